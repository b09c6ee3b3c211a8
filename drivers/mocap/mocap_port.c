/* drivers/mocap/mocap_port.c: sockets; see mocap_port.h. */
#define _GNU_SOURCE /* accept4, ppoll */
#include "drivers/mocap/mocap_port.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/mocap/natnet_server.h"
#include "drivers/mocap/vrpn.h"

#define DATAGRAMS_PER_STEP 64 /* of each socket: who floods us does not hold us up */
#define LOBS_PER_S 4
#define STALL_NS (10 * BB_NS_PER_S)

enum { WAY_COMMAND, WAY_DATA, WAYS };

struct connection {
	int fd;                  /* -1: free */
	int64_t moved_ns;        /* when something could be sent last, or nothing was to be */
	struct vrpn_session session;
};

struct bb_mocap {
	struct bb_mocap_config config;
	uint32_t allow[MOCAP_ALLOW_MAX]; /* network order; none: loopback only */
	size_t n_allow;
	int udp[WAYS];
	struct natnet_server *natnet;
	int listener, lobs;
	int64_t lob_ns;          /* when the next call back may be made */
	struct connection connection[MOCAP_VRPN_MAX];
	struct mocap_frame last; /* before this one, for velocities */
	bool has_last;
	struct bb_mocap_counts counts;
	uint8_t in[NATNET_DATAGRAM_MOST], out[NATNET_DATAGRAM_MOST];
};

/* ---- who may ---- */

static bool loopback(uint32_t ip)
{
	return ntohl(ip) >> 24 == 127;
}

static bool allowed(const struct bb_mocap *m, uint32_t ip)
{
	for (size_t i = 0; i < m->n_allow; i++)
		if (m->allow[i] == ip)
			return true;
	return loopback(ip); /* the kernel drops what claims to be and came from outside */
}

static enum bb_status address_of(const char *text, uint32_t *ip, struct bb_error *err)
{
	if (inet_pton(AF_INET, text, ip) == 1)
		return BB_OK;
	return bb_fail(err, BB_ERR_USAGE, 1760, NULL, "'%.60s' is no numeric IPv4 address", text);
}

static enum bb_status read_allowed(struct bb_mocap *m, uint32_t bind_ip, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < m->config.n_allow && i < MOCAP_ALLOW_MAX && status == BB_OK; i++)
		status = address_of(m->config.allow[i], &m->allow[m->n_allow++], err);
	if (status == BB_OK && !loopback(bind_ip) && !m->n_allow)
		status = bb_fail(err, BB_ERR_USAGE, 1761, NULL, "%.60s is not loopback", m->config.bind);
	return status;
}

/* ---- opening ---- */

static enum bb_status open_socket(int kind, uint32_t ip, uint16_t *port, int *fd, struct bb_error *err)
{
	struct sockaddr_in a = { .sin_family = AF_INET, .sin_port = htons(*port), .sin_addr = { ip } };
	socklen_t n = sizeof(a);
	const int on = 1;
	char text[INET_ADDRSTRLEN];

	*fd = socket(AF_INET, kind | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (*fd >= 0 && (kind != SOCK_STREAM || setsockopt(*fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on)) == 0) &&
	    bind(*fd, (const struct sockaddr *)&a, n) == 0 && (kind != SOCK_STREAM || listen(*fd, MOCAP_VRPN_MAX) == 0) &&
	    getsockname(*fd, (struct sockaddr *)&a, &n) == 0) {
		*port = ntohs(a.sin_port);
		return BB_OK;
	}
	return bb_fail(err, BB_ERR_IO, 1760, NULL, "%s %s port %u: %s", kind == SOCK_STREAM ? "TCP" : "UDP",
	               inet_ntop(AF_INET, &ip, text, sizeof(text)), *port, strerror(errno));
}

/* The group is named by the protocol; which way it goes must be said, or it would go where the routing table says. */
static enum bb_status go_multicast(struct bb_mocap *m, struct bb_error *err)
{
	struct in_addr way = { 0 };
	const uint8_t ttl = 1, loop = 1;
	const enum bb_status status = address_of(m->config.multicast, &way.s_addr, err);

	if (status != BB_OK)
		return status;
	if (setsockopt(m->udp[WAY_DATA], IPPROTO_IP, IP_MULTICAST_IF, &way, sizeof(way)) == 0 &&
	    setsockopt(m->udp[WAY_DATA], IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof(ttl)) == 0 &&
	    setsockopt(m->udp[WAY_DATA], IPPROTO_IP, IP_MULTICAST_LOOP, &loop, sizeof(loop)) == 0)
		return BB_OK;
	return bb_fail(err, BB_ERR_IO, 1760, NULL, "multicast by %.60s: %s", m->config.multicast, strerror(errno));
}

