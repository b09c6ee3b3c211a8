/* sim/camera/sight.c: what a simulated camera sees: blobs as the model in sim/sim_camera.h says, and lights of a picture. */
#include "sim/camera/camera_impl.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define RAD_PER_DEG (3.14159265358979323846 / 180.0)

static struct bb_pose pose_now(const struct sim_camera *c)
{
	struct bb_pose pose = c->base.config.pose;

	if (c->bump_ndeg)
		pose.q = bb_quat_mul(pose.q,
		                     bb_quat_axis_angle(c->bump_axis, (double)c->bump_ndeg * 1e-9 * RAD_PER_DEG));
	return pose;
}

static bool put(struct bb_blob *blobs, size_t *n, struct bb_blob blob)
{
	if (*n == SIM_CAMERA_BLOBS)
		return false;
	blobs[(*n)++] = blob;
	return true;
}

static struct sim_eye eye_at(const struct sim_camera *c, int64_t mid_ns)
{
	return (struct sim_eye){ .world = c->world, .config = &c->base.config, .lamp = &c->lamp, .pose = pose_now(c),
		                 .mid_ns = mid_ns, .exposure_ns = c->exposure_ns, .mirror = (double)c->mirror_ppm * 1e-6 };
}

static bool see_markers(const struct sim_camera *c, int64_t mid_ns, struct sim_rng *r, struct bb_blob *blobs,
                        size_t *n)
{
	const struct sim_eye eye = eye_at(c, mid_ns);
	const double sd_px = c->base.limits.blob_error_px + (double)c->noise_npx * 1e-9;
	struct bb_vec3 marker[BB_BODIES_MAX * 6];
	const size_t n_markers = sim_world_markers(c->world, mid_ns, marker, BB_ARRAY_LEN(marker));
	const double size = c->lamp.marker_mm / (SIM_MARKER_DIAMETER_M * 1e3);
	struct bb_blob blob;
	bool fits = true;
	double px[2];

	for (size_t i = 0; i < n_markers; i++) {
		/* Drawn for every marker, seen or not: what hides one does not move another. */
		const double dx = sd_px * sim_rng_normal(r), dy = sd_px * sim_rng_normal(r);
		int64_t at_ns = mid_ns;
		if (c->base.config.row_us > 0 && !sim_lights_place(&eye, i, false, &marker[i], px, &at_ns))
			continue;
		if (!sim_camera_project(&c->base.config, bb_pose_inverse_apply(&eye.pose, marker[i]), &blob))
			continue;
		if (!c->ideal && !sim_world_visible(c->world, c->base.config.pose.p, marker[i], at_ns))
			continue;
		blob.x_px = (float)((double)blob.x_px + dx);
		blob.y_px = (float)((double)blob.y_px + dy);
		blob.area_px = (float)((double)blob.area_px * size * size);
		fits &= put(blobs, n, blob);
	}
	return fits;
}

/* What a polished floor returns is near the threshold: each ghost is there in that share of the frames. */
static bool see_ghosts(const struct sim_camera *c, int64_t mid_ns, struct sim_rng *r, struct bb_blob *blobs, size_t *n)
{
	const struct sim_eye eye = eye_at(c, mid_ns);
	struct sim_light light[SIM_CAMERA_BLOBS];
	size_t n_lights = 0;

	if (c->ideal || !(eye.mirror + c->lamp.mirror > 0))
		return true;
	bool fits = sim_lights_see(&eye, light, BB_ARRAY_LEN(light), &n_lights);
	for (size_t i = 0; i < n_lights; i++) {
		const struct sim_light *l = &light[i];
		const struct bb_blob ghost = { (float)((l->x0_px + l->x1_px) / 2), (float)((l->y0_px + l->y1_px) / 2),
			                       (float)(3.1415926535897932 * l->radius_px * l->radius_px) };
		if (l->ghost && sim_rng_uniform(r) < eye.mirror + c->lamp.mirror)
			fits &= put(blobs, n, ghost);
	}
	return fits;
}

static double sun_grey(const struct sim_camera *c)
{
	return c->covered ? 0 : c->sensor.sun_grey + (double)c->sun_mgrey * 1e-3;
}

/* Who looks for bright points takes a patch of sun for a large one: as far as it reaches this level. */
#define SUN_EDGE_GREY 28.0
static bool see_sun(const struct sim_camera *c, struct bb_blob *blobs, size_t *n)
{
	const double rr = 2 * c->sensor.sun_px * c->sensor.sun_px * log(fmax(sun_grey(c) / SUN_EDGE_GREY, 1));
	const struct bb_blob sun = { (float)(c->sensor.sun_x * (double)c->base.config.width_px),
		                     (float)(c->sensor.sun_y * (double)c->base.config.height_px),
		                     (float)(3.1415926535897932 * rr) };

	return c->ideal || !(rr > 0) || put(blobs, n, sun);
}

