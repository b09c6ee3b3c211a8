/* drivers/link/peers.c: sessions, queues and what a packet may change; see the header. */
#include "drivers/link/peers.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define ASK_AGAIN_NS (BB_NS_PER_S / 10)
#define LINES_A_SECOND 10
#define PROMISED_NS BB_NS_PER_S /* so long an offered place waits to be taken up */

static struct link_peers *own(struct bb_link *l)
{
	return bb_container_of(l, struct link_peers, base);
}

static const struct link_peers *seen(const struct bb_link *l)
{
	return (const struct link_peers *)(const void *)l; /* base is the first member */
}

bool link_peers_is_head(const struct link_peers *l)
{
	return l->group.process == 0;
}

static bool is_local(const struct link_peers *l, uint16_t node)
{
	return l->group.home[node] == l->group.process;
}

static int64_t now_ns(const struct link_peers *l)
{
	return bb_clock_now_ns(l->base.dev.clk);
}

/* ---- packets out ---- */

static enum bb_status put_on_wire(struct link_peers *l, const struct link_address *to, const struct link_packet *p)
{
	uint8_t bytes[LINK_PACKET_MAX];
	const size_t n = link_packet_put(l->seal, p, bytes);
	const enum bb_status status = n ? l->wire->send(l, to, bytes, n) : BB_ERR_INTERNAL;

	l->counts.sent += status == BB_OK;
	l->counts.overflowed += status == BB_ERR_BUSY;
	return status;
}

static void lose(struct link_peers *l, uint16_t process, bool left)
{
	struct link_peer *peer = &l->session[process].peer;

	if (peer->state != LINK_PEER_JOINED)
		return;
	peer->state = LINK_PEER_LOST;
	peer->lost_ns = now_ns(l);
	peer->left = left;
}

static void say(struct link_peers *l, uint16_t process, struct link_packet *p)
{
	struct link_session *s = &l->session[process];

	p->process = l->group.process;
	p->session = s->session;
	p->number = ++s->number_out;
	if (p->kind != LINK_DATA)
		p->sent_ns = now_ns(l);
	if (put_on_wire(l, &s->address, p) == BB_ERR_LOST)
		lose(l, process, false);
}

static void say_kind(struct link_peers *l, uint16_t process, enum link_kind kind)
{
	struct link_packet p = { .kind = kind };

	say(l, process, &p);
}

/* ---- packets in ---- */

static void refuse(struct link_peers *l, uint64_t *counter, const char *what)
{
	const int64_t second = now_ns(l) / BB_NS_PER_S;

	++*counter;
	if (second != l->log_second)
		l->log_lines = 0;
	l->log_second = second;
	if (l->log_lines++ >= LINES_A_SECOND)
		return;
	l->counts.logged++;
	bb_log(l->base.dev.log, BB_LOG_WARN, BB_BLAME_DEVICE, "link/net", "%s packet refused (%llu so far)", what,
	       (unsigned long long)*counter);
}

void link_peers_forged(struct link_peers *l)
{
	refuse(l, &l->counts.forged, "forged");
}

static void keep(struct link_peers *l, const struct bb_link_message *m)
{
	struct link_queue *q = &l->queue[m->to];

	if (q->n == LINK_QUEUE) {
		q->first = (q->first + 1) % LINK_QUEUE;
		q->n--;
		l->counts.overflowed++;
	}
	q->message[(q->first + q->n++) % LINK_QUEUE] = *m;
	bb_device_event(&l->base.dev, BB_EV_MESSAGE, m->arrived_ns, (int64_t)m->from << 16 | m->to, (int64_t)m->n_bytes);
	if (q->notify && (!q->notify->slot || q->notify->at_ns > m->arrived_ns) &&
	    bb_clock_arm(l->base.dev.clk, q->notify, m->arrived_ns) != BB_OK)
		l->counts.overflowed++; /* out of memory: it finds the message when it wakes by itself */
}

