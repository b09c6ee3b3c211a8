#include "render/mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEAF_TRIANGLES 4
#define DEPTH_MOST 64
#define VERTEX_MOST_M 1e6F
#define PLACES_PER_M 0x1p30 /* surfaces at one place are at one distance whichever triangles they are made of */
#define BOX_SLACK_M 1e-9 /* a box is larger than its triangles by what rounding could take off */

/* ---- one ray, one triangle ---- */

struct bb_mesh_ray bb_mesh_ray_at(const struct bb_view *view, uint32_t width, uint32_t height, uint32_t column,
				  uint32_t row)
{
	const struct bb_corners *c = &view->corners;
	const struct bb_vec3 across = bb_vec3_scale(bb_vec3_sub(c->lower_right, c->lower_left), (column + 0.5) / width);
	const struct bb_vec3 down = bb_vec3_scale(bb_vec3_sub(c->lower_left, c->upper_left), (row + 0.5) / height);
	const struct bb_vec3 corner = bb_vec3_sub(c->upper_left, view->eye);
	const struct bb_vec3 d = bb_vec3_unit(bb_vec3_add(bb_vec3_add(corner, across), down), (struct bb_vec3){ 0, 0, -1 });
	struct bb_mesh_ray ray = { .from = { view->eye.x, view->eye.y, view->eye.z }, .direction = { d.x, d.y, d.z } };
	int longest = 0;

	for (int a = 1; a < 3; a++)
		if (fabs(ray.direction[a]) > fabs(ray.direction[longest]))
			longest = a;
	ray.axis[0] = (longest + 1) % 3;
	ray.axis[1] = (longest + 2) % 3;
	ray.axis[2] = longest;
	ray.shear[2] = 1 / ray.direction[longest];
	ray.shear[0] = ray.direction[ray.axis[0]] * ray.shear[2];
	ray.shear[1] = ray.direction[ray.axis[1]] * ray.shear[2];
	return ray;
}

/* A vertex as the ray sees it: itself at 0, 0; the third number is the distance. */
static void seen(const struct bb_mesh_ray *ray, const float v[3], double out[3])
{
	double p[3];

	for (int a = 0; a < 3; a++)
		p[a] = (double)v[ray->axis[a]] - ray->from[ray->axis[a]];
	out[0] = p[0] - ray->shear[0] * p[2];
	out[1] = p[1] - ray->shear[1] * p[2];
	out[2] = p[2] * ray->shear[2];
}

static double cross(const double a[3], const double b[3])
{
	return b[0] * a[1] - b[1] * a[0];
}

/* On which side of the edge from a to b the ray is; swapping them changes the sign and nothing else. */
static int side(double area, const double a[3], const double b[3])
{
	const double moved_x = b[1] - a[1], moved_y = a[0] - b[0];
	const double decides = area != 0 ? area : moved_x != 0 ? moved_x : moved_y;

	return (decides > 0) - (decides < 0);
}

void bb_mesh_colour(const struct bb_mesh *mesh, uint32_t triangle, const double weight[3], double rgba[4])
{
	const uint32_t *corner = mesh->triangle[triangle];

	for (int c = 0; c < 4; c++) {
		double sum = 0;
		for (int k = 0; k < 3; k++)
			sum += weight[k] * (double)mesh->rgba[corner[k]][c];
		rgba[c] = sum > 0 ? (sum < 1 ? sum : 1) : 0;
	}
}

bool bb_mesh_ray_meets(const struct bb_mesh_ray *ray, const struct bb_mesh *mesh, uint32_t triangle,
		       struct bb_mesh_fragment *out)
{
	const uint32_t *corner = mesh->triangle[triangle];
	double p[3][3], weight[3];

	for (int k = 0; k < 3; k++)
		seen(ray, mesh->vertex_m[corner[k]], p[k]);
	for (int k = 0; k < 3; k++)
		weight[k] = cross(p[(k + 1) % 3], p[(k + 2) % 3]);
	const int s = side(weight[0], p[1], p[2]);
	if (!s || side(weight[1], p[2], p[0]) != s || side(weight[2], p[0], p[1]) != s)
		return false;
	const double area = weight[0] + weight[1] + weight[2];
	if (area == 0)
		return false;
	for (int k = 0; k < 3; k++)
		weight[k] /= area;
	const double at_m = weight[0] * p[0][2] + weight[1] * p[1][2] + weight[2] * p[2][2];
	out->at_m = rint(at_m * PLACES_PER_M) / PLACES_PER_M;
	if (!(out->at_m > 0))
		return false;
	out->triangle = triangle;
	bb_mesh_colour(mesh, triangle, weight, out->rgba);
	return true;
}

