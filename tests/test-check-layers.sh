#!/bin/sh
# tests/test-check-layers.sh: plants each kind of break in a copy of the sources and expects tests/check-layers.sh to
# name its file, line and rule; plants look-alikes and expects silence. Exit 0: all as expected.
set -u
cd "$(dirname "$0")/.." || exit 2
copy=$(mktemp -d) || exit 2
trap 'rm -rf "$copy"' EXIT
trap 'exit 1' HUP INT TERM
n=0 failed=0

for d in hal drivers sim sync render bench; do
	mkdir -p "$copy/$d"
	(find "$d" -type f \( -name '*.[ch]' -o -name '*.def' \) 2>/dev/null) | while read -r f; do
		mkdir -p "$copy/$(dirname "$f")"
		cp "$f" "$copy/$f"
	done
done
mkdir -p "$copy/tests"
cp tests/layers.txt tests/check-layers.sh "$copy/tests/"

check() { sh "$copy/tests/check-layers.sh" "$copy" >"$copy/out" 2>&1; }
complain() { failed=$((failed + 1)); echo "FAIL: $1"; sed 's/^/	/' "$copy/out"; }

# found NAME FILE LINE RULE TEXT: with TEXT as a file, exactly that place and rule is reported.
found() {
	n=$((n + 1))
	mkdir -p "$copy/$(dirname "$2")"
	[ -e "$copy/$2" ] && { echo "FAIL: $1: $2 exists"; failed=$((failed + 1)); return; }
	printf '%b' "$5" >"$copy/$2"
	check; status=$?
	[ $status = 1 ] && grep -q "^$2:$3: $4: " "$copy/out" && grep -q '^check-layers: 1 breaks' "$copy/out" ||
		complain "$1 (exit $status, want 1 and one line $2:$3: $4)"
	rm "$copy/$2"
}

# silent NAME FILE TEXT: nothing is reported.
silent() {
	n=$((n + 1))
	mkdir -p "$copy/$(dirname "$2")"
	printf '%b' "$3" >"$copy/$2"
	check; status=$?
	[ $status = 0 ] || complain "$1 (exit $status, want 0)"
	rm "$copy/$2"
}

n=$((n + 1))
check || { complain "the sources themselves are not clean"; exit 1; }

found "hal sees sim"              hal/zz.c       2 layer  '\n#include "sim/world.h"\n'
found "hal sees bench"            hal/zz.h       1 layer  '#include "bench/cli.h"\n'
found "drivers see sim"           drivers/zz.c   1 layer  '#include "sim/world.h"\n'
found "sim sees a driver"         sim/zz.c       3 layer  '\n\n#include "drivers/edid.h"\n'
found "sim sees bench"            sim/zz.c       1 layer  '#include "bench/cli.h"\n'
found "sync sees render"          sync/track/zz.c 1 layer '#include "render/view.h"\n'
found "sync sees sim"             sync/zz.c      1 layer  '#include "sim/sim.h"\n'
found "render sees sim"           render/gl/zz.c 1 layer  '#include "sim/sim.h"\n'
found "render sees drivers"       render/zz.c    1 layer  '#include "drivers/edid.h"\n'
found "render sees the tracker"   render/zz.c    1 layer  '#include "sync/track/tracker.h"\n'
found "by angle brackets"         hal/zz.c       1 layer  '#include <sim/world.h>\n'
found "with blanks"               hal/zz.c       1 layer  ' \t# \t include\t"sim/world.h"\n'
found "over a broken line"        hal/zz.c       2 layer  '\n#include \\\n"sim/world.h"\n'
found "behind a comment"          hal/zz.c       1 layer  '/* x */ #include "sim/world.h"\n'
found "behind a long comment"     hal/zz.c       2 layer  '/* x\n*/ #include "sim/world.h"\n'
found "in a .def"                 hal/zz.def     1 layer  '#include "sim/world.h"\n'
found "sideways"                  sim/zz.c       1 path   '#include "world.h"\n'
found "upwards"                   sim/zz.c       1 path   '#include "../hal/room.h"\n'
found "round the back"            sim/zz.c       1 path   '#include "hal/../drivers/edid.h"\n'
found "by macro"                  sim/zz.c       2 path   '#define H "drivers/edid.h"\n#include H\n'
found "bench fills in a driver"   bench/zz.c     1 driver-header '#include "hal/camera_driver.h"\n'
found "hal outside its class"     hal/zz.c       1 driver-header '#include "hal/camera_driver.h"\n'
found "vendor outside drivers"    bench/zz.c     1 vendor '#include <gpiod.h>\n'
found "vendor in sim"             sim/zz.c       1 vendor '#include <modbus/modbus.h>\n'
found "kernel header in hal"      hal/zz.c       1 vendor '#include <linux/i2c-dev.h>\n'
found "openssl in bench"          bench/zz.c     1 vendor '#include <openssl/evp.h>\n'
found "clock_gettime"             sim/zz.c       2 word   'void f(void)\n{ clock_gettime(0, 0); }\n'
found "its address"               sim/zz.c       1 word   'void *f = (void *)clock_gettime;\n'
found "nanosleep"                 render/zz.c    1 word   'int a = nanosleep(0, 0);\n'
found "usleep"                    bench/zz.c     1 word   'int a = usleep(1);\n'
found "time("                     bench/zz.c     1 word   'long a = time (NULL);\n'
found "time( after runtime("      bench/zz.c     1 word   'long a = runtime(1) + time(NULL);\n'
found "in another hal file"       hal/zz.c       1 word   'long a = time(NULL);\n'
found "rand"                      sim/zz.c       1 word   'int a = rand();\n'
found "getenv"                    bench/zz.c     1 word   'char *a = getenv("HOME");\n'

