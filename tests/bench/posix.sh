#!/bin/sh
# tests/bench/posix.sh [SECONDS]: 120 Hz in four real processes for so long (600): how late they wake, beside what a bare
# sleep on this machine is late (before the scene, and while the others still run), and what of the frames came of it.
set -u
seconds=${1:-600}
out=${OUT:-build/results/bench-posix}
"${BB_PROGRAM:-build/blackburst}" run rooms/bench120.yaml scenes/bench120.yaml --clock posix --nodes 4 --link "${LINK:-shm}" \
	--duration "$seconds" --quiet --out "$out"
case $? in 0 | 1) ;; *) exit 1 ;; esac # budgets are judged in a room, not here
python3 - "$out/result.json" <<'P'
import json, sys
r = json.load(open(sys.argv[1]))
f, c = r['facts'], r['counters']
print(f"{f['processes']}, {r['duration_s']:g} s at 120 Hz: {c['frames']} frames, {c['flips']} flips of {3 * c['frames']}")
for key, what in (('timer_floor_us', 'a bare sleep, before'), ('timer_floor_busy_us', 'a bare sleep, at the end'),
                  ('wake_late_head_us', 'the head, at the vblank'), ('wake_late_nodes_us', 'the nodes, a quarter frame after release')):
    print(f"  late, us: {what:42} {f[key]}")
for s in r['stages']:
    if s['stage'] in ('state', 'barrier') and s['node'] == '':
        m = s['summary']
        print(f"  {s['stage']:8} ms: p50 {m['p50']:.3f}, p99 {m['p99']:.3f}, max {m['max']:.3f}")
P
