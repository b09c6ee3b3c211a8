# blackburst: one Makefile, out-of-tree builds in build/.
#   make            the program, build/blackburst          make check      every test that needs no root and no network
#   make run        a whole room, from nothing to a report  make deps       Debian packages this needs
#   make t-NAME     one test binary, tests/test_NAME.c     make lint       clang-tidy and cppcheck
#   make install    program, man page, udev rules, systemd units (PREFIX=/usr/local, DESTDIR=)
#   make check-kernel   real drivers in a QEMU guest on Debian's kernel: ONLY=, LONG=1, DETERMINISM=1, see tests/guest/run.sh
# Variants: SAN=address,undefined  SAN=thread  CC=clang  (each has its own folder under build/)

CC      ?= gcc
ifeq ($(origin CC),default)
CC      := gcc
endif
comma   := ,
VARIANT := $(notdir $(firstword $(CC)))$(if $(SAN),-$(subst $(comma),-,$(SAN)))
B       := build/$(VARIANT)
PROGRAM := $(if $(filter gcc,$(VARIANT)),build/blackburst,$B/blackburst)

PKGS    := yaml-0.1 jansson libpng cairo zlib libcrypto libgpiod libusb-1.0 hidapi-hidraw libevdev libmodbus liblz4 libzstd libzmq lapacke
WARN    := -Wall -Wextra -Wconversion -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wdouble-promotion -Wvla
OPT     ?= -O2
CFLAGS  ?= -g
REVISION := $(shell git describe --always --dirty 2>/dev/null || echo unknown)
ALL_CFLAGS = -std=gnu11 $(OPT) $(WARN) $(WERROR) -I. -D_FORTIFY_SOURCE=2 -fstack-protector-strong -fno-math-errno \
             -ffp-contract=off $(if $(SAN),-fsanitize=$(SAN) -fno-sanitize-recover=all -fno-omit-frame-pointer -U_FORTIFY_SOURCE) \
             $(shell pkg-config --cflags $(PKGS) 2>/dev/null) $(CFLAGS)
LDLIBS   = $(shell pkg-config --libs $(PKGS) 2>/dev/null) -lm -lpthread -ldl

