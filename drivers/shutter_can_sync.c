/*
 * drivers/shutter_can_sync.c: SYNC frames to the generator's edges, measured phases to the stages' edges. A SYNC may
 * wait behind a frame, so its stamp alone is up to 135 us late at 1 Mbit/s; the emitter's follow-up says by how much.
 */
#include "drivers/shutter_can_impl.h"

#include <math.h>

#define SYNC_BITS 55              /* of a SYNC with its counter, when nobody says how long it took */
#define RELOCK 3
#define GAIN (1.0 / 16)
#define HOLD_NS INT64_C(8000000000)
#define LATE_SLOTS 8
#define REPEATS_MOST 3

static struct sc_sync *newest(struct shutter_can *s)
{
	return &s->sync[s->sync_at];
}

static int64_t window_ns(const struct shutter_can *s)
{
	return (int64_t)(s->period_ns / 4);
}

static int64_t frame_ns(const struct shutter_can *s)
{
	return SYNC_BITS * BB_NS_PER_S / (s->bus->bitrate > 0 ? s->bus->bitrate : 1000000);
}

static struct sc_sync *of_seq(struct shutter_can *s, uint32_t seq)
{
	for (uint32_t i = 0; i < SC_SYNCS; i++)
		if (s->sync[i].valid && s->sync[i].seq == seq)
			return &s->sync[i];
	return NULL;
}

/* Counter 1..overflow against the number of an edge: how many edges later, -overflow/2 .. overflow/2. */
static int64_t ahead(const struct shutter_can *s, uint8_t counter, uint32_t seq)
{
	const int64_t n = s->opt.overflow;
	const int64_t d = (counter - 1 - (int64_t)(seq % (uint32_t)n) + n) % n;

	return d > n / 2 ? d - n : d;
}

/* Edges */

static void queue_edge(struct shutter_can *s, const struct bb_shutter_edge *e)
{
	if (s->n_edges == SC_EDGES) {
		s->head = (s->head + 1) % SC_EDGES;
		s->n_edges--;
		s->dropped++;
	}
	uint32_t i = s->n_edges++;
	for (; i > 0; i--) { /* phases of one edge come in order of ids, not of time */
		const struct bb_shutter_edge *before = &s->edge[(s->head + i - 1) % SC_EDGES];
		if (before->at_ns <= e->at_ns)
			break;
		s->edge[(s->head + i) % SC_EDGES] = *before;
	}
	s->edge[(s->head + i) % SC_EDGES] = *e;
	bb_device_event(&s->base.dev, BB_EV_EDGE, e->at_ns, e->eye, e->stage);
}

static void resolve(struct shutter_can *s, const struct sc_sync *y, const struct sc_pending *p)
{
	const struct bb_shutter_edge e = { y->edge_ns + p->phase_ns, p->seq, p->eye, p->stage };

	queue_edge(s, &e);
}

static void settle(struct shutter_can *s, struct sc_sync *y, int64_t edge_ns)
{
	size_t kept = 0;

	y->edge_ns = edge_ns;
	y->exact = true;
	for (size_t i = 0; i < s->n_pending; i++) {
		if (s->pending[i].seq == y->seq)
			resolve(s, y, &s->pending[i]);
		else if ((int32_t)(y->seq - s->pending[i].seq) < SC_SYNCS)
			s->pending[kept++] = s->pending[i];
	}
	s->n_pending = kept;
}

/* SYNC */

static struct sc_sync *add_sync(struct shutter_can *s, uint32_t seq, int64_t stamp_ns)
{
	struct sc_sync *last = newest(s);

	if (last->valid && !last->exact) /* its follow-up got lost */
		settle(s, last, last->stamp_ns - frame_ns(s));
	s->sync_at = (s->sync_at + 1) % SC_SYNCS;
	*newest(s) = (struct sc_sync){ seq, stamp_ns, stamp_ns - frame_ns(s), true, false };
	return newest(s);
}

static void lock_to(struct shutter_can *s, uint32_t seq, int64_t stamp_ns)
{
	(void)add_sync(s, seq, stamp_ns);
	s->locked = true;
	s->good = 1;
	s->bad = 0;
	s->heard_ns = stamp_ns;
}

static void refuse_sync(struct shutter_can *s, uint8_t counter, int64_t stamp_ns, double late_ns)
{
	const int64_t between_ns = stamp_ns - s->bad_ns;
	const int64_t edges = ahead(s, counter, s->bad_counter);
	const bool follows = s->bad && edges > 0 && edges < 16 &&
	                     fabs((double)between_ns - (double)edges * s->period_ns) < s->period_ns / 4;

	sc_raise(s, BB_CANF_SYNC_LATE, counter, stamp_ns, "SYNC %u is %+.3f ms outside its place", counter,
	         late_ns * 1e-6);
	s->good = 0;
	s->bad = follows ? s->bad + 1 : 1;
	s->bad_ns = stamp_ns;
	s->bad_counter = (uint32_t)(counter - 1);
	if (s->bad < RELOCK)
		return;
	/* Three in a row that agree with each other: the generator has moved, so follow it. */
	const struct sc_sync *y = newest(s);
	lock_to(s, y->seq + (uint32_t)ahead(s, counter, y->seq), stamp_ns);
}

static void accept_sync(struct shutter_can *s, uint32_t seq, int64_t stamp_ns)
{
	const struct sc_sync *y = newest(s);
	const int64_t edges = seq - y->seq;

	if (edges == 1 && s->good)
		s->period_ns += ((double)(stamp_ns - y->stamp_ns) - s->period_ns) * GAIN;
	(void)add_sync(s, seq, stamp_ns);
	s->good++;
	s->bad = 0;
	s->syncs++;
	s->heard_ns = stamp_ns;
}

