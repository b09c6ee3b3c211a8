/*
 * drivers/modbus_pace.h: how long to wait. A time-out learned from what replies took (twice the 99.9th percentile of the
 * last thousand, within bounds), and a back-off between attempts to connect. ns. No clock, no threads.
 */
#ifndef BB_DRIVERS_MODBUS_PACE_H
#define BB_DRIVERS_MODBUS_PACE_H

#include "hal/base.h"

#define MODBUS_PACE_KEPT 1000
#define MODBUS_PACE_LEAST 20 /* samples before what was learned is believed; until then the longest wait */

struct modbus_pace {
	int64_t least_ns, most_ns;
	size_t n;                /* samples in all */
	int64_t took_ns[MODBUS_PACE_KEPT];
};
void modbus_pace_add(struct modbus_pace *p, int64_t took_ns);
int64_t modbus_pace_timeout_ns(const struct modbus_pace *p);

struct modbus_backoff { /* 100 ms, doubled each time up to 5 s, each +-20 % so that many do not knock at once */
	unsigned tries;
	uint64_t random;         /* any seed */
};
int64_t modbus_backoff_next_ns(struct modbus_backoff *b);

#endif
