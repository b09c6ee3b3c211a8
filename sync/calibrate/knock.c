/* sync/calibrate/knock.c: cameras that moved while the wand was danced: what is left over jumps at one time. */
#include <math.h>
#include <stdlib.h>

#include "sync/calibrate/calibrate_private.h"

#define SPANS 24
#define LEAST_IN_SPAN 9
#define LEAST_SPANS 2    /* on either side */
#define FAR_SIGMAS 4.0
#define SICK_SHARE 0.4   /* of a camera's markers are far off or were left out: it saw something else than the others */
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

/*
 * What is looked at: where to a camera's markers are off, which is clear when it was turned and the adjustment found a place
 * between; and how far, which is clear when it was rolled or shifted, and the adjustment took one side for outliers.
 */
enum look { WHERE_TO, HOW_FAR };

struct spans { /* of one camera: medians over spans of time */
	enum look look;
	size_t n;
	double x[SPANS], y[SPANS]; /* y is 0 of HOW_FAR */
	int64_t from_ns[SPANS];
};

static bool usable(const struct bb_bundle_obs *o, size_t camera)
{
	return o->camera == camera && isfinite(o->off_px[0]);
}

static double part(const struct bb_bundle_obs *o, enum look look, int axis)
{
	if (look == WHERE_TO)
		return (double)o->off_px[axis];
	return axis ? 0 : hypot((double)o->off_px[0], (double)o->off_px[1]);
}

static void fill(const struct bb_calibration *c, size_t camera, enum look look, double *scratch, struct spans *out)
{
	const struct bb_bundle *b = &c->bundle;
	size_t at = 0;

	out->look = look;
	out->n = 0;
	for (size_t k = 0; k < SPANS; k++) {
		const size_t to_rod = (k + 1) * b->n_rods / SPANS, from = at;
		double middle[2];
		while (at < b->n_obs && b->obs[at].rod < to_rod)
			at++;
		size_t n = 0;
		for (int axis = 0; axis < 2; axis++) {
			n = 0;
			for (size_t i = from; i < at; i++)
				if (usable(&b->obs[i], camera))
					scratch[n++] = part(&b->obs[i], look, axis);
			middle[axis] = n ? bb_median(scratch, n) : 0;
		}
		if (n < LEAST_IN_SPAN)
			continue;
		out->x[out->n] = middle[0];
		out->y[out->n] = middle[1];
		out->from_ns[out->n++] = c->rod_ns[b->obs[from].rod];
	}
}

static double middle(const double *v, size_t n)
{
	double copy[SPANS];

	for (size_t i = 0; i < n; i++)
		copy[i] = v[i];
	return bb_median(copy, n);
}

/* Distances of a side's spans from that side's middle: their sum, and the median of them. */
static double spread(const double *x, const double *y, size_t n, double *typical)
{
	const double mx = middle(x, n), my = middle(y, n);
	double far[SPANS], sum = 0;

	for (size_t i = 0; i < n; i++) {
		far[i] = hypot(x[i] - mx, y[i] - my);
		sum += far[i];
	}
	*typical = bb_median(far, n);
	return sum;
}

/* Splits the spans where either side is nearest to its own middle, in sum (the wands that few cameras saw follow a knocked
 * one, so that squares would listen to the wrong ones); is the jump between them clear? */
static bool jumps(const struct spans *s, double sigma_px, size_t *split, double jump[2])
{
	double least = (double)INFINITY, within = 0;

	for (size_t k = LEAST_SPANS; k + LEAST_SPANS <= s->n; k++) {
		double before, after;
		const double sum = spread(s->x, s->y, k, &before) + spread(s->x + k, s->y + k, s->n - k, &after);
		if (sum >= least)
			continue;
		least = sum;
		within = before + after;
		*split = k;
		jump[0] = middle(s->x + k, s->n - k) - middle(s->x, k);
		jump[1] = middle(s->y + k, s->n - k) - middle(s->y, k);
	}
	return isfinite(least) && hypot(jump[0], jump[1]) > fmax(LEAST_SIGMAS * sigma_px, CLEAR * within);
}