static void send_one(struct link_peers *l, const struct bb_link_message *m)
{
	struct link_packet p = { .kind = LINK_DATA, .sent_ns = m->sent_ns, .from = m->from, .to = m->to,
		                 .n_bytes = (uint16_t)m->n_bytes };
	const uint16_t process = link_peers_is_head(l) ? l->group.home[m->to] : 0;

	if (is_local(l, m->to)) {
		keep(l, m);
		return;
	}
	if (l->session[process].peer.state != LINK_PEER_JOINED)
		return; /* as on a network whose cable is out */
	memcpy(p.bytes, m->bytes, m->n_bytes);
	say(l, process, &p);
}

static void hear_data(struct link_peers *l, uint16_t process, const struct link_packet *p)
{
	struct bb_link_message m = { .from = p->from, .to = p->to, .sent_ns = p->sent_ns, .arrived_ns = now_ns(l),
		                     .n_bytes = p->n_bytes };

	/* Nobody speaks for another process's nodes; what the head passes on is not its own. */
	if (!p->n_bytes || p->from >= l->base.config.n_nodes || p->to >= l->base.config.n_nodes ||
	    (link_peers_is_head(l) ? l->group.home[p->from] != process : !is_local(l, p->to))) {
		refuse(l, &l->counts.malformed, "malformed");
		return;
	}
	memcpy(m.bytes, p->bytes, p->n_bytes);
	l->counts.received++;
	send_one(l, &m);
}

static void take_up(struct link_peers *l, struct link_session *s)
{
	s->session = s->next_session;
	s->next_session = 0;
	s->address = s->next_address;
	s->number_in = s->number_out = 0;
	s->peer.state = LINK_PEER_JOINED;
	s->peer.pid = s->next_pid;
	s->peer.joins++;
	s->peer.left = false;
	l->wire->joined(l, &s->address, s->peer.pid);
}

/* A packet of a session: its number must be higher than all before it. */
static void hear_session(struct link_peers *l, const struct link_packet *p)
{
	const uint16_t process = link_peers_is_head(l) ? p->process : 0;
	struct link_session *s = &l->session[process];

	if (p->process != process || process == l->group.process || process >= l->group.n_processes) {
		refuse(l, &l->counts.stale, "misplaced");
		return;
	}
	if (s->next_session && p->session == s->next_session)
		take_up(l, s);
	if (s->peer.state != LINK_PEER_JOINED || p->session != s->session) {
		refuse(l, &l->counts.stale, "stale");
		return;
	}
	if (p->number <= s->number_in) {
		refuse(l, &l->counts.replayed, "replayed");
		return;
	}
	l->counts.missed += p->number - s->number_in - 1;
	s->number_in = p->number;
	s->peer.heard_ns = now_ns(l);
	if (p->kind == LINK_DATA)
		hear_data(l, process, p);
	else if (p->kind == LINK_BYE)
		lose(l, process, true);
}

/* ---- joining, the head's side ---- */

static void answer_refused(struct link_peers *l, const struct link_address *to, enum link_reason reason, uint64_t nonce)
{
	struct link_packet p = { .kind = LINK_REFUSED, .sent_ns = now_ns(l), .number = nonce, .n_bytes = 1,
		                 .bytes = { (uint8_t)reason } };

	(void)put_on_wire(l, to, &p); /* who hears no answer asks again */
}

/* Who loads its scene or waits for others says nothing for long: only the wire knows who is there. */
static bool free_place(struct link_peers *l, uint16_t process)
{
	const struct link_session *s = &l->session[process];

	return s->peer.state != LINK_PEER_JOINED || !l->wire->alive(l, &s->address);
}

