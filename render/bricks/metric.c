#include "render/bricks/metric.h"
#include "render/bricks/metric_quick.h"

#include <math.h>
#include <string.h>

#define LEAST_DEVIATION BB_METRIC_LEAST_DEVIATION
#define MOST_DEVIATION BB_METRIC_MOST_DEVIATION
#define REACH 12.0 /* deviations beyond which float has nothing left of a normal distribution */

#define MOST_ERROR 1e18 /* stands for all larger ones */

/* ---- colours ---- */

static double square(double v)
{
	return v * v;
}

/* Equation 7, the square of a distance. */
static double distance(const float *a, const double *b)
{
	return (double)a[3] *
		       (square((double)a[0] - b[0]) + square((double)a[1] - b[1]) + square((double)a[2] - b[2])) +
	       square((double)a[3] - b[3]);
}

/* Equation 8. */
static double level(const double *c)
{
	return sqrt(c[3] * (square(c[0]) + square(c[1]) + square(c[2])) + square(c[3]));
}

void bb_metric_colours(const struct bb_transfer *tf, struct bb_metric_colours *out)
{
	double sum = 0, rgba[4];

	for (int j = 0; j < BB_METRIC_COLOURS; j++) {
		bb_transfer_at(tf, (j + 0.5) / BB_METRIC_COLOURS, rgba);
		for (int k = 0; k < 4; k++)
			out->rgba[j][k] = (float)rgba[k];
		if (j) {
			const float *before = out->rgba[j - 1];
			sum += distance(before, rgba);
		}
	}
	out->variation = sqrt(sum);
	out->visible_from[BB_METRIC_COLOURS] = BB_METRIC_COLOURS;
	for (int j = BB_METRIC_COLOURS; j-- > 0;) {
		const double from = (double)j / BB_METRIC_COLOURS, to = (j + 1.0) / BB_METRIC_COLOURS;
		out->visible_from[j] =
			bb_transfer_most_opacity(tf, from, to) > 0 ? (uint16_t)j : out->visible_from[j + 1];
	}
}

static int entry_of(double v)
{
	return v > 0 ? (v < 1 ? (int)(v * BB_METRIC_COLOURS) : BB_METRIC_COLOURS - 1) : 0;
}

bool bb_metric_visible(const struct bb_metric_colours *c, double least, double most)
{
	return c->visible_from[entry_of(least)] <= entry_of(most);
}

/* ---- the reference ---- */

double bb_metric_reference_space(const struct bb_metric_colours *c, const float *v, size_t n)
{
	double mean[4] = { 0 }, sum = 0;

	for (size_t i = 0; i < n; i++)
		for (int k = 0; k < 4; k++)
			mean[k] += (double)c->rgba[entry_of((double)v[i])][k] / (double)n;
	for (size_t i = 0; i < n; i++)
		sum += distance(c->rgba[entry_of((double)v[i])], mean) / (double)n;
	const double mu = level(mean);
	return mu > 0 ? sqrt(sum) / mu : 0;
}

double bb_metric_reference_time(const struct bb_metric_colours *c, const float *v, size_t n, size_t steps)
{
	double sum = 0;

	for (size_t i = 0; i < n; i++) {
		double mean[4] = { 0 }, dev = 0;
		for (size_t s = 0; s < steps; s++)
			for (int k = 0; k < 4; k++)
				mean[k] += (double)c->rgba[entry_of((double)v[s * n + i])][k] / (double)steps;
		for (size_t s = 0; s < steps; s++)
			dev += distance(c->rgba[entry_of((double)v[s * n + i])], mean) / (double)steps;
		const double mu = level(mean);
		sum += mu > 0 ? sqrt(dev) / mu : 0;
	}
	return n ? sum / (double)n : 0;
}

/* ---- the approximation ---- */

/* Equation 19. Where next to nothing is seen it has no bound, and soon no digits. */
static double ratio(double variance, double mu)
{
	if (!(mu > 1 / MOST_ERROR))
		return MOST_ERROR;
	return variance > 0 ? fmin(sqrt(variance) / mu, MOST_ERROR) : 0;
}

