#!/bin/sh
# tests/guest/run.sh PROGRAM...: `make check-kernel`. Boots a guest once, saves it, and runs every case of cases.txt in a
# fork of that snapshot. Prints a line a case, every skip with its reason, and "N passed, M failed, K skipped" at the
# end; leaves build/guest/junit.xml, results.jsonl (one line a case) and logs/. Exit 0 unless something failed.
# From make's command line: ONLY="smoke_can gpio_*" runs some cases; LONG=1 the long ones, too; DETERMINISM=1 wants the
# output of every case again from a second guest, byte for byte (unset: of the smoke cases; 0: of none); RECORD=1 writes
# latency.json anew; JOBS=N cases at the same time; MEMORY=MIB of the guest.
set -u
cd "$(dirname "$0")/../.." || exit 1
here=tests/guest
out=build/guest
tab=$(printf '\t')
mkdir -p $out

nothing() { # REASON: nothing can run here, which is no failure
	echo "SKIP check-kernel: $1"
	echo "0 passed, 0 failed, 1 skipped"
	exit 0
}

prepare() {
	[ "$(dpkg --print-architecture 2>/dev/null)" = amd64 ] || nothing "the guest is made of Debian's packages for amd64"
	tests/deps.sh packages-kernel.txt || nothing "the packages of packages-kernel.txt cannot be installed here"
	$here/build.sh "$@" >$out/build.log 2>&1
	code=$?
	grep -v '^SKIP' $out/build.log
	[ $code != 77 ] || nothing "$(sed -n 's/^SKIP: //p' $out/build.log | tail -n 1)"
	[ $code = 0 ] || { echo "the guest cannot be built"; echo "0 passed, 1 failed, 0 skipped"; exit 1; }
	environment=$(cat $out/environment) key=$(cat $out/key)
}

# The cases that ONLY names; "selected" is in their order, "again" are those that run in the second guest.
select_cases() {
	only=${ONLY:-*}
	sed 's/^#.*//; s/[ \t]*$//' $here/cases.txt | while read -r line; do
		set -f
		for pattern in ${line:+$only}; do
			# shellcheck disable=SC2254
			case ${line%%[ $tab]*} in $pattern) echo "$line"; break ;; esac
		done
		set +f
	done >$out/selected
	[ "${RECORD:-0}" != 1 ] || DETERMINISM=1 # only what came twice is recorded
	case ${DETERMINISM:-smoke} in
	0) : ;;
	smoke) grep '^smoke_' $out/selected ;;
	*) cat $out/selected ;;
	esac >$out/again
}

# Two guests come up at the same time. The first is kept for later runs of the very same machine; the second never is.
snapshots() {
	find $out -maxdepth 1 -name 'state-*' ! -name "state-$key*" -exec rm -f {} +
	second=
	if [ -s $out/again ]; then
		$here/snapshot.sh state-second "${MEMORY:-256}" 1 >$out/second.log 2>&1 &
		second=$!
	fi
	[ -f $out/state-"$key" ] || $here/snapshot.sh state-"$key" "${MEMORY:-256}" 0
	up=$?
	[ -z "$second" ] || wait "$second" || { cat $out/second.log; up=1; }
	[ $up = 0 ] || { echo "0 passed, 1 failed, 0 skipped"; exit 1; }
	[ -z "$second" ] || cmp -s $out/state-"$key".clock $out/state-second.clock ||
		echo "the guests did not stop at the same instant (bb_stop.c): $(cat $out/state-"$key".clock $out/state-second.clock)"
}

run_cases() { # LIST STATE LOGS
	rm -rf "${out:?}/$3"
	tr '\n' '\0' <"$1" | xargs -0 -r --process-slot-var=BB_SLOT -P "${JOBS:-$(nproc)}" -n 1 $here/case.sh "$2" "$3"
}

# ---- results: one line each in $out/results: SUITE, NAME, VERDICT, MILLISECONDS, REASON, separated by tabs ----

result() {
	printf '%s\t%s\t%s\t%s\t%s\n' "$@" >>$out/results
}

collect() {
	: >$out/results
	: >$out/results.jsonl
	while read -r name _; do
		read -r word took reason <$out/logs/"$name"/verdict || word=fail took=0 reason="no verdict"
		result kernel "$name" "$word" "$took" "$reason"
		json=$(grep '^{' $out/logs/"$name"/out | tail -n 1)
		echo "{\"case\": \"$name\", \"verdict\": \"$word\", \"wall_ms\": $took, \"result\": ${json:-null}}" >>$out/results.jsonl
	done <$out/selected
}

