#!/bin/sh
# Safety from the command line: a scene that would flash is refused, dimmed, or run by order; a run that is asked to end or
# dies leaves a report or at least open shutters behind.
. tests/cli.sh.inc

scene_of() { # NAME PATCH
	printf 'scene: %s\ntechnique: calibration\nduration_s: 8\nneeds: {shutters: 1, displays: 1}\n%s\n' "$1" "$2" >"$work/$1.yaml"
}
run() { # SCENE OPTIONS...
	s=$1
	shift
	"$program" run rooms/cabin.yaml "$work/$s.yaml" --no-pictures --json --out "$work/out" "$@" >"$work/json" 2>"$work/err"
}
refused() {
	run "$@"
	code=$?
	[ "$code" = 2 ] && grep -q '^BB1690: ' "$work/err" || { echo "exit $code"; head -3 "$work/err"; return 1; }
}
passes() {
	run "$@" || { echo "exit $?"; head -3 "$work/err"; return 1; }
}

scene_of slow 'patch: {hz: 2, size_m: 1}'
scene_of fast 'patch: {hz: 4, size_m: 1}'
scene_of small 'patch: {hz: 10, size_m: 0.05}'
scene_of faint 'patch: {hz: 10, size_m: 1, low_percent: 50, high_percent: 58}'
check "two flashes a second are no violation" passes slow
check "and are measured" [ "$(field "$work/json" '[2 <= b["value"] <= 2.5 for b in r["budgets"] if b["metric"] == "flashes"][0]')" = True ]
check "four are refused with a number" refused fast
check "a small patch may flash" passes small
check "a faint one may" passes faint
check "--dim-flash darkens it" passes fast --dim-flash
check "--allow-flash runs it" passes fast --allow-flash
check "with a warning" grep -q '^WARNING: ' "$work/err"

# Row O2: asked to end, or dead. Real time, in a room without cameras.
told() { # SIGNAL [GROUP]; "-": as a terminal and systemd do it, parent and child are told, and the parent passes it on
	# shellcheck disable=SC2086
	setsid $usual "$program" run rooms/cabin.yaml "$work/slow.yaml" --clock posix --no-pictures --quiet --guard --duration 2.5 --out "$work/$1" 2>"$work/err" &
	parent=$!
	sleep 1.5
	kill "-$1" "${2:-}$parent"
	wait $parent
	field "$work/$1/result.json" 'r["truncated"]'
}
ended() { # whatever this script itself was told to ignore
	[ "$(usual="env --default-signal=HUP,INT,TERM" && told "$@")" = True ] || { head -3 "$work/err"; return 1; }
}
went_on() { # as under nohup
	[ "$(usual= && trap '' HUP && told HUP)" = False ] || { head -3 "$work/err"; return 1; }
}
died() { # SIGNAL; a sanitizer would turn a crash into an exit
	ASAN_OPTIONS="${ASAN_OPTIONS:-}:handle_segv=0" "$program" run rooms/cabin.yaml "$work/slow.yaml" --clock posix --no-pictures --quiet --guard --out "$work/$1" 2>"$work/err" &
	parent=$!
	sleep 1
	kill "-$1" $(cat /proc/$parent/task/$parent/children)
	wait $parent
	code=$?
	[ "$code" = 3 ] && grep -q '^BB1692: ' "$work/err" || { echo "exit $code"; head -3 "$work/err"; return 1; }
}
for signal in INT TERM HUP; do
	check "$signal ends in a report that says so" ended $signal
done
check "a terminal's INT too" ended INT -
check "HUP that is ignored stays ignored" went_on
for signal in SEGV KILL; do
	check "$signal is seen by the guard" died $signal
done
finish
