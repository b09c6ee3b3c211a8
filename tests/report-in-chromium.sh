#!/bin/sh
# The report of a run, opened in headless Chromium: every section is there, the console stays silent, and the page asks
# the network for nothing. A page that does both is opened first, to see that this test can fail.
program=${BB_PROGRAM:-build/blackburst}
command -v chromium >/dev/null 2>&1 || { echo "SKIP: chromium is not installed"; exit 77; }
command -v python3 >/dev/null 2>&1 || { echo "SKIP: python3 is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failures=0

visit() { # PAGE: console lines to console.txt, requested addresses to requests.txt, the tree to dom.html
	timeout 120 chromium --headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking \
		--disable-component-update --disable-sync --disable-quic --disable-extensions --disable-default-apps \
		--user-data-dir="$work/profile" --enable-logging=stderr --v=0 --log-net-log="$work/net.json" \
		--virtual-time-budget=4000 --dump-dom "file://$1" >"$work/dom.html" 2>"$work/log"
	grep 'CONSOLE' "$work/log" >"$work/console.txt"
	# The page's own requests; the browser's (update pings and the like) have no initiator of ours.
	grep -o '"url":"[a-z]*://[^"]*"' "$work/net.json" | cut -d'"' -f4 | sort -u |
		grep -vE '^(file|data|chrome|devtools)' | grep -F 'blackburst-test' >"$work/requests.txt"
	python3 - "$work/net.json" "$1" >>"$work/requests.txt" <<'PY'
import json, sys
text = open(sys.argv[1]).read().rstrip().rstrip(',')
for end in ('', ']}', '}]}'):
    try:
        log = json.loads(text + end)
        break
    except ValueError:
        log = {'events': []}
for event in log['events']:
    p = event.get('params') or {}
    if str(p.get('initiator', '')).startswith(('file', 'null')) and not str(p.get('url', '')).startswith(('file:', 'data:')):
        print(p.get('url'))
PY
}
check() {
	name=$1
	shift
	"$@" && echo "ok: $name" || { echo "FAILED: $name"; failures=1; }
}

echo '<html><body><img src="http://127.0.0.1:9/blackburst-test.png"><script>console.error("planted")</script></body></html>' >"$work/bad.html"
visit "$work/bad.html"
check "a planted console error is seen" [ -s "$work/console.txt" ]
check "a planted request is seen" [ -s "$work/requests.txt" ]

"$program" run rooms/desk.yaml scenes/desk.yaml --quiet --out "$work/r" >/dev/null 2>&1
visit "$work/r/report.html"
check "the console stays silent" [ ! -s "$work/console.txt" ]
check "no request" [ ! -s "$work/requests.txt" ]
for section in verdicts trouble latency time streaming room pictures devices counters configuration versions; do
	check "section $section" grep -q "id=\"$section\"" "$work/dom.html"
done
check "pictures are embedded" grep -q 'src="data:image/png;base64' "$work/dom.html"
[ -s "$work/console.txt" ] && head -5 "$work/console.txt"
[ -s "$work/requests.txt" ] && head -5 "$work/requests.txt"
[ "$failures" = 0 ]
