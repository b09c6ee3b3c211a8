#include "sync/sync_guard.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GOOD_EDGES 8
#define GOOD_PART 0.02                /* of a period, from one edge to the next */
#define OFF_PART 0.08                 /* of a period, from its place: beyond, an eye's share of the light moves visibly */
#define TRY_NS INT64_C(300000000)     /* for so long at most it is listened to */
#define PROVEN_NS (10 * BB_NS_PER_S)  /* after so long tries start afresh */
#define DOUBLINGS 4
#define FLAPS 3
#define WANDER_PPM 1.0                /* what the best oscillator of such a chain is trusted with */

const char *bb_guard_cause_text(enum bb_guard_cause cause)
{
	static const char *const text[] = { "", "SYNC_LOST", "SYNC_FLAPS", "RATE_CHANGE", "CHAIN_GONE", "LC_BIAS",
		                            "EYES_UNKNOWN" };

	return text[cause];
}

void bb_guard_init(struct bb_sync_guard *g, const struct bb_guard_config *c, int64_t now_ns)
{
	memset(g, 0, sizeof(*g));
	g->c = *c;
#ifdef BB_SAFE_UNLATCHED /* see hal/safe_state.c */
	g->c.safety.transition_gap_s = 0;
#endif
	g->runs_ns = BB_NEVER;
	g->since_ns = now_ns;
}

static size_t row_of(uint8_t stage)
{
	return stage == BB_STAGE_EMITTER ? BB_STAGES_MAX : stage;
}

static const struct bb_phase_stage *stage_at(const struct bb_phase *p, size_t row)
{
	return row == BB_STAGES_MAX ? &p->emitter : &p->stage[row];
}

/* ---- edges ---- */

/* All that went wrong with a row, ever, by weight. */
static uint64_t wrongs(const struct bb_sync_guard *g, const struct bb_phase *p, size_t row)
{
	const struct bb_phase_stage *s = stage_at(p, row);

	return s->missed + 2 * s->doubled + 2 * g->slips[row] + (row == BB_STAGES_MAX ? g->offs : 0);
}

/* The same eye twice: it has seen for two periods, and the other one for none. */
static void note_slip(struct bb_sync_guard *g, const struct bb_phase *p, const struct bb_shutter_edge *e)
{
	const size_t row = row_of(e->stage);
	struct bb_shutter_edge *last = &g->last[row];
	const uint32_t steps = e->seq - last->seq;
	const bool runs_on = last->at_ns > g->runs_ns;

	if (!runs_on)
		g->disturbed[row] = wrongs(g, p, row); /* numbers that went by while it stood still */
	else if (g->quiet[row])
		g->disturbed[row] += steps - 1; /* they are the silence */
	if (runs_on && last->eye && e->eye && steps % 2 == (last->eye == e->eye))
		g->slips[row]++;
	g->quiet[row] = false;
	*last = *e;
}

/* Off the other way than the one before, or for the first time: a new period would be off the same way again and again. */
static void note_off(struct bb_sync_guard *g, double off_ns, double most_ns)
{
	const bool again = g->off_ns * off_ns > 0 && fabs(g->off_ns) > most_ns / 2;

	if (fabs(off_ns) > most_ns && !again)
		g->offs++;
	g->off_ns = off_ns;
}

/* Of an edge from where the last eight put it, on the mean. */
static double off_place_ns(const struct bb_sync_guard *g, const struct bb_phase *p, const struct bb_shutter_edge *e)
{
	const uint32_t n = g->n < 8 ? g->n : 8;
	double sum = 0;

	for (uint32_t i = 1; i <= n; i++) {
		const uint32_t k = (g->n - i) % BB_GUARD_RING;
		sum += (double)(e->at_ns - g->ring[k].at_ns) - (double)(int32_t)(e->seq - g->ring[k].seq) * (double)p->nominal_ns;
	}
	return sum / n;
}

