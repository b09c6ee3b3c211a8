#!/bin/sh
# Only what the scene requires: a device class that is not in `needs` has no event and no call, and its budgets are
# skipped with the reason; two fidelities of one class with one verdict tell the ratio of their costs.
. tests/cli.sh.inc

for class in shutters cameras displays monitors power gamepads; do
	"$program" run rooms/cabin.yaml "$scene" --no-pictures --json --fidelity "$class=-1" --out "$work/n" >"$work/n.json" 2>"$work/err"
	cost=$(field "$work/n.json" "sum(d['events'] + d['ops'] for d in r['devices'] if d['class'] == {'shutters': 'shutter', 'cameras': 'camera', 'displays': 'display', 'monitors': 'monitor', 'power': 'power', 'gamepads': 'gamepad'}['$class'])")
	check "without $class: 0 events, 0 calls" [ "$cost" = 0 ]
	failed=$(field "$work/n.json" "[b['metric'] for b in r['budgets'] if b['verdict'] == 'FAIL']")
	check "without $class: nothing fails, what cannot be judged is skipped" [ "$failed" = "[]" ]
done
for class in cameras displays shutters; do
	"$program" trade rooms/cabin.yaml "$scene" --device $class --json >"$work/t.json" 2>"$work/err"
	check "trade $class: both verdicts and the ratio" sh -c "[ $? = 0 ] && grep -q ratio '$work/t.json'"
done

# Cameras that deliver pictures: the same bytes twice, and a pose error to judge.
sed 's/cameras: 1/cameras: 2/' scenes/calibration.yaml >"$work/eyes.yaml"
for k in 1 2; do
	"$program" run rooms/cabin.yaml "$work/eyes.yaml" --no-pictures --duration 1 --json --out "$work/e$k" >"$work/e$k.json" 2>"$work/err"
	check "cameras at fidelity 2: exit 0" [ $? = 0 ]
done
hash="[r['event_log_sha256'], r['needs']['cameras'], [(b['metric'], b['value']) for b in r['budgets']]]"
check "the same events and values" [ "$(field "$work/e1.json" "$hash")" = "$(field "$work/e2.json" "$hash")" ]
check "a pose error below 0.3 mm" [ "$(field "$work/e1.json" "[0 < b['value'] < 0.3 for b in r['budgets'] if b['metric'] == 'pose_error']")" = "[True]" ]
"$program" trade rooms/cabin.yaml "$work/eyes.yaml" --device cameras --from 1 --duration 0.5 --json >"$work/t.json" 2>"$work/err"
check "trade of fidelities 1 and 2" [ "$(field "$work/t.json" "[p['fidelity'] for p in r['points']], r['same_verdict']")" = "([1, 2], True)" ]
"$program" bench blobs --seconds 0.05 --json >"$work/b.json" 2>"$work/err"
check "bench blobs: every spot found, a chessboard given up" [ "$(field "$work/b.json" "[(x['content'], x['spots'] == 64, x['overflow']) for x in r['rows'][5:]]")" = \
	"[('spots', True, False), ('white', False, False), ('chessboard', False, True)]" ]
"$program" bench blobs --kernel abacus >/dev/null 2>"$work/err"
check "bench blobs: BB1710" sh -c "[ $? = 2 ] && grep -q '^BB1710:' '$work/err'"
finish
