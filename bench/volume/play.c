#include "bench/volume/play.h"

#include <stdlib.h>

struct playing {
	const struct bb_play_config *config;
	const struct bb_bricks_header *h;
	struct bb_choice *heap, *out;
	uint32_t *shown; /* [n_bricks]: 1 + the step it was drawn in last, 0: never */
	uint32_t *used;  /* [n_bricks]: when it was used last, 0: not in memory */
	uint64_t *kept;  /* numbers of the bricks in memory */
	size_t n_kept, slots;
	uint32_t now;
};

static size_t choose(const struct playing *p, uint32_t step)
{
	const struct bb_play_config *c = p->config;
	const struct bb_selector_ask ask = { .step = step, .space_most = c->space_most, .time_most = c->time_most };

	return c->selector->choose(&p->h->tree, c->ratings, &ask, p->heap, p->out);
}

/* A brick drawn as one colour is not drawn when that colour is nothing. */
static bool is_hidden(const struct playing *p, uint64_t id)
{
	const double range = p->h->most - p->h->least;
	const double mean = (double)bb_bricks_moments(p->config->b)[id].mean;
	double rgba[4];

	bb_transfer_at(p->config->tf, range > 0 ? (mean - p->h->least) / range : 0, rgba);
	return !(rgba[3] > 0);
}

static void count(struct playing *p, uint32_t step, size_t n, struct bb_play *out)
{
	const struct bb_tree *t = &p->h->tree;
	const double all = (double)t->dim[0] * t->dim[1] * t->dim[2] * t->n_steps;

	for (size_t i = 0; i < n; i++) {
		const struct bb_choice *c = &p->out[i];
		const uint64_t id = (uint64_t)c->tau * t->n_nodes + c->node;
		const double share = (double)bb_tree_covered(t, c->node) / all;
		if (c->flat) {
			*(is_hidden(p, id) ? &out->hidden : &out->untextured) += share;
			continue;
		}
		const bool there = step && p->shown[id] == step; /* in the step before this one */
		*(there ? &out->reused : &out->loaded) += share;
		out->load_bricks += !there;
		out->kept_bytes += p->shown[id] ? 0 : bb_bricks_brick_bytes(p->h);
		p->shown[id] = step + 1;
	}
}

/* Into memory, in the place of what was used longest ago; true: it was not there. */
static bool load(struct playing *p, uint64_t id)
{
	const bool there = p->used[id];

	p->used[id] = ++p->now;
	if (there || !p->slots)
		return !there;
	if (p->n_kept < p->slots) {
		p->kept[p->n_kept++] = id;
		return true;
	}
	size_t oldest = 0;
	for (size_t i = 1; i < p->n_kept; i++)
		oldest = p->used[p->kept[i]] < p->used[p->kept[oldest]] ? i : oldest;
	p->used[p->kept[oldest]] = 0;
	p->kept[oldest] = id;
	return true;
}

static void play(struct playing *p, struct bb_play *out)
{
	const struct bb_tree *t = &p->h->tree;

	for (int pass = 0; pass < 2; pass++)
		for (uint32_t step = 0; step < t->n_steps; step++) {
			const size_t n = choose(p, step);
			if (!pass)
				count(p, step, n, out);
			for (size_t i = 0; i < n; i++) {
				const uint64_t id = (uint64_t)p->out[i].tau * t->n_nodes + p->out[i].node;
				if (!p->out[i].flat && load(p, id) && pass)
					out->again_bricks++;
			}
		}
	out->load_bricks /= t->n_steps;
	out->again_bricks /= t->n_steps;
	out->load_bytes = out->load_bricks * (double)bb_bricks_brick_bytes(p->h);
	out->again_bytes = out->again_bricks * (double)bb_bricks_brick_bytes(p->h);
}

enum bb_status bb_play(const struct bb_play_config *config, struct bb_play *out, struct bb_error *err)
{
	struct playing p = { .config = config, .h = bb_bricks_header(config->b) };
	const struct bb_tree *t = &p.h->tree;
	enum bb_status status = BB_OK;

	*out = (struct bb_play){ 0 };
	p.slots = config->memory_bytes / bb_bricks_brick_bytes(p.h);
	p.heap = calloc(bb_choose_most(t), sizeof(*p.heap));
	p.out = calloc(bb_choose_most(t), sizeof(*p.out));
	p.shown = calloc(t->n_bricks, sizeof(*p.shown));
	p.used = calloc(t->n_bricks, sizeof(*p.used));
	p.kept = calloc(p.slots + 1, sizeof(*p.kept));
	if (p.heap && p.out && p.shown && p.used && p.kept)
		play(&p, out);
	else
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a sequence of %llu bricks",
				 (unsigned long long)t->n_bricks);
	free(p.heap);
	free(p.out);
	free(p.shown);
	free(p.used);
	free(p.kept);
	return status;
}
