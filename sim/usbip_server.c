/* sim/usbip_server.c: see sim/usbip_server.h. */
#include "sim/usbip_server.h"

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
#include <unistd.h>

#define SILENT_NS BB_NS_PER_S

struct client {
	struct usbip_conn *conn;
	int fd;
	int64_t since_ns;
};

struct usbip_server {
	struct bb_clock *clk;
	struct usbip_exports exports;
	int listener;
	size_t n;
	struct client client[USBIP_CLIENTS];
	uint8_t buffer[16384];
};

static int64_t now_of(const struct usbip_server *s)
{
	return bb_clock_now_ns(s->clk);
}

enum bb_status usbip_server_create(struct bb_clock *clk, struct usbip_server **out)
{
	struct usbip_server *s = calloc(1, sizeof(*s));

	*out = s;
	if (!s)
		return BB_ERR_NOMEM;
	s->clk = clk;
	s->listener = -1;
	return BB_OK;
}

static void drop(struct usbip_server *s, size_t i)
{
	usbip_conn_destroy(s->client[i].conn);
	close(s->client[i].fd);
	s->client[i] = s->client[--s->n];
}

void usbip_server_destroy(struct usbip_server *s)
{
	if (!s)
		return;
	while (s->n)
		drop(s, s->n - 1);
	if (s->listener >= 0)
		close(s->listener);
	free(s);
}

enum bb_status usbip_server_export(struct usbip_server *s, struct sim_usb_device *device, size_t *item)
{
	struct usbip_export *e = &s->exports.item[s->exports.n];

	if (s->exports.n == USBIP_EXPORTS)
		return BB_ERR_RANGE;
	*item = s->exports.n++;
	snprintf(e->busid, sizeof(e->busid), "1-%zu", *item + 1);
	e->busnum = 1;
	e->devnum = (uint32_t)*item + 2; /* 1 is the hub everything hangs on */
	e->device = device;
	return BB_OK;
}

void usbip_server_withdraw(struct usbip_server *s, size_t item)
{
	if (item >= s->exports.n)
		return;
	s->exports.item[item].device = NULL;
	for (size_t i = s->n; i-- > 0;) /* drop() moves the last one here, which has been asked already */
		if (!usbip_conn_step(s->client[i].conn))
			drop(s, i);
}

void usbip_server_plug(struct usbip_server *s, size_t item, struct sim_usb_device *device)
{
	if (item >= s->exports.n)
		return;
	usbip_server_withdraw(s, item);
	s->exports.item[item].device = device;
	sim_usb_reset(device);
}

uint32_t usbip_server_devid(const struct usbip_server *s, size_t item)
{
	return s->exports.item[item].busnum << 16 | s->exports.item[item].devnum;
}

/* Sockets */

static bool nonblocking(int fd)
{
	const int flags = fcntl(fd, F_GETFL);

	return flags >= 0 && fcntl(fd, F_SETFL, flags | O_NONBLOCK) == 0 && fcntl(fd, F_SETFD, FD_CLOEXEC) == 0;
}

enum bb_status usbip_server_listen(struct usbip_server *s, uint16_t *port)
{
	struct sockaddr_in at = { .sin_family = AF_INET, .sin_port = htons(*port) };
	socklen_t n = sizeof(at);
	const int on = 1, fd = socket(AF_INET, SOCK_STREAM, 0);

	if (fd < 0 || s->listener >= 0) {
		if (fd >= 0)
			close(fd);
		return BB_ERR_IO;
	}
	at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
	(void)setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
	if (!nonblocking(fd) || bind(fd, (struct sockaddr *)&at, n) || listen(fd, 16) ||
	    getsockname(fd, (struct sockaddr *)&at, &n)) {
		const enum bb_status status = errno == EADDRINUSE ? BB_ERR_BUSY : BB_ERR_IO;
		close(fd);
		return status;
	}
	*port = ntohs(at.sin_port);
	s->listener = fd;
	return BB_OK;
}

static enum bb_status add(struct usbip_server *s, struct usbip_conn *conn, int fd)
{
	if (s->n == USBIP_CLIENTS || !nonblocking(fd)) {
		usbip_conn_destroy(conn);
		return s->n == USBIP_CLIENTS ? BB_ERR_BUSY : BB_ERR_IO;
	}
	s->client[s->n++] = (struct client){ conn, fd, now_of(s) };
	return BB_OK;
}

enum bb_status usbip_server_adopt(struct usbip_server *s, size_t item, int fd)
{
	struct usbip_conn *conn;
	enum bb_status status = usbip_conn_create_attached(&s->exports, item, &conn);

	if (status == BB_OK)
		status = add(s, conn, fd);
	return status;
}

void usbip_server_take(struct usbip_server *s, int fd, const uint8_t *bytes, size_t n)
{
	struct usbip_conn *conn;

	if (usbip_conn_create(&s->exports, &conn) != BB_OK || add(s, conn, fd) != BB_OK)
		close(fd);
	else if (n && !usbip_conn_feed(conn, bytes, n))
		drop(s, s->n - 1);
}

static void welcome(struct usbip_server *s)
{
	const int on = 1, fd = accept(s->listener, NULL, NULL);

	if (fd < 0)
		return;
	(void)setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
	usbip_server_take(s, fd, NULL, 0);
}

/* False: the other end is gone or talks nonsense. */
static bool receive(struct usbip_server *s, struct client *c)
{
	size_t room = usbip_conn_room(c->conn);

	while (room) {
		const size_t want = room < sizeof(s->buffer) ? room : sizeof(s->buffer);
		const ssize_t n = recv(c->fd, s->buffer, want, 0);
		if (n < 0)
			return errno == EAGAIN || errno == EINTR;
		if (n == 0 || !usbip_conn_feed(c->conn, s->buffer, (size_t)n))
			return false;
		room = usbip_conn_room(c->conn);
	}
	return true;
}

static bool send_out(struct client *c)
{
	size_t n;
	const uint8_t *bytes = usbip_conn_out(c->conn, &n);

	while (n) {
		const ssize_t sent = send(c->fd, bytes, n, MSG_NOSIGNAL);
		if (sent < 0)
			return errno == EAGAIN || errno == EINTR;
		usbip_conn_sent(c->conn, (size_t)sent);
		bytes = usbip_conn_out(c->conn, &n);
	}
	return !usbip_conn_is_done(c->conn);
}

static bool serve(struct usbip_server *s, struct client *c)
{
	if (!receive(s, c) || !usbip_conn_step(c->conn) || !send_out(c))
		return false;
	return usbip_conn_is_attached(c->conn) || now_of(s) - c->since_ns < SILENT_NS;
}

void usbip_server_step(struct usbip_server *s, int wait_ms)
{
	struct pollfd fds[USBIP_CLIENTS + 1];
	nfds_t n = 0;

	for (size_t i = 0; i < s->n; i++) {
		size_t out;
		(void)usbip_conn_out(s->client[i].conn, &out);
		fds[n++] = (struct pollfd){ .fd = s->client[i].fd,
			                    .events = (short)((usbip_conn_room(s->client[i].conn) ? POLLIN : 0) |
			                                      (out ? POLLOUT : 0)) };
	}
	if (s->listener >= 0)
		fds[n++] = (struct pollfd){ .fd = s->listener, .events = POLLIN };
	(void)poll(fds, n, wait_ms);
	for (size_t i = s->n; i-- > 0;)
		if (!serve(s, &s->client[i]))
			drop(s, i);
	if (s->listener >= 0)
		welcome(s);
}

size_t usbip_server_clients(const struct usbip_server *s)
{
	return s->n;
}
