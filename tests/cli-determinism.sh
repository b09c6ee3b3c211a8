#!/bin/sh
# Same room, scene and seed: the same event log and counters, byte for byte; another seed, another log; twice the budget,
# other bytes and another picture.
. tests/cli.sh.inc

run() { # NAME OPTIONS...
	name=$1
	shift
	"$program" run rooms/cabin.yaml "$scene" --json --out "$work/$name" "$@" >"$work/$name.json" 2>"$work/err" ||
		{ code=$?; [ "$code" = 1 ] || { echo "exit $code"; head -3 "$work/err"; }; }
}
same() { # EXPRESSION A B
	[ "$(field "$work/$2.json" "$1")" = "$(field "$work/$3.json" "$1")" ]
}
differ() {
	! same "$@"
}

run a --seed 7
run b --seed 7
run c --seed 8 --no-pictures
run memory --seed 7 --memory-mib 0.5
run stream --seed 7 --stream-bricks 1
check "two runs: one event log" same 'r["event_log_sha256"]' a b
check "two runs: the same counters" same 'sorted(r["counters"].items())' a b
check "two runs: the same pictures" same '[(p["psnr_db"], p["file"]) for p in r["pictures"]]' a b
check "another seed, another log" differ 'r["event_log_sha256"]' a c
for budget in memory stream; do
	check "another $budget budget changes the bytes" differ 'r["counters"]["bytes_streamed"]' a $budget
	check "another $budget budget changes the PSNR" differ '[p["psnr_db"] for p in r["pictures"]]' a $budget
done
check "stdout is result.json" cmp -s "$work/a.json" "$work/a/result.json"
finish
