#include "render/bricks/build_private.h"
#include "hal/file.h"
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

#define SLAB_VOXEL_BYTES (sizeof(float) + sizeof(uint16_t))

/* ---- a level ---- */

static uint64_t slab_floats(const struct bb_build *b, uint32_t tile, uint32_t *planes, uint32_t *rows)
{
	const uint32_t *v = b->h.tree.voxels[b->level], around = 2 * b->h.pad;
	const uint64_t deep = b->h.tree.edge + around, wide = (uint64_t)tile * b->h.tree.edge + around;

	*planes = (uint32_t)(deep < v[2] ? deep : v[2]);
	*rows = (uint32_t)(wide < v[1] ? wide : v[1]);
	return (uint64_t)b->h.tree.n_times * (*planes + bb_build_n_across(b)) * *rows * v[0];
}

static uint64_t coded_bytes(const struct bb_build *b, uint32_t tile)
{
	return (uint64_t)BB_BUILD_BATCH * tile * b->h.tree.grid[b->level][0] *
	       (bb_build_brick_cap(b) + BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST);
}

/* Of the next level, a plane of what a slab is halved into. */
static size_t halved_floats(const struct bb_build *b, uint32_t tile)
{
	return ((size_t)tile * b->h.tree.edge / 2 + 1) * ((b->h.tree.voxels[b->level][0] + 1) / 2);
}

static uint64_t unit_bytes(const struct bb_build *b, uint32_t tile)
{
	uint32_t planes, rows;

	return slab_floats(b, tile, &planes, &rows) * SLAB_VOXEL_BYTES + coded_bytes(b, tile) +
	       b->config->threads * halved_floats(b, tile) * sizeof(float);
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
	const size_t per_unit = (size_t)b->tile * b->h.tree.grid[b->level][0];
	uint32_t planes, rows;
	const uint64_t n = slab_floats(b, b->tile, &planes, &rows);

	b->slab = (struct bb_build_slab){ .n_planes = planes, .n_rows = rows, .n_across = bb_build_n_across(b) };
	b->slab.values = bb_build_alloc(b, n, sizeof(float), "a slab of all time nodes");
	b->slab.places = bb_build_alloc(b, n, sizeof(uint16_t), "a slab of all time nodes");
	for (unsigned i = 0; i < b->config->threads; i++)
		b->work[i].rows = bb_build_alloc(b, halved_floats(b, b->tile), sizeof(float), "rows of the next level");
	for (int i = 0; i < BB_BUILD_BATCH; i++) {
		b->output[i].bricks =
			bb_build_alloc(b, per_unit, bb_build_brick_cap(b), "bricks on their way to the file");
		b->output[i].histograms =
			bb_build_alloc(b, per_unit, BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST, "histograms on their way");
	}
}

static void leave_slab(struct bb_build *b)
{
	const size_t per_unit = (size_t)b->tile * b->h.tree.grid[b->level][0];
	uint32_t planes, rows;
	const uint64_t n = slab_floats(b, b->tile, &planes, &rows);

	bb_build_release(b, b->slab.values, n, sizeof(float));
	bb_build_release(b, b->slab.places, n, sizeof(uint16_t));
	b->slab = (struct bb_build_slab){ 0 };
	for (unsigned i = 0; i < b->config->threads; i++) {
		bb_build_release(b, b->work[i].rows, halved_floats(b, b->tile), sizeof(float));
		b->work[i].rows = NULL;
	}
	for (int i = 0; i < BB_BUILD_BATCH; i++) {
		bb_build_release(b, b->output[i].bricks, per_unit, bb_build_brick_cap(b));
		bb_build_release(b, b->output[i].histograms, per_unit, BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST);
		b->output[i] = (struct bb_build_output){ 0 };
	}
}

/* The parents' moments and values from what this level's bricks have. */
static struct bb_build_node *merge_up(struct bb_build *b)
{
	const struct bb_tree *t = &b->h.tree;
	struct bb_build_node *up =
		bb_build_alloc(b, (size_t)t->n_times * b->n_above, sizeof(*up), "statistics of parents");
	uint32_t child[8];

	for (size_t i = 0; up && i < (size_t)t->n_times * b->n_above; i++) {
		const uint32_t node = t->first[b->level - 1] + (uint32_t)(i % b->n_above);
		const uint32_t n = bb_tree_children(t, node, child);
		for (uint32_t c = 0; c < n; c++) {
			const struct bb_build_node *from =
				&b->node[i / b->n_above * b->n_here + (child[c] - t->first[b->level])];
			bb_histogram_merge(up[i].values, up[i].moments.n, from->values, from->moments.n, up[i].values);
			bb_moments_merge(&up[i].moments, &from->moments);
		}
	}
	return up;
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

static void one_unit(struct bb_build *b)
{
	bb_build_fill(b);
	if (!b->status)
		bb_build_emit(b);
	if (!b->status)
		bb_build_halve(b);
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
	enum { AT_A_TIME = 4096 };
	uint8_t buf[AT_A_TIME * BB_BRICKS_MOMENTS_BYTES];
	const uint64_t n = b->h.tree.n_bricks;

	*s = (struct bb_bricks_section){ .offset = b->append, .bytes = n * record_bytes };
	for (uint64_t i = 0; i < n && !b->status; i += AT_A_TIME) {
		const uint64_t part = n - i < AT_A_TIME ? n - i : AT_A_TIME;
		for (uint64_t k = 0; k < part; k++)
			put(b, i + k, buf + k * record_bytes);
		s->crc = bb_crc32c(s->crc, buf, part * record_bytes);
		bb_build_pwrite(b, b->fd, buf, part * record_bytes, b->append);
		b->append += part * record_bytes;
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
	bb_bricks_header_write(&b->h, header);
	bb_build_pwrite(b, b->fd, header, sizeof(header), 0);
	if (!b->status && (fsync(b->fd) || rename(b->part, b->config->path)))
		bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
	b->report->result_bytes = b->append;
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

static void take_memory(struct bb_build *b)
{
	const struct bb_tree *t = &b->h.tree;
	const size_t side = t->edge + 2 * b->h.pad, voxels = side * side * side;
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
	b->output = bb_build_alloc(b, BB_BUILD_BATCH, sizeof(*b->output), "a batch");
	b->work = bb_build_alloc(b, b->config->threads, sizeof(*b->work), "threads");
	for (unsigned i = 0; i < b->config->threads && b->work; i++) {
		b->work[i].voxels = bb_build_alloc(b, voxels, sizeof(float), "a brick for each thread");
		b->work[i].stored = bb_build_alloc(b, voxels, sizeof(float), "a brick for each thread");
	}
	for (uint32_t tau = 0; tau < t->n_times && b->span; tau++)
		b->span[tau] = bb_tree_span(t, tau);
	for (uint32_t step = 0; step < t->n_steps && b->leaf; step++)
		b->leaf[step] = bb_tree_leaf_time(t, step);
}

static void leave_memory(struct bb_build *b)
{
	for (unsigned i = 0; i < b->config->threads && b->work; i++) {
		free(b->work[i].voxels);
		free(b->work[i].stored);
	}
	free(b->work);
	free(b->output);
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
	b.scale = bb_bin_scale(b.h.least, b.h.most);
	while (!b.status && one_level(&b))
		;
	if (!b.status)
		finish(&b);
	close_files(&b);
	leave_memory(&b);
	return b.status;
}