/* The time that parts what lies nearer to one side's middle from what lies nearer to the other's best. */
static int64_t when(const struct bb_calibration *c, size_t camera, const struct spans *s, size_t split)
{
	const struct bb_bundle *b = &c->bundle;
	const double ax = middle(s->x, split), ay = middle(s->y, split);
	const double bx = middle(s->x + split, s->n - split), by = middle(s->y + split, s->n - split);
	int64_t best_ns = s->from_ns[split];
	int score = 0, best = -1;

	for (size_t i = 0; i < b->n_obs; i++) {
		const struct bb_bundle_obs *o = &b->obs[i];
		const int64_t t_ns = c->rod_ns[o->rod];
		if (!usable(o, camera) || t_ns < s->from_ns[split - 1] || (split + 1 < s->n && t_ns >= s->from_ns[split + 1]))
			continue;
		const double x = part(o, s->look, 0), y = part(o, s->look, 1);
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
	size_t worst = c->n_cameras;
	int64_t when_ns = 0;

	for (size_t k = 0; scratch && k < 2 * c->n_cameras; k++) {
		const size_t camera = k / 2;
		struct spans s;
		double jump[2] = { 0, 0 };
		size_t split = 0;
		if (c->report[camera].knocked)
			continue;
		fill(c, camera, k % 2 ? HOW_FAR : WHERE_TO, scratch, &s);
		/* what the knocked camera does to the others may be clear, too, but is smaller */
		if (!jumps(&s, sigma_px, &split, jump) || hypot(jump[0], jump[1]) <= best)
			continue;
		best = hypot(jump[0], jump[1]);
		worst = camera;
		when_ns = when(c, camera, &s, split);
	}
	free(scratch);
	if (worst == c->n_cameras)
		return false;
	c->report[worst].knocked = true;
	c->report[worst].knocked_ns = when_ns;
	return true;
}

size_t bb_calibrate_find_sick(const struct bb_calibration *c, double sigma_px)
{
	const struct bb_bundle *b = &c->bundle;
	size_t sickest = c->n_cameras;
	double most = SICK_SHARE;

	for (size_t k = 0; k < c->n_cameras; k++) {
		size_t n = 0, far = 0;
		for (size_t i = 0; i < b->n_obs; i++) {
			const struct bb_bundle_obs *o = &b->obs[i];
			if (o->camera != k || (c->report[k].knocked && c->rod_ns[o->rod] < c->report[k].knocked_ns))
				continue;
			n++;
			far += o->out || !(part(o, HOW_FAR, 0) <= FAR_SIGMAS * sigma_px);
		}
		if ((double)far > most * (double)n) {
			most = (double)far / (double)n;
			sickest = k;
		}
	}
	return sickest;
}

void bb_calibrate_halve(struct bb_calibration *c, size_t camera)
{
	struct bb_calibrate_camera *r = &c->report[camera];
	const struct bb_bundle *b = &c->bundle;
	size_t n = 0, at = 0;

	for (int pass = 0; pass < 2; pass++) /* count them, then stop at the middle one */
		for (size_t i = 0; i < b->n_obs; i++) {
			const int64_t t_ns = c->rod_ns[b->obs[i].rod];
			if (b->obs[i].camera != camera || (r->knocked && t_ns < r->knocked_ns))
				continue;
			if (!pass) {
				n++;
			} else if (at++ == n / 2) {
				r->knocked = true;
				r->knocked_ns = t_ns;
				return;
			}
		}
}

/* Median distance of what a camera saw before it was knocked. */
static double jump_of(const struct bb_calibration *c, size_t camera, double *scratch)
{
	size_t n = 0;

	for (size_t i = 0; i < c->bundle.n_obs; i++) {
		const struct bb_bundle_obs *o = &c->bundle.obs[i];
		if (usable(o, camera) && c->rod_ns[o->rod] < c->report[camera].knocked_ns)
			scratch[n++] = part(o, HOW_FAR, 0);
	}
	return n ? bb_median(scratch, n) : 0;
}

void bb_calibrate_time_knocks(struct bb_calibration *c, double sigma_px)
{
	const struct bb_bundle *b = &c->bundle;
	double *scratch = malloc((b->n_obs + 1) * sizeof(*scratch));

	for (size_t k = 0; k < c->n_cameras; k++) {
		int score = 0, best = 0;
		int64_t best_ns = c->rod_ns[0];
		for (size_t i = 0; i < b->n_obs && c->report[k].knocked; i++) {
			const struct bb_bundle_obs *o = &b->obs[i];
			if (!usable(o, k))
				continue;
			score += part(o, HOW_FAR, 0) > FAR_SIGMAS * sigma_px ? 1 : -1;
			if (score > best) {
				best = score;
				best_ns = c->rod_ns[o->rod] + 1;
			}
		}
		if (!c->report[k].knocked)
			continue;
		c->report[k].knocked_ns = best_ns;
		if (scratch)
			c->report[k].knock_px = jump_of(c, k, scratch);
	}
	free(scratch);
}
