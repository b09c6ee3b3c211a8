/*
 * drivers/line_uapi2.c: a GPIO line through the kernel's v2 character device. Two line descriptors (input with both
 * edges, output) after the chip's own is closed again. Belongs to the clock's thread; nothing here blocks.
 *
 * Limit: the stamp of an edge is taken in the interrupt, its level is read a little later in the interrupt's thread. On
 * a host that stalls for longer than a period the level may be the next one's; whoever counts parity must check it.
 */
#include "drivers/line.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/gpio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define AT_ONCE 64
#define BUFFER_MOST (GPIO_V2_LINES_MAX * 16) /* the kernel takes no more */
#define FUTURE_NS 1000000

_Static_assert(sizeof(struct gpio_v2_line_event) == BB_LINE_RECORD_BYTES, "the kernel's record");

struct line {
	struct bb_line_bus base;
	struct bb_line_reader reader;
	int out_fd;
};

static struct line *own(struct bb_line_bus *bus)
{
	return bb_container_of(bus, struct line, base);
}

enum bb_status bb_line_open_failed(const struct bb_line_request *r, int os_errno, const char *held_by,
                                   struct bb_error *err)
{
	const char *text = strerror(os_errno);
	enum bb_status status = BB_ERR_IO;

	switch (os_errno) {
	case EACCES:
	case EPERM:
		bb_fail(err, status, 1540, NULL, "%s: %s", r->chip, text);
		break;
	case EBUSY:
		status = bb_fail(err, BB_ERR_BUSY, 1541, NULL, "%s line %u is held by %s", r->chip, r->line,
		                 held_by && *held_by ? held_by : "someone unnamed");
		break;
	case ENOENT:
	case ENODEV:
	case ENXIO:
		status = bb_fail(err, BB_ERR_LOST, 1542, NULL, "%s: %s", r->chip, text);
		break;
	case EINVAL:
	case ENOTTY:
		status = bb_fail(err, BB_ERR_CONFIG, 1542, NULL, "%s has no line %u for edges (output %d): %s", r->chip,
		                 r->line, r->out, text);
		break;
	default:
		bb_fail(err, status, 1544, NULL, "%s line %u: %s", r->chip, r->line, text);
	}
	errno = os_errno;
	return status;
}

/* What is wrong with a record? */
static bool sane(const struct bb_line_reader *r, const struct gpio_v2_line_event *e, int64_t now_ns, int64_t *at_ns)
{
	if (e->id != GPIO_V2_LINE_EVENT_RISING_EDGE && e->id != GPIO_V2_LINE_EVENT_FALLING_EDGE)
		return false;
	if (e->offset != r->line || e->timestamp_ns > INT64_MAX)
		return false;
	*at_ns = bb_clock_from_monotonic_ns(r->clk, (int64_t)e->timestamp_ns);
	return *at_ns <= now_ns + FUTURE_NS && (!r->any || *at_ns >= r->at_ns);
}

size_t bb_line_decode(struct bb_line_reader *r, const uint8_t *bytes, size_t n_bytes, struct bb_line_event *events,
                      size_t cap, size_t *n_out)
{
	const int64_t now_ns = bb_clock_now_ns(r->clk);
	struct gpio_v2_line_event e;
	size_t used = 0;

	for (*n_out = 0; n_bytes - used >= sizeof(e) && *n_out < cap; used += sizeof(e)) {
		int64_t at_ns = 0;
		memcpy(&e, bytes + used, sizeof(e));
		if (!sane(r, &e, now_ns, &at_ns)) {
			r->n_malformed++;
			r->lost = true;
			continue;
		}
		const bool gap = r->any && e.line_seqno != r->seq + 1;
		events[(*n_out)++] = (struct bb_line_event){ .at_ns = at_ns,
			                                     .seq = e.line_seqno,
			                                     .level = e.id == GPIO_V2_LINE_EVENT_RISING_EDGE,
			                                     .overflow = gap || r->lost };
		r->seq = e.line_seqno;
		r->at_ns = at_ns;
		r->any = true;
		r->lost = false;
	}
	return used;
}

static enum bb_status line_read(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap, size_t *n_out)
{
	struct line *l = own(bus);
	struct gpio_v2_line_event raw[AT_ONCE];
	const size_t most = cap < AT_ONCE ? cap : AT_ONCE;
	ssize_t n;

	*n_out = 0;
	do
		n = read(bus->fd, raw, most * sizeof(raw[0]));
	while (n < 0 && errno == EINTR);
	if (n < 0)
		return errno == EAGAIN ? BB_TIMEOUT : BB_ERR_LOST;
	if (n == 0 || (size_t)n % sizeof(raw[0]) != 0 || (size_t)n > sizeof(raw)) {
		errno = EPROTO; /* no kernel does this: whatever it is, it is no line */
		return BB_ERR_LOST;
	}
	bb_line_decode(&l->reader, (const uint8_t *)raw, (size_t)n, events, cap, n_out);
	return *n_out ? BB_OK : BB_TIMEOUT;
}

