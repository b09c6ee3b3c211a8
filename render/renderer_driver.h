/*
 * render/renderer_driver.h: what a drawing back end fills in, and the rays that all of them share. Back ends only.
 */
#ifndef BB_RENDER_RENDERER_DRIVER_H
#define BB_RENDER_RENDERER_DRIVER_H

#include "render/renderer.h"

/* The rays of one picture through one volume, in the volume's own space (metres, centred). Everything is relative to the
 * eye and made in double, so that a back end may go on in float. */
struct bb_rays {
	struct bb_vec3 eye_m;
	struct bb_vec3 corner_m;         /* from the eye to the screen's upper left corner */
	struct bb_vec3 across_m, down_m; /* the screen's edges */
	struct bb_vec3 voxels_per_m;
	struct bb_vec3 dim; /* voxels: corner coordinates reach from 0 to dim; spherical: of the ball's cube, radial voxels */
	double step_m;
	uint32_t width, height;
};

/* One ray in corner coordinates: sample i lies at first + i * stride. Its distance from the eye is enter_m + (i + 0.5) *
 * step_m of the bb_rays. Spherical: coordinates of the cube (bb_spherical_at goes on from there). */
struct bb_ray {
	struct bb_vec3 first, stride;
	double enter_m;
	uint32_t n;
};

BB_MUST_CHECK enum bb_status bb_rays_make(const struct bb_view *view, const struct bb_layer *layer, double step_voxels,
					  uint32_t width, uint32_t height, struct bb_rays *out);
struct bb_ray bb_rays_at(const struct bb_rays *rays, uint32_t column, uint32_t row);

/* From the cube's corner coordinates (radial voxels) to the grid's own; false: outside the extent. */
struct bb_spherical {
	double centre;               /* of the cube, radial voxels */
	double from[3], per_voxel[3]; /* of r in radial voxels; theta, phi: radians */
	double dim[3];
	bool around; /* phi has no ends */
};
void bb_spherical_of(const uint32_t dim[3], const double extent[6], struct bb_spherical *out);
bool bb_spherical_at(const struct bb_spherical *s, struct bb_vec3 cube, struct bb_vec3 *grid);

struct bb_renderer_ops { /* all mandatory */
	/* rays: of each layer. */
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
