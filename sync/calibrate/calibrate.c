/* sync/calibrate/calibrate.c: see calibrate.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sync/calibrate/calibrate_private.h"

#define LEAST_PICTURES 30  /* of a camera, chosen ones */
#define LEAST_CELLS 4
#define REJECT_SIGMAS 4.0  /* of 3000 good markers one is lost */
#define MEDIAN_OF_RADIUS 1.17741 /* sqrt(2 ln 2), in sigmas of one coordinate */
#define WORST_SIGMA_PX 5.0 /* more than that is no solution */

static enum bb_status adjust(struct bb_calibration *c, double cauchy_px, unsigned steps, double tolerance)
{
	c->bundle.cauchy_px = cauchy_px;
	enum bb_status status = bb_bundle_run(&c->bundle, steps, tolerance);
	c->steps += c->bundle.steps;
	return status ? status : bb_bundle_residuals(&c->bundle);
}

/* Noise of one coordinate from the middle distance: what is far off does not count. */
static double robust_sigma(const struct bb_bundle *b)
{
	double *r = malloc((b->n_obs + 1) * sizeof(*r)), sigma = (double)INFINITY;
	size_t n = 0;

	for (size_t i = 0; r && i < b->n_obs; i++)
		if (!b->obs[i].out && isfinite(b->obs[i].off_px[0]))
			r[n++] = hypot((double)b->obs[i].off_px[0], (double)b->obs[i].off_px[1]);
	if (n)
		sigma = fmax(bb_median(r, n) / MEDIAN_OF_RADIUS, 1e-4);
	free(r);
	return sigma;
}

/* The loss narrows, so that cameras that were planned elsewhere come near before anything is called wrong. */
static enum bb_status narrow(struct bb_calibration *c, double from_px, double *sigma_px)
{
	enum bb_status status = BB_OK;
	double px = from_px;

	while (!status && px > 1) {
		status = adjust(c, px, 12, 1e-3);
		px /= 2.5;
	}
	*sigma_px = robust_sigma(&c->bundle);
	if (!status)
		status = adjust(c, fmax(1, 3 * *sigma_px), 12, 1e-4);
	*sigma_px = robust_sigma(&c->bundle);
	for (int i = 0; !status && i < 2; i++) {
		status = adjust(c, 3 * *sigma_px, 20, 1e-6);
		*sigma_px = robust_sigma(&c->bundle);
	}
	return status;
}

/* From before its camera was knocked: the camera is no longer where it saw that. */
static bool is_stale(const struct bb_calibration *c, const struct bb_bundle_obs *o)
{
	const struct bb_calibrate_camera *r = o->camera < c->n_cameras ? &c->report[o->camera] : NULL;

	return r && r->knocked && c->rod_ns[o->rod] < r->knocked_ns;
}

static void leave_out(struct bb_calibration *c, double most_px)
{
	for (size_t i = 0; i < c->bundle.n_obs; i++) {
		struct bb_bundle_obs *o = &c->bundle.obs[i];
		o->out = is_stale(c, o) || !(hypot((double)o->off_px[0], (double)o->off_px[1]) <= most_px);
	}
}

/* A wand that is left with fewer than four markers, or one camera, says next to nothing; its markers go, too. */
static void drop_weak_rods(struct bb_calibration *c)
{
	struct bb_bundle *b = &c->bundle;

	for (size_t i = 0, next; i < b->n_obs; i = next) {
		size_t n = 0, cameras = 0;
		int last = -1;
		for (next = i; next < b->n_obs && b->obs[next].rod == b->obs[i].rod; next++) {
			if (b->obs[next].out)
				continue;
			n++;
			cameras += b->obs[next].camera != last;
			last = b->obs[next].camera;
		}
		for (size_t k = i; k < next && (n < 4 || cameras < 2); k++)
			b->obs[k].out = true;
	}
}

