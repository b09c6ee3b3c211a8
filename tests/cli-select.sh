#!/bin/sh
# `blackburst volume select` and `volume tables`: every way of choosing by its name, and what the tables must add up to.
. tests/cli.sh.inc

refused() { # NUMBER ARGUMENTS...
	number=$1
	shift
	! "$program" volume "$@" >"$work/out" 2>"$work/err" && grep -q "^BB$number" "$work/err"
}

check "a file to choose from" "$program" volume build --generate cme --dim 60x52x44 --steps 5 --brick 8 --quiet --out "$work/s.bricks"
selected() { # NAME: covers the volume; by budget, in so many bricks at most
	"$program" volume select "$work/s.bricks" --tf scenes/cme.tf --selector "$1" --step 2 --memory 60 --json >"$work/$1.json" &&
		[ "$(field "$work/$1.json" '(abs(sum(l["voxel_share"] for l in r["levels"]) - 1) < 1e-9 and
			(r["selector"].startswith(("scalar", "colour")) or 1 < r["bricks"] <= 60))')" = True ]
}
for selector in $("$program" volume select x --selector help | cut -d' ' -f1); do
	check "selector $selector" selected "$selector"
done
check "an unknown selector is refused" refused 1460 select "$work/s.bricks" --tf scenes/cme.tf --selector nobody
check "no transfer function is refused" refused 1701 select "$work/s.bricks"
check "half a brick is refused" refused 1704 select "$work/s.bricks" --tf scenes/cme.tf --memory 2.5
check "an unknown set is refused" refused 1460 tables --set nobody
"$program" volume tables --scale 30 --set shock --json >"$work/tables.json"
check "tables" [ "$(field "$work/tables.json" 'len(r["sets"])')" = 4 ]
check "shares are all of it" [ "$(field "$work/tables.json" \
	'all(abs(x["not_rendered"] + x["untextured"] + x["reused"] + x["loaded"] - 100) < 1e-6 for s in r["sets"] for x in s.get("shares", {}).get("rows", []))')" = True ]
check "errors are as asked" [ "$(field "$work/tables.json" \
	'all(x["luv"] <= {"zero": 0.01, "slight": r["slight_luv"], "moderate": r["moderate_luv"]}[x["error"]] for s in r["sets"] for x in s.get("shares", {}).get("rows", []))')" = True ]
check "and print" sh -c "'$program' volume tables --scale 20 --set small-delta | grep -q '| small-delta | filled | moderate | colour |'"
finish