WINGS   := hal drivers sim sync render bench
SRC     := $(filter-out sim/kmod/%,$(wildcard $(WINGS:%=%/*.c) $(WINGS:%=%/*/*.c)))
LIB_SRC := $(filter-out bench/main.c,$(SRC))
HDR     := $(wildcard $(WINGS:%=%/*.h) $(WINGS:%=%/*/*.h))
TESTS   := $(patsubst tests/%.c,$B/tests/%,$(wildcard tests/test_*.c tests/contract_*.c))
FUZZ    := $(patsubst tests/fuzz/fuzz_%.c,%,$(wildcard tests/fuzz/fuzz_*.c))
DEEP    := $(patsubst tests/fuzz/deep_%.c,%,$(wildcard tests/fuzz/deep_*.c))
REPLAYS := $(FUZZ:%=$B/tests/replay_%) $(DEEP:%=$B/tests/replay_deep_%)
GUEST   := $(patsubst tests/%.c,$B/tests/%,$(filter-out tests/guest/align.c,$(wildcard tests/guest/*.c)))
GUEST   += $B/tests/hw_room
# Contract and fault suites that a case of the guest names run there, too.
GUEST   += $(foreach t,$(wildcard tests/contract_*.c tests/test_faults_*.c),$(if $(shell grep -w $(basename $(notdir $t)) tests/guest/cases.txt),$(t:tests/%.c=$B/tests/%)))
OBJ      = $(SRC:%.c=$B/%.o)

export LSAN_OPTIONS := suppressions=$(CURDIR)/tests/lsan.supp:print_suppressions=0

all: $(PROGRAM)

# The revision stands in two files only; they are rebuilt when it changes.
$B/bench/main.o $B/bench/outcome.o: ALL_CFLAGS += -DBB_REVISION='"$(REVISION)"'
$B/bench/main.o $B/bench/outcome.o: $B/revision
$B/revision: force
	@mkdir -p $(@D)
	@echo "$(REVISION)" | cmp -s - $@ || echo "$(REVISION)" >$@
force:

$(PROGRAM): $B/bench/main.o $B/libblackburst.a
	$(CC) $(ALL_CFLAGS) -o $@ $^ $(LDLIBS)

$B/libblackburst.a: $(LIB_SRC:%.c=$B/%.o)
	@rm -f $@
	@$(AR) qcs $@ $^

$B/%.o: %.c Makefile
	@mkdir -p $(@D)
	@echo "  cc $<"
	@$(CC) $(ALL_CFLAGS) -MMD -MP -c -o $@ $<

# Kernels that are chosen at run time; elsewhere than on x86-64 these files hold the portable one's name only.
ifeq ($(shell uname -m),x86_64)
$B/render/cpu/layer_kernel_avx2.o: ALL_CFLAGS += -mavx2 -mfma
$B/render/cpu/layer_kernel_avx512.o: ALL_CFLAGS += -mavx512f -mavx512dq -mavx512vl -mfma
$B/render/cpu/cast_avx2.o: ALL_CFLAGS += -mavx2 -mfma
$B/render/bricks/errors_avx2.o: ALL_CFLAGS += -mavx2
$B/render/bricks/errors_avx512.o: ALL_CFLAGS += -mavx512f -mavx512dq -mavx512vl
$B/sync/blobs/scan_avx2.o: ALL_CFLAGS += -mavx2
$B/sync/blobs/scan_avx512.o: ALL_CFLAGS += -mavx512bw
$B/render/cpu/cast_avx512.o: ALL_CFLAGS += -mavx512f -mavx512dq -mavx512vl -mfma
endif
# Their short loops must be unrolled, or vectors live in memory.
$B/render/cpu/cast_avx2.o $B/render/cpu/cast_avx512.o $B/render/cpu/cast_portable.o \
$B/render/bricks/errors_portable.o $B/render/bricks/errors_avx2.o $B/render/bricks/errors_avx512.o \
$B/render/bricks/stats.o $B/render/bricks/build_slab.o $B/render/bricks/build_write.o $B/sim/camera/picture.o: ALL_CFLAGS += -O3

# How vectors are passed to functions differs by these flags, says the compiler: none is, all such are inlined.
$B/render/bricks/errors_%.o: ALL_CFLAGS += -Wno-psabi

# What runs in the guest carries its libraries along: only those it uses.
$B/tests/%: $B/tests/%.o $B/libblackburst.a
	@$(CC) $(ALL_CFLAGS) -Wl,--as-needed -o $@ $^ $(LDLIBS) -lcmocka

# One test: make t-track builds and runs tests/test_track.c (or contract_track.c).
t-%:
	@$(MAKE) --no-print-directory $B/tests/$(notdir $(basename $(firstword $(wildcard tests/test_$*.c tests/contract_$*.c))))
	@$B/tests/$(notdir $(basename $(firstword $(wildcard tests/test_$*.c tests/contract_$*.c))))

# ---- what a newcomer runs ----

deps:
	@tests/deps.sh

# One unpacked file of a Debian package, never installed; without it the scene is the generated one.
data:
	@mkdir -p build
	@tests/fetch-data.sh

SCENE ?= $(if $(wildcard build/data/example4d.nii.gz),scenes/epi.yaml,scenes/cme.yaml)
run:
	@$(MAKE) --no-print-directory deps
	@$(MAKE) --no-print-directory data
	@$(MAKE) --no-print-directory -j$(shell nproc) all
	@$(MAKE) --no-print-directory run-room

run-room:
	build/blackburst run rooms/cabin.yaml $(SCENE) --seed 7

# ---- tests ----

SCRIPTS := tests/test-check-layers.sh tests/check-man.sh tests/fuzz/check-ledger.sh \
           tests/safety-coverage.sh tests/safety-mutants.py

check:
	@$(MAKE) --no-print-directory deps
	@$(MAKE) --no-print-directory data
	@$(MAKE) --no-print-directory -j$(shell nproc) all tests hdr-check layer-check
	@BB_PROGRAM=$(PROGRAM) BB_HW_ROOM=$B/tests/hw_room BB_REPLAY=$B/tests tests/run.sh $(TESTS) tests/fuzz/replay.sh $(wildcard tests/cli-*.sh) $(wildcard $(SCRIPTS))

tests: $(TESTS) $(REPLAYS) $(GUEST)

# Every fuzz target (tests/fuzz/fuzz_NAME.c) is an ordinary test over its seeds and corpus, and a fuzzer with `make fuzz`.
# Whole drivers (deep_NAME.c) are too slow for millions of inputs: tests, and fuzzed only when asked for by name.
$B/tests/replay_deep_%: $B/tests/fuzz/deep_%.o $B/tests/fuzz/replay.o $B/libblackburst.a
	@$(CC) $(ALL_CFLAGS) -o $@ $^ $(LDLIBS)
$B/tests/replay_%: $B/tests/fuzz/fuzz_%.o $B/tests/fuzz/replay.o $B/libblackburst.a
	@$(CC) $(ALL_CFLAGS) -o $@ $^ $(LDLIBS)

# Of the library only what parsers and simulated devices need; edges are counted in what is fuzzed only.
FUZZ_S ?= 20
FUZZ_SRC := $(filter hal/% drivers/% sim/% sync/optics/recorded.c sync/lock_proof.c sync/framelock/message.c \
            bench/phase/edges.c bench/track_record/reader.c sync/calibrate/sequence_line.c render/volume/% render/text.c render/half.c $(addprefix render/bricks/,bricks% format.c \
            tree.c stats.c values.c crc32c.c),$(SRC))
FUZZED   := $(filter %.c,$(shell sed 's/#.*//' tests/fuzz/targets.txt)) $(wildcard drivers/shutter_can*.c drivers/ddc_*.c) \
            drivers/monitor_ddc.c sim/peer_shutter.c
fuzz: fuzz-build
	@tests/fuzz/run.sh $(FUZZ_S) $(ONLY)
fuzz-build:
	@$(MAKE) --no-print-directory -j$(shell nproc) CC=clang SAN=address,undefined OPT=-O2 CFLAGS='-g1 -DBB_FUZZ' B=build/fuzz fuzz-programs
fuzz-programs: $(FUZZ:%=$B/fuzz_%) $(DEEP:%=$B/fuzz_deep_%)
ifeq ($B,build/fuzz)
$(FUZZED:%.c=$B/%.o): ALL_CFLAGS += -fsanitize=fuzzer-no-link
endif
$B/libfuzz.a: $(FUZZ_SRC:%.c=$B/%.o)
	@rm -f $@
	@$(AR) qcs $@ $^
$B/fuzz_deep_%: $B/tests/fuzz/deep_%.o $B/libfuzz.a
	@$(CC) $(ALL_CFLAGS) -fsanitize=fuzzer -Wl,--as-needed -o $@ $^ $(LDLIBS)
$B/fuzz_%: $B/tests/fuzz/fuzz_%.o $B/libfuzz.a
	@$(CC) $(ALL_CFLAGS) -fsanitize=fuzzer -Wl,--as-needed -o $@ $^ $(LDLIBS)

# The contracts against the devices of a room: make check-hw ROOM=my-room.yaml [SWITCH="pdu1/3 pdu2/1"]
ROOM ?= rooms/standin.yaml
check-hw: $B/tests/hw_room
	@BB_HW_ROOM=$< tests/check-hw.sh $(ROOM) $(SWITCH:%=--switch %) $(if $(STANDIN),--standin)

# What runs threads: casters, the brick reader, the brick builder. (make SAN=thread check-threads)
THREADED := $(patsubst %,$B/tests/test_%,reference stream bricks bricks_read bricks_output cpu)
check-threads: $(THREADED)
	@tests/run.sh $(THREADED)

# Ends with "0 passed, 0 failed, 1 skipped" and the reason where it cannot run.
check-kernel:
	@$(MAKE) --no-print-directory deps
	@$(MAKE) --no-print-directory -j$(shell nproc) guest-programs
	@tests/guest/run.sh $(GUEST)

guest-programs: $(GUEST)


# Every header compiles on its own.
hdr-check: $(HDR:%.h=$B/%.hco)
$B/%.hco: %.h
	@mkdir -p $(@D)
	@$(CC) $(ALL_CFLAGS) -fsyntax-only -include $< -x c /dev/null && touch $@

layer-check:
	@tests/check-layers.sh

lint:
	@tests/lint.sh

bench: all
	build/blackburst bench --out build/bench.json
	@$(MAKE) --no-print-directory bench-volume bench-gl

# Minutes, and GIB x 3.2 of disk (GIB=0: without the large one); no room on the disk is said and is no failure.
GIB ?= 16
bench-volume: all
	BB_PROGRAM=$(PROGRAM) tests/scale-volume.sh build $(GIB) || [ $$? = 77 ]

# One virtual hour of the 416-monitor room, twice: CPU seconds (at most 60), memory, the hash of its event log.
bench-hour: all
	BB_PROGRAM=$(PROGRAM) tests/hour.sh
# The phase plan against every delay and opening of 1 us: half a minute.
bench-plan:
	@$(MAKE) --no-print-directory B=build/plan-1us CFLAGS='-g -DBRUTE_STRIDE=1' build/plan-1us/tests/test_plan
	@build/plan-1us/tests/test_plan

# 3000 exposures of the cabin's eight cameras as pictures, and the poses from them: ten seconds. ARGS="2 marker_mm=16"
bench-eyes: $B/tests/test_camera_walk all
	@$< 3000 $(ARGS)
	$(PROGRAM) bench blobs

# The GLSL caster beside a plain one on the same driver (minutes, and only worth reading on idle cores).
bench-gl: $B/tests/bench_gl
	@$< || [ $$? = 77 ]

# Ten thousand campaigns of random faults, and no flashes (a minute and a half of a processor).
soak: $B/tests/test_campaigns
	$< 10000

# The native ray caster against VTK's and against this machine's gathers: ARGS="--json --rounds 9 --only sparse"
bench-cast: $B/tests/bench/cast
	@$< $(ARGS)

# 24 cameras from a dance of 90 s with a tenth of all markers wrong and one camera knocked: numbers, and how long it takes.
bench-calibrate: all
	$(PROGRAM) track calibrate rooms/deck.yaml --simulate --outliers 10 --knock c07 $(ARGS)

# Ten minutes of 120 Hz in four processes: how late they wake beside a bare sleep (S=5 for a look; LINK=zmq).
S ?= 600
bench-posix: all
	@BB_PROGRAM=$(PROGRAM) LINK=$(or $(LINK),shm) tests/bench/posix.sh $S

# The tracker over 10^5 frames of a walk, what its solver costs, what prediction buys (half a minute).
bench-track: all
	$(PROGRAM) bench track --walk --frames 100000
	$(PROGRAM) bench track --scaling
	$(PROGRAM) trade --table prediction

# Ways to flip together: simulated, and real processes beside MPI_Barrier where OpenMPI is (quiet cores, or noise).
bench-barrier: all
	@$(MAKE) --no-print-directory $B/tests/bench/mpi_barrier || true
	$(PROGRAM) bench barrier --mpi $B/tests/bench/mpi_barrier $(ARGS)
$B/tests/bench/mpi_barrier: tests/bench/mpi_barrier.c
	@command -v mpicc >/dev/null || { echo "SKIP: no mpicc here, so no MPI_Barrier (libopenmpi-dev openmpi-bin)"; exit 1; }
	@mkdir -p $(@D)
	@mpicc -O2 -o $@ $<

format:
	clang-format -i $(SRC) $(HDR) $(wildcard tests/*.[ch])

# Programs, rooms, man page; udev rules that let the group "blackburst" use the devices; systemd units that run as nobody.
PREFIX  ?= /usr/local
UDEVDIR ?= /etc/udev/rules.d
UNITDIR ?= /etc/systemd/system
SYSUSERS ?= /etc/sysusers.d
install: all
	install -Dm755 $(PROGRAM) $(DESTDIR)$(PREFIX)/bin/blackburst
	install -Dm644 docs/blackburst.1 $(DESTDIR)$(PREFIX)/share/man/man1/blackburst.1
	install -Dm644 docs/shutter.eds $(DESTDIR)$(PREFIX)/share/blackburst/shutter.eds
	install -Dm644 -t $(DESTDIR)$(PREFIX)/share/blackburst/rooms rooms/*.yaml
	install -Dm644 -t $(DESTDIR)$(PREFIX)/share/blackburst/rooms/profiles rooms/profiles/*.yaml
	install -Dm644 -t $(DESTDIR)$(PREFIX)/share/blackburst/scenes scenes/*.*
	install -Dm644 drivers/70-blackburst.rules $(DESTDIR)$(UDEVDIR)/70-blackburst.rules
	install -Dm644 drivers/blackburst.sysusers $(DESTDIR)$(SYSUSERS)/blackburst.conf
	for unit in bench/systemd/*.service; do \
		install -d $(DESTDIR)$(UNITDIR) && \
		sed 's,@PREFIX@,$(PREFIX),' $$unit >$(DESTDIR)$(UNITDIR)/$${unit##*/} || exit 1; done
	[ -n "$(DESTDIR)" ] || { systemd-sysusers && udevadm control --reload && udevadm trigger; } || true
uninstall:
	rm -rf $(DESTDIR)$(PREFIX)/bin/blackburst $(DESTDIR)$(PREFIX)/share/man/man1/blackburst.1 \
		$(DESTDIR)$(PREFIX)/share/blackburst $(DESTDIR)$(UDEVDIR)/70-blackburst.rules \
		$(DESTDIR)$(SYSUSERS)/blackburst.conf $(DESTDIR)$(UNITDIR)/blackburst-run@.service \
		$(DESTDIR)$(UNITDIR)/blackburst-serve@.service

clean:
	rm -rf build

help:
	@sed -n '2,8p' Makefile | cut -c3-

.PHONY: all deps data run run-room check check-threads check-hw check-kernel guest-programs tests hdr-check layer-check lint \
        bench bench-volume bench-hour bench-gl bench-cast bench-barrier bench-track bench-posix bench-plan bench-calibrate bench-eyes soak fuzz fuzz-build fuzz-programs install uninstall format clean help
.SECONDARY:
-include $(SRC:%.c=$B/%.d) $(TESTS:=.d) $(GUEST:=.d) $B/tests/bench/cast.d
