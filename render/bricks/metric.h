/*
 * render/bricks/metric.h: how wrong a brick would look, from what its file says of it and a transfer function: the
 * colour metrics of Ellsworth, Chiang and Shen 2000 (section 5, equations 7 to 20). Values are parts 0..1 of the data's
 * range, a transfer function is 256 entries, as theirs. An error is the deviation of colours over their mean, both
 * weighted by opacity; 0 where nothing can be seen.
 *
 * The reference metrics look at every voxel; they judge the others. The approximate spatial metric assumes that a
 * brick's values are normally distributed; a table over mean and deviation is made once for each edit of the transfer
 * function, and a brick then costs one look into it. Stateless; a table is constant once made.
 */
#ifndef BB_RENDER_BRICKS_METRIC_H
#define BB_RENDER_BRICKS_METRIC_H

#include "render/bricks/bricks.h"
#include "render/transfer.h"

#define BB_METRIC_COLOURS 256
#define BB_METRIC_DEVIATIONS 48

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

struct bb_metric_table {
	const struct bb_metric_colours *colours; /* borrowed */
	/* log(1 + error): it grows without bound where next to nothing is seen */
	float log_error[BB_METRIC_DEVIATIONS][BB_METRIC_COLOURS];
};
void bb_metric_table(const struct bb_metric_colours *c, struct bb_metric_table *out);
double bb_metric_look_up(const struct bb_metric_table *t, double mean, double deviation, double least, double most);

/* Of every brick of a file, [n_bricks]: its spatial error, and its temporal one by equation 20. */
void bb_metric_rate(const struct bb_bricks *b, const struct bb_metric_table *t, float *space, float *time);
/* Numbers of the bricks from the largest error down; equal ones by number. scratch and order: n entries each. */
void bb_metric_order(const float *error, uint32_t n, uint64_t *scratch, uint32_t *order);

#endif
