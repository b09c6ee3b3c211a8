/* sync/calibrate/knock.c: cameras that moved while the wand was danced: what is left over jumps at one time, all over their
 * picture. */
#include <math.h>
#include <stdlib.h>

#include "sync/calibrate/calibrate_private.h"

#define BINS 24
#define LEAST_IN_BIN 9
#define LEAST_BINS 2     /* on either side */
#define LEAST_SIGMAS 2.5 /* a smaller jump does no harm */
#define CLEAR 1.5        /* times what the spans of either side differ among themselves, in the middle */

static int ascending(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;
	return x < y ? -1 : x > y;
}

double bb_median(double *values, size_t n)
{
	qsort(values, n, sizeof(*values), ascending);
	return n % 2 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

struct bins { /* of one camera: medians over spans of time */
	size_t n;
	double x[BINS], y[BINS];
	int64_t from_ns[BINS];
};

static bool usable(const struct bb_bundle_obs *o, size_t camera)
{
	return o->camera == camera && isfinite(o->off_px[0]);
}

static void fill_bins(const struct bb_calibration *c, size_t camera, double *scratch, struct bins *out)
{
	const struct bb_bundle *b = &c->bundle;
	size_t at = 0;

	out->n = 0;
	for (size_t k = 0; k < BINS; k++) {
		const size_t to_rod = (k + 1) * b->n_rods / BINS, from = at;
		size_t n = 0;
		for (; at < b->n_obs && b->obs[at].rod < to_rod; at++)
			if (usable(&b->obs[at], camera))
				scratch[n++] = (double)b->obs[at].off_px[0];
		if (n < LEAST_IN_BIN)
			continue;
		out->x[out->n] = bb_median(scratch, n);
		n = 0;
		for (size_t i = from; i < at; i++)
			if (usable(&b->obs[i], camera))
				scratch[n++] = (double)b->obs[i].off_px[1];
		out->y[out->n] = bb_median(scratch, n);
		out->from_ns[out->n++] = c->rod_ns[b->obs[from].rod];
	}
}

static double middle(const double *v, size_t n)
{
	double copy[BINS];

	for (size_t i = 0; i < n; i++)
		copy[i] = v[i];
	return bb_median(copy, n);
}

/* Distances of a side's spans from that side's middle: their sum, and the median of them. */
static double spread(const double *x, const double *y, size_t n, double *typical)
{
	const double mx = middle(x, n), my = middle(y, n);
	double far[BINS], sum = 0;

	for (size_t i = 0; i < n; i++) {
		far[i] = hypot(x[i] - mx, y[i] - my);
		sum += far[i];
	}
	*typical = bb_median(far, n);
	return sum;
}

/* Splits the spans where either side is nearest to its own middle, in sum (the wands that few cameras saw follow a knocked
 * one, so that a square would listen to the wrong ones); is the jump between them clear? */
static bool jumps(const struct bins *b, double sigma_px, size_t *split, double jump[2])
{
	double least = (double)INFINITY, within = 0;

	for (size_t k = LEAST_BINS; k + LEAST_BINS <= b->n; k++) {
		double before, after;
		const double sum = spread(b->x, b->y, k, &before) + spread(b->x + k, b->y + k, b->n - k, &after);
		if (sum >= least)
			continue;
		least = sum;
		within = before + after;
		*split = k;
		jump[0] = middle(b->x + k, b->n - k) - middle(b->x, k);
		jump[1] = middle(b->y + k, b->n - k) - middle(b->y, k);
	}
	return isfinite(least) && hypot(jump[0], jump[1]) > fmax(LEAST_SIGMAS * sigma_px, CLEAR * within);
}

/* The time that parts what lies nearer to one side's middle from what lies nearer to the other's best. */
static int64_t when(const struct bb_calibration *c, size_t camera, const struct bins *bins, size_t split)
{
	const struct bb_bundle *b = &c->bundle;
	const double ax = middle(bins->x, split), ay = middle(bins->y, split);
	const double bx = middle(bins->x + split, bins->n - split), by = middle(bins->y + split, bins->n - split);
	int64_t best_ns = bins->from_ns[split];
	int score = 0, best = -1;

	for (size_t i = 0; i < b->n_obs; i++) {
		const struct bb_bundle_obs *o = &b->obs[i];
		const int64_t t_ns = c->rod_ns[o->rod];
		if (!usable(o, camera) || t_ns < bins->from_ns[split - 1] ||
		    (split + 1 < bins->n && t_ns >= bins->from_ns[split + 1]))
			continue;
		const double x = (double)o->off_px[0], y = (double)o->off_px[1];
		score += hypot(x - ax, y - ay) < hypot(x - bx, y - by) ? 1 : -1;
		if (score > best) {
			best = score;
			best_ns = t_ns + 1;
		}
	}
	return best_ns;
}

bool bb_calibrate_find_knock(struct bb_calibration *c, double sigma_px)
{
	double *scratch = malloc((c->bundle.n_obs + 1) * sizeof(*scratch)), best = 0;
	size_t worst = 0;
	struct bb_calibrate_camera found = { .knocked = false };

	for (size_t i = 0; scratch && i < c->n_cameras; i++) {
		struct bins bins;
		double jump[2] = { 0, 0 };
		size_t split = 0;
		if (c->report[i].knocked)
			continue;
		fill_bins(c, i, scratch, &bins);
		/* what the knocked camera does to the others is clear, too, but smaller */
		if (jumps(&bins, sigma_px, &split, jump) && hypot(jump[0], jump[1]) > best) {
			best = hypot(jump[0], jump[1]);
			worst = i;
			found = c->report[i];
			found.knocked = true;
			found.knocked_ns = when(c, i, &bins, split);
			found.knock_px[0] = jump[0];
			found.knock_px[1] = jump[1];
		}
	}
	free(scratch);
	if (!found.knocked)
		return false;
	c->report[worst] = found;
	return true;
}