static enum bb_status open_natnet(struct bb_mocap *m, uint32_t ip, struct bb_error *err)
{
	struct bb_mocap_config *c = &m->config;
	enum bb_status status = open_socket(SOCK_DGRAM, ip, &c->command_port, &m->udp[WAY_COMMAND], err);
	struct natnet_server_config server = { .model = c->model, .multicast = c->multicast != NULL };

	if (status == BB_OK)
		status = open_socket(SOCK_DGRAM, ip, &c->data_port, &m->udp[WAY_DATA], err);
	if (status == BB_OK && c->multicast)
		status = go_multicast(m, err);
	/* The group's members listen at the port of the protocol, which is not ours: ours may be taken by one of them. */
	server.data_port = c->multicast ? NATNET_DATA_PORT : c->data_port;
	if (status == BB_OK && !natnet_server_create(&server, &m->natnet))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the NatNet server");
	return status;
}

/* Lobs come by UDP to the port that listens for TCP. Without them "tcp://" clients are served all the same. */
static enum bb_status open_vrpn(struct bb_mocap *m, uint32_t ip, struct bb_error *err)
{
	enum bb_status status = open_socket(SOCK_STREAM, ip, &m->config.vrpn_port, &m->listener, err);
	uint16_t same = m->config.vrpn_port;

	if (status == BB_OK)
		status = open_socket(SOCK_DGRAM, ip, &same, &m->lobs, err);
	return status;
}

enum bb_status bb_mocap_open(const struct bb_mocap_config *config, struct bb_mocap **out, struct bb_error *err)
{
	struct bb_mocap *m = calloc(1, sizeof(*m));
	uint32_t ip = 0;

	*out = NULL;
	if (!m)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the tracking servers");
	m->config = *config;
	m->udp[WAY_COMMAND] = m->udp[WAY_DATA] = m->listener = m->lobs = -1;
	for (size_t i = 0; i < MOCAP_VRPN_MAX; i++)
		m->connection[i].fd = -1;
	enum bb_status status = address_of(config->bind ? config->bind : "127.0.0.1", &ip, err);
	if (status == BB_OK)
		status = read_allowed(m, ip, err);
	if (status == BB_OK && config->natnet)
		status = open_natnet(m, ip, err);
	if (status == BB_OK && config->vrpn)
		status = open_vrpn(m, ip, err);
	if (status != BB_OK) {
		bb_mocap_close(m);
		return status;
	}
	*out = m;
	return BB_OK;
}

static void close_fd(int fd)
{
	if (fd >= 0)
		close(fd);
}

void bb_mocap_close(struct bb_mocap *m)
{
	if (!m)
		return;
	for (size_t i = 0; i < MOCAP_VRPN_MAX; i++)
		close_fd(m->connection[i].fd);
	close_fd(m->udp[WAY_COMMAND]);
	close_fd(m->udp[WAY_DATA]);
	close_fd(m->listener);
	close_fd(m->lobs);
	natnet_server_destroy(m->natnet);
	free(m);
}

struct bb_mocap_ports bb_mocap_ports(const struct bb_mocap *m)
{
	return (struct bb_mocap_ports){ m->config.natnet ? m->config.command_port : 0,
		                        m->config.natnet ? m->config.data_port : 0, m->config.vrpn ? m->config.vrpn_port : 0 };
}

/* ---- NatNet ---- */

static void send_to(struct bb_mocap *m, const struct natnet_address *to, const uint8_t *bytes, size_t n)
{
	const struct sockaddr_in a = { .sin_family = AF_INET, .sin_port = to->port, .sin_addr = { to->ip } };

	/* A full socket buffer drops the datagram, as a network would. */
	if (n && sendto(m->udp[to->way], bytes, n, MSG_DONTWAIT | MSG_NOSIGNAL, (const struct sockaddr *)&a, sizeof(a)) >= 0)
		m->counts.natnet_sent++;
}

