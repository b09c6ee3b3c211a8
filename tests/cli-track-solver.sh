#!/bin/sh
# `bench track` and `trade --table prediction`: exit codes, JSON that agrees with the promises, counters that are the same
# every time, drawings, and a number for every mistake.
. tests/cli.sh.inc

"$program" bench track --walk --frames 2000 --json >"$work/a.json"
check "bench track --walk: exit 0" [ $? = 0 ]
"$program" bench track --walk --frames 2000 --json >"$work/b.json"
check "the same every time" cmp -s "$work/a.json" "$work/b.json"
check "no wrong label, found again at once, honest" [ "$(field "$work/a.json" "(r['wrong_labels'] == 0 and r['wrong_poses'] == 0 and
	r['losses'] >= 1 and r['most_frames_back'] <= 3 and 0.93 < r['position']['share'] < 0.97 and r['rms_mm'] < 0.3)")" = True ]
"$program" bench track --walk --frames 200 --fidelity 0 >/dev/null
check "cameras without noise, sigmas with: exit 1" [ $? = 1 ]

"$program" bench track --cameras 4 --bodies 2 --blobs 20 --sets 20 --json >"$work/c.json"
check "bench track: exit 0" [ $? = 0 ]
"$program" bench track --cameras 4 --bodies 2 --blobs 20 --sets 20 --json >"$work/d.json"
counted="[(r['usual'][k]['pairs'], r['usual'][k]['points'], r['usual'][k]['poses'], r['usual']['solved']) for k in ('work', 'cold_work')]"
check "its work is counted the same every time" [ "$(field "$work/c.json" "$counted")" = "$(field "$work/d.json" "$counted")" ]
check "it tells cost" [ "$(field "$work/c.json" "r['usual']['cameras'] == 4 and 0 < r['usual']['median_us'] <= r['usual']['p99_us'] <= r['usual']['most_us']")" = True ]
"$program" bench track --cameras 99 >/dev/null 2>"$work/err"
check "99 cameras: exit 2" [ $? = 2 ]
"$program" bench track rooms/rhythm.yaml --walk >/dev/null 2>"$work/err"
check "a room that is not there: exit 2" [ $? = 2 ]

"$program" trade --table prediction --frames 1500 --json --plot "$work/p.svg" >"$work/p.json"
check "trade --table prediction: exit 0" [ $? = 0 ]
check "at 40 ms a third or less, both" [ "$(field "$work/p.json" "[3 * p['rms_mm'] < p['still_rms_mm'] and 3 * p['rms_deg'] < p['still_rms_deg']
	for p in r['points'] if p['horizon_ms'] == 40]")" = "[True]" ]
check "a drawing" grep -q '<svg' "$work/p.svg"
"$program" trade --table prediction --frames 5 >/dev/null 2>"$work/err"
check "five frames: exit 2" [ $? = 2 ]
check "and a number" grep -q BB1704 "$work/err"
finish
