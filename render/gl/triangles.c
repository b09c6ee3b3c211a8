#include "render/gl/triangles.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/mesh.h"

#define TILE BB_GL_TILE_PIXELS
#define LEAST_DEPTH 1e-9 /* of what can be seen, in distances to the screen */
#define TRIANGLES_MOST (1u << 24) /* their numbers travel as floats */
#define PIXEL_SLACK 1e-3

void bb_gl_triangles_init(struct bb_gl_triangles *t, const struct bb_gl *gl)
{
	*t = (struct bb_gl_triangles){ 0 };
	gl->GenBuffers(BB_GL_LISTS, t->buffer);
	gl->GenTextures(BB_GL_LISTS, t->texture);
	gl->GetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &t->most);
}

void bb_gl_triangles_forget(struct bb_gl_triangles *t)
{
	t->colours_sent = t->tiles_sent = false;
}

void bb_gl_triangles_release(struct bb_gl_triangles *t, const struct bb_gl *gl)
{
	gl->DeleteTextures(BB_GL_LISTS, t->texture);
	gl->DeleteBuffers(BB_GL_LISTS, t->buffer);
	free(t->meshes);
	*t = (struct bb_gl_triangles){ 0 };
}

void bb_gl_triangles_bind(const struct bb_gl_triangles *t, const struct bb_gl *gl, unsigned unit)
{
	for (unsigned k = 0; k < BB_GL_LISTS; k++) {
		gl->ActiveTexture(GL_TEXTURE0 + unit + k);
		gl->BindTexture(GL_TEXTURE_BUFFER, t->texture[k]);
	}
}

static enum bb_status send(struct bb_gl_triangles *t, const struct bb_gl *gl, enum bb_gl_list which, const void *bytes,
			   size_t n_texels, uint64_t *upload_bytes, struct bb_error *err)
{
	static const float nothing[4] = { 0 };
	const size_t texel_bytes = which == BB_GL_TILES ? sizeof(uint32_t) : 4 * sizeof(float);

	if (n_texels > (size_t)t->most)
		return bb_fail(err, BB_ERR_RANGE, 1814, NULL, "%zu numbers, buffers end at %d", n_texels, t->most);
	gl->BindBuffer(GL_TEXTURE_BUFFER, t->buffer[which]);
	gl->BufferData(GL_TEXTURE_BUFFER, (GLsizeiptr)((n_texels ? n_texels : 1) * texel_bytes),
		       n_texels ? bytes : nothing, GL_STREAM_DRAW);
	gl->ActiveTexture(GL_TEXTURE0);
	gl->BindTexture(GL_TEXTURE_BUFFER, t->texture[which]);
	gl->TexBuffer(GL_TEXTURE_BUFFER, which == BB_GL_TILES ? GL_R32UI : GL_RGBA32F, t->buffer[which]);
	*upload_bytes += n_texels * texel_bytes;
	return BB_OK;
}

/* ---- the meshes ---- */

static bool same_meshes(const struct bb_gl_triangles *t, const struct bb_draw *draw)
{
	if (t->n_meshes != draw->n_meshes)
		return false;
	for (size_t m = 0; m < draw->n_meshes; m++) {
		const struct bb_mesh *a = &t->meshes[m], *b = &draw->meshes[m];
		if (a->vertex_m != b->vertex_m || a->rgba != b->rgba || a->triangle != b->triangle ||
		    a->n_vertices != b->n_vertices || a->n_triangles != b->n_triangles || a->generation != b->generation)
			return false;
	}
	return true;
}

static size_t count(const struct bb_draw *draw)
{
	size_t n = 0;

	for (size_t m = 0; m < draw->n_meshes; m++)
		n += draw->meshes[m].n_triangles;
	return n;
}

