/* sim/wire.c: listeners, ptys and sessions in one poll loop; see sim/wire.h. */
#define _GNU_SOURCE /* accept4, posix_openpt, ptsname_r */
#include "sim/wire.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#define TOKEN_NS BB_NS_PER_S
#define READ_BYTES 512
#define SESSION_BYTES 1024

struct saying {
	int64_t at_ns, gap_ns;
	size_t n, sent;
	uint8_t bytes[SIM_WIRE_SAY_MAX];
};

struct sim_wire_line {
	size_t first, n;
	struct saying queue[SIM_WIRE_QUEUE];
};

struct endpoint {
	int fd;                     /* of the listener; -1 for a pty */
	const struct sim_wire_protocol *protocol;
	void *peer;
	char token[SIM_WIRE_TOKEN_MOST];
};

struct session {
	int fd, slave_fd;           /* slave_fd: held open so that a pty without a client is no error; -1 for TCP */
	const struct endpoint *end;
	bool wants_token, blocked;  /* blocked: the far side does not read */
	size_t n_token;
	int64_t heard_ns, whole_ns; /* last byte; last moment without an unfinished frame */
	struct sim_wire_line line;
	_Alignas(max_align_t) uint8_t state[SESSION_BYTES];
};

struct sim_wire {
	struct bb_clock *clk;
	size_t n_ends;
	struct endpoint ends[SIM_WIRE_ENDPOINTS_MAX];
	size_t n_sessions, n_ptys;
	struct session *sessions[SIM_WIRE_SESSIONS_MAX + SIM_WIRE_ENDPOINTS_MAX];
	size_t n_watched;
	int watched[SIM_WIRE_WATCHED_MAX];
	uint64_t n_refused;
	size_t n_polled;
	struct pollfd polled[2 * SIM_WIRE_ENDPOINTS_MAX + SIM_WIRE_SESSIONS_MAX + SIM_WIRE_WATCHED_MAX];
};

enum bb_status sim_wire_create(struct bb_clock *clk, struct sim_wire **out)
{
	*out = NULL;
	if (bb_clock_is_virtual(clk)) /* a wire has real time at its other end */
		return BB_ERR_USAGE;
	*out = calloc(1, sizeof(**out));
	if (!*out)
		return BB_ERR_NOMEM;
	(*out)->clk = clk;
	return BB_OK;
}

static void end_session(struct sim_wire *w, size_t i)
{
	struct session *s = w->sessions[i];

	if (s->fd >= 0)
		close(s->fd);
	if (s->slave_fd >= 0) {
		close(s->slave_fd);
		w->n_ptys--;
	}
	free(s);
	w->sessions[i] = w->sessions[--w->n_sessions];
}

void sim_wire_destroy(struct sim_wire *w)
{
	if (!w)
		return;
	while (w->n_sessions)
		end_session(w, w->n_sessions - 1);
	for (size_t i = 0; i < w->n_ends; i++)
		if (w->ends[i].fd >= 0)
			close(w->ends[i].fd);
	free(w);
}

/* ---- endpoints ---- */

union address {
	struct sockaddr any;
	struct sockaddr_in v4;
	struct sockaddr_in6 v6;
};

static socklen_t address_of(const char *text, uint16_t port, union address *a)
{
	memset(a, 0, sizeof(*a));
	if (inet_pton(AF_INET, text, &a->v4.sin_addr) == 1) {
		a->v4.sin_family = AF_INET;
		a->v4.sin_port = htons(port);
		return sizeof(a->v4);
	}
	if (inet_pton(AF_INET6, text, &a->v6.sin6_addr) == 1) {
		a->v6.sin6_family = AF_INET6;
		a->v6.sin6_port = htons(port);
		return sizeof(a->v6);
	}
	return 0;
}

bool sim_wire_loopback(const char *address)
{
	union address a;
	const socklen_t n = address_of(address, 0, &a);

	if (n == sizeof(a.v4))
		return ntohl(a.v4.sin_addr.s_addr) >> 24 == 127;
	return n == sizeof(a.v6) && IN6_IS_ADDR_LOOPBACK(&a.v6.sin6_addr);
}

