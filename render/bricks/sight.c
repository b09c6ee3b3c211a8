#include "render/bricks/sight.h"

#include <math.h>
#include <string.h>

#define HALF_TURN 3.14159265358979323846
#define SLACK 1e-9 /* of the volume's size: what rounding may take from a box that only touches */

/* ---- frusta ---- */

static void to_array(struct bb_vec3 v, double out[3])
{
	out[0] = v.x;
	out[1] = v.y;
	out[2] = v.z;
}

/* A plane through p, positive where n points to; n is made a unit. */
static void plane(struct bb_vec3 n, struct bb_vec3 p, double out[4])
{
	n = bb_vec3_unit(n, (struct bb_vec3){ 0, 0, 0 });
	to_array(n, out);
	out[3] = -bb_vec3_dot(n, p);
}

/* How far the frustum, which has no end, reaches along each axis: on a side where no corner's ray goes, to the eye. */
static void reach(struct bb_sight_frustum *f, const struct bb_vec3 corner[4])
{
	for (int a = 0; a < 3; a++)
		f->low[a] = f->high[a] = f->eye[a];
	for (int i = 0; i < 4; i++) {
		double way[3];
		to_array(corner[i], way);
		for (int a = 0; a < 3; a++) {
			f->low[a] = way[a] < 0 ? -(double)INFINITY : f->low[a];
			f->high[a] = way[a] > 0 ? (double)INFINITY : f->high[a];
		}
	}
}

static struct bb_sight_frustum frustum_of(const struct bb_sight_view *view, const struct bb_pose *pose)
{
	const struct bb_view *v = view->view;
	const struct bb_quat turn = bb_quat_conj(bb_quat_unit(pose->q));
	const struct bb_vec3 across = bb_vec3_sub(v->corners.lower_right, v->corners.lower_left);
	const struct bb_vec3 rise = bb_vec3_sub(v->corners.upper_left, v->corners.lower_left);
	const struct bb_vec3 low_left = bb_vec3_sub(v->corners.lower_left, v->eye);
	const struct bb_vec3 eye = bb_quat_rotate(turn, bb_vec3_sub(v->eye, pose->p));
	const struct bb_vec3 ahead = bb_quat_rotate(turn, bb_vec3_scale(v->normal, -1));
	const struct bb_vec3 corner[4] = {
		/* around the wall, from the eye */
		bb_quat_rotate(turn, low_left),
		bb_quat_rotate(turn, bb_vec3_add(low_left, across)),
		bb_quat_rotate(turn, bb_vec3_add(bb_vec3_add(low_left, across), rise)),
		bb_quat_rotate(turn, bb_vec3_add(low_left, rise)),
	};
	const struct bb_vec3 middle = bb_vec3_add(corner[0], corner[2]);
	const double wall_m = bb_vec3_dot(corner[0], ahead);
	const double per_m = fmax(view->width_px / bb_vec3_norm(across), view->height_px / bb_vec3_norm(rise));
	struct bb_sight_frustum f = { .near_m = v->near_m, .least_cosine = 1, .pixels = per_m * wall_m };

	to_array(eye, f.eye);
	plane(ahead, eye, f.depth);
	for (int i = 0; i < 4; i++) {
		struct bb_vec3 inward = bb_vec3_cross(corner[i], corner[(i + 1) % 4]);
		if (bb_vec3_dot(inward, middle) < 0)
			inward = bb_vec3_scale(inward, -1);
		plane(inward, eye, f.side[i]);
		f.least_cosine = fmin(f.least_cosine, wall_m / bb_vec3_norm(corner[i]));
	}
	reach(&f, corner);
	return f;
}

