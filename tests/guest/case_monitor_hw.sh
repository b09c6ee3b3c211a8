#!/usr/bin/dash
# In the guest: check-hw's contract against two displays on the kernel's i2c buses, one named by its bus, one by the serial in
# its EDID; only the first may be written. usage: case_monitor_hw.sh BUS SERIAL
cd /tmp || exit 1
{ case_desk.sh && cat <<END; } >room.yaml
monitors:
  - {id: left, device: "i2c:$1", edid: S27A850D}
  - {id: right, device: "i2c:?serial=$2", edid: S27A850D}
END
hw_room room.yaml --switch left --out record.json --date 2026-01-01T00:00:00Z
code=$?
grep -E '"(check|result|found|reason)"' record.json
[ "$(grep -c '"result": "pass"' record.json)" = 18 ] && [ "$(grep -c 'may be changed' record.json)" = 2 ] || exit 1
exit $code
