#!/bin/sh
# The gate on virtual-clock counters: one extra brick a frame and one extra microsecond on a stage are caught, the
# unchanged build compared twenty times raises nothing, and no baseline is an exit code of its own.
. tests/cli.sh.inc

exits() { # CODE COMMAND...
	want=$1
	shift
	"$@" >"$work/out" 2>&1
	code=$?
	[ "$code" = "$want" ] || { echo "exit $code, want $want"; tail -5 "$work/out"; return 1; }
}
twenty() {
	for i in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
		"$program" bench --only cabin --baseline "$work/base.json" >"$work/out" 2>&1 || { tail -5 "$work/out"; return 1; }
	done
}

check "bench stores a baseline" exits 0 "$program" bench --out "$work/base.json"
check "the unchanged build compared 20 times raises nothing" twenty
check "one planted brick a frame is caught" exits 1 "$program" bench --baseline "$work/base.json" --plant-bricks 1
check "one planted microsecond is caught" exits 1 "$program" bench --baseline "$work/base.json" --plant-draw-us 1
check "no baseline is exit 5" exits 5 "$program" bench --only cabin --baseline "$work/none.json"
"$program" run rooms/cabin.yaml "$scene" --no-pictures --quiet --out "$work/a" >/dev/null 2>&1
"$program" run rooms/cabin.yaml "$scene" --no-pictures --quiet --out "$work/b" --plant-draw-us 1 >/dev/null 2>&1
"$program" run rooms/cabin.yaml "$scene" --no-pictures --quiet --out "$work/c" --seed 2 >/dev/null 2>&1
check "compare: the same" exits 0 "$program" compare "$work/a/result.json" "$work/a/result.json"
check "compare: a planted microsecond" exits 1 "$program" compare "$work/a/result.json" "$work/b/result.json"
check "compare: another seed cannot be compared" exits 6 "$program" compare "$work/a/result.json" "$work/c/result.json"
check "compare: no baseline" exits 5 "$program" compare "$work/none.json" "$work/a/result.json"
echo junk >"$work/junk.json"
check "compare: junk" exits 2 "$program" compare "$work/a/result.json" "$work/junk.json"
finish
