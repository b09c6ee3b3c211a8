/* sync/optics/analyse_private.h: what the two passes keep; between analyse.c, conclude.c and tag.c. */
#ifndef BB_SYNC_ANALYSE_PRIVATE_H
#define BB_SYNC_ANALYSE_PRIVATE_H

#include "sync/optics/analyse.h"

#define OPTICS_BINS 4096
#define OPTICS_GUARD 3.0 /* cycles of a show that belong to the change of pattern: scan-out, pixels, cells */
#define OPTICS_CLOCKS (BB_OPTICS_WALLS_MAX + 1)

struct trend { /* a straight line through what comes in, kept as sums */
	double n, x, y, xx, xy, yy;
};
/* How values scatter from cycle to cycle, as half the variance of their differences over 1, 2 and 3 cycles: what repeats
 * after three cycles (hum of 100 Hz in cycles of 60 Hz) is no scatter, for it cancels in a mean over them. */
#define OPTICS_LAGS 3
struct scatter {
	double last[OPTICS_LAGS];
	unsigned n_last;
	double n[OPTICS_LAGS], sum[OPTICS_LAGS], squares[OPTICS_LAGS];
};
struct part { /* one channel during one show, cycle by cycle */
	double re, im, area, n; /* of the cycle under way */
	double last_phase;
	double amplitude, samples; /* summed over cycles */
	struct trend trend;    /* phase of the fundamental, radians against seconds from the middle */
	struct trend mean;     /* volts */
	struct scatter phase_scatter, mean_scatter;
};
double bb_scatter_variance(const struct scatter *s); /* NAN: too few */
void bb_scatter_pool(struct scatter *into, const struct scatter *s);
struct tag {
	double low, high;      /* volts seen at all */
	double centre_ns;      /* of left frames, in the wall's cycle */
	double centre_weight;
	double sum[2];         /* left, right: of the frames under way */
	uint32_t n[2];
	bool in_right;
	unsigned bits, n_bits;
	int place;             /* last one read; -1: none */
	uint64_t cycles, gaps, odd;
};
struct optics_channel {
	size_t clock;
	struct part part[BB_SHOWS_MAX];
	struct bb_fold *fold[BB_PATTERN_COUNT]; /* a lamp's: the first */
	struct tag tag;
};
struct weighted {
	double slope, weight;
};
struct clock { /* one per wall, and one of the glasses */
	char wall[BB_ID_MAX];
	struct weighted rough, fine; /* radians a second against the nominal rate: within shows; from show to show */
	bool settled;
	double cycle_ns, cycle_sigma_ns;
};
struct bb_analyser {
	struct bb_recording r;
	double nominal_ns;     /* of a cycle */
	int64_t middle_ns, last_ns, tag_from_ns;
	double last[BB_CHANNELS_MAX];
	uint64_t n_samples;
	size_t n_clocks;
	struct clock clock[OPTICS_CLOCKS];
	struct optics_channel channel[BB_CHANNELS_MAX];
};

bool bb_trend_line(const struct trend *t, double *slope, double *slope_variance, double *scatter);
double bb_optics_phase(const struct clock *k, double since_ns); /* 0 <= phase < cycle */
void bb_optics_tag_find(struct bb_analyser *a, size_t channel);
void bb_optics_tag_sample(struct bb_analyser *a, size_t channel, double since_ns, double volts);

#endif
