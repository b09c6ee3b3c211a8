#include "bench/track/cover.h"

#include <math.h>
#include <stdlib.h>

#include "bench/file.h"
#include "bench/stats.h"
#include "hal/clock.h"
#include "render/parallel.h"
#include "sim/sim_camera.h"
#include "sim/world.h"

const char *bb_cover_body_text(enum bb_coverage_body body)
{
	static const char *const text[BB_COVERAGE_BODIES] = { "none", "mean", "worst" };

	return text[body];
}

/* A marker in the middle of those of the glasses. */
static struct bb_viewer_shape viewer_of(const struct bb_room *room)
{
	const struct sim_viewer_shape s = sim_viewer_shape(room);
	struct bb_vec3 centre = { 0, 0, 0 }, eyes = { 0, 0, 0 };

	if (room->n_bodies) {
		const struct bb_body *glasses = &room->bodies[0];
		for (size_t i = 0; i < glasses->n_markers; i++)
			centre = bb_vec3_add(centre, bb_vec3_scale(glasses->marker[i], 1 / (double)glasses->n_markers));
		eyes = glasses->eye_centre;
	}
	return (struct bb_viewer_shape){ .head = bb_vec3_add(bb_vec3_sub(eyes, centre), s.head_centre),
					 .head_radius_m = s.head_radius_m,
					 .torso_top_m = s.torso_top_m,
					 .torso_bottom_m = s.torso_bottom_m,
					 .torso_radius_m = s.torso_radius_m };
}

struct bb_coverage_config bb_cover_config(const struct bb_room *room, const struct bb_cover_wishes *w)
{
	return (struct bb_coverage_config){ .room = room,
					    .cameras = room->cameras,
					    .n_cameras = room->n_cameras,
					    .viewer = viewer_of(room),
					    .headings = w->headings,
					    .marker_m = w->marker_m,
					    .least_px = w->least_px,
					    .near_m = SIM_CAMERA_NEAR_M,
					    .far_m = SIM_CAMERA_FAR_M,
					    .noise_px = w->noise_px };
}

enum bb_status bb_cover_begin(const struct bb_room *room, const struct bb_cover_wishes *w, struct bb_cover *out,
			      struct bb_error *err)
{
	const struct bb_where where = { room->path, 0, 0 };
	size_t bad;

	*out = (struct bb_cover){ .room = room, .config = bb_cover_config(room, w), .threads = w->threads };
	if (!room->n_cameras)
		return bb_fail(err, BB_ERR_CONFIG, 1750, &where, "room %s", room->name);
	if (!bb_coverage_grid_over(w->boxed ? w->min : room->min, w->boxed ? w->max : room->max, w->voxel_m, &out->grid))
		return bb_fail(err, BB_ERR_CONFIG, 1751, &where, "voxels of %g mm in a box of %.3g x %.3g x %.3g m",
			       1e3 * w->voxel_m, (w->boxed ? w->max : room->max).x - (w->boxed ? w->min : room->min).x,
			       (w->boxed ? w->max : room->max).y - (w->boxed ? w->min : room->min).y,
			       (w->boxed ? w->max : room->max).z - (w->boxed ? w->min : room->min).z);
	const enum bb_status status = bb_coverage_create(&out->config, &out->model, &bad);
	if (status == BB_ERR_NOMEM)
		return bb_fail(err, status, 1702, NULL, "coverage");
	if (status && bad == room->n_cameras) /* all other numbers are within what the wishes can say */
		return bb_fail(err, status, 1013, &where, "the glasses' markers: %.3g m from the head, 2 at most",
			       bb_vec3_norm(out->config.viewer.head));
	if (status)
		return bb_fail(err, status, 1110, &where, "camera/%s has no lens that makes a picture", room->cameras[bad].id);
	return BB_OK;
}

static void row(void *ctx, size_t i, unsigned thread)
{
	struct bb_cover *c = ctx;

	(void)thread;
	bb_coverage_row(c->model, &c->grid, i, c->voxels + i * c->grid.n[0]);
}

