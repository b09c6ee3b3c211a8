#!/bin/sh
# Runs fuzz targets for as many executions as the ledger asks for, from the committed seeds and corpus, and writes
# what came of it to tests/fuzz/LEDGER: tests/fuzz/ledger.sh [NAME...]; RUNS=, SEED= for other than 10 million and 1.
# Refuses a tree with changes: the commit must say what was run. Exit 1: a find (left in build/fuzz/found), a plant
# that was not found, or too little covered.
runs=${RUNS:-10000000} seed=${SEED:-1}
ledger=tests/fuzz/LEDGER
[ $# -gt 0 ] || set -- $(awk '/^[a-z]/ { print $1 }' tests/fuzz/targets.txt)
git diff --quiet HEAD -- hal drivers sim sync render bench tests/fuzz ":!$ledger" || { echo "ledger: commit first" >&2; exit 2; }
make --no-print-directory fuzz-build >/dev/null || exit 2
commit=$(git rev-parse --short=8 HEAD)
mkdir -p build/fuzz/found build/fuzz/log
failed=0

note() { # NAME LINE: takes the place of the target's old line
	{
		grep '^#' "$ledger" 2>/dev/null || cat <<-'HEAD'
			# What each fuzz target has run, clean under ASan and UBSan, from its seeds and corpus. Written by
			# tests/fuzz/ledger.sh only; tests/fuzz/check-ledger.sh reads it. edges: of the parser's code, as the fuzzer
			# counts them (checks of the sanitizers among them); branches and regions: llvm-cov, tests/fuzz/coverage.sh;
			# plant: seconds until the overflow of tests/fuzz/plants.txt was found.
			# target          date       commit   seed executions exec/s  edges branches regions plant result
		HEAD
		{
			grep -v "^#\|^$1 " "$ledger" 2>/dev/null
			echo "$2"
		} | LC_ALL=C sort
	} >"$ledger.new" && mv "$ledger.new" "$ledger"
}

for name in "$@"; do
	rm -rf "build/fuzz/run/$name"
	mkdir -p "build/fuzz/run/$name/new"
	tests/fuzz/seeds.py "build/fuzz/run/$name/seeds" || exit 2
	log=build/fuzz/log/ledger-$name
	mkdir -p "build/fuzz/run/$name/seeds/$name"
	most=$(awk -v name="$name" '$1 == name { print $2 }' tests/fuzz/targets.txt)
	corpus=tests/fuzz/corpus/$name
	[ -d "$corpus" ] || corpus=
	result=clean
	"build/fuzz/fuzz_$name" -runs="$runs" -seed="$seed" -max_len="$most" -timeout=10 -print_final_stats=1 \
		-artifact_prefix="build/fuzz/found/$name-" "build/fuzz/run/$name/new" $corpus "build/fuzz/run/$name/seeds/$name" \
		>"$log" 2>&1 || result=FOUND
	executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
	speed=$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")
	edges=$(grep -o 'cov: [0-9]*' "$log" | tail -1 | cut -c6-)
	plant=-
	tests/fuzz/plants.sh "$name" >"$log.plant" && plant=$(cut -d' ' -f1 "build/fuzz/plant/$name/found")
	cover=$(tests/fuzz/coverage.sh "$name" | tail -1)
	line=$(printf '%-17s %s %s %4s %10s %6s %6s %8s %7s %5s %s' "$name" "$(date +%F)" "$commit" \
		"$seed" "$executions" "$speed" "$edges" "$(echo "$cover" | cut -d' ' -f3)" "$(echo "$cover" | cut -d' ' -f6)" \
		"$plant" "$result")
	note "$name" "$line"
	echo "$line"
	[ "$result" = clean ] && [ "$plant" != - ] || failed=1
done
tests/fuzz/check-ledger.sh "$@" || failed=1
exit $failed
