#!/bin/sh
# Every fuzz target over its seeds and its corpus, once; BB_REPLAY names the folder of the replay_NAME programs.
folder=${BB_REPLAY:-build/gcc/tests}
failed=0 n=0
seeds=$(mktemp -d) || exit 1
trap 'rm -rf "$seeds"' EXIT
tests/fuzz/seeds.py "$seeds" || failed=1
for target in tests/fuzz/fuzz_*.c tests/fuzz/deep_*.c; do
	name=$(basename "$target" .c)
	name=${name#fuzz_}
	if ! out=$("$folder/replay_$name" "$seeds/$name" "tests/fuzz/corpus/$name" 2>&1); then
		echo "FAILED: $name: $out"
		failed=1
	fi
	n=$((n + 1))
done
echo "$n targets replayed"
[ "$failed" = 0 ]
