# tests/guest/machine.sh: the machine; sourced by run.sh and case.sh, and hashed by build.sh, because any change of it
# shifts every number. Instructions are counted: 2 ns of guest time each, and waiting costs nothing. Never KVM: where CI
# runs it exists and yet cannot boot an unmodified kernel. One processor: a counted guest with two does not come up.

# QEMU's two threads share one core of the host and do not preempt each other: otherwise its main loop, awake at the wrong
# moment, takes a guest that just went idle for one whose last instructions are not counted yet, and sets the clock some
# microseconds wrong (2 of 8 runs of a case with some thousand sleeps; pinned, none of 16 on a quiet host, 2 of 8 on one
# with other work for both cores). Never as real-time threads: they spin for each other and take the host with them.
pinned() { # SLOT COMMAND...: on the core of that number among those we may use
	core=$(taskset -pc $$ 2>/dev/null | sed 's/.*: //' | awk -v slot="$1" '{
		n = split($0, part, ",")
		for (i = 1; i <= n; i++) { m = split(part[i], ends, "-"); for (c = ends[1]; c <= ends[m]; c++) core[k++] = c }
		if (k) print core[slot % k] }')
	shift
	if [ -n "$core" ] && chrt -b 0 true 2>/dev/null; then
		exec chrt -b 0 taskset -c "$core" "$@"
	fi
	exec "$@"
}

# To be called in build/guest/; CASE_FILE is what the guest reads as its case, SERIAL_FILE gets its console.
machine() { # SLOT MEMORY_MIB CASE_FILE SERIAL_FILE ARGUMENT...
	slot=$1 memory_mib=$2 case_file=$3 serial_file=$4
	shift 4
	pinned "$slot" qemu-system-x86_64 -accel tcg -smp 1 -m "$memory_mib" -nodefaults -no-user-config -display none -no-reboot \
		-kernel vmlinux -initrd guest.cpio -seed 1 -icount shift=1,align=off,sleep=off -rtc base=2026-01-01T00:00:00,clock=vm \
		-object can-bus,id=cb0 -device kvaser_pci,canbus=cb0 -device kvaser_pci,canbus=cb0 \
		-device pvpanic -action panic=pause -device isa-debug-exit,iobase=0xf4,iosize=0x04 \
		-fw_cfg name=opt/blackburst/case,file="$case_file" -serial file:"$serial_file" \
		-append "console=ttyS0,115200 quiet loglevel=1 panic=-1 oops=panic mitigations=off nokaslr tsc=reliable \
			no_timer_check randomize_kstack_offset=off" \
		"$@"
}
