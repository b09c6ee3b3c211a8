/* drivers/pad_guard.c: fault states of a gamepad, rows H1 to H5; see drivers/pad_guard.h. */
#include "drivers/pad_guard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define MS INT64_C(1000000)
#define SETTLE_NS (500 * MS) /* a fault state is left after that long without a fault ... */
#define SETTLE_GOOD 3        /* ... or that many good samples */
#define BAD_LEAST 3          /* so that one bad report in a quiet second is no quarantine */
#define BAD_MOST 100         /* a flood of them is not counted for a whole second */
#define REOPEN_FIRST_NS (100 * MS)
#define REOPEN_MOST_NS (5000 * MS)
#define MINUTE_NS (60000 * MS)
#define NOISE_TURNS_PER_S 20 /* no hand turns round that often for seconds */

static int64_t now_of(const struct bb_pad_core *core)
{
	return bb_clock_now_ns(core->g->dev.clk);
}

void bb_pad_guard_forget(struct bb_pad_core *core)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		core->axis[i] = (struct bb_pad_axis){ .since_ns = BB_NEVER, .noise_since_ns = BB_NEVER };
	core->drifting = 0;
}

void bb_pad_guard_state(struct bb_pad_core *core, enum bb_health health)
{
	if (health == core->health)
		return;
	bb_device_event(&core->g->dev, BB_EV_HEALTH, now_of(core), health, core->health);
	core->health = health;
	core->fault_ns = now_of(core);
	core->good_in_row = 0;
}

static void quarantine(struct bb_pad_core *core, const char *why)
{
	core->quarantined = true;
	bb_pad_guard_state(core, BB_HEALTH_QUARANTINED);
	(void)bb_device_fail(&core->g->dev, BB_ERR_FORMAT, "read", "PAD_QUARANTINE %s; close and open it again", why);
}

/* H1, H2: what happens after the pad was plugged in again begins at neutral. ----------------------------------- */

static int32_t dead_counts(const struct bb_pad_core *core, size_t i)
{
	return (int32_t)(BB_PAD_DEAD_ZONE * core->steps[i]);
}

/* An axis that moves less stands still: 2 counts, or a 64th of the way where counts are finer than the hand. */
static int32_t still_counts(const struct bb_pad_core *core, size_t i)
{
	return core->steps[i] / 64 > 2 ? core->steps[i] / 64 : 2;
}

static bool is_neutral(const struct bb_pad_core *core)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (abs(core->sample.count[i]) > dead_counts(core, i))
			return false;
	return true;
}

static void hold_until_neutral(struct bb_pad_core *core)
{
	if (!core->armed && is_neutral(core) && !core->sample.buttons)
		core->armed = true;
	if (core->armed)
		return;
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		core->sample.count[i] = 0;
	core->sample.buttons = 0;
}

/* H5: stuck, drifting, noisy. ---------------------------------------------------------------------------------- */

static void restart(struct bb_pad_axis *a, int32_t count, int64_t at_ns)
{
	a->least = a->most = count;
	a->since_ns = at_ns;
}

static void watch_noise(struct bb_pad_axis *a, int32_t count, int32_t least, int64_t at_ns)
{
	const int32_t by = count - a->last;
	const int direction = by > least ? 1 : by < -least ? -1 : 0;

	if (direction && direction == -a->direction)
		a->turns++;
	if (direction)
		a->direction = direction;
	if (a->noise_since_ns == BB_NEVER || at_ns - a->noise_since_ns > BB_PAD_DRIFT_NS) {
		a->noisy =
			a->noise_since_ns != BB_NEVER && a->turns > NOISE_TURNS_PER_S * (BB_PAD_DRIFT_NS / BB_NS_PER_S);
		a->turns = 0;
		a->noise_since_ns = at_ns;
	}
}

/* Is this axis wrong now? Updates the centre, which stays within the dead zone. */
static bool axis_is_wrong(struct bb_pad_core *core, size_t i, int32_t count, int64_t at_ns)
{
	struct bb_pad_axis *a = &core->axis[i];
	const int32_t little = still_counts(core, i);

	watch_noise(a, count, little, at_ns);
	a->last = count;
	a->least = count < a->least ? count : a->least;
	a->most = count > a->most ? count : a->most;
	const bool still = a->most - a->least <= little;
	if (a->since_ns == BB_NEVER || !still) {
		restart(a, count, at_ns);
		/* It moves: whatever stuck is free. A drift that was taken off stays off until the axis rests at zero.
		 */
		return a->noisy || a->centre;
	}
	if (abs(count) <= little) {
		a->centre = 0;
		return a->noisy;
	}
	if (at_ns - a->since_ns < BB_PAD_DRIFT_NS)
		return a->noisy || a->centre || (core->drifting >> i & 1);
	if (abs(count) <= dead_counts(core, i))
		a->centre = count;
	return true;
}

static void watch_axes(struct bb_pad_core *core, int64_t at_ns)
{
	const uint32_t before = core->drifting;

	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		const bool wrong = core->steps[i] > 1 && axis_is_wrong(core, i, core->sample.count[i], at_ns);
		core->drifting = (core->drifting & ~(1u << i)) | (uint32_t)wrong << i;
		if (wrong && !(before >> i & 1)) {
			(void)bb_device_fail(&core->g->dev, BB_OK, "read", "PAD_DRIFT axis %zu %s at %d of %d%s", i + 1,
					     core->axis[i].noisy ? "is noisy" : "stands still", core->sample.count[i],
					     core->steps[i], core->axis[i].centre ? ", recentred" : "");
			bb_pad_guard_state(core, BB_HEALTH_DEGRADED);
		}
		core->sample.count[i] -= core->axis[i].centre;
	}
}