# Runs a case once more. A host with other work can still set a guest's clock some microseconds wrong (machine.sh), now and
# then; a difference that is the guest's own comes back each time.
once_more() { # NAME STATE LOGS
	grep "^$1[ $tab]" $out/selected | tr '\n' '\0' | xargs -0 -n 1 $here/case.sh "$2" "$3"
}

compare() {
	while read -r name _; do
		grep -q "^pass" $out/logs/"$name"/verdict || continue
		took=$(cut -d' ' -f2 $out/logs-second/"$name"/verdict)
		mkdir -p $out/logs-first
		cp -r $out/logs/"$name" $out/logs-first/
		tries=1
		until cmp $out/logs-first/"$name"/out $out/logs-second/"$name"/out >$out/difference 2>&1 || [ $tries = 4 ]; do
			tries=$((tries + 1))
			once_more "$name" state-"$key" logs-first
			once_more "$name" state-second logs-second
		done
		word=pass reason=
		[ $tries = 1 ] || reason="at attempt $tries"
		if [ -s $out/difference ]; then
			word=fail reason=$(tail -n 1 $out/difference)
		else
			cp $out/logs-first/"$name"/out $out/logs/"$name"/out # what the gates look at
		fi
		result "same again" "$name" $word "$took" "$reason"
	done <$out/again
	rm -rf $out/logs-first
}

result_metrics() { # LOGS CASE: "METRIC VALUE" a line
	grep '^{' $out/"$1"/"$2"/out | tail -n 1 | grep -oE '"[a-z0-9_]+_(p50|p99|max)_(ns|us)": *[0-9.]+' | tr -d '"' | sed 's/: */ /'
}

record() {
	{
		printf '{\n\t"environment": "%s", "key": "%s", "margin_percent": 5,\n\t"gates": [' "$environment" "$key"
		separator=
		while read -r name _; do
			grep -q '^pass' $out/logs/"$name"/verdict || continue
			result_metrics logs "$name" | sed "s/\(.*\) \(.*\)/{\"case\": \"$name\", \"metric\": \"\1\", \"recorded\": \2}/"
		done <$out/selected | while read -r line; do
			printf '%s\n\t\t%s' "$separator" "$line"
			separator=,
		done
		printf '\n\t]\n}\n'
	} >$here/latency.json
	echo "recorded: $here/latency.json"
}

# Numbers are exact only on the very machine they were recorded on: the same kernel, QEMU, tools and libraries; on another
# nothing is concluded. There, if our programs are the same bytes as well, no number may change at all. If they are not,
# medians may not rise by more than the margin; tails say nothing then, since they move with the bytes of any program.
gate() {
	[ -f $here/latency.json ] || echo '{}' >$here/latency.json
	recorded=$(sed -n 's/.*"environment": "\([0-9a-f]*\)".*/\1/p' $here/latency.json 2>/dev/null)
	recorded_key=$(sed -n 's/.*"key": "\([0-9a-f]*\)".*/\1/p' $here/latency.json 2>/dev/null)
	margin=$(sed -n 's/.*"margin_percent": \([0-9]*\).*/\1/p' $here/latency.json 2>/dev/null)
	while read -r name _; do
		grep -q '^pass' $out/logs/"$name"/verdict || continue
		result_metrics logs "$name" >$out/metrics
		[ -s $out/metrics ] || continue
		gates=$(sed -n "s/.*\"case\": \"$name\", \"metric\": \"\([a-z0-9_]*\)\", \"recorded\": \([0-9.]*\).*/\1 \2/p" $here/latency.json)
		if [ -z "$gates" ]; then
			result latency "$name" skip 0 "INCONCLUSIVE: nothing recorded"
		elif [ "$plain" = 0 ] || [ "$environment" != "$recorded" ]; then
			result latency "$name" skip 0 "INCONCLUSIVE: recorded on $recorded, this is $environment$variant"
		else
			gate_case "$gates"
		fi
	done <$out/selected
}

