/*
 * tests/shutter_contract.h: what every shutter chain must do, as checks on an open one, and the script of the class
 * for tests/fidelity.h. Which back end it is, and whether time passes or is waited for, is the business of whoever
 * opens the bench: tests/contract_shutter.c for sims, wires and kernels, tests/hw_room.c for a room. A check begins with
 * open eyes.
 */
#ifndef BB_TESTS_SHUTTER_CONTRACT_H
#define BB_TESTS_SHUTTER_CONTRACT_H

#include "hal/shutter.h"
#include "tests/fidelity.h"

#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define SHUTTER_MS INT64_C(1000000)
#define SHUTTER_EDGES_MOST 2000

/* A row is a stage in chain order; the last one is the glasses. */
struct shutter_bench {
	struct bb_shutter *sh;
	struct bb_clock *clk;
	const struct bb_shutter_config *config; /* as it was opened */
	double scale;   /* how long to look, as a part of what costs nothing on the virtual clock */
	int64_t rest_ns; /* what people's eyes are owed between two changes of mode; 0 where nobody looks */
	int64_t gap_ns; /* an edge is told at most so long after it was; 0 where nobody waits for anything */
	void (*silence)(struct shutter_bench *t, uint32_t edges); /* the world's: from the next edge on so many do not come */
	/* The last switch of the glasses as it was: the eye, and when if at_ns is not -1. NULL: nobody knows. */
	enum bb_eye (*truth)(struct shutter_bench *t, int64_t *at_ns);
	void *impl;
	size_t n[BB_STAGES_MAX + 1];
	struct bb_shutter_edge edge[BB_STAGES_MAX + 1][SHUTTER_EDGES_MOST];
};

static inline size_t shutter_rows(const struct shutter_bench *t)
{
	return (size_t)t->config->n_stages + 1;
}

static inline size_t shutter_row(const struct shutter_bench *t, uint8_t stage)
{
	return stage == BB_STAGE_EMITTER ? shutter_rows(t) - 1 : stage;
}

/* Does the back end report the edges of this row? The glasses' always. */
static inline bool shutter_seen(const struct shutter_bench *t, size_t row)
{
	return row + 1 == shutter_rows(t) || (int64_t)row < bb_shutter_limits(t->sh)->n_stages;
}

static inline size_t shutter_first_row(const struct shutter_bench *t)
{
	return shutter_seen(t, 0) ? 0 : shutter_rows(t) - 1;
}

static inline int64_t shutter_period_ns(const struct shutter_bench *t)
{
	return bb_rate_period_ns(t->config->rate);
}

/* How far one edge may be from its place: jitter, the generator's rate error, stamps. */
static inline int64_t shutter_wander_ns(const struct shutter_bench *t)
{
	return 2 * bb_shutter_limits(t->sh)->stamp_error_ns + (int64_t)(8 * t->config->jitter_us * 1000) +
	       (int64_t)(t->config->rate_error_ppm * 1e-6 * (double)shutter_period_ns(t)) + 2;
}

/* How many edges must be told within a time that begins with none, at least. */
static inline size_t shutter_least(const struct shutter_bench *t, int64_t for_ns)
{
	return (size_t)((for_ns - t->gap_ns) / shutter_period_ns(t)) - 1;
}

/* Runs the clock, reading as it goes; edges by row, from now on. */
static inline void shutter_collect(struct shutter_bench *t, int64_t for_ns)
{
	const int64_t end_ns = bb_clock_now_ns(t->clk) + for_ns;
	struct bb_shutter_edge e[16];
	size_t n;

	memset(t->n, 0, sizeof(t->n));
	while (bb_clock_now_ns(t->clk) < end_ns) {
		bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + 10 * SHUTTER_MS);
		while (bb_shutter_read(t->sh, e, sizeof(e) / sizeof(e[0]), &n) == BB_OK)
			for (size_t i = 0; i < n; i++) {
				const size_t row = shutter_row(t, e[i].stage);
				assert_true(row < shutter_rows(t) && t->n[row] < SHUTTER_EDGES_MOST);
				assert_true(e[i].at_ns <= bb_clock_now_ns(t->clk));
				t->edge[row][t->n[row]++] = e[i];
			}
	}
}

static inline void shutter_stereo(struct shutter_bench *t)
{
	shutter_collect(t, t->rest_ns);
	assert_int_equal(bb_shutter_set_mode(t->sh, BB_SHUTTER_STEREO), BB_OK);
}

static inline void shutter_open_eyes(struct shutter_bench *t)
{
	shutter_collect(t, t->rest_ns);
	assert_int_equal(bb_shutter_set_mode(t->sh, BB_SHUTTER_OPEN), BB_OK);
}

