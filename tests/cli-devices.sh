#!/bin/sh
# `blackburst devices`: a simulated room is complete, a room with wires says what is missing and ends with 4, a room that
# is none with 2; and `run --gl cpu` draws without any OpenGL.
. tests/cli.sh.inc

ends_with() { # CODE ARGUMENTS...
	want=$1
	shift
	"$program" "$@" >"$work/out" 2>"$work/err"
	[ $? = "$want" ]
}

{ sh tests/guest/case_desk.sh && cat; } >"$work/wired.yaml" <<'END'
monitors:
  - {id: m1, device: "i2c:/dev/i2c-4711", edid: S27A850D}
gamepads:
  - {id: pad, model: rumblepad2, device: "hid:046d:c219?serial=nobody"}
END

check "what is attached" ends_with 0 devices
check "all of it" ends_with 0 devices --all --json
check "is JSON" sh -c "[ \"$(field "$work/out" 'sorted(r)')\" = \"['attached', 'backends', 'devices']\" ]"
check "a simulated room lacks nothing" ends_with 0 devices rooms/cabin.yaml
check "a wired one does" ends_with 4 devices "$work/wired.yaml" --json
check "both, and each with a why and a remedy" [ \
	"$(field "$work/out" 'sum(1 for d in r["devices"] if d["state"] == "missing" and d["why"] and d["remedy"])')" = 2 ]
check "no room is wrong usage" ends_with 2 devices Makefile
check "a picture without OpenGL" ends_with 0 run rooms/desk.yaml scenes/desk.yaml --duration 1 --gl cpu --out "$work/cpu" --json
check "by native code" sh -c "grep -q 'cpu, ' '$work/out'"
check "another kind is refused" ends_with 2 run rooms/desk.yaml scenes/desk.yaml --gl voodoo --out "$work/none"
finish