static enum bb_status line_set(struct bb_line_bus *bus, bool level)
{
	struct gpio_v2_line_values v = { .bits = level, .mask = 1 };
	const struct line *l = own(bus);

	if (l->out_fd < 0)
		return BB_ERR_UNSUPPORTED;
	return ioctl(l->out_fd, GPIO_V2_LINE_SET_VALUES_IOCTL, &v) ? BB_ERR_LOST : BB_OK;
}

static void line_close(struct bb_line_bus *bus)
{
	struct line *l = own(bus);

	if (l->out_fd >= 0)
		close(l->out_fd);
	if (bus->fd >= 0)
		close(bus->fd);
	free(l);
}

static const struct bb_line_ops ops = { line_read, line_set, line_close };

static uint64_t input_flags(const struct bb_line_request *r)
{
	static const uint64_t bias[] = { [BB_LINE_BIAS_AS_IS] = 0,
		                         [BB_LINE_BIAS_OFF] = GPIO_V2_LINE_FLAG_BIAS_DISABLED,
		                         [BB_LINE_BIAS_UP] = GPIO_V2_LINE_FLAG_BIAS_PULL_UP,
		                         [BB_LINE_BIAS_DOWN] = GPIO_V2_LINE_FLAG_BIAS_PULL_DOWN };

	return GPIO_V2_LINE_FLAG_INPUT | GPIO_V2_LINE_FLAG_EDGE_RISING | GPIO_V2_LINE_FLAG_EDGE_FALLING | bias[r->bias] |
	       (r->active_low ? (uint64_t)GPIO_V2_LINE_FLAG_ACTIVE_LOW : 0);
}

/* A request for one line; its descriptor, or -1 with errno. */
static int request_line(int chip, uint32_t offset, uint64_t flags, uint32_t n_buffer)
{
	struct gpio_v2_line_request q = { .offsets = { offset },
		                          .consumer = "blackburst",
		                          .config = { .flags = flags },
		                          .num_lines = 1,
		                          .event_buffer_size = n_buffer < BUFFER_MOST ? n_buffer : BUFFER_MOST };

	return ioctl(chip, GPIO_V2_GET_LINE_IOCTL, &q) ? -1 : q.fd;
}

static enum bb_status refused(int chip, const struct bb_line_request *r, uint32_t offset, struct bb_error *err)
{
	struct gpio_v2_line_info info = { .offset = offset };
	struct bb_line_request q = *r;
	const int why = errno;

	q.line = offset;
	if (why == EBUSY && ioctl(chip, GPIO_V2_GET_LINEINFO_IOCTL, &info))
		info.consumer[0] = '\0';
	info.consumer[sizeof(info.consumer) - 1] = '\0';
	return bb_line_open_failed(&q, why, info.consumer, err);
}

enum bb_status bb_line_uapi2_on(int in_fd, int out_fd, uint32_t line, struct bb_clock *clk, struct bb_line_bus **out)
{
	struct line *l = calloc(1, sizeof(*l));
	const int flags = fcntl(in_fd, F_GETFL);

	*out = NULL;
	if (!l || flags < 0 || fcntl(in_fd, F_SETFL, flags | O_NONBLOCK) < 0) {
		const enum bb_status status = l ? BB_ERR_IO : BB_ERR_NOMEM;
		const int why = errno;
		free(l);
		close(in_fd);
		if (out_fd >= 0)
			close(out_fd);
		errno = why;
		return status;
	}
	l->base = (struct bb_line_bus){ &ops, clk, in_fd };
	l->reader = (struct bb_line_reader){ .clk = clk, .line = line };
	l->out_fd = out_fd;
	*out = &l->base;
	return BB_OK;
}

static enum bb_status request_both(int chip, const struct bb_line_request *r, struct bb_clock *clk,
                                   struct bb_line_bus **out, struct bb_error *err)
{
	const int in_fd = request_line(chip, r->line, input_flags(r), r->n_buffer);
	int out_fd = -1;

	if (in_fd < 0)
		return refused(chip, r, r->line, err);
	if (r->out >= 0) {
		out_fd = request_line(chip, (uint32_t)r->out, GPIO_V2_LINE_FLAG_OUTPUT, 0);
		if (out_fd < 0) {
			const enum bb_status status = refused(chip, r, (uint32_t)r->out, err);
			close(in_fd);
			return status;
		}
	}
	if (bb_line_uapi2_on(in_fd, out_fd, r->line, clk, out) != BB_OK)
		return bb_line_open_failed(r, errno, NULL, err);
	return BB_OK;
}

static enum bb_status line_open(void *ctx, const struct bb_line_request *r, struct bb_clock *clk,
                                struct bb_line_bus **out, struct bb_error *err)
{
	const int chip = open(r->chip, O_RDWR | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);

	(void)ctx;
	*out = NULL;
	if (chip < 0)
		return bb_line_open_failed(r, errno, NULL, err);
	const enum bb_status status = request_both(chip, r, clk, out, err);
	const int why = errno;
	close(chip);
	errno = why;
	return status;
}

const struct bb_line_opener bb_line_uapi2 = { line_open, NULL };
