/* sync/calibrate/touch.c: see touch.h. */
#include "sync/calibrate/touch.h"

#include <math.h>
#include <string.h>

#include "sync/track/linalg.h"
#include "sync/track/rigid.h"

#define DEG_PER_RAD (180 / 3.14159265358979323846)

/* Standard deviation of the orientation about the axis it is known worst about: sigma over the points' inertia there. */
static double turn_sigma(const struct bb_vec3 *room, size_t n, double sigma_m)
{
	struct bb_vec3 mean = { 0, 0, 0 };
	double inertia[9] = { 0 }, values[3], vectors[9];

	for (size_t i = 0; i < n; i++)
		mean = bb_vec3_add(mean, bb_vec3_scale(room[i], 1 / (double)n));
	for (size_t i = 0; i < n; i++) {
		const struct bb_vec3 d = bb_vec3_sub(room[i], mean);
		const double v[3] = { d.x, d.y, d.z };
		for (int r = 0; r < 3; r++)
			for (int c = 0; c < 3; c++)
				inertia[3 * r + c] += (r == c ? bb_vec3_dot(d, d) : 0) - v[r] * v[c];
	}
	bb_sym_eigen(3, inertia, values, vectors);
	return values[2] > 0 ? sigma_m / sqrt(values[2]) : (double)INFINITY;
}

bool bb_touch_fit(const struct bb_vec3 *tracker, const struct bb_vec3 *room, size_t n, struct bb_touch_fit *out)
{
	struct bb_rigid fit;
	double square = 0;

	memset(out, 0, sizeof(*out));
	if (n < 3 || n > BB_TOUCHES_MAX || !bb_rigid_fit(tracker, room, n, BB_TOUCH_SIGMA_M, BB_QUAT_IDENTITY, &fit) ||
	    fit.collinear)
		return false;
	out->pose = fit.pose;
	for (size_t i = 0; i < n; i++) {
		out->off_m[i] = bb_vec3_norm(bb_vec3_sub(bb_pose_apply(&fit.pose, tracker[i]), room[i]));
		square += out->off_m[i] * out->off_m[i];
		if (out->off_m[i] > out->off_m[out->worst])
			out->worst = i;
	}
	out->rms_m = sqrt(square / (3 * (double)n - 6));
	const double sigma_m = fmax(out->rms_m, BB_TOUCH_SIGMA_M);
	out->sigma_m = sigma_m / sqrt((double)n);
	out->sigma_deg = DEG_PER_RAD * turn_sigma(room, n, sigma_m);
	return true;
}
