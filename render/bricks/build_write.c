/*
 * render/bricks/build_write.c: a unit's bricks, padded and packed, and its histograms, a row of bricks at a time by any
 * thread.
 */
#include "render/bricks/build_private.h"
#include "render/bricks/crc32c.h"
#include "render/bricks/values.h"
#include "render/parallel.h"

#include <string.h>

/* ---- bricks with their padding ---- */

struct row {
	uint32_t tau, y;
	size_t turn;
	struct bb_bricks_record *index;    /* of its bricks */
	struct bb_bricks_moments *moments; /* the same */
	struct bb_build_work *work;
};

static uint32_t held(int64_t at, uint32_t n)
{
	return at < 0 ? 0 : at >= n ? n - 1 : (uint32_t)at;
}

/* The plane of the slab that has z, which may lie outside the volume. */
static uint32_t plane_held(const struct bb_build *b, int64_t z)
{
	const int64_t n = b->h.tree.voxels[b->level][2], pad = b->h.pad;

	if (!b->slab.n_across || (z >= 0 && z < n))
		return held(z, (uint32_t)n);
	if (z < 0)
		return BB_BUILD_ACROSS + (uint32_t)(z + pad);
	return BB_BUILD_ACROSS + (uint32_t)(z < n + pad ? z - n + pad : 2 * pad - 1);
}

/* n floats; not by one memcpy, which is a call for so few. */
static inline void copy_few(float *to, const float *from, size_t n)
{
	enum { AT_A_TIME = 8 };

	if (n < AT_A_TIME) {
		for (size_t i = 0; i < n; i++)
			to[i] = from[i];
		return;
	}
	for (size_t i = 0; i + AT_A_TIME < n; i += AT_A_TIME)
		memcpy(to + i, from + i, AT_A_TIME * sizeof(float));
	memcpy(to + n - AT_A_TIME, from + n - AT_A_TIME, AT_A_TIME * sizeof(float));
}

/* One line of brick x, outside the volume the nearest voxel. */
static inline void gather_line(const struct bb_build *b, const float *line, uint32_t x, float *out)
{
	const uint32_t pad = b->h.pad, edge = b->h.tree.edge, side = edge + 2 * pad, n = b->h.tree.voxels[b->level][0];

	if (x && x * edge + edge + pad <= n) {
		copy_few(out, line + x * edge - pad, side);
		return;
	}
	for (uint32_t i = 0; i < side; i++)
		out[i] = line[held((int64_t)x * edge + i - pad, n)];
}

/* A row of bricks: line by line of the slab, which the processor foresees. */
static void gather(const struct bb_build *b, const struct row *r)
{
	const int64_t edge = b->h.tree.edge, pad = b->h.pad, z0 = (int64_t)b->z * edge, y0 = (int64_t)r->y * edge;
	const uint32_t n_rows = b->h.tree.voxels[b->level][1], n = b->h.tree.voxels[b->level][0];
	const size_t side = (size_t)(edge + 2 * pad), brick = side * side * side;
	float *out = r->work->voxels;

	for (int64_t z = z0 - pad; z < z0 + edge + pad; z++) {
		const float *plane = bb_build_row(b, r->tau, plane_held(b, z), b->slab.y_from);
		for (int64_t y = y0 - pad; y < y0 + edge + pad; y++, out += side) {
			const float *line = plane + (size_t)(held(y, n_rows) - b->slab.y_from) * n;
			for (uint32_t x = 0; x < b->h.tree.grid[b->level][0]; x++)
				gather_line(b, line, x, out + x * brick);
		}
	}
}

size_t bb_build_brick_cap(const struct bb_build *b)
{
	return bb_values_packed_cap(b->h.codec, bb_bricks_brick_bytes(&b->h));
}

bool bb_build_is_stored_as_it_is(const struct bb_build *b)
{
	return b->h.codec == BB_BRICK_PLAIN && b->h.type == BB_BRICK_F32;
}

/* ---- rows for the file ---- */

static void write_plain(struct bb_build *b, const struct row *r)
{
	const size_t brick = bb_bricks_brick_bytes(&b->h);
	const uint32_t across = b->h.tree.grid[b->level][0];
	uint64_t at;

	gather(b, r);
	uint8_t *out = bb_build_output_take(b, r->turn, across * brick, &at);
	if (!out)
		return;
	for (uint32_t x = 0; x < across; x++) {
		const float *voxels = r->work->voxels + x * (brick / sizeof(float));
		r->index[x] = (struct bb_bricks_record){ at + x * brick, (uint32_t)brick,
							 bb_crc32c_copy(0, out + x * brick, voxels, brick) };
	}
	bb_crc32c_copied();
	bb_build_output_put(b, at, across * brick);
}

