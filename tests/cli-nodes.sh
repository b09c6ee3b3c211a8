#!/bin/sh
# One run in several real processes: kill -9 of one over either link and the rest finish and say when and who; joining
# by hand and by mpirun; who does not belong is not let in; SIGTERM ends all with a report; no process outlives the head.
# Times of this machine are nobody's business here: budgets may fail, processes may not.
. tests/cli.sh.inc
room=rooms/cabin.yaml
pattern=scenes/calibration.yaml
run="$program run $room $pattern --clock posix --nodes 4"
umask 077
od -An -N16 -tx1 /dev/urandom | tr -d ' \n' >"$work/token"

children() { ps -o pid= --ppid "$1" 2>/dev/null; }
gone() { # every process of a list, within 2 s
	for i in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
		left=
		for pid in "$@"; do [ -d "/proc/$pid" ] && ! grep -q '^State:.Z' "/proc/$pid/status" 2>/dev/null && left=$pid; done
		[ -z "$left" ] && return 0
		sleep 0.1
	done
	return 1
}
begun() { # NAME: until that run's scene goes on
	for i in $(seq 600); do
		grep -q "the scene begins" "$work/$1.err" && return
		sleep 0.1
	done
}

invited() { # NAME: the address at which that run waits for others
	for i in $(seq 600); do
		to=$(sed -n 's/.*--join \(zmq:[^ ]*\).*/\1/p' "$work/$1.err")
		[ -n "$to" ] && break
		sleep 0.1
	done
	echo "$to"
}
connected() { # N: until so many are, at $address
	port=$(printf ':%04X ' "${address##*:}")
	for i in $(seq 600); do
		[ "$(awk '$4 == "01" { print $2 " " }' /proc/net/tcp | grep -c "$port")" -ge "$1" ] && return
		sleep 0.1
	done
}

# A process whose oscillator is 400 ppm too fast follows the head's clock all the same; left alone it would be 4 ms off.
follow() {
	$run --link zmq --nodes 2 --wait --token-file "$work/token" --duration 10 --out "$work/follow" >/dev/null 2>"$work/follow.err" &
	pid_follow=$!
	to=$(invited follow)
	"$program" node $room $pattern --nodes 2 --join "$to" --token-file "$work/token" --duration 10 --plant-crystal-ppm 400
	wait $pid_follow
}

# Runs at once, each disturbed when its scene has begun.
disturb() { # NAME...
	for way in "$@"; do begin $way; done
	for way in "$@"; do
		begun $way
		eval "pids_$way=\$(children \$pid_$way)"
		eval "second=\$(echo \$pids_$way | cut -d' ' -f2)"
		sleep 0.3
		case $way in
		hang) (kill -STOP "$second"; sleep 0.5; kill -CONT "$second") & ;;
		term) kill -TERM "$pid_term" ;;
		dead) kill -9 "$pid_dead" ;;
		*) kill -9 "$second" ;;
		esac
	done
}
begin() { # NAME
	case $1 in
	zmq) options="--link zmq --duration 5" ;;
	again) options="--restart --duration 60" ;;
	hang) options="--duration 9" ;;
	shm) options="--link shm --duration 5" ;;
	*) options="--duration 60" ;;
	esac
	# shellcheck disable=SC2086
	$run $options --out "$work/$1" >/dev/null 2>"$work/$1.err" &
	eval "pid_$1=$!"
}

# kill -9 of one of four, in the middle, where it is started again: both its nodes are, and have time to fall behind
disturb again
back() { grep -o "node .* is back" "$work/again.err" | sort -u | wc -l; }
for i in $(seq 400); do
	[ "$(back)" -ge 2 ] && break
	sleep 0.1
done
sleep 3
kill -TERM "$pid_again"
wait "$pid_again"
check "restart: both nodes of the process are back" [ "$(back)" -ge 2 ]
check "restart: the report counts them" [ "$(field "$work/again/result.json" "r['counters']['nodes_rejoined'] >= 2")" = True ] # on a busy machine one may fall behind again
check "restart: within five times 2 s" [ "$(field "$work/again/result.json" "all((i['to_s'] or r['duration_s']) - i['from_s'] < 10 for i in r['incidents'] if 'signal 9' in i['what'])")" = True ]
check "restart: and stay so" [ "$(field "$work/again/result.json" "r['counters']['processes_lost'] == 1 and all(i['to_s'] is not None for i in r['incidents'] if 'signal 9' in i['what'])")" = True ]