/* Somebody else was just offered it. Who asks again, because the head was long in answering, is offered the same. */
static bool is_promised(const struct link_peers *l, const struct link_session *s, const struct link_address *from)
{
	const bool own = s->next_address.n == from->n && !memcmp(s->next_address.bytes, from->bytes, from->n);

	return s->next_session && !own && now_ns(l) - s->offered_ns <= PROMISED_NS;
}

static uint16_t find_place(struct link_peers *l, const struct link_address *from, uint16_t wanted)
{
	if (wanted != BB_LINK_ANY)
		return wanted > 0 && wanted < l->group.n_processes && free_place(l, wanted) ? wanted : 0;
	for (uint16_t i = 1; i < l->group.n_processes; i++)
		if (free_place(l, i) && !is_promised(l, &l->session[i], from))
			return i;
	return 0;
}

static void hear_join(struct link_peers *l, const struct link_address *from, const struct link_packet *p)
{
	struct link_packet answer = { .kind = LINK_WELCOME, .sent_ns = now_ns(l) };
	struct link_welcome w = { .zero_ns = bb_clock_zero_ns(l->base.dev.clk) };
	struct link_join join;

	if (!link_join_get(p, &join)) {
		refuse(l, &l->counts.malformed, "malformed");
		return;
	}
	const uint16_t place = find_place(l, from, p->process);
	const bool version = !memcmp(join.version_sha256, l->group.version_sha256, sizeof(join.version_sha256));
	const bool config = !memcmp(join.config_sha256, l->group.config_sha256, sizeof(join.config_sha256));
	if (!version || !config || !place) {
		refuse(l, !version ? &l->counts.refused_version : !config ? &l->counts.refused_config : &l->counts.refused_place,
		       !version ? "other version's" : !config ? "other configuration's" : "surplus joiner's");
		answer_refused(l, from, !version ? LINK_OTHER_VERSION : !config ? LINK_OTHER_CONFIG : LINK_NO_PLACE, join.nonce);
		return;
	}
	struct link_session *s = &l->session[place];
	s->next_session = answer.session = ++l->sessions;
	s->next_address = *from;
	s->offered_ns = now_ns(l);
	s->next_pid = join.pid;
	w.nonce = join.nonce;
	w.process = place;
	w.now_ns = now_ns(l) + w.zero_ns;
	memcpy(w.machine, l->machine, sizeof(w.machine));
	link_welcome_put(&w, &answer);
	if (put_on_wire(l, from, &answer) != BB_OK)
		s->next_session = 0;
}

/* ---- joining, the others' side ---- */

static void ask(struct link_peers *l)
{
	struct link_packet p = { .kind = LINK_JOIN, .process = l->group.process, .sent_ns = now_ns(l) };
	struct link_join join = { .pid = (uint32_t)getpid() };

	if (l->asked_ns && now_ns(l) - l->asked_ns < ASK_AGAIN_NS)
		return;
	if (!bb_random_secret(&l->nonce, sizeof(l->nonce)))
		return;
	join.nonce = l->nonce;
	memcpy(join.version_sha256, l->group.version_sha256, sizeof(join.version_sha256));
	memcpy(join.config_sha256, l->group.config_sha256, sizeof(join.config_sha256));
	link_join_put(&join, &p);
	l->asked_ns = now_ns(l);
	if (put_on_wire(l, &l->session[0].address, &p) == BB_ERR_LOST)
		l->session[0].peer.state = LINK_PEER_LOST;
}