/* Counts what was used, and what it scatters by. */
static void sum_up(struct bb_calibration *c)
{
	const struct bb_bundle *b = &c->bundle;
	double square = 0, *per_camera = calloc(c->n_cameras, sizeof(*per_camera));
	uint64_t *cells = calloc(c->n_cameras, sizeof(*cells));
	size_t n_rods = 0, last = SIZE_MAX, n_before = 0;

	c->n_used = c->n_out = c->n_knocked = 0;
	for (size_t i = 0; i < c->n_cameras; i++)
		c->report[i].n_used = c->report[i].n_out = 0;
	for (size_t i = 0; per_camera && cells && i < b->n_obs; i++) {
		const struct bb_bundle_obs *o = &b->obs[i];
		const double x = (double)o->off_px[0], y = (double)o->off_px[1];
		const bool before = o->camera >= c->n_cameras; /* it was knocked */
		if (!before) {
			c->report[o->camera].n_used += !o->out;
			c->report[o->camera].n_out += o->out && !is_stale(c, o);
		}
		if (o->out)
			continue;
		n_rods += o->rod != last;
		last = o->rod;
		square += x * x + y * y;
		n_before += before;
		if (before)
			continue;
		per_camera[o->camera] += x * x + y * y;
		cells[o->camera] |= UINT64_C(1) << bb_calibrate_cell(&c->cameras[o->camera], o->px[0], o->px[1]);
	}
	for (size_t i = 0; i < c->n_cameras; i++) {
		c->n_used += c->report[i].n_used;
		c->n_out += c->report[i].n_out;
		c->n_knocked += c->report[i].knocked;
	}
	/* 11 a camera, 6 for where one hung before and 5 a wand were fitted, of which 6 are the free place of all */
	c->freedom = 2 * (double)(c->n_used + n_before) - (double)(BB_BUNDLE_CAMERA * c->n_cameras + BB_BUNDLE_ROD * n_rods) -
	             6 * (double)(b->n_cameras - c->n_cameras) + 6;
	c->rms_px = c->freedom > 0 ? sqrt(square / c->freedom) : (double)INFINITY;
	for (size_t i = 0; per_camera && cells && i < c->n_cameras; i++) {
		struct bb_calibrate_camera *r = &c->report[i];
		const double share = c->freedom / (2 * (double)(c->n_used + n_before));
		r->rms_px = r->n_used ? sqrt(per_camera[i] / (2 * (double)r->n_used * share)) : 0;
		r->covered = (double)__builtin_popcountll(cells[i]) / (BB_CALIBRATE_CELLS_X * BB_CALIBRATE_CELLS_Y);
	}
	free(per_camera);
	free(cells);
}

static enum bb_status check_seen(const struct bb_calibration *c, struct bb_error *err)
{
	for (size_t i = 0; i < c->n_cameras; i++) {
		const struct bb_calibrate_camera *r = &c->report[i];
		const bool few = r->n_used < 3 * LEAST_PICTURES || r->covered * BB_CALIBRATE_CELLS_X * BB_CALIBRATE_CELLS_Y < LEAST_CELLS;
		if (few && r->knocked)
			return bb_fail(err, BB_ERR_CONFIG, 1743, NULL, "'%s' moved %.1f s into the dance, and saw %zu markers since",
			               c->cameras[i].id, (double)r->knocked_ns * 1e-9, r->n_used);
		if (few)
			return bb_fail(err, BB_ERR_CONFIG, 1734, NULL,
			               "'%s' has %zu usable markers in %.0f %% of its picture; %d in 10 %% are the least", c->cameras[i].id,
			               r->n_used, 100 * r->covered, 3 * LEAST_PICTURES);
	}
	return BB_OK;
}

/* Begins again without what a knocked camera saw before. */
static enum bb_status begin_again(struct bb_calibration *c, double *sigma_px)
{
	leave_out(c, (double)INFINITY);
	const enum bb_status status = narrow(c, 16, sigma_px);
	bb_calibrate_time_knocks(c, *sigma_px);
	return status;
}

/* Leaves out what is beyond the noise, and adjusts the rest by squares. */
static enum bb_status finish(struct bb_calibration *c, double sigma_px)
{
	uint16_t *lens_of = calloc(c->n_cameras + BB_CALIBRATE_KNOCKS, sizeof(*lens_of));
	enum bb_status status = BB_OK;

