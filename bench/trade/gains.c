#include "bench/trade/gains.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bench/stats.h"

#define THEIR_LEAVES 32768.0

const struct bb_gains_set bb_gains_sets[] = {
	{ "enlil-filled", "enlil", "scenes/enlil-filled.tf", { 256, 256, 256 }, 8, 0.08, true },
	{ "enlil-sparse", "enlil", "scenes/enlil-sparse.tf", { 256, 256, 256 }, 8, 0.08, true },
	{ "delta-filled", "delta", "scenes/delta-filled.tf", { 222, 253, 103 }, 12, 0.08, true },
	{ "delta-sparse", "delta", "scenes/delta-sparse.tf", { 222, 253, 103 }, 12, 0.08, false },
	{ "wing-filled", "wing", "scenes/wing-filled.tf", { 402, 135, 103 }, 12, 0.08, true },
	{ "wing-sparse", "wing", "scenes/wing-sparse.tf", { 402, 135, 103 }, 12, 0.08, false },
	{ "shock-filled", "shock", "scenes/shock-filled.tf", { 512, 64, 64 }, 25, -0.3, true },
	{ "shock-sparse", "shock", "scenes/shock-sparse.tf", { 512, 64, 64 }, 25, -0.3, false },
	{ NULL, NULL, NULL, { 0 }, 0, 0, false },
};

const char *bb_gains_selector_text(enum bb_gains_selector s)
{
	static const char *const text[] = { "leaf", "far", "opacity", "child", "uniform" };

	return text[s];
}

struct measure {
	struct bb_trade *trade;
	struct bb_trade_setting setting;
	bb_gains_progress progress;
	void *ctx;
	size_t done, of;
	struct bb_error *err;
};

static enum bb_status play(struct measure *m, enum bb_gains_selector s, uint32_t memory, uint32_t stream,
			   struct bb_gains_value *out)
{
	struct bb_trade_point p;

	m->setting.selector = bb_selector_find(bb_gains_selector_text(s));
	m->setting.memory_bricks = memory;
	m->setting.bricks_per_frame = stream;
	const enum bb_status status = bb_trade_play(m->trade, &m->setting, &p, m->err);
	*out = (struct bb_gains_value){ p.psnr_db, p.ssim, p.cpu_ms, p.bricks_mean * (BB_GAINS_STEP + 1) / BB_GAINS_STEP };
	m->done++;
	if (m->progress)
		m->progress(m->ctx, m->done, m->of);
	return status;
}

static uint32_t leaves_of(const struct bb_tree *t, uint32_t brick)
{
	uint32_t n = 1;

	for (int a = 0; a < 3; a++)
		n *= (t->dim[a] + brick - 1) / brick;
	return n;
}

static void budgets(struct bb_gains *g)
{
	for (uint32_t b = 1; b < g->leaves && g->n + 1 < BB_GAINS_BUDGETS_MOST; b *= 2)
		g->budget[g->n++] = b;
	g->budget[g->n++] = g->leaves;
	for (size_t i = g->n; i-- > 0 && g->n_both < BB_GAINS_BUDGETS_MOST;)
		if ((g->n - 1 - i) % 2 == 0)
			g->n_both++;
	for (size_t k = 0; k < g->n_both; k++)
		g->both_budget[k] = g->budget[g->n - 1 - 2 * (g->n_both - 1 - k)];
}

static enum bb_status curves(struct measure *m, struct bb_gains *g)
{
	enum bb_status status = BB_OK;

	for (int s = 0; s < BB_GAINS_SELECTORS && !status; s++) {
		for (size_t i = 0; i < g->n && !status; i++)
			status = play(m, (enum bb_gains_selector)s, g->budget[i], 0, &g->memory[s][i]);
		for (size_t i = 0; i < g->n && !status && s != BB_GAINS_UNIFORM; i++)
			status = play(m, (enum bb_gains_selector)s, g->leaves, g->budget[i], &g->stream[s][i]);
	}
	return status;
}

static uint32_t share(const struct bb_gains *g, double of_theirs)
{
	const double n = rint(of_theirs * g->leaves / THEIR_LEAVES);

	return n > 1 ? (uint32_t)n : 1;
}

static enum bb_status both(struct measure *m, struct bb_gains *g)
{
	static const double memory[] = { 32768, 32768, 4096, 64 }, stream[] = { 4096, 2048, 512, 32 };
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < g->n_both; i++)
		for (size_t k = 0; k < g->n_both && !status; k++)
			status = play(m, BB_GAINS_FAR, g->both_budget[i], g->both_budget[k], &g->both[i][k]);
	for (int i = 0; i < 4 && !status; i++) {
		g->point_memory[i] = share(g, memory[i]);
		g->point_stream[i] = share(g, stream[i]);
		status = play(m, BB_GAINS_FAR, g->point_memory[i], g->point_stream[i], &g->point[i]);
	}
	return status;
}

enum bb_status bb_gains_measure(struct bb_trade *trade, uint32_t brick, enum bb_brick_type type,
				bb_gains_progress progress, void *ctx, struct bb_gains *out, struct bb_error *err)
{
	struct measure m = { .trade = trade, .progress = progress, .ctx = ctx, .err = err };

	*out = (struct bb_gains){ .leaves = leaves_of(&bb_trade_header(trade)->tree, brick) };
	budgets(out);
	m.setting = (struct bb_trade_setting){ .at_once = true, .step_voxels = 1, .brick = brick, .type = type };
	m.of = out->n * (2 * BB_GAINS_SELECTORS - 1) + out->n_both * out->n_both + 4;
	const enum bb_status status = curves(&m, out);
	return status ? status : both(&m, out);
}

struct bb_gains_duel bb_gains_duel(const struct bb_gains *g, bool stream, enum bb_gains_selector other)
{
	const struct bb_gains_value *leaf = stream ? g->stream[BB_GAINS_LEAF] : g->memory[BB_GAINS_LEAF];
	const struct bb_gains_value *with = stream ? g->stream[other] : g->memory[other];
	struct bb_gains_duel d = { .least_db = (double)INFINITY, .most_db = -(double)INFINITY };

	for (size_t i = 0; i < g->n; i++) {
		const double more = leaf[i].psnr_db - with[i].psnr_db;
		if ((uint64_t)g->budget[i] * 256 < g->leaves || (uint64_t)g->budget[i] * 4 > g->leaves || !isfinite(more))
			continue;
		d.n++;
		d.won += more > 0.05;
		d.lost += more < -0.05;
		d.mean_db += more;
		d.least_db = fmin(d.least_db, more);
		d.most_db = fmax(d.most_db, more);
	}
	d.mean_db = d.n ? d.mean_db / d.n : BB_UNKNOWN;
	return d;
}