silent "sim sees wire constants"  sim/zz.c       '#include "drivers/ddc_wire.h"\n'
silent "bench sees all"           bench/zz.c     '#include "sim/sim.h"\n#include "drivers/edid.h"\n#include "render/view.h"\n'
silent "render sees time maps"    render/zz.c    '#include "sync/timemap.h"\n'
silent "a driver fills one in"    drivers/zz.c   '#include "hal/camera_driver.h"\n#include "drivers/edid.h"\n'
silent "comments"                 hal/zz.c       '/* a\n#include "sim/world.h"\nclock_gettime(0) */ // time(0)\n'
silent "strings"                  hal/zz.c       'char *a = "time(x) \\"rand() /* ", b = '"'\"'"'; // "\n'
silent "longer names"             hal/zz.c       'int my_time(int), timer(int); int a = bb_clock_gettimeofday_;\n'
silent "a member called time"     hal/zz.c       'struct a { int time; }; int clock;\n'
silent "standard headers"         hal/zz.c       '#include <time.h>\n#include <sys/types.h>\n'

# Two files with one vendor's header: only the second is one too many.
n=$((n + 1))
mkdir -p "$copy/drivers"
echo '#include <zmq.h>' >"$copy/drivers/link_zmq.c"
printf '\n#include <zmq.h>\n' >"$copy/drivers/zz.c"
check; status=$?
[ $status = 1 ] && grep -q '^drivers/zz.c:2: vendor: .*drivers/link_zmq.c' "$copy/out" ||
	complain "one vendor header in two files (exit $status)"
rm "$copy/drivers/link_zmq.c" "$copy/drivers/zz.c"

# A check that checks nothing must not pass.
for damage in 'rm tests/layers.txt' 'echo nonsense >>tests/layers.txt' ': >tests/layers.txt'; do
	n=$((n + 1))
	cp tests/layers.txt "$copy/tests/"
	(cd "$copy" && eval "$damage")
	check; status=$?
	[ $status = 2 ] || complain "after '$damage' (exit $status, want 2)"
done
n=$((n + 1))
mkdir "$copy/empty"
sh tests/check-layers.sh "$copy/empty" >"$copy/out" 2>&1; status=$?
[ $status = 2 ] || complain "an empty folder (exit $status, want 2)"

echo "test-check-layers: $n cases, $failed failed"
[ $failed = 0 ]