static enum bb_status send_colours(struct bb_gl_triangles *t, const struct bb_gl *gl, const struct bb_draw *draw,
				   uint64_t *upload_bytes, struct bb_error *err)
{
	const size_t n = count(draw);
	float(*colour)[4] = malloc((n * 3 + 1) * sizeof(*colour));
	size_t i = 0;

	if (!colour)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "colours of %zu triangles", n);
	for (size_t m = 0; m < draw->n_meshes; m++) {
		const struct bb_mesh *mesh = &draw->meshes[m];
		for (size_t k = 0; k < (size_t)mesh->n_triangles * 3; k++)
			memcpy(colour[i++], mesh->rgba[mesh->triangle[k / 3][k % 3]], sizeof(*colour));
	}
	const enum bb_status st = send(t, gl, BB_GL_COLOURS, colour, n * 3, upload_bytes, err);
	free(colour);
	return st;
}

static enum bb_status adopt(struct bb_gl_triangles *t, const struct bb_gl *gl, const struct bb_draw *draw,
			    uint64_t *upload_bytes, struct bb_error *err)
{
	bb_gl_triangles_forget(t);
	enum bb_status st = bb_meshes_check(draw->meshes, draw->n_meshes, err);
	if (st != BB_OK)
		return st;
	if (count(draw) >= TRIANGLES_MOST)
		return bb_fail(err, BB_ERR_RANGE, 1814, NULL, "%zu triangles", count(draw));
	struct bb_mesh *meshes = malloc(draw->n_meshes * sizeof(*meshes));
	if (!meshes)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu meshes", draw->n_meshes);
	memcpy(meshes, draw->meshes, draw->n_meshes * sizeof(*meshes));
	free(t->meshes);
	t->meshes = meshes;
	t->n_meshes = draw->n_meshes;
	st = send_colours(t, gl, draw, upload_bytes, err);
	t->colours_sent = st == BB_OK;
	return st;
}

/* ---- tiles ---- */

struct plane { /* of the edge opposite to a corner, through the eye: positive towards that corner */
	float normal[3];
	float more; /* of the first: the distance is this by the sum of all three; of the second: the triangle's number */
};

struct box { /* tiles, to: exclusive */
	uint32_t from[2], to[2];
};

struct sorting {
	const struct bb_gl_triangles *t;
	struct bb_vec3 corner, across, down;
	struct bb_vec3 to_depth, to_x, to_y; /* depth, depth * x and depth * y of a point seen from the eye; x, y: 0..1 */
	uint32_t tiles[2];
	struct plane (*plane)[3]; /* of those that are seen */
	struct box *box;
	uint32_t n_seen;
	uint32_t *list; /* first the tiles' beginnings, and the last one's end */
	size_t n_list;
};

static struct bb_vec3 vertex_of(const struct sorting *s, const struct bb_mesh *mesh, size_t triangle, int k)
{
	const float *v = mesh->vertex_m[mesh->triangle[triangle][k]];

	return bb_vec3_sub((struct bb_vec3){ (double)v[0], (double)v[1], (double)v[2] }, s->t->eye);
}

static uint32_t tile_at(double share, uint32_t pixels, uint32_t tiles, double slack)
{
	const double tile = floor((share * pixels + slack) / TILE);

	return tile > 0 ? (tile < tiles ? (uint32_t)tile : tiles) : 0;
}

/* The tiles around a point of the triangle's part in front of the eye. */
static void enclose(double depth, double x, double y, double low[2], double high[2])
{
	low[0] = fmin(low[0], x / depth);
	low[1] = fmin(low[1], y / depth);
	high[0] = fmax(high[0], x / depth);
	high[1] = fmax(high[1], y / depth);
}

