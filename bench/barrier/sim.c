#include "bench/barrier/sim.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sim/sim.h"
#include "sim/sim_link.h"
#include "sim/world.h"

#define OPEN_FRAMES 64    /* between the first node's and the last one's */
#define PLAN_AHEAD 8      /* frames from telling a plan to its first */
#define PLAN_FRAMES 64    /* a plan is made anew: vblanks and the master's clock drift apart */

struct troupe_node {
	struct bb_troupe *wall;
	uint16_t index;
	struct bb_framelock *lock;
	struct bb_timer step, begin, ready, inbox;
	struct sim_rng rng;
	int64_t offset_ns, ppb;
	uint64_t frame;           /* being drawn, or drawn and waiting */
	bool dead;
	double slow, quality;
	int64_t begun_ns, took_ns; /* took: 0 while it draws */
	unsigned side;
};

struct troupe_frame {
	uint64_t frame;
	unsigned n;               /* nodes that flipped it */
	int64_t first_ns, last_ns, ready_ns, planned_ns;
	int64_t first_k, last_k;  /* vblanks */
	bool late;
};

struct bb_troupe {
	struct bb_troupe_config c;
	struct bb_clock *clk;
	struct bb_link *link;
	struct troupe_node *nodes;
	struct troupe_frame open[OPEN_FRAMES];
	struct sim_rng rng;
	double loss;
	unsigned every;
	uint64_t planned;         /* frame the newest plan begins with; 0: none */
	double *skew, *cost;      /* us, by counted frame */
	uint64_t n_counted, n_torn, n_late, n_lost;
	uint64_t sent0, resent0;  /* when counting began */
	uint64_t target;
	bool reached;
};

struct bb_troupe_config bb_troupe_usual(void)
{
	struct bb_troupe_config c = { .method = BB_LOCK_CENTRAL, .n_nodes = 6, .rate = { 60, 1 }, .drift_ppm = 100, .draw_least = 0.4,
		                    .draw_most = 0.8, .seed = 7, .settle_frames = 120, .frames = 1000 };

	/* The exponential's p99 is ln 100 = 4.605 means. */
	c.link = (struct bb_link_config){ .delay_us = 100, .jitter_us = 100 / 4.605, .spread = BB_LINK_EXPONENTIAL, .send_us = 3 };
	return c;
}

/* ---- clocks ---- */

int64_t bb_troupe_local_ns(const struct bb_troupe *w, unsigned node, int64_t true_ns)
{
	const struct troupe_node *n = &w->nodes[node];

	return n->offset_ns + true_ns + (int64_t)((__int128)true_ns * n->ppb / BB_NS_PER_S);
}

/* The first true time at which the node's clock shows this or more. */
static int64_t true_ns(const struct troupe_node *n, int64_t local_ns)
{
	const int64_t since_ns = local_ns - n->offset_ns;
	int64_t at_ns = (int64_t)((__int128)since_ns * BB_NS_PER_S / (BB_NS_PER_S + n->ppb)) - 1;

	while (bb_troupe_local_ns(n->wall, n->index, at_ns) < local_ns)
		at_ns++;
	return at_ns;
}

static int64_t here_ns(const struct troupe_node *n)
{
	return bb_troupe_local_ns(n->wall, n->index, bb_clock_now_ns(n->wall->clk));
}

/* The first vblank after a time. */
static int64_t vblank_after(const struct bb_troupe *w, int64_t at_ns)
{
	int64_t k = at_ns / bb_rate_period_ns(w->c.rate);

	while (bb_rate_frame_ns(w->c.rate, k) > at_ns)
		k--;
	while (bb_rate_frame_ns(w->c.rate, k) <= at_ns)
		k++;
	return k;
}

/* ---- frames ---- */

static struct troupe_frame *frame_at(struct bb_troupe *w, uint64_t frame)
{
	struct troupe_frame *f = &w->open[frame % OPEN_FRAMES];

	if (f->frame != frame || !frame)
		*f = (struct troupe_frame){ .frame = frame };
	return f;
}

