#!/bin/sh
# `trade --table clocks`: the same every time but for its cost, the curve an engineer relies on, a drawing; and the short
# form of "make bench-hour": a virtual minute of the deck's displays, shutters and links, twice.
. tests/cli.sh.inc

"$program" trade --table clocks --json --plot "$work/c.svg" >"$work/a.json"
check "trade --table clocks: exit 0" [ $? = 0 ]
"$program" trade --table clocks --json >"$work/b.json"
counted="[[v for k, v in p.items() if k != 'add_ns'] for p in r['points']]"
check "two runs: the same skews" [ "$(field "$work/a.json" "$counted")" = "$(field "$work/b.json" "$counted")" ]
line="[p['line of greatest margin']['p99_us'] for p in r['points']]"
check "64 exchanges: p99 within 20 us" [ "$(field "$work/a.json" "$line[4] <= 20")" = True ]
check "twice the exchanges, less than 0.7 of the skew, from 16 to 512" [ "$(field "$work/a.json" "all(b < 0.7 * a for a, b in zip($line[2:], $line[3:]))")" = True ]
check "the customary ways get worse with long windows" [ "$(field "$work/a.json" "all(r['points'][7][w]['p99_us'] > 10 * r['points'][2][w]['p50_us'] for w in ('mean of the window', 'least round trip'))")" = True ]
check "stated uncertainty holds in 97 %" [ "$(field "$work/a.json" "all(p['inside'] >= 0.97 for p in r['points'])")" = True ]
check "SVG" sh -c "head -c 200 '$work/c.svg' | grep -q '<svg'"
# Row O4: the head sleeps for five seconds. Told once, with its length; the next frame is the one for now, in phase at once.
for room in cabin120 desk; do
	[ $room = desk ] && dark=scenes/desk.yaml || dark=scenes/cme.yaml
	"$program" run rooms/$room.yaml $dark --seed 7 --duration 8 --no-pictures --json --out "$work/o4" \
		--fault "at 1s node/$([ $room = desk ] && echo desk || echo head) suspend for 5s" >"$work/o4.json"
	check "$room: asleep for 5 s, PASS" [ $? = 0 ]
	check "$room: told as a gap, and by nodes that heard nothing of it" [ "$(field "$work/o4.json" 'sorted(set(i["what"][:12] for i in r["incidents"]))')" = "['GAP 5000 ms:'$([ $room = desk ] || echo ", 'MASTER_LOST:'")]" ]
	check "$room: no frames made up for: 180 of three waking seconds" [ "$(field "$work/o4.json" 'abs(r["counters"]["frames"] - 180) <= 4')" = True ]
done
"$program" trade --table clocks --plot "$work/c.bmp" >/dev/null 2>"$work/err"
check "a drawing of another kind: exit 2, BB1850" [ "$? $(grep -c BB1850 "$work/err")" = "2 1" ]
check "a minute of 416 displays, twice: one hash" tests/hour.sh 60 4
finish
