#!/bin/sh
# The safety files by their own tests, built without optimisation: every branch must have been taken both ways (gcov -b).
# Run in the project's folder; says which lines are not.
files="hal/safety.c hal/safe_state.c hal/lc_guard.c"
command -v gcov >/dev/null || { echo "SKIP: no gcov"; exit 77; }
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
for f in $files; do
	gcc -std=gnu11 -O0 --coverage -I. -c -o "$dir/$(basename "$f" .c).o" "$PWD/$f" || exit 1
done
gcc -std=gnu11 -O0 --coverage -I. -o "$dir/test" tests/test_safety.c "$dir"/*.o hal/status.c -lcmocka -lm || exit 1
"$dir/test" >"$dir/out" 2>&1 || { tail -20 "$dir/out"; exit 1; }
failed=0
for f in $files; do
	base=$(basename "$f" .c)
	(cd "$dir" && gcov -b -c "$base.gcno" >summary 2>&1) || exit 1
	grep -nE '^ *(#####|=====):' "$dir/$base.c.gcov" && failed=1
	# branches never taken: "branch  1 never executed" or "taken 0"
	awk -v f="$f" '/^ *[0-9-]+\*?:/ || /^ *-:/ { line = $0 }
		/^branch/ && (/never executed/ || /taken 0( |$)/) && !/\(throw\)/ { print f ": " line " :: " $0; bad = 1 }
		END { exit bad }' "$dir/$base.c.gcov" || failed=1
	branches=$(grep -c '^branch' "$dir/$base.c.gcov")
	echo "$f: $branches branches"
done
[ $failed = 0 ] && echo "every branch of the safety files is taken both ways"
exit $failed
