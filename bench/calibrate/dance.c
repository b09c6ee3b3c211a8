/* bench/calibrate/dance.c: see dance.h. */
#include "bench/calibrate/dance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/sim.h"
#include "sim/sim_camera.h"
#include "sim/world.h"

#define TAU 6.283185307179586
#define SQUARE_S 10.0
#define DANCER_M 0.22 /* radius */
#define DANCER_HIGH_M 1.75
#define STRAY_SHARE 0.1 /* of the pictures have a blob that is nothing */

struct stage {
	const struct bb_dance_config *config;
	struct bb_dance *out;
	struct bb_camera_config *before; /* truth until the knock */
	struct sim_rng rng;
	struct bb_vec3 centre, reach;
	size_t cap_wrong;
};

struct pose_of_wand {
	struct bb_vec3 marker[3], dancer;
};

static double between(struct sim_rng *r, double low, double high)
{
	return low + (high - low) * sim_rng_uniform(r);
}

static struct bb_vec3 any_direction(struct sim_rng *r)
{
	struct bb_vec3 v;

	v.x = sim_rng_normal(r);
	v.y = sim_rng_normal(r);
	v.z = sim_rng_normal(r);
	return bb_vec3_unit(v, (struct bb_vec3){ 0, 1, 0 });
}

static struct bb_camera_config hung(struct sim_rng *r, const struct bb_camera_config *plan)
{
	struct bb_camera_config c = *plan;
	const struct bb_vec3 axis = any_direction(r);

	c.pose.q = bb_quat_unit(bb_quat_mul(c.pose.q, bb_quat_axis_angle(axis, between(r, 0, BB_DANCE_OFF_DEG) * TAU / 360)));
	c.pose.p.x += between(r, -BB_DANCE_OFF_M, BB_DANCE_OFF_M);
	c.pose.p.y += between(r, -BB_DANCE_OFF_M, BB_DANCE_OFF_M);
	c.pose.p.z += between(r, -BB_DANCE_OFF_M, BB_DANCE_OFF_M);
	c.fx_px *= between(r, 0.97, 1.03);
	c.fy_px = c.fx_px;
	c.cx_px += between(r, -6, 6);
	c.cy_px += between(r, -6, 6);
	c.k1 += between(r, -0.02, 0.02);
	c.k2 += between(r, -0.005, 0.005);
	return c;
}

static struct bb_camera_config knocked(struct sim_rng *r, struct bb_camera_config c)
{
	const struct bb_vec3 axis = any_direction(r), way = any_direction(r);

	/* about its optical axis alone a knock would hardly show: across it */
	const struct bb_vec3 across = bb_vec3_unit((struct bb_vec3){ axis.x, axis.y, 0.3 * axis.z }, (struct bb_vec3){ 1, 0, 0 });
	c.pose.q = bb_quat_unit(bb_quat_mul(c.pose.q, bb_quat_axis_angle(across, BB_DANCE_KNOCK_DEG * TAU / 360)));
	c.pose.p = bb_vec3_add(c.pose.p, bb_vec3_scale(way, BB_DANCE_KNOCK_M));
	return c;
}

/* Through all of the room in a minute and a half, the wand turning in the hand. */
static struct pose_of_wand wand_at(const struct stage *s, double t)
{
	const double a = TAU * t;
	const struct bb_vec3 p = { s->centre.x + s->reach.x * sin(0.071 * a + 0.4),
		                   s->centre.y + s->reach.y * sin(0.193 * a + 0.2 * sin(0.031 * a)),
		                   s->centre.z + s->reach.z * sin(0.103 * a + 1.1) };
	const double yaw = 2.2 * sin(0.137 * a) + 0.21 * a, pitch = 1.1 * sin(0.171 * a + 0.7);
	const struct bb_vec3 u = { cos(pitch) * cos(yaw), sin(pitch), cos(pitch) * sin(yaw) };
	const double behind = 0.31 * a;
	struct pose_of_wand w;