void sc_sync_frame(struct shutter_can *s, const struct bb_can_frame *f)
{
	uint8_t counter;

	if (bb_co_read_sync(f, &counter) != BB_OK || !counter || counter > s->opt.overflow) {
		sc_raise(s, BB_CANF_PROTO, f->id, f->at_ns, "SYNC of %u bytes, counter %u", f->n_bytes, f->bytes[0]);
		return;
	}
	if (!s->locked) {
		lock_to(s, (uint32_t)(counter - 1), f->at_ns);
		return;
	}
	const struct sc_sync *y = newest(s);
	const double passed_ns = (double)(f->at_ns - y->stamp_ns);
	const int64_t edges = llround(passed_ns / s->period_ns);
	const double late_ns = passed_ns - (double)edges * s->period_ns;
	const uint32_t seq = y->seq + (uint32_t)edges;
	if (edges < 1 || ahead(s, counter, seq) || fabs(late_ns) > (double)window_ns(s))
		refuse_sync(s, counter, f->at_ns, passed_ns - (double)ahead(s, counter, y->seq) * s->period_ns);
	else
		accept_sync(s, seq, f->at_ns);
}

void sc_follow_frame(struct shutter_can *s, const struct bb_can_frame *f)
{
	struct bb_co_follow p;

	if (bb_co_read_follow(f, &p) != BB_OK || (double)p.latency_ns > s->period_ns) {
		sc_raise(s, BB_CANF_PROTO, f->id, f->at_ns, "bad follow-up of %u bytes", f->n_bytes);
		return;
	}
	if (!s->locked)
		return;
	struct sc_sync *y = of_seq(s, newest(s)->seq + (uint32_t)ahead(s, p.counter, newest(s)->seq));
	if (y && !y->exact)
		settle(s, y, y->stamp_ns - p.latency_ns);
}

/* Goes on without SYNC, on the host's clock at the rate last heard, so that phases still have an edge to stand on. */
void sc_sync_poll(struct shutter_can *s, int64_t now_ns)
{
	if (!s->locked)
		return;
	if (now_ns - s->heard_ns > HOLD_NS) {
		s->locked = false;
		s->n_pending = 0;
		return;
	}
	for (int i = 0; i < SC_SYNCS; i++) {
		const struct sc_sync *y = newest(s);
		const int64_t due_ns = y->stamp_ns + (int64_t)s->period_ns;
		if (now_ns <= due_ns + window_ns(s))
			return;
		const int64_t edge_ns = y->edge_ns + (int64_t)s->period_ns;
		const uint32_t seq = y->seq + 1;
		if (s->down_ns == BB_NEVER && !s->off)
			sc_raise(s, BB_CANF_SYNC_LATE, seq, now_ns, "SYNC missing for %.1f ms",
			         (double)(now_ns - y->stamp_ns) * 1e-6);
		s->good = 0;
		s->freewheeled++;
		settle(s, add_sync(s, seq, due_ns), edge_ns);
	}
}

/* Phases */

/* Is this one that was not heard before, from the one node of that id? */
static bool fresh(struct shutter_can *s, struct sc_node *n, const struct bb_co_phase *p, int64_t at_ns)
{
	/* After a long silence the counter has gone round, nobody knows how often. */
	const bool counted = n->counted && (double)(at_ns - n->phase_ns) < s->period_ns * (double)s->opt.overflow / 4;
	const uint8_t steps = (uint8_t)(p->sequence - n->sequence);
	const int64_t edges = counted ? ahead(s, p->counter, (uint32_t)(n->counter - 1)) : 1;

	n->counted = true;
	n->phase_ns = at_ns;
	n->sequence = p->sequence;
	if (edges > 0) {
		n->counter = p->counter;
		n->repeats = 0;
		return true;
	}
	/* With each SYNC: a stage that switches about when SYNC comes has sometimes nothing new to tell. */
	if (steps == 1 && !edges && s->opt.pdo_type <= 240 && ++n->repeats < REPEATS_MOST)
		return false;
	if (steps == 1 || edges < 0)
		sc_raise(s, BB_CANF_STALE, n->id, at_ns, "node %u repeats the phase of SYNC %u", n->id, p->counter);
	else
		sc_raise(s, BB_CANF_DUP_ID, n->id, at_ns, "two controllers answer as node %u", n->id);
	return false;
}

void sc_phase_frame(struct shutter_can *s, struct sc_node *n, const struct bb_can_frame *f)
{
	struct bb_co_phase p;

	if (bb_co_read_phase(f, &p) != BB_OK || p.counter > s->opt.overflow || (double)p.phase_ns > 2 * s->period_ns) {
		sc_raise(s, BB_CANF_PROTO, n->id, f->at_ns, "bad phase of %u bytes from node %u", f->n_bytes, n->id);
		return;
	}
	if (!n->ready || n->position < 0 || !s->stereo || !fresh(s, n, &p, f->at_ns) || !s->locked ||
	    !(p.flags & SHUT_FLAG_EYE))
		return;
	const int64_t later = ahead(s, p.counter, newest(s)->seq);
	if (later < -LATE_SLOTS || later > 1)
		return;
	const struct sc_pending e = { newest(s)->seq + (uint32_t)later, p.phase_ns, p.flags & SHUT_FLAG_EYE,
		                      n->position ? (uint8_t)(n->position - 1) : BB_STAGE_EMITTER };
	const struct sc_sync *y = of_seq(s, e.seq);
	n->phases++;
	s->phases++;
	if (y && y->exact)
		resolve(s, y, &e);
	else if (s->n_pending < SC_PENDING)
		s->pending[s->n_pending++] = e;
}