/* ---- all of a ray ---- */

static bool before(const struct bb_mesh_fragment *a, const struct bb_mesh_fragment *b)
{
	if (a->at_m != b->at_m)
		return a->at_m < b->at_m;
	return a->mesh != b->mesh ? a->mesh < b->mesh : a->triangle < b->triangle;
}

void bb_mesh_fragments_add(struct bb_mesh_fragments *f, const struct bb_mesh_fragment *fragment)
{
	size_t i = f->n;

	while (i > 0 && before(fragment, &f->at[i - 1]))
		i--;
	if (i == BB_MESH_FRAGMENTS_MOST ||
	    (i > 0 && f->at[i - 1].mesh == fragment->mesh && f->at[i - 1].triangle == fragment->triangle))
		return;
	const size_t last = f->n < BB_MESH_FRAGMENTS_MOST ? f->n++ : f->n - 1;
	memmove(&f->at[i + 1], &f->at[i], (last - i) * sizeof(f->at[0]));
	f->at[i] = *fragment;
}

enum bb_status bb_meshes_check(const struct bb_mesh *meshes, size_t n, struct bb_error *err)
{
	for (size_t m = 0; m < n; m++) {
		const struct bb_mesh *mesh = &meshes[m];
		for (size_t v = 0; v < mesh->n_vertices; v++)
			for (int a = 0; a < 3; a++)
				if (!(fabsf(mesh->vertex_m[v][a]) <= VERTEX_MOST_M))
					return bb_fail(err, BB_ERR_RANGE, 1816, NULL, "mesh %zu, vertex %zu", m, v);
		for (size_t t = 0; t < mesh->n_triangles; t++)
			for (int k = 0; k < 3; k++)
				if (mesh->triangle[t][k] >= mesh->n_vertices)
					return bb_fail(err, BB_ERR_RANGE, 1816, NULL, "mesh %zu, triangle %zu", m, t);
	}
	return BB_OK;
}

/* ---- the tree ---- */

struct item { /* a triangle */
	uint32_t mesh, triangle;
	float middle[3];
};

struct box {
	double least[3], most[3];
	uint32_t first, n; /* items; n == 0: its halves are the next box and box number `first` */
};

struct bb_mesh_tree {
	const struct bb_mesh *meshes;
	struct item *items;
	struct box *boxes;
	uint32_t n_items, n_boxes;
};

static const float *vertex(const struct bb_mesh_tree *t, const struct item *i, int k)
{
	const struct bb_mesh *m = &t->meshes[i->mesh];

	return m->vertex_m[m->triangle[i->triangle][k]];
}

static void bound(const struct bb_mesh_tree *t, struct box *b)
{
	for (int a = 0; a < 3; a++) {
		b->least[a] = HUGE_VAL;
		b->most[a] = -HUGE_VAL;
	}
	for (uint32_t i = b->first; i < b->first + b->n; i++)
		for (int k = 0; k < 3; k++) {
			const float *v = vertex(t, &t->items[i], k);
			for (int a = 0; a < 3; a++) {
				b->least[a] = fmin(b->least[a], (double)v[a] - BOX_SLACK_M);
				b->most[a] = fmax(b->most[a], (double)v[a] + BOX_SLACK_M);
			}
		}
}

static int by_middle(const void *a, const void *b, int axis)
{
	const struct item *x = a, *y = b;

	if (x->middle[axis] != y->middle[axis])
		return x->middle[axis] < y->middle[axis] ? -1 : 1;
	if (x->mesh != y->mesh)
		return x->mesh < y->mesh ? -1 : 1;
	return (x->triangle > y->triangle) - (x->triangle < y->triangle);
}

static int by_x(const void *a, const void *b)
{
	return by_middle(a, b, 0);
}

static int by_y(const void *a, const void *b)
{
	return by_middle(a, b, 1);
}