# and over either link, where it is not
disturb shm zmq
for way in shm zmq; do
	eval "pid=\$pid_$way; set -- \$pids_$way"
	wait "$pid"
	code=$?
	check "$way: the rest finish with a verdict" [ $code = 1 ]
	check "$way: the report says who" [ "$(field "$work/$way/result.json" "sorted(i['culprit'] for i in r['incidents'] if 'pid $2) was killed by signal 9' in i['what'])")" = "['node/floor', 'node/left']" ]
	check "$way: and when" [ "$(field "$work/$way/result.json" "all(0 < i['from_s'] < 5 for i in r['incidents'] if 'signal 9' in i['what'])")" = True ]
	check "$way: the scene went on to its end" [ "$(field "$work/$way/result.json" "r['counters']['frames'] > 10 and not r['truncated']")" = True ]
	check "$way: no packet was refused" [ "$(field "$work/$way/result.json" "r['counters']['packets_refused']")" = 0 ]
	check "$way: nobody is left behind" gone "$@"
done

disturb hang term dead
wait "$pid_term"
check "SIGTERM: the report is there, truncated" [ "$(field "$work/term/result.json" "r['truncated'] and r['counters']['frames'] > 1")" = True ]
# shellcheck disable=SC2086
check "SIGTERM: nobody is left behind" gone $pids_term
wait "$pid_dead" 2>/dev/null
# shellcheck disable=SC2086
check "the head dies: nobody outlives it" gone $pids_dead
OUT=$work/posix BB_PROGRAM=$program tests/bench/posix.sh 2 >"$work/posix.txt" 2>"$work/posix.err" &
pid_posix=$!
printf 'scene: slow\ntechnique: calibration\nduration_s: 3\nneeds: {displays: 1}\npatch: {hz: 2, size_m: 1}\n' >"$work/slow.yaml"
"$program" run $room "$work/slow.yaml" --clock posix --nodes 4 --quiet --out "$work/slow" 2>"$work/slow.err"
check "walls that others draw are metered, too" [ "$(field "$work/slow/result.json" '[1 <= b["value"] <= 2.5 for b in r["budgets"] if b["metric"] == "flashes"][0]')" = True ]
wait "$pid_hang"
check "a process that hangs: the rest go on without it" [ "$(field "$work/hang/result.json" "r['counters']['frames'] > 10 and any('did not come to the swap barrier' in i['what'] for i in r['incidents'])")" = True ]
check "a process that hangs for a while is back" [ "$(field "$work/hang/result.json" "all(i['to_s'] is not None for i in r['incidents'] if 'did not come' in i['what'] and i['culprit'] == 'node/left')")" = True ]

# 120 Hz: counters only, a fifth of the frames is enough on any machine
wait $pid_posix
check "120 Hz in four processes: frames, and none refused" [ "$(field "$work/posix/result.json" "r['counters']['frames'] >= 48 and r['counters']['packets_refused'] == 0 and 'processes_lost' not in r['counters']")" = True ]
check "120 Hz: lateness stands beside the timer's floor" [ "$(grep -c 'wakes: p50' "$work/posix.txt")" = 4 ]

follow &
following=$!

