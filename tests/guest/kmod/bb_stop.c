// SPDX-License-Identifier: MIT OR GPL-2.0
/*
 * tests/guest/kmod/bb_stop.c: stops the machine by a write to pvpanic, so that it can be saved; loading it does that, once.
 * While QEMU's main loop stops a machine whose clock counts instructions, it may let the clock run on to the next timer,
 * or may not; this is a race between two threads of the host. So there must be no next timer: interrupts are off for
 * longer than a tick, the processor's timer has fired and nobody has set it again; init has seen to the clock chip's.
 */
#include <linux/delay.h>
#include <linux/io.h>
#include <linux/irqflags.h>
#include <linux/module.h>

#define PVPANIC_PORT 0x505
#define PVPANIC_PANICKED 1
#define LONGER_THAN_TICK_MS 10

static int __init bb_stop_init(void)
{
	unsigned long flags;

	local_irq_save(flags);
	mdelay(LONGER_THAN_TICK_MS);
	outb(PVPANIC_PANICKED, PVPANIC_PORT);
	local_irq_restore(flags);
	return 0;
}
module_init(bb_stop_init);

MODULE_DESCRIPTION("stops a QEMU guest where it can be saved");
MODULE_LICENSE("Dual MIT/GPL");
