#!/bin/sh
# A room that asks for another barrier: every one runs, is the same twice, survives a node's crash and names it; a slow
# node draws coarser and the wall is back at full rate within 15 frames; several processes keep to the central one.
. tests/cli.sh.inc

mkdir "$work/profiles" && cp rooms/profiles/*.yaml "$work/profiles"
run() { # ROOM NAME OPTIONS...
	room=$1 name=$2
	shift 2
	"$program" run "$room" ${drawn:-scenes/calibration.yaml} --seed 7 --no-pictures --json --out "$work/$name" "$@" >"$work/$name.json" 2>"$work/err"
}
same() {
	[ "$(field "$work/$1.json" 'r["event_log_sha256"]')" = "$(field "$work/$2.json" 'r["event_log_sha256"]')" ]
}
holds() { # NAME EXPRESSION
	[ "$(field "$work/$1.json" "$2")" = True ] || { field "$work/$1.json" "$2"; return 1; }
}
# The longest time between two frames' begins from one frame to another, in frames of 60 Hz.
gap() { # NAME FROM TO MOST
	python3 - "$work/$1/frames.csv" "$2" "$3" "$4" <<'PY'
import csv, sys
at = [float(r["start_clock_ns"]) for r in csv.DictReader(open(sys.argv[1]))][int(sys.argv[2]):int(sys.argv[3])]
gap = max(b - a for a, b in zip(at, at[1:])) * 60e-9
print(gap)
sys.exit(gap > float(sys.argv[4]) + 0.02)
PY
}

for barrier in central tree dissemination timed; do
	sed "s/^link:/framelock: {barrier: $barrier}\nlink:/" rooms/cabin.yaml >"$work/$barrier.yaml"
	run "$work/$barrier.yaml" a-$barrier --duration 2
	check "$barrier: passes" [ $? = 0 ]
	run "$work/$barrier.yaml" b-$barrier --duration 2
	check "$barrier: the same twice" same a-$barrier b-$barrier
	run "$work/$barrier.yaml" crash-$barrier --duration 4 --fault "at 1s node/right crash for 1s"
	check "$barrier: a crash fails and names the node" holds crash-$barrier \
		'"node/right" in [i["culprit"] for i in r["incidents"]]'
	check "$barrier: it stops the others for three frames at most" gap crash-$barrier 0 -1 4
	check "$barrier: the node is back within 2 s" holds crash-$barrier \
		'[i["to_s"] for i in r["incidents"] if i["culprit"] == "node/right"][-1] < 4'
done
run rooms/cabin.yaml plain --duration 2
check "central is what a room has that says nothing" same plain a-central
check "timed flips are timed" holds a-timed 'r["counters"]["flips_timed"] > r["counters"]["frames"] * 0.8'
drawn=scenes/cme.yaml
run "$work/tree.yaml" slow --duration 5 --fault "at 1s node/right drag factor=5"
first=$(python3 -c 'import csv, sys; print(next(r["frame"] for r in csv.DictReader(open(sys.argv[1])) if r["late_node"] != "NA"))' "$work/slow/frames.csv")
check "a slow node is named as a straggler" holds slow '"STRAGGLER" in " ".join(i["what"] for i in r["incidents"])'
check "it draws coarser" holds slow 'r["counters"]["qualities_lowered"] >= 1'
check "from 15 frames on the wall runs at full rate" gap slow $((first + 15)) $((first + 75)) 1
drawn=
run rooms/cabin120.yaml genlock --duration 1
check "genlocked displays are proven to be locked" holds genlock 'r["facts"]["frame_lock"].startswith("locked: 5 genlocked displays, counters 0 apart")'
sed 's/^  - id: back .*/  - id: back\n    display: {kind: dlp, refresh_hz: 60, stereo: mono, genlock: true}/' rooms/cabin120.yaml >"$work/mixed.yaml"
run "$work/mixed.yaml" mixed --duration 1
check "a display of another rate is not compared" holds mixed 'r["facts"]["frame_lock"].startswith("locked: 4 genlocked displays")'
run rooms/cabin120.yaml apart --duration 1 --fault "at 0.1s display/front rate ppm=200" --fault "at 0.5s display/front unlock"
check "a display on its own crystal is seen" holds apart 'r["facts"]["frame_lock"].startswith("phases apart: 5 genlocked displays")'
"$program" run "$work/tree.yaml" scenes/cme.yaml --clock posix --nodes 2 --duration 1 --no-pictures --quiet --out "$work/n" >"$work/out" 2>"$work/err"
code=$?
check "several processes keep to the central barrier" sh -c "[ $code = 2 ] && grep -q BB1662 '$work/err'"
sed "s/^link:/framelock: {barrier: hope}\nlink:/" rooms/cabin.yaml >"$work/hope.yaml"
"$program" room check "$work/hope.yaml" >"$work/out" 2>&1
check "another word is refused" [ $? = 2 ]

# The bake-off.
bake() {
	"$program" bench barrier --simulated --endpoints 2,6 --loss 0,10 --frames 50 --json "$@"
}
bake --png "$work/bake.png" >"$work/bake.json" && bake >"$work/again.json"
check "bench barrier: the same twice" cmp -s "$work/bake.json" "$work/again.json"
check "bench barrier: a picture" [ -s "$work/bake.png" ]
bake --seed 8 >"$work/other.json"
check "bench barrier: another seed, other numbers" sh -c "! cmp -s '$work/bake.json' '$work/other.json'"
check "bench barrier: six nodes within the bars" holds bake \
	'all(x["skew_us"]["p99"] <= {"central": 300, "timed": 20}.get(x["method"], 500) for x in r["simulated"]["rows"] if not x["loss_percent"])'
bake --endpoints 6,2 --loss 10,0 >"$work/turned.json"
check "bench barrier: lists in any order" cmp -s "$work/bake.json" "$work/turned.json"
bake --endpoints 64 --loss 50 --delay-us 100000 --jitter-us 10000 >"$work/still.json"
check "bench barrier: where no frame comes together, no numbers but the row" holds still \
	'[(x["frames"], "skew_us" in x) for x in r["simulated"]["rows"] if x["loss_percent"]] == [(0, False)] * 4'
for bad in "--endpoints 1" "--endpoints 2,x" "--endpoints 2.5" "--endpoints 2,513" "--loss 51" "--loss nan" "--frames 9" "--real" \
	"--real --png $work/no.png"; do
	# shellcheck disable=SC2086
	"$program" bench barrier --simulated $bad >"$work/out" 2>"$work/err"
	check "bench barrier: refused with a number: $bad" [ $? = 2 ]
done
finish
