#!/usr/bin/dash
# In the guest: check-hw's contracts against a room whose camera and pads are behind the kernel: `serve` on USB/IP, attached
# by the stock usbip, read by the shipped drivers as a real room is.
mkdir -p /var/run
cd /tmp || exit 1
room() { # CAMERA PAD MOUSE XBOX: a room with those devices
	case_desk.sh && cat <<END
cameras:
  - {id: c1, device: "$1", position_m: [0, 1.36, 0.02], look_at_m: [0, 1.2, 0.65], pixels: [640, 480], fov_deg: 56, rate_hz: 60, sync: display}
gamepads:
  - {id: pad, model: rumblepad2, device: "$2"}
  - {id: mouse, model: spacemouse, device: "$3"}
  - {id: x1, model: xbox360, device: "$4"}
bodies:
  glasses:
    markers_mm: [[0, 0, 0], [151, 11, -17], [62, 31, 12], [25, 21, -35], [130, 33, -40]]
    eyes_mm: [75, -8, 16]
END
}
room sim: sim: sim: sim: >served.yaml
room "usb:131d:0157?serial=c1&stamps=device" hid:046d:c219 evdev:256f:c62e "usb:045e:0719?slot=1" >room.yaml
: >serve.txt
serve_room serve served.yaml >serve.txt 2>&1 &
server=$!
until grep -q serving serve.txt; do sleep 0.05; done
sed -n 's/.*modprobe vhci-hcd; //p' serve.txt | while read -r line; do
	$line || echo "not attached: $line"
done
sleep 1.5
hw_room room.yaml --out record.json --date 2026-01-01T00:00:00Z
code=$?
grep -E '"(check|result|found|reason)"' record.json
kill $server
wait $server
[ "$(grep -c '"result": "pass"' record.json)" = 14 ] || exit 1
exit $code
