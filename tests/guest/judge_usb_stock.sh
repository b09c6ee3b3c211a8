#!/bin/sh
# tests/guest/judge_usb_stock.sh <OUTPUT: does what usbip, lsusb and evtest said in case_usb_stock.sh agree with what the
# simulated devices are and with what the pads' script made them do?
set -u
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/out"
failures=0

part() { # NAME: the lines below "== NAME"
	awk -v name="== $1" '/^== / { on = $0 == name; next } on' "$work/out"
}

check() { # WHAT COMMAND...
	what=$1
	shift
	"$@" >/dev/null && return
	echo "not so: $what"
	failures=$((failures + 1))
}

has() { # PART PATTERN
	part "$1" | grep -q -e "$2"
}

lacks() {
	! part "$1" | grep -i -e "$2"
}

equals() { # PART WANTED: the events of a device, one "CODE VALUE" a line
	part "$1" | sed -n 's/^Event: .*type [13] ([A-Z_]*), code [0-9]* (\([A-Z_0-9]*\)), value \(-*[0-9]*\)$/\1 \2/p' >"$work/events"
	echo "$2" | tr ',' '\n' | sed 's/^ *//' | diff - "$work/events" >&2
}

# usbip's list: bus id, identity, classes of interfaces.
check "four devices are listed" [ "$(part list | grep -c '^ *1-[1-4]: .*([0-9a-f]*:[0-9a-f]*)$')" = 4 ]
check "1-1 is the camera" has list '1-1: .*(131d:0157)'
check "1-2 is the RumblePad" has list '1-2: .*(046d:c219)'
check "1-3 is the SpaceMouse" has list '1-3: .*(256f:c62e)'
check "1-4 is the receiver" has list '1-4: .*(045e:0719)'
check "two HID interfaces" [ "$(part list | grep -c ' 0 - .*(03/00/00)')" = 2 ]
check "eight interfaces of a receiver" [ "$(part list | grep -c ' [0-7] - .*(ff/5d/8[12])')" = 8 ]
check "the lines that serve prints attach them all" [ "$(part attach | grep -c '^attached: usbip attach -r 127.0.0.1 -b 1-[1-4]$')" = 4 ]
check "all are attached, and the adapter" has attached '^5$'
check "what a fault pulls out is gone for the kernel" lacks end '131d:0157\|046d:c219'
check "the others stay" [ "$(part end | grep -c 'ID \(256f:c62e\|045e:0719\) blackburst')" = 2 ]

# lsusb: identity, class, endpoints, sizes; it complains of nothing.
for id in 131d:0157 046d:c219 256f:c62e 045e:0719 1c40:0534; do
	check "$id: lsusb has no complaint" lacks "lsusb -v $id" "couldn't\|can't\|cannot\|unavailable\|warning\|error\|invalid\|unknown\|junk"
	check "$id: its identity" has "lsusb -v $id" "ID $id blackburst"
	check "$id: a status" has "lsusb -v $id" '^Device Status: *0x0000'
done
endpoints() { # ID ADDRESS TYPE SIZE INTERVAL: one of its endpoints
	part "lsusb -v $1" | awk -v a="$2" -v t="$3" -v s="$4" -v i="$5" '
		$1 == "bEndpointAddress" { on = $2 == a; if (on) n++ } on && $1 == "Transfer" { type = $3 }
		on && $1 == "wMaxPacketSize" { size = $4 } on && $1 == "bInterval" { every = $2 }
		END { exit !(n == 1 && type == t && size == s && every == i) }'
}
check "camera: vendor class" has "lsusb -v 131d:0157" 'bInterfaceClass *255'
check "camera: bulk out" endpoints 131d:0157 0x01 Bulk 512 0
check "camera: bulk in" endpoints 131d:0157 0x82 Bulk 512 0
check "camera: its serial number" has "lsusb -v 131d:0157" 'iSerial *3 c1'
check "RumblePad: HID" has "lsusb -v 046d:c219" 'bInterfaceClass *3 '
check "RumblePad: interrupt in" endpoints 046d:c219 0x81 Interrupt 8 8
check "RumblePad: its report descriptor is whole" has "lsusb -v 046d:c219" 'Report Descriptor: (length is 96)'
check "RumblePad: is a game pad" has "lsusb -v 046d:c219" '^ *Gamepad$'
check "SpaceMouse: interrupt in" endpoints 256f:c62e 0x81 Interrupt 16 8
check "SpaceMouse: its report descriptor is whole" has "lsusb -v 256f:c62e" 'Report Descriptor: (length is 117)'
check "SpaceMouse: has a battery" has "lsusb -v 256f:c62e" 'Report ID, data= \[ 0x17 \] 23'
for i in 1 2 3 4 5 6 7 8; do
	every=$((i % 2 ? 1 : 2)) out=$((i % 2 ? 8 : 4))
	check "receiver: endpoint $i in" endpoints 045e:0719 "0x8$i" Interrupt 32 $every
	check "receiver: endpoint $i out" endpoints 045e:0719 "0x0$i" Interrupt 32 $out
done
check "adapter: no endpoints but control" has "lsusb -v 1c40:0534" 'bNumEndpoints *0'

# evtest, behind the kernel's drivers: what the script says, in each device's own counts. The first report tells where
# the axes rest, which is not where the kernel begins.
pad="evtest blackburst Cordless RumblePad 2"
check "RumblePad: twelve buttons" [ "$(part "$pad" | grep -c 'Event code 3[01][0-9] (BTN_')" = 12 ]
check "RumblePad: hid-logitech's motors" has "$pad" 'FF_RUMBLE'
check "RumblePad: what the script says" equals "$pad" "ABS_X 192,ABS_Y 127,ABS_Z 128,ABS_RZ 127,ABS_X 1,ABS_X 128,BTN_EAST 1,\
BTN_EAST 0,ABS_HAT0X 1,ABS_HAT0X 0,ABS_Z 64,ABS_Z 128"
mouse="evtest blackburst SpaceMouse Wireless"
check "SpaceMouse: six axes of 350" [ "$(part "$mouse" | grep -c 'Max *350$')" = 6 ]
check "SpaceMouse: what the script says" equals "$mouse" "ABS_X 175,ABS_X -350,ABS_X 0,BTN_1 1,BTN_1 0,ABS_RZ -350,ABS_RZ 0,\
ABS_Y -175,ABS_Y 0"
xbox="evtest Xbox 360 Wireless Receiver"
check "Xbox: xpad's name for it" has "$xbox" 'vendor 0x45e product 0x2a1'
check "Xbox: what the script says" equals "$xbox" "ABS_X 16384,ABS_X -32767,ABS_X 0,BTN_EAST 1,BTN_EAST 0,\
BTN_TRIGGER_HAPPY2 1,ABS_HAT0X 1,BTN_TRIGGER_HAPPY2 0,ABS_HAT0X 0,ABS_RX -16384,ABS_RX 0"

[ $failures = 0 ]