static enum bb_status add_end(struct sim_wire *w, const struct sim_wire_protocol *protocol, void *peer,
                              struct endpoint **out, struct bb_error *err)
{
	if (w->n_ends == SIM_WIRE_ENDPOINTS_MAX || protocol->session_bytes > SESSION_BYTES)
		return bb_fail(err, BB_ERR_RANGE, 1571, NULL, "more than %d endpoints", SIM_WIRE_ENDPOINTS_MAX);
	*out = &w->ends[w->n_ends];
	**out = (struct endpoint){ .fd = -1, .protocol = protocol, .peer = peer };
	return BB_OK;
}

static int listener(const union address *a, socklen_t n)
{
	const int on = 1;
	const int fd = socket(a->any.sa_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

	if (fd < 0)
		return -1;
	if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on)) == 0 && bind(fd, &a->any, n) == 0 &&
	    listen(fd, SIM_WIRE_SESSIONS_MAX) == 0)
		return fd;
	const int why = errno;
	close(fd);
	errno = why;
	return -1;
}

enum bb_status sim_wire_tcp(struct sim_wire *w, const struct sim_wire_listen *at,
                            const struct sim_wire_protocol *protocol, void *peer, uint16_t *port_out,
                            struct bb_error *err)
{
	struct endpoint *end = NULL;
	union address a;
	socklen_t n = address_of(at->address, at->port, &a);

	if (!n)
		return bb_fail(err, BB_ERR_USAGE, 1571, NULL, "'%.60s' is no numeric address", at->address);
	if (at->token && strlen(at->token) >= sizeof(end->token))
		return bb_fail(err, BB_ERR_USAGE, 1572, NULL, "a token of more than %d characters", SIM_WIRE_TOKEN_MOST - 1);
	const enum bb_status status = add_end(w, protocol, peer, &end, err);
	if (status != BB_OK)
		return status;
	snprintf(end->token, sizeof(end->token), "%s", at->token ? at->token : "");
	end->fd = listener(&a, n);
	if (end->fd < 0)
		return bb_fail(err, BB_ERR_IO, 1571, NULL, "%s port %u: %s", at->address, at->port, strerror(errno));
	if (getsockname(end->fd, &a.any, &n) == 0)
		*port_out = ntohs(a.any.sa_family == AF_INET ? a.v4.sin_port : a.v6.sin6_port);
	w->n_ends++;
	return BB_OK;
}

static struct session *begin_session(struct sim_wire *w, const struct endpoint *end, int fd)
{
	struct session *s = calloc(1, sizeof(*s));

	if (!s)
		return NULL;
	s->fd = fd;
	s->slave_fd = -1;
	s->end = end;
	s->wants_token = end->token[0] != '\0';
	s->heard_ns = s->whole_ns = bb_clock_now_ns(w->clk);
	w->sessions[w->n_sessions++] = s;
	return s;
}

/* The terminal's far side: raw from the start, or its echo would answer the peer. */
static int open_slave(int master, char *path, size_t cap)
{
	struct termios t;

	if (grantpt(master) != 0 || unlockpt(master) != 0 || ptsname_r(master, path, cap) != 0)
		return -1;
	const int fd = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
	if (fd < 0)
		return -1;
	if (tcgetattr(fd, &t) == 0) {
		cfmakeraw(&t);
		if (tcsetattr(fd, TCSANOW, &t) == 0)
			return fd;
	}
	close(fd);
	return -1;
}

enum bb_status sim_wire_pty(struct sim_wire *w, const struct sim_wire_protocol *protocol, void *peer, char *path_out,
                            size_t cap, struct bb_error *err)
{
	struct endpoint *end = NULL;
	const enum bb_status status = add_end(w, protocol, peer, &end, err);

	if (status != BB_OK)
		return status;
	const int master = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
	const int slave = master >= 0 ? open_slave(master, path_out, cap) : -1;
	struct session *s = slave >= 0 ? begin_session(w, end, master) : NULL;
	if (s) {
		s->slave_fd = slave;
		w->n_ends++;
		w->n_ptys++;
		return BB_OK;
	}
	const int why = errno;
	if (slave >= 0)
		close(slave);
	if (master >= 0)
		close(master);
	return bb_fail(err, BB_ERR_IO, 1571, NULL, "no pty: %s", strerror(why));
}

/* ---- saying ---- */

