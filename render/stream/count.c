/*
 * render/stream/count.c: what drawing a view would cost, counted without drawing: 32 x 24 rays through the middles of
 * equal cells of the screen stand for all its pixels. rays = those that meet the volume's box, samples = one a step of
 * their way through it, both times pixels / 768 rounded down. A pure function of view, placement and step.
 */
#include "render/renderer_driver.h"
#include "render/stream/stream_private.h"

#include <math.h>

#define COLUMNS 32
#define ROWS 24
#define SAMPLES_MOST 1e6 /* of one ray: keeps sums within 64 bits whatever the step */

struct beam { /* rays of one view: from o through corner + u * across + v * up, volume space */
	double o[3], corner[3], across[3], up[3];
	double half_m[3];
};

static void put(struct bb_vec3 v, double out[3])
{
	out[0] = v.x;
	out[1] = v.y;
	out[2] = v.z;
}

/* Way of one ray inside the box; 0 when they miss. Comparisons rather than fmin, which is a call. */
static double way_through_m(const struct beam *beam, double u, double v)
{
	double enter = 0, leave = 1e300, square = 0;

	for (int a = 0; a < 3; a++) {
		const double o = beam->o[a], h = beam->half_m[a];
		const double d = beam->corner[a] + beam->across[a] * u + beam->up[a] * v - o;
		square += d * d;
		if (d > -1e-12 && d < 1e-12) {
			if (o > h || o < -h)
				return 0;
			continue;
		}
		const double inverse = 1 / d, t1 = (-h - o) * inverse, t2 = (h - o) * inverse;
		const double first = t1 < t2 ? t1 : t2, last = t1 < t2 ? t2 : t1;
		enter = first > enter ? first : enter;
		leave = last < leave ? last : leave;
	}
	return leave > enter && leave < 1e300 ? (leave - enter) * sqrt(square) : 0;
}

void bb_count_rays(const struct bb_stream *s, const struct bb_view *view, const struct bb_stream_frame *frame,
		   struct bb_stream_counts *counts)
{
	const struct bb_stream_config *config = &s->config;
	const struct bb_layer layer = bb_stream_layer(s);
	const uint32_t width_px = frame->width_px, height_px = frame->height_px;
	const struct bb_pose *pose = &config->placement.pose;
	const struct bb_vec3 corner = bb_pose_inverse_apply(pose, view->corners.lower_left);
	struct beam beam = { 0 };
	struct bb_rays through;
	uint64_t rays = 0, samples = 0;

	if (bb_rays_make(view, &layer, frame->step_voxels, width_px, height_px, &through) != BB_OK)
		return;
	put(bb_pose_inverse_apply(pose, view->eye), beam.o);
	put(corner, beam.corner);
	put(bb_vec3_sub(bb_pose_inverse_apply(pose, view->corners.lower_right), corner), beam.across);
	put(bb_vec3_sub(bb_pose_inverse_apply(pose, view->corners.upper_left), corner), beam.up);
	put(bb_vec3_scale(config->placement.size_m, 0.5), beam.half_m);
	for (int j = 0; j < ROWS; j++)
		for (int i = 0; i < COLUMNS; i++) {
			const double way_m = way_through_m(&beam, (i + 0.5) / COLUMNS, (j + 0.5) / ROWS);
			const double n = way_m / through.step_m + 0.5; /* samples stand at (k + 0.5) steps */
			rays += way_m > 0;
			samples += way_m > 0 ? (uint64_t)(n < SAMPLES_MOST ? n : SAMPLES_MOST) : 0;
		}
	counts->rays += rays * width_px * height_px / (COLUMNS * ROWS);
	counts->samples += samples * width_px * height_px / (COLUMNS * ROWS);
}