static inline void shutter_limits_hold(struct shutter_bench *t)
{
	const struct bb_shutter_limits *l = bb_shutter_limits(t->sh);

	assert_true(l->least_period_ns <= shutter_period_ns(t) && shutter_period_ns(t) <= l->most_period_ns);
	assert_true(l->phase_step_ns >= 0 && l->stamp_error_ns >= 0);
	assert_true(l->open_ns >= l->close_ns);
	assert_true(l->n_stages >= 0 && l->n_stages <= t->config->n_stages);
}

static inline void shutter_edges_alternate(struct shutter_bench *t)
{
	const int64_t for_ns = (int64_t)(5e9 * t->scale);
	const int64_t expected = for_ns / shutter_period_ns(t);
	const int64_t late = (t->gap_ns + shutter_period_ns(t) - 1) / shutter_period_ns(t);

	shutter_stereo(t);
	if (t->gap_ns) /* what runs in real time needs a moment to begin */
		shutter_collect(t, 100 * SHUTTER_MS);
	shutter_collect(t, for_ns);
	for (size_t s = 0; s < shutter_rows(t); s++) {
		if (!shutter_seen(t, s)) {
			assert_int_equal(t->n[s], 0);
			continue;
		}
		assert_in_range(t->n[s], expected - 1 - late, expected + 1 + late);
		for (size_t i = 1; i < t->n[s]; i++) {
			const struct bb_shutter_edge *p = &t->edge[s][i - 1], *q = &t->edge[s][i];
			assert_int_equal(q->seq, p->seq + 1);
			assert_true(q->eye != p->eye && (q->eye == BB_EYE_LEFT || q->eye == BB_EYE_RIGHT));
			assert_true(llabs(q->at_ns - p->at_ns - shutter_period_ns(t)) <= shutter_wander_ns(t));
		}
	}
	for (size_t s = 1; s < shutter_rows(t) && shutter_seen(t, 0); s++) { /* one edge has one eye everywhere */
		const uint32_t ahead = t->edge[s][0].seq - t->edge[0][0].seq;
		assert_int_equal((t->edge[s][0].eye + t->edge[0][0].eye + ahead) % 2, 0);
	}
}

/* What is told is what was. Edges are judged when 2 to 4 ms old: the glasses have switched, and not yet again. */
static inline void shutter_truth_is_told(struct shutter_bench *t)
{
	const int64_t within_ns = bb_shutter_limits(t->sh)->stamp_error_ns + bb_shutter_limits(t->sh)->phase_step_ns;
	struct bb_shutter_edge e[16], last = { 0 };
	size_t n, judged = 0;

	shutter_stereo(t);
	for (int i = 0; t->truth && i < 500; i++) {
		bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + SHUTTER_MS);
		while (bb_shutter_read(t->sh, e, sizeof(e) / sizeof(e[0]), &n) == BB_OK)
			for (size_t k = 0; k < n; k++)
				last = e[k].stage == BB_STAGE_EMITTER ? e[k] : last;
		const int64_t age_ns = bb_clock_now_ns(t->clk) - last.at_ns;
		if (i < 200 || age_ns < 2 * SHUTTER_MS || age_ns > 4 * SHUTTER_MS)
			continue;
		int64_t at_ns = -1;
		assert_int_equal(t->truth(t, &at_ns), last.eye);
		if (at_ns >= 0)
			assert_in_range(llabs(at_ns - last.at_ns), 0, within_ns);
		judged++;
	}
	assert_true(!t->truth || judged >= 30);
}

/* Edges of a row against those of the glasses by number, mean, ns. */
static inline double shutter_lag_ns(const struct shutter_bench *t, size_t row)
{
	const size_t last = shutter_rows(t) - 1;
	double sum = 0;
	int n = 0;

	for (size_t i = 0, k = 0; i < t->n[row] && k < t->n[last];) {
		const struct bb_shutter_edge *p = &t->edge[row][i], *q = &t->edge[last][k];
		if (p->seq != q->seq) {
			if (p->seq < q->seq)
				i++;
			else
				k++;
			continue;
		}
		sum += (double)(p->at_ns - q->at_ns);
		n++;
		i++;
		k++;
	}
	assert_true(n > 50 * t->scale);
	return sum / n;
}

