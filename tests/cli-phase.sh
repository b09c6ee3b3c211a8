#!/bin/sh
# tests/cli-phase.sh: `phase` plans two rooms, refuses a third, and puts a run's edges beside the plan.
set -u
cd "$(dirname "$0")/.." || exit 2
. tests/cli.sh.inc

plan() { # ROOM [OPTIONS]: into $work/out
	room=$1
	shift
	"$program" phase "rooms/$room.yaml" "$@" >"$work/out" 2>"$work/err"
}
gives() { # CODE COMMAND...
	want=$1
	shift
	"$@"
	[ $? = "$want" ]
}
says() {
	grep -q -e "$1" "$work/out" "$work/err"
}

for room in cabin cabin120; do
	check "$room: a plan" gives 0 plan $room --json
	check "$room: within the budget, the same each time" sh -c "'$program' phase rooms/$room.yaml --json | cmp -s - '$work/out'"
	check "$room: numbers" [ "$(field "$work/out" "r['planned']['possible'] and 0 < r['planned']['crosstalk_percent'] <= 2 \
and len(r['walls']) == 5 and r['tokens_and_strobes_apart'] and r['cameras'][0]['n'] == 8 \
and r['planned']['light_percent'] >= r['as_in_file']['light_percent'] and r['as_in_file']['possible']")" = True ]
done
check "lcd120: refused" gives 1 plan lcd120 --json
check "lcd120: the part, and what it would take" [ "$(field "$work/out" "not r['planned']['possible'] and r['stops'] == 'vblank_us' \
and r['needs']['vblank_us']['needed'] > 3000 and r['needs']['cell_close_us']['needed'] is None")" = True ]
check "lcd120: in words" gives 1 plan lcd120
check "... with the part" says 'NOT POSSIBLE.*vertical blank'
check "a limit nothing holds" gives 1 plan cabin120 --limit-percent 0.05
check "... and contrast is why" says 'contrast of the cells stops it'
check "a limit that cannot be" gives 2 plan cabin120 --limit-percent nan
check "... with its number" says BB1704
sed 's/protocol: 3d-vision/protocol: nuvision/' rooms/lcd120.yaml >"$work/nuvision.yaml"
check "tokens nobody knows" sh -c "'$program' phase '$work/nuvision.yaml' | grep -q 'nuvision.*known: 3d-vision.* epson$'"
check "a room without stereo" gives 2 plan desk
check "... with its number" says BB1610

check "a drawing" gives 0 plan cabin120 --svg "$work/a.svg" --png "$work/a.png"
check "... of both kinds" sh -c "grep -q '<svg' '$work/a.svg' && head -c 4 '$work/a.png' | grep -q PNG"
check "a drawing of another kind" gives 2 plan cabin120 --svg "$work/a.pdf"
check "the trade" gives 0 plan cabin120 --trade --json --svg "$work/trade.svg"
check "... light grows with crosstalk" [ "$(field "$work/out" "len(r['points']) > 15 and all(a['light_percent'] <= b['light_percent'] \
and a['crosstalk_percent'] <= b['limit_percent'] for a, b in zip(r['points'], r['points'][1:]))")" = True ]

check "a trade of one limit" gives 2 plan cabin120 --trade --limit-percent 1
check "... is wrong usage" says BB1701

cat >"$work/short.yaml" <<'YAML'
scene: short
technique: calibration
duration_s: 1
needs: {shutters: 1, displays: 1}
YAML
check "a run writes its edges" sh -c "'$program' run rooms/cabin120.yaml '$work/short.yaml' --seed 1 --out '$work/run' >/dev/null"
check "... which are read" gives 0 plan cabin120 --measured "$work/run/edges.csv" --json --png "$work/m.png"
edges="{(e['track'], e['eye']): e for e in r['measured']['edges']}"
check "... with vblanks on their edges and the glasses where the file has them" [ "$(field "$work/out" \
	"abs($edges['vblank:front', 'left']['mean_us']) < 10 and abs($edges['glasses', 'right']['mean_us'] - 8403) < 60")" = True ]
echo "t_ns,track,eye,event
1,glasses,left" >"$work/bad.csv"
check "edges that are none" gives 2 plan cabin120 --measured "$work/bad.csv"
check "... with number and line" says 'BB1613.*bad.csv:2'
finish