static void hear_natnet(struct bb_mocap *m, uint8_t way, int64_t now_ns)
{
	for (int i = 0; i < DATAGRAMS_PER_STEP; i++) {
		struct sockaddr_in a = { 0 };
		socklen_t n_a = sizeof(a);
		const ssize_t n = recvfrom(m->udp[way], m->in, sizeof(m->in), MSG_DONTWAIT, (struct sockaddr *)&a, &n_a);
		if (n < 0 && (errno == ECONNREFUSED || errno == EINTR)) /* a client that is gone says so by ICMP */
			continue;
		if (n < 0)
			return;
		const struct natnet_address from = { a.sin_addr.s_addr, a.sin_port, way };
		if (n_a != sizeof(a) || !a.sin_port || !allowed(m, from.ip)) {
			m->counts.natnet_refused++;
			continue;
		}
		const size_t said = natnet_server_hear(m->natnet, &from, m->in, (size_t)n, now_ns, m->out, sizeof(m->out));
		send_to(m, &from, m->out, said);
	}
}

static void step_natnet(struct bb_mocap *m, int64_t now_ns)
{
	struct natnet_address gone;
	size_t n;

	hear_natnet(m, WAY_COMMAND, now_ns);
	hear_natnet(m, WAY_DATA, now_ns);
	while ((n = natnet_server_expire(m->natnet, now_ns, &gone, m->out, sizeof(m->out))) > 0)
		send_to(m, &gone, m->out, n);
}

static void send_frame(struct bb_mocap *m, const struct mocap_frame *frame)
{
	const uint8_t *bytes;
	const size_t n = natnet_server_frame(m->natnet, frame, &bytes);
	struct natnet_address group = { .port = htons(NATNET_DATA_PORT), .way = WAY_DATA };
	const struct natnet_address *to;

	if (m->config.multicast && inet_pton(AF_INET, NATNET_MULTICAST, &group.ip) == 1)
		send_to(m, &group, bytes, n);
	for (size_t i = 0; (to = natnet_server_client(m->natnet, i)); i++)
		send_to(m, to, bytes, n);
}

/* ---- VRPN ---- */

static void drop(struct connection *c)
{
	close(c->fd);
	c->fd = -1;
}

static void adopt(struct bb_mocap *m, int fd, int64_t now_ns)
{
	const int on = 1, most = VRPN_OUT_BYTES;

	for (size_t i = 0; i < MOCAP_VRPN_MAX; i++) {
		struct connection *c = &m->connection[i];
		if (c->fd >= 0)
			continue;
		c->fd = fd;
		c->moved_ns = now_ns;
		(void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on)); /* a pose is not to wait for the next one */
		/* Nor behind the minute of old ones that would fit the kernel's megabytes. */
		(void)setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &most, sizeof(most));
		vrpn_session_begin(&c->session, &m->config.model, now_ns);
		m->counts.vrpn_connections++;
		return;
	}
	m->counts.vrpn_refused++;
	close(fd);
}

static void accept_all(struct bb_mocap *m, int64_t now_ns)
{
	for (int i = 0; i < MOCAP_VRPN_MAX; i++) {
		struct sockaddr_in a = { 0 };
		socklen_t n = sizeof(a);
		const int fd = accept4(m->listener, (struct sockaddr *)&a, &n, SOCK_CLOEXEC | SOCK_NONBLOCK);
		if (fd < 0)
			return;
		if (allowed(m, a.sin_addr.s_addr)) {
			adopt(m, fd, now_ns);
		} else {
			m->counts.vrpn_refused++;
			close(fd);
		}
	}
}

/* Called back is only who asks for himself. */
static void call_back(struct bb_mocap *m, int64_t now_ns)
{
	for (int i = 0; i < DATAGRAMS_PER_STEP; i++) {
		struct sockaddr_in a = { 0 };
		socklen_t n_a = sizeof(a);
		uint32_t ip = 0;
		uint16_t port = 0;
		const ssize_t n = recvfrom(m->lobs, m->in, VRPN_LOB_MOST, MSG_DONTWAIT, (struct sockaddr *)&a, &n_a);
		if (n < 0)
			return;
		const bool fair = vrpn_lob_read(m->in, (size_t)n, &ip, &port) && ip == a.sin_addr.s_addr && allowed(m, ip);
		if (!fair || now_ns < m->lob_ns) {
			m->counts.vrpn_refused++;
			continue;
		}
		m->lob_ns = now_ns + BB_NS_PER_S / LOBS_PER_S;
		a.sin_port = htons(port);
		const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
		if (fd >= 0 && (connect(fd, (const struct sockaddr *)&a, n_a) == 0 || errno == EINPROGRESS))
			adopt(m, fd, now_ns);
		else
			close_fd(fd);
	}
}

