/*
 * render/bricks/build_state.c: the state of a build between two units, so that hours of work survive a stop. What is on
 * disk already is synced first; then the state is written beside it and renamed, so that there is always a whole one.
 */
#include "render/bricks/build_private.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define STATE_MAGIC UINT64_C(0x3445544154534242) /* "BBSTATE4" */

struct state_head { /* of this machine and this build only: never carried elsewhere */
	uint64_t magic, fingerprint;
	uint64_t append, done, n_nonfinite;
	double least, most;
	uint32_t level, tile, y, z;
};

struct piece {
	void *at;
	size_t bytes;
};

/* The same data, the same choices. */
static uint64_t fingerprint(const struct bb_build *b)
{
	const struct bb_build_config *c = b->config;
	const double numbers[] = { c->has_range ? c->least : 0, c->has_range ? c->most : 0 };
	const uint64_t parts[] = { c->steps->fingerprint,
				   c->edge,
				   c->pad,
				   (uint64_t)c->type,
				   (uint64_t)c->codec,
				   (uint64_t)c->grid,
				   c->has_range,
				   c->memory_bytes,
				   sizeof(struct bb_build_node),
				   sizeof(struct bb_build_space) };

	return (uint64_t)bb_crc32c(0, parts, sizeof(parts)) << 32 |
	       bb_crc32c(bb_crc32c(bb_crc32c(1, parts, sizeof(parts)), c->extent, sizeof(c->extent)), numbers,
			 sizeof(numbers));
}

static size_t pieces(const struct bb_build *b, struct piece out[6])
{
	const struct bb_tree *t = &b->h.tree;
	const size_t times = t->n_times;
	size_t n_samples = t->n_steps, n = 0;

	for (int a = 0; a < 3; a++)
		n_samples *= b->n_cells[a];
	out[n++] = (struct piece){ b->index, t->n_bricks * sizeof(*b->index) };
	out[n++] = (struct piece){ b->moments, t->n_bricks * sizeof(*b->moments) };
	out[n++] = (struct piece){ b->samples, n_samples * sizeof(*b->samples) };
	out[n++] = (struct piece){ b->node, times * b->n_here * sizeof(*b->node) };
	if (b->space)
		out[n++] = (struct piece){ b->space, times * b->n_here * sizeof(*b->space) };
	if (b->space_above)
		out[n++] = (struct piece){ b->space_above, times * b->n_above * sizeof(*b->space_above) };
	return n;
}

static bool put(FILE *f, uint32_t *crc, const void *bytes, size_t n)
{
	*crc = bb_crc32c(*crc, bytes, n);
	return fwrite(bytes, 1, n, f) == n;
}

void bb_build_keep(struct bb_build *b)
{
	bb_build_output_flush(b);
	if (b->status) /* a state of what is not in the file would be believed */
		return;
	const struct state_head head = { STATE_MAGIC,
					 fingerprint(b),
					 bb_build_output_end(b),
					 b->done,
					 b->h.n_nonfinite,
					 b->h.least,
					 b->h.most,
					 b->level,
					 b->tile,
					 b->y,
					 b->z };
	char path[BB_PATH_MAX_BYTES + 16];
	struct piece piece[6];
	const size_t n = pieces(b, piece);
	uint32_t crc = 0;

	snprintf(path, sizeof(path), "%s.new", b->state);
	FILE *f = fdatasync(b->fd) || fdatasync(b->spill[0]) || fdatasync(b->spill[1]) ? NULL : fopen(path, "we");
	bool ok = f && put(f, &crc, &head, sizeof(head));
	for (size_t i = 0; i < n && ok; i++)
		ok = put(f, &crc, piece[i].at, piece[i].bytes);
	ok = ok && fwrite(&crc, 1, sizeof(crc), f) == sizeof(crc) && fflush(f) == 0 && fsync(fileno(f)) == 0;
	if (f && fclose(f))
		ok = false;
	if (!ok || rename(path, b->state)) {
		bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
		unlink(path);
	}
	b->since_checkpoint = 0;
}

static bool get(FILE *f, uint32_t *crc, void *bytes, size_t n)
{
	if (fread(bytes, 1, n, f) != n)
		return false;
	*crc = bb_crc32c(*crc, bytes, n);
	return true;
}

/* The arrays of the level that the state is of. */
static bool take_level(struct bb_build *b, const struct state_head *head)
{
	const struct bb_tree *t = &b->h.tree;
	const size_t times = t->n_times;

	if (head->level >= t->n_levels)
		return false;
	bb_build_release(b, b->node, times * b->n_here, sizeof(*b->node));
	bb_build_release(b, b->space_above, times * b->n_above, sizeof(*b->space_above));
	b->space_above = NULL;
	b->level = head->level;
	b->n_here = t->first[b->level + 1] - t->first[b->level];
	b->n_above = b->level ? t->first[b->level] - t->first[b->level - 1] : 0;
	b->node = bb_build_alloc(b, times * b->n_here, sizeof(*b->node), "statistics of a level");
	if (!bb_build_at_leaves(b))
		b->space = bb_build_alloc(b, times * b->n_here, sizeof(*b->space), "errors of a level");
	if (b->level)
		b->space_above = bb_build_alloc(b, times * b->n_above, sizeof(*b->space_above), "errors of parents");
	return !b->status;
}

static bool read_state(struct bb_build *b, FILE *f)
{
	struct state_head head;
	struct piece piece[6];
	uint32_t crc = 0, kept;

	if (!get(f, &crc, &head, sizeof(head)) || head.magic != STATE_MAGIC || head.fingerprint != fingerprint(b) ||
	    !take_level(b, &head))
		return false;
	const size_t n = pieces(b, piece);
	for (size_t i = 0; i < n; i++)
		if (!get(f, &crc, piece[i].at, piece[i].bytes))
			return false;
	const uint32_t *grid = b->h.tree.grid[head.level];
	if (fread(&kept, 1, sizeof(kept), f) != sizeof(kept) || kept != crc || !head.tile || head.tile > grid[1] ||
	    head.y > grid[1] + head.tile || head.z >= grid[2])
		return false;
	b->append = head.append;
	b->done = head.done;
	b->h.n_nonfinite = head.n_nonfinite;
	b->h.least = head.least;
	b->h.most = head.most;
	b->tile = head.tile;
	b->y = head.y;
	b->z = head.z;
	return true;
}

/* A state that was begun to be read and is no good leaves zeroed arrays of the leaves behind, as before. */
static void begin_anew(struct bb_build *b)
{
	const struct state_head leaves = { .level = b->h.tree.n_levels - 1 };
	struct piece piece[6];

	bb_build_release(b, b->space, (size_t)b->h.tree.n_times * b->n_here, sizeof(*b->space));
	b->space = NULL;
	if (!take_level(b, &leaves))
		return;
	const size_t n = pieces(b, piece);
	for (size_t i = 0; i < n; i++)
		memset(piece[i].at, 0, piece[i].bytes);
}

bool bb_build_resume(struct bb_build *b)
{
	FILE *f = fopen(b->state, "re");

	if (!f)
		return false;
	const bool ok = read_state(b, f);
	fclose(f);
	if (!ok && !b->status)
		begin_anew(b);
	b->report->resumed = ok;
	return ok;
}
