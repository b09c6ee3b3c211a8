#!/bin/sh
# The cabin with a volume four times as large as what a node may hold: budgets are kept, every wall has a picture of its
# levels, the same seed gives the same bytes; a disk that stalls costs detail and no frame; bricks that make a frame late
# and bricks that cannot be read are named.
. tests/cli.sh.inc
wind=scenes/wind.yaml

run() { # FOLDER ARGUMENTS...; its exit code is in $code
	out=$work/$1
	shift
	"$program" run "$@" --seed 3 --quiet --out "$out" >"$work/out" 2>"$work/err"
	code=$?
}
json() { # FOLDER EXPRESSION: it holds
	[ "$(field "$work/$1/result.json" "$2")" = True ] || { field "$work/$1/result.json" 'r["summary"], r["streaming"]'; return 1; }
}
lit() { # FOLDER: every wall has its levels at every time, lit where an eye sees the volume; and some wall does
	python3 - "$work/$1" <<'PY'
import json, os, struct, sys, zlib
folder = sys.argv[1]

def share(path): # of pixels that are not black
    data = open(path, 'rb').read()
    assert data[:8] == b'\x89PNG\r\n\x1a\n', path
    at, body = 8, b''
    while at < len(data):
        n, kind = struct.unpack('>I4s', data[at:at + 8])
        part = data[at + 8:at + 8 + n]
        assert struct.unpack('>I', data[at + 8 + n:at + 12 + n])[0] == zlib.crc32(kind + part), path
        if kind == b'IHDR':
            w, h, depth, colour = struct.unpack('>IIBB', part[:10])
        body += part if kind == b'IDAT' else b''
        at += 12 + n
    assert depth == 8 and colour in (2, 6), path
    px = 3 if colour == 2 else 4
    raw, before, bright = zlib.decompress(body), bytes(w * px), 0
    for y in range(h):
        kind, line = raw[y * (w * px + 1)], bytearray(raw[y * (w * px + 1) + 1:(y + 1) * (w * px + 1)])
        for i in range(len(line)):
            a, b, c = (line[i - px] if i >= px else 0), before[i], (before[i - px] if i >= px else 0)
            if kind == 4:
                p = a + b - c
                d = abs(p - a), abs(p - b), abs(p - c)
                line[i] = line[i] + (a if d[0] <= d[1] and d[0] <= d[2] else b if d[1] <= d[2] else c) & 255
            elif kind:
                line[i] = line[i] + (a if kind == 1 else b if kind == 2 else (a + b) // 2) & 255
        before = bytes(line)
        bright += sum(max(line[i:i + 3]) > 12 for i in range(0, len(line), px))
    return bright / (w * h)

pictures = json.load(open(folder + '/result.json'))['pictures']
walls = {(p['wall'], p['at_s']): {} for p in pictures}
for p in pictures:
    walls[p['wall'], p['at_s']][p['eye']] = share(os.path.join(folder, p['file']))
seen = [w for w in walls.values() if w['left'] > 0.05]
assert len({w for w, t in walls}) == 5 and len(seen) >= 4, walls
for w in seen:
    assert w['levels'] > 0.8 * w['left'], walls
PY
}
returned() { # FOLDER REFERENCE: from 2 s after the stall on no more is missing than without one, and while it lasted far more
	python3 - "$work/$1/frames.csv" "$work/$2/frames.csv" <<'PY'
import csv, sys
def missing(path, a, b):
    rows = [r for r in csv.DictReader(open(path)) if a <= float(r['start_scene_s']) < b]
    return sum(int(r['bricks_missing_count']) for r in rows) / len(rows)
before, during, after = [[missing(p, a, b) for p in sys.argv[1:]] for a, b in ((1, 2), (3, 7), (9, 10.5))]
print('missing bricks in a frame, stalled and not: before %.1f %.1f, during %.1f %.1f, after %.1f %.1f' % (*before, *during, *after))
sys.exit(not (before[0] == before[1] and during[0] > 4 * during[1] and after[0] <= 1.05 * after[1] + 1))
PY
}
same() { # FOLDER FOLDER: but for the time it took
	for f in frames.csv trace.json $(cd "$work/$1" && ls *.png); do
		cmp "$work/$1/$f" "$work/$2/$f" || return 1
	done
	grep -v wall_time "$work/$1/result.json" >"$work/1.json"
	grep -v wall_time "$work/$2/result.json" | cmp - "$work/1.json"
}

sed 's/^pictures:.*/pictures: {at_s: [0.9], walls: all, eyes: left, scale: 0.1}/' $wind >"$work/small.yaml"
run a rooms/cabin.yaml "$work/small.yaml" --gl cpu --duration 1
check "it passes" [ $code = 0 ]
check "every wall has its levels" lit a
run b rooms/cabin.yaml "$work/small.yaml" --gl cpu --duration 1
check "the same seed, the same bytes" same a b

run free rooms/cabin.yaml $wind --no-pictures --duration 10.5
check "it passes for 10.5 s" [ $code = 0 ]
nodes='all(%s for n in r["streaming"]["nodes"]) and len(r["streaming"]["nodes"]) == 5'
check "the data is four times the budget" json free "$(printf "$nodes" 'n["data_over_memory"] >= 4')"
check "memory is kept" json free "$(printf "$nodes" '0 < n["memory_held_bytes"] <= n["memory_budget_bytes"] == 2097152')"
check "streaming is kept" json free "$(printf "$nodes" '0 < n["bricks_read"]["most"] <= n["bricks_a_frame_budget"] == 48')"
check "no brick load spent a frame" json free 'r["streaming"]["brick_loads"].startswith("no brick load spent a frame; the most was 0.1")'

run stalled rooms/cabin.yaml $wind --no-pictures --duration 10.5 --fault "at 2s node/front stall for 5s"
check "a disk that stalls fails nothing" [ $code = 0 ]
check "the frame budget holds" json stalled 'all(b["verdict"] == "PASS" for b in r["budgets"] if b["metric"] == "frame")'
check "detail goes and is back within 2 s" returned stalled free
check "a warning names the disk" json stalled '[i["culprit"] for i in r["incidents"] if i["state"] == "WARNING" and "gives nothing" in i["what"] and 2 <= i["from_s"] < 2.3 and 7 <= i["to_s"] < 7.3] == ["node/front"]'
check "and nothing warns without a stall" json free 'not r["incidents"]'

# The same room with nodes on which a brick costs a millisecond.
mkdir "$work/profiles"
sed 's/^per_brick_ns:.*/per_brick_ns: 1000000/' rooms/profiles/desktop-gpu.yaml >"$work/profiles/desktop-gpu.yaml"
cp rooms/cabin.yaml "$work/slow.yaml"
run slow "$work/slow.yaml" $wind --no-pictures --duration 1
check "dear bricks fail the frame budget" [ $code = 1 ]
check "and are named with their node" json slow 'any(b["metric"] == "frame" and b["verdict"] == "FAIL" and b["culprit"].startswith("node/") and "loading" in b["cause"] and ("brick (" in b["cause"] or "bricks (" in b["cause"]) for b in r["budgets"])'
check "in the section too" json slow '"late; the worst at" in r["streaming"]["brick_loads"] and max(n["frames_late_by_bricks"] for n in r["streaming"]["nodes"]) > 5'
check "a late frame would have been in time" json slow 'all(n["worst_late"]["frame_ms"] > 8.33 >= n["worst_late"]["frame_ms"] - n["worst_late"]["ms"] for n in r["streaming"]["nodes"] if n["worst_late"])'
check "where drawing leaves time, fewer are read and few frames are late" json slow 'sorted(n["frames_late_by_bricks"] for n in r["streaming"]["nodes"])[-2] <= 2'
check "the report tells it" grep -q "Brick loads made" "$work/slow/report.html"

# A file some of whose bricks are damaged, though none of their histograms: the run goes on with coarser ones.
"$program" volume build --generate enlil --dim 64x32x64 --steps 4 --brick 8 --type u16 --quiet --out "$work/d.bricks" >"$work/out" 2>&1
python3 - "$work/d.bricks" <<'PY'
import struct, sys
with open(sys.argv[1], 'r+b') as f:
    head = f.read(4096)
    n, index = struct.unpack('<QQ', head[152:168]) # bricks, and where their records begin: offset u64, bytes u32, CRC u32
    f.seek(index)
    records = f.read(16 * n)
    for i in range(40, n, 9):
        offset, length = struct.unpack('<QI', records[16 * i:16 * i + 12])
        f.seek(offset + length // 2)
        byte = f.read(1)
        f.seek(offset + length // 2)
        f.write(bytes([byte[0] ^ 0x5A]))
PY
sed -e '/^  generate:/d; /^  dim:/d; /^  steps:/d; s/^data:/data:\n  file: d.bricks/' $wind >"$work/damaged.yaml"
run hurt rooms/cabin.yaml "$work/damaged.yaml" --no-pictures --duration 1
check "damaged bricks fail nothing" [ $code = 0 ]
check "they are counted, with the error" json hurt 'any(n["failed"] > 0 and n["error"] == 1441 and "BB1441" in n["error_text"] for n in r["streaming"]["nodes"])'
check "and warned of" json hurt 'any(i["state"] == "WARNING" and "BB1441" in i["what"] for i in r["incidents"])'
check "and stand in the report" grep -q "could not be read" "$work/hurt/report.html"
finish
