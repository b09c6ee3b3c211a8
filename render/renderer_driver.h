/*
 * render/renderer_driver.h: what a drawing back end fills in, and the rays that all of them share. Back ends only.
 */
#ifndef BB_RENDER_RENDERER_DRIVER_H
#define BB_RENDER_RENDERER_DRIVER_H

#include "render/renderer.h"

/* The rays of one picture in the volume's own space (metres, centred). Everything is relative to the eye and made in
 * double, so that a back end may go on in float. */
struct bb_rays {
	struct bb_vec3 eye_m;
	struct bb_vec3 corner_m;         /* from the eye to the screen's upper left corner */
	struct bb_vec3 across_m, down_m; /* the screen's edges */
	struct bb_vec3 voxels_per_m;
	struct bb_vec3 dim; /* voxels */
	double step_m;
	double time; /* checked: 0 .. n_steps - 1 */
	uint32_t width, height;
};

/* One ray in voxel coordinates: sample i lies at first + i * stride. */
struct bb_ray {
	struct bb_vec3 first, stride;
	uint32_t n;
};

BB_MUST_CHECK enum bb_status bb_rays_make(const struct bb_draw *draw, uint32_t width, uint32_t height,
					  struct bb_rays *out);
struct bb_ray bb_rays_at(const struct bb_rays *rays, uint32_t column, uint32_t row);

struct bb_renderer_ops { /* all mandatory */
	enum bb_status (*draw)(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
			       struct bb_image *image, struct bb_draw_stats *stats);
	void (*forget)(struct bb_renderer *r);
	void (*destroy)(struct bb_renderer *r);
};

struct bb_renderer { /* first member of a back end */
	const struct bb_renderer_ops *ops;
	struct bb_error last_error;
	char description[192];
};

#endif
