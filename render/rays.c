/*
 * render/rays.c: where the rays of a picture run through the volume, and where on them the samples lie. Pure, double.
 * The GLSL caster repeats bb_rays_at in float: a change here is a change in gl/cast_glsl.h.
 */
#include <math.h>

#include "render/renderer_driver.h"

#define PI 3.14159265358979323846
#define LEAST_STEP_VOXELS (1.0 / 64)
#define MOST_STEP_VOXELS 64.0
#define AROUND 1e-3 /* radians: what is no farther from all the way goes all the way, as in format.h */
#define PARALLEL_M 1e-12 /* a direction component below this meets its two planes infinitely far away */

/* Voxels along the edges; a ball's are those of its cube, as wide as it has them along r. */
static struct bb_vec3 voxels_of(const struct bb_atlas *atlas)
{
	const double across = 2 * atlas->extent[1] / (atlas->extent[1] - atlas->extent[0]) * atlas->dim[0];

	if (atlas->kind == BB_BRICK_SPHERICAL)
		return (struct bb_vec3){ across, across, across };
	return (struct bb_vec3){ atlas->dim[0], atlas->dim[1], atlas->dim[2] };
}

/* A step is measured in voxels along the volume's longest edge, as the streamer counts it. */
static double step_length_m(struct bb_vec3 dim, struct bb_vec3 size_m, double step_voxels)
{
	const double edge_m[3] = { size_m.x, size_m.y, size_m.z }, voxels[3] = { dim.x, dim.y, dim.z };
	int longest = 0;

	for (int a = 1; a < 3; a++)
		if (edge_m[a] > edge_m[longest])
			longest = a;
	return step_voxels * edge_m[longest] / voxels[longest];
}

static bool positive(double x)
{
	return x > 0 && x < 1e6;
}

/* False: a number that is none, or an eye in its screen's plane: rays without a direction. Never of bb_view_make's. */
static bool looks_somewhere(const struct bb_view *view)
{
	const struct bb_corners *c = &view->corners;
	const struct bb_vec3 across = bb_vec3_sub(c->lower_right, c->lower_left);
	const struct bb_vec3 down = bb_vec3_sub(c->lower_left, c->upper_left);
	const double depth = bb_vec3_dot(bb_vec3_sub(c->upper_left, view->eye), bb_vec3_cross(across, down));

	return isfinite(depth) && depth != 0;
}

enum bb_status bb_rays_make(const struct bb_view *view, const struct bb_layer *layer, double step_voxels, uint32_t width,
			    uint32_t height, struct bb_rays *out)
{
	const struct bb_vec3 size_m = layer->placement.size_m, at = layer->placement.pose.p;
	const struct bb_quat to_volume = bb_quat_conj(bb_quat_unit(layer->placement.pose.q));
	const struct bb_corners *c = &view->corners;
	const struct bb_vec3 eye = view->eye;

	if (!positive(size_m.x) || !positive(size_m.y) || !positive(size_m.z))
		return BB_ERR_RANGE;
	if (!(step_voxels >= LEAST_STEP_VOXELS && step_voxels <= MOST_STEP_VOXELS))
		return BB_ERR_RANGE;
	if (!looks_somewhere(view) || !isfinite(at.x + at.y + at.z))
		return BB_ERR_RANGE;
	*out = (struct bb_rays){ .width = width, .height = height, .dim = voxels_of(layer->atlas) };
	out->eye_m = bb_quat_rotate(to_volume, bb_vec3_sub(eye, at));
	out->corner_m = bb_quat_rotate(to_volume, bb_vec3_sub(c->upper_left, eye));
	out->across_m = bb_quat_rotate(to_volume, bb_vec3_sub(c->lower_right, c->lower_left));
	out->down_m = bb_quat_rotate(to_volume, bb_vec3_sub(c->lower_left, c->upper_left));
	out->voxels_per_m = (struct bb_vec3){ out->dim.x / size_m.x, out->dim.y / size_m.y, out->dim.z / size_m.z };
	out->step_m = step_length_m(out->dim, size_m, step_voxels);
	return BB_OK;
}