/* Good and bad reports. ---------------------------------------------------------------------------------------- */

/* Judged once a second: three bad ones in a row of a good pad are no quarantine, a tenth of all is. */
static void count_second(struct bb_pad_core *core)
{
	if (core->n_bad < BAD_MOST && now_of(core) - core->second_ns < BB_NS_PER_S)
		return;
	const bool too_bad = core->n_bad >= BAD_LEAST && core->n_bad * 10 > core->n_good + core->n_bad;
	core->second_ns = now_of(core);
	core->n_good = core->n_bad = 0;
	if (too_bad)
		quarantine(core, "more than a tenth of a second's reports were bad");
}

static void settle(struct bb_pad_core *core)
{
	core->good_in_row++;
	if (core->health == BB_HEALTH_OK || core->drifting || !core->armed)
		return;
	if (core->good_in_row >= SETTLE_GOOD || now_of(core) - core->fault_ns >= SETTLE_NS)
		bb_pad_guard_state(core, BB_HEALTH_OK);
}

void bb_pad_guard_good(struct bb_pad_core *core, int64_t at_ns)
{
	core->n_good++;
	count_second(core);
	core->last_ns = at_ns;
	watch_axes(core, at_ns);
	hold_until_neutral(core);
	core->moved = !is_neutral(core);
	if (core->health == BB_HEALTH_LOST)
		bb_pad_guard_state(core, BB_HEALTH_RECOVERING);
	settle(core);
}

void bb_pad_guard_bad(struct bb_pad_core *core, const char *what)
{
	core->n_bad++;
	core->bad_total++;
	(void)bb_device_fail(&core->g->dev, BB_ERR_FORMAT, "read", "PAD_BAD %llu: %s",
			     (unsigned long long)core->bad_total, what);
	core->good_in_row = 0;
	if (core->health == BB_HEALTH_OK)
		bb_pad_guard_state(core, BB_HEALTH_DEGRADED);
	count_second(core);
}

/* A pad that fell silent at zero rests there: what was taken off is not true any more. */
static void forgive_rest(struct bb_pad_core *core)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (core->drifting >> i & 1 && abs(core->axis[i].last) <= still_counts(core, i) &&
		    !core->axis[i].noisy) {
			core->axis[i].centre = 0;
			core->axis[i].since_ns = BB_NEVER;
			core->drifting &= ~(1u << i);
		}
}

void bb_pad_guard_idle(struct bb_pad_core *core)
{
	const int64_t now_ns = now_of(core);

	/* An idle pad may say nothing for hours; one with a deflected stick may not. */
	if (core->moved && core->gap_ns != BB_NEVER && core->health != BB_HEALTH_LOST &&
	    now_ns - core->last_ns > core->gap_ns) {
		char level[24] = "battery unknown";
		if (!isnan(core->battery))
			snprintf(level, sizeof(level), "battery %.0f %%", (double)core->battery * 100);
		bb_pad_guard_state(core, BB_HEALTH_LOST);
		(void)bb_device_fail(&core->g->dev, BB_TIMEOUT, "read",
				     "PAD_SILENT for %lld ms with a stick deflected, %s",
				     (long long)((now_ns - core->last_ns) / MS), level);
	}
	if (core->drifting && now_ns - core->last_ns >= SETTLE_NS)
		forgive_rest(core);
	if (core->health == BB_HEALTH_DEGRADED && !core->drifting && now_ns - core->fault_ns >= SETTLE_NS)
		bb_pad_guard_state(core, BB_HEALTH_OK);
}

/* Unplug and reopen. ------------------------------------------------------------------------------------------- */

/* 100 ms, doubled each time up to 5 s, each +-20 % so that a rack of receivers does not come back as one. */
static int64_t pause_ns(struct bb_pad_core *core)
{
	const uint32_t k = core->attempts < 6 ? core->attempts : 6;
	int64_t ns = REOPEN_FIRST_NS << k;

	if (ns > REOPEN_MOST_NS)
		ns = REOPEN_MOST_NS;
	core->jitter = core->jitter * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return ns - ns / 5 + (int64_t)(core->jitter >> 40) % (2 * ns / 5);
}

void bb_pad_guard_lost(struct bb_pad_core *core, const char *op, const char *what)
{
	core->armed = false;
	core->moved = false;
	core->attempts = 0;
	core->reopen_ns = now_of(core) + pause_ns(core);
	bb_pad_guard_forget(core);
	bb_pad_guard_state(core, BB_HEALTH_LOST);
	(void)bb_device_fail(&core->g->dev, BB_ERR_LOST, op, "%s", what);
}

bool bb_pad_guard_may_reopen(struct bb_pad_core *core)
{
	return !core->quarantined && now_of(core) >= core->reopen_ns;
}

void bb_pad_guard_reopened(struct bb_pad_core *core, enum bb_status status)
{
	const size_t slots = BB_ARRAY_LEN(core->reopened_ns);

	core->attempts++;
	core->reopen_ns = now_of(core) + pause_ns(core);
	if (status == BB_ERR_FORMAT) {
		quarantine(core, "DESC_REJECT what came back has a descriptor that cannot be");
		return;
	}
	if (status != BB_OK)
		return;
	const int64_t fifth_ns = core->reopened_ns[core->n_reopened % slots];
	if (core->n_reopened >= slots && now_of(core) - fifth_ns < MINUTE_NS) {
		core->source->close(core);
		core->is_open = false;
		quarantine(core, "it came back more than 5 times in a minute");
		return;
	}
	core->reopened_ns[core->n_reopened++ % slots] = now_of(core);
	core->second_ns = now_of(core);
	core->n_good = core->n_bad = 0;
	bb_pad_guard_state(core, BB_HEALTH_RECOVERING);
}
