/* bench/loop/shutters.c: the chain's edges into phase and polarity, once a frame. */
#include "bench/loop/loop.h"

#include <math.h>
#include <stdlib.h>

#define READ_AT_ONCE 64

static double phase_limit_us(const struct bb_room *room)
{
	for (size_t i = 0; i < room->n_budgets; i++)
		if (room->budgets[i].metric == BB_METRIC_PHASE)
			return room->budgets[i].limit;
	return (double)INFINITY;
}

static void sample_phase(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	int64_t offset_ns;
	unsigned stage;

	if (!bb_phase_worst(&l->phase, &offset_ns, &stage))
		return;
	const int wall = bb_room_wall(l->room, l->room->chain.stage[stage]);
	const struct bb_sample s = { .value = (double)offset_ns * 1e-3,
		                     .uncertainty = (double)bb_shutter_limits(l->rig->shutter)->stamp_error_ns * 1e-3,
		                     .frame = f->frame,
		                     .at_ns = now_ns,
		                     .node = wall < 0 ? BB_NOBODY : (uint16_t)bb_room_node(l->room, l->room->walls[wall].node),
		                     .stage = BB_STAGE_SHUTTER };

	bb_ledger_sample(l->ledger, BB_METRIC_PHASE, &s);
	if (fabs(s.value) > phase_limit_us(l->room))
		bb_watch_bad(l->watch, l->shutter_slot, now_ns, BB_HEALTH_DEGRADED, "stage %s switches %+.0f us from the glasses",
		             l->room->chain.stage[stage], s.value);
	else
		bb_watch_good(l->watch, l->shutter_slot, now_ns);
}

/* Which stage opens for the other eye than the glasses do? -1: none. */
static int inverted_stage(const struct bb_phase *p)
{
	for (unsigned i = 0; i < p->n_stages; i++)
		if (p->stage[i].paired && p->stage[i].eye_differs)
			return (int)i;
	return -1;
}

/* One look a frame: at a stage that disagrees with the glasses, or else at any that can be compared with them. */
static enum bb_polarity_verdict see_polarity(struct bb_frame_loop *l, int stage)
{
	const struct bb_phase *p = &l->phase;
	unsigned i = stage < 0 ? 0 : (unsigned)stage;

	while (stage < 0 && i < p->n_stages && !p->stage[i].paired)
		i++;
	if (i == p->n_stages)
		return l->polarity.verdict;
	const uint64_t flips = l->polarity.flips;
	const enum bb_eye wall = (enum bb_eye)p->stage[i].eye, other = wall == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
	const enum bb_eye glasses = wall == BB_EYE_NONE || stage < 0 ? wall : other;
	const enum bb_polarity_verdict v =
		bb_polarity_see(&l->polarity, BB_POLARITY_LEVEL, p->stage[i].at_ns, wall, wall ? glasses : BB_EYE_LEFT);

	if (l->polarity.flips > flips)
		bb_result_count(l->result, "polarity_flips", 1);
	return v;
}

static void watch_polarity(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	const int stage = inverted_stage(&l->phase);
	const enum bb_polarity_verdict v = see_polarity(l, stage);

	if (v == BB_POLARITY_UNTAGGED) {
		bb_watch_bad(l->watch, l->polarity_slot, now_ns, BB_HEALTH_DEGRADED,
		             "eye polarity unknown: no edge tells whose eye it is");
		return;
	}
	if (stage < 0) {
		bb_watch_good(l->watch, l->polarity_slot, now_ns);
		return;
	}
	f->eyes_swapped = true;
	bb_watch_bad(l->watch, l->polarity_slot, now_ns, BB_HEALTH_DEGRADED,
	             "eye polarity inverted: stage %s and the glasses open for different eyes", l->room->chain.stage[stage]);
}

/* Rows G2, G6, G7: spurious edges, a burst of jitter (2 % of the period), another rate. */
static void watch_rhythm(struct bb_frame_loop *l, int64_t now_ns)
{
	const struct bb_phase *p = &l->phase;
	const double period_ns = (double)p->nominal_ns;
	uint64_t doubled = p->emitter.doubled;

	for (unsigned i = 0; i < p->n_stages; i++)
		doubled += p->stage[i].doubled;
	if (doubled > l->doubled_seen)
		bb_watch_bad(l->watch, l->rhythm_slot, now_ns, BB_HEALTH_DEGRADED, "GLITCH: %llu spurious edges",
		             (unsigned long long)(doubled - l->doubled_seen));
	else if (fabs(p->recent_ns - period_ns) > 0.01 * period_ns)
		bb_watch_bad(l->watch, l->rhythm_slot, now_ns, BB_HEALTH_DEGRADED, "RATE_CHANGE: the sync runs at %.2f Hz, want %.2f",
		             1e9 / p->recent_ns, 1e9 / period_ns);
	else if (bb_phase_jitter_ns(p) > 0.02 * period_ns)
		bb_watch_bad(l->watch, l->rhythm_slot, now_ns, BB_HEALTH_DEGRADED, "JITTER: %.0f us rms",
		             bb_phase_jitter_ns(p) * 1e-3);
	else
		bb_watch_good(l->watch, l->rhythm_slot, now_ns);
	l->doubled_seen = doubled;
}

void bb_shutters_feed(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_shutter_edge edges[READ_AT_ONCE];
	enum bb_status status = BB_OK;
	size_t n;

	if (!l->rig->shutter)
		return;
	while ((status = bb_shutter_read(l->rig->shutter, edges, READ_AT_ONCE, &n)) == BB_OK) {
		for (size_t i = 0; i < n; i++) {
			bb_phase_edge(&l->phase, &edges[i]);
			bb_crosstalk_edge(l->crosstalk, &edges[i]);
			bb_diode_edge(l->diode, &edges[i]);
			bb_eyes_edge(l, &edges[i]);
			bb_ledger_mark(l->ledger, BB_TRACK_SHUTTER, edges[i].stage, edges[i].at_ns, edges[i].eye,
			               edges[i].eye);
		}
	}
	l->eyes.gone = status < 0;
	if (l->eyes.gone)
		bb_watch_bad(l->watch, l->shutter_slot, now_ns, BB_HEALTH_LOST, "CHAIN_GONE: the chain does not answer: %s",
		             bb_status_text(status));
}

void bb_shutters_read(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	if (!l->rig->shutter)
		return;
	bb_shutters_feed(l, now_ns);
	bb_crosstalk_frame(l->crosstalk, f->frame, now_ns, l->ledger);
	if (!l->eyes.running)
		return; /* open shutters have no phase */
	sample_phase(l, f, now_ns);
	watch_polarity(l, f, now_ns);
	watch_rhythm(l, now_ns);
}
