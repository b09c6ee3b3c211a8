/* tests/hw_gamepad.h: the gamepads of a room before the gamepad contract; a part of tests/hw_room.c. Nobody need touch them. */
#ifndef BB_TESTS_HW_GAMEPAD_H
#define BB_TESTS_HW_GAMEPAD_H

#include "tests/gamepad_contract.h"

static void gamepad_reports_fit(struct gamepad_bench *t)
{
	struct row *row = t->impl;
	struct bb_pad_report last = { .battery = NAN };
	const long n = gamepad_play(t, 3 * BB_NS_PER_S, &last);

	snprintf(row->found, sizeof(row->found), "%ld reports in 3 s%s", n, n ? "" : ": nobody touches it");
}

static const struct {
	const char *what;
	void (*check)(struct gamepad_bench *t);
} gamepad_checks[] = {
	{ "reports fit the limits", gamepad_reports_fit },
	{ "bad calls are refused", gamepad_bad_calls_are_refused },
	{ "it rumbles if it says so", gamepad_rumbles_if_it_says_so },
};

static void run_gamepad(struct row *row)
{
	struct gamepad_bench t = { .clk = row->hw->clk, .look_ns = BB_NS_PER_S / 1000, .impl = row };
	struct bb_uri uri;
	struct bb_error err = { 0 };
	enum bb_status status = bb_uri_parse(row->device, &uri, NULL, &err);
	const struct bb_backend *b = status == BB_OK ? bb_backend_find(&uri, row->id, &err) : NULL;
	const struct bb_open open = { .clk = row->hw->clk, .uri = &uri, .seed = 1 };

	if (!b || !b->gamepad)
		snprintf(row->reason, sizeof(row->reason), "%.150s", b ? "its back end has no gamepads" : err.text);
	else if ((status = bb_gamepad_open(b->gamepad, row->config, &open, &t.g)) != BB_OK)
		snprintf(row->reason, sizeof(row->reason), "cannot be opened: %s", bb_status_text(status));
	if (!t.g)
		fail_msg("%s", row->reason);
	gamepad_checks[row->step].check(&t);
	bb_gamepad_close(t.g);
}

/* How many real ones there are. */
static size_t add_gamepads(struct hw *hw)
{
	size_t n = 0;

	for (size_t i = 0; i < hw->room->n_gamepads; i++) {
		const struct bb_gamepad_config *config = &hw->room->gamepads[i];
		if (simulated(config->device))
			continue;
		n++;
		for (size_t step = 0; step < BB_ARRAY_LEN(gamepad_checks); step++) {
			struct row *row = add_row(hw, "gamepad", config->id, config->device, gamepad_checks[step].what);
			if (!row)
				return n;
			row->run = run_gamepad;
			row->config = config;
			row->step = step;
		}
	}
	return n;
}

#endif
