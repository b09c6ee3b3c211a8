/*
 * drivers/link/zmq.c: packets over ZeroMQ between machines; the only file that knows the library. The head is a ROUTER
 * that listens, the others are DEALERs that connect. CURVE (libzmq's security of that name) encrypts; both sides' keys
 * come from the group's secret, and the head admits one client key only, so that who lacks the secret gets no further
 * than the handshake (ZeroMQ RFC 27, ZAP). "zmq:tcp://127.0.0.1:5570"; port 0 or none is any free one for the head.
 * Another address than loopback needs the option "open=1".
 */
#define _GNU_SOURCE
#include "drivers/link/peers.h"

#include <arpa/inet.h>
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <zmq.h>

#define KEY_BYTES 32
#define QUEUED 256             /* packets each way and far end */
#define CURVE_BYTES 64         /* and more than an encrypted message adds */
#define HANDSHAKE_MS 1000
#define HANDSHAKE_FAILED (ZMQ_EVENT_HANDSHAKE_FAILED_NO_DETAIL | ZMQ_EVENT_HANDSHAKE_FAILED_PROTOCOL | ZMQ_EVENT_HANDSHAKE_FAILED_AUTH)
#define HEARTBEAT_MS 500
#define TAKE_PARTS 8           /* of one message at most are looked at; ours have two */

struct link_zmq {
	struct link_peers peers;
	void *context, *socket;
	void *zap, *watch;         /* head: who wants in; who was turned away in the handshake */
	uint8_t client_public[KEY_BYTES];
	struct link_address lost[LINK_PROCESSES_MAX]; /* the ROUTER no longer knows them */
	size_t n_lost;
};

static struct link_zmq *own(struct link_peers *l)
{
	return bb_container_of(l, struct link_zmq, peers);
}

/* ---- packets ---- */

static bool same(const struct link_address *a, const struct link_address *b)
{
	return a->n == b->n && !memcmp(a->bytes, b->bytes, a->n);
}

static bool wire_alive(struct link_peers *l, const struct link_address *far)
{
	const struct link_zmq *z = own(l);

	for (size_t i = 0; i < z->n_lost; i++)
		if (same(&z->lost[i], far))
			return false;
	return true;
}

static void note_lost(struct link_zmq *z, const struct link_address *far)
{
	if (!wire_alive(&z->peers, far))
		return;
	if (z->n_lost == BB_ARRAY_LEN(z->lost))
		memmove(&z->lost[0], &z->lost[1], --z->n_lost * sizeof(z->lost[0]));
	z->lost[z->n_lost++] = *far;
}

static enum bb_status wire_send(struct link_peers *l, const struct link_address *to, const uint8_t *bytes, size_t n)
{
	struct link_zmq *z = own(l);
	int code = 0;

	if (link_peers_is_head(l))
		code = zmq_send(z->socket, to->bytes, to->n, ZMQ_DONTWAIT | ZMQ_SNDMORE);
	if (code >= 0)
		code = zmq_send(z->socket, bytes, n, ZMQ_DONTWAIT);
	if (code >= 0)
		return BB_OK;
	if (zmq_errno() == EHOSTUNREACH) {
		note_lost(z, to);
		return BB_ERR_LOST;
	}
	return zmq_errno() == EAGAIN ? BB_ERR_BUSY : BB_ERR_IO;
}

static bool more(void *socket)
{
	int yes = 0;
	size_t n = sizeof(yes);

	return zmq_getsockopt(socket, ZMQ_RCVMORE, &yes, &n) == 0 && yes;
}

/* One part; 0 bytes for none. A part longer than cap says so by its length. */
static size_t part(void *socket, void *bytes, size_t cap)
{
	const int n = zmq_recv(socket, bytes, cap, ZMQ_DONTWAIT);

	return n > 0 ? (size_t)n : 0;
}

static void drop_rest(void *socket)
{
	uint8_t unused[64];

	for (int i = 0; i < TAKE_PARTS && more(socket); i++)
		part(socket, unused, sizeof(unused));
}

