#include "bench/trade/still.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define BATCH 64
#define NOWHERE (-1)

struct bb_still {
	const struct bb_bricks *bricks;
	const struct bb_tree *tree;
	struct bb_bricks_reader *reader;
	struct bb_atlas atlas;
	uint8_t *voxels;
	struct bb_atlas_range *range;
	uint64_t *generation;
	struct bb_atlas_cell *map[2];
	int32_t *slot_of;      /* [n_bricks] */
	uint64_t *brick_in;    /* [n_slots], UINT64_MAX: nothing */
	uint64_t *used, turn;  /* [n_slots] when a slot was shown last */
	uint32_t next;         /* where to look for a free slot */
	const struct bb_choice *shown[2];
};

static size_t blocks_of(const struct bb_atlas *a)
{
	return (size_t)a->blocks * a->blocks * a->blocks;
}

static bool take(struct bb_still *s, size_t n_slots)
{
	struct bb_atlas *a = &s->atlas;
	const size_t n_cells = (size_t)a->grid[0] * a->grid[1] * a->grid[2];

	s->voxels = calloc(1, n_slots * a->slot_bytes + bb_atlas_slack_bytes(a));
	s->range = calloc(n_slots * blocks_of(a), sizeof(*s->range));
	s->generation = calloc(n_slots, sizeof(*s->generation));
	s->brick_in = malloc(n_slots * sizeof(*s->brick_in));
	s->used = calloc(n_slots, sizeof(*s->used));
	s->slot_of = malloc(s->tree->n_bricks * sizeof(*s->slot_of));
	for (int k = 0; k < 2; k++)
		a->map[k] = s->map[k] = calloc(n_cells, sizeof(*s->map[k]));
	if (!s->voxels || !s->range || !s->generation || !s->brick_in || !s->used || !s->slot_of || !s->map[0] ||
	    !s->map[1])
		return false;
	a->n_slots = (uint32_t)n_slots;
	a->bricks = s->voxels;
	a->range = s->range;
	a->slot_generation = s->generation;
	memset(s->brick_in, 0xFF, n_slots * sizeof(*s->brick_in));
	memset(s->slot_of, 0xFF, s->tree->n_bricks * sizeof(*s->slot_of)); /* NOWHERE */
	return true;
}

enum bb_status bb_still_create(const struct bb_bricks *bricks, size_t most, struct bb_still **out, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_bricks_header(bricks);

	*out = NULL;
	if (!h->pad)
		return bb_fail(err, BB_ERR_FORMAT, 1471, NULL, "%s", h->name);
	struct bb_still *s = calloc(1, sizeof(*s));
	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "an atlas");
	s->bricks = bricks;
	s->tree = &h->tree;
	bb_atlas_describe(&s->atlas, h);
	enum bb_status status = bb_bricks_reader_create(bricks, BATCH, BB_BRICKS_CACHED, &s->reader, err);
	if (!status && !take(s, most ? most : 1))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "an atlas of %zu bricks", most);
	if (status)
		bb_still_destroy(s);
	else
		*out = s;
	return status;
}

void bb_still_destroy(struct bb_still *s)
{
	if (!s)
		return;
	bb_bricks_reader_destroy(s->reader);
	free(s->voxels);
	free(s->range);
	free(s->generation);
	free(s->brick_in);
	free(s->used);
	free(s->slot_of);
	free(s->map[0]);
	free(s->map[1]);
	free(s);
}

const struct bb_atlas *bb_still_atlas(const struct bb_still *s)
{
	return &s->atlas;
}

uint64_t bb_still_bytes(const struct bb_still *s, uint64_t n_bricks)
{
	const struct bb_atlas *a = &s->atlas;
	const uint64_t n_cells = (uint64_t)a->grid[0] * a->grid[1] * a->grid[2];

	return n_bricks * (a->slot_bytes + blocks_of(a) * sizeof(*s->range) + sizeof(*s->generation)) +
	       bb_atlas_slack_bytes(a) + 2 * n_cells * sizeof(*s->map[0]);
}

/* ---- bricks ---- */

static uint64_t brick_of(const struct bb_still *s, const struct bb_choice *c)
{
	return (uint64_t)c->tau * s->tree->n_nodes + c->node;
}

/* What stays is marked before anything is replaced. */
static void keep(struct bb_still *s, const struct bb_choice *c, size_t n, struct bb_still_counts *counts)
{
	for (size_t i = 0; i < n; i++) {
		const int32_t slot = c[i].flat ? NOWHERE : s->slot_of[brick_of(s, &c[i])];
		if (slot == NOWHERE)
			continue;
		counts->in_use += s->used[slot] != s->turn;
		s->used[slot] = s->turn;
	}
}

/* There is one: a choice is never larger than what the atlas was made for. */
static uint32_t free_slot(struct bb_still *s)
{
	while (s->used[s->next] == s->turn)
		s->next = (s->next + 1) % s->atlas.n_slots;
	return s->next;
}

