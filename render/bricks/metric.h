/*
 * render/bricks/metric.h: how wrong a brick would look, from what its file says of it and a transfer function: the
 * colour metrics of Ellsworth, Chiang and Shen 2000 (section 5, equations 7 to 20). Values are parts 0..1 of the data's
 * range, a transfer function is 256 entries, as theirs. An error is the deviation of colours over their mean, both
 * weighted by opacity; 0 where nothing can be seen.
 *
 * The reference metrics look at every voxel; they judge the others. The approximate spatial metric assumes that a
 * brick's values are normally distributed; a table over mean and deviation is made once for each edit of the transfer
 * function, and a brick then costs one look into it. Stateless; a table is constant once made.
 *
 * Beside theirs: the deviation of colours alone, which divides by nothing and so is never larger than 2; an
 * approximation in time that knows what the transfer function does where the brick's values are, which equation 20
 * takes to be the same everywhere; and the scalar metrics, which know nothing of colours.
 */
#ifndef BB_RENDER_BRICKS_METRIC_H
#define BB_RENDER_BRICKS_METRIC_H

#include "render/bricks/bricks.h"
#include "render/transfer.h"

#define BB_METRIC_COLOURS 256
#define BB_METRIC_DEVIATIONS 48
#define BB_METRIC_LEAST_DEVIATION (0.25 / BB_METRIC_COLOURS) /* below a quarter of an entry a brick is flat */
#define BB_METRIC_MOST_DEVIATION 0.5                         /* half the values at either end */

struct bb_metric_colours {
	float rgba[BB_METRIC_COLOURS][4];
	/* First entry from here on that can be seen; BB_METRIC_COLOURS: none. */
	uint16_t visible_from[BB_METRIC_COLOURS + 1];
	double variation; /* the root of all steps from entry to entry, equation 20 */
};
void bb_metric_colours(const struct bb_transfer *tf, struct bb_metric_colours *out);
/* Can any value from least to most be seen? */
bool bb_metric_visible(const struct bb_metric_colours *c, double least, double most);

/* Equations 7 to 10 over n values, and 11 to 13 over n voxels of so many steps, step after step. */
double bb_metric_reference_space(const struct bb_metric_colours *c, const float *v, size_t n);
double bb_metric_reference_time(const struct bb_metric_colours *c, const float *v, size_t n, size_t steps);
/* Equations 14 to 19 as they stand. */
double bb_metric_approximate(const struct bb_metric_colours *c, double mean, double deviation, double least,
			     double most);

enum bb_metric_form {
	BB_METRIC_RATIO,    /* deviation over mean, equation 19 */
	BB_METRIC_DEVIATION /* equation 18 alone */
};

struct bb_metric_table {
	const struct bb_metric_colours *colours; /* borrowed */
	enum bb_metric_form form;
	/* log(1 + error): it grows without bound where next to nothing is seen */
	float log_error[BB_METRIC_DEVIATIONS][BB_METRIC_COLOURS];
	float seen[BB_METRIC_DEVIATIONS][BB_METRIC_COLOURS]; /* share of the values that can be seen */
};
void bb_metric_table(const struct bb_metric_colours *c, struct bb_metric_table *out); /* the ratio */
void bb_metric_table_of(const struct bb_metric_colours *c, enum bb_metric_form form, struct bb_metric_table *out);
double bb_metric_look_up(const struct bb_metric_table *t, double mean, double deviation, double least, double most);

/*
 * Errors in time: of a voxel that deviates so far over time, expected over the values there are in a brick of such mean
 * and deviation. Made from the table above, which has the error of a voxel of this mean.
 */
#define BB_METRIC_TIME_ROWS 16
#define BB_METRIC_TIME_DEVIATIONS 12
#define BB_METRIC_TIME_MEANS 128
struct bb_metric_times {
	const struct bb_metric_colours *colours; /* borrowed */
	float log_error[BB_METRIC_TIME_ROWS][BB_METRIC_TIME_DEVIATIONS][BB_METRIC_TIME_MEANS];
};
void bb_metric_times(const struct bb_metric_table *t, struct bb_metric_times *out);
double bb_metric_look_up_time(const struct bb_metric_times *t, double mean, double deviation, double least, double most,
			      double time_deviation);

/* Of every brick of a file, [n_bricks]: its spatial error, and its temporal one by equation 20. */
void bb_metric_rate(const struct bb_bricks *b, const struct bb_metric_table *t, float *space, float *time);
/* The same with the temporal one by bb_metric_look_up_time. */
void bb_metric_rate_local(const struct bb_bricks *b, const struct bb_metric_table *t,
			  const struct bb_metric_times *times, float *space, float *time);
double bb_metric_deviation_of_row(int row); /* of the first table's */

/*
 * The reference metrics of every brick, from every voxel of the leaves of all single steps, read once; sums of colours
 * go up both trees. Takes 88 bytes a brick, and a byte a step for each voxel of a leaf. Errors as of bb_bricks_read; 1702.
 */
BB_MUST_CHECK enum bb_status bb_metric_rate_reference(const struct bb_bricks *b, const struct bb_metric_colours *c,
						      float *space, float *time, struct bb_error *err);
/*
 * In space from the value histograms, for those bricks alone whose values deviate by more than a bin: they need not be
 * normally distributed. space has the others already (bb_metric_rate).
 */
BB_MUST_CHECK enum bb_status bb_metric_rate_histograms(const struct bb_bricks *b, const struct bb_metric_colours *c,
						       float *space, struct bb_error *err);

/*
 * Scalar metrics (equations 1 to 6): the coefficient of variation as it stands, which is nothing or infinite where the
 * mean is zero; Sand's (2014), the deviation itself, divided by nothing, so that a tolerance means something else in
 * every unit; and ours, whose mean stays a thousandth of the data's range away from zero: always finite, and the same
 * in every unit.
 */
enum bb_metric_scalar { BB_SCALAR_BARE, BB_SCALAR_SAND, BB_SCALAR_GUARDED, BB_METRIC_SCALARS };
double bb_metric_scalar(enum bb_metric_scalar guard, double mean, double deviation, double range);
/* Of every brick. In time the file has guarded coefficients and bare deviations; the bare coefficient is the former. */
void bb_metric_rate_scalar(const struct bb_bricks *b, enum bb_metric_scalar guard, float *space, float *time);

/* Numbers of the bricks from the largest error down; equal ones by number. scratch and order: n entries each. */
void bb_metric_order(const float *error, uint32_t n, uint64_t *scratch, uint32_t *order);

#endif
