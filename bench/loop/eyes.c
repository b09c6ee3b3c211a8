/*
 * bench/loop/eyes.c: what the two eyes are let see. Every frame the chain's edges say what may be shown (sync/sync_guard.h),
 * the outputs go there as safely as can be (hal/safe_state.h), and the light that comes of it goes to the flash meter.
 */
#include "bench/loop/loop.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

void bb_eyes_init(struct bb_frame_loop *l)
{
	struct bb_eyes *y = &l->eyes;
	const struct bb_guard_config c = { .safety = l->room->safety };

	y->watch = (struct bb_timer){ .step = bb_eyes_watch, .rank = 3 };
	y->running = l->rig->shutter != NULL;
	y->runs = y->running;
	bb_safe_init(&y->safe, &l->room->safety, bb_light_dim(l->room), BB_SHOW_STEREO, bb_clock_now_ns(l->clk));
	y->out = y->safe.out;
	y->sent = y->shown = y->out.light;
	bb_guard_init(&y->guard, &c, bb_clock_now_ns(l->clk));
	if (!l->rig->shutter)
		return;
	const struct bb_shutter_limits *limits = bb_shutter_limits(l->rig->shutter);
	y->guard.c.n_stages = (unsigned)limits->n_stages;
	y->guard.c.coast_ns = limits->coast_ns;
	y->guard.c.stamp_error_ns = limits->stamp_error_ns;
}

/* An edge that was read. */
void bb_eyes_edge(struct bb_frame_loop *l, const struct bb_shutter_edge *e)
{
	bb_guard_edge(&l->eyes.guard, &l->phase, e);
	if (l->eyes.running) /* what was under way when they were opened changes nothing any more */
		bb_light_edge(l->light, e);
}

/* Opening is done at once and tried until it is heard; closing waits until the pictures that go with it are shown. */
static void drive(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_eyes *y = &l->eyes;
	const bool runs = !y->out.open;

	if (runs == y->running || y->gone)
		return;
	if (runs && y->runs != runs) {
		y->runs = runs;
		return;
	}
	y->runs = runs;
	if (bb_shutter_set_mode(l->rig->shutter, runs ? BB_SHUTTER_STEREO : BB_SHUTTER_OPEN) != BB_OK)
		return;
	y->running = runs;
	bb_result_count(l->result, runs ? "shutters_closed" : "shutters_opened", 1);
	if (!runs)
		bb_light_open(l->light, now_ns);
}

static const char *silent_name(const struct bb_frame_loop *l)
{
	const unsigned stage = l->eyes.guard.silent_stage;

	return stage == BB_STAGE_EMITTER ? "the glasses" : l->room->chain.stage[stage];
}

static void tell_holdover(struct bb_frame_loop *l, int64_t now_ns)
{
	const struct bb_sync_guard *g = &l->eyes.guard;
	const double left_s = (double)(bb_guard_holdover_ns(g, &l->phase) - (now_ns - g->heard_ns)) * 1e-9;

	bb_watch_bad(l->watch, l->eyes.slot, now_ns, BB_HEALTH_HOLDOVER, "SYNC_LOST: no edge of %s for %.1f ms, holdover left %.3g s",
	             silent_name(l), (double)(now_ns - g->heard_ns) * 1e-6, fmax(0, left_s));
}

static void tell_open(struct bb_frame_loop *l, int64_t now_ns)
{
	const struct bb_sync_guard *g = &l->eyes.guard;
	const char *word = bb_guard_cause_text(g->cause);
	char why[96] = "";

	if (g->cause == BB_GUARD_SILENT)
		snprintf(why, sizeof(why), "no edge of %s for %.1f ms, ", silent_name(l), (double)(now_ns - g->heard_ns) * 1e-6);
	else if (g->cause == BB_GUARD_RATE)
		snprintf(why, sizeof(why), "%.2f Hz, want %.2f, ", 1e9 / l->phase.recent_ns, 1e9 / (double)l->phase.nominal_ns);
	bb_watch_bad(l->watch, l->eyes.slot, now_ns, BB_HEALTH_LOST, "%s: %sshutters open, both eyes see one view", word, why);
}

/* The rhythm was there a step ago and is not now. */
static void note_loss(struct bb_frame_loop *l, enum bb_guard_state was, int64_t now_ns)
{
	const enum bb_guard_state is = l->eyes.guard.state;
	struct bb_black_trigger t = { .kind = BB_BLACK_LOCK, .at_ns = now_ns, .frame = l->n_frames, .node = BB_NOBODY };

	if (was == is || is == BB_GUARD_GOOD || is == BB_GUARD_TRY || was == BB_GUARD_TRY)
		return;
	snprintf(t.culprit, sizeof(t.culprit), "shutter/%s", l->room->chain.id);
	bb_blackbox_trigger(l->blackbox, &t);
}

/* One word a state; the first of an incident stays, a worse one takes its place. */
static void tell(struct bb_frame_loop *l, int64_t now_ns)
{
	const struct bb_sync_guard *g = &l->eyes.guard;

	if (g->state == BB_GUARD_OPEN || g->state == BB_GUARD_TRY)
		tell_open(l, now_ns);
	else if (g->state == BB_GUARD_HOLDOVER)
		tell_holdover(l, now_ns);
	else if (bb_guard_jittery(g))
		bb_watch_bad(l->watch, l->eyes.slot, now_ns, BB_HEALTH_DEGRADED, "JITTER: the last edge is %+.0f us off", g->off_ns * 1e-3);
	else
		bb_watch_good(l->watch, l->eyes.slot, now_ns);
	if (g->parity_lost)
		bb_watch_bad(l->watch, l->eyes.parity_slot, now_ns, BB_HEALTH_DEGRADED,
		             "EYES_UNKNOWN: the chain tells no eyes and was disturbed: mono until somebody looks");
}

