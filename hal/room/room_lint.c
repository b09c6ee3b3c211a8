/*
 * hal/room/room_lint.c: geometry that loads but cannot be right: findings 1150 to 1160. Pure, no allocation. Metres.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "hal/room/room_build.h"

#define TOUCH_M 5e-3          /* walls this close meet; sums may be off by this */
#define GAP_MOST_M 0.3        /* edges further apart were never meant to meet */
#define PARALLEL 0.99985      /* cosine of 1 degree */
#define CORNER_COS 0.866      /* walls that differ by more than 30 degrees make a corner, not a row of screens */
#define SQUARE_SINE 0.002     /* 0.1 degree: 5 mm over 2.5 m */
#define MOUNT_M 0.1           /* a camera's housing may stand this far behind the picture */
#define ABOVE_M 0.5           /* cameras hang above the walls' top edges */
#define ALIKE_M 2e-3
#define BELOW_EYES_MM 50.0
#define ABOVE_EYES_MM 80.0

struct sink {
	struct bb_finding *findings;
	size_t cap, n;
};

BB_PRINTF(4, 5)
static void find(struct sink *s, int number, int severity, const char *fmt, ...)
{
	va_list ap;

	if (s->n < s->cap) {
		struct bb_finding *f = &s->findings[s->n];
		f->number = number;
		f->severity = severity;
		va_start(ap, fmt);
		vsnprintf(f->text, sizeof(f->text), fmt, ap);
		va_end(ap);
	}
	s->n++;
}

static struct bb_vec3 corner(const struct bb_corners *c, int i) /* around the rectangle */
{
	return bb_corners_at(c, i == 1 || i == 2, i >= 2);
}

