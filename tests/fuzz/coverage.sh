#!/bin/sh
# How much of a parser the seeds and the corpus of its fuzz target reach: tests/fuzz/coverage.sh NAME
# [MORE-FOLDERS...] Compiles the parser's files (tests/fuzz/targets.txt) without optimisation and with clang's
# source-based coverage, runs the target over its inputs and prints "BRANCHES COVERED PERCENT REGIONS COVERED
# PERCENT", where a branch is one outcome of one condition (of if, loop, ?:, && and || operands, and cases of a
# switch). Functions that targets.txt names under "without" do not count. With -v, first every function that is not
# covered fully, with the lines of missing branches. Needs `make fuzz-build` and llvm-cov (package llvm).
set -e
verbose=
[ "$1" = -v ] && verbose=1 && shift
name=$1
shift
out=build/fuzz/coverage/$name
row=$(grep "^$name " tests/fuzz/targets.txt)
files=$(echo "$row" | tr ' ' '\n' | grep '\.c$')
rm -rf "$out"
mkdir -p "$out"
cflags="-std=gnu11 -I. -DBB_FUZZ -g1 $(pkg-config --cflags libusb-1.0 hidapi-hidraw libevdev libmodbus libgpiod)"
objects=
for file in $files; do
	object=$out/$(echo "$file" | tr / _).o
	clang $cflags -O0 -fprofile-instr-generate -fcoverage-mapping -c -o "$object" "$file"
	objects="$objects $object"
done
clang $cflags -O1 -o "$out/run" "tests/fuzz/fuzz_$name.c" tests/fuzz/replay.c $objects build/fuzz/libfuzz.a \
	-fprofile-instr-generate -fsanitize=address,undefined -Wl,--as-needed \
	$(pkg-config --libs yaml-0.1 zlib libcrypto libgpiod libusb-1.0 hidapi-hidraw libevdev libmodbus liblz4 libzstd) -lm -lpthread -ldl
tests/fuzz/seeds.py "$out/seeds"
LLVM_PROFILE_FILE=$out/raw "$out/run" "$out/seeds/$name" "tests/fuzz/corpus/$name" "$@" >/dev/null
llvm-profdata merge -o "$out/data" "$out/raw"
llvm-cov export -instr-profile="$out/data" "$out/run" >"$out/json"
tests/fuzz/coverage.py $verbose "$name" "$out/json"
