#!/bin/sh
# tests/check-man.sh: docs/blackburst.1 is well-formed mdoc, and names exactly the options that the commands have.
# Exit 0: so it is; 1: not; 77: mandoc is not installed (the options were compared all the same).
set -u
cd "$(dirname "$0")/.." || exit 2
page=docs/blackburst.1
status=0

# A row of an option table: name, shape of the value or NULL, help.
have=$(sed -nE 's/^.*\{ "([a-z][a-z0-9-]*)", (NULL|"[^"]*"), "([^"\\]|\\.)*" \}.*$/\1/p' bench/cmd/*.c bench/cli.c 2>/dev/null |
	sed '/^help$/d' | LC_ALL=C sort -u)
told=$(grep -oE 'Fl -[a-z][a-z0-9-]*' "$page" | sed 's/^Fl -//' | sed -E '/^(help|name)$/d' | LC_ALL=C sort -u)
for o in $have; do
	echo "$told" | grep -qx -e "$o" || { echo "$page: --$o is missing"; status=1; }
done
if [ -e bench/cmd/run.c ]; then # before that half of the commands are not there yet
	for o in $told; do
		echo "$have" | grep -qx -e "$o" || { echo "$page: no command has --$o"; status=1; }
	done
fi

if ! command -v mandoc >/dev/null 2>&1; then
	[ $status = 0 ] && status=77
	echo "check-man: mandoc is not installed (package mandoc)"
else
	mandoc -Tlint -Wstyle "$page" || status=1
fi
[ $status = 0 ] && echo "check-man: $page is in order"
exit $status