void bb_sight_prepare(const struct bb_tree *tree, enum bb_brick_grid grid, const double extent[6],
		      const struct bb_pose *pose, struct bb_vec3 size_m, const struct bb_sight_view *views,
		      size_t n_views, const float *seen, struct bb_sight_frustum *frusta, struct bb_sight *out)
{
	double size[3];

	*out = (struct bb_sight){ .tree = tree, .grid = grid, .frusta = frusta, .n_frusta = n_views, .seen = seen };
	to_array(size_m, size);
	const double diameter = fmax(size[0], fmax(size[1], size[2]));
	for (int a = 0; a < 3; a++) {
		if (grid == BB_BRICK_SPHERICAL) {
			const double unit = a ? 1 : diameter / 2 / extent[1];
			out->from[a] = extent[2 * a] * unit;
			out->voxel[a] = (extent[2 * a + 1] - extent[2 * a]) * unit / tree->dim[a];
			out->scale[a] = size[a] / diameter;
		} else {
			out->from[a] = -size[a] / 2;
			out->voxel[a] = size[a] / tree->dim[a];
		}
	}
	for (size_t i = 0; i < n_views; i++)
		frusta[i] = frustum_of(&views[i], pose);
}

/* ---- nodes ---- */

struct box {
	double centre[3], half[3];
	double voxel_m; /* of the data, its longest edge there */
	uint32_t up;    /* levels above the data's own */
};

/* From low to high, of which the cosine is asked: at its ends, or 1 and -1 where it passes them. */
static void cosines(double low, double high, double *least, double *most)
{
	const double a = cos(low), b = cos(high);

	*least = floor((high + HALF_TURN) / (2 * HALF_TURN)) > floor((low + HALF_TURN) / (2 * HALF_TURN)) ? -1
													  : fmin(a, b);
	*most = floor(high / (2 * HALF_TURN)) > floor(low / (2 * HALF_TURN)) ? 1 : fmax(a, b);
}

static void span_product(double least, double most, double low, double high, double out[2])
{
	out[0] = least < 0 ? least * high : least * low; /* low, high: not negative */
	out[1] = most < 0 ? most * low : most * high;
}

/* The box around a part of the ball: r, theta from +y, phi from +x to +z. */
static void around_part(const struct bb_sight *s, const double low[3], const double high[3], struct box *b)
{
	const double r0 = fmax(low[0], 0), r1 = high[0];
	const double theta0 = fmax(low[1], 0), theta1 = fmin(high[1], HALF_TURN);
	const double ring0 = sin(theta0), ring1 = sin(theta1);
	const double ring = theta0 <= HALF_TURN / 2 && theta1 >= HALF_TURN / 2 ? 1 : fmax(ring0, ring1);
	double least, most, span[3][2];

	cosines(theta0, theta1, &least, &most);
	span_product(least, most, r0, r1, span[1]);
	cosines(low[2], high[2], &least, &most);
	span_product(least, most, r0 * fmin(ring0, ring1), r1 * ring, span[0]);
	cosines(low[2] - HALF_TURN / 2, high[2] - HALF_TURN / 2, &least, &most);
	span_product(least, most, r0 * fmin(ring0, ring1), r1 * ring, span[2]);
	for (int a = 0; a < 3; a++) {
		b->centre[a] = (span[a][0] + span[a][1]) / 2 * s->scale[a];
		b->half[a] = (span[a][1] - span[a][0]) / 2 * s->scale[a];
	}
	b->voxel_m = fmax(s->voxel[0], r1 * fmax(s->voxel[1], ring * s->voxel[2]));
}

static struct box box_of(const struct bb_sight *s, uint32_t node)
{
	const struct bb_tree *t = s->tree;
	const struct bb_tree_place p = bb_tree_place(t, node);
	struct box b = { .up = t->n_levels - 1 - p.level };
	const uint64_t edge = (uint64_t)t->edge << b.up;
	const double border = ldexp(0.5, (int)b.up);
	double low[3], high[3];

