#!/bin/sh
# tests/guest/case.sh STATE LOGS "NAME TIMEOUT_S MODULES COMMAND...": runs one case in a fork of build/guest/STATE and
# leaves build/guest/LOGS/NAME/out (what it printed) and verdict: "pass|fail|skip MILLISECONDS REASON".
set -u
cd "$(dirname "$0")/../../build/guest" || exit 1
here=../../tests/guest
. $here/machine.sh
state=$1 logs=$2
read -r name timeout_s modules command <<END
$3
END
long=${LONG:-0}
dir=$logs/$name
begun=$(date +%s%N)
mkdir -p "$dir"
: >"$dir/out"

verdict() { # WORD REASON
	echo "$1 $((($(date +%s%N) - begun) / 1000000)) $2" >"$dir/verdict"
	exit 0
}

# What the guest reads as its case; QEMU wants the same size each time.
write_case() {
	replugs=3
	[ "$long" != 1 ] || replugs=100 timeout_s=$((timeout_s * 30))
	{
		echo "timeout_s=$timeout_s modules='$(echo "$modules" | sed 's/^-$//; s/,/ /g')'"
		echo "export LONG=$long REPLUGS=$replugs"
		printf "cat >/tmp/command <<'END_OF_COMMAND'\n%s\nEND_OF_COMMAND\n" "$command"
		head -c 8192 /dev/zero | tr '\0' '\n'
	} | head -c 8192 >"$dir/case"
}

# The machine was saved while it stood still, so somebody has to tell it to go on, once it is restored.
go_on() {
	left=1500
	until grep -qa guest-panicked "$dir/answers" || [ $left = 0 ]; do
		echo "info status"
		left=$((left - 1))
		sleep 0.02
	done
	echo cont
}

run_guest() {
	: >"$dir/answers"
	limit_s=$((60 + 10 * timeout_s))
	go_on 2>/dev/null | timeout --foreground -k 5 $limit_s sh -c '. '$here'/machine.sh; machine "$@"' machine "${BB_SLOT:-0}" "${MEMORY:-256}" "$dir/case" \
		"$dir/serial" -incoming "exec:cat $state" -monitor stdio >"$dir/answers" 2>&1
	awk '/^@out$/ { on = 1; next } /^@rc / { on = 0 } on' "$dir/serial" >"$dir/out"
	rc=$(sed -n 's/^@rc //p' "$dir/serial" | tail -n 1)
}

case $name in long_*) [ "$long" = 1 ] || verdict skip "runs with LONG=1" ;; esac
for module in $(echo "$modules" | tr ',' ' '); do
	! grep -qx "${module%%:*}" missing-modules || verdict fail "no kernel module is called ${module%%:*}"
done
write_case
run_guest
case $rc in
0) ;;
77) verdict skip "$(grep -v '^$' "$dir/out" | tail -n 1 | sed 's/^SKIP[: ]*//')" ;;
143) verdict fail "not done after $timeout_s s of guest time" ;;
'') cat "$dir/serial" >"$dir/out"; verdict fail "the guest ended or hung before the case did" ;;
*) verdict fail "exit code $rc" ;;
esac
! grep -q '^@kernel$' "$dir/out" || verdict fail "the kernel complained"
if [ -f "$here/judge_$name.sh" ] && ! sh "$here/judge_$name.sh" <"$dir/out" >"$dir/judge" 2>&1; then
	{ echo "judge_$name.sh:"; cat "$dir/judge"; } >>"$dir/out"
	verdict fail "judge_$name.sh does not agree: $(tail -n 1 "$dir/judge")"
fi
verdict pass ""
