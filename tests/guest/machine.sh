# tests/guest/machine.sh: the machine; sourced by run.sh and case.sh, and hashed by build.sh, because any change of it
# shifts every number. Instructions are counted: 2 ns of guest time each, and waiting costs nothing. Never KVM: where CI
# runs it exists and yet cannot boot an unmodified kernel. One processor: a counted guest with two does not come up.

# To be called in build/guest/; CASE_FILE is what the guest reads as its case, SERIAL_FILE gets its console.
machine() { # MEMORY_MIB CASE_FILE SERIAL_FILE ARGUMENT...
	memory_mib=$1 case_file=$2 serial_file=$3
	shift 3
	exec qemu-system-x86_64 -accel tcg -smp 1 -m "$memory_mib" -nodefaults -no-user-config -display none -no-reboot \
		-kernel vmlinux -initrd guest.cpio -seed 1 -icount shift=1,align=off,sleep=off -rtc base=2026-01-01T00:00:00,clock=vm \
		-object can-bus,id=cb0 -device kvaser_pci,canbus=cb0 -device kvaser_pci,canbus=cb0 \
		-device pvpanic -action panic=pause -device isa-debug-exit,iobase=0xf4,iosize=0x04 \
		-fw_cfg name=opt/blackburst/case,file="$case_file" -serial file:"$serial_file" \
		-append "console=ttyS0,115200 quiet loglevel=1 panic=-1 oops=panic mitigations=off nokaslr tsc=reliable \
			no_timer_check randomize_kstack_offset=off" \
		"$@"
}
