#!/bin/sh
# Is a planted overflow found? tests/fuzz/plants.sh [NAME...]: for each target builds its parser with the one-line
# mistake of tests/fuzz/plants.txt and lets it fuzz for at most 60 s from its seeds and corpus, without those that
# show the mistake at once: it must come by mutation. Exit 1: a mistake no longer fits its file, or was not found.
# Needs `make fuzz-build`. Leaves "SECONDS EXECUTIONS" in build/fuzz/plant/NAME/found.
[ $# -gt 0 ] || set -- $(awk '/^[a-z]/ { print $1 }' tests/fuzz/plants.txt)
cflags="-std=gnu11 -O2 -g1 -I. -DBB_FUZZ -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
	$(pkg-config --cflags libusb-1.0 hidapi-hidraw libevdev libmodbus libgpiod)"
libs="$(pkg-config --libs yaml-0.1 zlib libcrypto libgpiod libusb-1.0 hidapi-hidraw libevdev libmodbus liblz4 libzstd) -lm -lpthread
	-ldl"
export ASAN_OPTIONS=detect_leaks=0 TIMEFORMAT=%R
failed=0 found=0

plant() { # NAME FILE EXPRESSION: leaves build/fuzz/plant/NAME/fuzz
	rm -rf "build/fuzz/plant/$1"
	mkdir -p "$out/seeds" "$out/hidden"
	sed "$3" "$2" >"$out/planted.c" || return 1
	! cmp -s "$2" "$out/planted.c" || { echo "$1: the mistake no longer fits $2"; return 1; }
	clang $cflags -fsanitize=fuzzer-no-link -c -o "$out/planted.o" "$out/planted.c" &&
		clang $cflags -fsanitize=fuzzer -Wl,--as-needed -o "$out/fuzz" "build/fuzz/tests/fuzz/fuzz_$1.o" "$out/planted.o" \
			build/fuzz/libfuzz.a $libs
}

for name in "$@"; do
	out=build/fuzz/plant/$name
	row=$(grep "^$name " tests/fuzz/plants.txt)
	file=$(echo "$row" | awk '{ print $2 }')
	expression=$(echo "$row" | sed 's/^[a-z_0-9]* *[^ ]* *//')
	if ! plant "$name" "$file" "$expression"; then
		failed=$((failed + 1))
		continue
	fi
	tests/fuzz/seeds.py "$out/all"
	n=0 shown=0
	for input in "$out/all/$name"/* "tests/fuzz/corpus/$name"/*; do
		[ -f "$input" ] || continue
		n=$((n + 1))
		if "$out/fuzz" "$input" >/dev/null 2>&1; then cp "$input" "$out/seeds/$n"; else shown=$((shown + 1)); fi
	done
	most=$(awk -v name="$name" '$1 == name { print $2 }' tests/fuzz/targets.txt)
	begin=$(date +%s.%N)
	"$out/fuzz" -seed=1 -max_total_time=60 -max_len="$most" -print_final_stats=1 -artifact_prefix="$out/" \
		"$out/hidden" "$out/seeds" >"$out/log" 2>&1
	code=$?
	seconds=$(date +%s.%N | awk -v begin="$begin" '{ printf "%.1f", $1 - begin }')
	executions=$(sed -n 's/^stat::number_of_executed_units: *//p' "$out/log")
	if [ "$code" != 0 ] && grep -qE 'AddressSanitizer|runtime error|deadly signal' "$out/log"; then
		found=$((found + 1))
		echo "$seconds $executions" >"$out/found"
		why=$(grep -oE 'AddressSanitizer: [a-z-]+|runtime error: .{0,50}|deadly signal' "$out/log" | head -1)
		echo "$name: found in $seconds s, after $executions executions ($shown of $n seeds show it at once): $why"
	else
		failed=$((failed + 1))
		echo "$name: not found in $seconds s, $executions executions"
	fi
done
echo "$found passed, $failed failed, 0 skipped"
[ "$failed" = 0 ]