/* Narrow [*enter, *leave] to where the ray is between two planes at +-half_m. */
static void clip_slab(double from_m, double direction, double half_m, double *enter, double *leave)
{
	const double d = fabs(direction) < PARALLEL_M ? copysign(PARALLEL_M, direction) : direction;
	const double a = (-half_m - from_m) / d, b = (half_m - from_m) / d;

	*enter = fmax(*enter, fmin(a, b));
	*leave = fmin(*leave, fmax(a, b));
}

struct bb_ray bb_rays_at(const struct bb_rays *rays, uint32_t column, uint32_t row)
{
	const struct bb_vec3 k = rays->voxels_per_m, e = rays->eye_m;
	const struct bb_vec3 to =
		bb_vec3_add(bb_vec3_add(rays->corner_m, bb_vec3_scale(rays->across_m, (column + 0.5) / rays->width)),
			    bb_vec3_scale(rays->down_m, (row + 0.5) / rays->height));
	const struct bb_vec3 d = bb_vec3_unit(to, (struct bb_vec3){ 0, 0, -1 });
	struct bb_ray ray = { .n = 0 };
	double enter = 0, leave = HUGE_VAL;

	clip_slab(e.x, d.x, rays->dim.x / k.x / 2, &enter, &leave);
	clip_slab(e.y, d.y, rays->dim.y / k.y / 2, &enter, &leave);
	clip_slab(e.z, d.z, rays->dim.z / k.z / 2, &enter, &leave);
	if (!(leave > enter))
		return ray;
	const struct bb_vec3 at = bb_vec3_add(e, bb_vec3_scale(d, enter + 0.5 * rays->step_m));

	ray.n = (uint32_t)fmin(ceil((leave - enter) / rays->step_m - 0.5), 1e9);
	ray.enter_m = enter;
	ray.first = (struct bb_vec3){ at.x * k.x + rays->dim.x / 2, at.y * k.y + rays->dim.y / 2,
				      at.z * k.z + rays->dim.z / 2 };
	ray.stride = (struct bb_vec3){ d.x * k.x * rays->step_m, d.y * k.y * rays->step_m, d.z * k.z * rays->step_m };
	return ray;
}

void bb_spherical_of(const uint32_t dim[3], const double extent[6], struct bb_spherical *out)
{
	const double per_r = (extent[1] - extent[0]) / dim[0];

	*out = (struct bb_spherical){ .centre = extent[1] / per_r,
				      .from = { extent[0] / per_r, extent[2], extent[4] },
				      .per_voxel = { 1, (extent[3] - extent[2]) / dim[1], (extent[5] - extent[4]) / dim[2] },
				      .dim = { dim[0], dim[1], dim[2] },
				      .around = fabs(2 * PI - (extent[5] - extent[4])) < AROUND };
}

bool bb_spherical_at(const struct bb_spherical *s, struct bb_vec3 cube, struct bb_vec3 *grid)
{
	const double x = cube.x - s->centre, y = cube.y - s->centre, z = cube.z - s->centre;
	const double r = sqrt(x * x + y * y + z * z);
	const double theta = r > 0 ? acos(fmax(-1, fmin(1, y / r))) : 0;
	double phi = atan2(z, x);

	phi += phi < s->from[2] ? 2 * PI : 0;
	grid->x = (r - s->from[0]) / s->per_voxel[0];
	grid->y = (theta - s->from[1]) / s->per_voxel[1];
	grid->z = (phi - s->from[2]) / s->per_voxel[2];
	/* An axis without ends has no outside, however its coordinate is rounded. */
	return grid->x >= 0 && grid->x <= s->dim[0] && grid->y >= 0 && grid->y <= s->dim[1] &&
	       (s->around || grid->z <= s->dim[2]);
}