static void count_frame(struct bb_troupe *w, const struct troupe_frame *f)
{
	const int64_t due_ns = f->planned_ns > f->ready_ns ? f->planned_ns : f->ready_ns;
	const uint64_t at = w->n_counted;

	if (at == w->c.frames)
		return;
	w->skew[at] = (double)(f->last_ns - f->first_ns) * 1e-3;
	w->cost[at] = fmax(0, (double)(f->last_ns - due_ns) * 1e-3);
	w->n_counted++;
	w->n_torn += f->first_k != f->last_k;
	w->n_late += f->late;
	w->n_lost += (uint64_t)(f->last_k - vblank_after(w, f->ready_ns));
}

static uint64_t sum_resent(const struct bb_troupe *w)
{
	uint64_t sum = 0;

	for (unsigned i = 0; i < w->c.n_nodes; i++)
		sum += bb_framelock_counts(w->nodes[i].lock).resent;
	return sum;
}

static unsigned living(const struct bb_troupe *w)
{
	unsigned n = 0;

	for (unsigned i = 0; i < w->c.n_nodes; i++)
		n += !w->nodes[i].dead && bb_framelock_state(w->nodes[i].lock) == BB_LOCK_IN;
	return n;
}

static void flipped(struct bb_troupe *w, const struct bb_lock_release *r, int64_t at_ns)
{
	struct troupe_frame *f = frame_at(w, r->frame);
	const int64_t k = vblank_after(w, at_ns);

	if (!f->n || at_ns < f->first_ns)
		f->first_ns = at_ns;
	if (!f->n || at_ns > f->last_ns)
		f->last_ns = at_ns;
	if (!f->n || k < f->first_k)
		f->first_k = k;
	if (!f->n || k > f->last_k)
		f->last_k = k;
	if (r->timed && !r->late) /* on time, nobody has waited for anybody */
		f->planned_ns = f->planned_ns && f->planned_ns < at_ns ? f->planned_ns : at_ns;
	f->late |= r->late;
	f->n++;
	if (f->n < living(w))
		return;
	if (r->frame == w->c.settle_frames) {
		w->sent0 = sim_link_counts(w->link).sent;
		w->resent0 = sum_resent(w);
	} else if (r->frame > w->c.settle_frames) {
		count_frame(w, f);
	}
	if (r->frame >= w->target) {
		w->reached = true;
		bb_clock_stop(w->clk);
	}
}

/* The master knows its vblanks by its own clock. A plan flips an eighth of a period before one. */
static void make_plan(struct bb_troupe *w, struct troupe_node *master, uint64_t frame)
{
	if (w->c.method != BB_LOCK_TIMED || bb_framelock_master(master->lock) != master->index ||
	    (w->planned && frame < w->planned + PLAN_FRAMES && frame >= w->planned - PLAN_AHEAD))
		return;
	for (unsigned i = 0; i < w->c.n_nodes; i++)
		if (!w->nodes[i].dead && bb_framelock_state(w->nodes[i].lock) == BB_LOCK_IN &&
		    !bb_framelock_synchronised(w->nodes[i].lock, here_ns(&w->nodes[i]), NULL))
			return;
	const int64_t k = vblank_after(w, bb_clock_now_ns(w->clk)), period_ns = bb_rate_period_ns(w->c.rate);
	const int64_t at_ns = bb_rate_frame_ns(w->c.rate, k + (int64_t)((PLAN_AHEAD + 1) * w->every)) - period_ns / 8;
	w->planned = frame + PLAN_AHEAD;
	bb_framelock_plan(master->lock, w->planned, bb_troupe_local_ns(w, master->index, at_ns), w->every);
}

static void arm(struct bb_troupe *w, struct bb_timer *t, int64_t at_ns)
{
	if (bb_clock_arm(w->clk, t, at_ns) != BB_OK)
		bb_clock_stop(w->clk);
}

static void begin_after(struct troupe_node *n, uint64_t frame)
{
	struct bb_troupe *w = n->wall;

	n->frame = frame;
	bb_clock_disarm(w->clk, &n->ready);
	arm(w, &n->begin, bb_rate_frame_ns(w->c.rate, vblank_after(w, bb_clock_now_ns(w->clk))));
}

