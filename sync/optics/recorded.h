/*
 * sync/optics/recorded.h: an optical recording as text (docs/phase-measure.md): "# key: value" lines, one line of column
 * names, then a line of numbers per sample. Bytes are pushed in pieces of any size and are hostile until they have
 * passed: bounded lines, columns and shows; finite numbers; time that only goes forward. Nothing is allocated.
 */
#ifndef BB_SYNC_RECORDED_H
#define BB_SYNC_RECORDED_H

#include "hal/optics.h"
#include "hal/status.h"

#ifdef BB_FUZZ
#define BB_RECORDED_LINE 256 /* reached by short inputs */
#else
#define BB_RECORDED_LINE 8192 /* every channel with a wall of the longest name */
#endif

struct bb_recorded { /* the caller's memory */
	struct bb_recording recording; /* complete once `headed` */
	bool headed;
	double rate_hz;                /* as told; 0: not yet */
	const char *path;              /* for errors; borrowed */
	void (*sample)(void *ctx, const struct bb_recording *r, int64_t at_ns, const double *volts);
	void *ctx;
	int line_no;
	size_t n_line;
	uint64_t n_samples;
	int64_t last_ns;
	double volts[BB_CHANNELS_MAX];
	char line[BB_RECORDED_LINE];
};

/* sample may be NULL. */
void bb_recorded_begin(struct bb_recorded *r, const char *path,
                       void (*sample)(void *ctx, const struct bb_recording *r, int64_t at_ns, const double *volts),
                       void *ctx);
/* Errors 1630..1637, with the line. After one the reader must not be used again. */
BB_MUST_CHECK enum bb_status bb_recorded_push(struct bb_recorded *r, const char *bytes, size_t n, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_recorded_end(struct bb_recorded *r, struct bb_error *err);

#endif
