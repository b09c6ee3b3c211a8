#include "bench/loop/follow.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/remote.h"
#include "hal/dev_time.h"
#include "sync/exchange.h"
#include "sync/servo.h"

#define KIND 0x6501
#define ASK_NS (BB_NS_PER_S / 8)
#define FIRST 32                        /* exchanges that come faster, until the rate is known */
#define ASK_FIRST_NS (BB_NS_PER_S / 32)
#define SETTLED 80                      /* and what is counted as its error comes after these */
#define MOST_PPB 2e6 /* two oscillators differ by half of it, and a millisecond is gone in a second */

struct follow_message { /* native layout: all processes are of one version */
	uint32_t kind, node, planted, zero;
	int64_t t1_ns, t2_ns, t3_ns; /* asked: this machine's clock; heard, answered: the head's */
	double rate_ppb;             /* with a question: what the servo gives, */
	int64_t uncertainty_ns;      /* how far off it may be, INT64_MAX before it is locked, */
	int64_t off_ns;              /* planted: how far off it is */
	uint32_t exchanges, outliers;
};
_Static_assert(sizeof(struct follow_message) != sizeof(struct bb_message), "packets are told apart by length and kind");

struct bb_follow {
	struct bb_frame_loop *loop;
	struct bb_timer ask;
	struct bb_clockfit fit;
	struct bb_servo servo;
	uint32_t exchanges;
	unsigned node; /* who asks for this process */
	struct follow_message told[BB_NODES_MAX]; /* head: the newest of each process, by the node that asked; */
	double most_ns[BB_NODES_MAX];             /* the most one was off, once it had settled */
};

enum bb_status bb_follow_create(struct bb_frame_loop *l, struct bb_follow **out)
{
	struct bb_servo_config c = bb_servo_defaults(BB_SERVO_PI, ASK_NS);

	*out = NULL;
	if (!l->room->link.group)
		return BB_OK;
	struct bb_follow *f = calloc(1, sizeof(*f));
	if (!f)
		return BB_ERR_NOMEM;
	f->loop = l;
	c.first_step_ns = INT64_MAX; /* joining has put it within a round trip, and time must not run back */
	c.step_ns = 0;
	c.max_ppb = MOST_PPB;
	bb_clockfit_init(&f->fit, BB_CLOCKFIT_WINDOW_DEFAULT);
	bb_servo_init(&f->servo, &c);
	*out = f;
	return BB_OK;
}

void bb_follow_destroy(struct bb_follow *f)
{
	if (f)
		bb_clock_disarm(f->loop->clk, &f->ask);
	free(f);
}

static void send(struct bb_follow *f, unsigned from, unsigned to, const struct follow_message *m)
{
	if (bb_link_send(f->loop->rig->link, (uint16_t)from, (uint16_t)to, m, sizeof(*m)) != BB_OK)
		bb_result_count(f->loop->result, "messages_refused", 1);
}

/* A planted crystal's clock against the kernel's, read within a moment of each other. */
static int64_t off_by_ns(const struct bb_clock *clk)
{
	for (int i = 0; i < 5; i++) {
		const int64_t before_ns = bb_clock_stopwatch_ns(), now_ns = bb_clock_now_ns(clk);
		if (bb_clock_stopwatch_ns() - before_ns < 20000)
			return now_ns - (before_ns - bb_clock_zero_ns(clk));
	}
	return 0;
}

static int64_t ask(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_follow *f = bb_container_of(timer, struct bb_follow, ask);
	struct bb_clock *clk = f->loop->clk;
	const int64_t own_ns = bb_clock_own_ns(clk, now_ns);

	(void)scheduled_ns;
	if (f->servo.state != BB_SERVO_UNLOCKED)
		bb_clock_steer(clk, bb_servo_step(&f->servo, own_ns));
	const struct follow_message m = { .kind = KIND, .node = f->node,
		                          .planted = fabs(f->loop->options->plant_crystal_ppm) > 0, .t1_ns = own_ns, .rate_ppb = f->servo.given_ppb,
		                          .uncertainty_ns = bb_servo_uncertainty_ns(&f->servo, own_ns),
		                          .off_ns = off_by_ns(clk),
		                          .exchanges = f->exchanges, .outliers = (uint32_t)f->fit.n_outliers };
	send(f, f->node, bb_loop_head(f->loop), &m);
	return now_ns + (f->exchanges < FIRST ? ASK_FIRST_NS : ASK_NS);
}