static bool listen_to(struct bb_mocap *m, struct connection *c, int64_t now_ns)
{
	for (int i = 0; i < 4; i++) {
		const ssize_t n = recv(c->fd, m->in, VRPN_MESSAGE_MOST, MSG_DONTWAIT);
		if (n < 0)
			return errno == EAGAIN || errno == EINTR || errno == ENOTCONN; /* not connected: called back, not there yet */
		if (n == 0 || !vrpn_session_take(&c->session, m->in, (size_t)n, now_ns))
			return false;
	}
	return true;
}

static bool speak_to(struct connection *c, int64_t now_ns)
{
	while (c->session.n_out) {
		const ssize_t n = send(c->fd, c->session.out, c->session.n_out, MSG_DONTWAIT | MSG_NOSIGNAL);
		if (n < 0)
			return errno == EAGAIN || errno == EINTR || errno == ENOTCONN;
		vrpn_session_sent(&c->session, (size_t)n);
		c->moved_ns = now_ns;
	}
	c->moved_ns = now_ns;
	return true;
}

static void step_vrpn(struct bb_mocap *m, int64_t now_ns)
{
	accept_all(m, now_ns);
	call_back(m, now_ns);
	for (size_t i = 0; i < MOCAP_VRPN_MAX; i++) {
		struct connection *c = &m->connection[i];
		if (c->fd < 0)
			continue;
		if (!listen_to(m, c, now_ns) || !speak_to(c, now_ns) || now_ns - c->moved_ns > STALL_NS ||
		    (!c->session.greeted && now_ns - c->session.began_ns > VRPN_HANDSHAKE_NS))
			drop(c);
	}
}

static void tell_frame(struct bb_mocap *m, const struct mocap_frame *frame, int64_t now_ns)
{
	for (size_t i = 0; i < MOCAP_VRPN_MAX; i++) {
		struct connection *c = &m->connection[i];
		if (c->fd < 0)
			continue;
		const uint64_t poses = c->session.poses, dropped = c->session.dropped;
		vrpn_session_frame(&c->session, frame, m->has_last ? &m->last : NULL);
		m->counts.vrpn_poses += c->session.poses - poses;
		m->counts.vrpn_dropped += c->session.dropped - dropped;
		if (!speak_to(c, now_ns))
			drop(c);
	}
}

/* ---- both ---- */

void bb_mocap_step(struct bb_mocap *m, int64_t now_ns)
{
	if (m->config.natnet)
		step_natnet(m, now_ns);
	if (m->config.vrpn)
		step_vrpn(m, now_ns);
}

void bb_mocap_frame(struct bb_mocap *m, const struct mocap_frame *frame, int64_t now_ns)
{
	struct mocap_frame f = *frame;

	f.sent_ns = now_ns;
	m->counts.frames++;
	if (m->config.natnet)
		send_frame(m, &f);
	if (m->config.vrpn)
		tell_frame(m, &f, now_ns);
	m->last = f;
	m->has_last = true;
}

bool bb_mocap_wait(struct bb_mocap *m, int64_t most_ns, int other_fd)
{
	struct pollfd fds[5 + MOCAP_VRPN_MAX];
	const int own[] = { m->udp[WAY_COMMAND], m->udp[WAY_DATA], m->listener, m->lobs };
	const struct timespec most = { most_ns / BB_NS_PER_S, most_ns % BB_NS_PER_S };
	nfds_t n = 0;

	fds[n++] = (struct pollfd){ .fd = other_fd, .events = POLLIN }; /* -1 is passed over, as below */
	for (size_t i = 0; i < BB_ARRAY_LEN(own); i++)
		fds[n++] = (struct pollfd){ .fd = own[i], .events = POLLIN };
	for (size_t i = 0; i < MOCAP_VRPN_MAX; i++)
		fds[n++] = (struct pollfd){ .fd = m->connection[i].fd,
			                    .events = (short)(m->connection[i].session.n_out ? POLLIN | POLLOUT : POLLIN) };
	return ppoll(fds, n, &most, NULL) > 0 && (fds[0].revents & POLLIN);
}

struct bb_mocap_counts bb_mocap_counts(const struct bb_mocap *m)
{
	struct bb_mocap_counts c = m->counts;

	if (m->natnet) {
		const struct natnet_counts *n = natnet_server_counts(m->natnet);
		c.natnet_heard = n->heard;
		c.natnet_refused += n->malformed + n->beyond_rate + n->refused_clients;
	}
	return c;
}
