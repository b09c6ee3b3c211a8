#include "render/bricks/stats.h"

#include <math.h>
#include <string.h>

void bb_moment_lanes_begin(struct bb_moment_lanes *m, float first)
{
	*m = (struct bb_moment_lanes){ .first = first };
	for (size_t i = 0; i < BB_MOMENT_LANES; i++)
		m->least[i] = m->most[i] = first;
}

double bb_lanes_sum(const double lane[BB_MOMENT_LANES])
{
	return ((lane[0] + lane[1]) + (lane[2] + lane[3])) + ((lane[4] + lane[5]) + (lane[6] + lane[7]));
}

void bb_moment_lanes_close(const struct bb_moment_lanes *m, struct bb_moments *out)
{
	const double sum = bb_lanes_sum(m->sum);

	*out = (struct bb_moments){ .n = m->n, .least = m->first, .most = m->first };
	if (m->n <= 0)
		return;
	out->mean = (double)m->first + sum / m->n;
	out->m2 = fmax(0, bb_lanes_sum(m->square) - sum * sum / m->n);
	for (size_t i = 0; i < BB_MOMENT_LANES; i++) {
		out->least = m->least[i] < out->least ? m->least[i] : out->least;
		out->most = m->most[i] > out->most ? m->most[i] : out->most;
	}
}

void bb_moments_merge(struct bb_moments *out, const struct bb_moments *b)
{
	const double n = out->n + b->n, apart = b->mean - out->mean;

	if (b->n <= 0)
		return;
	if (out->n <= 0) {
		*out = *b;
		return;
	}
	out->m2 += b->m2 + apart * apart * (out->n * b->n / n);
	out->mean += apart * (b->n / n);
	out->time_dev += (b->time_dev - out->time_dev) * (b->n / n);
	out->time_cov += (b->time_cov - out->time_cov) * (b->n / n);
	out->least = b->least < out->least ? b->least : out->least;
	out->most = b->most > out->most ? b->most : out->most;
	out->n = n;
}

double bb_moments_deviation(const struct bb_moments *m)
{
	return m->n > 0 ? sqrt(m->m2 / m->n) : 0;
}

double bb_moments_cov(const struct bb_moments *m, double range)
{
	const double deviation = bb_moments_deviation(m), mean = fmax(fabs(m->mean), 1e-3 * fabs(range));

	return deviation > 0 && mean > 0 ? deviation / mean : 0;
}

struct bb_bin_scale bb_bin_scale(double least, double most)
{
	const double per_bin = most > least ? BB_STATS_PLACES / (most - least) : 0;

	/* A range of denormals: everything is in the first bin rather than at infinity. */
	return (struct bb_bin_scale){ (float)least, per_bin < 3e38 ? (float)per_bin : 0 };
}

static uint16_t part_of(double sum, double n)
{
	const double part = sum / n; /* no call: loops of it are vectors */

	return (uint16_t)(int)((part > 0 ? (part < 1 ? part : 1) : 0) * 65535 + 0.5); /* none of nothing is no number: 0 */
}

void bb_bins_close(const struct bb_bin_sums *b, double n, uint16_t out[BB_STATS_BINS])
{
	int64_t above = b->at[BB_STATS_BINS].below;

	for (size_t i = BB_STATS_BINS; i-- > 0;) {
		out[i] = part_of((double)b->at[i].part / 256 + (double)above, n);
		above += b->at[i].below;
	}
}

void bb_counts_close(const uint32_t counts[BB_STATS_BINS], double n, uint16_t out[BB_STATS_BINS])
{
	for (size_t i = 0; i < BB_STATS_BINS; i++)
		out[i] = part_of(counts[i], n);
}

void bb_histogram_merge(const uint16_t *a, double na, const uint16_t *b, double nb, uint16_t *out)
{
	const double n = na + nb;

	for (size_t i = 0; i < BB_STATS_BINS; i++)
		out[i] = n > 0 ? (uint16_t)((a[i] * na + b[i] * nb) / n + 0.5) : 0;
}

/*
 * A token is one byte 0..127: a difference of -63..64; 128..191: 1 to 64 differences of nothing; 192: a difference of
 * two bytes follows, low byte first, modulo 65536.
 */
enum { SMALL_ZERO = 63, RUN = 128, WIDE = 192 };

size_t bb_histogram_encode(const uint16_t h[BB_STATS_BINS], uint8_t *out)
{
	size_t n = 0, run = 0;

	for (size_t i = 0; i <= BB_STATS_BINS; i++) {
		const int d = i == BB_STATS_BINS ? 1 : h[i] - (i ? h[i - 1] : 0);
		if (!d) {
			run++;
			continue;
		}
		if (run)
			out[n++] = (uint8_t)(RUN + run - 1);
		run = 0;
		if (i == BB_STATS_BINS)
			break;
		if (d >= -SMALL_ZERO && d <= 64) {
			out[n++] = (uint8_t)(d + SMALL_ZERO);
			continue;
		}
		out[n++] = WIDE;
		out[n++] = (uint8_t)((unsigned)d & 0xff);
		out[n++] = (uint8_t)((unsigned)d >> 8 & 0xff);
	}
	return n;
}

size_t bb_histogram_decode(const uint8_t *bytes, size_t n, uint16_t out[BB_STATS_BINS])
{
	size_t at = 0, bin = 0;
	uint16_t now = 0;

	while (bin < BB_STATS_BINS) {
		if (at == n || bytes[at] > WIDE)
			return 0;
		const uint8_t token = bytes[at++];
		size_t many = 1;
		if (token == WIDE) {
			if (n - at < 2)
				return 0;
			now = (uint16_t)(now + (bytes[at] | bytes[at + 1] << 8));
			at += 2;
		} else if (token >= RUN) {
			many = token - RUN + 1u;
		} else {
			now = (uint16_t)(now + token - SMALL_ZERO);
		}
		if (many > BB_STATS_BINS - bin)
			return 0;
		while (many--)
			out[bin++] = now;
	}
	return at;
}