static inline void shutter_phase_moves(struct shutter_bench *t)
{
	const double step_ns = (double)bb_shutter_limits(t->sh)->phase_step_ns;
	const int64_t asked_ns[] = { 0, 1234567, 3000000, shutter_period_ns(t) - 333333, 100400 };
	const uint8_t stage = t->config->n_stages > 1;
	double first_ns[BB_STAGES_MAX + 1] = { 0 };

	if (step_ns <= 0) { /* then it must say so */
		assert_int_equal(bb_shutter_set_phase(t->sh, stage, 1234567, 1000000), BB_ERR_UNSUPPORTED);
		return;
	}
	shutter_stereo(t);
	for (size_t i = 0; i < sizeof(asked_ns) / sizeof(asked_ns[0]); i++) {
		assert_int_equal(bb_shutter_set_phase(t->sh, stage, asked_ns[i], 1000000), BB_OK);
		shutter_collect(t, 30 * SHUTTER_MS + 2 * t->gap_ns); /* the edge under way */
		shutter_collect(t, (int64_t)(1e9 * t->scale));
		for (size_t s = 0; s < shutter_rows(t); s++) {
			const double lag_ns = shutter_lag_ns(t, s);
			if (!i)
				first_ns[s] = lag_ns;
			const double want_ns = s == stage ? (double)(asked_ns[i] - asked_ns[0]) : 0;
			assert_true(fabs(lag_ns - first_ns[s] - want_ns) <= 2 * step_ns + 2);
		}
	}
}

static inline void shutter_arguments_are_checked(struct shutter_bench *t)
{
	const enum bb_status able = bb_shutter_limits(t->sh)->phase_step_ns ? BB_OK : BB_ERR_UNSUPPORTED;
	const int64_t other_ns = (int64_t)(t->config->emitter_offset_us * 1000) + SHUTTER_MS;

	assert_int_equal(bb_shutter_set_phase(t->sh, (uint8_t)t->config->n_stages, 0, 0), BB_ERR_USAGE);
	assert_int_equal(bb_shutter_set_phase(t->sh, 0, -1, 0), BB_ERR_RANGE);
	assert_int_equal(bb_shutter_set_phase(t->sh, 0, shutter_period_ns(t), 0), BB_ERR_RANGE);
	assert_int_equal(bb_shutter_set_phase(t->sh, 0, 0, 1000001), BB_ERR_RANGE);
	assert_int_equal(bb_shutter_set_phase(t->sh, BB_STAGE_EMITTER, other_ns, 500000), able);
}

static inline void shutter_open_stops(struct shutter_bench *t)
{
	const size_t first = shutter_first_row(t), least = shutter_least(t, 100 * SHUTTER_MS);

	shutter_collect(t, 100 * SHUTTER_MS);
	for (size_t s = 0; s < shutter_rows(t); s++)
		assert_int_equal(t->n[s], 0); /* open until told otherwise */
	shutter_stereo(t);
	shutter_stereo(t);
	shutter_collect(t, 100 * SHUTTER_MS);
	assert_true(t->n[first] >= least);
	shutter_open_eyes(t);
	shutter_collect(t, 100 * SHUTTER_MS);
	for (size_t s = 0; s < shutter_rows(t); s++)
		assert_int_equal(t->n[s], 0);
	shutter_stereo(t);
	shutter_collect(t, 100 * SHUTTER_MS);
	assert_true(t->n[first] >= least);
}

static inline void shutter_small_pieces_lose_nothing(struct shutter_bench *t)
{
	struct bb_shutter_edge e;
	uint32_t seq = 0;
	size_t n, told = 0;

	shutter_stereo(t);
	bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + 200 * SHUTTER_MS);
	const int64_t now_ns = bb_clock_now_ns(t->clk);
	while (bb_shutter_read(t->sh, &e, 1, &n) == BB_OK) {
		assert_int_equal(n, 1);
		if (shutter_row(t, e.stage) == shutter_first_row(t)) {
			assert_true(!told || e.seq == seq + 1);
			seq = e.seq;
			told++;
		}
	}
	assert_int_equal(n, 0);
	assert_true(told >= shutter_least(t, 200 * SHUTTER_MS));
	if (bb_clock_is_virtual(t->clk))
		assert_int_equal(bb_clock_now_ns(t->clk), now_ns);
	else /* nothing blocks */
		assert_true(bb_clock_now_ns(t->clk) - now_ns < 5 * SHUTTER_MS);
	assert_int_equal(bb_shutter_read(t->sh, &e, 0, &n), BB_ERR_USAGE);
}

/* ---- the script of the class: edges in four windows, between which something happens ---- */

#define SHUTTER_SCRIPT_EDGES 160

struct shutter_watch {
	struct shutter_bench *t;
	bool began;
	uint32_t seq0;   /* edge 0 of the script: the first of a left eye that the glasses show once it runs */
	int64_t newest;  /* edge of the glasses */
	size_t n_all;
	enum bb_status silent; /* what a read says during the silence */
	bool here[BB_STAGES_MAX + 1][SHUTTER_SCRIPT_EDGES];
	struct bb_shutter_edge edge[BB_STAGES_MAX + 1][SHUTTER_SCRIPT_EDGES];
};