static void released(void *ctx, const struct bb_lock_release *r)
{
	struct troupe_node *n = ctx;
	struct bb_troupe *w = n->wall;
	const int64_t at_ns = bb_clock_now_ns(w->clk);

	if (!r->skipped)
		flipped(w, r, at_ns);
	if (w->c.released)
		w->c.released(w->c.ctx, n->index, at_ns, r);
	begin_after(n, r->frame + 1);
	make_plan(w, n, r->frame + 1);
}

static void send(void *ctx, uint16_t to, const void *bytes, size_t n_bytes)
{
	struct troupe_node *n = ctx;
	struct bb_troupe *w = n->wall;

	if (n->dead || n->side != w->nodes[to].side || (w->loss > 0 && sim_rng_uniform(&w->rng) < w->loss))
		return;
	if (bb_link_send(w->link, n->index, to, bytes, n_bytes) != BB_OK)
		bb_clock_stop(w->clk);
}

/* ---- what wakes a node ---- */

/* After anything has happened: what is due is done, and the next wake-up; a node that was let in again draws. */
static void stepped(struct troupe_node *n)
{
	const int64_t wake_ns = bb_framelock_step(n->lock, here_ns(n));
	const uint64_t frame = bb_framelock_frame(n->lock);

	bb_clock_disarm(n->wall->clk, &n->step);
	if (wake_ns != BB_NEVER) {
		const int64_t at_ns = wake_ns == INT64_MIN ? 0 : true_ns(n, wake_ns), now_ns = bb_clock_now_ns(n->wall->clk);
		arm(n->wall, &n->step, at_ns > now_ns ? at_ns : now_ns);
	}
	if (bb_framelock_state(n->lock) == BB_LOCK_IN && frame > n->frame)
		begin_after(n, frame);
}

static int64_t on_step(struct bb_timer *t, int64_t scheduled_ns, int64_t now_ns)
{
	struct troupe_node *n = bb_container_of(t, struct troupe_node, step);

	(void)scheduled_ns;
	(void)now_ns;
	if (!n->dead)
		stepped(n);
	return BB_NEVER;
}

static int64_t on_begin(struct bb_timer *t, int64_t scheduled_ns, int64_t now_ns)
{
	struct troupe_node *n = bb_container_of(t, struct troupe_node, begin);
	struct bb_troupe *w = n->wall;
	const double share = w->c.draw_least + (w->c.draw_most - w->c.draw_least) * sim_rng_uniform(&n->rng);

	(void)scheduled_ns;
	if (n->dead)
		return BB_NEVER;
	/* Who is behind a plan leaves frames out. */
	const uint64_t next = bb_framelock_next(n->lock, here_ns(n));
	n->frame = next > n->frame ? next : n->frame;
	n->begun_ns = now_ns;
	n->took_ns = 0;
	arm(w, &n->ready, now_ns + (int64_t)(share * n->slow * n->quality * (double)bb_rate_period_ns(w->c.rate)));
	return BB_NEVER;
}

static int64_t on_ready(struct bb_timer *t, int64_t scheduled_ns, int64_t now_ns)
{
	struct troupe_node *n = bb_container_of(t, struct troupe_node, ready);

	(void)scheduled_ns;
	if (n->dead)
		return BB_NEVER;
	n->took_ns = now_ns - n->begun_ns;
	if (bb_framelock_state(n->lock) == BB_LOCK_IN && n->frame >= bb_framelock_frame(n->lock)) {
		struct troupe_frame *f = frame_at(n->wall, n->frame);
		f->ready_ns = now_ns > f->ready_ns ? now_ns : f->ready_ns;
	}
	bb_framelock_ready(n->lock, n->frame, here_ns(n));
	stepped(n);
	return BB_NEVER;
}

static int64_t on_inbox(struct bb_timer *t, int64_t scheduled_ns, int64_t now_ns)
{
	struct troupe_node *n = bb_container_of(t, struct troupe_node, inbox);
	struct bb_troupe *w = n->wall;
	struct bb_link_message m;
	bool any = false;

	(void)scheduled_ns;
	(void)now_ns;
	while (bb_link_receive(w->link, n->index, &m) == BB_OK) {
		if (n->dead || w->nodes[m.from].side != n->side)
			continue;
		any = true;
		bb_framelock_hear(n->lock, m.from, m.bytes, m.n_bytes, here_ns(n));
	}
	if (any)
		stepped(n);
	return BB_NEVER;
}