/* ZAP: the library asks who may come in; only who made the client key from the secret. */
static void answer_zap(struct link_zmq *z)
{
	uint8_t version[16], id[64], rest[256], key[KEY_BYTES + 1];
	size_t n_version, n_id, n_key = 0;

	while ((n_version = part(z->zap, version, sizeof(version)))) {
		n_id = more(z->zap) ? part(z->zap, id, sizeof(id)) : 0;
		for (int i = 0; i < 4 && more(z->zap); i++) /* domain, address, identity, mechanism */
			part(z->zap, rest, sizeof(rest));
		n_key = more(z->zap) ? part(z->zap, key, sizeof(key)) : 0;
		drop_rest(z->zap);
		const bool welcome = n_version <= sizeof(version) && n_id <= sizeof(id) && n_key == KEY_BYTES &&
		                     !memcmp(key, z->client_public, KEY_BYTES);
		const char *code = welcome ? "200" : "400";
		if (zmq_send(z->zap, "1.0", 3, ZMQ_SNDMORE) < 0 ||
		    zmq_send(z->zap, id, n_id <= sizeof(id) ? n_id : 0, ZMQ_SNDMORE) < 0 ||
		    zmq_send(z->zap, code, 3, ZMQ_SNDMORE) < 0 || zmq_send(z->zap, "", 0, ZMQ_SNDMORE) < 0 ||
		    zmq_send(z->zap, "", 0, ZMQ_SNDMORE) < 0 || zmq_send(z->zap, "", 0, 0) < 0)
			return;
	}
}

static void note_turned_away(struct link_zmq *z)
{
	uint8_t event[6];

	while (part(z->watch, event, sizeof(event))) {
		drop_rest(z->watch);
		link_peers_forged(&z->peers);
	}
}

static size_t wire_receive(struct link_peers *l, struct link_address *from, uint8_t *bytes, size_t cap)
{
	struct link_zmq *z = own(l);
	uint8_t id[sizeof(from->bytes) + 1];
	size_t n;

	*from = (struct link_address){ 0 };
	if (link_peers_is_head(l)) {
		answer_zap(z);
		note_turned_away(z);
	} else {
		n = part(z->socket, bytes, cap);
		drop_rest(z->socket);
		return n;
	}
	while ((n = part(z->socket, id, sizeof(id)))) {
		const size_t n_bytes = more(z->socket) ? part(z->socket, bytes, cap) : 0;
		drop_rest(z->socket);
		if (n > sizeof(from->bytes))
			continue; /* names the library gives have five bytes */
		from->n = (uint8_t)n;
		memcpy(from->bytes, id, n);
		return n_bytes ? n_bytes : 1; /* an empty packet is a truncated one */
	}
	return 0;
}

static bool readable(void *socket)
{
	int events = 0;
	size_t n = sizeof(events);

	return socket && zmq_getsockopt(socket, ZMQ_EVENTS, &events, &n) == 0 && events & ZMQ_POLLIN;
}

static int descriptor(void *socket)
{
	int fd = -1;
	size_t n = sizeof(fd);

	return socket && zmq_getsockopt(socket, ZMQ_FD, &fd, &n) == 0 ? fd : -1;
}

/* zmq_poll counts in milliseconds; the library's descriptors wake by edges, so the sockets are asked first. */
static void wire_wait(struct link_peers *l, int64_t until_ns)
{
	struct link_zmq *z = own(l);
	struct pollfd fds[2] = { { .fd = descriptor(z->socket), .events = POLLIN },
		                 { .fd = descriptor(z->zap), .events = POLLIN } };

	for (;;) {
		const int64_t left_ns = until_ns - bb_clock_stopwatch_ns();
		const struct timespec t = { .tv_sec = left_ns / BB_NS_PER_S, .tv_nsec = left_ns % BB_NS_PER_S };
		if (left_ns <= 0 || readable(z->socket) || readable(z->zap) || ppoll(fds, 2, &t, NULL) <= 0)
			return;
	}
}

