#!/bin/sh
# tests/cli-coverage.sh: `track coverage`, `track place` and `trade --table tracking`: numbers, files, the same every time
# for any number of threads, and what a hostile command line gets.
. tests/cli.sh.inc

refused() { # NUMBER ARGUMENTS...: exit 2 with that error
	want=$1
	shift
	"$program" "$@" >/dev/null 2>"$work/err"
	[ $? = 2 ] && grep -q "^BB$want:" "$work/err"
}
cover() {
	"$program" track coverage rooms/cabin.yaml --voxel-mm 200 "$@"
}

cover --json >"$work/a.json"
check "coverage: exit 0" [ $? = 0 ]
cover --at-least 8 --json --out "$work/c" --threads 1 >"$work/c.json"
check "coverage with pictures: exit 0" [ $? = 0 ]
check "shares fall with cameras, and with the viewer in the way" [ "$(field "$work/a.json" "(all(
	list(v['share_at_least'].values()) == sorted(v['share_at_least'].values(), reverse=True) for v in r['viewer'].values())
	and (lambda w: w == sorted(w))([r['viewer'][k]['weakest_decile_mm'] or 1e9 for k in ('none', 'mean', 'worst')]))")" = True ]
check "nearly all of the cabin is seen by three, a quarter by eight" [ "$(field "$work/a.json" \
	"r['viewer']['none']['share_at_least']['3'] > 0.99 and 0.2 < r['viewer']['none']['share_at_least']['8'] < 0.32")" = True ]
check "a line for each voxel" [ "$(wc -l <"$work/c/voxels.csv")" = "$(field "$work/a.json" "r['inside'] + 1")" ]
check "the lines' cameras are the table's" [ "$(python3 -c "
import csv, sys
rows = list(csv.DictReader(open('$work/c/voxels.csv')))
print(round(sum(int(x['cameras_none']) >= 6 for x in rows) / len(rows), 9))")" = \
	"$(field "$work/a.json" "round(r['viewer']['none']['share_at_least']['6'], 9)")" ]
check "pictures and a page" sh -c "head -c 4 '$work/c/clouds.png' | grep -q PNG && head -c 4 '$work/c/slices.png' | grep -q PNG &&
	[ \$(grep -o '<svg ' '$work/c/coverage.html' | wc -l) = 2 ] && ! grep -qE '(src|href)=\"http' '$work/c/coverage.html'"
cover --at-least 8 --json --out "$work/d" --threads 2 >"$work/d.json"
check "two threads: the same table" cmp -s "$work/c.json" "$work/d.json"
check "two threads: the same files" diff -r "$work/c" "$work/d"
cover --monte-carlo --json >"$work/m.json"
check "Monte Carlo: every point within 10 %" [ "$? $(field "$work/m.json" "r['monte_carlo']['within_10_percent']")" = "0 200" ]

"$program" track place rooms/cabin.yaml --voxel-mm 200 --grid-mm 500 --tries 2 --sweeps 20 --headings 8 --json \
	--out "$work/placed.yaml" >"$work/p.json"
check "place: exit 0" [ $? = 0 ]
check "the weakest decile gains" [ "$(field "$work/p.json" "r['weakest_decile_factor'] > 1.2")" = True ]
"$program" track place rooms/cabin.yaml --voxel-mm 200 --grid-mm 500 --tries 2 --sweeps 20 --headings 8 --json \
	--threads 1 >"$work/q.json"
check "one thread: the same cameras" cmp -s "$work/p.json" "$work/q.json"
check "the new room loads" sh -c "'$program' room check '$work/placed.yaml' >/dev/null"
"$program" track coverage "$work/placed.yaml" --voxel-mm 200 --headings 8 --box=-1.524:0.6:-1.524:1.524:2:1.524 --json >"$work/e.json"
check "... and is what was promised" [ "$(field "$work/e.json" "round(r['viewer']['mean']['weakest_decile_mm'], 2)")" = \
	"$(field "$work/p.json" "round(r['after']['viewer']['mean']['weakest_decile_mm'], 2)")" ]
check "only its cameras differ" [ "$(diff rooms/cabin.yaml "$work/placed.yaml" | grep -c '^[<>]')" = 18 ]
printf '# one rail\n-1.4 2.2 -1.4 1.4 2.2 -1.4\n' >"$work/rails"
"$program" track place rooms/cabin.yaml --rails "$work/rails" --cameras 3 --voxel-mm 300 --grid-mm 700 --tries 1 --sweeps 3 \
	--body none --json >"$work/r.json"
check "three cameras on a rail of one's own" [ "$(field "$work/r.json" "(len(r['cameras']) == 3 and
	all([round(v, 9) for v in c['position_m'][1:]] == [2.2, -1.4] for c in r['cameras']))")" = True ]

