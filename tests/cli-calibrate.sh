#!/bin/sh
# tests/cli-calibrate.sh: a simulated dance as a file, the calibration made from it, a room that uses it, touched corners
# that move it, and what is refused.
set -u
cd "$(dirname "$0")/.." || exit 2
. tests/cli.sh.inc

track() { # WORD... : into $work/out and $work/err
	"$program" track "$@" >"$work/out" 2>"$work/err"
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
cabin=rooms/cabin.yaml

check "a dance, simulated" gives 0 track calibrate $cabin --simulate --seconds 20 --outliers 10 --knock c3 --json \
	--save "$work/dance.txt" --out "$work/simulated.yaml" --svg "$work/left.svg"
check "holds, and finds c3" [ "$(field "$work/out" "r['truth']['holds'] and r['knocked'] == 1 and r['cameras'][2]['knocked'] \
and r['truth']['outliers_found'] > 0.95 * r['truth']['outliers']")" = True ]
check "a picture" grep -q "</svg>" "$work/left.svg"
check "from its file" gives 0 track calibrate $cabin --sequence "$work/dance.txt" --date 2026-11-22 --out "$work/cal.yaml" --json
check "the same rms" [ "$(field "$work/out" "0.09 < r['rms_px'] < 0.11 and len(r['cameras']) == 8")" = True ]
check "says whose it is" grep -q "^made: \"2026-11-22\"" "$work/cal.yaml"

here=$(pwd)
sed 's/^room: immersive-cabin/&\ncalibration: cal.yaml/' $cabin >"$work/room.yaml"
cp -r rooms/profiles "$work/"
check "a room with it loads" sh -c "cd '$work' && '$here/$program' room check room.yaml >out 2>err; [ \$? -le 1 ]"
check "and has other cameras" says "BB1156"
sed 's/fov_deg: 74/fov_deg: 75/' "$work/room.yaml" >"$work/changed.yaml"
check "another plan: stale" sh -c "cd '$work' && '$here/$program' room check changed.yaml 2>err; [ \$? = 2 ]"
check "by its number" says "BB1738"

printf 'front lower_left -1.514 0.022 -1.533\nfront lower_right 1.535 0.021 -1.532\nfront upper_left -1.515 2.307 -1.531\n' >"$work/touched"
check "corners" gives 0 track align $cabin --touched "$work/touched" --out "$work/aligned.yaml" --json
check "move it" [ "$(field "$work/out" "abs(r['moved_m'][1] + 0.02) < 0.002 and r['rms_mm'] < 3 and r['sigma_mm'] > 1")" = True ]
check "into the file" grep -q "^moved_m: \[-0.0" "$work/aligned.yaml"
sed 3d "$work/touched" >"$work/edge"
check "an edge: refused" gives 2 track align $cabin --touched "$work/edge"
check "an edge: 1741" says "BB1741"
sed '3s/2.307/2.207/' "$work/touched" >"$work/wrong"
check "a wrong corner: refused" gives 2 track align $cabin --touched "$work/wrong"
check "a wrong corner: 1742" says "BB1742"
echo "front lower_left nan 0 0" >>"$work/edge"
check "no number: 1740" gives 2 track align $cabin --touched "$work/edge"
check "its line" says "BB1740.*:3"

sed 's/cal.yaml/aligned.yaml/' "$work/room.yaml" >"$work/again.yaml"
check "again, onto itself" gives 0 track align "$work/again.yaml" --touched "$work/touched" --out "$work/aligned.yaml"
before=$(cksum <"$work/cal.yaml")
check "a calibration the room does not name: spared" gives 2 track align $cabin --touched "$work/touched" --out "$work/cal.yaml"
check "a plan, moved" gives 0 track align $cabin --touched "$work/touched" --out "$work/plan.yaml"
check "over itself" gives 0 track align $cabin --touched "$work/touched" --out "$work/plan.yaml"
check "the sequence: spared" gives 2 track calibrate $cabin --sequence "$work/dance.txt" --out "$work/dance.txt"
check "the room: spared" gives 2 track calibrate "$work/room.yaml" --sequence "$work/dance.txt" --png "$work/../$(basename "$work")/room.yaml"
check "as they were" sh -c "[ '$before' = \"\$(cksum <'$work/cal.yaml')\" ] && head -1 '$work/dance.txt' | grep -q wand"

check "neither of both" gives 2 track calibrate $cabin
check "no such camera" gives 2 track calibrate $cabin --simulate --knock c99
head -c 20000 "$work/dance.txt" >"$work/cut.txt"
check "a cut sequence" gives 2 track calibrate $cabin --sequence "$work/cut.txt"
check "by its number" says "BB1731"
check "another room's" gives 2 track calibrate rooms/deck.yaml --sequence "$work/dance.txt"
check "by its number" says "BB1733"
finish
