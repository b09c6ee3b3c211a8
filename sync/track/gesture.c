#include "sync/track/gesture.h"

#include <math.h>

#define RELEASE_NS INT64_C(250000000)
#define GRAZING 1e-3 /* sine: below it nobody can say where a ray meets a wall */

/* Where a ray meets a rectangle from its front, as u, v in 0..1 from the lower left; distance below 0: not at all. */
static double meet(const struct bb_corners *c, struct bb_vec3 from, struct bb_vec3 along, double *u, double *v)
{
	const struct bb_vec3 right = bb_vec3_sub(c->lower_right, c->lower_left), up = bb_vec3_sub(c->upper_left, c->lower_left);
	const struct bb_vec3 normal = bb_corners_normal(c);
	const double against = -bb_vec3_dot(along, normal);

	if (!(against > GRAZING))
		return -1;
	const double distance = bb_vec3_dot(bb_vec3_sub(from, c->lower_left), normal) / against;
	const struct bb_vec3 at = bb_vec3_sub(bb_vec3_add(from, bb_vec3_scale(along, distance)), c->lower_left);
	*u = bb_vec3_dot(at, right) / bb_vec3_dot(right, right);
	*v = bb_vec3_dot(at, up) / bb_vec3_dot(up, up);
	return *u >= 0 && *u <= 1 && *v >= 0 && *v <= 1 ? distance : -1;
}

struct bb_pointing bb_gesture_point(const struct bb_room *room, const struct bb_pose *body)
{
	const struct bb_vec3 along = bb_quat_rotate(body->q, (struct bb_vec3){ 0, 0, -1 });
	struct bb_pointing p = { .distance_m = (double)INFINITY };

	for (size_t i = 0; i < room->n_screens; i++) {
		const struct bb_screen *s = &room->screens[i];
		double u = 0, v = 0;
		const double distance = meet(&s->corners, body->p, along, &u, &v);
		if (!(distance > 0 && distance < p.distance_m))
			continue;
		p = (struct bb_pointing){ true, (uint16_t)i, u * (double)s->display.width_px - 0.5,
			                  (1 - v) * (double)s->display.height_px - 0.5, distance };
	}
	return p;
}

void bb_grab_init(struct bb_grab *g, unsigned marker, unsigned frames)
{
	*g = (struct bb_grab){ .marker = marker, .frames = frames ? frames : 1, .release_ns = RELEASE_NS };
}

static enum bb_grab_change change(struct bb_grab *g)
{
	g->against = 0;
	g->held = !g->held;
	return g->held ? BB_GRAB_TAKEN : BB_GRAB_LET_GO;
}

enum bb_grab_change bb_grab_solution(struct bb_grab *g, int64_t at_ns, uint32_t labelled)
{
	const bool covered = !(labelled >> g->marker & 1);

	if (at_ns <= g->seen_ns)
		return BB_GRAB_NONE;
	g->seen_ns = at_ns;
	g->against = covered != g->held ? g->against + 1 : 0;
	return g->against >= g->frames ? change(g) : BB_GRAB_NONE;
}

enum bb_grab_change bb_grab_wait(struct bb_grab *g, int64_t now_ns)
{
	int64_t silent_ns;

	if (__builtin_sub_overflow(now_ns, g->seen_ns, &silent_ns) || silent_ns <= g->release_ns)
		return BB_GRAB_NONE;
	g->against = 0;
	return g->held ? change(g) : BB_GRAB_NONE;
}
