/* drivers/camera_usb_time.c: see drivers/camera_usb_time.h. */
#include "drivers/camera_usb_time.h"

#define US_NS 1000
#define MS_NS INT64_C(1000000)
#define SLACK_PPM 150           /* the camera's crystal against the host's */
#define CONTRADICTION_MS 50     /* stamp against USB frame number */

/* How many frames passed by the clock: what tells 1 from 257 when a number has 8 bits. */
static int64_t by_clock(const struct camera_usb_time *t, const struct camera_usb_mark *m)
{
	const int64_t span_ns = m->arrived_ns - t->arrived_ns;

	return (span_ns + t->period_ns / 2) / t->period_ns;
}

static int64_t step_of(const struct camera_usb_time *t, const struct camera_usb_mark *m)
{
	const int64_t guess = by_clock(t, m);

	if (t->broken)
		return guess > 1 ? guess : 1;
	if (m->stamped)
		return (int32_t)(m->counter - t->counter);
	const int64_t low = (uint8_t)(m->counter - t->counter);
	const int64_t wraps = (guess - low + 128) >> 8;
	return low + (wraps > 0 ? wraps * 256 : 0);
}

/* The USB frame number wraps every 2.048 s; the arrival says how many times it did. */
static int64_t unwrap_usb(const struct camera_usb_time *t, const struct camera_usb_mark *m)
{
	const int64_t guess_ms = t->usb_ms + (m->arrived_ns - t->arrived_ns) / MS_NS;
	const int64_t low = (int64_t)(((uint32_t)m->usb_frame - (uint32_t)guess_ms) & 0x7FF);

	return guess_ms + (low < 1024 ? low : low - 2048);
}

static bool device_stamp(struct camera_usb_time *t, const struct camera_usb_mark *m, int64_t *stamp_ns)
{
	struct bb_unwrap32 ticks = t->ticks;
	int64_t offset_ns = t->tick_offset_ns, usb_ms = (int64_t)m->usb_frame;

	if (t->broken)
		ticks.started = false;
	*stamp_ns = bb_unwrap32(&ticks, m->mid_us) * US_NS + offset_ns;
	if (t->any) {
		const int64_t span_ns = m->arrived_ns - t->arrived_ns;
		usb_ms = unwrap_usb(t, m);
		if (t->broken) { /* keep the distance of stamps to arrivals, as far as one frame tells */
			offset_ns += t->stamp_ns + span_ns - *stamp_ns;
			*stamp_ns = t->stamp_ns + span_ns;
		} else {
			const int64_t off_ms = (*stamp_ns - t->stamp_ns) / MS_NS - (usb_ms - t->usb_ms);
			if (*stamp_ns <= t->stamp_ns || off_ms > CONTRADICTION_MS || off_ms < -CONTRADICTION_MS)
				return false;
		}
	}
	t->ticks = ticks;
	t->tick_offset_ns = offset_ns;
	t->usb_ms = usb_ms;
	return true;
}

/* Without a device clock: arrivals are only ever late, so the stamp follows the earliest the period allows. */
static int64_t arrival_stamp(const struct camera_usb_time *t, const struct camera_usb_mark *m, int64_t step)
{
	const int64_t heard_ns = m->arrived_ns - t->least_latency_ns;

	if (!t->any || t->broken)
		return heard_ns;
	const int64_t span_ns = step * t->period_ns;
	const int64_t due_ns = t->stamp_ns + span_ns + span_ns / 1000000 * SLACK_PPM;
	if (heard_ns - due_ns > t->jitter_ns) /* the rhythm began anew */
		return heard_ns;
	return heard_ns < due_ns ? heard_ns : due_ns;
}

bool camera_usb_time_add(struct camera_usb_time *t, const struct camera_usb_mark *m, uint32_t *lost)
{
	const int64_t step = t->any ? step_of(t, m) : 0;
	int64_t stamp_ns;

	*lost = 0;
	if (t->any && step <= 0)
		return false;
	if (!m->stamped)
		stamp_ns = arrival_stamp(t, m, step);
	else if (!device_stamp(t, m, &stamp_ns))
		return false;
	*lost = t->any ? (uint32_t)(step - 1) : 0;
	t->seq += (uint32_t)step;
	t->counter = m->counter;
	t->arrived_ns = m->arrived_ns;
	t->stamp_ns = stamp_ns;
	t->usb_frame = m->usb_frame;
	t->any = true;
	t->broken = false;
	return true;
}
