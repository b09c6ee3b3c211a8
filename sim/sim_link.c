/* sim/sim_link.c: the network; the model stands in sim/sim_link.h. A timer per node, on the owner's thread. */
#include "sim/sim_link.h"
#include "sim/sim.h"
#include "sim/sim_option.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define QUEUE 64 /* and four from every node in a large network: all may speak to one at once */
#define QUEUE_EACH 4
#define JITTER_MOST 4.0

struct link_node {
	struct sim_link *link;
	struct bb_timer timer;        /* runs at the next arrival */
	struct bb_timer *notify;
	int64_t loss_ppm, cut;        /* sums over faults */
	int64_t free_ns;              /* its transmitter has sent what it was given */
	uint32_t n;
	uint32_t *queue;              /* into messages, by arrival, oldest first; what lies ahead of now is on the wire */
};

struct sim_link {
	struct bb_link base;
	struct sim_world *world;
	struct sim_rng rng;
	bool ideal;
	int64_t delay_ns, jitter_ns, send_ns;
	int64_t down, added_ns, loss_ppm, duplicate_ppm; /* sums over faults; the ppm with the network's own */
	struct link_node *nodes;
	uint32_t queue_most, *queues;
	struct bb_link_message *messages; /* of all queues */
	uint32_t *unused, n_unused;       /* of those */
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
		if (node->link->messages[node->queue[i]].arrived_ns > after_ns)
			return node->link->messages[node->queue[i]].arrived_ns;
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
	const double z = s->base.config.spread == BB_LINK_EXPONENTIAL ? sim_rng_exponential(&s->rng)
	                                                              : fmin(fabs(sim_rng_normal(&s->rng)), JITTER_MOST);

	return s->delay_ns + s->added_ns + (int64_t)(z * (double)s->jitter_ns);
}

static bool is_lost(struct sim_link *s, const struct link_node *from, const struct link_node *to)
{
	const double draw = sim_rng_uniform(&s->rng) * 1e6; /* always drawn: a fault does not shift the later ones */

	return s->down || from->cut || to->cut || draw < (double)(s->loss_ppm + from->loss_ppm + to->loss_ppm);
}

static void drop_oldest(struct sim_link *s, struct link_node *node)
{
	s->unused[s->n_unused++] = node->queue[0];
	memmove(&node->queue[0], &node->queue[1], --node->n * sizeof(*node->queue));
}

static enum bb_status deliver(struct sim_link *s, struct link_node *to, const struct bb_link_message *m)
{
	if (to->n == s->queue_most || (to->n && !s->n_unused)) {
		drop_oldest(s, to);
		s->counts.overflowed++;
	} else if (!s->n_unused) {
		s->counts.overflowed++;
		return BB_OK;
	}
	const uint32_t own = s->unused[--s->n_unused];
	uint32_t at = to->n++;
	s->messages[own] = *m;
	for (; at > 0 && s->messages[to->queue[at - 1]].arrived_ns > m->arrived_ns; at--)
		to->queue[at] = to->queue[at - 1];
	to->queue[at] = own;
	bb_device_event(&s->base.dev, BB_EV_MESSAGE, m->arrived_ns, (int64_t)m->from << 16 | m->to,
	                (int64_t)m->n_bytes);
	if (to->timer.slot && to->timer.at_ns <= m->arrived_ns)
		return BB_OK;
	return bb_clock_arm(s->base.dev.clk, &to->timer, m->arrived_ns);
}

/* When a datagram leaves: after those its sender was given before. */
static int64_t leave_ns(struct sim_link *s, struct link_node *from, int64_t now_ns)
{
	from->free_ns = (from->free_ns > now_ns ? from->free_ns : now_ns) + s->send_ns;
	return from->free_ns;
}

static enum bb_status send_one(struct sim_link *s, uint16_t to, struct bb_link_message *m)
{
	const bool lost = is_lost(s, &s->nodes[m->from], &s->nodes[to]);
	const int64_t left_ns = leave_ns(s, &s->nodes[m->from], m->sent_ns), arrived_ns = left_ns + flight_ns(s);
	const bool twice = s->duplicate_ppm && sim_rng_uniform(&s->rng) * 1e6 < (double)s->duplicate_ppm;

	s->counts.sent++;
	if (lost) {
		s->counts.lost++;
		return BB_OK;
	}
	m->to = to;
	m->arrived_ns = arrived_ns;
	enum bb_status status = deliver(s, &s->nodes[to], m);
	if (status == BB_OK && twice) {
		s->counts.duplicated++;
		m->arrived_ns = left_ns + flight_ns(s);
		status = deliver(s, &s->nodes[to], m);
	}
	return status;
}

/* Ops */