	for (int a = 0; a < 3; a++) {
		const uint64_t from = p.at[a] * edge, to = from + edge < t->dim[a] ? from + edge : t->dim[a];
		low[a] = s->from[a] + ((double)from - border) * s->voxel[a];
		high[a] = s->from[a] + ((double)to + border) * s->voxel[a];
		b.centre[a] = (low[a] + high[a]) / 2;
		b.half[a] = (high[a] - low[a]) / 2;
	}
	if (s->grid == BB_BRICK_SPHERICAL)
		around_part(s, low, high, &b);
	else
		b.voxel_m = fmax(s->voxel[0], fmax(s->voxel[1], s->voxel[2]));
	return b;
}

static double centre_of(const double n[4], const struct box *b)
{
	return n[0] * b->centre[0] + n[1] * b->centre[1] + n[2] * b->centre[2] + n[3];
}

static double half_of(const double n[4], const struct box *b)
{
	return fabs(n[0]) * b->half[0] + fabs(n[1]) * b->half[1] + fabs(n[2]) * b->half[2];
}

/* Metres in front of the eye where the box can first be seen, 0: it cannot. A line of sight as long as the way to the
 * box's nearest point is at least that, times the least cosine, deep. */
static double nearest(const struct bb_sight_frustum *f, const struct box *b)
{
	const double slack = SLACK * (b->half[0] + b->half[1] + b->half[2]);
	const double front = half_of(f->depth, b), at = centre_of(f->depth, b);
	double way = 0;

	if (at + front < -slack)
		return 0;
	for (int i = 0; i < 4; i++)
		if (centre_of(f->side[i], b) + half_of(f->side[i], b) < -slack)
			return 0;
	for (int a = 0; a < 3; a++) {
		const double from = b->centre[a] - b->half[a], to = b->centre[a] + b->half[a];
		if (to < f->low[a] - slack || from > f->high[a] + slack)
			return 0;
		const double off = fmax(0, fabs(f->eye[a] - b->centre[a]) - b->half[a]);
		way += off * off;
	}
	return fmax(f->near_m, fmax(at - front, sqrt(way) * f->least_cosine));
}

/* Of a voxel of the data, in the view where it is widest; 0: no view sees the box. */
static double pixels_of(const struct bb_sight *s, const struct box *b)
{
	double most = 0;

	for (size_t i = 0; i < s->n_frusta; i++) {
		const struct bb_sight_frustum *f = &s->frusta[i];
		const double depth_m = nearest(f, b);
		if (depth_m > 0)
			most = fmax(most, f->pixels / depth_m * b->voxel_m);
	}
	return fmin(most, BB_SIGHT_PIXELS_MOST);
}

float bb_sight_pixels(const struct bb_sight *s, uint32_t node)
{
	const struct box b = box_of(s, node);

	return (float)ldexp(pixels_of(s, &b), (int)b.up);
}

float bb_sight_weight(const struct bb_sight *s, uint32_t node)
{
	const struct box b = box_of(s, node);
	const double pixels = pixels_of(s, &b);
	const double seen = s->seen ? (double)s->seen[node] : 1;

	if (!(ldexp(pixels, (int)b.up) > 1))
		return 0;
	return (float)(pixels * pixels * fmax(seen, BB_SIGHT_SEEN_LEAST));
}

void bb_sight_weights(const struct bb_sight *s, float *out)
{
	for (uint32_t node = 0; node < s->tree->n_nodes; node++) {
		const uint32_t parent = bb_tree_parent(s->tree, node);
		out[node] = parent == BB_TREE_NONE || out[parent] > 0 ? bb_sight_weight(s, node) : 0;
	}
}

void bb_sight_seen(const struct bb_tree *tree, float *seen)
{
	memset(seen, 0, tree->first[tree->n_levels - 1] * sizeof(*seen));
	for (uint32_t node = tree->n_nodes; node-- > 1;) { /* children come after their parents */
		const uint32_t parent = bb_tree_parent(tree, node);
		seen[parent] = seen[node] > seen[parent] ? seen[node] : seen[parent];
	}
}