double bb_metric_approximate(const struct bb_metric_colours *c, double mean, double deviation, double least,
			     double most)
{
	const int from = entry_of(least), to = entry_of(most);
	double p[BB_METRIC_COLOURS], total = 0, colour[4] = { 0 }, sum = 0;

	if (!(deviation > 0) || !bb_metric_visible(c, least, most))
		return 0;
	for (int j = from; j <= to; j++) {
		p[j] = exp(-square((j + 0.5) / BB_METRIC_COLOURS - mean) / (2 * square(deviation)));
		total += p[j];
	}
	if (!(total > 0)) /* narrower than an entry */
		return 0;
	for (int j = from; j <= to; j++)
		for (int k = 0; k < 4; k++)
			colour[k] += p[j] / total * (double)c->rgba[j][k];
	for (int j = from; j <= to; j++)
		sum += p[j] / total * distance(c->rgba[j], colour);
	return ratio(sum, level(colour));
}

/* Deviations of the table's rows: geometric, since narrow distributions change fastest. */
double bb_metric_deviation_of_row(int row)
{
	return LEAST_DEVIATION * pow(MOST_DEVIATION / LEAST_DEVIATION, (double)row / (BB_METRIC_DEVIATIONS - 1));
}

static float row_of(double deviation)
{
	const float per_row = (float)((BB_METRIC_DEVIATIONS - 1) / log2(MOST_DEVIATION / LEAST_DEVIATION));

	return bb_quick_log2((float)(deviation * (1 / LEAST_DEVIATION))) * per_row;
}

/*
 * What equations 16 to 18 need of the colours around a mean is nine weighted means: of r, g, b and opacity, of these
 * times opacity, and of the squares; the distance of equation 7 multiplied out.
 */
enum { MEAN_R, MEAN_G, MEAN_B, MEAN_A, MEAN_AR, MEAN_AG, MEAN_AB, MEAN_ARGB2, MEAN_A2, MEAN_SEEN, MEANS };

static float log_error_of(const float *m, enum bb_metric_form form)
{
	const double c[4] = { (double)m[MEAN_R], (double)m[MEAN_G], (double)m[MEAN_B], (double)m[MEAN_A] },
		     mu = level(c);
	const double cross = c[0] * (double)m[MEAN_AR] + c[1] * (double)m[MEAN_AG] + c[2] * (double)m[MEAN_AB];
	const double own = c[3] * (square(c[0]) + square(c[1]) + square(c[2]));
	const double sum = (double)m[MEAN_ARGB2] - 2 * cross + own + (double)m[MEAN_A2] - square(c[3]);

	return (float)log1p(form == BB_METRIC_RATIO ? ratio(sum, mu) : sqrt(fmax(sum, 0)));
}

static void weights_of(const struct bb_metric_colours *c, float (*w)[MEANS])
{
	for (int j = 0; j < BB_METRIC_COLOURS; j++) {
		const float *x = c->rgba[j];
		const float all[MEANS] = { x[0],        x[1],
					   x[2],        x[3],
					   x[3] * x[0], x[3] * x[1],
					   x[3] * x[2], x[3] * (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]),
					   x[3] * x[3], x[3] > 0 };
		memcpy(w[j], all, sizeof(all));
	}
}

void bb_metric_table(const struct bb_metric_colours *c, struct bb_metric_table *out)
{
	bb_metric_table_of(c, BB_METRIC_RATIO, out);
}

void bb_metric_table_of(const struct bb_metric_colours *c, enum bb_metric_form form, struct bb_metric_table *out)
{
	float w[BB_METRIC_COLOURS][MEANS], bell[BB_METRIC_COLOURS] = { 0 };

	out->colours = c;
	out->form = form;
	weights_of(c, w);
	for (int row = 0; row < BB_METRIC_DEVIATIONS; row++) {
		const double deviation = bb_metric_deviation_of_row(row) * BB_METRIC_COLOURS; /* in entries */
		const int reach = (int)fmin(ceil(REACH * deviation), BB_METRIC_COLOURS - 1);
		for (int d = 0; d <= reach; d++)
			bell[d] = expf(-(float)square(d / deviation) / 2);
		for (int mean = 0; mean < BB_METRIC_COLOURS; mean++) {
			const int from = mean > reach ? mean - reach : 0;
			const int to = mean + reach < BB_METRIC_COLOURS ? mean + reach : BB_METRIC_COLOURS - 1;
			float sum[MEANS] = { 0 }, total = 0;
			for (int j = from; j <= to; j++) {
				const float p = bell[j < mean ? mean - j : j - mean];
				total += p;
				for (int k = 0; k < MEANS; k++)
					sum[k] += p * w[j][k];
			}
			for (int k = 0; k < MEANS; k++)
				sum[k] /= total;
			out->log_error[row][mean] = log_error_of(sum, form);
			out->seen[row][mean] = sum[MEAN_SEEN];
		}
	}
}