enum bb_status bb_cover_run(struct bb_cover *c, struct bb_error *err)
{
	const size_t n = bb_coverage_rows(&c->grid) * c->grid.n[0];
	const int64_t start_ns = bb_clock_stopwatch_ns();

	c->voxels = malloc(n * sizeof(*c->voxels));
	if (!c->voxels)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu voxels", n);
	bb_parallel(c->threads, bb_coverage_rows(&c->grid), row, c);
	for (size_t i = 0; i < n; i++)
		c->n_inside += c->voxels[i].inside;
	c->run_s = (double)(bb_clock_stopwatch_ns() - start_ns) * 1e-9;
	return c->n_inside ? BB_OK : bb_fail(err, BB_ERR_CONFIG, 1751, NULL, "no voxel of the box lies in the room");
}

void bb_cover_end(struct bb_cover *c)
{
	bb_coverage_destroy(c->model);
	free(c->voxels);
	*c = (struct bb_cover){ 0 };
}

/* The values of one field of all voxels inside, sorted. */
static void gather(const struct bb_cover *c, enum bb_coverage_body body, int field, double *out)
{
	const size_t n = bb_coverage_rows(&c->grid) * c->grid.n[0];
	size_t k = 0;

	for (size_t i = 0; i < n; i++) {
		const struct bb_coverage_voxel *v = &c->voxels[i];
		if (v->inside)
			out[k++] = (double)(field == 0 ? v->n : field == 1 ? v->error_m : v->worst_m)[body];
	}
	bb_stats_sort(out, k);
}

/* 1 / error, 0 without a position; on average over headings those without one count as 0 too. */
static double weakest_m(const struct bb_cover *c, enum bb_coverage_body body, double *worth)
{
	const size_t n = bb_coverage_rows(&c->grid) * c->grid.n[0], tenth = (c->n_inside + 9) / 10;
	double sum = 0;
	size_t k = 0;

	for (size_t i = 0; i < n; i++) {
		const struct bb_coverage_voxel *v = &c->voxels[i];
		const double share = body == BB_COVERAGE_MEAN ? 1 - (double)v->lost : 1;
		if (v->inside)
			worth[k++] = isfinite(v->error_m[body]) ? share / (double)v->error_m[body] : 0;
	}
	bb_stats_sort(worth, k);
	for (size_t i = 0; i < tenth; i++)
		sum += worth[i];
	return sum > 0 ? (double)tenth / sum : HUGE_VAL;
}

static size_t below(const double *sorted, size_t n, double v)
{
	size_t low = 0, high = n;

	while (low < high) {
		const size_t mid = (low + high) / 2;
		if (sorted[mid] < v)
			low = mid + 1;
		else
			high = mid;
	}
	return low;
}

enum bb_status bb_cover_summarise(const struct bb_cover *c, enum bb_coverage_body body, const unsigned *levels,
				  size_t n_levels, struct bb_cover_summary *out)
{
	const size_t n = c->n_inside;
	double *v = malloc(n * sizeof(*v));

	*out = (struct bb_cover_summary){ 0 };
	if (!v)
		return BB_ERR_NOMEM;
	gather(c, body, 0, v);
	out->p10_n = bb_stats_nearest_rank(v, n, 0.1);
	for (size_t i = 0; i < n_levels; i++)
		out->share[i] = (double)(n - below(v, n, levels[i] - 1e-6)) / (double)n;
	gather(c, body, 1, v);
	out->placed = (double)below(v, n, HUGE_VAL) / (double)n;
	out->p50_m = bb_stats_nearest_rank(v, n, 0.5);
	out->p90_m = bb_stats_nearest_rank(v, n, 0.9);
	gather(c, body, 2, v);
	out->worst_p90_m = bb_stats_nearest_rank(v, n, 0.9);
	out->weak_m = weakest_m(c, body, v);
	free(v);
	return BB_OK;
}