void bb_guard_edge(struct bb_sync_guard *g, const struct bb_phase *p, const struct bb_shutter_edge *e)
{
	if (e->stage != BB_STAGE_EMITTER && e->stage >= g->c.n_stages)
		return;
	bb_lc_edge(&g->lc[row_of(e->stage)], (enum bb_eye)e->eye, e->at_ns);
	if (stage_at(p, row_of(e->stage))->at_ns == e->at_ns)
		note_slip(g, p, e);
	if (e->stage != BB_STAGE_EMITTER || p->emitter.at_ns != e->at_ns)
		return; /* one that was not accepted counts as a disturbance, and as nothing else */
	if (g->n) {
		const uint32_t last = (g->n - 1) % BB_GUARD_RING;
		const double steps = (double)(int32_t)(e->seq - g->ring[last].seq);
		const double off = (double)(e->at_ns - g->ring[last].at_ns) - steps * (double)p->nominal_ns;
		note_off(g, off_place_ns(g, p, e), OFF_PART * (double)p->nominal_ns);
		g->jittery = (uint8_t)(g->jittery << 1 | (fabs(g->off_ns) > GOOD_PART * (double)p->nominal_ns));
		g->good = steps < 2 && fabs(off) < GOOD_PART * (double)p->nominal_ns ? g->good + 1 : 0;
	}
	g->ring[g->n % BB_GUARD_RING].seq = e->seq;
	g->ring[g->n++ % BB_GUARD_RING].at_ns = e->at_ns;
}

bool bb_guard_jittery(const struct bb_sync_guard *g)
{
	return __builtin_popcount(g->jittery) >= 3;
}

static bool rate_changed(const struct bb_sync_guard *g, const struct bb_phase *p)
{
	const uint32_t last = (g->n - 1) % BB_GUARD_RING, held = g->n < BB_GUARD_RING ? g->n : BB_GUARD_RING;

	for (uint32_t i = 1; i < held; i++) {
		const uint32_t k = (g->n - 1 - i) % BB_GUARD_RING;
		const int64_t steps = (int32_t)(g->ring[last].seq - g->ring[k].seq);
		if (llabs(g->ring[last].at_ns - g->ring[k].at_ns - steps * p->nominal_ns) > p->nominal_ns / 2)
			return true;
	}
	return false;
}

static int64_t heard_ns(const struct bb_sync_guard *g, const struct bb_phase_stage *s)
{
	return s->n && s->at_ns > g->runs_ns ? s->at_ns : g->runs_ns;
}

/* Is some stage silent for 1.5 periods? Who: the glasses, if they are, for then the line is; else who is for longest. */
static bool silent(struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns)
{
	g->heard_ns = now_ns - p->nominal_ns * 3 / 2;
	bool any = false;

	for (size_t i = 0; i <= g->c.n_stages; i++) {
		const bool last = i == g->c.n_stages;
		const int64_t at_ns = heard_ns(g, last ? &p->emitter : &p->stage[i]);
		if (at_ns >= now_ns - p->nominal_ns * 3 / 2)
			continue;
		if (at_ns < g->heard_ns || last)
			g->silent_stage = last ? BB_STAGE_EMITTER : (unsigned)i;
		g->heard_ns = at_ns < g->heard_ns ? at_ns : g->heard_ns;
		any = true;
	}
	return any;
}

static bool biased(const struct bb_sync_guard *g, int64_t now_ns)
{
	for (size_t i = 0; i <= g->c.n_stages; i++)
		if (bb_lc_harmed(&g->lc[i == g->c.n_stages ? BB_STAGES_MAX : i], now_ns))
			return true;
	return false;
}

/* ---- disturbances ---- */

static void disturb(struct bb_sync_guard *g, unsigned weight, int64_t now_ns)
{
	if (g->n_events == BB_GUARD_EVENTS)
		memmove(&g->event[0], &g->event[1], (--g->n_events) * sizeof(g->event[0]));
	g->event[g->n_events].at_ns = now_ns;
	g->event[g->n_events++].weight = weight;
}

static bool flaps(const struct bb_sync_guard *g, int64_t now_ns)
{
	unsigned weight = 0;

	for (unsigned i = 0; i < g->n_events; i++)
		if ((double)(now_ns - g->event[i].at_ns) < g->c.safety.transition_gap_s * 1e9)
			weight += g->event[i].weight;
	return weight >= FLAPS;
}

/* Missed, doubled and slipped edges since the last step: of the row that has most. */
static unsigned news(struct bb_sync_guard *g, const struct bb_phase *p)
{
	uint64_t most = 0;

	for (size_t i = 0; i <= g->c.n_stages; i++) {
		const size_t row = i == g->c.n_stages ? BB_STAGES_MAX : i;
		const uint64_t n = wrongs(g, p, row);
		most = n - g->disturbed[row] > most ? n - g->disturbed[row] : most;
		g->disturbed[row] = n;
	}
	return most > FLAPS ? FLAPS : (unsigned)most;
}

