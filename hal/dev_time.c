#include "hal/dev_time.h"

int64_t bb_unwrap32(struct bb_unwrap32 *u, uint32_t ticks)
{
	if (!u->started) {
		u->started = true;
		u->total = ticks;
	} else {
		u->total += (int32_t)(ticks - u->last); /* modular: a wrap is an ordinary step */
	}
	u->last = ticks;
	return u->total;
}

void bb_timemap_init(struct bb_timemap *m, int64_t least_latency_ns)
{
	*m = (struct bb_timemap){ .least_latency_ns = least_latency_ns, .uncertainty_ns = INT64_MAX };
}

void bb_timemap_add(struct bb_timemap *m, struct bb_dev_ns stamp, int64_t arrived_ns)
{
	const uint32_t slot = m->n % BB_TIMEMAP_WINDOW;
	const uint32_t held = m->n < BB_TIMEMAP_WINDOW ? m->n + 1 : BB_TIMEMAP_WINDOW;
	const int64_t newest = bb_ns_since(arrived_ns, stamp.ns);
	int64_t least = 0, most = 0; /* since the newest: deltas may lie on both sides of the end of int64 */

	m->delta_ns[slot] = newest;
	m->n++;
	for (uint32_t i = 0; i < held; i++) {
		const int64_t since = bb_ns_since(m->delta_ns[i], newest);
		least = since < least ? since : least;
		most = since > most ? since : most;
	}
	m->offset_ns = bb_ns_since(bb_ns_after(newest, least), m->least_latency_ns);
	/* The least of n delays that spread over `most - least` lies about (most - least) / n above the true least. */
	m->uncertainty_ns = held > 1 ? (int64_t)(((uint64_t)most - (uint64_t)least) / held) + 1 : m->least_latency_ns + 1;
}

int64_t bb_timemap_host_ns(const struct bb_timemap *m, struct bb_dev_ns stamp)
{
	return bb_ns_after(stamp.ns, m->offset_ns);
}
