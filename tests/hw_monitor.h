/*
 * tests/hw_monitor.h: the monitors of a room before the monitor contract; a part of tests/hw_room.c. They are read; one that
 * --switch names has its luminance changed and put back. Nothing is ever saved.
 */
#ifndef BB_TESTS_HW_MONITOR_H
#define BB_TESTS_HW_MONITOR_H

#include "drivers/edid.h"
#include "tests/monitor_contract.h"

/* Who it is, and how many of its answers came at the first try. */
static void monitor_says_who_it_is(struct monitor_bench *t)
{
	struct row *row = t->impl;
	const struct bb_monitor_reply r = monitor_ask(t, BB_MONITOR_EDID, 0, 0);
	const struct bb_monitor_reply hours = monitor_get(t, BB_VCP_HOURS);
	struct edid_info e;
	char lit[24] = "";

	assert_int_equal(edid_parse(r.edid, r.edid_bytes, &e), BB_OK);
	if (hours.status == BB_OK)
		snprintf(lit, sizeof(lit), ", %u h", hours.current);
	snprintf(row->found, sizeof(row->found), "%s %04X \"%s\", serial %lu \"%s\"%s", e.maker, e.product, e.name,
	         (unsigned long)e.serial, e.serial_text, lit);
}

static const struct {
	const char *what;
	void (*check)(struct monitor_bench *t);
	bool writes;
} monitor_checks[] = {
	{ "it says who it is", monitor_says_who_it_is, false },
	{ "its EDID is whole", monitor_edid_is_whole, false },
	{ "one request at a time", monitor_one_request_at_a_time, false },
	{ "codes it does not have", monitor_unknown_codes_are_unsupported, false },
	{ "its capabilities are text", monitor_capabilities_are_text, false },
	{ "power off is refused", monitor_power_off_is_refused, false },
	{ "saving is refused", monitor_saving_is_refused, false },
	{ "waits before replies are kept", monitor_reply_waits_are_kept, false },
	{ "waits after writes are kept", monitor_write_waits_are_kept, true },
	{ "writes are read back", monitor_writes_are_read_back, true },
};

static void run_monitor(struct row *row)
{
	struct monitor_bench t = { .clk = row->hw->clk, .rounds = 5, .impl = row };
	struct bb_uri uri;
	struct bb_error err = { 0 };
	enum bb_status status = bb_uri_parse(row->device, &uri, NULL, &err);
	const struct bb_backend *b = status == BB_OK ? bb_backend_find(&uri, row->id, &err) : NULL;
	const struct bb_open open = { .clk = row->hw->clk, .uri = &uri, .seed = 1 };

	if (!b || !b->monitor)
		snprintf(row->reason, sizeof(row->reason), "%.150s", b ? "its back end has no monitors" : err.text);
	else if ((status = bb_monitor_open(b->monitor, row->config, &open, &t.m)) != BB_OK)
		snprintf(row->reason, sizeof(row->reason), "cannot be opened: %s", bb_status_text(status));
	if (!t.m)
		fail_msg("%s", row->reason);
	monitor_pass(&t, 150 * MONITOR_MS); /* the check before left it in the middle of a wait, perhaps */
	monitor_checks[row->step].check(&t);
	bb_monitor_close(t.m);
}

static bool may_write(const struct hw *hw, const char *id)
{
	for (size_t i = 0; i < hw->n_switches; i++)
		if (!strcmp(hw->switches[i], id))
			return true;
	return false;
}

/* How many real ones there are. */
static size_t add_monitors(struct hw *hw)
{
	size_t n = 0;

	for (size_t i = 0; i < hw->room->n_monitors; i++) {
		const struct bb_monitor_config *config = &hw->room->monitors[i];
		if (simulated(config->device))
			continue;
		n++;
		for (size_t step = 0; step < BB_ARRAY_LEN(monitor_checks); step++) {
			struct row *row = add_row(hw, "monitor", config->id, config->device, monitor_checks[step].what);
			if (!row)
				return n;
			row->config = config;
			row->step = step;
			if (!monitor_checks[step].writes || may_write(hw, config->id))
				row->run = run_monitor;
			else
				snprintf(row->reason, sizeof(row->reason), "none of its settings may be changed: SWITCH=%s allows it",
				         config->id);
		}
	}
	return n;
}

#endif