static bool see_strays(const struct sim_camera *c, struct sim_rng *r, struct bb_blob *blobs, size_t *n)
{
	bool fits = true;

	for (int64_t i = 0; i < c->flood && fits; i++) {
		const double x = sim_rng_uniform(r) * (double)(c->base.config.width_px - 1);
		const double y = sim_rng_uniform(r) * (double)(c->base.config.height_px - 1);
		fits = put(blobs, n, (struct bb_blob){ (float)x, (float)y, (float)(2 + 20 * sim_rng_uniform(r)) });
	}
	return fits;
}

static int by_place(const void *a, const void *b)
{
	const struct bb_blob *p = a, *q = b;

	if (p->y_px != q->y_px)
		return p->y_px < q->y_px ? -1 : 1;
	return p->x_px < q->x_px ? -1 : p->x_px > q->x_px;
}

static struct bb_blob merged(struct bb_blob a, struct bb_blob b)
{
	const float area = a.area_px + b.area_px;
	const float t = area > 0 ? b.area_px / area : 0.5f;

	return (struct bb_blob){ a.x_px + (b.x_px - a.x_px) * t, a.y_px + (b.y_px - a.y_px) * t, area };
}

/* Two round spots of light of which one reaches into the other, or into a pixel beside it, are one to whoever looks for
 * bright points: on 1000 frames with 15 spots it tells another number than stripes do once (12 times without the pixel). */
static bool overlap(const struct bb_blob *a, const struct bb_blob *b)
{
	const float dx = a->x_px - b->x_px, dy = a->y_px - b->y_px;
	const float reach = (sqrtf(fmaxf(a->area_px, 0)) + sqrtf(fmaxf(b->area_px, 0))) * 0.56418958f + 1; /* 1 / sqrt(pi) */

	return dx * dx + dy * dy < reach * reach;
}

static void merge_close(struct bb_blob *blobs, size_t *n)
{
	for (size_t i = 0; i < *n; i++)
		for (size_t j = i + 1; j < *n;) {
			if (!overlap(&blobs[i], &blobs[j])) {
				j++;
				continue;
			}
			blobs[i] = merged(blobs[i], blobs[j]);
			memmove(&blobs[j], &blobs[j + 1], (--*n - j) * sizeof(*blobs));
			j = i + 1; /* the blob has moved: look at all others again */
		}
}

static void look(const struct sim_camera *c, int64_t mid_ns, struct sim_rng *r, struct sim_camera_queued *q)
{
	if (!c->covered) {
		const bool markers_fit = see_markers(c, mid_ns, r, q->blob, &q->n);
		const bool strays_fit = see_strays(c, r, q->blob, &q->n);
		const bool others_fit = see_sun(c, q->blob, &q->n) && see_ghosts(c, mid_ns, r, q->blob, &q->n);
		q->overflow = !markers_fit || !strays_fit || !others_fit;
		qsort(q->blob, q->n, sizeof(*q->blob), by_place);
	}
	if (!c->ideal) {
		merge_close(q->blob, &q->n);
		qsort(q->blob, q->n, sizeof(*q->blob), by_place);
	}
}

/* Fidelity 2: the lights of the same moment. Only the noise of faults moves them; that of the sensor is the picture's. */
static void look_closely(const struct sim_camera *c, int64_t mid_ns, struct sim_camera_queued *q)
{
	const struct sim_eye eye = eye_at(c, mid_ns);
	const double sd_px = (double)c->noise_npx * 1e-9;
	struct sim_rng r = sim_rng_at(&c->rng, ~(uint64_t)q->seq);

	if (!c->covered)
		(void)sim_lights_see(&eye, q->light, BB_ARRAY_LEN(q->light), &q->n_lights);
	for (size_t i = 0; i < q->n_lights; i++) {
		struct sim_light *l = &q->light[i];
		const double dx = sd_px * sim_rng_normal(&r), dy = sd_px * sim_rng_normal(&r);
		l->x0_px += dx;
		l->x1_px += dx;
		l->y0_px += dy;
		l->y1_px += dy;
	}
	for (int64_t i = 0; i < c->flood && !c->covered && q->n_lights < BB_ARRAY_LEN(q->light); i++) {
		const double x = sim_rng_uniform(&r) * (double)(c->base.config.width_px - 1);
		const double y = sim_rng_uniform(&r) * (double)(c->base.config.height_px - 1);
		q->light[q->n_lights++] = (struct sim_light){ x, y, x, y, 0.8 + 2 * sim_rng_uniform(&r), 150, 0, false };
	}
	q->sun = sun_grey(c);
	q->noise = r;
}

void sim_camera_look(struct sim_camera *c, int64_t mid_ns, struct sim_rng *r, struct sim_camera_queued *q)
{
	look(c, mid_ns, r, q);
	if (c->picture)
		look_closely(c, mid_ns, q);
}
