#!/bin/sh
# One virtual hour of the Reality Deck: 416 displays, 18 nodes, their links, and a shutter chain over the four walls, all
# at fidelity 1, twice: CPU seconds and memory of each, and the same event log hash. tests/hour.sh [SECONDS [LIMIT_S]]
# The deck has no shutters of its own: a chain of four stages and an emitter at 120 Hz is added to a copy of its file.
# fails: when the hashes differ, or a run takes more than five times LIMIT_S (60) of CPU.
seconds=${1:-3600}
limit=${2:-60}
program=${BB_PROGRAM:-build/blackburst}
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
sed '/^cameras:/i\
shutters:\
  chain: {rate_hz: 120, stages: [front, right, back, left], stage_delay_us: 35, rate_error_ppm: 12, jitter_us: 1}\
  emitter: {protocol: 3d-vision, offset_us: 3000}\
' rooms/deck.yaml >"$work/deck.yaml"
cp -r rooms/profiles "$work/"
for run in 1 2; do
	python3 - "$program" "$work" "$run" "$seconds" "$limit" <<'PY' || exit 1
import json, resource, subprocess, sys
program, work, run, seconds, limit = sys.argv[1:]
out = f"{work}/{run}"
done = subprocess.run([program, "run", f"{work}/deck.yaml", "scenes/rhythm.yaml", "--duration", seconds, "--seed", "7",
                       "--no-pictures", "--quiet", "--out", out])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
result = json.load(open(f"{out}/result.json"))
cpu = used.ru_utime + used.ru_stime
print(f"{seconds} virtual s: {cpu:.1f} CPU s of at most {limit}, {used.ru_maxrss / 1024:.0f} MiB, {result['events']} events, "
      f"{result['events'] / cpu / 1e6:.2f} million/s, {result['event_log_sha256']}")
open(f"{work}/hash.{run}", "w").write(result["event_log_sha256"])
sys.exit(done.returncode not in (0, 1) or cpu > 5 * float(limit))
PY
done
cmp "$work/hash.1" "$work/hash.2"
