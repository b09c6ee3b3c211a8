/* drivers/bus_modbus.c: the one place that knows libmodbus; see drivers/bus_modbus.h. */
#include "drivers/bus_modbus.h"

#include <errno.h>
#include <fcntl.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

#define LATE_MOST 3
#define QUIET_NS (50 * INT64_C(1000000)) /* a serial line is drained when it has said nothing for so long */
#define DRAIN_NS (100 * INT64_C(1000000))

struct bus_modbus {
	struct bus_modbus_config config;
	struct bb_clock *clk;
	modbus_t *ctx;
	bool up;
	uint16_t transaction;
	struct {
		uint16_t transaction;
		int64_t at_ns;
	} sent[MODBUS_SENT_KEPT]; /* for the delay of late replies */
	size_t n_sent;
	unsigned late_in_a_row;
	struct bus_modbus_note note;
};

enum bb_status bus_modbus_create(const struct bus_modbus_config *config, struct bb_clock *clk, struct bus_modbus **out)
{
	*out = NULL;
	if (bb_clock_is_virtual(clk) || config->n_allow > MODBUS_ALLOW_MAX)
		return BB_ERR_UNSUPPORTED;
	*out = calloc(1, sizeof(**out));
	if (!*out)
		return BB_ERR_NOMEM;
	(*out)->config = *config;
	(*out)->clk = clk;
	return BB_OK;
}

void bus_modbus_destroy(struct bus_modbus *b)
{
	if (!b)
		return;
	bus_modbus_hang_up(b);
	free(b);
}

bool bus_modbus_up(const struct bus_modbus *b)
{
	return b->up;
}

const struct bus_modbus_note *bus_modbus_note(const struct bus_modbus *b)
{
	return &b->note;
}

void bus_modbus_hang_up(struct bus_modbus *b)
{
	if (b->ctx) {
		modbus_close(b->ctx);
		modbus_free(b->ctx);
	}
	b->ctx = NULL;
	b->up = false;
}

/* libmodbus 3.1.6 puts descriptors into an fd_set unchecked: the next one must fit. */
static bool descriptor_fits(void)
{
	const int fd = open("/dev/null", O_RDONLY | O_CLOEXEC);

	if (fd < 0)
		return false;
	close(fd);
	return fd < FD_SETSIZE;
}

static modbus_t *context(const struct bus_modbus_config *c)
{
	struct sigaction before;

	/* It may set the whole process to ignore SIGPIPE, which is not its to decide. */
	const bool kept = sigaction(SIGPIPE, NULL, &before) == 0;
	modbus_t *ctx = c->rtu ? modbus_new_rtu(c->tty, c->baud, c->parity, 8, c->stop) : modbus_new_tcp(c->host, c->port);
	if (kept)
		sigaction(SIGPIPE, &before, NULL);
	return ctx;
}

static void set_wait(modbus_t *ctx, int64_t wait_ns)
{
	const int64_t us = wait_ns < 1000000 ? 1000 : wait_ns / 1000;

	modbus_set_response_timeout(ctx, (uint32_t)(us / 1000000), (uint32_t)(us % 1000000));
	modbus_set_byte_timeout(ctx, 0, 0); /* none: the wait above is for the whole reply */
}

enum bb_status bus_modbus_connect(struct bus_modbus *b, int64_t within_ns)
{
	bus_modbus_hang_up(b);
	b->note = (struct bus_modbus_note){ .why = "cannot connect" };
	if (!descriptor_fits())
		return BB_ERR_IO;
	b->ctx = context(&b->config);
	if (!b->ctx)
		return BB_ERR_CONFIG;
	set_wait(b->ctx, within_ns);
	modbus_set_error_recovery(b->ctx, MODBUS_ERROR_RECOVERY_NONE); /* it would sleep, or try for ever */
	if (modbus_set_slave(b->ctx, b->config.unit) != 0 || modbus_connect(b->ctx) != 0) {
		const int why = errno;
		bus_modbus_hang_up(b);
		errno = why;
		return BB_ERR_LOST;
	}
	b->up = true;
	b->late_in_a_row = 0;
	if (!b->config.rtu) {
		const int fd = modbus_get_socket(b->ctx);
		const unsigned ms = (unsigned)(b->config.user_timeout_ns / 1000000);
		setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &ms, sizeof(ms)); /* helps; the polls find it too */
	}
	return BB_OK;
}

static enum bb_status broken(struct bus_modbus *b, enum bb_status status, const char *why)
{
	b->note.why = why;
	bus_modbus_hang_up(b);
	return status;
}

/* Reads and forgets until nothing comes any more, or for long enough: what a serial line still says belongs to no request of ours. */
static void drain(struct bus_modbus *b)
{
	uint8_t junk[256];
	struct pollfd p = { modbus_get_socket(b->ctx), POLLIN, 0 };
	const int64_t end_ns = bb_clock_now_ns(b->clk) + DRAIN_NS;

	while (bb_clock_now_ns(b->clk) < end_ns && poll(&p, 1, (int)(QUIET_NS / 1000000)) > 0)
		if (read(p.fd, junk, sizeof(junk)) <= 0)
			break;
	modbus_flush(b->ctx);
}

