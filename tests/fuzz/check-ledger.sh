#!/bin/sh
# Does every fuzz target have its row in targets.txt, a plant that still fits, its seeds, and a line in the ledger with at least 10
# million clean executions, 90 % of the parser's branches and its plant found within 60 s? tests/fuzz/check-ledger.sh
# [NAME...]. Says besides, without failing, which parsers have changed since.
cd "$(dirname "$0")/../.." || exit 2
[ $# -gt 0 ] || set -- $(for target in tests/fuzz/fuzz_*.c; do basename "$target" .c | sed 's/^fuzz_//'; done)
failed=0
for name in "$@"; do
	for table in targets.txt plants.txt; do
		grep -q "^$name " "tests/fuzz/$table" || { echo "$name: no line in tests/fuzz/$table"; failed=1; }
	done
	file=$(awk -v name="$name" '$1 == name { print $2 }' tests/fuzz/plants.txt)
	plant=$(sed -n "s/^$name  *[^ ]*  *//p" tests/fuzz/plants.txt)
	! sed "$plant" "$file" | cmp -s - "$file" || { echo "$name: the plant no longer fits $file"; failed=1; }
	grep -qx "\[$name\]" tests/fuzz/seeds.txt || { echo "$name: no seeds in tests/fuzz/seeds.txt"; failed=1; }
	grep "^$name " tests/fuzz/LEDGER | awk -v name="$name" '
		NF == 11 && $5 >= 10000000 && $8 >= 90 && $10 != "-" && $10 <= 60 && $11 == "clean" { good = 1 }
		END { if (!good) { print name ": the ledger lacks 10 million clean executions, 90 % or its plant: " $0; exit 1 } }' ||
		failed=1
	commit=$(awk -v name="$name" '$1 == name { print $3 }' tests/fuzz/LEDGER)
	files=$(awk -v name="$name" '$1 == name { for (i = 3; i <= NF; i++) print $i }' tests/fuzz/targets.txt)
	! git cat-file -e "$commit^{commit}" 2>/dev/null ||
		git diff --quiet "$commit" -- "tests/fuzz/fuzz_$name.c" $files ||
		echo "note: $name has changed since its run: tests/fuzz/ledger.sh $name"
done
for name in $(awk '/^[a-z]/ { print $1 }' tests/fuzz/targets.txt); do
	[ -f "tests/fuzz/fuzz_$name.c" ] || { echo "$name: in targets.txt, but there is no tests/fuzz/fuzz_$name.c"; failed=1; }
done
[ "$failed" = 0 ] && echo "$# fuzz targets stand in the ledger"
exit $failed
