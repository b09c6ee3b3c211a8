/*
 * render/stream/count.c: what drawing a view would cost, counted without drawing: 32 x 24 rays through the middles of
 * equal cells of the screen stand for all its pixels. rays = those that meet the volume's box, samples = one a step of
 * their way through it, both times pixels / 768 rounded down. A pure function of view, placement and step.
 */
#include "render/stream/stream_private.h"

#include <math.h>

#define COLUMNS 32
#define ROWS 24
#define SAMPLES_MOST 1e6 /* of one ray: keeps sums within 64 bits whatever the step */

/* Length of the ray from o along the unit vector d inside the box of half edges h; 0 when they miss. */
static double way_through(const double o[3], const double d[3], const double h[3])
{
	double enter = 0, leave = HUGE_VAL;

	for (int a = 0; a < 3; a++) {
		if (fabs(d[a]) < 1e-15) {
			if (fabs(o[a]) > h[a])
				return 0;
			continue;
		}
		const double t1 = (-h[a] - o[a]) / d[a], t2 = (h[a] - o[a]) / d[a];
		enter = fmax(enter, fmin(t1, t2));
		leave = fmin(leave, fmax(t1, t2));
	}
	return leave > enter && leave < HUGE_VAL ? leave - enter : 0;
}

/* A step is measured along the longest edge of the volume. */
static double step_length_m(const struct bb_stream_config *config, double step_voxels)
{
	const struct bb_vec3 size = config->placement.size_m;
	const double edge[3] = { size.x, size.y, size.z };
	int longest = 0;

	for (int a = 1; a < 3; a++)
		if (edge[a] > edge[longest])
			longest = a;
	return step_voxels * edge[longest] / config->volume->dim[longest];
}

void bb_count_rays(const struct bb_stream_config *config, const struct bb_view *view, uint32_t width_px,
                   uint32_t height_px, double step_voxels, struct bb_stream_counts *counts)
{
	const struct bb_placement *place = &config->placement;
	const struct bb_vec3 eye = bb_pose_inverse_apply(&place->pose, view->eye);
	const struct bb_vec3 ll = bb_pose_inverse_apply(&place->pose, view->corners.lower_left);
	const struct bb_vec3 lr = bb_pose_inverse_apply(&place->pose, view->corners.lower_right);
	const struct bb_vec3 ul = bb_pose_inverse_apply(&place->pose, view->corners.upper_left);
	const struct bb_vec3 across = bb_vec3_sub(lr, ll), up = bb_vec3_sub(ul, ll), from = bb_vec3_sub(ll, eye);
	const double o[3] = { eye.x, eye.y, eye.z };
	const double h[3] = { place->size_m.x / 2, place->size_m.y / 2, place->size_m.z / 2 };
	const double step_m = step_length_m(config, step_voxels);
	uint64_t rays = 0, samples = 0;

	if (!(step_m > 0))
		return;
	for (int j = 0; j < ROWS; j++)
		for (int i = 0; i < COLUMNS; i++) {
			struct bb_vec3 d = bb_vec3_add(from, bb_vec3_scale(across, (i + 0.5) / COLUMNS));
			d = bb_vec3_unit(bb_vec3_add(d, bb_vec3_scale(up, (j + 0.5) / ROWS)), (struct bb_vec3){ 0, 0, -1 });
			const double way_m = way_through(o, (const double[]){ d.x, d.y, d.z }, h);
			if (!(way_m > 0))
				continue;
			rays++; /* samples stand at (k + 0.5) steps */
			samples += (uint64_t)fmin(way_m / step_m + 0.5, SAMPLES_MOST);
		}
	counts->rays += rays * width_px * height_px / (COLUMNS * ROWS);
	counts->samples += samples * width_px * height_px / (COLUMNS * ROWS);
}
