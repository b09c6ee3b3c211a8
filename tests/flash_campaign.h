/*
 * tests/flash_campaign.h: random fault plans over a room, and an oracle of its own for what they make of the light: from
 * what the simulated shutters really did (their events) and how bright the pictures were made, whatever the loop and its
 * flash meter believe. Of every wall and eye the light over 1/60 s, its turning points, and the most of them in a second.
 */
#ifndef BB_TESTS_FLASH_CAMPAIGN_H
#define BB_TESTS_FLASH_CAMPAIGN_H

#include "tests/still_run.h"

#define WALLS 5

struct oracle {
	bool external;
	int64_t at_ns;              /* summed up to here */
	int64_t window_ns;          /* begin of the window under way, while the glasses stand still */
	int64_t edge_ns[3];         /* of the glasses */
	double gate[WALLS + 1][2], light;
	double sum[WALLS][2];       /* ever */
	double edge_sum[3][WALLS][2], window_sum[WALLS][2];
	double low[WALLS][2], high[WALLS][2];
	int way[WALLS][2];
	size_t n_turns[WALLS][2];
	int64_t turn_ns[WALLS][2][64];
	bool away_turn[WALLS][2][64];
	const struct sim_fault *faults;
	int away;                   /* suspensions of the head: nobody is there to hold anything */
	unsigned worst;             /* turning points within a second, of which somebody could have held, */
	int64_t worst_ns;
	unsigned all;               /* and any */
};

static inline void oracle_turn(struct oracle *o, int w, int e, double y, int64_t at_ns)
{
	double *low = &o->low[w][e], *high = &o->high[w][e];
	const bool up = o->way[w][e] <= 0 && y >= *low + 0.1 && *low < 0.8;
	const bool down = o->way[w][e] >= 0 && y <= *high - 0.1 && y < 0.8;
	unsigned n = 0, all = 0;

	if (up || down) {
		o->way[w][e] = up ? 1 : -1;
		*low = *high = y;
		o->away_turn[w][e][o->n_turns[w][e] % 64] = o->away > 0;
		o->turn_ns[w][e][o->n_turns[w][e]++ % 64] = at_ns;
		for (size_t i = 0; i < 64 && i < o->n_turns[w][e]; i++) {
			const bool recent = at_ns - o->turn_ns[w][e][i] < BB_NS_PER_S;
			all += recent;
			n += recent && !o->away_turn[w][e][i];
		}
		o->all = all > o->all ? all : o->all;
		if (n > o->worst) {
			o->worst = n;
			o->worst_ns = at_ns;
		}
	}
	*low = fmin(*low, y);
	*high = fmax(*high, y);
}

/* Up to now; while the glasses stand still, a window of 1/60 s after the other, from where they should have moved on. */
static inline void oracle_until(struct oracle *o, int64_t now_ns)
{
	const int64_t window = BB_NS_PER_S / 60;

	while (o->at_ns < now_ns) {
		const bool before = o->at_ns < o->window_ns;
		const int64_t next_ns = before ? o->window_ns : o->window_ns + window;
		const int64_t end_ns = next_ns < now_ns ? next_ns : now_ns;
		const bool whole = end_ns == next_ns;
		for (int w = 0; w < WALLS; w++)
			for (int e = 0; e < 2; e++) {
				const double wall = o->external ? (o->gate[w][0] + o->gate[w][1]) / 2 : 1;
				o->sum[w][e] += (double)(end_ns - o->at_ns) * o->light * wall * o->gate[WALLS][e];
				if (whole && !before)
					oracle_turn(o, w, e, (o->sum[w][e] - o->window_sum[w][e]) / (double)window, end_ns);
				if (whole)
					o->window_sum[w][e] = o->sum[w][e];
			}
		o->at_ns = end_ns;
		if (whole && !before)
			o->window_ns = end_ns;
	}
}