# Joining by hand, over ZeroMQ: any place, an own place, another scene, one too many. Who joined says nothing until all are
# there, and keeps its place for all that.
$run --link zmq --wait --token-file "$work/token" --duration 6 --out "$work/hand" >/dev/null 2>"$work/hand.err" &
pid=$!
address=$(invited hand)
hand() { "$program" node $room "$@" --nodes 4 --join "$address" --token-file "$work/token" --duration 6; }
hand "$scene" 2>"$work/other" >/dev/null
check "another scene is not let in: BB1677" grep -q BB1677 "$work/other"
ss -ltn 2>/dev/null | grep -q "0.0.0.0:${address##*:}" && open=yes
check "it listens on loopback only" [ -z "${open:-}" ]
hand $pattern --index 2 2>"$work/n1" &
one=$!
connected 1
sleep 1.5 # a place whose owner said nothing for a second was given away once
if command -v mpirun >/dev/null; then
	mpirun --allow-run-as-root --oversubscribe -n 2 "$program" node $room $pattern --nodes 4 --join "$address" --token-file "$work/token" --duration 6 >"$work/mpi" 2>&1 &
else
	echo "SKIP: there is no mpirun: a shell starts the other two processes"
	for i in 2 3; do hand $pattern 2>"$work/n$i" & done
fi
begun hand
hand $pattern 2>"$work/many" >/dev/null
check "one too many is not let in: BB1675" grep -q BB1675 "$work/many"
wait $pid
wait $one
check "a node by hand ends well with its head" [ $? = 0 ]
check "by hand: all frames of the scene" [ "$(field "$work/hand/result.json" "r['counters']['frames'] > 60 and 'processes_lost' not in r['counters']")" = True ]
check "by hand: refused joins are counted" [ "$(field "$work/hand/result.json" "r['counters']['packets_refused'] >= 2")" = True ]

wait $following
check "another oscillator: steered by what it is wrong" [ "$(field "$work/follow/result.json" "abs(float(r['facts']['clock_front'].split('by ')[1].split()[0]) + 400) < 60")" = True ]
check "another oscillator: within half of what it would be" [ "$(field "$work/follow/result.json" "float(r['facts']['clock_front_off'].split()[0]) < 2000")" = True ]

# The head is killed: who joined by hand holds its pictures, fades them, and only then ends
$run --link zmq --nodes 2 --wait --token-file "$work/token" --duration 20 --out "$work/orphan" >/dev/null 2>"$work/orphan.err" &
pid=$!
address=$(invited orphan)
"$program" node $room $pattern --nodes 2 --join "$address" --token-file "$work/token" --duration 20 2>"$work/orphaned" >/dev/null &
two=$!
begun orphan
sleep 1
kill -9 $pid
killed=$(date +%s%N)
wait $two
status=$?
check "the head is killed: a node by hand ends by BB1674" [ "$status" = 4 ]
check "the head is killed: it said so, and faded first" [ "$(grep -c MASTER_LOST "$work/orphaned")" -ge 1 ] &&
	check "the head is killed: not before its walls were dark" [ $(($(date +%s%N) - killed)) -gt 1400000000 ]
wait

# Barriers of real processes: every way works under every load, the peer that is not built says so
"$program" bench barrier --real --processes 3 --seconds 0.02 --json >"$work/barrier.json" 2>"$work/err"
check "bench barrier: every way came round" [ "$(field "$work/barrier.json" "all(x.get('rounds', 0) > 0 for x in r['real']['rows'] if x['barrier'] != 'mpi')")" = True ]
check "bench barrier: three loads, eight ways, and MPI's reason" [ "$(field "$work/barrier.json" "(len(r['real']['rows']), sum('skipped' in x for x in r['real']['rows']))")" = "(24, 2)" ]

# Words that make no sense
refused() { "$@" 2>&1 >/dev/null | grep -o 'BB1[0-9]*' | head -n 1; }
check "virtual time has one process" [ "$(refused "$program" run $room $pattern --nodes 2)" = BB1701 ]
check "a process of none" [ "$(refused "$program" run $room $pattern --clock posix --nodes 7)" = BB1701 ]
check "no such link" [ "$(refused $run --link ipc)" = BB1670 ]
check "loopback unless told otherwise" [ "$(refused $run --link zmq:tcp://0.0.0.0 --token-file "$work/token")" = BB1672 ]
check "open only with a secret" [ "$(refused $run --link zmq:tcp://0.0.0.0 --open)" = BB1671 ]
chmod 644 "$work/token"
check "a secret that all may read is none" [ "$(refused $run --token-file "$work/token")" = BB1671 ]
finish