static enum bb_status flush(struct bb_still *s, struct bb_bricks_want *want, size_t n, struct bb_error *err)
{
	const enum bb_status status = n ? bb_bricks_read_many(s->reader, want, n, err) : BB_OK;

	for (size_t i = 0; i < n && !status; i++) {
		const size_t slot = (size_t)(want[i].out - s->voxels) / s->atlas.slot_bytes;
		(void)bb_atlas_accept(&s->atlas, want[i].out, s->range + slot * blocks_of(&s->atlas));
		s->generation[slot] = ++s->atlas.generation;
	}
	return status;
}

static enum bb_status fetch(struct bb_still *s, const struct bb_choice *c, size_t n, struct bb_still_counts *counts,
			    struct bb_error *err)
{
	struct bb_bricks_want want[BATCH];
	enum bb_status status = BB_OK;
	size_t n_wants = 0;

	for (size_t i = 0; i < n && !status; i++) {
		const uint64_t id = brick_of(s, &c[i]);
		if (c[i].flat || s->slot_of[id] != NOWHERE)
			continue;
		const uint32_t slot = free_slot(s);
		if (s->brick_in[slot] != UINT64_MAX)
			s->slot_of[s->brick_in[slot]] = NOWHERE;
		s->brick_in[slot] = id;
		s->slot_of[id] = (int32_t)slot;
		s->used[slot] = s->turn;
		counts->in_use++;
		counts->bricks++;
		want[n_wants++] = (struct bb_bricks_want){ .brick = id, .out = s->voxels + slot * s->atlas.slot_bytes };
		if (n_wants == BATCH) {
			status = flush(s, want, n_wants, err);
			n_wants = 0;
		}
	}
	return status ? status : flush(s, want, n_wants, err);
}

/* ---- maps ---- */

static struct bb_atlas_cell cell_of(const struct bb_still *s, const struct bb_choice *c, uint32_t up)
{
	const struct bb_bricks_header *h = bb_bricks_header(s->bricks);
	const double per = h->most > h->least ? 1 / (h->most - h->least) : 0;
	const uint64_t id = brick_of(s, c);

	if (!c->flat)
		return (struct bb_atlas_cell){ s->slot_of[id], up, 0 };
	const double value = ((double)bb_bricks_moments(s->bricks)[id].mean - h->least) * per;
	return (struct bb_atlas_cell){ BB_ATLAS_FLAT, up, (float)fmin(fmax(value, 0), 1) };
}

static void fill(struct bb_still *s, struct bb_atlas_cell *map, const struct bb_choice *c)
{
	const struct bb_tree_place p = bb_tree_place(s->tree, c->node);
	const uint32_t up = s->tree->n_levels - 1 - p.level, *grid = s->atlas.grid;
	const struct bb_atlas_cell cell = cell_of(s, c, up);
	uint32_t from[3], to[3];

	for (int a = 0; a < 3; a++) {
		from[a] = p.at[a] << up;
		to[a] = (p.at[a] + 1) << up < grid[a] ? (p.at[a] + 1) << up : grid[a];
	}
	for (uint32_t z = from[2]; z < to[2]; z++)
		for (uint32_t y = from[1]; y < to[1]; y++)
			for (uint32_t x = from[0]; x < to[0]; x++)
				map[((size_t)z * grid[1] + y) * grid[0] + x] = cell;
}

enum bb_status bb_still_show(struct bb_still *s, double step, const struct bb_choice *const choice[2],
			     const size_t n[2], struct bb_still_counts *counts, struct bb_error *err)
{
	struct bb_atlas *a = &s->atlas;
	enum bb_status status = BB_OK;
	const uint32_t n_shown = step > floor(step) ? 2 : 1;

	*counts = (struct bb_still_counts){ 0 };
	a->time = step;
	a->mix = (float)(step - floor(step));
	if (n_shown == a->n_shown && s->shown[0] == choice[0] && (n_shown == 1 || s->shown[1] == choice[1]))
		return BB_OK;
	s->turn++;
	a->n_shown = n_shown;
	s->shown[0] = choice[0];
	s->shown[1] = choice[1];
	for (uint32_t k = 0; k < a->n_shown; k++)
		keep(s, choice[k], n[k], counts);
	for (uint32_t k = 0; k < a->n_shown && !status; k++)
		status = fetch(s, choice[k], n[k], counts, err);
	for (uint32_t k = 0; k < a->n_shown && !status; k++)
		for (size_t i = 0; i < n[k]; i++)
			fill(s, s->map[k], &choice[k][i]);
	if (a->n_shown == 1)
		memcpy(s->map[1], s->map[0], (size_t)a->grid[0] * a->grid[1] * a->grid[2] * sizeof(*s->map[0]));
	a->map_generation++;
	counts->bytes = counts->bricks * a->slot_bytes;
	return status;
}