"$program" track place rooms/cabin.yaml --cameras 24 --voxel-mm 300 --grid-mm 700 --tries 1 --sweeps 1 --body none --json >"$work/m.json"
check "cameras that are added hang apart" [ "$(field "$work/m.json" "(lambda p: min(sum((a - b) ** 2 for a, b in zip(x, y)) ** 0.5
	for i, x in enumerate(p) for y in p[:i]))([c['position_m'] for c in r['cameras']]) >= 0.15")" = True ]
check "no room for eight cameras 10 m apart" refused 1757 track place rooms/cabin.yaml --voxel-mm 300 --grid-mm 700 --tries 1 \
	--sweeps 1 --apart-mm 10000

# What would change more than poses is not written.
sed 's/{id: c3, /{id: c3, noise_px: 0.2, /' rooms/cabin.yaml >"$work/own.yaml"
check "a camera with keys of its own" refused 1758 track place "$work/own.yaml" --voxel-mm 300 --grid-mm 700 --tries 1 \
	--sweeps 1 --out "$work/never.yaml"
(
	trap '' XFSZ
	ulimit -f 4
	"$program" track place rooms/cabin.yaml --voxel-mm 300 --grid-mm 700 --tries 1 --sweeps 1 --out "$work/never.yaml" 2>"$work/err"
)
check "a full disk is told as that" [ "$? $(cut -c 1-7 "$work/err")" = "3 BB1901:" ]
check "... both leave nothing behind" sh -c "! ls '$work' | grep -q never"
for bad in '1 2 3' '1 2 3 4 5 nan' '1 2 3 1 2 3' '1 2 3 4 5 6 7' 'x' ''; do
	printf '%s\n' "$bad" >"$work/rails"
	check "rails '$bad'" refused 1756 track place rooms/cabin.yaml --rails "$work/rails"
done
check "no rails file" refused 1001 track place rooms/cabin.yaml --rails "$work/nowhere"

check "a voxel of nothing" refused 1704 track coverage rooms/cabin.yaml --voxel-mm 0
check "half a thread" refused 1704 track coverage rooms/cabin.yaml --threads 2.5
check "half a camera" refused 1704 track place rooms/cabin.yaml --cameras 2.5
"$program" track coverage rooms/cabin.yaml --voxel-mm 500 --least-px 1000 --monte-carlo --json >"$work/n.json"
check "nothing to try is told as that" [ "$? $(field "$work/n.json" "r['monte_carlo']['points']")" = "1 0" ]
check "a voxel of nan" refused 1704 track coverage rooms/cabin.yaml --voxel-mm nan
check "10^10 voxels" refused 1751 track coverage rooms/cabin.yaml --voxel-mm 1
check "a box outside" refused 1751 track coverage rooms/cabin.yaml --box 5:0:5:6:1:6
check "a flat room" refused 1751 track coverage rooms/desk.yaml
sed 's/eyes_mm: .*/eyes_mm: [1500, -1900, 16]/' rooms/cabin.yaml >"$work/far.yaml"
check "glasses worn on a stick" refused 1013 track coverage "$work/far.yaml"
for bad in 1 1:2:3:4:5 1:1:1:0:2:2 a:b:c:d:e:f 0:0:0:1:1:inf 0:0:0:1:1:1e9; do
	check "--box $bad" refused 1752 track coverage rooms/cabin.yaml --box "$bad"
done
check "--body some" refused 1753 track coverage rooms/cabin.yaml --body some
check "no such parent" refused 1754 track coverage rooms/cabin.yaml --voxel-mm 500 --out "$work/no/where"
for bad in 0 3,2 3,3 a 1,2,3,4,5,6,7,8,9 300 ''; do
	check "--at-least '$bad'" refused 1755 track coverage rooms/cabin.yaml --at-least "$bad"
done
sed '/^cameras:/,/^$/d' rooms/cabin.yaml >"$work/blind.yaml"
check "a room without cameras" refused 1750 track coverage "$work/blind.yaml"
check "... to place" refused 1759 track place "$work/blind.yaml"

"$program" trade --table tracking --frames 60 --json --plot "$work/t.svg" >"$work/t.json"
check "trade --table tracking: exit 0" [ $? = 0 ]
check "a curve" sh -c "head -c 200 '$work/t.svg' | grep -q '<svg'"
check "more cameras, less error; more noise, more" [ "$(field "$work/t.json" "(lambda c, n, f:
	c[0]['rms_mm'] > 1.5 * c[-1]['rms_mm'] and n[0]['rms_mm'] * 10 < n[-1]['rms_mm'] and f[0]['rms_mm'] < 1e-3)(
	*[[p for p in r['points'] if p['knob'] == k] for k in ('cameras', 'noise', 'fidelity')])")" = True ]
"$program" trade --table tracking --frames 60 --json >"$work/u.json"
told="[[v for k, v in p.items() if not k.startswith('solve_')] for p in r['points']]"
check "two runs: the same errors" [ "$(field "$work/t.json" "$told")" = "$(field "$work/u.json" "$told")" ]
finish
