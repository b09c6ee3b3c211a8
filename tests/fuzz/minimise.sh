#!/bin/sh
# Makes tests/fuzz/corpus/NAME anew: of it and of what `make fuzz` found (build/fuzz/corpus, build/fuzz/run), the fewest
# inputs that reach every edge which the seeds do not. tests/fuzz/minimise.sh [NAME...]; needs `make fuzz-build`.
[ $# -gt 0 ] || set -- $(awk '/^[a-z]/ { print $1 }' tests/fuzz/targets.txt)
for name in "$@"; do
	tmp=$(mktemp -d) || exit 1
	most=$(awk -v name="$name" '$1 == name { print $2 }' tests/fuzz/targets.txt)
	tests/fuzz/seeds.py "$tmp/seeds" || exit 1
	mkdir -p "$tmp/all/old" "$tmp/seeds/$name" "tests/fuzz/corpus/$name"
	find "tests/fuzz/corpus/$name" "build/fuzz/corpus/$name" "build/fuzz/run/$name/new" -type f 2>/dev/null |
		while read -r input; do cp "$input" "$tmp/all/old/$(sha1sum <"$input" | cut -c1-16)"; done
	ls "$tmp/seeds/$name" >"$tmp/names"
	"build/fuzz/fuzz_$name" -merge=1 -use_counters=0 -max_len="$most" "$tmp/seeds/$name" "$tmp/all/old" >"$tmp/log" 2>&1 ||
		{ echo "$name: the merge failed"; tail -5 "$tmp/log"; exit 1; }
	rm -rf "tests/fuzz/corpus/$name"
	mkdir -p "tests/fuzz/corpus/$name"
	ls "$tmp/seeds/$name" | grep -vxFf "$tmp/names" |
		while read -r new; do cp "$tmp/seeds/$name/$new" "tests/fuzz/corpus/$name/$(echo "$new" | cut -c1-16)"; done
	echo "$name: $(wc -l <"$tmp/names") seeds, $(ls "tests/fuzz/corpus/$name" | wc -l) more inputs"
	rm -rf "$tmp"
done
