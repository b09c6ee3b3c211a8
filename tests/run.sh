#!/bin/sh
# Run test programs and scripts, one after another; print every skip with its reason, at the end what those that failed
# said, and a plain line "N passed, M failed, K skipped" that counts single tests (cmocka's) and scripts.
# usage: tests/run.sh PROGRAM...
passed=0 failed=0 skipped=0
log=$(mktemp) bad_logs=$(mktemp)
trap 'rm -f "$log" "$bad_logs"' EXIT
for program in "$@"; do
	start=$(date +%s)
	"$program" >"$log" 2>&1 </dev/null
	code=$?
	took=$(($(date +%s) - start))
	ok=$(grep -c '^\[       OK \]' "$log")
	bad=$(grep '^\[  FAILED  \] [A-Za-z_0-9]*$' "$log" | sort -u | wc -l) # named again in the summary
	skip=$(grep '^\[  SKIPPED \] [A-Za-z_0-9]*$' "$log" | sort -u | wc -l)
	if grep -q '^\[==========\]' "$log"; then # a cmocka program: counts its own tests
		grep -ihE '^SKIP(PED)?:' "$log"
	else
		ok=0 bad=0 skip=0
		case $code in
		0) ok=1 ;;
		77) skip=1; grep -ihE '^(SKIP(PED)?|[a-z-]*: skipped):' "$log" ;;
		*) bad=1 ;;
		esac
	fi
	[ "$code" = 0 ] || [ "$code" = 77 ] || [ "$bad" -gt 0 ] || bad=1
	passed=$((passed + ok)) failed=$((failed + bad)) skipped=$((skipped + skip))
	printf '%-42s %4d ok %3d failed %3d skipped  %3d s\n' "$(basename "$program")" "$ok" "$bad" "$skip" "$took"
	grep -E '^(fault|fidelity) ' "$log" # the tables a person wants to see
	[ "$bad" = 0 ] || { echo "-- $(basename "$program") failed"; tail -n 60 "$log"; } >>"$bad_logs"
done
cat "$bad_logs"
echo "$passed passed, $failed failed, $skipped skipped"
[ "$failed" = 0 ]
