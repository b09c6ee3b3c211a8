#!/usr/bin/dash
# case_can.sh chain|sync|faults|garbage|hw|hardware: in the guest, `blackburst serve` puts a room's chain on vcan0, and the
# shipped driver drives it (can_chain). chain: phases at each switch, and candump writes down what is on the wire, for
# judge_can_chain.sh; sync: phases with each SYNC; faults: C1 to C6 of the wire; garbage: random frames before the driver
# comes, and once more while it works; hw: check-hw on that chain; hardware: what serve refuses, and then the same through
# two real controllers on one emulated bus.
ip link add dev vcan0 type vcan && ip link set up vcan0 || exit 1
cat >/tmp/room.yaml <<'END'
room: a chain
neutral_m: [0, 1.6, 0]
nodes:
  - {id: head, head: true}
walls:
  - id: front
    node: head
    corners_m: {lower_left: [-1.5, 0, -1.5], lower_right: [1.5, 0, -1.5], upper_left: [-1.5, 2.3, -1.5]}
    pixels: [1400, 1050]
    display: {kind: lcd, refresh_hz: 60, stereo: dual-projector-external-shutter}
  - id: left
    node: head
    corners_m: {lower_left: [-1.5, 0, 1.5], lower_right: [-1.5, 0, -1.5], upper_left: [-1.5, 2.3, 1.5]}
    pixels: [1400, 1050]
    display: {kind: lcd, refresh_hz: 60, stereo: dual-projector-external-shutter}
shutters:
  chain: {rate_hz: 120, stages: [front, left], stage_delay_us: 35, rate_error_ppm: 12, jitter_us: 1}
  emitter: {protocol: 3d-vision, offset_us: 3000}
END

garbage() { # FRAMES SEED: random frames, 5000 a second, one in eight of 29 bits, as candump writes them
	awk -v n="$1" -v seed="$2" 'BEGIN {
		srand(seed)
		for (i = 0; i < n; i++) {
			id = rand() < 0.125 ? sprintf("%08X", int(rand() * 536870912)) : sprintf("%03X", int(rand() * 2048))
			data = ""
			for (k = int(rand() * 9); k > 0; k--) data = data sprintf("%02X", int(rand() * 256))
			printf "(%.6f) vcan0 %s#%s\n", i * 0.0002, id, data
		}
	}'
}

serve() { # ARGUMENTS...
	: >/tmp/serve
	blackburst_serve serve /tmp/room.yaml --can "$@" >/tmp/serve 2>&1 &
	server=$!
	i=0
	until grep -q 'can:.*?node=1' /tmp/serve || [ $i = 100 ]; do
		sleep 0.02
		i=$((i + 1))
	done
}

refused() { # NUMBER INTERFACE
	blackburst_serve serve /tmp/room.yaml --can "$2" --for 0.1 >/tmp/serve 2>&1
	code=$?
	[ $code != 0 ] && grep -q "^BB$1: " /tmp/serve || { echo "no BB$1 for $2, exit code $code:"; cat /tmp/serve; exit 1; }
	sed 's/; likely.*//' /tmp/serve
}

ended() { # CODE: serve ends well, too
	kill -TERM $server
	wait $server || { echo "serve: exit code $?"; cat /tmp/serve; exit 1; }
	exit "$1"
}

case $1 in
chain)
	candump -L vcan0 >/tmp/dump &
	dump=$!
	sleep 0.2
	serve vcan0 --fault "at 4s can/chain emergency stage=left for 0.3s"
	can_chain "can:vcan0?node=1" 2 2 NODE >/tmp/result
	code=$?
	kill -INT $dump
	wait $dump
	gzip -c /tmp/dump | base64 | sed 's/^/log: /' # a quarter of the bytes: the serial line is slow
	cat /tmp/result
	ended $code
	;;
sync)
	serve vcan0
	can_chain "can:vcan0?node=1&pdo_type=1" 2 5
	ended $?
	;;
faults)
	serve vcan0 --fault "at 2s can/chain babble id=0x123 us=1000 for 0.5s" --fault "at 9s can/chain unplug stage=left for 0.6s" \
		--fault "at 11.5s can/chain power stage=front for 0.6s" --fault "at 14s can/chain drop_sync n=3 for 1s" \
		--fault "at 16s can/chain freeze stage=left for 0.3s" --fault "at 18s can/chain late_sync us=3000 for 0.2s" \
		--fault "at 20s can/chain twin" --fault "at 21.5s can/chain bad_sync" --fault "at 23s shutter/chain stuck for 0.3s" \
		--fault "at 25s can/chain bus_off for 0.2s"
	(sleep 27; ip link set vcan0 down; sleep 0.7; ip link set vcan0 up) &
	# In this order, so that none can be taken for another.
	can_chain "can:vcan0?node=1" 2 0.5 BABBLE NODE_LOST NODE_LOST SYNC_LATE STALE SYNC_LATE DUP_ID PROTO NODE BUS_OFF IF_DOWN
	ended $?
	;;
garbage)
	serve vcan0
	garbage 8000 7 >/tmp/before && garbage 3000 8 >/tmp/during && canplayer -I /tmp/before || exit 1
	cansend vcan0 "000#8100" # every controller begins anew, whatever it was told
	# Emergencies that nobody had stand until their node begins anew.
	(sleep 4; canplayer -I /tmp/during; cansend vcan0 "000#8100") &
	can_chain "can:vcan0?node=1" 2 2 any
	ended $?
	;;
hw)
	serve vcan0
	sed 's/chain: {/chain: {device: "can:vcan0?node=1", /' /tmp/room.yaml >/tmp/hw.yaml
	hw_room /tmp/hw.yaml --standin --date 2026-01-01 --out /tmp/record 2>&1
	code=$?
	tr -d '\n' </tmp/record | tr -s ' '
	echo
	[ "$(grep -c '"result": "pass"' /tmp/record)" = 6 ] || code=1
	ended $code
	;;
hardware)
	refused 1531 vcan7
	ip link add dev vcan7 type vcan
	refused 1532 vcan7
	for interface in can0 can1; do
		ip link set $interface type can bitrate 1000000 restart-ms 100 && ip link set up $interface || exit 1
	done
	refused 1578 can0
	serve can0 --can-hardware
	can_chain "can:can1?node=1" 2 2
	ended $?
	;;
esac
