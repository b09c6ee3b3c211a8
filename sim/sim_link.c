/* sim/sim_link.c: the network; the model stands in sim/sim_link.h. A timer per node, on the owner's thread. */
#include "sim/sim_link.h"
#include "sim/sim.h"
#include "sim/sim_option.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define QUEUE 64
#define JITTER_MOST 4.0

struct link_node {
	struct sim_link *link;
	struct bb_timer timer;        /* runs at the next arrival */
	struct bb_timer *notify;
	int64_t loss_ppm, cut;        /* sums over faults */
	uint32_t n;
	struct bb_link_message *queue; /* by arrival, oldest first; what lies ahead of now is still on the wire */
};

struct sim_link {
	struct bb_link base;
	struct sim_world *world;
	struct sim_rng rng;
	bool ideal;
	int64_t delay_ns, jitter_ns;
	int64_t down, added_ns, loss_ppm; /* sums over faults; loss_ppm with the network's own */
	struct link_node *nodes;
	struct bb_link_message *messages;
	struct sim_link_counts counts;
};

static struct sim_link *own(struct bb_link *l)
{
	return bb_container_of(l, struct sim_link, base);
}

struct sim_link_counts sim_link_counts(const struct bb_link *l)
{
	return ((const struct sim_link *)(const void *)l)->counts; /* base is the first member */
}

static int64_t next_arrival(const struct link_node *node, int64_t after_ns)
{
	for (uint32_t i = 0; i < node->n; i++)
		if (node->queue[i].arrived_ns > after_ns)
			return node->queue[i].arrived_ns;
	return BB_NEVER;
}

static int64_t arrive(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct link_node *node = bb_container_of(timer, struct link_node, timer);
	struct bb_clock *clk = node->link->base.dev.clk;

	(void)now_ns;
	/* Never later than the node wants anyway. Out of memory: it finds the message when it wakes by itself. */
	if (node->notify && (!node->notify->slot || node->notify->at_ns > scheduled_ns) &&
	    bb_clock_arm(clk, node->notify, scheduled_ns) != BB_OK)
		return BB_NEVER;
	return next_arrival(node, scheduled_ns);
}

static int64_t flight_ns(struct sim_link *s)
{
	const double z = fmin(fabs(sim_rng_normal(&s->rng)), JITTER_MOST);

	return s->delay_ns + s->added_ns + (int64_t)(z * (double)s->jitter_ns);
}

static bool is_lost(struct sim_link *s, const struct link_node *from, const struct link_node *to)
{
	const double draw = sim_rng_uniform(&s->rng) * 1e6; /* always drawn: a fault does not shift the later ones */

	return s->down || from->cut || to->cut || draw < (double)(s->loss_ppm + from->loss_ppm + to->loss_ppm);
}

static enum bb_status deliver(struct sim_link *s, struct link_node *to, const struct bb_link_message *m)
{
	uint32_t at = to->n;

	if (to->n == QUEUE) {
		memmove(&to->queue[0], &to->queue[1], --to->n * sizeof(*m));
		at = to->n;
		s->counts.overflowed++;
	}
	for (; at > 0 && to->queue[at - 1].arrived_ns > m->arrived_ns; at--)
		to->queue[at] = to->queue[at - 1];
	to->queue[at] = *m;
	to->n++;
	bb_device_event(&s->base.dev, BB_EV_MESSAGE, m->arrived_ns, (int64_t)m->from << 16 | m->to,
	                (int64_t)m->n_bytes);
	if (to->timer.slot && to->timer.at_ns <= m->arrived_ns)
		return BB_OK;
	return bb_clock_arm(s->base.dev.clk, &to->timer, m->arrived_ns);
}

static enum bb_status send_one(struct sim_link *s, uint16_t to, struct bb_link_message *m)
{
	const bool lost = is_lost(s, &s->nodes[m->from], &s->nodes[to]);
	const int64_t arrived_ns = m->sent_ns + flight_ns(s);

	s->counts.sent++;
	if (lost) {
		s->counts.lost++;
		return BB_OK;
	}
	m->to = to;
	m->arrived_ns = arrived_ns;
	return deliver(s, &s->nodes[to], m);
}

/* Ops */

static const struct sim_option options[] = {
	{ "delay_us", offsetof(struct bb_link_config, delay_us), 0, 1e6 },
	{ "jitter_us", offsetof(struct bb_link_config, jitter_us), 0, 1e5 },
	{ "loss_ppm", offsetof(struct bb_link_config, loss_ppm), 0, 1e6 },
	{ NULL, 0, 0, 0 },
};

static enum bb_status check_config(struct sim_link *s)
{
	const struct bb_link_config *c = &s->base.config;

	if (c->n_nodes < 1 || c->n_nodes > BB_LINK_NODES_MAX)
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "%lld nodes", (long long)c->n_nodes);
	if (!(c->delay_us >= 0 && c->delay_us <= 1e6 && c->jitter_us >= 0 && c->jitter_us <= 1e5 && c->loss_ppm >= 0 &&
	      c->loss_ppm <= 1e6))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "delay, jitter or loss");
	return BB_OK;
}

static enum bb_status take_memory(struct sim_link *s)
{
	const size_t n = (size_t)s->base.config.n_nodes;

	s->nodes = calloc(n, sizeof(*s->nodes));
	s->messages = calloc(n * QUEUE, sizeof(*s->messages));
	if (!s->nodes || !s->messages)
		return BB_ERR_NOMEM;
	for (size_t i = 0; i < n; i++) {
		s->nodes[i].link = s;
		s->nodes[i].timer = (struct bb_timer){ .step = arrive, .rank = 2 };
		s->nodes[i].queue = s->messages + i * QUEUE;
	}
	return BB_OK;
}