static enum bb_status spoiled(struct bus_modbus *b, const char *why)
{
	if (!b->config.rtu)
		return broken(b, BB_ERR_FORMAT, why);
	b->note.why = why;
	drain(b);
	return BB_ERR_FORMAT;
}

static enum bb_status send_request(struct bus_modbus *b, const struct modbus_request *r)
{
	uint8_t adu[MODBUS_TCP_REQUEST_BYTES];
	bool gone;

	b->transaction++;
	b->sent[b->n_sent % MODBUS_SENT_KEPT].transaction = b->transaction;
	b->sent[b->n_sent++ % MODBUS_SENT_KEPT].at_ns = bb_clock_now_ns(b->clk);
	if (b->config.rtu) {
		modbus_put_request(r, adu);
		gone = modbus_send_raw_request(b->ctx, adu, MODBUS_REQUEST_BYTES) < 0;
	} else {
		modbus_put_tcp(r, b->transaction, adu);
		gone = send(modbus_get_socket(b->ctx), adu, sizeof(adu), MSG_NOSIGNAL | MSG_DONTWAIT) != sizeof(adu);
	}
	return gone ? broken(b, BB_ERR_LOST, "cannot send") : BB_OK;
}

/* One frame. Waits for its first byte outside libmodbus: after such a wait nothing is lost, the stream stays whole. */
static enum bb_status receive(struct bus_modbus *b, int64_t deadline_ns, uint8_t *adu, size_t *n)
{
	struct pollfd p = { modbus_get_socket(b->ctx), POLLIN, 0 };
	const int64_t wait_ns = deadline_ns - bb_clock_now_ns(b->clk);

	if (wait_ns <= 0 || poll(&p, 1, (int)(wait_ns / 1000000 + 1)) <= 0)
		return BB_TIMEOUT;
	set_wait(b->ctx, deadline_ns - bb_clock_now_ns(b->clk));
	const int got = modbus_receive_confirmation(b->ctx, adu);
	*n = got > 0 ? (size_t)got : 0;
	if (got >= 0)
		return BB_OK;
	if (errno == ETIMEDOUT)
		return spoiled(b, "a reply that does not end");
	if (errno == EMBBADCRC || errno == EMBBADDATA)
		return spoiled(b, errno == EMBBADCRC ? "wrong checksum" : "more bytes than a frame has");
	return broken(b, BB_ERR_LOST, "the connection broke");
}

static void note_late(struct bus_modbus *b, uint16_t transaction)
{
	const size_t kept = b->n_sent < MODBUS_SENT_KEPT ? b->n_sent : MODBUS_SENT_KEPT;

	b->note.n_late++;
	b->late_in_a_row++;
	for (size_t i = 0; i < kept; i++) {
		const int64_t ns = bb_clock_now_ns(b->clk) - b->sent[i].at_ns;
		if (b->sent[i].transaction == transaction && ns > b->note.late_ns)
			b->note.late_ns = ns;
	}
}

/* Bytes after the answer, when nothing else was asked, are nobody's. */
static bool leftovers(struct bus_modbus *b)
{
	int n = 0;

	return ioctl(modbus_get_socket(b->ctx), FIONREAD, &n) == 0 && n > 0;
}

static enum bb_status judge(struct bus_modbus *b, const uint8_t *adu, size_t n, const struct modbus_request *r,
                            struct modbus_reply *reply)
{
	if (b->config.rtu)
		modbus_judge_rtu(adu, n, r, reply);
	else
		modbus_judge_tcp(adu, n, r, b->transaction, reply);
	if (reply->verdict == MODBUS_BAD)
		return spoiled(b, reply->why);
	if (reply->verdict == MODBUS_OTHER) {
		note_late(b, reply->transaction);
		if (b->late_in_a_row < LATE_MOST)
			return BB_TIMEOUT;
		b->note.skewed = true;
		return spoiled(b, "three late replies in a row");
	}
	b->late_in_a_row = 0;
	return leftovers(b) ? spoiled(b, "bytes after the reply") : BB_OK;
}

enum bb_status bus_modbus_exchange(struct bus_modbus *b, const struct modbus_request *request, int64_t deadline_ns,
                                   struct modbus_reply *reply)
{
	uint8_t adu[MODBUS_MAX_ADU_LENGTH];
	size_t n;

	memset(reply, 0, sizeof(*reply));
	b->note = (struct bus_modbus_note){ .why = "" };
	if (modbus_writes(request) && !modbus_allowed(b->config.allow, b->config.n_allow, b->config.unit, request))
		return BB_ERR_REFUSED;
	if (!b->up)
		return BB_ERR_LOST;
	const int64_t begun_ns = bb_clock_now_ns(b->clk);
	enum bb_status status = send_request(b, request);
	while (status == BB_OK) {
		status = receive(b, deadline_ns, adu, &n);
		if (status != BB_OK)
			break;
		status = n ? judge(b, adu, n, request, reply) : BB_TIMEOUT; /* n 0: another unit on the line */
		if (status != BB_TIMEOUT)
			break;
		status = BB_OK; /* discarded; keep waiting until the deadline */
	}
	if (status == BB_TIMEOUT && b->config.rtu)
		drain(b); /* there is no transaction on a serial line to know a late reply by */
	b->note.took_ns = bb_clock_now_ns(b->clk) - begun_ns;
	return status;
}
