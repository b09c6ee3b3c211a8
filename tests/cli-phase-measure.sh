#!/bin/sh
# Sensors in a simulated room, and what is found in what they record; crosstalk in runs at fidelity 2.
. tests/cli.sh.inc

exits() { # CODE COMMAND...
	want=$1
	shift
	"$@" >"$work/out" 2>&1
	code=$?
	[ "$code" = "$want" ] || { echo "exit $code, want $want"; tail -5 "$work/out"; return 1; }
}
says() { # CODE ERROR COMMAND...
	exits "$1" "$program" phase measure "$3" && grep -q "BB$2" "$work/out"
}
timed() { # CODE ERROR FILE
	exits "$1" timeout 20 "$program" phase measure "$3" && grep -q "BB$2" "$work/out"
}
close_to_plan() { # every phase within 60 us: the controllers' own errors
	"$program" phase measure "$1" --room "$2" --json >"$work/m.json"
	[ "$(field "$work/m.json" 'r["verdict"] == "PASS" and len(r["walls"]) == 2 and all(abs(c["value"]["value"]) < 60 for c in r["checks"] if "phase" in c["what"])')" = True ]
}

# The cabins with two of their walls.
cp -r rooms/profiles "$work"
python3 - "$work" <<'PY'
import re, sys
for name in "cabin", "cabin120":
    text = open(f"rooms/{name}.yaml").read()
    for wall in "right", "back", "floor":
        text = re.sub(rf"  - id: {wall} .*?(?=  - id: |\n\n)|  - id: {wall}\n.*?(?=  - id: |\n\n)", "", text, flags=re.S)
    text = text.replace("stages: [front, left, right, back, floor]", "stages: [front, left]")
    text = re.sub(r"\nmonitors:.*?(?=\n\n)|\npower:.*?(?=\n\n)|\ngamepads:.*?(?=\n\n)", "", text, flags=re.S)
    open(f"{sys.argv[1]}/{name}.yaml", "w").write(text)
planned = open(f"{sys.argv[1]}/cabin120.yaml").read()
open(f"{sys.argv[1]}/late.yaml", "w").write(re.sub(r"(emitter: .*?)offset_us: [0-9.]+", r"\1offset_us: 3000", planned))
PY
for room in cabin cabin120; do
	check "sense $room" exits 0 "$program" phase sense "$work/$room.yaml" --out "$work/$room.csv"
	check "measure $room: as planned" close_to_plan "$work/$room.csv" "$work/$room.yaml"
done
check "the same seed gives the same bytes" exits 0 sh -c "'$program' phase sense '$work/cabin120.yaml' --out '$work/again.csv' && cmp '$work/cabin120.csv' '$work/again.csv'"
check "edges for the plan" exits 0 "$program" phase measure "$work/cabin.csv" --room "$work/cabin.yaml" --edges "$work/edges.csv"
check "beside the plan" exits 0 "$program" phase "$work/cabin.yaml" --measured "$work/edges.csv" --png "$work/both.png"
check "two plots" exits 0 "$program" phase measure "$work/cabin120.csv" --png "$work/plot.png" --svg "$work/plot.svg"
check "... of both kinds" sh -c "grep -q '<svg' '$work/plot.svg' && head -c 4 '$work/plot.png' | grep -q PNG"
"$program" phase sense "$work/cabin120.yaml" --swapped --cycles 9 --out "$work/swapped.csv" >/dev/null
check "swapped glasses fail" exits 1 "$program" phase measure "$work/swapped.csv"
"$program" phase sense "$work/late.yaml" --configured --cycles 9 --out "$work/late.csv" >/dev/null
check "lenses that open 3 ms late have too much crosstalk" exits 1 "$program" phase measure "$work/late.csv" --room "$work/late.yaml" --configured
sed 's/max_percent: 2}/max_percent: 0.6}/' "$work/cabin120.yaml" >"$work/tight.yaml"
"$program" phase sense "$work/cabin120.yaml" --noise 30 --cycles 9 --out "$work/noisy.csv" >/dev/null
check "a limit within the uncertainty is undecided" exits 6 "$program" phase measure "$work/noisy.csv" --room "$work/tight.yaml"
"$program" phase sense "$work/cabin120.yaml" --png-frames "$work/frames" --lens left --cycles 9 >/dev/null
"$program" phase measure "$work/frames" --json >"$work/m.json"
check "a camera sees the same crosstalk" [ "$(field "$work/m.json" '0.1 < r["walls"][0]["bands"][0]["crosstalk_percent"]["value"] < 0.5')" = True ]
rm "$work/frames/000000.png"
check "a picture is missing" says 2 1641 "$work/frames"
head -c 100000 "$work/cabin120.csv" >"$work/cut.csv"
check "a cut file" says 2 1637 "$work/cut.csv"
check "no recording" says 2 1630 rooms/cabin.yaml
mkfifo "$work/pipe.csv" "$work/frames/000000.png"
check "a pipe that nobody fills is refused, not waited for" timed 2 1630 "$work/pipe.csv"
check "... nor one among the pictures" timed 2 1641 "$work/frames"
# Four cycles of a show are enough for a period and too few to say how sure a phase is.
awk -F, '/^# show: / { split($0, w, " "); if (w[4] < 0.6) printf "# show: %s %s %.9f\n", w[3], w[4], w[4] + 7 / 60; next }
	/^[0-9]/ && $1 > 0.8 { exit } { print }' "$work/cabin120.csv" >"$work/short.csv"
"$program" phase measure "$work/short.csv" --json >"$work/m.json"
check "JSON of a short recording has all that the table has" [ "$(field "$work/m.json" 'all(len(w["bands"]) == 6 and w["bands"][0]["crosstalk_percent"] is None and w["bands"][0]["white"]["on_us"]["sigma"] is None for w in r["walls"])')" = True ]
check "a room without shutters" exits 2 "$program" phase sense rooms/desk.yaml --out "$work/x.csv"

fidelity2() { # ROOM
	exits "$1" "$program" run "$2" "$scene" --duration 2 --fidelity displays=2 --fidelity shutters=2 --no-pictures --quiet --out "$work/run"
}
check "a run at fidelity 2 holds the crosstalk budget" fidelity2 0 "$work/cabin120.yaml"
check "as planned" [ "$(field "$work/run/result.json" '[0.2 < b["value"] < 0.35 for b in r["budgets"] if b["metric"] == "crosstalk"]')" = "[True]" ]
check "with lenses 3 ms late it does not" fidelity2 1 "$work/late.yaml"
check "at fidelity 1 it is not judged" exits 0 "$program" run "$work/cabin120.yaml" "$scene" --duration 1 --no-pictures --quiet --out "$work/run"
check "and says so" [ "$(field "$work/run/result.json" '[b["verdict"] for b in r["budgets"] if b["metric"] == "crosstalk"]')" = "['SKIP']" ]
finish