static inline void shutter_watch_take(struct shutter_watch *w, const struct bb_shutter_edge *e)
{
	const size_t row = shutter_row(w->t, e->stage);
	const int64_t k = (int32_t)(e->seq - w->seq0);

	w->n_all++;
	if (row >= shutter_rows(w->t) || !w->began || k < 0 || k >= SHUTTER_SCRIPT_EDGES)
		return;
	w->here[row][k] = true;
	w->edge[row][k] = *e;
	if (e->stage == BB_STAGE_EMITTER)
		w->newest = k;
}

/* Looks every millisecond until the glasses have shown edge `last` or so many periods have passed. */
static inline void shutter_watch_until(struct shutter_watch *w, int64_t last, int64_t periods)
{
	const int64_t end_ns = bb_clock_now_ns(w->t->clk) + periods * shutter_period_ns(w->t);
	struct bb_shutter_edge e[8];
	size_t n;

	while (bb_clock_now_ns(w->t->clk) < end_ns && (!w->began || w->newest < last)) {
		bb_clock_run_until(w->t->clk, bb_clock_now_ns(w->t->clk) + SHUTTER_MS);
		while ((w->silent = bb_shutter_read(w->t->sh, e, sizeof(e) / sizeof(e[0]), &n)) == BB_OK)
			for (size_t i = 0; i < n; i++) {
				if (!w->began && last == 0 && e[i].stage == BB_STAGE_EMITTER && e[i].eye == BB_EYE_LEFT) {
					w->began = true;
					w->seq0 = e[i].seq;
				}
				shutter_watch_take(w, &e[i]);
			}
	}
}

/* The stamps of an edge and of the log's first one may both be wrong; a delay is rounded to the device's step. */
static inline int64_t shutter_within_ns(const struct shutter_bench *t)
{
	return 2 * bb_shutter_limits(t->sh)->stamp_error_ns + bb_shutter_limits(t->sh)->phase_step_ns;
}

static inline void shutter_note_window(const struct shutter_watch *w, struct fid_log *log, int64_t from, int64_t to,
                                       bool stages)
{
	static const char *const eyes[] = { "no eye", "left eye", "right eye" };
	const size_t rows = shutter_rows(w->t);

	for (int64_t k = from; k < to; k++)
		for (size_t s = 0; s < (stages ? rows : 1); s++) {
			const size_t row = (s + rows - 1) % rows; /* the glasses first */
			const struct bb_shutter_edge *e = &w->edge[row][k];
			if (w->here[row][k])
				fid_note(log, e->at_ns, shutter_within_ns(w->t), "%s %lld: %s", s ? w->t->config->stage[row] : "glasses",
				         (long long)k, eyes[e->eye]);
		}
}

/* stages: those of the chain as well, and one is moved; else the glasses only, which is all that a sync line tells. */
static inline void shutter_script(struct shutter_bench *t, struct fid_log *log, bool stages)
{
	struct shutter_watch *w = calloc(1, sizeof(*w));
	enum bb_status moved = BB_OK;

	assert_non_null(w);
	w->t = t;
	shutter_stereo(t);
	shutter_watch_until(w, -1, 24);
	shutter_watch_until(w, 0, 24);
	assert_true(w->began);
	shutter_watch_until(w, 24, 48);
	if (stages)
		moved = bb_shutter_set_phase(t->sh, 1, 2 * SHUTTER_MS, 1000000);
	shutter_watch_until(w, 60, 60);
	t->silence(t, 24); /* 61 .. 84 */
	shutter_watch_until(w, 61, 12);
	const enum bb_status silent = w->silent;
	shutter_watch_until(w, 100, 60);
	const enum bb_status opened = bb_shutter_set_mode(t->sh, BB_SHUTTER_OPEN);
	w->n_all = 0;
	shutter_watch_until(w, SHUTTER_SCRIPT_EDGES, 12);
	const size_t n_open = w->n_all;
	const enum bb_status again = bb_shutter_set_mode(t->sh, BB_SHUTTER_STEREO);
	shutter_watch_until(w, 140, 60);

	const int64_t end_ns = w->edge[shutter_rows(t) - 1][100].at_ns;
	shutter_note_window(w, log, 0, 24, stages);
	if (stages)
		fid_note(log, w->edge[1][24].at_ns, shutter_period_ns(t), "second stage to 2 ms: %s", bb_status_text(moved));
	shutter_note_window(w, log, 48, 60, stages);
	shutter_note_window(w, log, 60, 100, false);
	fid_note(log, w->edge[shutter_rows(t) - 1][60].at_ns, shutter_within_ns(t), "silence: %s", bb_status_text(silent));
	shutter_note_window(w, log, 88, 100, stages);
	fid_note(log, end_ns, shutter_within_ns(t), "open: %s, %zu edges", bb_status_text(opened), n_open);
	fid_note(log, end_ns, shutter_within_ns(t), "stereo: %s", bb_status_text(again));
	shutter_note_window(w, log, 124, 136, stages);
	free(w);
}

#endif
