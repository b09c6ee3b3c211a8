#!/bin/sh
# tests/lint.sh [FILE...]: clang-tidy (.clang-tidy) and cppcheck over the sources, or over the files named.
# Exit 0: nothing found; 1: findings; 77: neither tool is installed.
set -u
cd "$(dirname "$0")/.." || exit 2

[ $# -gt 0 ] || set -- $(find hal drivers sim sync render bench -name '*.c' -not -path 'sim/kmod/*' 2>/dev/null | LC_ALL=C sort)
[ $# -gt 0 ] || { echo "lint: no sources" >&2; exit 2; }

ran=0 found=0
log=$(mktemp) || exit 2
trap 'rm -f "$log"' EXIT
trap 'exit 1' HUP INT TERM
jobs=$(nproc 2>/dev/null || echo 1)

if command -v clang-tidy >/dev/null 2>&1; then
	ran=1
	# shellcheck disable=SC2016
	printf '%s\n' "$@" | xargs -P "$jobs" -n 1 sh -c '
		case $1 in hal/status.c | hal/device.c) stubs= ;; *) stubs="-include tests/lint_stubs.h" ;; esac
		clang-tidy --quiet "$1" -- -std=gnu11 -D_GNU_SOURCE -I. $stubs \
			$(pkg-config --cflags yaml-0.1 jansson libpng cairo zlib libcrypto libusb-1.0 hidapi-hidraw libevdev liblz4 libzstd 2>/dev/null) 2>/dev/null' sh >"$log" || found=1
	cat "$log"
	echo "lint: clang-tidy over $# files"
else
	echo "lint: clang-tidy is not installed (package clang-tidy)"
fi

if command -v cppcheck >/dev/null 2>&1; then
	ran=1
	# Findings of whole-program style (unused functions, shadowed names) are the compiler's affair.
	# internalAstError: it does not know arithmetic on vectors (render/cpu/cast_kernel.h).
	cppcheck --quiet --std=c11 --enable=warning,performance,portability --inline-suppr --error-exitcode=1 \
		--suppress=missingIncludeSystem --suppress=normalCheckLevelMaxBranches --suppress=unusedStructMember --suppress=internalAstError \
		-I. -j "$jobs" --template='{file}:{line}: {severity}: {message} [cppcheck {id}]' "$@" || found=1
	echo "lint: cppcheck over $# files"
else
	echo "lint: cppcheck is not installed (package cppcheck)"
fi

[ $ran = 1 ] || exit 77
[ $found = 0 ] && echo "lint: nothing found"
exit $found