static double axis_of(struct bb_vec3 v, int axis)
{
	return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

/* Distance in front of a wall's plane. */
static double in_front(const struct bb_corners *c, struct bb_vec3 p)
{
	return bb_vec3_dot(bb_corners_normal(c), bb_vec3_sub(p, c->lower_left));
}

/* Where a point lies along a wall's edges, in metres from the lower left; a skewed wall is taken as it is. */
static void along(const struct bb_corners *c, struct bb_vec3 p, double *right_m, double *up_m)
{
	const struct bb_vec3 x = { 1, 0, 0 }, d = bb_vec3_sub(p, c->lower_left);

	*right_m = bb_vec3_dot(d, bb_vec3_unit(bb_vec3_sub(c->lower_right, c->lower_left), x));
	*up_m = bb_vec3_dot(d, bb_vec3_unit(bb_vec3_sub(c->upper_left, c->lower_left), x));
}

static bool over_wall(const struct bb_corners *c, struct bb_vec3 p, double slack_m)
{
	double right, up;

	along(c, p, &right, &up);
	return right > -slack_m && right < bb_vec3_norm(bb_vec3_sub(c->lower_right, c->lower_left)) + slack_m &&
	       up > -slack_m && up < bb_vec3_norm(bb_vec3_sub(c->upper_left, c->lower_left)) + slack_m;
}

/* --- inside and outside ------------------------------------------------------------------------------------------- */

/*
 * Which way is in: 1 as the corners say, -1 when the middle of all walls lies behind this one. So one wall that faces
 * away is one finding, and does not put everything else outside.
 */
static double facing(const struct bb_room *room, const struct bb_corners *c)
{
	const struct bb_vec3 middle = bb_vec3_scale(bb_vec3_add(room->min, room->max), 0.5);

	return in_front(c, middle) < -TOUCH_M ? -1 : 1;
}

static double depth_in(const struct bb_room *room, const struct bb_corners *c, struct bb_vec3 p)
{
	return facing(room, c) * in_front(c, p);
}

static bool face_each_other(const struct bb_room *room, const struct bb_corners *a, const struct bb_corners *b)
{
	const double cosine = bb_vec3_dot(bb_corners_normal(a), bb_corners_normal(b));

	return fabs(cosine) > 0.9 && depth_in(room, a, bb_corners_at(b, 0.5, 0.5)) > TOUCH_M &&
	       depth_in(room, b, bb_corners_at(a, 0.5, 0.5)) > TOUCH_M;
}

bool bb_room_contains(const struct bb_room *room, struct bb_vec3 p, double slack_m)
{
	bool enclosed = false;

	for (size_t i = 0; i < room->n_walls; i++) {
		const struct bb_corners *a = &room->walls[i].corners;
		const bool behind = depth_in(room, a, p) < -slack_m;

		if (behind && over_wall(a, p, slack_m))
			return false;
		for (size_t j = i + 1; j < room->n_walls; j++) {
			const struct bb_corners *b = &room->walls[j].corners;
			if (!face_each_other(room, a, b))
				continue;
			enclosed = true;
			if (behind || depth_in(room, b, p) < -slack_m)
				return false;
		}
	}
	return !enclosed || (p.y >= room->min.y - slack_m && p.y <= room->max.y + ABOVE_M + slack_m);
}

/* --- walls -------------------------------------------------------------------------------------------------------- */

static void lint_wall(struct sink *s, const struct bb_room *room, const struct bb_wall *w)
{
	const struct bb_vec3 x = { 1, 0, 0 };
	const struct bb_vec3 right = bb_vec3_unit(bb_vec3_sub(w->corners.lower_right, w->corners.lower_left), x);
	const struct bb_vec3 up = bb_vec3_unit(bb_vec3_sub(w->corners.upper_left, w->corners.lower_left), x);
	const double lean = bb_vec3_dot(right, up);

	if (facing(room, &w->corners) < 0 || (room->n_walls == 1 && in_front(&w->corners, room->neutral) <= 0))
		find(s, 1152, 1, "wall/%s (line %d): its picture faces outwards", w->id, w->line);
	if (fabs(lean) > SQUARE_SINE)
		find(s, 1153, 1, "wall/%s (line %d): %.2f degrees between its edges, not 90", w->id, w->line,
		     acos(lean) * 57.29577951308232);
}

/* Do b's corners and a overlap by more than TOUCH_M along both edges of a? */
static bool overlap_along(const struct bb_corners *a, const struct bb_corners *b)
{
	double least[2] = { (double)INFINITY, (double)INFINITY }, most[2] = { (double)-INFINITY, (double)-INFINITY };
	const double size[2] = { bb_vec3_norm(bb_vec3_sub(a->lower_right, a->lower_left)),
		                 bb_vec3_norm(bb_vec3_sub(a->upper_left, a->lower_left)) };

	for (int i = 0; i < 4; i++) {
		double at[2];
		along(a, corner(b, i), &at[0], &at[1]);
		for (int k = 0; k < 2; k++) {
			least[k] = fmin(least[k], at[k]);
			most[k] = fmax(most[k], at[k]);
		}
	}
	return fmin(most[0], size[0]) - fmax(least[0], 0) > TOUCH_M && fmin(most[1], size[1]) - fmax(least[1], 0) > TOUCH_M;
}

static bool coplanar(const struct bb_corners *a, const struct bb_corners *b)
{
	return fabs(bb_vec3_dot(bb_corners_normal(a), bb_corners_normal(b))) > PARALLEL &&
	       fabs(in_front(a, bb_corners_at(b, 0.5, 0.5))) < TOUCH_M;
}

/*
 * Where b goes through a's plane: two points of its rim. False when b only touches it (a corner, a wall that ends on
 * another), that is when it does not reach to both sides by more than TOUCH_M.
 */
static bool cut(const struct bb_corners *a, const struct bb_corners *b, struct bb_vec3 ends[2])
{
	double least = (double)INFINITY, most = (double)-INFINITY;
	int n = 0;

	for (int i = 0; i < 4; i++) {
		const struct bb_vec3 p = corner(b, i), q = corner(b, (i + 1) % 4);
		const double dp = in_front(a, p), dq = in_front(a, q);

		least = fmin(least, dp);
		most = fmax(most, dp);
		if ((dp < 0) != (dq < 0) && n < 2)
			ends[n++] = bb_vec3_lerp(p, q, dp / (dp - dq));
	}
	return n == 2 && least < -TOUCH_M && most > TOUCH_M;
}

/* Two walls cross where their cuts, which lie on one line, have more than a point in common. */
static bool cross(const struct bb_corners *a, const struct bb_corners *b)
{
	struct bb_vec3 in_a[2], in_b[2];

	if (!cut(a, b, in_b) || !cut(b, a, in_a))
		return false;
	const struct bb_vec3 line = bb_vec3_unit(bb_vec3_sub(in_a[1], in_a[0]), (struct bb_vec3){ 0, 1, 0 });
	const double length = bb_vec3_norm(bb_vec3_sub(in_a[1], in_a[0]));
	const double u = bb_vec3_dot(line, bb_vec3_sub(in_b[0], in_a[0])), v = bb_vec3_dot(line, bb_vec3_sub(in_b[1], in_a[0]));
	return fmin(fmax(u, v), length) - fmax(fmin(u, v), 0) > TOUCH_M;
}

/* How far apart the nearest two edges of two walls are, as the larger distance of their ends. */
static double edge_distance(const struct bb_corners *a, const struct bb_corners *b, double *shorter)
{
	double best = (double)INFINITY;

	for (int i = 0; i < 16; i++) {
		const struct bb_vec3 a0 = corner(a, i / 4), a1 = corner(a, (i / 4 + 1) % 4);
		const struct bb_vec3 b0 = corner(b, i % 4), b1 = corner(b, (i % 4 + 1) % 4);
		const double same = fmax(bb_vec3_norm(bb_vec3_sub(a0, b0)), bb_vec3_norm(bb_vec3_sub(a1, b1)));
		const double swapped = fmax(bb_vec3_norm(bb_vec3_sub(a0, b1)), bb_vec3_norm(bb_vec3_sub(a1, b0)));

		if (fmin(same, swapped) >= best)
			continue;
		best = fmin(same, swapped);
		*shorter = fmin(bb_vec3_norm(bb_vec3_sub(a1, a0)), bb_vec3_norm(bb_vec3_sub(b1, b0)));
	}
	return best;
}

static void lint_pair(struct sink *s, const struct bb_wall *a, const struct bb_wall *b)
{
	const bool flat = coplanar(&a->corners, &b->corners);
	const double cosine = fabs(bb_vec3_dot(bb_corners_normal(&a->corners), bb_corners_normal(&b->corners)));
	double shorter = 0, apart;

	if (flat ? overlap_along(&a->corners, &b->corners) && overlap_along(&b->corners, &a->corners)
	         : cross(&a->corners, &b->corners)) {
		find(s, 1150, 1, "wall/%s (line %d) and wall/%s (line %d) overlap", a->id, a->line, b->id, b->line);
		return;
	}
	apart = edge_distance(&a->corners, &b->corners, &shorter);
	/* screens side by side on a desk may stand apart; a corner that does not close is a mistake */
	if (apart > TOUCH_M && apart < fmin(GAP_MOST_M, 0.25 * shorter))
		find(s, 1151, cosine < CORNER_COS, "wall/%s (line %d) and wall/%s (line %d) come within %.0f mm and do not meet",
		     a->id, a->line, b->id, b->line, apart * 1e3);
}

/* --- sums --------------------------------------------------------------------------------------------------------- */

/* Length along an axis that the walls in the plane of wall `first` cover together, overlaps counted once. */
static double covered(const struct bb_room *room, size_t first, int axis)
{
	double from[BB_ROOM_WALLS_MAX], to[BB_ROOM_WALLS_MAX], sum = 0, end = (double)-INFINITY;
	size_t n = 0;

	for (size_t i = 0; i < room->n_walls && n < BB_ROOM_WALLS_MAX; i++) {
		const struct bb_corners *c = &room->walls[i].corners;
		double low = (double)INFINITY, high = (double)-INFINITY;
		size_t at = n;

		if (i != first && !coplanar(&room->walls[first].corners, c))
			continue;
		for (int k = 0; k < 4; k++) {
			low = fmin(low, axis_of(corner(c, k), axis));
			high = fmax(high, axis_of(corner(c, k), axis));
		}
		for (; at > 0 && from[at - 1] > low; at--) { /* kept sorted */
			from[at] = from[at - 1];
			to[at] = to[at - 1];
		}
		from[at] = low;
		to[at] = high;
		n++;
	}
	for (size_t i = 0; i < n; i++) {
		sum += fmax(0, to[i] - fmax(from[i], end));
		end = fmax(end, to[i]);
	}
	return sum;
}

static void lint_sums(struct sink *s, const struct bb_room *room)
{
	static const char *const names[] = { "wide (x)", "high (y)", "deep (z)" };

	for (int axis = 0; axis < 3; axis++) {
		const double size = axis_of(room->size_m, axis), box = axis_of(room->max, axis) - axis_of(room->min, axis);

		if (size > 0 && box > TOUCH_M && fabs(box - size) > TOUCH_M)
			find(s, 1154, 1, "room: %.4f m %s by size_m, its walls span %.4f m", size, names[axis], box);
		for (size_t i = 0; i < room->n_walls && size > 0 && axis != 1; i++) {
			const struct bb_vec3 n = bb_corners_normal(&room->walls[i].corners);
			const double sum = covered(room, i, axis);
			/* walls that lie across this axis, once per plane; the box has told of all of them being off */
			if (fabs(axis_of(n, axis)) > 0.01 || fmax(fabs(n.x), fmax(fabs(n.y), fabs(n.z))) < PARALLEL)
				continue;
			if (fabs(sum - size) > TOUCH_M && fabs(box - size) <= TOUCH_M)
				find(s, 1154, 1, "wall/%s (line %d): %.4f m of the room's %.4f m %s", room->walls[i].id,
				     room->walls[i].line, sum, size, names[axis]);
		}
	}
}

/* --- people and cameras ------------------------------------------------------------------------------------------- */

static void lint_viewer(struct sink *s, const struct bb_room *room)
{
	const double eyes_mm = room->eye_separation_m * 1e3;

	if (eyes_mm < BELOW_EYES_MM || eyes_mm > ABOVE_EYES_MM)
		find(s, 1155, 1, "room: eyes %.4g mm apart, people have %g to %g", eyes_mm, BELOW_EYES_MM, ABOVE_EYES_MM);
	if (room->n_walls > 1 && !bb_room_contains(room, room->neutral, 0))
		find(s, 1157, 1, "room: the neutral point [%.3f, %.3f, %.3f] m is outside", room->neutral.x, room->neutral.y,
		     room->neutral.z);
}

static void lint_camera(struct sink *s, const struct bb_room *room, const struct bb_camera_config *c)
{
	const struct bb_vec3 axis = bb_quat_rotate(c->pose.q, (struct bb_vec3){ 0, 0, 1 });
	const struct bb_vec3 ahead = bb_vec3_add(c->pose.p, bb_vec3_scale(axis, 0.5));

	if (!bb_room_contains(room, c->pose.p, MOUNT_M))
		find(s, 1156, 1, "camera/%s at [%.3f, %.3f, %.3f] m is outside", c->id, c->pose.p.x, c->pose.p.y, c->pose.p.z);
	else if (!bb_room_contains(room, ahead, 0.02))
		find(s, 1158, 1, "camera/%s looks out of the room", c->id);
}

static void lint_coverage(struct sink *s, const struct bb_room *room)
{
	const size_t wanted = room->n_cameras < 2 ? room->n_cameras : 2;
	size_t seen = 0;

	for (size_t i = 0; i < room->n_cameras; i++)
		seen += bb_camera_sees(&room->cameras[i], room->neutral, 0);
	if (seen < wanted)
		find(s, 1159, 0, "room: %zu of %zu cameras see the neutral point [%.3f, %.3f, %.3f] m", seen, room->n_cameras,
		     room->neutral.x, room->neutral.y, room->neutral.z);
}

static void lint_body(struct sink *s, const struct bb_body *body)
{
	double d[15], least = (double)INFINITY;
	size_t n = 0;

	for (size_t i = 0; i < body->n_markers; i++)
		for (size_t j = 0; j < i && n < BB_ARRAY_LEN(d); j++)
			d[n++] = bb_vec3_norm(bb_vec3_sub(body->marker[i], body->marker[j]));
	for (size_t i = 0; i < n; i++)
		for (size_t j = 0; j < i; j++)
			least = fmin(least, fabs(d[i] - d[j]));
	if (least < ALIKE_M)
		find(s, 1160, 0, "body/%s: two distances between markers differ by %.1f mm only", body->id, least * 1e3);
}

size_t bb_room_lint(const struct bb_room *room, struct bb_finding *findings, size_t cap)
{
	struct sink s = { findings, findings ? cap : 0, 0 };

	for (size_t i = 0; i < room->n_walls; i++)
		lint_wall(&s, room, &room->walls[i]);
	for (size_t i = 0; i < room->n_walls; i++)
		for (size_t j = i + 1; j < room->n_walls; j++)
			lint_pair(&s, &room->walls[i], &room->walls[j]);
	lint_sums(&s, room);
	lint_viewer(&s, room);
	for (size_t i = 0; i < room->n_cameras; i++)
		lint_camera(&s, room, &room->cameras[i]);
	lint_coverage(&s, room);
	for (size_t i = 0; i < room->n_bodies; i++)
		lint_body(&s, &room->bodies[i]);
	return s.n;
}
