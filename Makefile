# blackburst: one Makefile, out-of-tree builds in build/.
#   make            the program, build/blackburst          make check      every test that needs no root and no network
#   make run        a whole room, from nothing to a report  make deps       Debian packages this needs
#   make t-NAME     one test binary, tests/test_NAME.c     make lint       clang-tidy and cppcheck
# Variants: SAN=address,undefined  SAN=thread  CC=clang  (each has its own folder under build/)

CC      ?= gcc
ifeq ($(origin CC),default)
CC      := gcc
endif
comma   := ,
VARIANT := $(notdir $(firstword $(CC)))$(if $(SAN),-$(subst $(comma),-,$(SAN)))
B       := build/$(VARIANT)
PROGRAM := $(if $(SAN),$B/blackburst,build/blackburst)

PKGS    := yaml-0.1 jansson libpng cairo zlib libcrypto
WARN    := -Wall -Wextra -Wconversion -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wdouble-promotion -Wvla
OPT     ?= -O2
CFLAGS  ?= -g
ALL_CFLAGS = -std=gnu11 $(OPT) $(WARN) $(WERROR) -I. -D_FORTIFY_SOURCE=2 -fstack-protector-strong -fno-math-errno \
             -ffp-contract=off $(if $(SAN),-fsanitize=$(SAN) -fno-sanitize-recover=all -fno-omit-frame-pointer -U_FORTIFY_SOURCE) \
             $(shell pkg-config --cflags $(PKGS) 2>/dev/null) $(CFLAGS)
LDLIBS   = $(shell pkg-config --libs $(PKGS) 2>/dev/null) -lm -lpthread -ldl

WINGS   := hal drivers sim sync render bench
SRC     := $(wildcard $(WINGS:%=%/*.c) $(WINGS:%=%/*/*.c))
LIB_SRC := $(filter-out bench/main.c,$(SRC))
HDR     := $(wildcard $(WINGS:%=%/*.h) $(WINGS:%=%/*/*.h))
TESTS   := $(patsubst tests/%.c,$B/tests/%,$(wildcard tests/test_*.c tests/contract_*.c))
OBJ      = $(SRC:%.c=$B/%.o)

export LSAN_OPTIONS := suppressions=$(CURDIR)/tests/lsan.supp:print_suppressions=0

all: $(PROGRAM)

$(PROGRAM): $B/bench/main.o $B/libblackburst.a
	$(CC) $(ALL_CFLAGS) -o $@ $^ $(LDLIBS)

$B/libblackburst.a: $(LIB_SRC:%.c=$B/%.o)
	@rm -f $@
	@$(AR) rcs $@ $^

$B/%.o: %.c Makefile
	@mkdir -p $(@D)
	@echo "  cc $<"
	@$(CC) $(ALL_CFLAGS) -MMD -MP -c -o $@ $<

$B/tests/%: $B/tests/%.o $B/libblackburst.a
	@$(CC) $(ALL_CFLAGS) -o $@ $^ $(LDLIBS) -lcmocka

# One test: make t-track builds and runs tests/test_track.c (or contract_track.c).
t-%:
	@$(MAKE) --no-print-directory $B/tests/$(notdir $(basename $(firstword $(wildcard tests/test_$*.c tests/contract_$*.c))))
	@$B/tests/$(notdir $(basename $(firstword $(wildcard tests/test_$*.c tests/contract_$*.c))))

.PHONY: all
.SECONDARY:
-include $(SRC:%.c=$B/%.d) $(TESTS:=.d)