/* Has a row fallen silent, for 2.5 periods? Those whose last edges lie within 1.5 of each other did for one reason. */
static bool new_silence(struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns)
{
	bool any = false;

	for (size_t i = 0; i <= g->c.n_stages; i++) {
		const size_t row = i == g->c.n_stages ? BB_STAGES_MAX : i;
		const int64_t at_ns = heard_ns(g, stage_at(p, row));
		if (g->quiet[row] || now_ns - at_ns <= p->nominal_ns * 5 / 2)
			continue;
		g->quiet[row] = true;
		if (at_ns - g->silence_ns <= p->nominal_ns * 3 / 2)
			continue;
		g->silence_ns = at_ns;
		any = true;
	}
	return any;
}

static bool note_disturbances(struct bb_sync_guard *g, const struct bb_phase *p, bool is_silent, int64_t now_ns)
{
	const unsigned n = news(g, p);

	if (n)
		disturb(g, n, now_ns);
	if (new_silence(g, p, now_ns))
		disturb(g, 2, now_ns);
	if ((n || is_silent) && p->emitter.n && p->emitter.eye == BB_EYE_NONE)
		g->parity_lost = true;
	return n > 0;
}

void bb_guard_away(struct bb_sync_guard *g)
{
	memset(g->quiet, 1, sizeof(g->quiet));
}

void bb_guard_back(struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns)
{
	const unsigned n = news(g, p);

	if (n && g->runs_ns != BB_NEVER)
		disturb(g, n, now_ns);
	g->runs_ns = BB_NEVER;
	memset(g->disturbed, 0, sizeof(g->disturbed));
}

/* Light has moved a moment ago, and may not much more; or edges are missing that may come back wrong. */
static bool alert(const struct bb_sync_guard *g, int64_t now_ns)
{
	if (g->state == BB_GUARD_TRY || g->state == BB_GUARD_HOLDOVER)
		return true;
	for (unsigned i = 0; i < g->n_events; i++)
		if ((double)(now_ns - g->event[i].at_ns) < g->c.safety.transition_gap_s * 1e9)
			return true;
	return false;
}

int64_t bb_guard_due_ns(const struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns)
{
	if (g->runs_ns == BB_NEVER || alert(g, now_ns))
		return now_ns + p->nominal_ns / 2;
	int64_t least_ns = heard_ns(g, &p->emitter);
	for (size_t i = 0; i < g->c.n_stages; i++)
		least_ns = heard_ns(g, &p->stage[i]) < least_ns ? heard_ns(g, &p->stage[i]) : least_ns;
	return least_ns + p->nominal_ns * 3 / 2 + 1;
}

/* ---- states ---- */

int64_t bb_guard_holdover_ns(const struct bb_sync_guard *g, const struct bb_phase *p)
{
	const double known_ns = (double)(p->emitter.at_ns - p->first_ns);
	const double error_ns = 2 * bb_phase_jitter_ns(p) + (double)g->c.stamp_error_ns;
	const double ppm = WANDER_PPM + 1e6 * error_ns / (known_ns > 1 ? known_ns : 1);
	const int64_t box_ns = bb_safety_holdover_ns(&g->c.safety, p->nominal_ns, ppm);
	const int64_t coast_ns = g->c.coast_ns ? g->c.coast_ns : BB_LC_STILL_NS; /* standing cells cannot wait */

	return box_ns < coast_ns ? box_ns : coast_ns;
}

static void enter(struct bb_sync_guard *g, enum bb_guard_state state, int64_t now_ns)
{
	g->state = state;
	g->since_ns = now_ns;
}

static void open_up(struct bb_sync_guard *g, enum bb_guard_cause cause, int64_t now_ns)
{
	const int64_t gap_ns = (int64_t)(g->c.safety.transition_gap_s * 1e9);

	g->cause = cause;
	g->retry_ns = now_ns + (gap_ns << g->failures);
	g->failures += g->failures < DOUBLINGS;
	enter(g, BB_GUARD_OPEN, now_ns);
}

static void rest_cells(struct bb_sync_guard *g)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(g->lc); i++)
		bb_lc_init(&g->lc[i]);
}

