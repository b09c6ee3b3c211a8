#!/bin/sh
# Run fuzz targets of build/fuzz for some seconds each, two at a time: tests/fuzz/run.sh [SECONDS] [NAME...]. New inputs
# go to build/fuzz/corpus/NAME; a crash is left in build/fuzz/found/. Prints executions and edges of each target.
seconds=${1:-20}
[ $# -gt 0 ] && shift
[ $# -gt 0 ] || set -- $(sed 's/#.*//' tests/fuzz/targets.txt | awk '/^[a-z]/ { print $1 }')
mkdir -p build/fuzz/found build/fuzz/log
rm -rf build/fuzz/seeds
tests/fuzz/seeds.py build/fuzz/seeds || exit 1
export seconds
printf '%s\n' "$@" | xargs -P "${FUZZ_JOBS:-2}" -I NAME sh -c '
	mkdir -p build/fuzz/corpus/NAME build/fuzz/seeds/NAME tests/fuzz/corpus/NAME
	most=$(awk "\$1 == \"NAME\" { print \$2 }" tests/fuzz/targets.txt)
	build/fuzz/fuzz_NAME -max_total_time="$seconds" -print_final_stats=1 -max_len="${most:-1600}" -timeout=10 \
		-artifact_prefix=build/fuzz/found/NAME- build/fuzz/corpus/NAME tests/fuzz/corpus/NAME build/fuzz/seeds/NAME >build/fuzz/log/NAME 2>&1
	echo $? >build/fuzz/log/NAME.code'
passed=0 failed=0
for name in "$@"; do
	log=build/fuzz/log/$name
	if [ "$(cat "$log.code")" = 0 ]; then
		passed=$((passed + 1))
	else
		failed=$((failed + 1))
		grep -E 'ERROR|SUMMARY|Test unit|not found' "$log" | head -5
	fi
	printf '%-18s %10s executions %7s a second, %s\n' "$name" "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
		"$(sed -n 's/^stat::average_exec_per_sec: *//p' "$log")" "$(grep -o 'cov: [0-9]*' "$log" | tail -1)"
done
echo "$passed passed, $failed failed, 0 skipped"
[ "$failed" = 0 ]