bool sim_wire_say(struct sim_wire_line *line, const uint8_t *bytes, size_t n, int64_t at_ns, int64_t gap_ns)
{
	if (line->n == SIM_WIRE_QUEUE || n > SIM_WIRE_SAY_MAX)
		return false;
	struct saying *s = &line->queue[(line->first + line->n++) % SIM_WIRE_QUEUE];
	s->at_ns = at_ns;
	s->gap_ns = gap_ns;
	s->n = n;
	s->sent = 0;
	memcpy(s->bytes, bytes, n);
	return true;
}

struct sim_wire_line *sim_wire_line_create(void)
{
	return calloc(1, sizeof(struct sim_wire_line));
}

size_t sim_wire_line_next(struct sim_wire_line *line, uint8_t *out, size_t cap)
{
	const struct saying *s = &line->queue[line->first];

	if (!line->n)
		return 0;
	const size_t n = s->n < cap ? s->n : cap;
	memcpy(out, s->bytes, n);
	line->first = (line->first + 1) % SIM_WIRE_QUEUE;
	line->n--;
	return n;
}

/* When the next byte leaves: never, if nothing is to be said. Sayings keep their order. */
static int64_t next_byte_ns(const struct sim_wire_line *line)
{
	const struct saying *s = &line->queue[line->first];

	return line->n ? s->at_ns + (int64_t)s->sent * s->gap_ns : BB_NEVER;
}

static ssize_t put(const struct session *s, const uint8_t *bytes, size_t n)
{
	return s->slave_fd >= 0 ? write(s->fd, bytes, n) : send(s->fd, bytes, n, MSG_NOSIGNAL);
}

/* Sends what is due. false: the session is over. */
static bool speak(struct session *s, int64_t now_ns)
{
	struct sim_wire_line *line = &s->line;

	s->blocked = false;
	while (next_byte_ns(line) <= now_ns) {
		struct saying *say = &line->queue[line->first];
		const size_t n = say->gap_ns ? 1 : say->n - say->sent;
		const ssize_t done = n ? put(s, say->bytes + say->sent, n) : 0;
		if (done < 0) {
			s->blocked = errno == EAGAIN || errno == EINTR;
			return s->blocked;
		}
		say->sent += (size_t)done;
		if (say->sent == say->n) {
			line->first = (line->first + 1) % SIM_WIRE_QUEUE;
			line->n--;
		}
	}
	return true;
}

/* ---- hearing ---- */

/* Every byte is looked at, however soon one is wrong: the time taken says nothing about the token. */
static bool token_is(const char *token, const uint8_t *given, size_t n)
{
	const size_t want = strlen(token);
	unsigned different = n != want;

	for (size_t i = 0; i < want; i++)
		different |= (unsigned)((uint8_t)token[i] ^ (i < n ? given[i] : 0U));
	return !different;
}

/* Takes the token's line off the front of the bytes; the state memory holds it until it is whole. */
static bool hear_token(struct session *s, const uint8_t **bytes, size_t *n)
{
	while (*n && s->wants_token) {
		const uint8_t c = *(*bytes)++;
		--*n;
		if (c != '\n') {
			if (s->n_token == SIM_WIRE_TOKEN_MOST)
				return false;
			s->state[s->n_token++] = c;
			continue;
		}
		if (!token_is(s->end->token, s->state, s->n_token))
			return false;
		s->wants_token = false;
		memset(s->state, 0, sizeof(s->state));
	}
	return true;
}

static bool hear(struct session *s, int64_t now_ns)
{
	uint8_t buf[READ_BYTES];
	const uint8_t *bytes = buf;
	const ssize_t got = read(s->fd, buf, sizeof(buf));

	if (got <= 0)
		return got < 0 && (errno == EAGAIN || errno == EINTR);
	size_t n = (size_t)got;
	s->heard_ns = now_ns;
	if (s->wants_token && !hear_token(s, &bytes, &n))
		return false;
	if (s->end->protocol->adopt && !s->wants_token) {
		s->end->protocol->adopt(s->end->peer, s->fd, bytes, n);
		s->fd = -1;
		return false;
	}
	return !n || s->end->protocol->take(s->end->peer, s->state, &s->line, bytes, n, now_ns);
}

static int64_t limit_ns(const struct session *s)
{
	const struct sim_wire_protocol *p = s->end->protocol;

	if (s->slave_fd >= 0)
		return BB_NEVER;
	if (s->wants_token)
		return s->whole_ns + TOKEN_NS;
	return p->unfinished(s->state) ? s->whole_ns + p->frame_ns : s->heard_ns + p->idle_ns;
}