static enum bb_status link_open(struct bb_link *l, const struct bb_open *open)
{
	struct sim_link *s = own(l);

	s->world = open->world;
	s->ideal = open->fidelity == 0;
	enum bb_status status = sim_options_read(&l->dev, open->uri, options, &l->config);
	if (status == BB_OK)
		status = check_config(s);
	if (status != BB_OK)
		return status;
	s->delay_ns = llround(l->config.delay_us * 1000);
	s->jitter_ns = s->ideal ? 0 : llround(l->config.jitter_us * 1000);
	s->loss_ppm = s->ideal ? 0 : llround(l->config.loss_ppm);
	sim_rng_seed(&s->rng, open->seed, "link", l->dev.id);
	l->limits = (struct bb_link_limits){ .most_bytes = BB_LINK_MESSAGE_MAX, .least_delay_ns = s->delay_ns };
	status = take_memory(s);
	if (status == BB_OK)
		status = sim_world_register(s->world, "link", l->dev.id, s, sim_link_verbs);
	if (status != BB_OK) {
		free(s->nodes);
		free(s->messages);
	}
	return status;
}

static void link_close(struct bb_link *l)
{
	struct sim_link *s = own(l);

	sim_world_unregister(s->world, s);
	for (int64_t i = 0; i < l->config.n_nodes; i++)
		bb_clock_disarm(l->dev.clk, &s->nodes[i].timer);
	free(s->nodes);
	free(s->messages);
}

static enum bb_status link_send(struct bb_link *l, uint16_t from, uint16_t to, const void *bytes, size_t n)
{
	struct sim_link *s = own(l);
	struct bb_link_message m = { .from = from, .sent_ns = bb_clock_now_ns(l->dev.clk), .n_bytes = n };
	enum bb_status status = BB_OK;

	memcpy(m.bytes, bytes, n);
	if (to != BB_LINK_ALL)
		return send_one(s, to, &m);
	for (uint16_t i = 0; i < l->config.n_nodes && status == BB_OK; i++)
		if (i != from)
			status = send_one(s, i, &m);
	return status;
}

static enum bb_status link_receive(struct bb_link *l, uint16_t node, struct bb_link_message *out)
{
	struct sim_link *s = own(l);
	struct link_node *to = &s->nodes[node];

	if (!to->n || to->queue[0].arrived_ns > bb_clock_now_ns(l->dev.clk))
		return BB_TIMEOUT;
	*out = to->queue[0];
	memmove(&to->queue[0], &to->queue[1], --to->n * sizeof(*out));
	s->counts.received++;
	return BB_OK;
}

static enum bb_status link_notify(struct bb_link *l, uint16_t node, struct bb_timer *timer)
{
	own(l)->nodes[node].notify = timer;
	return BB_OK;
}

static const struct bb_link_ops ops = { link_open, link_close, link_send, link_receive, link_notify };
const struct bb_link_driver sim_link_driver = { "sim", sizeof(struct sim_link), &ops };

/* Verbs */

static struct link_node *node_of(struct sim_link *s, const char *id)
{
	const struct bb_room *room = sim_world_room(s->world);

	for (size_t i = 0; id && i < room->n_nodes && (int64_t)i < s->base.config.n_nodes; i++)
		if (!strcmp(room->nodes[i].id, id))
			return &s->nodes[i];
	return NULL;
}

static enum bb_status verb_loss(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_link *s = device;
	const char *id = sim_fault_arg(args, "node");
	double percent;
	const enum bb_status status = sim_fault_range(args, "percent", SIM_FAULT_REQUIRED, 0, 100, &percent, err);

	if (status != BB_OK || !s)
		return status;
	struct link_node *node = node_of(s, id);
	if (id && !node)
		return BB_ERR_CONFIG;
	int64_t *sum = node ? &node->loss_ppm : &s->loss_ppm;
	*sum += llround(percent * (on ? 1e4 : -1e4));
	return BB_OK;
}

static enum bb_status verb_delay(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_link *s = device;
	double us;
	const enum bb_status status = sim_fault_range(args, "us", SIM_FAULT_REQUIRED, 0, 1e6, &us, err);

	if (status == BB_OK && s)
		s->added_ns += llround(us * (on ? 1e3 : -1e3));
	return status;
}

static enum bb_status verb_partition(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_link *s = device;
	const char *id = sim_fault_arg(args, "node");

	if (!id)
		return bb_fail(err, BB_ERR_CONFIG, 1605, args->where, "node=ID is missing");
	if (!s)
		return BB_OK;
	struct link_node *node = node_of(s, id);
	if (!node)
		return BB_ERR_CONFIG;
	node->cut += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status verb_down(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_link *s = device;

	(void)args;
	(void)err;
	if (s)
		s->down += on ? 1 : -1;
	return BB_OK;
}

const struct sim_verb sim_link_verbs[] = {
	{ "loss", "percent=N [node=ID]", "that share of the messages is lost (of one node, or of all)", "percent=5",
	  verb_loss },
	{ "delay", "us=N", "every message takes that much longer", "us=500", verb_delay },
	{ "partition", "node=ID", "a node neither sends nor hears", "node=front", verb_partition },
	{ "down", "", "the switch is dead: nothing arrives", "", verb_down },
	{ NULL, NULL, NULL, NULL, NULL },
};