/* Row G8, tagged: a stage that opens for the other eye than the glasses gets the other eye's pictures from the next frame
 * on; what was shown meanwhile counts as swapped. */
static void swap_back(struct bb_frame_loop *l, struct bb_frame *f)
{
	struct bb_eyes *y = &l->eyes;
	uint32_t differs = 0;

	for (unsigned i = 0; i < l->phase.n_stages; i++)
		differs |= (uint32_t)(l->phase.stage[i].paired && l->phase.stage[i].eye_differs) << i;
	if (f->eyes_swapped && differs == y->swapped)
		f->eyes_swapped = false;
	if (differs != y->swapped)
		bb_result_count(l->result, "eyes_swapped_back", 1);
	y->swapped = differs;
}

static void meter(struct bb_frame_loop *l, int64_t now_ns)
{
	const struct bb_flash_worst was = l->light ? bb_flash_worst(bb_light_meter(l->light)) : (struct bb_flash_worst){ 0 };

	if (!l->light)
		return;
	bb_light_patch(l->light, l->patch_s);
	bb_light_frame(l->light, now_ns, l->eyes.shown * l->options->dim);
	const struct bb_flash_worst is = bb_flash_worst(bb_light_meter(l->light));
	if (!(is.flashes > was.flashes))
		return;
	const int node = bb_room_node(l->room, l->room->walls[is.wall].node);
	const struct bb_sample s = { .value = is.flashes, .frame = l->n_frames - 1, .at_ns = now_ns,
		                     .node = node < 0 ? BB_NOBODY : (uint16_t)node, .stage = BB_STAGE_COUNT };
	bb_ledger_sample(l->ledger, BB_METRIC_FLASHES, &s);
}

/* Row O4: what the chain tells of the time away is read, judged, and forgotten. */
void bb_eyes_gap(struct bb_frame_loop *l, int64_t now_ns)
{
	if (l->rig->shutter) {
		bb_guard_away(&l->eyes.guard);
		bb_shutters_feed(l, now_ns);
		bb_guard_back(&l->eyes.guard, &l->phase, now_ns);
		bb_phase_init(&l->phase, l->room->chain.rate, (unsigned)l->room->chain.n_stages);
	}
	bb_light_skip(l->light, now_ns);
}

/* Outside of frames too: the run ends, or somebody wants it to. */
void bb_eyes_open(struct bb_frame_loop *l, int64_t now_ns)
{
	if (!l->rig->shutter)
		return;
	l->eyes.out = bb_safe_step(&l->eyes.safe, BB_SHOW_OPEN, now_ns);
	drive(l, now_ns);
}

static void note_output(struct bb_frame_loop *l, int64_t now_ns)
{
	bb_eventlog_add(l->events, bb_eventlog_source(l->events, "eyes", l->room->chain.id), BB_EV_OUTPUT, now_ns,
	                l->eyes.out.open, llround(1e6 * l->eyes.shown));
}

/* A frame begins at the vblank that brings the last one's pictures up. */
static void pass_on_light(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_eyes *y = &l->eyes;
	const double was = y->shown;

	y->shown = y->sent;
	y->sent = y->out.light;
	if (l->rig->shutter && (was > y->shown || was < y->shown))
		note_output(l, now_ns);
}

static void show(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_eyes *y = &l->eyes;
	const enum bb_guard_state was = y->guard.state;
	const enum bb_show want = bb_guard_step(&y->guard, &l->phase, y->gone, y->running, now_ns);

	const bool was_open = y->out.open;
	y->out = bb_safe_step(&y->safe, want, now_ns);
	if (was_open != y->out.open)
		note_output(l, now_ns);
	drive(l, now_ns);
	tell(l, now_ns);
	note_loss(l, was, now_ns);
}

/* Between frames: an edge that does not come is seen 1.5 periods after the last one, not a frame later. */
int64_t bb_eyes_watch(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, eyes.watch);
	const bool away = l->world && sim_world_node_suspended(l->world, (uint16_t)bb_loop_head(l));

	if (!l->eyes.running || away || now_ns - scheduled_ns > 3 * l->frame_ns)
		return BB_NEVER; /* the next frame that runs arms it again; it also knows what to make of a gap */
	bb_shutters_feed(l, now_ns);
	show(l, now_ns);
	const int64_t due_ns = bb_guard_due_ns(&l->eyes.guard, &l->phase, now_ns);
	return l->eyes.running && due_ns > now_ns ? due_ns : BB_NEVER;
}

void bb_eyes_step(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	struct bb_eyes *y = &l->eyes;

	if (l->rig->shutter) {
		show(l, now_ns);
		swap_back(l, f);
		const int64_t due_ns = bb_guard_due_ns(&y->guard, &l->phase, now_ns);
		if (y->running && due_ns > now_ns && bb_clock_arm(l->clk, &y->watch, due_ns) != BB_OK)
			bb_clock_stop(l->clk);
	}
	f->mono = l->n_eyes > 1 && y->out.depth < 1;
	meter(l, now_ns);
	pass_on_light(l, now_ns);
}
