/*
 * drivers/pad_core.h: what every gamepad driver does alike, whatever wire it reads: the queue of reports, silence with
 * a deflected stick, bad reports and quarantine, unplug and reopening with growing pauses, neutral once before motion,
 * drifting and stuck axes (rows H1 to H5 of the fault matrix). A driver embeds a bb_pad_core, hands it samples in the
 * device's own counts, and supplies how its bus is opened, emptied and closed. Nothing here waits; everything happens
 * inside a read. One thread, the handle's.
 *
 * What is wrong stands in the device's last_error by name (PAD_GONE, PAD_SILENT, PAD_BAD, PAD_QUARANTINE, PAD_DRIFT,
 * PAD_OVERRUN, DESC_REJECT); each change of health is an event (a = new, b = old).
 */
#ifndef BB_DRIVERS_PAD_CORE_H
#define BB_DRIVERS_PAD_CORE_H

#include "hal/gamepad_driver.h"

#define BB_PAD_PULL_MAX 128 /* packets taken from a bus in one read: a flood cannot hold the frame loop */

struct bb_pad_sample {
	int32_t count[BB_PAD_AXES];
	uint32_t buttons;
};

struct bb_pad_core;
struct bb_pad_source {
	/* Opens the bus; called again after an unplug. BB_ERR_LOST: not there (yet). BB_ERR_FORMAT: refused for good.
	 * BB_TIMEOUT, not at the first time: under way, to be asked again. */
	enum bb_status (*open)(struct bb_pad_core *core);
	void (*close)(struct bb_pad_core *core);
	/* Takes one packet and gives it to bb_pad_core_good, _bad or _battery. BB_TIMEOUT: there was none; BB_ERR_LOST:
	 * the device is gone; BB_SKIPPED: the receiver is there, its pad is off. */
	enum bb_status (*pull)(struct bb_pad_core *core);
};

struct bb_pad_axis {         /* what its last seconds were like, counts */
	int32_t centre;      /* taken off while it drifts within the dead zone */
	int32_t least, most; /* since since_ns */
	int32_t last;
	int64_t since_ns;
	int direction;  /* of its last movement */
	uint32_t turns; /* how often that changed since since_ns */
	bool noisy;
	int64_t noise_since_ns;
};

#define BB_PAD_QUEUE 128
struct bb_pad_core {
	struct bb_gamepad *g;
	const struct bb_pad_source *source;
	int32_t steps[BB_PAD_AXES]; /* counts from neutral to the end */
	int64_t gap_ns;             /* silence longer than this with a stick deflected is a fault; BB_NEVER: none is */

	bool is_open, off; /* off: the receiver is there, its pad is not */
	enum bb_health health;
	bool quarantined;
	bool armed;       /* has been neutral since it was plugged in again */
	bool moved;       /* the last sample was off neutral */
	int64_t last_ns;  /* of the last good sample */
	int64_t fault_ns; /* when the present fault state began */
	uint32_t good_in_row;
	float battery; /* NAN: unknown */

	int64_t second_ns;      /* begin of the second that is being counted */
	uint32_t n_good, n_bad; /* in it */
	uint64_t bad_total, overruns;

	uint64_t jitter;   /* state of the generator for pauses */
	uint32_t attempts; /* since the unplug */
	int64_t reopen_ns;
	int64_t reopened_ns[5]; /* the last ones: five in a minute are too many */
	size_t n_reopened;

	struct bb_pad_axis axis[BB_PAD_AXES];
	uint32_t drifting; /* bit i: axis i is stuck, drifts or is noisy */

	struct bb_pad_sample sample;
	uint32_t seq;
	size_t head, n;
	struct bb_pad_report queue[BB_PAD_QUEUE];
};

/* g's device, config and seed; fills g->limits' gap and step. */
void bb_pad_core_init(struct bb_pad_core *core, struct bb_gamepad *g, const struct bb_pad_source *source,
		      const int32_t steps[BB_PAD_AXES], uint64_t seed, int64_t gap_ns);
/* The first opening: fails as the bus does. */
BB_MUST_CHECK enum bb_status bb_pad_core_start(struct bb_pad_core *core);
void bb_pad_core_stop(struct bb_pad_core *core);

/* For a source's pull. */
void bb_pad_core_good(struct bb_pad_core *core, const struct bb_pad_sample *sample, int64_t at_ns);
BB_PRINTF(2, 3)
void bb_pad_core_bad(struct bb_pad_core *core, const char *fmt, ...);
void bb_pad_core_battery(struct bb_pad_core *core, float level);
/* A packet that says nothing of interest: it is neither good nor bad, but the device lives. */
void bb_pad_core_alive(struct bb_pad_core *core, int64_t at_ns);

/* bb_gamepad_ops.read of every driver. */
enum bb_status bb_pad_core_read(struct bb_pad_core *core, struct bb_pad_report *reports, size_t cap, size_t *n_out);
/* BB_OK: the device may be written to; otherwise why not. For bb_gamepad_ops.rumble. */
BB_MUST_CHECK enum bb_status bb_pad_core_ready(struct bb_pad_core *core, const char *op);
/* A write failed: the device is gone. */
enum bb_status bb_pad_core_gone(struct bb_pad_core *core, const char *op);

#endif
