/* sim/bus_sim_line.c: see sim/bus_sim_line.h. No timer: events up to now are made when a reader or a verb comes. */
#include "sim/bus_sim_line.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>

#include "sim/world.h"

#define QUEUE_MOST 1024
#define QUEUE_V1 16
#define JITTER_MOST 4.0
#define BOUNCE_WIDTH_NS 40000

struct sim_line {
	struct bb_clock *clk;
	struct bb_line_opener opener;
	struct bb_line_bus *bus;  /* the open one, or NULL */
	struct sim_rng rng;
	bool numbered;
	/* the generator */
	struct bb_rate rate;
	int64_t rate_ppb, base_ns, base_n, n, last_ns, jitter_ns, peak_ns;
	bool level, inverted, stuck;
	uint64_t edges;
	/* what is to go wrong */
	unsigned miss, overflow, bounce;
	int64_t bounce_ns;
	int vanished;
	bool out;
	int64_t out_ns;
};

struct handle {
	struct bb_line_bus base;
	struct sim_line *peer;
	bool active_low, has_out;
	uint32_t cap, head, n;
	uint32_t seq, read_seq;
	struct bb_line_event queue[QUEUE_MOST];
};

static struct handle *own(struct bb_line_bus *bus)
{
	return bb_container_of(bus, struct handle, base);
}

/* ---- the kernel's queue ---- */

static void put(struct sim_line *p, int64_t at_ns, bool level)
{
	struct handle *h = p->bus ? own(p->bus) : NULL;

	if (!h)
		return;
	if (p->miss) {
		p->miss--;
		return;
	}
	h->seq++;
	if (p->overflow) {
		p->overflow--;
		return;
	}
	if (h->n == h->cap) {
		if (!p->numbered)
			return;
		h->head = (h->head + 1) % QUEUE_MOST;
		h->n--;
	}
	h->queue[(h->head + h->n++) % QUEUE_MOST] =
		(struct bb_line_event){ .at_ns = at_ns, .seq = h->seq, .level = level != h->active_low };
}

/* ---- the generator ---- */

static int64_t place_ns(const struct sim_line *p, int64_t n)
{
	const int64_t ideal_ns = bb_rate_frame_ns(p->rate, n - p->base_n);

	return p->base_ns + ideal_ns - (int64_t)((__int128)ideal_ns * p->rate_ppb / 1000000000);
}

static int64_t edge_ns(const struct sim_line *p, int64_t n)
{
	struct sim_rng r = sim_rng_at(&p->rng, (uint64_t)n);
	const double normal = fmin(fmax(sim_rng_normal(&r), -JITTER_MOST), JITTER_MOST);
	const double uniform = 2 * sim_rng_uniform(&r) - 1;

	return place_ns(p, n) + llround(normal * (double)p->jitter_ns + uniform * (double)p->peak_ns);
}

static void change(struct sim_line *p, int64_t at_ns, bool level)
{
	if (p->stuck || level == p->level)
		return;
	p->level = level;
	p->edges++;
	put(p, at_ns, level);
	if (!p->bounce)
		return;
	p->bounce--;
	put(p, at_ns + p->bounce_ns, !level);
	put(p, at_ns + p->bounce_ns + BOUNCE_WIDTH_NS, level);
}

/* Everything up to now has happened. */
static void advance(struct sim_line *p)
{
	const int64_t now_ns = bb_clock_now_ns(p->clk);

	for (int64_t at_ns; (at_ns = edge_ns(p, p->n)) <= now_ns; p->n++) {
		p->last_ns = at_ns > p->last_ns ? at_ns : p->last_ns; /* a verb may have come between */
		change(p, p->last_ns, (p->n % 2 == 0) != p->inverted);
	}
}

/* ---- the bus ---- */

static enum bb_status line_read(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap, size_t *n_out)
{
	struct handle *h = own(bus);
	const int64_t now_ns = bb_clock_now_ns(bus->clk);

	*n_out = 0;
	if (h->peer->vanished) {
		errno = ENODEV;
		return BB_ERR_LOST;
	}
	advance(h->peer);
	while (*n_out < cap && h->n && h->queue[h->head].at_ns <= now_ns) {
		struct bb_line_event e = h->queue[h->head];
		e.overflow = h->peer->numbered && h->read_seq && e.seq != h->read_seq + 1;
		h->read_seq = e.seq;
		e.seq = h->peer->numbered ? e.seq : 0;
		events[(*n_out)++] = e;
		h->head = (h->head + 1) % QUEUE_MOST;
		h->n--;
	}
	return *n_out ? BB_OK : BB_TIMEOUT;
}

static enum bb_status line_set(struct bb_line_bus *bus, bool level)
{
	struct handle *h = own(bus);

