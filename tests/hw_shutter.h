/*
 * tests/hw_shutter.h: the shutter contract against the chain of a room; a part of tests/hw_room.c. Between two changes
 * of mode passes the time that people's eyes are owed (hal/safety.h).
 */
#ifndef BB_TESTS_HW_SHUTTER_H
#define BB_TESTS_HW_SHUTTER_H

#include "hal/safety.h"
#include "sim/can_link.h"
#include "tests/shutter_contract.h"

#define HW_SHUTTER_READY_NS (5 * BB_NS_PER_S)

/* Behind a virtual bus there are no eyes. */
static bool hw_shutter_harmless(const char *device)
{
	struct bb_uri uri;

	return bb_uri_parse(device, &uri, NULL, NULL) == BB_OK && !strcmp(uri.scheme, "can") &&
	       sim_can_link_is_virtual(uri.path);
}

static void hw_shutter_log(void *ctx, enum bb_log_level level, const char *line)
{
	struct row *row = ctx;

	(void)level;
	if (!row->reason[0])
		snprintf(row->reason, sizeof(row->reason), "%.150s", line);
}

static enum bb_status hw_shutter_open(struct row *row, struct shutter_bench *t)
{
	const struct bb_log log = { hw_shutter_log, row, BB_LOG_WARN };
	struct bb_uri uri;
	struct bb_error err = { 0 };
	enum bb_status status = bb_uri_parse(row->device, &uri, NULL, &err);
	const struct bb_backend *b = status == BB_OK ? bb_backend_find(&uri, row->id, &err) : NULL;
	const struct bb_open open = { .clk = t->clk, .uri = &uri, .seed = 1, .log = &log };

	if (!b || !b->shutter) {
		snprintf(row->reason, sizeof(row->reason), "%.150s", b ? "its back end has no shutters" : err.text);
		return BB_ERR_CONFIG;
	}
	status = bb_shutter_open(b->shutter, t->config, &open, &t->sh);
	if (status == BB_OK)
		bb_shutter_device(t->sh)->log = NULL; /* what it says later is the contract's to judge */
	return status;
}

/* A chain is found and configured after it is open: until every row tells edges, and then open eyes again. */
static bool hw_shutter_ready(struct row *row, struct shutter_bench *t)
{
	const int64_t end_ns = bb_clock_now_ns(t->clk) + HW_SHUTTER_READY_NS;
	size_t told = 0;

	shutter_stereo(t);
	while (told < shutter_rows(t) && bb_clock_now_ns(t->clk) < end_ns) {
		shutter_collect(t, 200 * SHUTTER_MS);
		for (size_t s = told = 0; s < shutter_rows(t); s++)
			told += !shutter_seen(t, s) || t->n[s] >= 10;
	}
	snprintf(row->found, sizeof(row->found), "%zu of %zu stages and the glasses tell edges, stamps within %.0f us",
	         told ? told - 1 : 0, shutter_rows(t) - 1, (double)bb_shutter_limits(t->sh)->stamp_error_ns * 1e-3);
	if (told < shutter_rows(t)) {
		snprintf(row->reason, sizeof(row->reason), "no edges: %.120s", bb_shutter_device(t->sh)->last_error.detail);
		return false;
	}
	shutter_open_eyes(t);
	shutter_collect(t, t->rest_ns);
	return true;
}

static const struct {
	const char *what;
	void (*check)(struct shutter_bench *);
} shutter_checks[] = {
	{ "limits hold the room's chain", shutter_limits_hold },
	{ "edges alternate at the rate", shutter_edges_alternate },
	{ "a phase moves one stage", shutter_phase_moves },
	{ "arguments are checked", shutter_arguments_are_checked },
	{ "open eyes see no edges", shutter_open_stops },
	{ "small pieces lose nothing", shutter_small_pieces_lose_nothing },
};

static void run_shutter(struct row *row)
{
	struct shutter_bench *t = calloc(1, sizeof(*t));
	const int64_t rest_ns = (int64_t)(bb_safety_ceilings().transition_gap_s * 1e9);

	assert_non_null(t);
	t->clk = row->hw->clk;
	t->config = &row->hw->room->chain;
	t->scale = 0.4;
	t->gap_ns = 20 * SHUTTER_MS;
	t->rest_ns = row->hw->standin ? 0 : rest_ns;
	if (hw_shutter_open(row, t) != BB_OK)
		fail_msg("cannot be opened: %s", row->reason);
	if (!hw_shutter_ready(row, t))
		fail_msg("%s", row->reason);
	shutter_checks[row->step].check(t);
	shutter_collect(t, t->rest_ns);
	bb_shutter_close(t->sh);
	free(t);
}

/* How many real ones there are. */
static size_t add_shutters(struct hw *hw)
{
	const struct bb_shutter_config *chain = &hw->room->chain;

	if (!hw->room->has_chain || simulated(chain->device))
		return 0;
	for (size_t step = 0; step < BB_ARRAY_LEN(shutter_checks); step++) {
		struct row *row = add_row(hw, "shutter", chain->id, chain->device, shutter_checks[step].what);
		if (!row)
			break;
		row->run = run_shutter;
		row->step = step;
	}
	return 1;
}

#endif