/* An edge of the glasses ends a cycle that began two edges ago. */
static inline void oracle_edge(struct oracle *o, int64_t at_ns)
{
	for (int w = 0; w < WALLS; w++)
		for (int e = 0; e < 2; e++) {
			if (o->edge_ns[1] && at_ns - o->edge_ns[1] < 30 * MS)
				oracle_turn(o, w, e, (o->sum[w][e] - o->edge_sum[1][w][e]) / (double)(at_ns - o->edge_ns[1]), at_ns);
			o->edge_sum[1][w][e] = o->edge_sum[0][w][e];
			o->edge_sum[0][w][e] = o->sum[w][e];
		}
	o->edge_ns[1] = o->edge_ns[0];
	o->edge_ns[0] = at_ns;
	o->window_ns = at_ns + 30 * MS;
}

static inline void oracle_events(void *ctx, const struct bb_event *events, size_t n)
{
	struct oracle *o = ctx;

	for (size_t i = 0; i < n; i++) {
		const struct bb_event *e = &events[i];
		if (e->kind != BB_EV_EDGE && e->kind != BB_EV_OUTPUT && e->kind != BB_EV_FAULT)
			continue;
		oracle_until(o, e->at_ns);
		if (e->kind == BB_EV_FAULT) {
			if (!strcmp(o->faults[e->a].verb, "suspend"))
				o->away += e->b ? 1 : -1;
			continue;
		}
		if (e->kind == BB_EV_OUTPUT) {
			o->light = (double)e->b * 1e-6;
			continue;
		}
		double *gate = o->gate[e->b == BB_STAGE_EMITTER ? WALLS : e->b];
		gate[0] = e->a != BB_EYE_RIGHT;
		gate[1] = e->a != BB_EYE_LEFT;
		if (e->b == BB_STAGE_EMITTER && e->a != BB_EYE_NONE)
			oracle_edge(o, e->at_ns);
	}
}

/* ---- plans ---- */

static inline double pick(struct sim_rng *r, double least, double most)
{
	return least + (most - least) * sim_rng_uniform(r);
}

static const char *const walls_of_cabin[] = { "front", "left", "right", "back", "floor" };

/* gentle: not while the frame loop stands still, for then nobody is there to hold anything. */
static inline void one_fault(struct sim_rng *r, bool gentle, struct sim_fault *f, size_t *n)
{
	const char *wall = walls_of_cabin[sim_rng_u64(r) % WALLS];
	const double at_s = pick(r, 0, 9.5);
	const int for_ms = (int)exp(pick(r, log(20), log(4000)));
	char text[160];

	switch (sim_rng_u64(r) % (gentle ? 13 : 14)) {
	case 0: snprintf(text, sizeof(text), "at %.3fs shutter/chain stuck for %dms", at_s, for_ms); break;
	case 1: snprintf(text, sizeof(text), "at %.3fs shutter/chain stuck stage=%s for %dms", at_s, wall, for_ms); break;
	case 2: snprintf(text, sizeof(text), "at %.3fs shutter/chain stuck stage=emitter for %dms", at_s, for_ms); break;
	case 3: snprintf(text, sizeof(text), "at %.3fs shutter/chain miss n=%d", at_s, 1 + (int)(sim_rng_u64(r) % 20)); break;
	case 4: snprintf(text, sizeof(text), "at %.3fs shutter/chain double n=%d", at_s, 1 + (int)(sim_rng_u64(r) % 6)); break;
	case 5: snprintf(text, sizeof(text), "at %.3fs shutter/chain flip_polarity for %dms", at_s, for_ms); break;
	case 6: snprintf(text, sizeof(text), "at %.3fs shutter/chain jitter_burst us=%.0f for %dms", at_s, pick(r, 50, 2000), for_ms); break;
	case 7: snprintf(text, sizeof(text), "at %.3fs shutter/chain rate hz=%.2f for %dms", at_s, pick(r, 70, 160), for_ms); break;
	case 8: snprintf(text, sizeof(text), "at %.3fs shutter/chain unplug for %dms", at_s, for_ms); break;
	case 9: snprintf(text, sizeof(text), "at %.3fs shutter/chain stage_offset stage=%s us=%.0f for %dms", at_s, wall, pick(r, -4000, 4000), for_ms); break;
	case 10: snprintf(text, sizeof(text), "at %.3fs display/%s drop_flip n=%d", at_s, wall, 1 + (int)(sim_rng_u64(r) % 30)); break;
	case 11: snprintf(text, sizeof(text), "at %.3fs node/%s late frames=%d for %dms", at_s, wall, 1 + (int)(sim_rng_u64(r) % 3), for_ms); break;
	case 12: snprintf(text, sizeof(text), "at %.3fs link/net loss percent=%.0f for %dms", at_s, pick(r, 5, 60), for_ms); break;
	default: snprintf(text, sizeof(text), "at %.3fs node/head suspend for %dms", at_s, for_ms < 250 ? for_ms : 250); break;
	}
	plant(f, n, text);
}