enum bb_status bb_follow_begin(struct bb_follow *f)
{
	int64_t uncertainty_ns;

	f->ask = (struct bb_timer){ .step = ask, .rank = 4 };
	while (f->node < f->loop->room->n_nodes && !bb_remote_plays(f->loop, f->node))
		f->node++;
	(void)link_head_zero_ns(f->loop->rig->link, &uncertainty_ns);
	if (f->node == f->loop->room->n_nodes || (!uncertainty_ns && !(fabs(f->loop->options->plant_crystal_ppm) > 0)))
		return BB_OK;
	return bb_clock_arm(f->loop->clk, &f->ask, bb_clock_now_ns(f->loop->clk));
}

/* What the head's clock shows now, by the fit, is what ours should: the difference goes to the servo. */
static void learn(struct bb_follow *f, const struct bb_exchange *x, int64_t now_ns)
{
	struct bb_clock *clk = f->loop->clk;

	if (bb_clockfit_add(&f->fit, x) == BB_CLOCKFIT_REFUSED)
		return;
	if (f->exchanges++ < FIRST)
		return; /* a servo fed with an offset whose rate is a guess learns the guess */
	const int64_t own_ns = bb_clock_own_ns(clk, now_ns);
	const struct bb_servo_sample s = { .now_ns = own_ns, .local_ns = now_ns,
		                           .offset_ns = bb_ns_since(now_ns, bb_clockfit_remote_ns(&f->fit, own_ns, NULL)) };
	bb_clock_steer(clk, bb_servo_sample(&f->servo, &s).adjust_ppb);
}

bool bb_follow_hear(struct bb_follow *f, const struct bb_link_message *packet, int64_t now_ns)
{
	struct follow_message m;

	if (!f || packet->n_bytes != sizeof(m))
		return false;
	memcpy(&m, packet->bytes, sizeof(m));
	if (m.kind != KIND)
		return false;
	const unsigned head = bb_loop_head(f->loop);
	if (bb_remote_only_plays(f->loop)) {
		const struct bb_exchange x = { m.t1_ns, m.t2_ns, m.t3_ns, bb_clock_own_ns(f->loop->clk, packet->arrived_ns) };
		if (packet->from == head)
			learn(f, &x, now_ns);
		return true;
	}
	if (m.node != packet->from || m.node >= f->loop->room->n_nodes)
		return true;
	f->told[m.node] = m;
	if (m.exchanges > SETTLED)
		f->most_ns[m.node] = fmax(f->most_ns[m.node], fabs((double)m.off_ns));
	m.t2_ns = packet->arrived_ns;
	m.t3_ns = bb_clock_now_ns(f->loop->clk);
	send(f, head, packet->from, &m);
	return true;
}

void bb_follow_tell(const struct bb_follow *f, struct bb_run_result *result)
{
	for (size_t i = 0; f && i < f->loop->room->n_nodes; i++) {
		const struct follow_message *m = &f->told[i];
		const char *id = f->loop->room->nodes[i].id;
		char key[BB_ID_MAX + 16];
		if (!m->kind)
			continue;
		snprintf(key, sizeof(key), "clock_%s", id);
		if (m->uncertainty_ns == INT64_MAX)
			bb_result_fact(result, key, "not locked to the head's after %u exchanges", m->exchanges);
		else
			bb_result_fact(result, key, "on the head's within %.1f us, steered by %+.2f ppm; %u exchanges, %u outliers",
			               (double)m->uncertainty_ns * 1e-3, m->rate_ppb * 1e-3, m->exchanges, m->outliers);
		snprintf(key, sizeof(key), "clock_%s_off", id);
		if (m->planted)
			bb_result_fact(result, key, "%.1f us at most", f->most_ns[i] * 1e-3);
	}
}
