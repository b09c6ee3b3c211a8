#include "hal/file.h"
#include "render/bricks/build_private.h"
#include "render/bricks/values.h"
#include "render/parallel.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <unistd.h>

#define SAMPLES_OF_A_BRICK_EDGE 4 /* cells along a brick, so that eight leaves have 512 */

/* ---- a level ---- */

#define LINE_FLOATS 16 /* of a cache */

/* n floats and some, so that what is as far apart begins in other sets of the caches: `lines` more than a multiple of
 * their ways. Of a few kilobytes that would be as much again, and those do not meet. */
static uint64_t apart(uint64_t n, uint64_t lines)
{
	const uint64_t all = (n + LINE_FLOATS - 1) / LINE_FLOATS, way = 64;

	return all < 16 * way ? n : (all + (lines + way - all % way) % way) * LINE_FLOATS;
}

static struct bb_build_slab slab_of(const struct bb_build *b, uint32_t tile)
{
	const uint32_t *v = b->h.tree.voxels[b->level], around = 2 * b->h.pad;
	const uint64_t deep = b->h.tree.edge + around, wide = (uint64_t)tile * b->h.tree.edge + around;
	struct bb_build_slab s = { .n_across = bb_build_n_across(b) };

	s.n_planes = (uint32_t)(deep < v[2] ? deep : v[2]);
	s.n_rows = (uint32_t)(wide < v[1] ? wide : v[1]);
	s.per_plane = apart((uint64_t)s.n_rows * v[0], 3);
	s.per_time = apart((s.n_planes + s.n_across) * s.per_plane, 11);
	return s;
}

/* What a unit of so many rows of bricks takes, its slab apart. */
struct unit_sizes {
	size_t half, histograms, out; /* floats, bytes; of a thread: bytes */
};

static struct unit_sizes sizes_of(const struct bb_build *b, uint32_t tile)
{
	const struct bb_tree *t = &b->h.tree;
	const size_t across = t->grid[b->level][0];
	const size_t cap = bb_build_brick_cap(b);

	return (struct unit_sizes){
		.half = (size_t)t->n_times * (t->edge / 2) * tile * (t->edge / 2) * bb_build_half_row(b),
		.histograms = (size_t)t->n_times * tile * across * BB_BUILD_HISTOGRAMS_MOST,
		.out = across * (cap > BB_BUILD_HISTOGRAMS_MOST ? cap : BB_BUILD_HISTOGRAMS_MOST),
	};
}

static uint64_t unit_bytes(const struct bb_build *b, uint32_t tile)
{
	const struct unit_sizes n = sizes_of(b, tile);

	return ((uint64_t)b->h.tree.n_times * slab_of(b, tile).per_time + n.half) * sizeof(float) + n.histograms +
	       (bb_build_is_stored_as_it_is(b) ? 0 : b->threads * n.out);
}

/* As many rows of bricks at a time as fit beside what is held. */
static void choose_tile(struct bb_build *b)
{
	const uint64_t room = b->config->memory_bytes - b->held_bytes;

	b->tile = b->h.tree.grid[b->level][1];
	while (b->tile > 1 && unit_bytes(b, b->tile) > room)
		b->tile = (b->tile + 1) / 2;
}

static void level_sizes(const struct bb_build *b, uint32_t level, uint32_t *here, uint32_t *above)
{
	const struct bb_tree *t = &b->h.tree;

	*here = t->first[level + 1] - t->first[level];
	*above = level ? t->first[level] - t->first[level - 1] : 0;
}

static void take_slab(struct bb_build *b)
{
	const struct unit_sizes n = sizes_of(b, b->tile);

	b->slab = slab_of(b, b->tile);
	b->slab.values =
		bb_build_alloc(b, b->h.tree.n_times * b->slab.per_time, sizeof(float), "a slab of all time nodes");
	b->half = bb_build_alloc(b, n.half, sizeof(float), "voxels of the next level");
	b->histograms = bb_build_alloc(b, n.histograms, 1, "histograms on their way to the file");
	for (unsigned i = 0; i < b->threads && !bb_build_is_stored_as_it_is(b); i++)
		b->work[i].packed = bb_build_alloc(b, n.out, 1, "a row of bricks for each thread");
}