/* The same fault again and again: 2 to 20 Hz, half of the time. */
static inline void flap(struct sim_rng *r, struct sim_fault *f, size_t *n, size_t cap)
{
	static const char *const verbs[] = { "stuck", "unplug", "flip_polarity", "stuck stage=emitter", "stuck stage=left", "rate hz=96" };
	const char *verb = verbs[sim_rng_u64(r) % BB_ARRAY_LEN(verbs)];
	const double hz = pick(r, 2, 20), from_s = pick(r, 0, 5);
	char text[160];

	for (double t = from_s; t < 9.8 && *n < cap; t += 1 / hz) {
		snprintf(text, sizeof(text), "at %.3fs shutter/chain %s for %.0fms", t, verb, 500 / hz);
		plant(f, n, text);
	}
}

static inline size_t plan_faults(uint64_t seed, struct sim_fault *f, size_t cap)
{
	struct sim_rng r;
	size_t n = 0;

	sim_rng_seed(&r, seed, "campaign", "flash");
	if (seed % 3 == 0)
		flap(&r, f, &n, cap - 16);
	for (size_t k = 1 + sim_rng_u64(&r) % 8; k; k--)
		one_fault(&r, seed % 3 == 0, f, &n);
	return n;
}

struct campaign {
	double meter;               /* flashes in the worst second, by the run's own meter */
	unsigned oracle;            /* turning points, by ours, while somebody was there */
	int64_t oracle_ns;
	unsigned all;               /* ever */
	uint64_t opened;
	char hash[65];
};

/* duration_s 0: the scene's own ten. */
static inline struct campaign campaign_of(uint64_t seed, const struct sim_fault *f, size_t n, double duration_s)
{
	struct bb_run_options o = still_options(seed % 2 ? "rooms/cabin.yaml" : "rooms/cabin120.yaml", f, n);
	struct oracle *oracle = calloc(1, sizeof(*oracle));
	struct campaign c = { 0 };
	struct bb_run run;

	assert_non_null(oracle);
	oracle->external = seed % 2;
	oracle->light = 1;
	oracle->faults = f;
	for (int w = 0; w <= WALLS; w++)
		oracle->gate[w][0] = oracle->gate[w][1] = 1;
	for (int w = 0; w < WALLS; w++)
		oracle->low[w][0] = oracle->low[w][1] = oracle->high[w][0] = oracle->high[w][1] = 1; /* a room begins open */
	o.seed = seed;
	o.duration_s = duration_s;
	o.events = oracle_events;
	o.events_ctx = oracle;
	still_run(o, &run);
	c.meter = bb_ledger_metric(run.result->ledger, BB_METRIC_FLASHES).max;
	c.oracle = oracle->worst;
	c.oracle_ns = oracle->worst_ns;
	c.all = oracle->all;
	c.opened = counted(run.result, "shutters_opened");
	memcpy(c.hash, run.result->event_log_sha256, sizeof(c.hash));
	bb_run_free(&run);
	free(oracle);
	return c;
}

#endif
