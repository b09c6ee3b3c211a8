#!/bin/sh
# tests/scale-volume.sh [FOLDER [GIB]]: what building a brick file costs, at sizes that no test of every day has. Not part
# of `make check`; `make bench-volume` runs it in build/ with 16 GiB.
#
# 1. 256^3 x 8 f32 in bricks of 8^3 under a cap of 512 MiB: peak memory, bytes moved against input and output, and time
#    against a copy (dd) that reads and writes as many bytes and waits for the disk as the builder does. Build and copy take
#    turns, three times; medians, and the spread. The input lies in the page cache for both.
# 2. A generated sequence of GIB gibibytes, bricks of 32^3, under the same cap. Needs 3.2 times as much disk; all files are
#    deleted. 16 GiB took 291 seconds, 395 of processors, 446 MiB counted, 457 MiB resident, and made
#    42.5 GiB.
#
# Exit 0: all bounds hold (512 MiB, 1.3, 2); 1: one does not; 77: no room on the disk.
set -eu
program=$(realpath "${BB_PROGRAM:-build/blackburst}")
folder=${1:-build}
gib=${2:-0}
work=$(mktemp -d "$folder/scale-XXXXXX")
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM
cd "$work"
failures=0

room_mib() { df -m . | awk 'NR == 2 { print $4 }'; }
now() { date +%s.%N; }
need() { # MIB
	[ "$(room_mib)" -ge "$1" ] && return
	echo "SKIP: $1 MiB of disk are wanted in $folder, $(room_mib) are free"
	exit 77
}
field() { python3 -c 'import json, sys; r = json.load(open(sys.argv[1])); print(eval(sys.argv[2]))' "$@"; }
within() { # NAME VALUE LIMIT
	if awk "BEGIN { exit !($2 <= $3) }"; then echo "ok: $1: $2 (limit $3)"; else
		echo "FAILED: $1: $2 (limit $3)"
		failures=$((failures + 1))
	fi
}

copy() { # MIB, from a file of 512 over and over
	left=$1 at=0
	while [ "$left" -gt 0 ]; do
		n=$((left < 512 ? left : 512))
		left=$((left - n))
		dd if=e.raw of=copy bs=1M count=$n seek=$at conv=notrunc$([ $left = 0 ] && echo ,fsync) 2>dd.log || { cat dd.log; exit 1; }
		at=$((at + n))
	done
}

need 6000
"$program" volume generate enlil --dim 256x256x256 --steps 8 --quiet --out e.hdr.txt
cat e.raw >/dev/null
for i in 1 2 3; do
	sync
	"$program" volume build e.hdr.txt --brick 8 --memory 512 --quiet --json --out e.bricks >"build$i.json"
	rm e.bricks
	mib=$(field "build$i.json" '(r["bytes_read"] + r["bytes_written"]) // 2 // 1048576')
	sync
	begun=$(now)
	copy "$mib"
	field "build$i.json" "r['seconds'], $(now) - $begun, r['cpu_seconds']" >>times
	rm copy
done
python3 - <<'END'
import statistics
rows = [eval(line) for line in open("times")]
ratio = sorted(b / c for b, c, cpu in rows)
print("256^3 x 8 f32, 8^3: build %s s (of processors: %s s), copy of as many bytes %s s; ratio %.2f .. %.2f" % (
    " ".join("%.1f" % b for b, c, cpu in rows), " ".join("%.1f" % cpu for b, c, cpu in rows),
    " ".join("%.1f" % c for b, c, cpu in rows), ratio[0], ratio[-1]))
open("ratio", "w").write("%.2f" % statistics.median(ratio))
END
within "peak memory, MiB" "$(field build1.json 'round(r["peak_bytes"] / 1048576, 1)')" 512
within "the process's own peak (VmHWM), MiB" "$(field build1.json 'round(r["resident_bytes"] / 1048576, 1)')" 512
within "bytes moved over input and output" \
	"$(field build1.json 'round((r["bytes_read"] + r["bytes_written"]) / (r["bytes"] + 256**3 * 8 * 4), 3)')" 1.3
within "time over that of a copy, median of 3" "$(cat ratio)" 2
rm -f e.raw e.hdr.txt

if [ "$gib" -gt 0 ]; then
	need $((gib * 3277 + 2000))
	"$program" volume build --generate shock --dim 1024x512x512 --steps "$gib" --brick 32 --memory 512 --json --quiet \
		--out big.bricks >big.json
	field big.json '"%d GiB, 32^3: %d bricks, %.1f GiB in %.0f s (%.0f MiB/s written, generating included)" % ('"$gib"',
		r["bricks"], r["bytes"] / 2**30, r["seconds"], r["bytes_written"] / 2**20 / r["seconds"])'
	within "peak memory, MiB" "$(field big.json 'round(r["peak_bytes"] / 1048576, 1)')" 512
	within "the process's own peak (VmHWM), MiB" "$(field big.json 'round(r["resident_bytes"] / 1048576, 1)')" 512
	# There is no input to count: as a file it would be read twice, or once with --range.
	within "bytes moved over output" "$(field big.json "round((r['bytes_read'] + r['bytes_written']) / r['bytes'], 3)")" 1.3
fi
[ $failures = 0 ]