static void leave_slab(struct bb_build *b)
{
	const struct unit_sizes n = sizes_of(b, b->tile);

	bb_build_release(b, b->slab.values, b->h.tree.n_times * b->slab.per_time, sizeof(float));
	bb_build_release(b, b->half, n.half, sizeof(float));
	bb_build_release(b, b->histograms, n.histograms, 1);
	for (unsigned i = 0; i < b->threads; i++) {
		bb_build_release(b, b->work[i].packed, n.out, 1);
		b->work[i].packed = NULL;
	}
	b->slab = (struct bb_build_slab){ 0 };
	b->half = NULL;
	b->histograms = NULL;
}

struct merging {
	const struct bb_build *b;
	struct bb_build_node *up; /* [tau][n_above] */
};

/* The parents' moments and values from what this level's bricks have, of a time node. */
static void merge_time(void *ctx, size_t tau, unsigned thread)
{
	const struct merging *m = ctx;
	const struct bb_build *b = m->b;
	const struct bb_tree *t = &b->h.tree;
	uint32_t child[8];
	(void)thread;

	for (uint32_t i = 0; i < b->n_above; i++) {
		struct bb_build_node *up = &m->up[tau * b->n_above + i];
		const uint32_t n = bb_tree_children(t, t->first[b->level - 1] + i, child);
		for (uint32_t c = 0; c < n; c++) {
			const struct bb_build_node *from = &b->node[tau * b->n_here + (child[c] - t->first[b->level])];
			bb_histogram_merge(up->values, up->moments.n, from->values, from->moments.n, up->values);
			bb_moments_merge(&up->moments, &from->moments);
		}
	}
}

static struct bb_build_node *merge_up(struct bb_build *b)
{
	const uint32_t n_times = b->h.tree.n_times;
	struct merging m = { b,
			     bb_build_alloc(b, (size_t)n_times * b->n_above, sizeof(*m.up), "statistics of parents") };

	if (m.up)
		bb_parallel(b->threads, n_times, merge_time, &m);
	return m.up;
}

static void next_level(struct bb_build *b)
{
	const size_t times = b->h.tree.n_times;
	struct bb_build_node *up = b->level ? merge_up(b) : NULL;

	bb_build_release(b, b->node, times * b->n_here, sizeof(*b->node));
	bb_build_release(b, b->space, times * b->n_here, sizeof(*b->space));
	b->node = up;
	b->space = b->space_above;
	b->space_above = NULL;
	if (!b->level || b->status)
		return;
	b->level--;
	level_sizes(b, b->level, &b->n_here, &b->n_above);
	if (b->level)
		b->space_above = bb_build_alloc(b, times * b->n_above, sizeof(*b->space_above), "errors of parents");
	b->y = b->z = 0;
}

/* ---- the whole ---- */

/* Counting and writing in turns, so that processors and disk have work at the same time. */
static void piece_of_unit(void *ctx, size_t i, unsigned thread)
{
	struct bb_build *b = ctx;
	const size_t rows = (size_t)b->h.tree.n_times * bb_build_unit_rows(b), tallies = bb_build_tally_pieces(b);
	const size_t before = i * tallies / (rows + tallies); /* tallies among the pieces before this one */

	if (b->status)
		bb_build_output_fail(b); /* nobody waits for a row that does not come */
	else if ((i + 1) * tallies / (rows + tallies) > before)
		bb_build_tally(b, (uint32_t)before, thread);
	else
		bb_build_write_bricks(b, i - before, thread);
}

static void one_unit(struct bb_build *b)
{
	bb_build_fill(b);
	if (b->status)
		return;
	bb_build_output_begin(b);
	bb_parallel(b->threads, (size_t)b->h.tree.n_times * bb_build_unit_rows(b) + bb_build_tally_pieces(b),
		    piece_of_unit, b);
	if (!b->status)
		bb_build_write_histograms(b);
	if (!b->status)
		bb_build_spill(b);
	b->done += (uint64_t)bb_build_unit_bricks(b) * b->h.tree.n_times;
}