static bool find_box(const struct sorting *s, const struct bb_vec3 v[3], struct box *out)
{
	double low[2] = { HUGE_VAL, HUGE_VAL }, high[2] = { -HUGE_VAL, -HUGE_VAL }, p[3][3];

	for (int k = 0; k < 3; k++) {
		p[k][0] = bb_vec3_dot(v[k], s->to_depth);
		p[k][1] = bb_vec3_dot(v[k], s->to_x);
		p[k][2] = bb_vec3_dot(v[k], s->to_y);
	}
	for (int k = 0; k < 3; k++) {
		const double *a = p[k], *b = p[(k + 1) % 3];
		if (a[0] > LEAST_DEPTH)
			enclose(a[0], a[1], a[2], low, high);
		if ((a[0] > LEAST_DEPTH) == (b[0] > LEAST_DEPTH))
			continue;
		const double u = (LEAST_DEPTH - a[0]) / (b[0] - a[0]);
		enclose(LEAST_DEPTH, a[1] + u * (b[1] - a[1]), a[2] + u * (b[2] - a[2]), low, high);
	}
	if (!(high[0] > 0 && high[1] > 0 && low[0] < 1 && low[1] < 1))
		return false;
	const uint32_t pixels[2] = { s->t->width, s->t->height };
	for (int a = 0; a < 2; a++) {
		out->from[a] = tile_at(low[a], pixels[a], s->tiles[a], -PIXEL_SLACK);
		out->to[a] = tile_at(high[a], pixels[a], s->tiles[a], PIXEL_SLACK) + 1;
		out->to[a] = out->to[a] < s->tiles[a] ? out->to[a] : s->tiles[a];
	}
	return out->from[0] < out->to[0] && out->from[1] < out->to[1];
}

static void see(struct sorting *s, const struct bb_mesh *mesh, size_t triangle, size_t number)
{
	const struct bb_vec3 v[3] = { vertex_of(s, mesh, triangle, 0), vertex_of(s, mesh, triangle, 1),
				      vertex_of(s, mesh, triangle, 2) };
	const double volume = bb_vec3_dot(v[0], bb_vec3_cross(v[1], v[2])), sign = volume < 0 ? -1 : 1;
	struct plane *p = s->plane[s->n_seen];

	if (volume == 0 || !find_box(s, v, &s->box[s->n_seen]))
		return;
	for (int k = 0; k < 3; k++) {
		const struct bb_vec3 n = bb_vec3_scale(bb_vec3_cross(v[(k + 1) % 3], v[(k + 2) % 3]), sign);
		p[k] = (struct plane){ { (float)n.x, (float)n.y, (float)n.z }, 0 };
	}
	p[0].more = (float)fabs(volume);
	p[1].more = (float)number;
	s->n_seen++;
}

/* A tile on the outer side of one of the three planes with all its corners is not met. */
static bool outside(const struct sorting *s, const struct plane p[3], uint32_t tile_x, uint32_t tile_y)
{
	const double x[2] = { (double)tile_x * TILE / s->t->width, (tile_x + 1.0) * TILE / s->t->width };
	const double y[2] = { (double)tile_y * TILE / s->t->height, (tile_y + 1.0) * TILE / s->t->height };

	for (int k = 0; k < 3; k++) {
		const float *m = p[k].normal;
		const struct bb_vec3 n = { (double)m[0], (double)m[1], (double)m[2] };
		const double at = bb_vec3_dot(n, s->corner), dx = bb_vec3_dot(n, s->across), dy = bb_vec3_dot(n, s->down);
		const double most = at + fmax(dx * x[0], dx * x[1]) + fmax(dy * y[0], dy * y[1]);
		if (most < -1e-6 * (fabs(at) + fabs(dx) + fabs(dy)))
			return true;
	}
	return false;
}

/* Twice: first how many there are in each tile, then which. */
static bool fill_tiles(struct sorting *s)
{
	const size_t n_tiles = (size_t)s->tiles[0] * s->tiles[1];
	uint32_t *next = calloc(n_tiles, sizeof(*next));
	size_t total = n_tiles + 1;

	for (int pass = 0; pass < 2 && next; pass++) {
		for (uint32_t i = 0; i < s->n_seen; i++)
			for (uint32_t y = s->box[i].from[1]; y < s->box[i].to[1]; y++)
				for (uint32_t x = s->box[i].from[0]; x < s->box[i].to[0]; x++) {
					const size_t tile = (size_t)y * s->tiles[0] + x;
					if (outside(s, s->plane[i], x, y))
						continue;
					if (pass)
						s->list[next[tile]] = i;
					next[tile]++;
				}
		if (pass)
			break;
		for (size_t k = 0; k < n_tiles; k++)
			total += next[k];
		s->list = total < UINT32_MAX ? malloc(total * sizeof(*s->list)) : NULL;
		if (!s->list)
			break;
		s->list[0] = (uint32_t)n_tiles + 1;
		for (size_t k = 0; k < n_tiles; k++) {
			s->list[k + 1] = s->list[k] + next[k];
			next[k] = s->list[k];
		}
	}
	s->n_list = total;
	free(next);
	return s->list != NULL;
}

