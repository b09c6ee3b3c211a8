/*
 * hal/dev_time.h: a stamp from a device clock has its own type and needs a map before it is host time.
 *
 * The map is estimated from pairs (device stamp, arrival on the host): transfer only ever delays, so the smallest
 * (arrival - stamp) of a window bounds the offset from above; the known least transfer time is subtracted. The
 * uncertainty says how far host time may be wrong. One map belongs to one thread.
 */
#ifndef BB_HAL_DEV_TIME_H
#define BB_HAL_DEV_TIME_H

#include "hal/base.h"

/* Differences of stamps by modular arithmetic: right across the end of int64 while they lie less than 146 years apart. */
static inline int64_t bb_ns_since(int64_t at_ns, int64_t since_ns)
{
	return (int64_t)((uint64_t)at_ns - (uint64_t)since_ns);
}
static inline int64_t bb_ns_after(int64_t at_ns, int64_t later_ns)
{
	return (int64_t)((uint64_t)at_ns + (uint64_t)later_ns);
}

struct bb_dev_ns { /* ns since the device's own zero, unwrapped by its driver */
	int64_t ns;
};

/* Unwraps a 32-bit counter by modular differences; right while two readings are less than half a wrap apart. */
struct bb_unwrap32 {
	uint32_t last;
	int64_t total; /* ticks since the first reading's own value */
	bool started;
};
int64_t bb_unwrap32(struct bb_unwrap32 *u, uint32_t ticks);

#define BB_TIMEMAP_WINDOW 64

struct bb_timemap {
	int64_t least_latency_ns;              /* from the device's limits */
	int64_t delta_ns[BB_TIMEMAP_WINDOW];   /* arrival - stamp, a ring */
	uint32_t n;                            /* pairs seen */
	int64_t offset_ns, uncertainty_ns;     /* host = stamp + offset +- uncertainty */
};
void bb_timemap_init(struct bb_timemap *m, int64_t least_latency_ns);
void bb_timemap_add(struct bb_timemap *m, struct bb_dev_ns stamp, int64_t arrived_ns);
/* Host time of a device stamp; 0 pairs: the stamp itself with uncertainty INT64_MAX. */
int64_t bb_timemap_host_ns(const struct bb_timemap *m, struct bb_dev_ns stamp);

#endif
