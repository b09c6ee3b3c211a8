/*
 * hal/power.h: outlets of a power strip: switch, read the contact back, current. The state after a write is what the
 * read-back says, never what was asked. Minimum off and on times, cycles per hour and stagger come from hal/safety.h
 * and are enforced here, in the wrapper, for every back end.
 */
#ifndef BB_HAL_POWER_H
#define BB_HAL_POWER_H

#include "hal/device.h"
#include "hal/safety.h"

#define BB_OUTLETS_MAX 64

struct bb_outlet_config {
	int64_t outlet;           /* the strip's own number, from 1 */
	char name[BB_ID_MAX];
	double load_a, inrush_a, inrush_ms;
};

struct bb_power_config {
	char id[BB_ID_MAX];
	char device[160];
	size_t n_outlets;
	struct bb_outlet_config outlet[BB_OUTLETS_MAX];
	struct bb_safety safety;
};

struct bb_power_limits {
	int64_t settle_ns;        /* from a write to a read-back that shows it, at most */
	double current_error_a;
	double most_total_a;      /* the strip's fuse */
};

struct bb_outlet_state {
	bool commanded, closed;   /* asked for; read back from the contact */
	bool known;               /* false: no answer, closed means nothing */
	double current_a;
	int64_t at_ns;
};

struct bb_power;
struct bb_power_driver;

BB_MUST_CHECK enum bb_status bb_power_open(const struct bb_power_driver *driver, const struct bb_power_config *config,
                                           const struct bb_open *open, struct bb_power **out);
/* Leaves every outlet as it is. */
void bb_power_close(struct bb_power *p);
const struct bb_power_limits *bb_power_limits(const struct bb_power *p);
/* index counts config.outlet. BB_ERR_REFUSED when a safety time has not passed (last_error says how long to wait). */
BB_MUST_CHECK enum bb_status bb_power_set(struct bb_power *p, size_t index, bool on);
/* How long until bb_power_set(p, index, on) would not be refused, ns; 0: now. */
int64_t bb_power_wait_ns(const struct bb_power *p, size_t index, bool on);
BB_MUST_CHECK enum bb_status bb_power_read(struct bb_power *p, size_t index, struct bb_outlet_state *out);
struct bb_device *bb_power_device(struct bb_power *p);

#endif