/* ---- creation ---- */

static struct bb_lock_config lock_config(const struct bb_troupe *w, struct troupe_node *n)
{
	struct bb_lock_config l = { .method = w->c.method, .n_nodes = (uint16_t)w->c.n_nodes, .self = n->index, .rate = w->c.rate,
		                    .window = w->c.window, .send = send, .released = released, .ctx = n };

	bb_lock_config_times(&l, bb_rate_period_ns(w->c.rate));
	l.members = bb_lock_set_first(w->c.starts_empty ? 1 : w->c.n_nodes);
	return l;
}

static enum bb_status create_node(struct bb_troupe *w, uint16_t index)
{
	struct troupe_node *n = &w->nodes[index];
	char id[16];

	snprintf(id, sizeof(id), "%u", index);
	n->wall = w;
	n->index = index;
	n->slow = n->quality = 1;
	sim_rng_seed(&n->rng, w->c.seed, "wall", id);
	n->ppb = llround((2 * sim_rng_uniform(&n->rng) - 1) * w->c.drift_ppm * 1000);
	n->offset_ns = w->c.zero_ns + (w->c.drift_ppm > 0 ? (int64_t)(sim_rng_uniform(&n->rng) * 1e9) : 0);
	n->step = (struct bb_timer){ .step = on_step, .rank = 3 };
	n->begin = (struct bb_timer){ .step = on_begin, .rank = 3 };
	n->ready = (struct bb_timer){ .step = on_ready, .rank = 3 };
	n->inbox = (struct bb_timer){ .step = on_inbox, .rank = 3 };
	const struct bb_lock_config l = lock_config(w, n);
	enum bb_status status = bb_framelock_create(&l, &n->lock);
	if (status == BB_OK)
		status = bb_link_notify(w->link, index, &n->inbox);
	if (status == BB_OK && bb_framelock_state(n->lock) == BB_LOCK_IN)
		status = bb_clock_arm(w->clk, &n->begin, bb_rate_frame_ns(w->c.rate, 1));
	if (status == BB_OK)
		status = bb_clock_arm(w->clk, &n->step, 1);
	return status;
}

static enum bb_status open_all(struct bb_troupe *w)
{
	enum bb_status status = bb_clock_virtual_create(&w->clk);

	if (status != BB_OK)
		return status;
	const struct bb_open open = { .clk = w->clk, .seed = w->c.seed, .fidelity = 1 };
	status = bb_link_open(&sim_link_driver, &w->c.link, &open, &w->link);
	for (uint16_t i = 0; i < w->c.n_nodes && status == BB_OK; i++)
		status = create_node(w, i);
	return status;
}

enum bb_status bb_troupe_create(const struct bb_troupe_config *config, struct bb_troupe **out)
{
	*out = NULL;
	if (!config->n_nodes || config->n_nodes > BB_LOCK_NODES_MAX || !config->frames || config->frames > 10000000)
		return BB_ERR_RANGE;
	struct bb_troupe *w = calloc(1, sizeof(*w));
	if (!w)
		return BB_ERR_NOMEM;
	w->c = *config;
	w->c.link.n_nodes = config->n_nodes;
	snprintf(w->c.link.id, sizeof(w->c.link.id), "net");
	w->every = 1;
	sim_rng_seed(&w->rng, config->seed, "wall", "loss");
	w->nodes = calloc(config->n_nodes, sizeof(*w->nodes));
	w->skew = calloc(config->frames, sizeof(*w->skew));
	w->cost = calloc(config->frames, sizeof(*w->cost));
	const enum bb_status status = w->nodes && w->skew && w->cost ? open_all(w) : BB_ERR_NOMEM;
	if (status != BB_OK) {
		bb_troupe_destroy(w);
		return status;
	}
	*out = w;
	return BB_OK;
}