double bb_metric_look_up(const struct bb_metric_table *t, double mean, double deviation, double least, double most)
{
	if (!(deviation >= LEAST_DEVIATION) || !bb_metric_visible(t->colours, least, most))
		return 0;
	const float row = fminf(row_of(deviation), BB_METRIC_DEVIATIONS - 1.001f);
	const float column = fminf(fmaxf((float)mean * BB_METRIC_COLOURS - 0.5f, 0), BB_METRIC_COLOURS - 1.001f);
	const int r = (int)row, c = (int)column;
	const float fr = row - (float)r, fc = column - (float)c;
	const float a = t->log_error[r][c] + (t->log_error[r][c + 1] - t->log_error[r][c]) * fc;
	const float b = t->log_error[r + 1][c] + (t->log_error[r + 1][c + 1] - t->log_error[r + 1][c]) * fc;
	return (double)bb_quick_expm1(a + (b - a) * fr);
}

/* ---- all bricks of a file ---- */

struct in_parts { /* a brick's moments as parts of the data's range */
	double mean, deviation, least, most;
};

static struct in_parts in_parts(const struct bb_bricks_moments *m, double least, double per)
{
	return (struct in_parts){ ((double)m->mean - least) * per, (double)m->deviation * per,
				  ((double)m->least - least) * per, ((double)m->most - least) * per };
}

void bb_metric_rate(const struct bb_bricks *b, const struct bb_metric_table *t, float *space, float *time)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_bricks_moments *m = bb_bricks_moments(b);
	const double per = h->most > h->least ? 1 / (h->most - h->least) : 0;

	for (uint64_t i = 0; i < h->tree.n_bricks; i++) {
		const struct in_parts v = in_parts(&m[i], h->least, per);
		space[i] = (float)bb_metric_look_up(t, v.mean, v.deviation, v.least, v.most);
		time[i] = bb_metric_visible(t->colours, v.least, v.most)
				  ? (float)((double)m[i].time_cov * t->colours->variation)
				  : 0;
	}
}

double bb_metric_scalar(enum bb_metric_scalar guard, double mean, double deviation, double range)
{
	if (guard == BB_SCALAR_BARE)
		return deviation / fabs(mean);
	if (guard == BB_SCALAR_SAND)
		return deviation;
	const double guarded = fmax(fabs(mean), 1e-3 * fabs(range)); /* as bb_moments_cov, without a square */
	return deviation > 0 && guarded > 0 ? deviation / guarded : 0;
}

void bb_metric_rate_scalar(const struct bb_bricks *b, enum bb_metric_scalar guard, float *space, float *time)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_bricks_moments *m = bb_bricks_moments(b);

	for (uint64_t i = 0; i < h->tree.n_bricks; i++) {
		space[i] =
			(float)bb_metric_scalar(guard, (double)m[i].mean, (double)m[i].deviation, h->most - h->least);
		time[i] = guard == BB_SCALAR_SAND ? m[i].time_dev : m[i].time_cov;
	}
}

/* ---- order ---- */

/* Errors are not negative, so their bits have their order: a radix sort in three passes, the largest first. */
void bb_metric_order(const float *error, uint32_t n, uint64_t *scratch, uint32_t *order)
{
	enum { RADIX = 11, BUCKETS = 1 << RADIX, PASSES = 3 };
	uint32_t count[PASSES][BUCKETS] = { { 0 } };

	for (uint32_t i = 0; i < n; i++) {
		uint32_t bits;
		memcpy(&bits, &error[i], 4);
		for (int p = 0; p < PASSES; p++)
			count[p][BUCKETS - 1 - (bits >> RADIX * p & (BUCKETS - 1))]++;
	}
	for (int p = 0; p < PASSES; p++)
		for (uint32_t k = 0, sum = 0; k < BUCKETS; k++) {
			const uint32_t here = count[p][k];
			count[p][k] = sum;
			sum += here;
		}
	/* order -> lower half of scratch -> upper half -> order: indices only */
	uint32_t *first = (uint32_t *)scratch, *second = first + n;
	for (int p = 0; p < PASSES; p++) {
		const uint32_t *from = p == 1 ? first : second;
		uint32_t *to = p == 0 ? first : p == 1 ? second : order;
		for (uint32_t k = 0; k < n; k++) {
			const uint32_t i = p ? from[k] : k;
			uint32_t bits;
			memcpy(&bits, &error[i], 4);
			to[count[p][BUCKETS - 1 - (bits >> RADIX * p & (BUCKETS - 1))]++] = i;
		}
	}
}