static bool go_on(struct bb_build *b)
{
	const struct bb_build_config *c = b->config;

	if (b->status)
		return false;
	const bool stop = c->progress && !c->progress(c->ctx, b->done, b->h.tree.n_bricks);
	if (stop || (c->checkpoint_bytes && b->since_checkpoint >= c->checkpoint_bytes))
		bb_build_keep(b);
	if (stop && !b->status)
		b->status = BB_SKIPPED;
	return !b->status;
}

/* Units of a level from (b->y, b->z) on. False: all levels are done, or it was stopped. */
static bool one_level(struct bb_build *b)
{
	const uint32_t *grid = b->h.tree.grid[b->level];

	take_slab(b);
	while (b->y < grid[1] && !b->status) {
		one_unit(b);
		if (++b->z == grid[2]) {
			b->z = 0;
			b->y += b->tile;
		}
		if (!go_on(b))
			break;
	}
	leave_slab(b);
	if (b->status)
		return false;
	const bool last = !b->level;
	next_level(b);
	if (!last)
		choose_tile(b);
	return !last && !b->status;
}

static void write_section(struct bb_build *b, struct bb_bricks_section *s, size_t record_bytes,
			  void (*put)(const struct bb_build *b, uint64_t i, uint8_t *to))
{
	enum { AT_A_TIME = 64 }; /* less than a block, which any place of the ring is */
	const uint64_t n = b->h.tree.n_bricks;
	uint64_t at;

	*s = (struct bb_bricks_section){ .offset = bb_build_output_end(b), .bytes = n * record_bytes };
	bb_build_output_begin(b);
	for (uint64_t i = 0; i < n && !b->status; i += AT_A_TIME) {
		const uint64_t part = n - i < AT_A_TIME ? n - i : AT_A_TIME;
		uint8_t *out = bb_build_output_take(b, i / AT_A_TIME, part * record_bytes, &at);
		if (!out)
			return;
		for (uint64_t k = 0; k < part; k++)
			put(b, i + k, out + k * record_bytes);
		s->crc = bb_crc32c(s->crc, out, part * record_bytes);
		bb_build_output_put(b, at, part * record_bytes);
	}
}

static void put_index(const struct bb_build *b, uint64_t i, uint8_t *to)
{
	bb_bricks_record_write(&b->index[i], to);
}

static void put_moments(const struct bb_build *b, uint64_t i, uint8_t *to)
{
	bb_bricks_moments_write(&b->moments[i], to);
}

static void finish(struct bb_build *b)
{
	uint8_t header[BB_BRICKS_HEADER_BYTES];

	write_section(b, &b->h.index, BB_BRICKS_INDEX_BYTES, put_index);
	write_section(b, &b->h.moments, BB_BRICKS_MOMENTS_BYTES, put_moments);
	bb_build_output_flush(b);
	b->report->result_bytes = bb_build_output_end(b);
	bb_build_output_close(b);
	bb_bricks_header_write(&b->h, header);
	bb_build_pwrite(b, b->fd, header, sizeof(header), 0);
	if (!b->status && (fsync(b->fd) || rename(b->part, b->config->path)))
		bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
	b->report->n_bricks = b->h.tree.n_bricks;
	b->report->n_nonfinite = b->h.n_nonfinite;
}

/* The largest divisor of the edge that leaves SAMPLES_OF_A_BRICK_EDGE cells along it. */
static uint32_t cell_of(uint32_t edge)
{
	uint32_t cell = edge / SAMPLES_OF_A_BRICK_EDGE;

	while (cell > 1 && edge % cell)
		cell--;
	return cell ? cell : 1;
}

/* No more threads than a quarter of the memory is enough for, or a machine with many needs more than one with few. */
static unsigned threads_for(const struct bb_build *b, uint64_t bytes)
{
	const uint64_t many = b->config->memory_bytes / 4 / bytes;

	return many < 1 ? 1 : many < b->config->threads ? (unsigned)many : b->config->threads;
}