static void hear_welcome(struct link_peers *l, const struct link_packet *p)
{
	struct link_session *s = &l->session[0];
	struct link_welcome w;

	if (!link_welcome_get(p, &w) || s->peer.state == LINK_PEER_JOINED || w.nonce != l->nonce || !l->asked_ns ||
	    (l->group.process != BB_LINK_ANY && w.process != l->group.process) || w.process >= l->group.n_processes) {
		refuse(l, &l->counts.stale, "stale");
		return;
	}
	const int64_t zero_ns = bb_clock_zero_ns(l->base.dev.clk), round_ns = now_ns(l) - l->asked_ns;
	l->group.process = w.process;
	l->uncertainty_ns = 0;
	l->head_zero_ns = w.zero_ns;
	if (memcmp(w.machine, l->machine, sizeof(w.machine))) { /* Cristian: the answer was made half way */
		l->uncertainty_ns = round_ns / 2;
		l->head_zero_ns = w.zero_ns - (w.now_ns - (zero_ns + l->asked_ns + round_ns / 2));
	}
	s->session = p->session;
	s->number_in = s->number_out = 0;
	s->peer.state = LINK_PEER_JOINED;
	s->peer.joins++;
	s->peer.heard_ns = now_ns(l);
	say_kind(l, 0, LINK_HELLO);
}

static void hear(struct link_peers *l, const struct link_address *from, const struct link_packet *p)
{
	const bool head = link_peers_is_head(l);

	if (p->kind == LINK_JOIN && head)
		hear_join(l, from, p);
	else if (p->kind == LINK_WELCOME && !head)
		hear_welcome(l, p);
	else if (p->kind == LINK_REFUSED && !head && p->number == l->nonce && l->asked_ns && p->n_bytes == 1 &&
	         l->session[0].peer.state == LINK_PEER_ABSENT && p->bytes[0] > LINK_FINE && p->bytes[0] < LINK_REASONS)
		l->refusal = (enum link_reason)p->bytes[0];
	else if (p->kind == LINK_DATA || p->kind == LINK_HELLO || p->kind == LINK_BYE)
		hear_session(l, p);
	else
		refuse(l, &l->counts.stale, "unexpected");
}

/* Everything that has come, so that one flood of packets cannot hold the process for ever: a queue's worth each. */
static void pump(struct link_peers *l)
{
	uint8_t bytes[LINK_PACKET_MAX + 1];
	struct link_address from;
	struct link_packet p;
	size_t n = 0;

	if (l->group.n_processes <= 1)
		return;
	if (!link_peers_is_head(l) && l->session[0].peer.state == LINK_PEER_ABSENT && !l->refusal)
		ask(l);
	for (size_t i = 0; i < (size_t)l->group.n_processes * LINK_QUEUE && (n = l->wire->receive(l, &from, bytes, sizeof(bytes))); i++)
		switch (link_packet_get(l->seal, bytes, n <= sizeof(bytes) ? n : sizeof(bytes), &p)) {
		case LINK_WHOLE: hear(l, &from, &p); break;
		case LINK_TRUNCATED: refuse(l, &l->counts.truncated, "truncated"); break;
		case LINK_MALFORMED: refuse(l, &l->counts.malformed, "malformed"); break;
		case LINK_FORGED: refuse(l, &l->counts.forged, "forged"); break;
		}
}

/* Instead of sleeping: until a message has armed a timer, or the time has come. */
static void wait(void *ctx, int64_t until_ns)
{
	struct link_peers *l = ctx;
	const int64_t zero_ns = bb_clock_zero_ns(l->base.dev.clk), next_ns = bb_clock_next_ns(l->base.dev.clk);

	pump(l);
	if (bb_clock_next_ns(l->base.dev.clk) < next_ns)
		return;
	if (!link_peers_is_head(l) && l->session[0].peer.state == LINK_PEER_ABSENT && now_ns(l) + zero_ns + ASK_AGAIN_NS < until_ns)
		until_ns = now_ns(l) + zero_ns + ASK_AGAIN_NS;
	l->wire->wait(l, until_ns);
	pump(l);
}

/* ---- the link class ---- */

void link_peers_key(const struct link_peers *l, const char *purpose, uint8_t out[32])
{
	struct bb_hash h;

	memset(out, 0, BB_HASH_BYTES);
	if (!bb_hash_init(&h))
		return;
	bb_hash_update(&h, "blackburst link 1", 18);
	bb_hash_update(&h, purpose, strlen(purpose) + 1);
	bb_hash_update(&h, l->group.secret, sizeof(l->group.secret));
	bb_hash_final(&h, out);
}

