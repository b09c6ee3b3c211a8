#!/bin/sh
# `blackburst volume`: a build, what is said of it, a stop and going on, a damaged brick that is named, wrong words refused.
. tests/cli.sh.inc

build() {
	"$program" volume build --generate cme --dim 60x52x44 --steps 5 --brick 8 --quiet "$@" >"$work/out" 2>"$work/err"
}

refused() { # NUMBER ARGUMENTS...
	number=$1
	shift
	! "$program" volume "$@" >"$work/out" 2>"$work/err" && grep -q "^BB$number" "$work/err"
}

damaged() {
	"$program" volume verify "$work/a.bricks" --json >"$work/verify.json" 2>/dev/null && return 1
	[ "$(field "$work/verify.json" 'r["damaged"]')" = 1 ]
}

packed_speed() {
	"$program" volume speed "$work/lz4.bricks" --mib 4 --rounds 1 --threads 1 --depth 1 >"$work/out" && grep -q "liblz4" "$work/out"
}

interrupted() { # until one attempt lives long enough to be stopped and short enough not to end
	for wait in 0.02 0.05 0.1 0.2 0.4; do
		rm -f "$work"/c.bricks*
		"$program" volume build --generate cme --dim 160x160x120 --steps 6 --brick 8 --memory 40 --out "$work/c.bricks" \
			>/dev/null 2>"$work/err" &
		pid=$!
		sleep $wait
		kill -INT $pid
		wait $pid
		[ $? = 130 ] && grep -q "goes on from here" "$work/err" && return 0
	done
	return 1
}

gone_on_with() {
	"$program" volume build --generate cme --dim 160x160x120 --steps 6 --brick 8 --memory 40 --out "$work/c.bricks" \
		>"$work/out" && grep -q "went on" "$work/out" && "$program" volume verify "$work/c.bricks" >/dev/null &&
		[ "$(ls "$work"/c.bricks*)" = "$work/c.bricks" ]
}

check "build" build --out "$work/a.bricks"
check "info" "$program" volume info "$work/a.bricks"
"$program" volume info "$work/a.bricks" --json >"$work/info.json"
check "its shape" [ "$(field "$work/info.json" 'r["voxels"], r["steps"], r["bricks"], len(r["levels"])')" = \
	"([60, 52, 44], 5, $((9 * (336 + 48 + 8 + 1))), 4)" ]
check "leaves of single steps have no error" [ "$(field "$work/info.json" 'r["levels"][-1]["mean_error_of_steps"]')" = 0.0 ]
check "verify" "$program" volume verify "$work/a.bricks"
for codec in lz4 zstd; do
	check "$codec" build --codec $codec --type u16 --out "$work/$codec.bricks"
	check "$codec verifies" "$program" volume verify "$work/$codec.bricks"
	check "$codec is smaller" [ "$(stat -c %s "$work/$codec.bricks")" -lt "$(($(stat -c %s "$work/a.bricks") / 2))" ]
done
"$program" volume speed "$work/a.bricks" --mib 4 --rounds 3 --depth 2 --json >"$work/speed.json"
check "its speed is told, beside memcpy" [ "$(field "$work/speed.json" \
	'min(r["ratio"] for r in r["rows"]) > 0, [x["against"] for x in r["rows"]].count("memcpy") >= 4')" = "(True, True)" ]
check "and of packed bricks" packed_speed
printf 'x' | dd of="$work/a.bricks" bs=1 seek=5000 conv=notrunc 2>/dev/null
check "a damaged brick is named" damaged
head -c 100000 "$work/lz4.bricks" >"$work/short.bricks"
check "a file cut short is refused" refused 1445 info "$work/short.bricks"
check "another file is refused" refused 1440 info Makefile
check "a wrong edge is refused" refused 1442 build --generate cme --brick 7 --out "$work/b.bricks"
check "a small cap is said" refused 1447 build --generate cme --memory 1 --out "$work/b.bricks"
check "no input is refused" refused 1701 build --out "$work/b.bricks"
check "parts of voxels are refused" refused 1701 build --generate cme --dim 8.5x8x8 --out "$work/b.bricks"
check "a folder is no result" refused 1901 build --generate cme --dim 8x8x8 --steps 1 --brick 4 --out "$work"
mkfifo "$work/pipe" "$work/pipe.raw"
check "nor is a pipe" refused 1901 build --generate cme --dim 8x8x8 --steps 1 --brick 4 --out "$work/pipe"
check "which stays one" [ -p "$work/pipe" ]
check "nor for voxels" refused 1901 generate cme --dim 8x8x8 --steps 1 --out "$work/pipe.hdr.txt"
check "which stays one, too" [ -p "$work/pipe.raw" ]
check "and leaves nothing" [ -z "$(ls "$work"/b.* 2>/dev/null)" ]
check "a made spherical grid" "$program" volume build --generate enlil --dim 32x24x40 --steps 2 --brick 8 --seed 5 --quiet \
	--out "$work/e.bricks"
"$program" volume info "$work/e.bricks" | tail -n +2 >"$work/e.info"
check "its extents are shown" sh -c '"$1" volume info "$2" | grep -q "^r 0.1 .. 1.7, theta .* radians, all the way round"' \
	x "$program" "$work/e.bricks"
"$program" volume info "$work/e.bricks" --json >"$work/info.json"
check "and given to programs" [ "$(field "$work/info.json" 'r["extent"]["wraps"], r["extent"]["r"]')" = "(True, [0.1, 1.7])" ]
check "voxels are written" "$program" volume generate enlil --dim 32x24x40 --steps 2 --seed 5 --quiet --out "$work/e.hdr.txt"
check "and built to the same bricks" "$program" volume build "$work/e.hdr.txt" --brick 8 --quiet --out "$work/f.bricks"
check "of the same grid" sh -c '"$1" volume info "$2" | tail -n +2 | cmp - "$3"' x "$program" "$work/f.bricks" \
	"$work/e.info"
check "half a turn has two faces" sh -c '"$1" volume build --generate shock --dim 16x16x16 --steps 1 --brick 8 --quiet \
	--spherical 1:2:0.5:2.5:0:3 --out "$2" && ! "$1" volume info "$2" | grep -q "all the way"' x "$program" "$work/h.bricks"
check "an unknown generator is refused" refused 1430 build --generate smoke --out "$work/b.bricks"
check "an interrupt keeps what is done" interrupted
check "and it goes on" gone_on_with
finish
