/*
 * render/bricks/gain.h: what it gains to show a brick's children instead of it, from its histograms and a transfer
 * function (Carlsson and Tjernstroem 2016, section 3.3). An edit of the transfer function costs one pass over the
 * histograms.
 *
 * opacity      sum of opacity times values, for either split (eq. 3.4)
 * leaf error   how much of the error against the leaves goes away (eq. 3.8), error as in eq. 3.6 and 3.7
 * child error  the error against the spatial, or temporal, children (eq. 3.9)
 * far error    ours: as leaf error, but of all depths of splitting in space, or in time, the one that takes most of the
 *              error away for each brick. Where the children are no better than their parent and the grandchildren
 *              are, leaf error gains nothing and stops there, whatever is left of the budget.
 *
 * A split in space takes eight bricks for one, in time two, so gains are divided by these numbers. (Equations 3.2
 * and 3.3 of the source have the two divisors the other way round, against their own text: a split in time is the
 * cheaper one.)
 */
#ifndef BB_RENDER_BRICKS_GAIN_H
#define BB_RENDER_BRICKS_GAIN_H

#include "render/bricks/bricks.h"
#include "render/bricks/metric.h"

enum bb_gain_method { BB_GAIN_OPACITY, BB_GAIN_LEAF, BB_GAIN_CHILD, BB_GAIN_FAR, BB_GAIN_METHODS };
const char *bb_gain_method_text(enum bb_gain_method method);

/*
 * Weight of each bin: how visible its values are, and how fast the picture changes there. By colours as they are
 * mixed: the opacity, and the change of colour and opacity times the opacity (eq. 3.7). As they are seen: the distance
 * in CIE L*a*b*, in hundreds, of a slab of BB_GAIN_SLAB_VOXELS of that value over black, from black, and from a slab of
 * a value beside it.
 */
enum bb_gain_colour { BB_GAIN_RGB, BB_GAIN_LAB, BB_GAIN_COLOURS };
const char *bb_gain_colour_text(enum bb_gain_colour colour);
#define BB_GAIN_SLAB_VOXELS 8
struct bb_gain_weights {
	float opacity[BB_STATS_BINS], change[BB_STATS_BINS];
};
void bb_gain_weights(const struct bb_transfer *tf, struct bb_gain_weights *out); /* RGB */
void bb_gain_weights_of(const struct bb_transfer *tf, enum bb_gain_colour colour, struct bb_gain_weights *out);

/*
 * Split points of all bricks, [n_bricks]; -1: there is nothing to split into. work: [n_bricks], afterwards with leaf
 * and far error the leaf error of every brick, else of no use. Errors as of bb_bricks_histograms; 1702.
 */
BB_MUST_CHECK enum bb_status bb_gain_points(const struct bb_bricks *b, const struct bb_gain_weights *w,
					    enum bb_gain_method method, float *space, float *time, float *work,
					    struct bb_error *err);
/*
 * After gains by leaf error: children may be no better than their parent where grandchildren are (the mean of a front is as
 * wrong in eight parts as in one), and a greedy choice would stop there with its budget unspent. A split is worth at least
 * a hundredth of what its brick is wrong by. error: the work of bb_gain_points.
 */
void bb_gain_press_on(const float *error, uint64_t n_bricks, float *space, float *time);

#endif
