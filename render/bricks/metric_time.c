/*
 * render/bricks/metric_time.c: errors over time from a brick's mean, its deviation, and how far its voxels deviate over
 * time. Equation 20 takes one factor for the whole transfer function; where most of it is dark, most of what moves
 * cannot be seen. Here a voxel's error is the spatial table's for a distribution as wide as it moves, and a brick's the
 * mean of that over the values it holds.
 */
#include "render/bricks/metric.h"
#include "render/bricks/metric_quick.h"

#include <math.h>
#include <string.h>

#define TIME_EVERY 3      /* rows of the spatial table for one of ours, along the deviation over time */
#define DEVIATION_EVERY 4 /* along the deviation within the brick */
#define REACH 4.0         /* deviations */
#define LEAST_ERROR 1e-9
#define LOOKS 8.0 /* what is seen less than once in so many steps is seen in as many times fewer voxels */

static int nearest_column(int mean)
{
	return (2 * mean + 1) * BB_METRIC_COLOURS / (2 * BB_METRIC_TIME_MEANS);
}

/* Of a voxel of each mean. */
static void voxel_errors(const struct bb_metric_table *t, int row, float out[BB_METRIC_COLOURS])
{
	for (int c = 0; c < BB_METRIC_COLOURS; c++) {
		const float seen = t->form == BB_METRIC_RATIO ? fminf(1, (float)LOOKS * t->seen[row][c]) : 1;
		out[c] = fminf(expm1f(t->log_error[row][c]), 1e9f) * seen;
	}
}

static float expected(const float error[BB_METRIC_COLOURS], int centre, const float *bell, int reach)
{
	const int from = centre > reach ? centre - reach : 0;
	const int to = centre + reach < BB_METRIC_COLOURS ? centre + reach : BB_METRIC_COLOURS - 1;
	float sum = 0, total = 0;

	for (int j = from; j <= to; j++) {
		const float p = bell[j < centre ? centre - j : j - centre];
		sum += p * error[j];
		total += p;
	}
	return sum / total;
}

void bb_metric_times(const struct bb_metric_table *t, struct bb_metric_times *out)
{
	float error[BB_METRIC_COLOURS], bell[BB_METRIC_COLOURS];

	out->colours = t->colours;
	for (int row = 0; row < BB_METRIC_TIME_ROWS; row++) {
		voxel_errors(t, row * TIME_EVERY, error);
		for (int d = 0; d < BB_METRIC_TIME_DEVIATIONS; d++) {
			const double deviation = bb_metric_deviation_of_row(d * DEVIATION_EVERY) * BB_METRIC_COLOURS;
			const int reach = (int)fmin(ceil(REACH * deviation), BB_METRIC_COLOURS - 1);
			for (int k = 0; k <= reach; k++)
				bell[k] = expf(-(float)(k / deviation * (k / deviation)) / 2);
			for (int m = 0; m < BB_METRIC_TIME_MEANS; m++)
				out->log_error[row][d][m] = log1pf(expected(error, nearest_column(m), bell, reach));
		}
	}
}

struct at { /* along one axis of the table, between two entries */
	int i;
	float part;
};

static struct at at(float where, int n)
{
	const float w = fminf(fmaxf(where, 0), (float)n - 1.001f);

	return (struct at){ (int)w, w - (float)(int)w };
}

/* Rows are geometric in the deviation. */
static float row_of(double deviation, int every)
{
	const float per_row = (float)((BB_METRIC_DEVIATIONS - 1) /
				      log2(BB_METRIC_MOST_DEVIATION / BB_METRIC_LEAST_DEVIATION) / every);

	return deviation > BB_METRIC_LEAST_DEVIATION
		       ? bb_quick_log2((float)(deviation * (1 / BB_METRIC_LEAST_DEVIATION))) * per_row
		       : 0;
}

static float along(const float *row, struct at x)
{
	return row[x.i] + (row[x.i + 1] - row[x.i]) * x.part;
}

double bb_metric_look_up_time(const struct bb_metric_times *t, double mean, double deviation, double least, double most,
			      double time_deviation)
{
	const double narrow = BB_METRIC_LEAST_DEVIATION;
	float part[2];

	if (!(time_deviation > 0) || !bb_metric_visible(t->colours, least, most))
		return 0;
	const struct at x = at((float)mean * BB_METRIC_TIME_MEANS - 0.5f, BB_METRIC_TIME_MEANS);
	const struct at y = at(row_of(deviation, DEVIATION_EVERY), BB_METRIC_TIME_DEVIATIONS);
	const struct at z = at(row_of(time_deviation, TIME_EVERY), BB_METRIC_TIME_ROWS);
	for (int k = 0; k < 2; k++) {
		const float a = along(t->log_error[z.i + k][y.i], x), b = along(t->log_error[z.i + k][y.i + 1], x);
		part[k] = a + (b - a) * y.part;
	}
	/* Where the table says nothing is seen, something yet may be: no tolerance is no error. */
	const double error = fmax((double)bb_quick_expm1(part[0] + (part[1] - part[0]) * z.part), LEAST_ERROR);
	return time_deviation < narrow ? error * (time_deviation / narrow)
				       : error; /* below the first row: in proportion */
}

void bb_metric_rate_local(const struct bb_bricks *b, const struct bb_metric_table *t,
			  const struct bb_metric_times *times, float *space, float *time)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_bricks_moments *m = bb_bricks_moments(b);
	const double least = h->least, per = h->most > h->least ? 1 / (h->most - h->least) : 0;

	for (uint64_t i = 0; i < h->tree.n_bricks; i++) {
		const double mean = ((double)m[i].mean - least) * per, deviation = (double)m[i].deviation * per;
		const double low = ((double)m[i].least - least) * per, high = ((double)m[i].most - least) * per;
		space[i] = (float)bb_metric_look_up(t, mean, deviation, low, high);
		time[i] = (float)bb_metric_look_up_time(times, mean, deviation, low, high, (double)m[i].time_dev * per);
	}
}