	for (int i = 0; i < 3; i++)
		w.marker[i] = bb_vec3_add(p, bb_vec3_scale(u, s->out->sequence.along_m[i] - 0.2));
	w.dancer = bb_vec3_add(p, (struct bb_vec3){ 0.6 * cos(behind), 0, 0.6 * sin(behind) });
	return w;
}

/* Does the dancer, a post, stand between a camera and a marker? */
static bool hidden(struct bb_vec3 from, struct bb_vec3 to, struct bb_vec3 dancer)
{
	const double dx = to.x - from.x, dz = to.z - from.z, length2 = dx * dx + dz * dz;
	const double t = length2 > 0 ? ((dancer.x - from.x) * dx + (dancer.z - from.z) * dz) / length2 : 0;

	if (t < 0 || t > 1 || hypot(from.x + t * dx - dancer.x, from.z + t * dz - dancer.z) > DANCER_M)
		return false;
	return from.y + t * (to.y - from.y) < DANCER_HIGH_M;
}

struct picture {
	float px[BB_SEQUENCE_BLOBS_MAX][2];
	uint8_t wrong[BB_SEQUENCE_BLOBS_MAX];
	size_t n;
};

static void see(struct stage *s, const struct bb_camera_config *c, struct bb_vec3 at, const double shift[2], bool wrong,
                struct picture *out)
{
	const double dx = s->config->noise_px * sim_rng_normal(&s->rng), dy = s->config->noise_px * sim_rng_normal(&s->rng);
	double px[2];

	if (!sim_camera_pixel(c, bb_pose_inverse_apply(&c->pose, at), px))
		return;
	px[0] += dx + shift[0];
	px[1] += dy + shift[1];
	if (!(px[0] > 0 && px[1] > 0 && px[0] < (double)c->width_px - 1 && px[1] < (double)c->height_px - 1))
		return;
	out->px[out->n][0] = (float)px[0];
	out->px[out->n][1] = (float)px[1];
	out->wrong[out->n++] = wrong;
}

/* Half of the wrong pictures have one marker off, half all three: with a share p of wrong markers 1.5 p of the pictures. */
static void photograph(struct stage *s, const struct bb_camera_config *c, const struct pose_of_wand *w, struct picture *out)
{
	struct sim_rng *r = &s->rng;
	const bool bad = sim_rng_uniform(r) < 1.5 * s->config->outlier_share, all = sim_rng_uniform(r) < 0.5;
	const int which = (int)(sim_rng_uniform(r) * 3);
	const double turn = sim_rng_uniform(r) * TAU, far = all ? between(r, 4, 60) : between(r, 2, 25);
	const bool stray = sim_rng_uniform(r) < STRAY_SHARE;
	const double none[2] = { 0, 0 }, shift[2] = { far * cos(turn), far * sin(turn) };
	const double x = between(r, 1, (double)c->width_px - 2), y = between(r, 1, (double)c->height_px - 2);

	out->n = 0;
	for (int i = 0; i < 3; i++) {
		const bool wrong = bad && (all || i == which);
		if (!hidden(c->pose.p, w->marker[i], w->dancer))
			see(s, c, w->marker[i], wrong ? shift : none, wrong, out);
	}
	if (stray) {
		out->px[out->n][0] = (float)x;
		out->px[out->n][1] = (float)y;
		out->wrong[out->n++] = 1;
	}
}

static enum bb_status keep(struct stage *s, int64_t t_ns, size_t camera, bool square, const struct picture *p)
{
	struct bb_dance *d = s->out;
	const size_t n = d->sequence.n_px + p->n;