gate_case() { # GATES: "METRIC RECORDED" a line
	exact=0 tries=1 note=
	[ "$key" != "$recorded_key" ] || exact=1
	judge "$1"
	while [ -n "$bad" ] && [ $exact = 1 ] && [ $tries -lt 4 ]; do
		tries=$((tries + 1)) note="at attempt $tries"
		once_more "$name" state-"$key" logs-again
		result_metrics logs-again "$name" >$out/metrics
		judge "$1"
	done
	if [ -z "$bad" ]; then
		result latency "$name" pass 0 "$note"
	else
		result latency "$name" fail 0 "$(echo "$bad" | tr '\n' ' ')"
	fi
}

judge() { # GATES: what is wrong with the numbers in $out/metrics goes to "bad"
	bad=$(echo "$1" | awk -v margin="$margin" -v exact=$exact -v now=$out/metrics '
		BEGIN { while ((getline line < now) > 0) { split(line, f, " "); value[f[1]] = f[2] } }
		!exact && $1 !~ /_p50_/ { next }
		!($1 in value) { print $1 " is not measured any more;"; next }
		exact && value[$1] != $2 { print $1 " is " value[$1] ", recorded on the same bytes: " $2 ";"; next }
		value[$1] > $2 * (1 + margin / 100) { print $1 " is " value[$1] ", at most " $2 " + " margin " %;" }')
}

# ---- what a person and a machine read ----

show() {
	while IFS=$tab read -r suite name word took reason; do
		printf '%-10s %-34s %-5s %6d ms  %s\n' "$suite" "$name" "$word" "$took" "$reason"
		case $word in
		skip) echo "SKIP $suite $name: $reason" ;;
		fail) [ "$suite" != kernel ] || tail -n 40 $out/logs/"$name"/out ;;
		esac
	done <$out/results
	# How far each class's simulation and peer can stand for the kernel: one table over all cases.
	cat $out/logs/*/out | grep '^fidelity ' | awk '!seen[$0]++' | tee $out/fidelity.txt
	cat $out/logs/*/out | grep '^fault ' | awk '!seen[$0]++'
}

junit() {
	awk -F'\t' -v logs=$out/logs '
	function text(s) { gsub(/&/, "\\&amp;", s); gsub(/</, "\\&lt;", s); gsub(/>/, "\\&gt;", s); gsub(/"/, "\\&quot;", s)
		gsub(/[^\t -~]/, "?", s); return s }
	{ n++; f += $3 == "fail"; k += $3 == "skip"; time += $4
	  body = body sprintf("  <testcase classname=\"%s\" name=\"%s\" time=\"%.3f\">\n", text($1), text($2), $4 / 1000)
	  if ($3 == "skip") body = body "    <skipped message=\"" text($5) "\"/>\n"
	  if ($3 == "fail") body = body "    <failure message=\"" text($5) "\"/>\n"
	  if ($1 == "kernel") {
		body = body "    <system-out>"
		file = logs "/" $2 "/out"
		while ((getline line < file) > 0) body = body text(line) "\n"
		close(file)
		body = body "</system-out>\n"
	  }
	  body = body "  </testcase>\n" }
	END { printf "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
	  printf "<testsuite name=\"check-kernel\" tests=\"%d\" failures=\"%d\" skipped=\"%d\" time=\"%.3f\">\n%s</testsuite>\n",
		n, f, k, time / 1000, body }' $out/results >$out/junit.xml
}

begun=$(date +%s)
# Sanitizers want memory.
[ -z "${SAN:-}" ] || export MEMORY="${MEMORY:-512}"
plain=1 variant=
case ${1:-build/gcc/} in build/gcc/*) ;; *) plain=0 variant=" (not the plain build)" ;; esac
[ "${LONG:-0}" != 1 ] || plain=0 variant=" (with LONG=1)"
prepare "$@"
select_cases
[ -s $out/selected ] || nothing "ONLY=\"${ONLY:-}\" names no case of cases.txt"
built=$(date +%s)
snapshots
booted=$(date +%s)
run_cases $out/selected state-"$key" logs
run_cases $out/again state-second logs-second
collect
compare
rm -f $out/state-second $out/state-second.clock
[ "${RECORD:-0}" != 1 ] || record
gate
show
junit
echo "packages and build $((built - begun)) s, boot $((booted - built)) s, cases $(($(date +%s) - booted)) s; $out/junit.xml"
awk -F'\t' '{ n[$3]++ } END { printf "%d passed, %d failed, %d skipped\n", n["pass"], n["fail"], n["skip"]; exit n["fail"] > 0 }' \
	$out/results
