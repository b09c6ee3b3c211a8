#!/bin/sh
# `trade SCENE`: JSON that parses and counts the same every time, fronts and answers that agree with the points, files of
# the kind their names say, and a number for every mistake.
. tests/cli.sh.inc

small="--generate cme --dim 40x40x40 --steps 4 --frames 24 --pictures 2 --timed 1 --size 64x48 --draw cpu"
few="--memory 0.25,1 --stream 8 --selector leaf,uniform --tolerance 0.1 --step 1,2 --brick 8 --type u8"
run() {
	"$program" trade $small $few --json "$@" 2>"$work/err"
}

run --frame-ms 1e6 --psnr 10 --csv "$work/t.csv" --plot "$work/t.svg" >"$work/a.json"
check "a small grid: exit 0" [ $? = 0 ]
run >"$work/b.json"
counted="[(p['changed'], p['setting'], p.get('quality'), p.get('counted')) for p in r['points']]"
check "two runs: the same settings, quality and counters" [ "$(field "$work/a.json" "$counted")" = "$(field "$work/b.json" "$counted")" ]
check "all points were played" [ "$(field "$work/a.json" "all('quality' in p for p in r['points']) and len(r['points'])")" = 10 ]
front="[i for i, p in enumerate(r['points']) if p['front_of_bytes']] == [i for i, p in enumerate(r['points']) if not any(
	q['quality']['psnr_db'] >= p['quality']['psnr_db'] and q['counted']['bytes_a_frame'] <= p['counted']['bytes_a_frame'] and
	(q['quality']['psnr_db'], q['counted']['bytes_a_frame']) != (p['quality']['psnr_db'], p['counted']['bytes_a_frame'])
	for q in r['points'])]"
check "the front of bytes is what nothing beats" [ "$(field "$work/a.json" "$front")" = True ]
best="r['points'][r['answers'][0]['point']]['quality']['psnr_db'] == max(p['quality']['psnr_db'] for p in r['points'])"
check "the best within a large budget is the best of all" [ "$(field "$work/a.json" "$best")" = True ]
check "CSV: a line for each point" [ "$(wc -l <"$work/t.csv")" = 11 ]
check "SVG" sh -c "head -c 200 '$work/t.svg' | grep -q '<svg'"
run --psnr 199 >/dev/null
check "a question without an answer: exit 1" [ $? = 1 ]

number() { # what, number, arguments
	what=$1 expected=$2
	shift 2
	"$program" trade "$@" >/dev/null 2>"$work/err"
	check "$what: BB$expected" sh -c "[ $? = 2 ] && grep -q '^BB$expected:' '$work/err'"
}
number "no arguments" 1701
number "a scene that is not there" 1001 nowhere.yaml
number "a scene without a volume" 1484 scenes/calibration.yaml
number "a selector that is not there" 1481 $small --selector leafs
number "an odd brick" 1481 $small --brick 7
number "a size" 1481 $small --size 0x0
number "a disk" 1481 $small --disk fast
number "a kind of data" 1430 --generate sheep --tf scenes/cme.tf
number "a table" 1483 --table pains
number "a set of a table" 1483 --table gains --set sheep
number "a room for a table that has its own" 1701 rooms/deck.yaml --table tracking --frames 10.5
number "a scene for a table" 1701 rooms/cabin.yaml scenes/walk.yaml --table prediction --frames 10.5
number "half a frame" 1704 --table tracking --frames 10.5
number "half a seed" 1704 --table tracking --seed 10.5 --frames 10
number "more pictures than frames" 1704 $small --frames 1
number "a kind of drawing" 1850 $small $few --plot "$work/t.jpg"
number "... before anything is looked for" 1850 nowhere.yaml --plot "$work/t.jpg"
"$program" volume build --generate cme --dim 32x32x32 --steps 2 --brick 8 --type u8 --out "$work/c.bricks" >/dev/null 2>&1
number "other bricks than the file's" 1482 "$work/c.bricks" --tf scenes/cme.tf --brick 16 --frames 2 --pictures 1 --size 32x32
number "other values than the file's" 1482 "$work/c.bricks" --tf scenes/cme.tf --type f32 --frames 2 --pictures 1 --size 32x32
finish