static int by_z(const void *a, const void *b)
{
	return by_middle(a, b, 2);
}

/* Halved at the median until few are left: depth is the logarithm of the number, whatever the mesh. */
static void split(struct bb_mesh_tree *t, uint32_t first, uint32_t n)
{
	static int (*const order[3])(const void *, const void *) = { by_x, by_y, by_z };
	const uint32_t own = t->n_boxes++;
	struct box *b = &t->boxes[own];
	int widest = 0;

	*b = (struct box){ .first = first, .n = n };
	bound(t, b);
	if (n <= LEAF_TRIANGLES)
		return;
	for (int a = 1; a < 3; a++)
		if (b->most[a] - b->least[a] > b->most[widest] - b->least[widest])
			widest = a;
	qsort(t->items + first, n, sizeof(*t->items), order[widest]);
	split(t, first, n / 2);
	b->first = t->n_boxes;
	b->n = 0;
	split(t, first + n / 2, n - n / 2);
}

static void list(struct bb_mesh_tree *t, size_t n)
{
	for (uint32_t m = 0; m < n; m++)
		for (uint32_t k = 0; k < t->meshes[m].n_triangles; k++) {
			struct item *i = &t->items[t->n_items++];
			*i = (struct item){ .mesh = m, .triangle = k };
			for (int a = 0; a < 3; a++)
				i->middle[a] = (vertex(t, i, 0)[a] + vertex(t, i, 1)[a] + vertex(t, i, 2)[a]) / 3;
		}
}

enum bb_status bb_mesh_tree_create(const struct bb_mesh *meshes, size_t n, struct bb_mesh_tree **out,
				   struct bb_error *err)
{
	struct bb_mesh_tree *t = calloc(1, sizeof(*t));
	uint64_t n_items = 0;

	*out = NULL;
	for (size_t m = 0; m < n; m++)
		n_items += meshes[m].n_triangles;
	if (t && n_items < UINT32_MAX / 2) {
		t->meshes = meshes;
		t->items = calloc((size_t)n_items + 1, sizeof(*t->items));
		t->boxes = calloc((size_t)n_items * 2 + 1, sizeof(*t->boxes));
	}
	if (!t || !t->items || !t->boxes) {
		bb_mesh_tree_destroy(t);
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a tree of %llu triangles", (unsigned long long)n_items);
	}
	list(t, n);
	split(t, 0, t->n_items);
	*out = t;
	return BB_OK;
}

void bb_mesh_tree_destroy(struct bb_mesh_tree *t)
{
	if (!t)
		return;
	free(t->items);
	free(t->boxes);
	free(t);
}

static bool through(const struct box *b, const struct bb_mesh_ray *ray, const double inverse[3])
{
	double enter = 0, leave = HUGE_VAL;

	for (int a = 0; a < 3; a++) {
		const double x = (b->least[a] - ray->from[a]) * inverse[a], y = (b->most[a] - ray->from[a]) * inverse[a];
		const double nearer = x < y ? x : y, farther = x < y ? y : x;
		enter = nearer > enter ? nearer : enter;
		leave = farther < leave ? farther : leave;
	}
	return leave >= enter;
}

void bb_mesh_tree_meets(const struct bb_mesh_tree *t, const struct bb_mesh_ray *ray, struct bb_mesh_fragments *out)
{
	uint32_t waiting[DEPTH_MOST], n = 0;
	double inverse[3];

	out->n = 0;
	for (int a = 0; a < 3; a++)
		inverse[a] = fabs(ray->direction[a]) > 1e-100 ? 1 / ray->direction[a] : 1e100;
	waiting[n++] = 0;
	while (n) {
		const uint32_t own = waiting[--n];
		const struct box *b = &t->boxes[own];
		if (!through(b, ray, inverse))
			continue;
		if (!b->n) {
			if (b->first > own) {
				waiting[n++] = b->first;
				waiting[n++] = own + 1;
			}
			continue;
		}
		for (uint32_t i = b->first; i < b->first + b->n; i++) {
			struct bb_mesh_fragment f = { .mesh = t->items[i].mesh };
			if (bb_mesh_ray_meets(ray, &t->meshes[f.mesh], t->items[i].triangle, &f))
				bb_mesh_fragments_add(out, &f);
		}
	}
}
