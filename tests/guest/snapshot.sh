#!/bin/sh
# tests/guest/snapshot.sh STATE MEMORY_MIB SLOT: boots the guest of build/guest/ and saves it, where it stopped itself, as
# build/guest/STATE; STATE.clock gets its counters of instructions and skipped time: states in which they are equal behave
# the same to the last byte. Prints the console and exits 1 when the guest does not come up.
set -u
cd "$(dirname "$0")/../../build/guest" || exit 1
. ../../tests/guest/machine.sh
state=$1
work=boot-$state
rm -rf "$work"
mkdir "$work"
mkfifo "$work/monitor"
head -c 8192 /dev/zero | tr '\0' '\n' >"$work/case"
(machine "$3" "$2" "$work/case" "$work/serial" -qmp stdio <"$work/monitor" >"$work/answers" 2>&1) &
guest=$!
trap 'kill $guest 2>/dev/null; exit 1' HUP INT TERM
exec 3>"$work/monitor"

# Waits for an answer or an event. Nothing may be asked before the guest has stopped: see align.c.
until_told() { # PATTERN SECONDS [QUESTION]
	left=$((20 * $2))
	until grep -qa "$1" "$work/answers"; do
		left=$((left - 1))
		[ $left -gt 0 ] && kill -0 $guest 2>/dev/null || return 1
		[ -z "${3:-}" ] || echo "$3" >&3
		sleep 0.05
	done
}

echo '{"execute": "qmp_capabilities"}' >&3
until_told '"event": "STOP"' 180 &&
	echo '{"execute": "migrate", "arguments": {"uri": "exec:cat >'"$state"'.part"}}' >&3 &&
	until_told '"status": "completed"' 60 '{"execute": "query-migrate"}'
saved=$?
kill -0 $guest 2>/dev/null && echo '{"execute": "quit"}' >&3
exec 3>&-
wait $guest
if [ $saved = 0 ]; then
	at=$(LC_ALL=C grep -abo timer/icount "$state.part" | head -n 1 | cut -d: -f1)
	tail -c +$((at + 17)) "$state.part" | head -c 16 | od -An -tx1 | tr -d ' \n' >"$state.clock"
	mv "$state.part" "$state"
else
	echo "the guest did not come up; its console and QEMU's answers:"
	tail -n 30 "$work/serial"
	tail -n 5 "$work/answers"
fi
rm -rf "$work" "$state.part"
exit $saved