/* The kernel's name of this boot of this machine; zeros where it has none, which makes all machines others. */
static void machine_name(uint8_t out[16])
{
	const int fd = open("/proc/sys/kernel/random/boot_id", O_RDONLY | O_CLOEXEC);
	uint8_t text[64], hash[BB_HASH_BYTES];
	const ssize_t n = fd >= 0 ? read(fd, text, sizeof(text)) : 0;

	if (fd >= 0)
		close(fd);
	bb_hash_bytes(text, n > 0 ? (size_t)n : 0, hash);
	if (n <= 0 && !bb_random_secret(hash, sizeof(hash)))
		memset(hash, 0, sizeof(hash));
	memcpy(out, hash, 16);
}

static enum bb_status take_memory(struct link_peers *l)
{
	const size_t n_nodes = (size_t)l->base.config.n_nodes;

	l->session = calloc(l->group.n_processes, sizeof(*l->session));
	l->queue = calloc(n_nodes, sizeof(*l->queue));
	if (!l->session || !l->queue)
		return BB_ERR_NOMEM;
	for (size_t i = 0; i < n_nodes; i++) {
		/* A process that takes any place learns later which nodes are its own. */
		l->queue[i].message = is_local(l, (uint16_t)i) || l->group.process == BB_LINK_ANY
					      ? calloc(LINK_QUEUE, sizeof(*l->queue[i].message)) : NULL;
		if (!l->queue[i].message && (is_local(l, (uint16_t)i) || l->group.process == BB_LINK_ANY))
			return BB_ERR_NOMEM;
	}
	return BB_OK;
}

static enum bb_status check(struct link_peers *l)
{
	const struct bb_link_config *c = &l->base.config;

	if (c->group)
		l->group = *c->group;
	else
		l->group.n_processes = 1;
	if (c->n_nodes < 1 || c->n_nodes > BB_LINK_NODES_MAX)
		return bb_device_fail(&l->base.dev, BB_ERR_RANGE, "open", "%lld nodes", (long long)c->n_nodes);
	if (!l->group.n_processes || l->group.n_processes > LINK_PROCESSES_MAX ||
	    (l->group.process >= l->group.n_processes && l->group.process != BB_LINK_ANY))
		return bb_device_fail(&l->base.dev, BB_ERR_RANGE, "open", "process %u of %u", l->group.process,
		                      l->group.n_processes);
	for (int64_t i = 0; i < c->n_nodes; i++)
		if (l->group.home[i] >= l->group.n_processes)
			return bb_device_fail(&l->base.dev, BB_ERR_RANGE, "open", "node %lld has no process", (long long)i);
	return BB_OK;
}

enum bb_status link_peers_open(struct link_peers *l, const struct link_wire_ops *wire)
{
	enum bb_status status = check(l);
	uint8_t key[32];

	l->wire = wire;
	l->base.limits = (struct bb_link_limits){ .most_bytes = BB_LINK_MESSAGE_MAX };
	l->log_second = -1;
	machine_name(l->machine);
	if (status == BB_OK)
		status = take_memory(l);
	if (status != BB_OK)
		return status;
	link_peers_key(l, "seal", key);
	if (!bb_seal_create(key, &l->seal) || !bb_random_secret(&l->sessions, sizeof(l->sessions)))
		return BB_ERR_NOMEM;
	l->sessions >>= 1; /* room to count upwards */
	if (l->group.n_processes > 1)
		bb_clock_wait_by(l->base.dev.clk, wait, l);
	return BB_OK;
}