	if (!lens_of)
		return BB_ERR_NOMEM;
	if (bb_calibrate_split(c, lens_of))
		status = narrow(c, 16, &sigma_px);
	for (int i = 0; !status && i < 3; i++) {
		leave_out(c, REJECT_SIGMAS * sigma_px);
		bb_calibrate_doubt(c);
		drop_weak_rods(c);
		status = adjust(c, 0, 20, 1e-9);
		sum_up(c);
		sigma_px = c->rms_px;
	}
	bb_calibrate_join(c);
	free(lens_of);
	return status;
}

/* Everything from the first rough start to the last adjustment by squares. */
static enum bb_status solve(struct bb_calibration *c)
{
	double sigma_px;
	size_t sick;
	enum bb_status status = narrow(c, 40, &sigma_px);

	for (int i = 0; !status && i < BB_CALIBRATE_KNOCKS; i++) {
		if (!bb_calibrate_find_knock(c, sigma_px)) {
			sick = bb_calibrate_find_sick(c, sigma_px);
			if (sick == c->n_cameras)
				break;
			bb_calibrate_halve(c, sick);
		}
		status = begin_again(c, &sigma_px);
	}
	return status ? status : finish(c, sigma_px);
}

static enum bb_status prepare(const struct bb_calibrate_config *config, struct bb_calibration *out, struct bb_error *err)
{
	const size_t n = config->n_cameras;
	struct bb_lens *lenses = calloc(n + 1, sizeof(*lenses));

	out->n_cameras = n;
	out->cameras = calloc(n + BB_CALIBRATE_KNOCKS, sizeof(*out->cameras));
	out->report = calloc(n + 1, sizeof(*out->report));
	enum bb_status status = lenses && out->cameras && out->report ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "cameras");
	for (size_t i = 0; !status && i < n; i++) {
		out->cameras[i] = config->cameras[i];
		if (!bb_lens_init(&lenses[i], &config->cameras[i]))
			status = bb_fail(err, BB_ERR_CONFIG, 1110, NULL, "'%s' has no usable lens", config->cameras[i].id);
	}
	if (!status && bb_calibrate_choose(config, lenses, out))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu pictures", config->sequence->n_sights);
	out->bundle.cameras = out->cameras;
	out->bundle.n_cameras = n;
	out->bundle.prior = config->cameras;
	free(lenses);
	return status;
}

enum bb_status bb_calibrate(const struct bb_calibrate_config *config, struct bb_calibration *out, struct bb_error *err)
{
	const size_t n = config->n_cameras;

	memset(out, 0, sizeof(*out));
	if (config->n_cameras < 2 || config->n_cameras != config->sequence->n_cameras)
		return bb_fail(err, BB_ERR_CONFIG, 1733, NULL, "the sequence has %zu cameras, the room %zu, and two are the least",
		               config->sequence->n_cameras, config->n_cameras);
	enum bb_status status = prepare(config, out, err);
	if (!status)
		sum_up(out); /* before any adjustment: how much there is to begin with */
	if (!status)
		status = check_seen(out, err);
	if (!status) {
		status = solve(out);
		if (status)
			status = bb_fail(err, status, status == BB_ERR_NOMEM ? 1702 : 1736, NULL, "the adjustment broke down");
		else if (bb_calibrate_find_sick(out, out->rms_px) < n)
			status = bb_fail(err, BB_ERR_CONFIG, 1736, NULL, "'%s' saw something else than the others",
			                 out->cameras[bb_calibrate_find_sick(out, out->rms_px)].id);
		else if (!(out->rms_px < WORST_SIGMA_PX))
			status = bb_fail(err, BB_ERR_CONFIG, 1736, NULL, "%.2f px are left over after %u steps", out->rms_px, out->steps);
	}
	if (!status)
		status = check_seen(out, err);
	if (!status)
		status = bb_calibrate_align(config, out, err);
	out->bundle.prior = NULL; /* the caller's */
	if (status)
		bb_calibration_free(out);
	return status;
}

void bb_calibration_free(struct bb_calibration *c)
{
	free(c->cameras);
	free(c->report);
	free(c->bundle.rods);
	free(c->bundle.obs);
	free(c->rod_ns);
	memset(c, 0, sizeof(*c));
}
