/*
 * render/stream/select.c: which bricks a set of views can see, and in which order they matter. Frustum planes are taken
 * from the view's matrices and brought into volume space once a view, so a brick costs six dot products. Ranks are
 * whole micrometres with the brick's number below them: no two are equal and every machine sorts them alike.
 */
#include "render/stream/stream_private.h"

#include <math.h>

struct plane { /* inside where dot(n, p) + d >= 0 */
	double n[3], d;
};

static void frustum_of(const struct bb_view *view, const struct bb_pose *pose, struct plane out[6])
{
	const struct bb_mat4 place = bb_mat4_from_pose(pose);
	const struct bb_mat4 eye = bb_mat4_mul(&view->view, &place);
	const struct bb_mat4 clip = bb_mat4_mul(&view->projection, &eye);
	const double *m = clip.m;

	for (int i = 0; i < 6; i++) { /* w + x, w - x, w + y ... are not negative inside */
		const int row = i / 2;
		const double sign = i & 1 ? -1 : 1;
		for (int c = 0; c < 3; c++)
			out[i].n[c] = m[c * 4 + 3] + sign * m[c * 4 + row];
		out[i].d = m[15] + sign * m[12 + row];
	}
}

/* Wholly outside one plane. A box at a frustum's corner may be kept although it cannot be seen: harmless. */
static bool outside(const struct plane frustum[6], const double c[3], const double h[3])
{
	for (int i = 0; i < 6; i++) {
		const struct plane *p = &frustum[i];
		const double middle = p->n[0] * c[0] + p->n[1] * c[1] + p->n[2] * c[2] + p->d;
		const double reach = fabs(p->n[0]) * h[0] + fabs(p->n[1]) * h[1] + fabs(p->n[2]) * h[2];
		if (middle + reach < 0)
			return true;
	}
	return false;
}

static uint32_t distance_um(const double c[3], struct bb_vec3 eye)
{
	const double x = c[0] - eye.x, y = c[1] - eye.y, z = c[2] - eye.z;
	const double um = sqrt(x * x + y * y + z * z) * 1e6;

	return um < 4e9 ? (uint32_t)um : 4000000000u; /* NaN and 4 km are far */
}

static void add_view(struct bb_stream *s, const struct bb_view *view)
{
	const struct bb_pose *pose = &s->config.placement.pose;
	const struct bb_vec3 eye = bb_pose_inverse_apply(pose, view->eye);
	const uint32_t *grid = s->atlas.grid;
	struct plane frustum[6];
	uint32_t *near_um = s->near_um;
	double c[3], h[3];

	frustum_of(view, pose, frustum);
	for (uint32_t z = 0; z < grid[2]; z++) {
		c[2] = s->centre_m[2][z];
		h[2] = s->half_m[2][z];
		for (uint32_t y = 0; y < grid[1]; y++) {
			c[1] = s->centre_m[1][y];
			h[1] = s->half_m[1][y];
			for (uint32_t x = 0; x < grid[0]; x++, near_um++) {
				c[0] = s->centre_m[0][x];
				h[0] = s->half_m[0][x];
				if (outside(frustum, c, h))
					continue;
				const uint32_t um = distance_um(c, eye);
				if (um < *near_um)
					*near_um = um;
			}
		}
	}
}

void bb_select_seen(struct bb_stream *s, const struct bb_view *views, size_t n_views)
{
	for (uint32_t b = 0; b < s->n_bricks; b++)
		s->near_um[b] = BB_UNSEEN;
	for (size_t i = 0; i < n_views; i++)
		add_view(s, &views[i]);
}

size_t bb_select_gather(const struct bb_stream *s, uint32_t step, uint64_t *out)
{
	const uint32_t first = step * s->n_bricks;
	size_t n = 0;

	for (uint32_t b = 0; b < s->n_bricks; b++) {
		const uint32_t um = s->near_um[b], gid = first + b;
		if (um == BB_UNSEEN || s->empty[gid])
			continue;
		/* A brick that is here counts as an eighth nearer, or a swaying head would swap two of them for ever. */
		const uint32_t rank = s->where[gid] >= 0 ? um - um / 8 : um;
		out[n++] = (uint64_t)rank << 32 | gid;
	}
	return n;
}

static void sift_down(uint64_t *heap, size_t n, size_t i)
{
	const uint64_t moving = heap[i];

	for (size_t child; (child = 2 * i + 1) < n; i = child) {
		if (child + 1 < n && heap[child + 1] < heap[child])
			child++;
		if (moving <= heap[child])
			break;
		heap[i] = heap[child];
	}
	heap[i] = moving;
}

void bb_heap_make(uint64_t *heap, size_t n)
{
	for (size_t i = n / 2; i-- > 0;)
		sift_down(heap, n, i);
}

uint64_t bb_heap_pop(uint64_t *heap, size_t n)
{
	const uint64_t least = heap[0];

	heap[0] = heap[n - 1];
	heap[n - 1] = least;
	if (n > 1)
		sift_down(heap, n - 1, 0);
	return least;
}