static void wire_joined(struct link_peers *l, const struct link_address *far, uint32_t pid)
{
	(void)l;
	(void)far;
	(void)pid;
}

static const struct link_wire_ops wire = { wire_send, wire_receive, wire_alive, wire_wait, wire_joined };

/* ---- open ---- */

static enum bb_status fail(struct link_zmq *z, const char *what)
{
	const int code = zmq_errno();

	return bb_device_fail(&z->peers.base.dev, code == EADDRINUSE ? BB_ERR_BUSY : BB_ERR_IO, "open", "%s: %s", what,
	                      zmq_strerror(code));
}

static bool set(void *socket, int option, int value)
{
	return zmq_setsockopt(socket, option, &value, sizeof(value)) == 0;
}

/* tcp://ADDRESS[:PORT], numbers only: names would ask a resolver whom nobody authenticates. */
static bool is_loopback(const char *endpoint, bool *valid)
{
	char host[64];
	struct in_addr v4;
	struct in6_addr v6;
	int n = 0;

	*valid = sscanf(endpoint, "tcp://[%45[0-9a-fA-F:.]]%n", host, &n) == 1 && n > 0 && inet_pton(AF_INET6, host, &v6) == 1;
	if (*valid)
		return IN6_IS_ADDR_LOOPBACK(&v6);
	*valid = sscanf(endpoint, "tcp://%45[0-9.]", host) == 1 && inet_pton(AF_INET, host, &v4) == 1;
	return *valid && ntohl(v4.s_addr) >> 24 == 127;
}

static bool may_be_open(const struct bb_uri *uri)
{
	for (size_t i = 0; i < uri->n_options; i++)
		if (!strcmp(uri->option[i].key, "open") && !strcmp(uri->option[i].value, "1"))
			return true;
	return false;
}

/* A CURVE key pair: any 32 bytes are a secret key; the library speaks of public ones in Z85. */
static bool key_pair(const struct link_zmq *z, const char *whose, uint8_t secret[KEY_BYTES], uint8_t public[KEY_BYTES])
{
	char secret_text[41], public_text[41];

	link_peers_key(&z->peers, whose, secret);
	return zmq_z85_encode(secret_text, secret, KEY_BYTES) && zmq_curve_public(public_text, secret_text) == 0 &&
	       zmq_z85_decode(public, public_text);
}

static bool secure(struct link_zmq *z)
{
	uint8_t secret[KEY_BYTES], head_public[KEY_BYTES], client_secret[KEY_BYTES];

	if (!key_pair(z, "curve head", secret, head_public) || !key_pair(z, "curve client", client_secret, z->client_public))
		return false;
	if (link_peers_is_head(&z->peers))
		return set(z->socket, ZMQ_CURVE_SERVER, 1) &&
		       zmq_setsockopt(z->socket, ZMQ_CURVE_SECRETKEY, secret, KEY_BYTES) == 0 &&
		       zmq_setsockopt(z->socket, ZMQ_ZAP_DOMAIN, "blackburst", 10) == 0;
	return zmq_setsockopt(z->socket, ZMQ_CURVE_SERVERKEY, head_public, KEY_BYTES) == 0 &&
	       zmq_setsockopt(z->socket, ZMQ_CURVE_PUBLICKEY, z->client_public, KEY_BYTES) == 0 &&
	       zmq_setsockopt(z->socket, ZMQ_CURVE_SECRETKEY, client_secret, KEY_BYTES) == 0;
}

static bool limit(void *socket, bool v6)
{
	return set(socket, ZMQ_LINGER, 100) && set(socket, ZMQ_SNDHWM, QUEUED) && set(socket, ZMQ_RCVHWM, QUEUED) &&
	       set(socket, ZMQ_HANDSHAKE_IVL, HANDSHAKE_MS) && set(socket, ZMQ_HEARTBEAT_IVL, HEARTBEAT_MS) &&
	       set(socket, ZMQ_HEARTBEAT_TIMEOUT, 2 * HEARTBEAT_MS) && set(socket, ZMQ_IPV6, v6) &&
	       zmq_setsockopt(socket, ZMQ_MAXMSGSIZE, &(int64_t){ LINK_PACKET_MAX + CURVE_BYTES }, sizeof(int64_t)) == 0;
}

