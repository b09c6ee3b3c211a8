#!/bin/sh
# Every fault a user can plant from the command line turns the verdict to FAIL and names its culprit; without a fault
# the rooms pass. (README: "Break it".)
. tests/cli.sh.inc

fails_with() { # CULPRIT FAULT...: exit 1, and the summary or a budget names the culprit
	culprit=$1
	shift
	set -- "$@"
	args=
	for fault in "$@"; do
		args="$args --fault '$fault'"
	done
	eval "$program" run rooms/cabin.yaml "$scene" --seed 7 --no-pictures --json --out "$work/f" $args >"$work/f.json" 2>"$work/err"
	code=$?
	[ "$code" = 1 ] || { echo "exit code $code, want 1"; head -3 "$work/err"; return 1; }
	named=$(field "$work/f.json" '" ".join(sorted(set(b["culprit"] for b in r["budgets"] if b["verdict"] == "FAIL")))')
	case " $named " in
	*" $culprit "* | *" $culprit"*) return 0 ;;
	esac
	echo "culprits: $named, want $culprit"
	return 1
}

for room in cabin cabin120; do
	"$program" run rooms/$room.yaml "$scene" --seed 7 --no-pictures --quiet --out "$work/ok" >"$work/out" 2>&1
	check "$room passes without faults" [ $? = 0 ]
done
"$program" run rooms/desk.yaml scenes/desk.yaml --seed 7 --no-pictures --quiet --out "$work/ok" >"$work/out" 2>&1
check "desk passes without faults" [ $? = 0 ]

check "a camera covered" fails_with camera/c3 "at 2.0s camera/c3 cover for 3s"
check "two cameras dark" fails_with camera/c1 "at 2.0s camera/c1 dark" "at 2.0s camera/c2 dark"
both=$(field "$work/f.json" '" ".join(sorted(i["culprit"] for i in r["incidents"]))')
check "both dark cameras have an incident" [ "$both" = "camera/c1 camera/c2" ]
check "eye polarity flipped in the middle" fails_with shutter/chain "at 5s shutter/chain flip_polarity"
check "node right one frame late for 20 frames" fails_with node/right "at 3s node/right late frames=1 for 20 frames"
check "a monitor on the wrong input" fails_with monitor/front-m "at 1s monitor/front-m input value=0x11"
check "an outlet whose relay is stuck" fails_with power/pdu1 "at boot power/pdu1 stick outlet=2"
check "the gamepad silent with a deflected stick" fails_with gamepad/pad "at 3s gamepad/pad silence"
# A low battery and a stuck axis are warnings by name; a room that sets a budget fails on them.
warned() { # ROOM CODE WORDS FAULT
	"$program" run "$1" "$scene" --seed 7 --duration 12 --no-pictures --json --out "$work/f" --fault "$4" >"$work/f.json" 2>"$work/err"
	code=$?
	[ "$code" = "$2" ] || { echo "exit code $code, want $2"; return 1; }
	field "$work/f.json" '" ".join(i["culprit"] + " " + i["state"] + " " + i["what"] for i in r["incidents"])' | grep -q "$3"
}
mkdir "$work/profiles" "$work/scenes" && cp rooms/profiles/*.yaml "$work/profiles" && cp -r scenes/pads "$work/scenes"
sed 's/^budgets:/budgets:\n  pad_battery: {min_percent: 15}\n  pad_stuck: {max_s: 8}/' rooms/cabin.yaml >"$work/strict.yaml"
low="at 1s gamepad/mouse battery level=0.05" stuck="at 0.5s gamepad/mouse stick_axis axis=3 value=0.4"
check "a low battery is a warning" warned rooms/cabin.yaml 0 "gamepad/mouse WARNING PAD_BATTERY low: 5 %" "$low"
check "a stuck axis is a warning" warned rooms/cabin.yaml 0 "gamepad/mouse WARNING PAD_DRIFT axis 3" "$stuck"
check "a low battery beyond the room's budget fails" warned "$work/strict.yaml" 1 "gamepad/mouse WARNING PAD_BATTERY" "$low"
check "so does a stuck axis" warned "$work/strict.yaml" 1 "gamepad/mouse WARNING PAD_DRIFT" "$stuck"
check "a shutter stage 900 us off phase" fails_with shutter/chain "at 1s shutter/chain stage_offset stage=left us=900"

for bad in "camera/c3 cover" "at 2s camera/c3 fly" "at 2s camera/nobody cover" "at -1s camera/c3 cover" \
	"at 2s camera/c3 cover for nans" "at 1e99s camera/c3 cover" "at 2s shutter/chain stage_offset stage=moon us=1"; do
	"$program" run rooms/cabin.yaml "$scene" --no-pictures --fault "$bad" --out "$work/bad" >"$work/out" 2>"$work/err"
	code=$?
	check "refused with a number: $bad" sh -c "[ $code = 2 ] && grep -q '^BB16[0-9][0-9]: ' '$work/err'"
done
"$program" run --list-faults >"$work/list"
check "--list-faults covers every class" sh -c \
	"for c in shutter camera display monitor power gamepad link node modbus ddc; do grep -q \"^\$c \" '$work/list' || exit 1; done"
finish