	if (!h->has_out)
		return BB_ERR_UNSUPPORTED;
	if (h->peer->vanished) {
		errno = ENODEV;
		return BB_ERR_LOST;
	}
	if (h->peer->out != level)
		h->peer->out_ns = bb_clock_now_ns(bus->clk);
	h->peer->out = level;
	return BB_OK;
}

static void line_close(struct bb_line_bus *bus)
{
	struct handle *h = own(bus);

	h->peer->bus = NULL;
	free(h);
}

static const struct bb_line_ops ops = { line_read, line_set, line_close };

static enum bb_status line_open(void *ctx, const struct bb_line_request *r, struct bb_clock *clk,
                                struct bb_line_bus **out, struct bb_error *err)
{
	struct sim_line *p = ctx;
	const int why = p->bus ? EBUSY : p->vanished;

	*out = NULL;
	if (why) {
		bb_fail(err, BB_ERR_LOST, why == EACCES ? 1540 : why == EBUSY ? 1541 : 1542, NULL, "%s line %u", r->chip,
		        r->line);
		errno = why;
		return why == EBUSY ? BB_ERR_BUSY : why == EACCES ? BB_ERR_IO : BB_ERR_LOST;
	}
	struct handle *h = calloc(1, sizeof(*h));
	if (!h)
		return BB_ERR_NOMEM;
	advance(p); /* edges before this moment are nobody's */
	h->base = (struct bb_line_bus){ &ops, clk, -1 };
	h->peer = p;
	h->active_low = r->active_low;
	h->has_out = r->out >= 0;
	h->cap = !p->numbered ? QUEUE_V1 : r->n_buffer < QUEUE_MOST ? r->n_buffer : QUEUE_MOST;
	p->bus = *out = &h->base;
	if (h->has_out && p->out)
		p->out_ns = bb_clock_now_ns(clk);
	p->out = p->out && !h->has_out;
	return BB_OK;
}

enum bb_status sim_line_create(struct bb_clock *clk, const struct sim_line_config *c, struct sim_line **out)
{
	struct sim_line *p = calloc(1, sizeof(*p));

	*out = p;
	if (!p)
		return BB_ERR_NOMEM;
	p->clk = clk;
	p->opener = (struct bb_line_opener){ line_open, p };
	sim_rng_seed(&p->rng, c->seed, "line", "sync");
	p->numbered = c->numbered;
	p->rate = c->rate;
	p->rate_ppb = llround(c->rate_error_ppm * 1000);
	p->jitter_ns = llround(c->jitter_us * 1000);
	p->base_ns = p->last_ns = c->begin_ns;
	return BB_OK;
}

void sim_line_destroy(struct sim_line *p)
{
	free(p);
}

const struct bb_line_opener *sim_line_opener(struct sim_line *p)
{
	return &p->opener;
}

/* ---- verbs ---- */

void sim_line_stuck(struct sim_line *p, bool on)
{
	advance(p);
	p->stuck = on;
}

void sim_line_bounce(struct sim_line *p, unsigned n, int64_t after_ns)
{
	advance(p);
	p->bounce = n;
	p->bounce_ns = after_ns;
}

void sim_line_miss(struct sim_line *p, unsigned n)
{
	advance(p);
	p->miss = n;
}

void sim_line_overflow(struct sim_line *p, unsigned n)
{
	advance(p);
	p->overflow = n;
}

void sim_line_jitter(struct sim_line *p, int64_t peak_ns)
{
	advance(p);
	p->peak_ns = peak_ns;
}

void sim_line_rate(struct sim_line *p, struct bb_rate rate, double rate_error_ppm)
{
	advance(p);
	if (p->n > 0) { /* the edge before the next keeps its place */
		p->base_ns = place_ns(p, p->n - 1);
		p->base_n = p->n - 1;
	}
	p->rate = rate;
	p->rate_ppb = llround(rate_error_ppm * 1000);
}

void sim_line_invert(struct sim_line *p)
{
	advance(p);
	p->inverted = !p->inverted;
	p->last_ns = bb_clock_now_ns(p->clk);
	change(p, p->last_ns, !p->level);
}

void sim_line_vanish(struct sim_line *p, int os_errno)
{
	advance(p);
	p->vanished = os_errno;
	if (os_errno)
		p->out = false; /* no power, and a resistor to ground */
}

bool sim_line_out(const struct sim_line *p)
{
	return p->out;
}

int64_t sim_line_out_ns(const struct sim_line *p)
{
	return p->out_ns;
}

bool sim_line_is_open(const struct sim_line *p)
{
	return p->bus;
}

bool sim_line_level(struct sim_line *p)
{
	advance(p);
	return p->level;
}

uint64_t sim_line_edges(struct sim_line *p)
{
	advance(p);
	return p->edges;
}