static enum bb_status listen_at(struct link_zmq *z, const char *endpoint)
{
	char bound[96], any[112];
	size_t n = sizeof(bound);
	const bool has_port = strlen(endpoint) > 6 && strchr(endpoint + 6, ':') &&
	                      (endpoint[6] != '[' || strstr(endpoint, "]:"));

	z->zap = zmq_socket(z->context, ZMQ_REP);
	z->watch = zmq_socket(z->context, ZMQ_PAIR);
	if (!z->zap || !z->watch || !set(z->zap, ZMQ_LINGER, 0) || !set(z->watch, ZMQ_LINGER, 0) ||
	    zmq_socket_monitor(z->socket, "inproc://turned-away", HANDSHAKE_FAILED) ||
	    zmq_connect(z->watch, "inproc://turned-away") || zmq_bind(z->zap, "inproc://zeromq.zap.01"))
		return fail(z, "the door keeper");
	if (!set(z->socket, ZMQ_ROUTER_MANDATORY, 1))
		return fail(z, "the router");
	snprintf(any, sizeof(any), "%s%s", endpoint, has_port ? "" : ":*");
	if (zmq_bind(z->socket, any) || zmq_getsockopt(z->socket, ZMQ_LAST_ENDPOINT, bound, &n))
		return fail(z, any);
	snprintf(z->peers.address, sizeof(z->peers.address), "zmq:%s", bound);
	return BB_OK;
}

static enum bb_status open_sockets(struct link_zmq *z, const struct bb_uri *uri)
{
	const char *endpoint = uri->path[0] ? uri->path : "tcp://127.0.0.1";
	const bool head = link_peers_is_head(&z->peers);
	bool valid;

	if (!is_loopback(endpoint, &valid) && !(valid && may_be_open(uri)))
		return bb_device_fail(&z->peers.base.dev, valid ? BB_ERR_REFUSED : BB_ERR_CONFIG, "open",
		                      valid ? "%s is not loopback" : "%s is not tcp://ADDRESS:PORT in numbers", endpoint);
	z->context = zmq_ctx_new();
	z->socket = z->context ? zmq_socket(z->context, head ? ZMQ_ROUTER : ZMQ_DEALER) : NULL;
	if (!z->socket || !limit(z->socket, strchr(endpoint, '[') != NULL) || !secure(z))
		return fail(z, "the socket");
	if (head)
		return listen_at(z, endpoint);
	return zmq_connect(z->socket, endpoint) ? fail(z, endpoint) : BB_OK;
}

static void zmq_close_link(struct bb_link *l)
{
	struct link_zmq *z = own(bb_container_of(l, struct link_peers, base));

	link_peers_close(&z->peers);
	if (z->socket)
		zmq_close(z->socket);
	if (z->watch)
		zmq_close(z->watch);
	if (z->zap)
		zmq_close(z->zap);
	if (z->context)
		zmq_ctx_term(z->context);
}

static enum bb_status zmq_open_link(struct bb_link *l, const struct bb_open *open)
{
	struct link_zmq *z = own(bb_container_of(l, struct link_peers, base));
	enum bb_status status = link_peers_open(&z->peers, &wire);

	if (status == BB_OK && z->peers.group.n_processes > 1)
		status = open_sockets(z, open->uri);
	if (status != BB_OK)
		zmq_close_link(l);
	return status;
}

static const struct bb_link_ops ops = { zmq_open_link, zmq_close_link, link_peers_send, link_peers_receive, link_peers_notify };
const struct bb_link_driver link_zmq_driver = { "zmq", sizeof(struct link_zmq), &ops };