static void aim(struct sorting *s, const struct bb_view *view)
{
	const struct bb_corners *c = &view->corners;

	s->corner = bb_vec3_sub(c->upper_left, view->eye);
	s->across = bb_vec3_sub(c->lower_right, c->lower_left);
	s->down = bb_vec3_sub(c->lower_left, c->upper_left);
	const struct bb_vec3 normal = bb_vec3_cross(s->across, s->down);
	const double k = 1 / bb_vec3_dot(s->corner, normal); /* a view's eye is never in its screen's plane */
	s->to_depth = bb_vec3_scale(normal, k);
	s->to_x = bb_vec3_scale(bb_vec3_cross(s->down, s->corner), k);
	s->to_y = bb_vec3_scale(bb_vec3_cross(s->corner, s->across), k);
}

static enum bb_status send_tiles(struct bb_gl_triangles *t, const struct bb_gl *gl, const struct bb_draw *draw,
				 uint64_t *upload_bytes, struct bb_error *err)
{
	const size_t n = count(draw);
	struct sorting s = { .t = t,
			     .tiles = { (t->width + TILE - 1) / TILE, (t->height + TILE - 1) / TILE },
			     .plane = malloc((n + 1) * sizeof(*s.plane)),
			     .box = malloc((n + 1) * sizeof(*s.box)) };
	enum bb_status st = BB_ERR_NOMEM;
	size_t number = 0;

	aim(&s, draw->view);
	if (s.plane && s.box) {
		for (size_t m = 0; m < draw->n_meshes; m++)
			for (size_t k = 0; k < draw->meshes[m].n_triangles; k++)
				see(&s, &draw->meshes[m], k, number++);
		st = fill_tiles(&s) ? BB_OK : BB_ERR_NOMEM;
	}
	if (st != BB_OK)
		(void)bb_fail(err, st, 1702, NULL, "tiles of %zu triangles", n);
	if (st == BB_OK)
		st = send(t, gl, BB_GL_PLANES, s.plane, (size_t)s.n_seen * 3, upload_bytes, err);
	if (st == BB_OK)
		st = send(t, gl, BB_GL_TILES, s.list, s.n_list, upload_bytes, err);
	free(s.plane);
	free(s.box);
	free(s.list);
	return st;
}

static bool same_vec3(struct bb_vec3 a, struct bb_vec3 b)
{
	return a.x == b.x && a.y == b.y && a.z == b.z;
}

static bool same_view(const struct bb_gl_triangles *t, const struct bb_view *v, uint32_t width, uint32_t height)
{
	return t->width == width && t->height == height && same_vec3(t->eye, v->eye) &&
	       same_vec3(t->upper_left, v->corners.upper_left) && same_vec3(t->lower_left, v->corners.lower_left) &&
	       same_vec3(t->lower_right, v->corners.lower_right);
}

enum bb_status bb_gl_triangles_update(struct bb_gl_triangles *t, const struct bb_gl *gl, const struct bb_draw *draw,
				      uint32_t width, uint32_t height, uint64_t *upload_bytes, struct bb_error *err)
{
	const struct bb_view *v = draw->view;
	enum bb_status st = BB_OK;

	if (!t->colours_sent || !same_meshes(t, draw))
		st = adopt(t, gl, draw, upload_bytes, err);
	if (st != BB_OK || (t->tiles_sent && same_view(t, v, width, height)))
		return st;
	t->eye = v->eye;
	t->upper_left = v->corners.upper_left;
	t->lower_left = v->corners.lower_left;
	t->lower_right = v->corners.lower_right;
	t->width = width;
	t->height = height;
	st = send_tiles(t, gl, draw, upload_bytes, err);
	t->tiles_sent = st == BB_OK;
	return st;
}
