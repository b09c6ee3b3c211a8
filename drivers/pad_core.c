/* drivers/pad_core.c: the path of a read: empty the bus, queue what was good, hand it over; see drivers/pad_core.h. */
#include "drivers/pad_core.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "drivers/pad_guard.h"

#define OVERRUN 60 /* packets at once: the kernel keeps 64 of a hidraw node and drops the newest, so these are old */

void bb_pad_core_init(struct bb_pad_core *core, struct bb_gamepad *g, const struct bb_pad_source *source,
		      const int32_t steps[BB_PAD_AXES], uint64_t seed, int64_t gap_ns)
{
	core->g = g;
	core->source = source;
	memcpy(core->steps, steps, sizeof(core->steps));
	core->gap_ns = gap_ns;
	core->battery = NAN;
	core->armed = true;
	core->last_ns = BB_NEVER;
	core->second_ns = bb_clock_now_ns(g->dev.clk);
	core->jitter = seed;
	for (const char *c = g->config.id; *c; c++) /* two pads unplugged together come back one after the other */
		core->jitter = core->jitter * UINT64_C(6364136223846793005) + (unsigned char)*c;
	g->limits.most_report_gap_ns = gap_ns;
	g->limits.axis_step = 1.0 / steps[0];
	bb_pad_guard_forget(core);
}

enum bb_status bb_pad_core_start(struct bb_pad_core *core)
{
	const enum bb_status status = core->source->open(core);

	core->is_open = status == BB_OK;
	core->health = BB_HEALTH_OK;
	return status;
}

void bb_pad_core_stop(struct bb_pad_core *core)
{
	if (core->is_open)
		core->source->close(core);
	core->is_open = false;
}

static void push(struct bb_pad_core *core, int64_t at_ns)
{
	struct bb_pad_report *r = &core->queue[(core->head + core->n) % BB_PAD_QUEUE];
	const struct bb_pad_report *before = &core->queue[(core->head + core->n + BB_PAD_QUEUE - 1) % BB_PAD_QUEUE];

	/* Reports read in one go can bear one stamp; theirs must ascend. */
	if (core->seq && at_ns <= before->at_ns)
		at_ns = before->at_ns + 1;
	if (core->n == BB_PAD_QUEUE) /* the oldest is lost, the sequence shows it */
		core->head = (core->head + 1) % BB_PAD_QUEUE;
	else
		core->n++;
	*r = (struct bb_pad_report){
		.at_ns = at_ns, .seq = core->seq++, .buttons = core->sample.buttons, .battery = core->battery
	};
	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		const float v = (float)core->sample.count[i] / (float)core->steps[i];
		r->axis[i] = fmaxf(-1, fminf(1, v));
	}
	bb_device_event(&core->g->dev, BB_EV_REPORT, at_ns, r->seq, r->buttons);
}

void bb_pad_core_good(struct bb_pad_core *core, const struct bb_pad_sample *sample, int64_t at_ns)
{
	core->sample = *sample;
	bb_pad_guard_good(core, at_ns);
	push(core, at_ns);
}

void bb_pad_core_battery(struct bb_pad_core *core, float level)
{
	core->battery = level;
}

void bb_pad_core_alive(struct bb_pad_core *core, int64_t at_ns)
{
	if (core->last_ns != BB_NEVER)
		core->last_ns = at_ns;
}

void bb_pad_core_bad(struct bb_pad_core *core, const char *fmt, ...)
{
	char what[64];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(what, sizeof(what), fmt, ap);
	va_end(ap);
	bb_pad_guard_bad(core, what);
}

/* Everything that waits, at most PULL_MAX packets. */
static enum bb_status pull_all(struct bb_pad_core *core)
{
	enum bb_status status = BB_OK;
	size_t pulled = 0;

	while (pulled < BB_PAD_PULL_MAX && !core->quarantined && (status = core->source->pull(core)) == BB_OK)
		pulled++;
	if (pulled >= OVERRUN && core->n) {
		/* Nobody read for a while: motion of long ago must not be played now. */
		core->overruns++;
		core->moved = false; /* unknown; the next report says */
		core->n = 0;
		(void)bb_device_fail(&core->g->dev, BB_OK, "read", "PAD_OVERRUN %zu old reports dropped", pulled);
	}
	return status;
}

static enum bb_status deliver(struct bb_pad_core *core, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	if (!core->n)
		return BB_TIMEOUT;
	for (; *n_out < cap && core->n; core->n--) {
		reports[(*n_out)++] = core->queue[core->head];
		core->head = (core->head + 1) % BB_PAD_QUEUE;
	}
	return BB_OK;
}

enum bb_status bb_pad_core_gone(struct bb_pad_core *core, const char *op)
{
	bb_pad_core_stop(core);
	core->n = 0; /* what was under way goes with the node */
	bb_pad_guard_lost(core, op, "PAD_GONE unplugged or its node is gone");
	return BB_ERR_LOST;
}

static enum bb_status reopen(struct bb_pad_core *core)
{
	if (!bb_pad_guard_may_reopen(core))
		return core->quarantined ? BB_ERR_FORMAT : BB_ERR_LOST;
	const enum bb_status status = core->source->open(core);
	if (status == BB_TIMEOUT)
		return BB_ERR_LOST;
	core->is_open = status == BB_OK;
	bb_pad_guard_reopened(core, status);
	return status == BB_OK ? BB_OK : core->quarantined ? BB_ERR_FORMAT : BB_ERR_LOST;
}

enum bb_status bb_pad_core_read(struct bb_pad_core *core, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	enum bb_status status = BB_OK;

	if (core->quarantined)
		return BB_ERR_FORMAT;
	if (!core->is_open)
		status = reopen(core);
	if (status != BB_OK)
		return status;
	status = pull_all(core);
	if (status == BB_ERR_LOST)
		return bb_pad_core_gone(core, "read");
	if (core->quarantined) {
		core->n = 0;
		return BB_ERR_FORMAT;
	}
	if (status == BB_SKIPPED) {
		core->n = 0;
		if (!core->off)
			bb_pad_guard_lost(core, "read",
					  "PAD_GONE its receiver is there, the pad is off or out of reach");
		core->off = true;
		return BB_ERR_LOST;
	}
	core->off = false;
	bb_pad_guard_idle(core);
	return deliver(core, reports, cap, n_out);
}

enum bb_status bb_pad_core_ready(struct bb_pad_core *core, const char *op)
{
	if (core->quarantined)
		return BB_ERR_FORMAT;
	if (!core->is_open || core->off)
		return bb_device_fail(&core->g->dev, BB_ERR_LOST, op, "PAD_GONE nothing to write to");
	return BB_OK;
}
