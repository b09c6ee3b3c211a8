/* sim/camera/lights.c: see sim/camera/lights.h. */
#include "sim/camera/lights.h"

#include <math.h>

#include "sim/sim_camera.h"

#define MARKERS_MAX ((size_t)BB_BODIES_MAX * 6)
#define SETTLE 2 /* rounds until a row and what it sees agree: a pixel a row apart moves less than a row */

static struct bb_vec3 marker_at(const struct sim_eye *eye, size_t i, int64_t at_ns, bool mirrored)
{
	struct bb_vec3 marker[MARKERS_MAX];
	const size_t n = sim_world_markers(eye->world, at_ns, marker, MARKERS_MAX);
	struct bb_vec3 p = i < n ? marker[i] : (struct bb_vec3){ 0, 0, 0 };

	if (mirrored)
		p.y = -p.y; /* the floor is y = 0 */
	return p;
}

static bool pixel(const struct sim_eye *eye, struct bb_vec3 p, double px[2])
{
	return sim_camera_pixel(eye->config, bb_pose_inverse_apply(&eye->pose, p), px);
}

/* Is the straight way free? From under the floor it goes up to the real marker on the same side of the plane. */
static bool is_free(const struct sim_eye *eye, struct bb_vec3 p, bool mirrored, int64_t at_ns)
{
	const struct bb_vec3 from = eye->pose.p;

	if (!mirrored)
		return sim_world_visible(eye->world, from, p, at_ns);
	if (p.y >= 0 || from.y <= 0)
		return false;
	const struct bb_vec3 floor = bb_vec3_lerp(from, p, from.y / (from.y - p.y)), real = { p.x, -p.y, p.z };
	return sim_world_visible(eye->world, from, floor, at_ns) && sim_world_visible(eye->world, floor, real, at_ns);
}

/* A bit for each point of the disc that something hides; it faces the camera, as a ball of tape does. */
static uint32_t hidden_points(const struct sim_eye *eye, struct bb_vec3 p, bool mirrored, int64_t at_ns)
{
	const double r = eye->lamp->marker_mm * 0.5e-3;
	const struct bb_vec3 ahead = bb_vec3_unit(bb_vec3_sub(p, eye->pose.p), (struct bb_vec3){ 0, 0, 1 });
	const struct bb_vec3 right = bb_vec3_unit(bb_vec3_cross(ahead, (struct bb_vec3){ 0, 1, 0 }), (struct bb_vec3){ 1, 0, 0 });
	const struct bb_vec3 up = bb_vec3_cross(right, ahead);
	uint32_t hidden = 0;

	for (unsigned i = 0; i < SIM_DISC_POINTS; i++) {
		double x, y;
		sim_disc_point(i, &x, &y);
		const struct bb_vec3 at = bb_vec3_add(p, bb_vec3_add(bb_vec3_scale(right, r * x), bb_vec3_scale(up, r * y)));
		hidden |= (uint32_t)!is_free(eye, at, mirrored, at_ns) << i;
	}
	return hidden;
}

/* The disc's radius in the picture: how far its edge lies from its centre there, over two directions. */
static double radius_px(const struct sim_eye *eye, struct bb_vec3 p, const double px[2])
{
	const struct bb_vec3 c = bb_pose_inverse_apply(&eye->pose, p);
	const double r = eye->lamp->marker_mm * 0.5e-3;
	double a[2], b[2];

	if (!sim_camera_pixel(eye->config, (struct bb_vec3){ c.x + r, c.y, c.z }, a) ||
	    !sim_camera_pixel(eye->config, (struct bb_vec3){ c.x, c.y + r, c.z }, b))
		return eye->config->fx_px * r / c.z;
	return (hypot(a[0] - px[0], a[1] - px[1]) + hypot(b[0] - px[0], b[1] - px[1])) / 2;
}

bool sim_lights_place(const struct sim_eye *eye, size_t i, bool mirrored, struct bb_vec3 *p, double px[2], int64_t *at_ns)
{
	const double row_ns = eye->config->row_us * 1e3, middle = (double)(eye->config->height_px - 1) / 2;

	*at_ns = eye->mid_ns;
	*p = marker_at(eye, i, *at_ns, mirrored);
	for (int k = 0; k <= SETTLE; k++) {
		const struct bb_vec3 in_camera = bb_pose_inverse_apply(&eye->pose, *p);
		if (!(in_camera.z >= SIM_CAMERA_NEAR_M) || bb_vec3_norm(in_camera) > SIM_CAMERA_FAR_M || !pixel(eye, *p, px))
			return false;
		if (!(row_ns > 0))
			break;
		const double row = fmin(fmax(px[1] - middle, -middle), middle); /* beside the sensor there are none */
		*at_ns = eye->mid_ns + llround(row * row_ns);
		*p = marker_at(eye, i, *at_ns, mirrored);
	}
	return true;
}

static bool see_one(const struct sim_eye *eye, size_t i, bool mirrored, double share, struct sim_light *out)
{
	const struct bb_camera_config *c = eye->config;
	double px[2], from[2], to[2];
	struct bb_vec3 p;
	int64_t mid_ns;

	if (!sim_lights_place(eye, i, mirrored, &p, px, &mid_ns))
		return false;
	if (!(px[0] >= -0.5 && px[1] >= -0.5 && px[0] < (double)c->width_px - 0.5 && px[1] < (double)c->height_px - 0.5))
		return false;
	const int64_t half_ns = eye->exposure_ns / 2;
	if (!pixel(eye, marker_at(eye, i, mid_ns - half_ns, mirrored), from) ||
	    !pixel(eye, marker_at(eye, i, mid_ns + half_ns, mirrored), to))
		return false;
	const double near = eye->lamp->lamp_m / bb_vec3_norm(bb_vec3_sub(p, eye->pose.p));
	*out = (struct sim_light){ .x0_px = from[0], .y0_px = from[1], .x1_px = to[0], .y1_px = to[1],
		                   .radius_px = radius_px(eye, p, px),
		                   .grey = share * eye->lamp->marker_grey * near * near *
		                           ((double)eye->exposure_ns / (double)eye->lamp->lamp_ns),
		                   .hidden = hidden_points(eye, p, mirrored, mid_ns),
		                   .ghost = mirrored };
	return out->hidden != (1u << SIM_DISC_POINTS) - 1;
}

bool sim_lights_see(const struct sim_eye *eye, struct sim_light *out, size_t cap, size_t *n_out)
{
	struct bb_vec3 marker[MARKERS_MAX];
	const size_t n = sim_world_markers(eye->world, eye->mid_ns, marker, MARKERS_MAX);
	const double mirror = eye->lamp->mirror + eye->mirror;
	struct sim_light light;
	bool fits = true;

	*n_out = 0;
	for (size_t k = 0; n && k < (mirror > 0 ? 2 * n : n); k++) {
		if (!see_one(eye, k % n, k >= n, k >= n ? fmin(mirror, 1) : 1, &light))
			continue;
		fits &= *n_out < cap;
		if (*n_out < cap)
			out[(*n_out)++] = light;
	}
	return fits;
}