/* A brick of another type, packed or not; 0: it could not be. */
static size_t pack(const struct bb_build *b, const float *voxels, uint8_t *stored, uint8_t *out)
{
	const size_t bytes = bb_bricks_brick_bytes(&b->h);

	bb_values_store(&b->h, voxels, bytes / bb_brick_type_bytes(b->h.type), stored);
	return bb_values_pack(b->h.codec, stored, bytes, out);
}

static void write_packed(struct bb_build *b, const struct row *r)
{
	const uint32_t across = b->h.tree.grid[b->level][0];
	const size_t side = b->h.tree.edge + 2 * b->h.pad;
	struct bb_build_work *w = r->work;
	size_t n = 0;
	uint64_t at;

	gather(b, r);
	for (uint32_t x = 0; x < across; x++) {
		const size_t packed = pack(b, w->voxels + x * side * side * side, w->stored, w->packed + n);
		if (!packed) {
			bb_build_fail(b, BB_ERR_INTERNAL, 1448, "packing a brick");
			bb_build_output_fail(b);
			return;
		}
		r->index[x] = (struct bb_bricks_record){ n, (uint32_t)packed, bb_crc32c(0, w->packed + n, packed) };
		n += packed;
	}
	uint8_t *out = bb_build_output_take(b, r->turn, n, &at);
	if (!out)
		return;
	memcpy(out, w->packed, n);
	bb_build_output_put(b, at, n);
	for (uint32_t x = 0; x < across; x++)
		r->index[x].offset += at;
}

/* Of n bricks, one behind the other in the unit. */
static void write_histograms(struct bb_build *b, size_t turn, const uint8_t *from, struct bb_bricks_moments *moments,
			     uint32_t n)
{
	size_t bytes = 0;
	uint64_t at;

	for (uint32_t i = 0; i < n; i++)
		bytes += moments[i].histograms.bytes;
	uint8_t *out = bb_build_output_take(b, turn, bytes, &at);
	if (!out)
		return;
	uint64_t to = at;
	for (uint32_t i = 0; i < n; i++, from += BB_BUILD_HISTOGRAMS_MOST) {
		struct bb_bricks_record *h = &moments[i].histograms;
		memcpy(out + (to - at), from, h->bytes);
		h->offset = to;
		to += h->bytes;
	}
	bb_build_output_put(b, at, bytes);
}

/* The unit's i-th row, of n_times * rows. */
static struct row row_at(struct bb_build *b, size_t i, unsigned thread)
{
	const struct bb_tree *t = &b->h.tree;
	const uint32_t rows = bb_build_unit_rows(b);
	struct row r = {
		.tau = (uint32_t)(i / rows), .y = b->y + (uint32_t)(i % rows), .turn = i, .work = &b->work[thread]
	};
	const uint64_t id = (uint64_t)r.tau * t->n_nodes + t->first[b->level] +
			    ((uint64_t)b->z * t->grid[b->level][1] + r.y) * t->grid[b->level][0];

	r.index = b->index + id;
	r.moments = b->moments + id;
	return r;
}

void bb_build_write_bricks(struct bb_build *b, size_t i, unsigned thread)
{
	const struct row r = row_at(b, i, thread);

	if (bb_build_is_stored_as_it_is(b))
		write_plain(b, &r);
	else
		write_packed(b, &r);
}

/* As many as surely have room in a place. */
static uint32_t histograms_at_once(const struct bb_build *b)
{
	return (uint32_t)(bb_build_output_most(b) / BB_BUILD_HISTOGRAMS_MOST);
}

static void write_part(void *ctx, size_t i, unsigned thread)
{
	struct bb_build *b = ctx;
	const uint32_t all = bb_build_unit_bricks(b), most = histograms_at_once(b), parts = (all + most - 1) / most;
	const uint32_t tau = (uint32_t)(i / parts), first = (uint32_t)(i % parts) * most;
	const struct row r = row_at(b, (size_t)tau * bb_build_unit_rows(b), thread);

	write_histograms(b, i, b->histograms + ((size_t)tau * all + first) * BB_BUILD_HISTOGRAMS_MOST,
			 r.moments + first, all - first < most ? all - first : most);
}

void bb_build_write_histograms(struct bb_build *b)
{
	const uint32_t all = bb_build_unit_bricks(b), most = histograms_at_once(b), parts = (all + most - 1) / most;

	bb_build_output_begin(b);
	bb_parallel(b->threads, (size_t)b->h.tree.n_times * parts, write_part, b);
}