static const struct sim_option options[] = {
	{ "delay_us", offsetof(struct bb_link_config, delay_us), 0, 1e6 },
	{ "jitter_us", offsetof(struct bb_link_config, jitter_us), 0, 1e5 },
	{ "loss_ppm", offsetof(struct bb_link_config, loss_ppm), 0, 1e6 },
	{ "duplicate_ppm", offsetof(struct bb_link_config, duplicate_ppm), 0, 1e6 },
	{ "send_us", offsetof(struct bb_link_config, send_us), 0, 1e4 },
	{ NULL, 0, 0, 0 },
};

static enum bb_status check_config(struct sim_link *s)
{
	const struct bb_link_config *c = &s->base.config;

	if (c->n_nodes < 1 || c->n_nodes > BB_LINK_ENDPOINTS_MAX)
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "%lld nodes", (long long)c->n_nodes);
	if (!(c->delay_us >= 0 && c->delay_us <= 1e6 && c->jitter_us >= 0 && c->jitter_us <= 1e5 && c->loss_ppm >= 0 &&
	      c->loss_ppm <= 1e6 && c->duplicate_ppm >= 0 && c->duplicate_ppm <= 1e6 && c->send_us >= 0 && c->send_us <= 1e4 &&
	      c->spread >= BB_LINK_HALF_NORMAL && c->spread <= BB_LINK_EXPONENTIAL))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "delay, jitter, loss, duplicates or send time");
	return BB_OK;
}

static void give_memory(struct sim_link *s)
{
	free(s->nodes);
	free(s->queues);
	free(s->messages);
	free(s->unused);
}

static enum bb_status take_memory(struct sim_link *s)
{
	const uint32_t n = (uint32_t)s->base.config.n_nodes, all = n * QUEUE;

	s->queue_most = QUEUE_EACH * n > QUEUE ? QUEUE_EACH * n : QUEUE;
	s->nodes = calloc(n, sizeof(*s->nodes));
	s->queues = calloc((size_t)n * s->queue_most, sizeof(*s->queues));
	s->messages = calloc(all, sizeof(*s->messages));
	s->unused = calloc(all, sizeof(*s->unused));
	if (!s->nodes || !s->queues || !s->messages || !s->unused)
		return BB_ERR_NOMEM;
	for (uint32_t i = 0; i < all; i++)
		s->unused[s->n_unused++] = all - 1 - i;
	for (uint32_t i = 0; i < n; i++) {
		s->nodes[i].link = s;
		s->nodes[i].timer = (struct bb_timer){ .step = arrive, .rank = 2 };
		s->nodes[i].queue = s->queues + (size_t)i * s->queue_most;
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
	s->send_ns = llround(l->config.send_us * 1000);
	s->loss_ppm = s->ideal ? 0 : llround(l->config.loss_ppm);
	s->duplicate_ppm = s->ideal ? 0 : llround(l->config.duplicate_ppm);
	sim_rng_seed(&s->rng, open->seed, "link", l->dev.id);
	l->limits = (struct bb_link_limits){ .most_bytes = BB_LINK_MESSAGE_MAX, .least_delay_ns = s->delay_ns };
	status = take_memory(s);
	if (status == BB_OK && s->world) /* a network alone, in no room, has no faults */
		status = sim_world_register(s->world, "link", l->dev.id, s, sim_link_verbs);
	if (status != BB_OK)
		give_memory(s);
	return status;
}

static void link_close(struct bb_link *l)
{
	struct sim_link *s = own(l);

	if (s->world)
		sim_world_unregister(s->world, s);
	for (int64_t i = 0; i < l->config.n_nodes; i++)
		bb_clock_disarm(l->dev.clk, &s->nodes[i].timer);
	give_memory(s);
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

	if (!to->n || s->messages[to->queue[0]].arrived_ns > bb_clock_now_ns(l->dev.clk))
		return BB_TIMEOUT;
	*out = s->messages[to->queue[0]];
	drop_oldest(s, to);
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

static enum bb_status verb_duplicate(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_link *s = device;
	double percent;
	const enum bb_status status = sim_fault_range(args, "percent", SIM_FAULT_REQUIRED, 0, 100, &percent, err);

	if (status == BB_OK && s)
		s->duplicate_ppm += llround(percent * (on ? 1e4 : -1e4));
	return status;
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
	{ "duplicate", "percent=N", "that share of the messages comes twice", "percent=5", verb_duplicate },
	{ "delay", "us=N", "every message takes that much longer", "us=500", verb_delay },
	{ "partition", "node=ID", "a node neither sends nor hears", "node=front", verb_partition },
	{ "down", "", "the switch is dead: nothing arrives", "", verb_down },
	{ NULL, NULL, NULL, NULL, NULL },
};