/* What each thread works with. */
static void take_work(struct bb_build *b)
{
	const struct bb_tree *t = &b->h.tree;
	const size_t side = t->edge + 2 * b->h.pad, brick = side * side * side;
	const size_t row = brick * t->grid[t->n_levels - 1][0]; /* of leaves: the longest */
	const bool packs = !bb_build_is_stored_as_it_is(b);
	uint32_t deepest = 0;

	if (b->status || !b->depth || !b->span)
		return;
	for (uint32_t tau = 1; tau < t->n_times; tau++) {
		b->depth[tau] = b->depth[b->span[tau].parent] + 1;
		deepest = b->depth[tau] > deepest ? b->depth[tau] : deepest;
	}
	b->times = (struct bb_errors_tree){ .n_times = t->n_times,
					    .n_steps = t->n_steps,
					    .n_groups = deepest / 4 + 1,
					    .span = b->span,
					    .leaf = b->leaf,
					    .depth = b->depth };
	const size_t n = bb_errors_bytes(&b->times, (uint64_t)t->edge * t->edge * t->edge);
	b->threads = threads_for(b, n + t->n_times * sizeof(*b->work->histograms) + row * sizeof(float) +
					    (packs ? brick * sizeof(float) + sizes_of(b, 1).out : 0));
	b->work = bb_build_alloc(b, b->threads, sizeof(*b->work), "threads");
	for (unsigned i = 0; i < b->threads && b->work; i++) {
		struct bb_build_work *w = &b->work[i];
		w->errors_memory = bb_build_alloc(b, n, 1, "bins of all time nodes");
		w->histograms = bb_build_alloc(b, t->n_times, sizeof(*w->histograms), "histograms of all time nodes");
		w->voxels = bb_build_alloc(b, row, sizeof(float), "a row of bricks for each thread");
		if (packs)
			w->stored = bb_build_alloc(b, brick, sizeof(float), "a brick for each thread");
	}
}

static void take_memory(struct bb_build *b)
{
	const struct bb_tree *t = &b->h.tree;
	size_t n_samples = t->n_steps;

	b->cell = cell_of(t->edge);
	for (int a = 0; a < 3; a++)
		n_samples *= b->n_cells[a] = (t->dim[a] + b->cell - 1) / b->cell;
	b->level = t->n_levels - 1;
	level_sizes(b, b->level, &b->n_here, &b->n_above);
	b->span = bb_build_alloc(b, t->n_times, sizeof(*b->span), "time nodes");
	b->leaf = bb_build_alloc(b, t->n_steps, sizeof(*b->leaf), "time nodes");
	b->index = bb_build_alloc(b, t->n_bricks, sizeof(*b->index), "the index");
	b->moments = bb_build_alloc(b, t->n_bricks, sizeof(*b->moments), "moments of all bricks");
	b->samples = bb_build_alloc(b, n_samples, sizeof(float), "samples of the data");
	b->node = bb_build_alloc(b, (size_t)t->n_times * b->n_here, sizeof(*b->node), "statistics of the leaves");
	if (b->level)
		b->space_above = bb_build_alloc(b, (size_t)t->n_times * b->n_above, sizeof(*b->space_above),
						"errors of parents");
	b->depth = bb_build_alloc(b, t->n_times, sizeof(*b->depth), "time nodes");
	for (uint32_t tau = 0; tau < t->n_times && b->span; tau++)
		b->span[tau] = bb_tree_span(t, tau);
	for (uint32_t step = 0; step < t->n_steps && b->leaf; step++)
		b->leaf[step] = bb_tree_leaf_time(t, step);
	take_work(b);
	if (!b->status)
		bb_build_output_open(b, sizes_of(b, 1).out); /* no row of bricks is longer than that of leaves */
}

/* The range of the data is known. */
static void begin_errors(struct bb_build *b)
{
	const uint64_t voxels = (uint64_t)b->h.tree.edge * b->h.tree.edge * b->h.tree.edge;

	for (unsigned i = 0; i < b->threads; i++)
		bb_errors_init(&b->work[i].errors, &b->times, voxels, bb_bin_scale(b->h.least, b->h.most),
			       b->h.most - b->h.least, bb_errors_best(), b->work[i].errors_memory);
}

static void leave_memory(struct bb_build *b)
{
	for (unsigned i = 0; i < b->threads && b->work; i++) {
		free(b->work[i].errors_memory);
		free(b->work[i].histograms);
		free(b->work[i].voxels);
		free(b->work[i].stored);
	}
	free(b->work);
	free(b->depth);
	free(b->space_above);
	free(b->space);
	free(b->node);
	free(b->samples);
	free(b->moments);
	free(b->index);
	free(b->leaf);
	free(b->span);
}

