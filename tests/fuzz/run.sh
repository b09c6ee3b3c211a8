#!/bin/sh
# Run every fuzz target of build/fuzz for some seconds: tests/fuzz/run.sh [SECONDS] [NAME...]. New inputs go to
# build/fuzz/corpus/NAME; a crash is left in build/fuzz/found/. Prints executions and edges of each target.
seconds=${1:-20}
[ $# -gt 0 ] && shift
passed=0 failed=0
for program in build/fuzz/fuzz_*; do
	case $program in *.o | *.d | *'*') continue ;; esac
	name=${program##*/fuzz_}
	[ $# = 0 ] || case " $* " in *" $name "*) ;; *) continue ;; esac
	mkdir -p "build/fuzz/corpus/$name" build/fuzz/found
	if "$program" -max_total_time="$seconds" -print_final_stats=1 -artifact_prefix="build/fuzz/found/$name-" \
		-max_len=4200 "build/fuzz/corpus/$name" "tests/fuzz/corpus/$name" >build/fuzz/log 2>&1; then
		passed=$((passed + 1))
	else
		failed=$((failed + 1))
		grep -E 'ERROR|SUMMARY|Test unit' build/fuzz/log | head -5
	fi
	echo "$name: $(sed -n 's/^stat::number_of_executed_units: *//p' build/fuzz/log) executions, $(grep -o 'cov: [0-9]*' build/fuzz/log | tail -1)"
done
echo "$passed passed, $failed failed, 0 skipped"
[ "$failed" = 0 ]
