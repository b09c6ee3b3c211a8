#!/bin/sh
# 416 monitors: loading and checking the room, drawing it, and a virtual minute of it. Wall time is printed; it fails
# only at five times the limit (0.5 s, 30 s), as a guard against hanging.
. tests/cli.sh.inc

clock() { # SECONDS COMMAND...: runs it under the guard, prints what it took
	guard=$1
	shift
	start=$(date +%s.%N)
	timeout "$guard" "$@" >"$work/out" 2>&1
	code=$?
	python3 -c "print('took %.2f s of at most $guard s' % ($(date +%s.%N) - $start))"
	[ "$code" = 0 ] || tail -5 "$work/out"
	return $code
}

check "room check rooms/deck.yaml (limit 0.5 s)" clock 2.5 "$program" room check rooms/deck.yaml
check "it has 416 monitors" grep -q 416 "$work/out"
check "room draw rooms/deck.yaml" clock 25 "$program" room draw rooms/deck.yaml --out "$work/deck.png"
check "60 virtual seconds of the deck (limit 30 s)" clock 150 "$program" run rooms/deck.yaml scenes/calibration.yaml \
	--duration 60 --no-pictures --quiet --out "$work/deck"
check "every needed camera tracked" sh -c "[ \$(python3 -c 'import json; r = json.load(open(\"$work/deck/result.json\")); print(r[\"counters\"][\"poses_solved\"] > 10000)') = True ]"
finish