static void open_files(struct bb_build *b)
{
	if (!bb_path_may_be_replaced(b->config->path)) {
		bb_build_fail(b, BB_ERR_IO, 1901, "it is there and no regular file");
		return;
	}
	snprintf(b->part, sizeof(b->part), "%.*s.part", (int)sizeof(b->part) - 8, b->config->path);
	snprintf(b->state, sizeof(b->state), "%s.state", b->part);
	b->fd = open(b->part, O_RDWR | O_CREAT | O_CLOEXEC, 0644);
	for (int i = 0; i < 2; i++) {
		snprintf(b->spill_path[i], sizeof(b->spill_path[i]), "%s.%d", b->part, i);
		b->spill[i] = open(b->spill_path[i], O_RDWR | O_CREAT | O_CLOEXEC, 0600);
	}
	if (b->fd < 0 || b->spill[0] < 0 || b->spill[1] < 0)
		bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
	else if (flock(b->fd, LOCK_EX | LOCK_NB))
		bb_build_fail(b, BB_ERR_BUSY, 1449, b->part);
}

/* What an earlier attempt wrote beyond `append` is of no use; all of it, when there is nothing to go on with. */
static void cut_files(struct bb_build *b)
{
	const bool cut = ftruncate(b->fd, (off_t)b->append) == 0 &&
			 (b->report->resumed || (ftruncate(b->spill[0], 0) == 0 && ftruncate(b->spill[1], 0) == 0));

	if (!cut)
		bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
}

/* What was kept stays for another day; otherwise nothing is left but the result. */
static void close_files(struct bb_build *b)
{
	for (int i = 0; i < 2; i++)
		if (b->spill[i] >= 0)
			close(b->spill[i]);
	if (b->fd >= 0)
		close(b->fd);
	if (b->status && (b->status == BB_ERR_BUSY || access(b->state, F_OK) == 0))
		return;
	unlink(b->part); /* gone already when it was renamed */
	unlink(b->state);
	for (int i = 0; i < 2; i++)
		unlink(b->spill_path[i]);
}

static bool sane(const struct bb_build_config *c, struct bb_build *b)
{
	b->h = (struct bb_bricks_header){
		.pad = c->pad, .type = c->type, .codec = c->codec, .grid = c->grid, .least = c->least, .most = c->most
	};
	memcpy(b->h.extent, c->extent, sizeof(b->h.extent));
	if (c->steps->spherical && c->grid == BB_BRICK_CARTESIAN) { /* the data know better */
		b->h.grid = BB_BRICK_SPHERICAL;
		memcpy(b->h.extent, c->steps->extent, sizeof(b->h.extent));
	}
	memcpy(b->h.spacing_mm, c->steps->spacing_mm, sizeof(b->h.spacing_mm));
	snprintf(b->h.name, sizeof(b->h.name), "%s", c->steps->name);
	return c->pad <= BB_BRICKS_PAD_MOST && c->threads >= 1 && c->threads <= BB_PARALLEL_MOST &&
	       bb_tree_init(&b->h.tree, c->steps->dim, c->steps->n_steps, c->edge);
}

enum bb_status bb_bricks_build(const struct bb_build_config *config, struct bb_build_report *report,
			       struct bb_error *err)
{
	struct bb_build b = { .config = config,
			      .report = report,
			      .err = err,
			      .fd = -1,
			      .spill = { -1, -1 },
			      .append = BB_BRICKS_HEADER_BYTES };

	*report = (struct bb_build_report){ 0 };
	if (!sane(config, &b))
		return bb_fail(err, BB_ERR_CONFIG, 1442, NULL, "bricks of %u with padding %u, %u threads", config->edge,
			       config->pad, config->threads);
	open_files(&b);
	take_memory(&b);
	if (!b.status && !bb_build_resume(&b)) {
		if (!config->has_range)
			bb_build_range(&b);
		choose_tile(&b);
	}
	if (!b.status)
		cut_files(&b);
	if (!b.status)
		bb_build_output_start(&b, b.append);
	if (!b.status)
		begin_errors(&b);
	while (!b.status && one_level(&b))
		;
	if (!b.status)
		finish(&b);
	bb_build_output_close(&b);
	close_files(&b);
	leave_memory(&b);
	return b.status;
}