void link_peers_close(struct link_peers *l)
{
	for (uint16_t i = 0; l->session && l->seal && i < l->group.n_processes; i++)
		if (l->session[i].peer.state == LINK_PEER_JOINED)
			say_kind(l, i, LINK_BYE);
	if (l->group.n_processes > 1)
		bb_clock_wait_by(l->base.dev.clk, NULL, NULL);
	for (int64_t i = 0; l->queue && i < l->base.config.n_nodes; i++)
		free(l->queue[i].message);
	free(l->queue);
	free(l->session);
	bb_seal_destroy(l->seal);
	l->queue = NULL;
	l->session = NULL;
	l->seal = NULL;
}

enum bb_status link_peers_send(struct bb_link *base, uint16_t from, uint16_t to, const void *bytes, size_t n)
{
	struct link_peers *l = own(base);
	struct bb_link_message m = { .from = from, .to = to, .sent_ns = now_ns(l), .n_bytes = n };

	if (!is_local(l, from))
		return BB_ERR_RANGE;
	m.arrived_ns = m.sent_ns;
	memcpy(m.bytes, bytes, n);
	if (to != BB_LINK_ALL) {
		send_one(l, &m);
		return BB_OK;
	}
	for (m.to = 0; m.to < base->config.n_nodes; m.to++)
		if (m.to != from)
			send_one(l, &m);
	return BB_OK;
}

enum bb_status link_peers_receive(struct bb_link *base, uint16_t node, struct bb_link_message *out)
{
	struct link_peers *l = own(base);
	struct link_queue *q = &l->queue[node];

	if (!is_local(l, node))
		return BB_ERR_RANGE;
	if (!q->n)
		pump(l);
	if (!q->n)
		return BB_TIMEOUT;
	*out = q->message[q->first];
	q->first = (q->first + 1) % LINK_QUEUE;
	q->n--;
	return BB_OK;
}

enum bb_status link_peers_notify(struct bb_link *base, uint16_t node, struct bb_timer *timer)
{
	struct link_peers *l = own(base);

	if (!is_local(l, node))
		return BB_ERR_RANGE;
	l->queue[node].notify = timer;
	/* What came before anybody asked to be woken. */
	return timer && l->queue[node].n ? bb_clock_arm(base->dev.clk, timer, now_ns(l)) : BB_OK;
}

/* ---- for users ---- */

const char *link_address(const struct bb_link *l)
{
	return seen(l)->address;
}

struct link_counts link_counts(const struct bb_link *l)
{
	return seen(l)->counts;
}

struct link_peer link_peer(const struct bb_link *l, uint16_t process)
{
	return process < seen(l)->group.n_processes ? seen(l)->session[process].peer : (struct link_peer){ 0 };
}

void link_look_after(struct bb_link *base)
{
	struct link_peers *l = own(base);
	const uint16_t n = link_peers_is_head(l) ? l->group.n_processes : 1;

	pump(l);
	for (uint16_t i = link_peers_is_head(l); i < n; i++) {
		if (l->session[i].peer.state != LINK_PEER_JOINED)
			continue;
		say_kind(l, i, LINK_HELLO);
		if (!l->wire->alive(l, &l->session[i].address))
			lose(l, i, false);
	}
}

enum bb_status link_joined(struct bb_link *base)
{
	struct link_peers *l = own(base);

	pump(l);
	if (link_peers_is_head(l))
		return BB_ERR_UNSUPPORTED;
	if (l->refusal)
		return BB_ERR_REFUSED;
	return l->session[0].peer.state == LINK_PEER_JOINED ? BB_OK
	       : l->session[0].peer.state == LINK_PEER_LOST ? BB_ERR_LOST : BB_TIMEOUT;
}

enum link_reason link_refusal(const struct bb_link *l)
{
	return seen(l)->refusal;
}

uint16_t link_process(const struct bb_link *l)
{
	return seen(l)->group.process;
}

int64_t link_head_zero_ns(const struct bb_link *l, int64_t *uncertainty_ns)
{
	*uncertainty_ns = seen(l)->uncertainty_ns;
	return seen(l)->head_zero_ns;
}