	if (n > s->cap_wrong) {
		uint8_t *more = realloc(d->wrong, 2 * n);
		if (!more)
			return BB_ERR_NOMEM;
		d->wrong = more;
		s->cap_wrong = 2 * n;
	}
	for (size_t i = 0; i < p->n; i++) {
		d->wrong[d->sequence.n_px + i] = p->wrong[i];
		d->n_wrong += p->wrong[i];
	}
	return bb_sequence_add(&d->sequence, t_ns, (uint16_t)camera, square, (const float(*)[2])p->px, p->n);
}

static enum bb_status film_square(struct stage *s)
{
	const double none[2] = { 0, 0 };
	enum bb_status status = BB_OK;

	for (int64_t k = 0; !status && k < (int64_t)(SQUARE_S * s->config->rate_hz); k++)
		for (size_t i = 0; !status && i < s->out->n_cameras; i++) {
			struct picture p = { .n = 0 };
			for (int m = 0; m < 4; m++)
				see(s, &s->before[i], s->out->sequence.square[m], none, false, &p);
			status = keep(s, llround((double)k * 1e9 / s->config->rate_hz), i, true, &p);
		}
	return status;
}

static enum bb_status film_dance(struct stage *s)
{
	enum bb_status status = BB_OK;

	s->out->knock_ns = llround(s->config->seconds * 0.5e9);
	for (int64_t k = 0; !status && k < (int64_t)(s->config->seconds * s->config->rate_hz); k++) {
		const double t = (double)k / s->config->rate_hz;
		const struct pose_of_wand w = wand_at(s, t);
		const int64_t t_ns = llround(t * 1e9);
		for (size_t i = 0; !status && i < s->out->n_cameras; i++) {
			struct picture p;
			photograph(s, t_ns < s->out->knock_ns ? &s->before[i] : &s->out->truth[i], &w, &p);
			status = keep(s, t_ns, i, false, &p);
		}
	}
	return status;
}

static void set_stage(struct stage *s)
{
	const struct bb_room *room = s->config->room;
	const struct bb_vec3 min = room->min, max = room->max;

	/* as far as a hand reaches, half a metre off the walls; in a large room not into its corners, but well out */
	s->centre = (struct bb_vec3){ (min.x + max.x) / 2, 1.15, (min.z + max.z) / 2 };
	s->reach = (struct bb_vec3){ fmax(0.4, (max.x - min.x) / 2 - 0.5), 0.9, fmax(0.4, (max.z - min.z) / 2 - 0.5) };
	for (size_t i = 0; i < s->out->n_cameras; i++) {
		s->before[i] = s->out->truth[i] = hung(&s->rng, &room->cameras[i]);
		if ((int)i == s->config->knocked)
			s->out->truth[i] = knocked(&s->rng, s->before[i]);
	}
}

enum bb_status bb_dance_make(const struct bb_dance_config *config, struct bb_dance *out)
{
	const size_t n = config->n_cameras && config->n_cameras < config->room->n_cameras ? config->n_cameras :
	                                                                                    config->room->n_cameras;
	struct stage s = { .config = config, .out = out };
	enum bb_status status = BB_OK;

	memset(out, 0, sizeof(*out));
	bb_sequence_defaults(&out->sequence);
	sim_rng_seed(&s.rng, config->seed, "dance", config->room->name);
	out->n_cameras = n;
	out->truth = calloc(n + 1, sizeof(*out->truth));
	s.before = calloc(n + 1, sizeof(*s.before));
	if (!out->truth || !s.before)
		status = BB_ERR_NOMEM;
	for (size_t i = 0; !status && i < n; i++)
		status = bb_sequence_add_camera(&out->sequence, config->room->cameras[i].id);
	if (!status) {
		set_stage(&s);
		status = film_square(&s);
	}
	if (!status)
		status = film_dance(&s);
	free(s.before);
	if (status)
		bb_dance_free(out);
	return status;
}

void bb_dance_free(struct bb_dance *d)
{
	bb_sequence_free(&d->sequence);
	free(d->truth);
	free(d->wrong);
	memset(d, 0, sizeof(*d));
}