static bool session_lives(struct sim_wire *w, struct session *s, short events)
{
	const int64_t now_ns = bb_clock_now_ns(w->clk);

	if ((events & (POLLIN | POLLHUP | POLLERR)) && !hear(s, now_ns) && s->slave_fd < 0)
		return false;
	if (!speak(s, now_ns))
		return s->slave_fd >= 0;
	if (!s->wants_token && !s->end->protocol->unfinished(s->state))
		s->whole_ns = now_ns;
	if (now_ns < limit_ns(s))
		return true;
	w->n_refused++;
	return false;
}

static void accept_all(struct sim_wire *w, const struct endpoint *end)
{
	const int on = 1;

	for (;;) {
		const int fd = accept4(end->fd, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);
		if (fd < 0)
			return;
		setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
		if (end->protocol->adopt && !end->token[0]) {
			end->protocol->adopt(end->peer, fd, NULL, 0);
			continue;
		}
		if (w->n_sessions - w->n_ptys >= SIM_WIRE_SESSIONS_MAX || !begin_session(w, end, fd)) {
			w->n_refused++;
			close(fd);
		}
	}
}

/* ---- the loop ---- */

bool sim_wire_watch(struct sim_wire *w, int fd)
{
	if (w->n_watched == SIM_WIRE_WATCHED_MAX)
		return false;
	w->watched[w->n_watched++] = fd;
	return true;
}

/* Order of the polled files: watched ones, listeners by endpoint, sessions. */
static int64_t prepare(struct sim_wire *w)
{
	int64_t wake_ns = BB_NEVER;
	size_t n = 0;

	for (size_t i = 0; i < w->n_watched; i++)
		w->polled[n++] = (struct pollfd){ w->watched[i], POLLIN, 0 };
	for (size_t i = 0; i < w->n_ends; i++)
		w->polled[n++] = (struct pollfd){ w->ends[i].fd, POLLIN, 0 };
	for (size_t i = 0; i < w->n_sessions; i++) {
		const struct session *s = w->sessions[i];
		/* Whoever does not read what was said is not listened to either. */
		const short in = s->line.n < SIM_WIRE_QUEUE / 2 ? POLLIN : 0;
		w->polled[n++] = (struct pollfd){ s->fd, (short)(in | (s->blocked ? POLLOUT : 0)), 0 };
		const int64_t say_ns = s->blocked ? BB_NEVER : next_byte_ns(&s->line), end_ns = limit_ns(s);
		wake_ns = say_ns < wake_ns ? say_ns : wake_ns;
		wake_ns = end_ns < wake_ns ? end_ns : wake_ns;
	}
	w->n_polled = n;
	return wake_ns;
}

bool sim_wire_wait(struct sim_wire *w, int64_t most_ns)
{
	const int64_t wake_ns = prepare(w), now_ns = bb_clock_now_ns(w->clk);
	int64_t wait_ns = wake_ns == BB_NEVER ? most_ns : wake_ns - now_ns;

	wait_ns = wait_ns > most_ns ? most_ns : wait_ns < 0 ? 0 : wait_ns;
	const struct timespec t = { wait_ns / BB_NS_PER_S, wait_ns % BB_NS_PER_S };
	if (ppoll(w->polled, w->n_polled, &t, NULL) < 0)
		for (size_t i = 0; i < w->n_polled; i++)
			w->polled[i].revents = 0;
	for (size_t i = 0; i < w->n_watched; i++)
		if (w->polled[i].revents)
			return true;
	return false;
}

void sim_wire_serve(struct sim_wire *w)
{
	const size_t n_ends = w->n_ends, first = w->n_watched + n_ends;

	if (w->n_polled < first)
		return;
	/* Sessions first and from the end: ending one moves the last into its place. New ones were not polled yet. */
	for (size_t i = w->n_polled - first; i-- > 0;)
		if (i < w->n_sessions && !session_lives(w, w->sessions[i], w->polled[first + i].revents))
			end_session(w, i);
	for (size_t i = 0; i < n_ends; i++)
		if (w->polled[w->n_watched + i].revents & POLLIN)
			accept_all(w, &w->ends[i]);
	w->n_polled = 0;
}

size_t sim_wire_sessions(const struct sim_wire *w)
{
	return w->n_sessions - w->n_ptys;
}

uint64_t sim_wire_refused(const struct sim_wire *w)
{
	return w->n_refused;
}
