#!/bin/sh
# `make check-hw` against a stand-in room: `serve` puts the cabin's strips on loopback and a pty, rooms/standin.yaml sees
# them from outside, one over TCP, one over RTU. Classes without a real device are skipped with the reason.
. tests/cli.sh.inc
[ -x "${BB_HW_ROOM:-build/gcc/tests/hw_room}" ] || { echo "SKIP: hw_room is not built"; exit 77; }

"$program" serve rooms/cabin.yaml --modbus-port 0 --usbip-port 0 --pty --json >"$work/serve.json" 2>"$work/err" &
pid=$!
tries=0
until grep -q '^}' "$work/serve.json" 2>/dev/null || [ $tries = 100 ]; do
	sleep 0.05
	tries=$((tries + 1))
done
where() { # WIRE DEVICE
	field "$work/serve.json" "[e['where'] for e in r['endpoints'] if e['wire'] == '$1' and e['device'] == '$2'][0]"
}
sed -e "s#127.0.0.1:1502#$(where modbus-tcp power/pdu1)#" -e "s#/dev/pts/99#$(where modbus-rtu power/pdu2)#" \
	-e 's#?unit=1#?unit=1\&timeout_most_ms=400\&poll_ms=50#' rooms/standin.yaml >"$work/room.yaml"

count() { # RESULT CLASS
	field "$work/record.json" "len([x for x in r['rows'] if x['result'] == '$1' and x['class'] == '$2'])"
}
RECORD=$work/record.json tests/check-hw.sh "$work/room.yaml" --standin --switch pdu1/2 --switch pdu2/5 >"$work/out" 2>&1
check "the contracts pass" [ $? = 0 ]
check "8 checks of two strips passed" [ "$(count pass power)" = 8 ]
check "the other classes are skipped with a reason" [ "$(field "$work/record.json" "len([x for x in r['rows'] if x['result'] == 'skip' and x['reason']])")" = 6 ]
check "the record has a date" [ "$(field "$work/record.json" "r['date'][:2]")" = 20 ]
RECORD=$work/record.json tests/check-hw.sh "$work/room.yaml" --standin >"$work/out" 2>&1
check "nothing is switched unasked" [ "$(count pass power) $(count skip power)" = "4 4" ]
sed "s#127.0.0.1:[0-9]*#192.0.2.1:502#" "$work/room.yaml" >"$work/real.yaml"
RECORD=$work/no.json tests/check-hw.sh "$work/real.yaml" --standin >"$work/out" 2>&1
check "a real address is no stand-in" [ $? = 2 ]
{ cat "$work/room.yaml"; echo 'shutters: {chain: {device: "can:none0?node=1", rate_hz: 120, stages: [screen]}}'; } >"$work/chain.yaml"
RECORD=$work/no.json tests/check-hw.sh "$work/chain.yaml" --standin >"$work/out" 2>&1
check "a chain that may be real is no stand-in" [ $? = 2 ]
RECORD=$work/record.json tests/check-hw.sh "$work/chain.yaml" >"$work/out" 2>&1
check "a chain that is not there fails, and the record says why" [ "$(field "$work/record.json" "len([x for x in r['rows'] if x['class'] == 'shutter' and x['result'] == 'fail' and 'BB153' in x['reason']])")" = 6 ]
kill -TERM $pid
wait $pid
RECORD=$work/record.json tests/check-hw.sh "$work/room.yaml" --standin >"$work/out" 2>&1
check "a room that does not answer fails" [ $? = 1 ]
check "and the record says why" [ "$(field "$work/record.json" "len([x for x in r['rows'] if x['result'] == 'fail' and 'cannot be opened' in x['reason']])")" = 4 ]
finish
