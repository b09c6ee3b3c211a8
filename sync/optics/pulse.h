/*
 * sync/optics/pulse.h: one pulse of light a cycle, found in samples folded into that cycle: a cell or a pixel that is
 * driven on at `rise` and off at `fall` and follows each drive as 1 - exp(-t / tau) and exp(-t / tau), seen through a
 * first-order sensor and an exposure. Least squares on the steady state of that; every number with one sigma.
 * Stateless; ns within the cycle.
 */
#ifndef BB_SYNC_PULSE_H
#define BB_SYNC_PULSE_H

#include "hal/base.h"

struct bb_estimate {
	double value, sigma; /* NAN: not measured */
};

struct bb_fold { /* samples of one bin of a cycle */
	double sum, phase_sum; /* phases in ns, less the bin's begin */
	uint32_t n;
};

struct bb_pulse {
	struct bb_estimate rise_ns, fall_ns; /* drive instants, 0 <= value < cycle */
	struct bb_estimate rise_tau_ns, fall_tau_ns;
	struct bb_estimate base, height;     /* in the samples' unit */
	double rms;                          /* of what the fit leaves over, per sample */
	bool found;
};

struct bb_pulse_task {
	const struct bb_fold *fold;
	size_t n_bins;
	double cycle_ns;
	double sensor_tau_ns, aperture_ns; /* 0: none */
};

/* found is false when there is no pulse that stands out of the noise. */
struct bb_pulse bb_pulse_fit(const struct bb_pulse_task *task);

#endif
