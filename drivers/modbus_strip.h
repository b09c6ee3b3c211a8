/*
 * drivers/modbus_strip.h: what there is to do on the link to one strip, as a state machine: connect, check who answers,
 * write what was asked, read it back, poll, notice what is wrong. Each step does at most a handful of exchanges, blocks
 * for them, and says when it wants to run again; it belongs to one thread. Times are ns of the posix clock.
 */
#ifndef BB_DRIVERS_MODBUS_STRIP_H
#define BB_DRIVERS_MODBUS_STRIP_H

#include "drivers/modbus_map.h"
#include "drivers/modbus_pace.h"
#include "drivers/power_modbus.h"

struct modbus_strip_outlet {
	struct bb_outlet_state state; /* as last read; commanded: the strip's register */
	bool asked, want;        /* a command came from above: what was wanted last */
	bool pending;            /* to be written */
	bool verifying;          /* written, not seen yet */
	bool mismatch;           /* the contact is not where it was told to be, and there was time enough */
	int64_t due_ns, give_up_ns, verify_end_ns;
};

struct modbus_strip {
	const struct bb_power_config *config;
	const struct modbus_map *map;
	struct bus_modbus *bus;
	struct bb_clock *clk;
	struct modbus_pace pace;
	struct modbus_backoff backoff;
	struct modbus_strip_outlet outlet[BB_OUTLETS_MAX]; /* index counts config->outlet */
	struct power_modbus_report report;
	bool identified, no_meter;
	int64_t next_try_ns, next_poll_ns, last_heard_ns, stagger_until_ns;
	unsigned good_in_a_row;
	size_t n_spoiled;
	int64_t spoiled_ns[POWER_MODBUS_SPOILED_MOST];
};

void modbus_strip_init(struct modbus_strip *s, const struct bb_power_config *config, const struct modbus_map *map,
                       struct bus_modbus *bus, struct bb_clock *clk, uint64_t seed);
/* Does what is due; returns when it wants to run again. */
int64_t modbus_strip_step(struct modbus_strip *s);
void modbus_strip_ask(struct modbus_strip *s, size_t index, bool on, int64_t asked_ns);

#endif
