#!/bin/sh
# tests/guest/snapshot.sh STATE MEMORY_MIB: boots the guest of build/guest/ and saves it, where it stopped itself, as
# build/guest/STATE. Prints the console and exits 1 when it does not come up.
set -u
cd "$(dirname "$0")/../../build/guest" || exit 1
. ../../tests/guest/machine.sh
state=$1
work=boot-$state
rm -rf "$work"
mkdir "$work"
mkfifo "$work/monitor"
head -c 8192 /dev/zero | tr '\0' '\n' >"$work/case"
(machine "$2" "$work/case" "$work/serial" -monitor stdio <"$work/monitor" >"$work/answers" 2>&1) &
guest=$!
trap 'kill $guest 2>/dev/null; exit 1' HUP INT TERM
exec 3>"$work/monitor"

# Asks the monitor 20 times a second until it gives this answer, for some minutes at most.
until_answered() { # QUESTION ANSWER SECONDS
	left=$((20 * $3))
	until grep -qa "$2" "$work/answers"; do
		left=$((left - 1))
		[ $left -gt 0 ] && kill -0 $guest 2>/dev/null || return 1
		echo "$1" >&3
		sleep 0.05
	done
}

until_answered "info status" 'VM status: paused' 180 && echo "migrate \"exec:cat >$state.part\"" >&3 &&
	until_answered "info migrate" 'Migration status: completed' 60
saved=$?
kill -0 $guest 2>/dev/null && echo quit >&3
exec 3>&-
wait $guest
if [ $saved = 0 ]; then
	mv "$state.part" "$state"
else
	echo "the guest did not come up; its console and QEMU's answers:"
	tail -n 30 "$work/serial"
	tail -n 5 "$work/answers" | tr -d '\033'
fi
rm -rf "$work" "$state.part"
exit $saved
