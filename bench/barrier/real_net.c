/* bench/barrier/real_net.c: barriers of messages to rank 0 and back: datagrams, and the links a run has. */
#include "bench/barrier/real_impl.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#define SAY_AGAIN_NS (BB_NS_PER_S / 5)
#define TRIES 25

/* ---- datagrams ---- */

static bool udp_begin(struct real_place *p)
{
	struct sockaddr_in at = { .sin_family = AF_INET, .sin_addr = { htonl(INADDR_LOOPBACK) } };
	const struct timeval patience = { .tv_usec = SAY_AGAIN_NS / 1000 };
	socklen_t n = sizeof(at);

	p->socket = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
	if (p->socket < 0 || setsockopt(p->socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience)))
		return false;
	if (p->rank) {
		at.sin_port = p->shared->port;
		return connect(p->socket, (struct sockaddr *)&at, sizeof(at)) == 0;
	}
	if (bind(p->socket, (struct sockaddr *)&at, sizeof(at)) || getsockname(p->socket, (struct sockaddr *)&at, &n))
		return false;
	p->shared->port = at.sin_port;
	return true;
}

/* Rank 0: everyone's word for this round, then the word back. A word for an earlier round: its answer was lost. */
static bool udp_lead(struct real_place *p)
{
	struct sockaddr_in from[BB_REAL_SIZE_MOST] = { 0 }, who = { 0 };
	unsigned have = 0;

	for (int tries = 0; have < p->n - 1 && tries < TRIES;) {
		socklen_t n = sizeof(who);
		uint32_t round, known = 0;
		if (recvfrom(p->socket, &round, sizeof(round), 0, (struct sockaddr *)&who, &n) != sizeof(round)) {
			tries++;
			continue;
		}
		if (round != p->round) {
			if (sendto(p->socket, &round, sizeof(round), 0, (struct sockaddr *)&who, n) < 0)
				return false;
			continue;
		}
		for (unsigned i = 0; i < have; i++)
			known |= from[i].sin_port == who.sin_port;
		if (!known)
			from[have++] = who;
	}
	for (unsigned i = 0; i < have; i++)
		if (sendto(p->socket, &p->round, sizeof(p->round), 0, (struct sockaddr *)&from[i], sizeof(from[i])) < 0)
			return false;
	return have == p->n - 1;
}

static bool udp_follow(struct real_place *p)
{
	for (int tries = 0; tries < TRIES; tries++) {
		uint32_t round = p->round;
		if (send(p->socket, &round, sizeof(round), 0) < 0)
			return false;
		while (recv(p->socket, &round, sizeof(round), 0) == sizeof(round))
			if (round == p->round)
				return true;
	}
	return false;
}

/* ---- links ---- */

static int64_t wake(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct real_place *p = bb_container_of(timer, struct real_place, woken);

	(void)scheduled_ns;
	(void)now_ns;
	bb_clock_stop(p->clk);
	return BB_NEVER;
}

static bool link_begin(struct real_place *p)
{
	struct bb_link_group group = { .process = (uint16_t)p->rank, .n_processes = (uint16_t)p->n };
	const struct bb_link_config config = { .id = "net", .n_nodes = p->n, .group = &group };
	struct bb_open open = { 0 };
	struct bb_uri uri;
	int64_t end_ns;

	memcpy(group.secret, p->shared->secret, sizeof(group.secret));
	for (unsigned i = 0; i < p->n; i++)
		group.home[i] = (uint16_t)i;
	if (bb_clock_posix_create(&p->clk) != BB_OK)
		return false;
	open.clk = p->clk;
	open.uri = &uri;
	const char *address = p->rank ? p->shared->address : p->method == BB_REAL_SHM ? "shm:" : "zmq:tcp://127.0.0.1";
	if (bb_uri_parse(address, &uri, &(struct bb_where){ 0 }, NULL) != BB_OK ||
	    bb_link_open(p->method == BB_REAL_SHM ? &link_shm_driver : &link_zmq_driver, &config, &open, &p->link) != BB_OK)
		return false;
	p->woken = (struct bb_timer){ .step = wake };
	if (bb_link_notify(p->link, (uint16_t)p->rank, &p->woken) != BB_OK)
		return false;
	if (!p->rank)
		snprintf(p->shared->address, sizeof(p->shared->address), "%s", link_address(p->link));
	end_ns = bb_clock_now_ns(p->clk) + 5 * BB_NS_PER_S;
	while (p->rank && link_joined(p->link) != BB_OK && bb_clock_now_ns(p->clk) < end_ns)
		bb_clock_run_until(p->clk, bb_clock_now_ns(p->clk) + BB_NS_PER_S / 1000);
	return !p->rank || link_joined(p->link) == BB_OK;
}

/* The next message of this round (or a later one), from whom; false: none came for a while. */
static bool hear(struct real_place *p, uint16_t *from, uint32_t *round)
{
	const int64_t end_ns = bb_clock_now_ns(p->clk) + SAY_AGAIN_NS;
	struct bb_link_message m;

	while (bb_link_receive(p->link, (uint16_t)p->rank, &m) != BB_OK) {
		if (bb_clock_now_ns(p->clk) >= end_ns)
			return false;
		bb_clock_run_until(p->clk, end_ns);
	}
	memcpy(round, m.bytes, sizeof(*round));
	*from = m.from;
	return true;
}

static bool tell(struct real_place *p, uint16_t to, uint32_t round)
{
	return bb_link_send(p->link, (uint16_t)p->rank, to, &round, sizeof(round)) == BB_OK;
}

static bool link_lead(struct real_place *p)
{
	const uint32_t all = (1U << p->n) - 2;
	uint32_t have = 0, round;
	uint16_t from;

	for (int tries = 0; have != all && tries < TRIES;) {
		if (!hear(p, &from, &round))
			tries++;
		else if (round == p->round)
			have |= 1U << from;
		else if (!tell(p, from, round))
			return false;
	}
	for (unsigned i = 1; i < p->n; i++)
		if (!tell(p, (uint16_t)i, p->round))
			return false;
	return have == all;
}

static bool link_follow(struct real_place *p)
{
	uint32_t round;
	uint16_t from;

	for (int tries = 0; tries < TRIES; tries++) {
		if (!tell(p, 0, p->round))
			return false;
		while (hear(p, &from, &round))
			if (round == p->round)
				return true;
	}
	return false;
}

/* ---- both ---- */

bool real_net_begin(struct real_place *p)
{
	p->socket = -1;
	return p->method == BB_REAL_UDP ? udp_begin(p) : link_begin(p);
}

bool real_net_wait(struct real_place *p)
{
	p->round++;
	if (p->method == BB_REAL_UDP)
		return p->rank ? udp_follow(p) : udp_lead(p);
	return p->rank ? link_follow(p) : link_lead(p);
}

void real_net_end(struct real_place *p)
{
	if (p->socket >= 0)
		close(p->socket);
	bb_link_close(p->link);
	if (p->clk)
		bb_clock_disarm(p->clk, &p->woken);
	bb_clock_destroy(p->clk);
}
