/*
 * render/bricks/stats.h: what a brick knows of the voxels it stands for: moments (Welford 1962 within a brick, merged
 * pairwise as Chan, Golub and LeVeque 1983: a sum of squares loses every digit when the mean is large) and histograms.
 *
 * A value histogram counts voxels. An error histogram (Carlsson and Tjernstroem 2016, section 3.3.9) has, for each
 * voxel A that is shown as B, the bins between A and B raised by one, the outer two by the part of them that lies
 * between. Both are over the whole range of the data, and are kept as parts of their number of voxels, 65535 being all.
 */
#ifndef BB_RENDER_BRICKS_STATS_H
#define BB_RENDER_BRICKS_STATS_H

#include "hal/base.h"

#define BB_STATS_BINS 64

struct bb_moments {
	double n, mean, m2; /* number, mean, sum of squared distances from it */
	float least, most;
	double time_dev, time_cov; /* means over voxels of one voxel's deviation over time and of that / mean (eq. 6 of
				    * Ellsworth, Chiang and Shen 2000); 0 in a single step */
};

/*
 * Moments being gathered, eight voxels at a time, from one of them on: since that is one of the voxels, its distance
 * from the mean is in m2, and taking it out of a sum of squares costs no more than log2(n) bits of 53.
 */
#define BB_MOMENT_LANES 8
struct bb_moment_lanes {
	double n, sum[BB_MOMENT_LANES], square[BB_MOMENT_LANES];
	float first, least[BB_MOMENT_LANES], most[BB_MOMENT_LANES];
};

/* n <= 8 of v, which has eight; finite ones. */
static inline void bb_moment_lanes_add(struct bb_moment_lanes *restrict m, const float *restrict v, uint32_t n)
{
	const float first = m->first;

	for (uint32_t i = 0; i < BB_MOMENT_LANES; i++) {
		const float one = i < n ? v[i] : first;
		const double d = (double)one - (double)first;
		m->sum[i] += d;
		m->square[i] += d * d;
		m->least[i] = one < m->least[i] ? one : m->least[i];
		m->most[i] = one > m->most[i] ? one : m->most[i];
	}
	m->n += n;
}
double bb_lanes_sum(const double lane[BB_MOMENT_LANES]); /* in an order of its own */
void bb_moment_lanes_begin(struct bb_moment_lanes *m, float first);
void bb_moment_lanes_close(const struct bb_moment_lanes *m, struct bb_moments *out);

/* out takes in b. */
void bb_moments_merge(struct bb_moments *out, const struct bb_moments *b);
double bb_moments_deviation(const struct bb_moments *m);
/*
 * deviation / |mean|, the coefficient of variation, with the mean kept away from zero by a thousandth of the data's
 * range: data around zero would be infinitely uneven, and an all-zero brick undefined.
 */
double bb_moments_cov(const struct bb_moments *m, double range);

/*
 * A value's place among the bins, in 256ths of one: 0 .. BB_STATS_PLACES. All places of a brick are made once and
 * compared often, so they are whole numbers.
 */
#define BB_STATS_PLACES (BB_STATS_BINS * 256)

struct bb_bin_scale {
	float least, per_bin; /* 256ths of a bin for each unit */
};
struct bb_bin_scale bb_bin_scale(double least, double most);

static inline uint16_t bb_bin_place(const struct bb_bin_scale *s, float v)
{
	const float most = BB_STATS_PLACES;
	float at = (v - s->least) * s->per_bin;

	at = at > 0 ? at : 0; /* one after the other: a minimum and a maximum, no branch; NaN is 0 */
	at = at < most ? at : most;
	return (uint16_t)(int)at;
}

/* Of any number of stretches: the parts of each bin, in 256ths, and the stretches that begin less those that end there.
 */
struct bb_bin_sums {
	struct {
		int64_t part, below;
	} at[BB_STATS_BINS + 1];
};

/* Of bins that voxels were counted in. */
void bb_counts_close(const uint32_t counts[BB_STATS_BINS], double n, uint16_t out[BB_STATS_BINS]);

/* As parts of n voxels, 65535 each being all of them. */
void bb_bins_close(const struct bb_bin_sums *b, double n, uint16_t out[BB_STATS_BINS]);
/* The mean of histograms of na and nb voxels, into out, which may be one of them. */
void bb_histogram_merge(const uint16_t *a, double na, const uint16_t *b, double nb, uint16_t *out);

/*
 * Histograms as bytes: the differences of neighbours, small ones in a byte, runs of nothing in one; at most
 * BB_HISTOGRAM_CODED_MOST. Returns how many.
 */
#define BB_HISTOGRAM_CODED_MOST (3 * BB_STATS_BINS)
size_t bb_histogram_encode(const uint16_t h[BB_STATS_BINS], uint8_t *out);
/* Of n bytes; returns how many it took, 0 when they are no histogram. */
size_t bb_histogram_decode(const uint8_t *bytes, size_t n, uint16_t out[BB_STATS_BINS]);

#endif