static void start_running(struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns)
{
	g->runs_ns = now_ns;
	g->n = g->good = g->jittery = 0;
	g->silence_ns = now_ns - 2 * p->nominal_ns;
	memset(g->quiet, 0, sizeof(g->quiet));
	(void)news(g, p); /* numbers that went by while they were open are no disturbance */
	rest_cells(g);
	if (g->state == BB_GUARD_TRY)
		disturb(g, FLAPS - 1, now_ns); /* trying was seen as well: it must be the last for a while */
}

static bool all_heard(const struct bb_sync_guard *g, const struct bb_phase *p)
{
	for (size_t i = 0; i < g->c.n_stages; i++)
		if (!p->stage[i].n || p->stage[i].at_ns <= g->runs_ns)
			return false;
	return true;
}

/* Reasons that open at once, in the order in which they explain each other. */
static enum bb_guard_cause trouble(const struct bb_sync_guard *g, const struct bb_phase *p, bool gone, bool is_silent,
                                   int64_t now_ns)
{
	if (gone)
		return BB_GUARD_GONE;
	if (g->n && rate_changed(g, p))
		return BB_GUARD_RATE;
	if (flaps(g, now_ns))
		return BB_GUARD_FLAPS;
	if (is_silent && now_ns - g->heard_ns > bb_guard_holdover_ns(g, p))
		return BB_GUARD_SILENT;
	if (biased(g, now_ns))
		return BB_GUARD_DRIVE;
	return BB_GUARD_NONE;
}

static void settle(struct bb_sync_guard *g, bool is_silent, int64_t now_ns)
{
	if (g->state == BB_GUARD_GOOD && now_ns - g->since_ns > PROVEN_NS)
		g->failures = 0;
	if (g->state == BB_GUARD_GOOD && is_silent) {
		enter(g, BB_GUARD_HOLDOVER, now_ns);
		g->cause = BB_GUARD_SILENT;
		g->good = 0;
	} else if (g->state == BB_GUARD_HOLDOVER && !is_silent && g->good >= GOOD_EDGES) {
		enter(g, BB_GUARD_GOOD, now_ns);
	}
	if (g->state == BB_GUARD_GOOD)
		g->cause = g->parity_lost ? BB_GUARD_PARITY : BB_GUARD_NONE;
}

/* A row came, and stays away; that others have not come yet excuses none. */
static bool broke_off(const struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns)
{
	for (size_t i = 0; i <= g->c.n_stages; i++) {
		const int64_t at_ns = heard_ns(g, i == g->c.n_stages ? &p->emitter : &p->stage[i]);
		if (at_ns > g->runs_ns && now_ns - at_ns > p->nominal_ns * 3 / 2)
			return true;
	}
	return false;
}

static void step_try(struct bb_sync_guard *g, const struct bb_phase *p, bool broken, bool runs, bool is_silent, int64_t now_ns)
{
	const bool failed = broke_off(g, p, now_ns) || now_ns - g->runs_ns > TRY_NS || (g->n && rate_changed(g, p)) ||
	                    biased(g, now_ns);

	if (broken || (runs && failed))
		open_up(g, g->cause, now_ns);
	else if (runs && !is_silent && g->good >= GOOD_EDGES && all_heard(g, p))
		enter(g, BB_GUARD_GOOD, now_ns);
}

enum bb_show bb_guard_step(struct bb_sync_guard *g, const struct bb_phase *p, bool gone, bool runs, int64_t now_ns)
{
	if (!runs)
		g->runs_ns = BB_NEVER;
	else if (g->runs_ns == BB_NEVER)
		start_running(g, p, now_ns);
	const bool is_silent = runs && silent(g, p, now_ns);
	if (is_silent && g->c.coast_ns) /* driven by their own clocks, which are trusted for so long */
		rest_cells(g);
	const bool disturbed = runs && note_disturbances(g, p, is_silent, now_ns);

	if (g->state == BB_GUARD_OPEN) {
		if (!gone && now_ns >= g->retry_ns)
			enter(g, BB_GUARD_TRY, now_ns);
	} else if (g->state == BB_GUARD_TRY) {
		step_try(g, p, gone || disturbed, runs, is_silent, now_ns);
	} else {
		const enum bb_guard_cause cause = trouble(g, p, gone, is_silent, now_ns);
		if (cause != BB_GUARD_NONE)
			open_up(g, cause, now_ns);
		else
			settle(g, is_silent, now_ns);
	}
	if (g->state == BB_GUARD_OPEN)
		return BB_SHOW_OPEN;
	return g->state == BB_GUARD_TRY || g->parity_lost ? BB_SHOW_MONO : BB_SHOW_STEREO;
}
