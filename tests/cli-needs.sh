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
finish
