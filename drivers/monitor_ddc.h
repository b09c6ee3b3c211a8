/*
 * drivers/monitor_ddc.h: a monitor's EDID and DDC/CI controls over an I2C bus ("i2c:/dev/i2c-4", or
 * "i2c:?serial=SIM0001234" for the bus on which an EDID has that serial, wherever it is plugged in). One state machine a
 * bus on the clock's timers: requests of a few bytes, and between them the waits of the standard, so that one event
 * loop serves every bus of a node. It never waits for one: what blocks in the kernel does so in a thread of the bus's.
 * One thread, the clock's; ns.
 *
 * A write is read back before it counts as done. A display that does not answer in time gets longer waits; Null
 * replies are told apart (busy, asleep, "I do not have that") by asking for a code no flat panel has. Faults are
 * named (drivers/ddc_health.h) in the device's last_error and in the report; while one lasts the idle machine asks on
 * its own until the display is well again. Nothing is ever saved in the display.
 */
#ifndef BB_DRIVERS_MONITOR_DDC_H
#define BB_DRIVERS_MONITOR_DDC_H

#include "drivers/ddc_health.h"
#include "hal/bus.h"
#include "hal/monitor_driver.h"

extern const struct bb_monitor_driver monitor_ddc_driver;

/* On a bus that is there already. The bus is the monitor's from now on, also when this fails. */
BB_MUST_CHECK enum bb_status monitor_ddc_open_on(struct bb_i2c_bus *bus, const struct bb_monitor_config *config,
						 const struct bb_open *open, struct bb_monitor **out);

enum ddc_null { DDC_NULL_UNKNOWN, DDC_NULL_BUSY, DDC_NULL_UNSUPPORTED };
#define MONITOR_DDC_MOST_TRIES 10

struct monitor_ddc_report {
	struct ddc_health health;
	struct ddc_gap gap;
	enum ddc_null null_means;
	bool doubled_source;                        /* sends its address byte twice */
	uint64_t requests;                          /* of the user, finished */
	uint64_t tries[MONITOR_DDC_MOST_TRIES + 1]; /* [n]: requests that took n */
	uint64_t transfers;
	size_t good_edid_bytes; /* the last EDID without damage, kept over bad ones */
	uint8_t good_edid[BB_EDID_MAX_BYTES];
};
/* Borrowed, as of now. */
const struct monitor_ddc_report *monitor_ddc_report(struct bb_monitor *m);
/* Lifts a quarantine by hand: the bus is asked again. */
void monitor_ddc_release(struct bb_monitor *m);

#endif
