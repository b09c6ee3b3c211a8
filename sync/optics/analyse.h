/*
 * sync/optics/analyse.h: phase, order of the eyes, skew between walls and crosstalk from what light sensors saw, given
 * nominal rates and the schedule of patterns only. Every number has one sigma.
 *
 * Two passes over the same samples, in memory that the recording's header bounds: the first (`scan`) finds each clock's
 * true period from the phase of its fundamental, cycle by cycle, and every channel's mean light; the second (`fold`)
 * folds the samples into that cycle. Then pulses are fitted (sync/optics/pulse.h). What is white for one eye only gives
 * a wall's windows; a steady lamp behind a lens gives that lens alone; means through the lenses give crosstalk:
 * leakage over signal, both less black (Woods 2012), never clamped: it may be negative.
 * Stamps are int64 ns on the recorder's own axis; only differences are doubles. One thread.
 */
#ifndef BB_SYNC_ANALYSE_H
#define BB_SYNC_ANALYSE_H

#include "hal/optics.h"
#include "hal/status.h"
#include "sync/optics/pulse.h"

#define BB_OPTICS_WALLS_MAX 32

enum bb_order { BB_ORDER_UNKNOWN, BB_ORDER_RIGHT, BB_ORDER_SWAPPED }; /* does each eye get its own picture? */

struct bb_optics_band {               /* arrays by eye: left, right */
	bool seen;
	struct bb_pulse white[2];         /* the wall without glasses, white for that eye only; ns in the wall's cycle */
	struct bb_estimate phase_ns[2];   /* wall lights up less lens opens, within half a cycle */
	struct bb_estimate crosstalk[2];  /* percent */
	struct bb_estimate light[2];      /* percent of the bare white wall that reaches the eye */
};
struct bb_optics_wall {
	char id[BB_ID_MAX];
	struct bb_estimate cycle_ns;      /* two eye changes */
	struct bb_optics_band band[BB_BANDS];
	struct bb_estimate skew_ns;       /* lights up less the first wall, at the recording's middle */
	struct bb_estimate scan_ns;       /* top band to bottom band; negative: upwards */
	enum bb_order order;
	struct { /* the patch that tells the eye */
		bool seen;
		uint64_t cycles, gaps, odd;   /* read; steps of the counter that are not 1; levels that are no frame's */
		enum bb_order order;          /* against the wall's own white frames */
	} tag;
};
struct bb_optics {
	struct bb_estimate cycle_ns;      /* of the glasses */
	struct bb_pulse lens[2];
	bool has_lens[2];
	size_t n_walls;
	struct bb_optics_wall wall[BB_OPTICS_WALLS_MAX];
	int64_t middle_ns;                /* phases count from here */
	uint64_t n_samples;
};

struct bb_analyser;
/* BB_ERR_NOMEM, or BB_ERR_CONFIG for a recording without shows, channels or rate. The recording is copied. */
BB_MUST_CHECK enum bb_status bb_analyser_create(const struct bb_recording *r, struct bb_analyser **out);
void bb_analyser_destroy(struct bb_analyser *a);
/* All samples in order of time, volts by channel; then turn; then the same ones again; then finish. */
void bb_analyser_scan(struct bb_analyser *a, int64_t at_ns, const double *volts);
/* False when nothing in the recording repeats: no period could be found. */
bool bb_analyser_turn(struct bb_analyser *a);
void bb_analyser_fold(struct bb_analyser *a, int64_t at_ns, const double *volts);
void bb_analyser_finish(struct bb_analyser *a, struct bb_optics *out);
/* A channel's light over its wall's cycle with one pattern (any for a lamp), for a drawing: n means, NAN where nothing
 * fell. False when it was not folded. */
bool bb_analyser_wave(const struct bb_analyser *a, size_t channel, enum bb_pattern pattern, double *out, size_t n);

enum bb_judgement { BB_HOLDS, BB_MISSES, BB_UNDECIDED }; /* undecided: two sigma reach over the limit, or no value */
enum bb_judgement bb_optics_judge(struct bb_estimate e, double most);

#endif