void bb_troupe_destroy(struct bb_troupe *w)
{
	if (!w)
		return;
	bb_link_close(w->link);
	for (unsigned i = 0; w->nodes && i < w->c.n_nodes; i++)
		bb_framelock_destroy(w->nodes[i].lock);
	bb_clock_destroy(w->clk);
	free(w->nodes);
	free(w->skew);
	free(w->cost);
	free(w);
}

/* ---- running ---- */

bool bb_troupe_run(struct bb_troupe *w, uint64_t frame, int64_t most_ns)
{
	w->target = frame;
	w->reached = false;
	bb_clock_run_until(w->clk, bb_clock_now_ns(w->clk) + most_ns);
	return w->reached;
}

void bb_troupe_run_for(struct bb_troupe *w, int64_t ns)
{
	w->target = UINT64_MAX;
	bb_clock_run_until(w->clk, bb_clock_now_ns(w->clk) + ns);
}

static struct bb_spread spread(double *v, size_t n)
{
	bb_stats_sort(v, n);
	return (struct bb_spread){ bb_stats_nearest_rank(v, n, 0.5), bb_stats_nearest_rank(v, n, 0.99),
		                   bb_stats_nearest_rank(v, n, 1) };
}

struct bb_troupe_result bb_troupe_result(struct bb_troupe *w)
{
	const double n = (double)w->n_counted;
	struct bb_troupe_result r = { .skew = spread(w->skew, w->n_counted), .cost = spread(w->cost, w->n_counted),
		                    .frames = w->n_counted };

	r.frames_lost = (double)w->n_lost / n;
	r.torn = (double)w->n_torn / n;
	r.late = (double)w->n_late / n;
	r.messages = (double)(sim_link_counts(w->link).sent - w->sent0) / n;
	r.resent = (double)(sum_resent(w) - w->resent0) / n;
	r.epochs = bb_framelock_epoch(w->nodes[0].lock);
	return r;
}

/* ---- what is done to it ---- */

void bb_troupe_kill(struct bb_troupe *w, unsigned node)
{
	w->nodes[node].dead = true;
}

void bb_troupe_revive(struct bb_troupe *w, unsigned node)
{
	struct troupe_node *n = &w->nodes[node];

	n->dead = false;
	n->frame = 0;
	bb_clock_disarm(w->clk, &n->begin);
	bb_clock_disarm(w->clk, &n->ready);
	bb_framelock_restart(n->lock);
	stepped(n);
}

void bb_troupe_slow(struct bb_troupe *w, unsigned node, double factor)
{
	w->nodes[node].slow = factor;
}

void bb_troupe_quality(struct bb_troupe *w, unsigned node, double quality)
{
	w->nodes[node].quality = quality;
}

int64_t bb_troupe_took_ns(const struct bb_troupe *w, unsigned node)
{
	const struct troupe_node *n = &w->nodes[node];

	return n->took_ns ? n->took_ns : bb_clock_now_ns(w->clk) - n->begun_ns;
}

void bb_troupe_cut(struct bb_troupe *w, unsigned node, unsigned side)
{
	w->nodes[node].side = side;
}

void bb_troupe_loss(struct bb_troupe *w, double share)
{
	w->loss = share;
}

void bb_troupe_configure(struct bb_troupe *w, unsigned node, uint32_t version, uint8_t hash0)
{
	struct troupe_node *n = &w->nodes[node];
	struct bb_lock_config l = lock_config(w, n);

	l.version = version;
	l.hash[0] = hash0;
	l.members = (struct bb_lock_set){ { 0 } };
	bb_framelock_destroy(n->lock);
	if (bb_framelock_create(&l, &n->lock) != BB_OK)
		abort();
}

void bb_troupe_every(struct bb_troupe *w, unsigned every)
{
	w->every = every;
	w->planned = 0;
}

struct bb_framelock *bb_troupe_lock(struct bb_troupe *w, unsigned node)
{
	return w->nodes[node].lock;
}

struct bb_clock *bb_troupe_clock(struct bb_troupe *w)
{
	return w->clk;
}

int64_t bb_troupe_now_ns(const struct bb_troupe *w)
{
	return bb_clock_now_ns(w->clk);
}
