/*
 * drivers/line_gpiod.c: a GPIO line through libgpiod, for systems that bring their own. Its header has no version
 * macro; the bulk size is one that only 1.x defines.
 *
 * 1.x speaks the kernel's v1 interface: 16 events are kept, the next ones dropped without a word, and none is numbered.
 * Events come with seq 0; what was lost can only be inferred by someone who knows the period (drivers/edge_lock.h).
 * 2.x numbers its events and keeps as many as asked for.
 */
#include "drivers/line.h"

#include <errno.h>
#include <gpiod.h>
#include <stdlib.h>
#include <string.h>

#define CONSUMER "blackburst"
#define AT_ONCE 16

#ifdef GPIOD_LINE_BULK_MAX_LINES /* 1.x */

struct line {
	struct bb_line_bus base;
	struct gpiod_chip *chip;
	struct gpiod_line *in, *out;
};

static struct line *own(struct bb_line_bus *bus)
{
	return bb_container_of(bus, struct line, base);
}

static enum bb_status line_read(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap, size_t *n_out)
{
	const struct timespec at_once = { 0, 0 };
	struct gpiod_line_event raw[AT_ONCE];
	struct line *l = own(bus);

	*n_out = 0;
	const int ready = gpiod_line_event_wait(l->in, &at_once);
	if (ready <= 0)
		return ready == 0 || errno == EINTR ? BB_TIMEOUT : BB_ERR_LOST;
	const int n = gpiod_line_event_read_multiple(l->in, raw, (unsigned)(cap < AT_ONCE ? cap : AT_ONCE));
	if (n < 0)
		return errno == EAGAIN ? BB_TIMEOUT : BB_ERR_LOST;
	for (int i = 0; i < n; i++) {
		const int64_t ns = (int64_t)raw[i].ts.tv_sec * BB_NS_PER_S + raw[i].ts.tv_nsec;
		events[i].at_ns = bb_clock_from_monotonic_ns(bus->clk, ns);
		events[i].seq = 0;
		events[i].level = raw[i].event_type == GPIOD_LINE_EVENT_RISING_EDGE;
		events[i].overflow = false;
	}
	*n_out = (size_t)n;
	return n ? BB_OK : BB_TIMEOUT;
}

static enum bb_status line_set(struct bb_line_bus *bus, bool level)
{
	const struct line *l = own(bus);

	if (!l->out)
		return BB_ERR_UNSUPPORTED;
	return gpiod_line_set_value(l->out, level) ? BB_ERR_LOST : BB_OK;
}

static void line_close(struct bb_line_bus *bus)
{
	struct line *l = own(bus);

	gpiod_chip_close(l->chip); /* releases its lines */
	free(l);
}

static int flags_of(const struct bb_line_request *r)
{
	static const int bias[] = { [BB_LINE_BIAS_AS_IS] = 0,
		                    [BB_LINE_BIAS_OFF] = GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE,
		                    [BB_LINE_BIAS_UP] = GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP,
		                    [BB_LINE_BIAS_DOWN] = GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN };

	return bias[r->bias] | (r->active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0);
}

/* 0, or -1 with errno; *held_by names who has the line that was refused. */
static int request_lines(struct line *l, const struct bb_line_request *r, const char **held_by)
{
	l->in = gpiod_chip_get_line(l->chip, r->line);
	if (!l->in)
		return -1;
	*held_by = gpiod_line_consumer(l->in);
	if (gpiod_line_request_both_edges_events_flags(l->in, CONSUMER, flags_of(r)))
		return -1;
	l->base.fd = gpiod_line_event_get_fd(l->in);
	if (r->out < 0)
		return 0;
	struct gpiod_line *out = gpiod_chip_get_line(l->chip, (unsigned)r->out);
	if (!out)
		return -1;
	*held_by = gpiod_line_consumer(out);
	if (gpiod_line_request_output(out, CONSUMER, 0))
		return -1;
	l->out = out;
	return 0;
}

static int open_chip(struct line *l, const struct bb_line_request *r, const char **held_by)
{
	l->chip = gpiod_chip_open(r->chip);
	return l->chip ? request_lines(l, r, held_by) : -1;
}

static void drop(struct line *l)
{
	if (l->chip)
		gpiod_chip_close(l->chip);
	free(l);
}

#else /* 2.x */

struct line {
	struct bb_line_bus base;
	struct gpiod_chip *chip;
	struct gpiod_line_request *in, *out;
	struct gpiod_edge_event_buffer *buffer;
	unsigned out_offset;
	unsigned long seq;
};

static struct line *own(struct bb_line_bus *bus)
{
	return bb_container_of(bus, struct line, base);
}

static struct bb_line_event convert(struct line *l, struct gpiod_edge_event *e)
{
	const int64_t ns = (int64_t)gpiod_edge_event_get_timestamp_ns(e);
	const unsigned long seq = gpiod_edge_event_get_line_seqno(e);
	const struct bb_line_event out = { .at_ns = bb_clock_from_monotonic_ns(l->base.clk, ns),
		                           .seq = (uint32_t)seq,
		                           .level = gpiod_edge_event_get_event_type(e) == GPIOD_EDGE_EVENT_RISING_EDGE,
		                           .overflow = l->seq && (uint32_t)seq != (uint32_t)(l->seq + 1) };

	l->seq = seq;
	return out;
}

static enum bb_status line_read(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap, size_t *n_out)
{
	struct line *l = own(bus);

	*n_out = 0;
	const int ready = gpiod_line_request_wait_edge_events(l->in, 0);
	if (ready <= 0)
		return ready == 0 || errno == EINTR ? BB_TIMEOUT : BB_ERR_LOST;
	const int n = gpiod_line_request_read_edge_events(l->in, l->buffer, cap < AT_ONCE ? cap : AT_ONCE);
	if (n < 0)
		return errno == EAGAIN ? BB_TIMEOUT : BB_ERR_LOST;
	for (int i = 0; i < n; i++)
		events[i] = convert(l, gpiod_edge_event_buffer_get_event(l->buffer, (unsigned long)i));
	*n_out = (size_t)n;
	return n ? BB_OK : BB_TIMEOUT;
}

static enum bb_status line_set(struct bb_line_bus *bus, bool level)
{
	const struct line *l = own(bus);

	if (!l->out)
		return BB_ERR_UNSUPPORTED;
	return gpiod_line_request_set_value(l->out, l->out_offset,
	                                    level ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE)
	               ? BB_ERR_LOST
	               : BB_OK;
}

static void drop(struct line *l)
{
	if (l->out)
		gpiod_line_request_release(l->out);
	if (l->in)
		gpiod_line_request_release(l->in);
	if (l->buffer)
		gpiod_edge_event_buffer_free(l->buffer);
	if (l->chip)
		gpiod_chip_close(l->chip);
	free(l);
}

static void line_close(struct bb_line_bus *bus)
{
	drop(own(bus));
}

/* One line by its settings; NULL with errno. */
static struct gpiod_line_request *request_one(struct line *l, unsigned offset, struct gpiod_line_settings *settings,
                                              uint32_t n_buffer)
{
	struct gpiod_line_config *lines = gpiod_line_config_new();
	struct gpiod_request_config *how = gpiod_request_config_new();
	struct gpiod_line_request *request = NULL;

	if (lines && how && !gpiod_line_config_add_line_settings(lines, &offset, 1, settings)) {
		gpiod_request_config_set_consumer(how, CONSUMER);
		gpiod_request_config_set_event_buffer_size(how, n_buffer);
		request = gpiod_chip_request_lines(l->chip, how, lines);
	}
	const int why = errno;
	if (how)
		gpiod_request_config_free(how);
	if (lines)
		gpiod_line_config_free(lines);
	errno = why;
	return request;
}

static int input_settings(struct gpiod_line_settings *s, const struct bb_line_request *r)
{
	static const enum gpiod_line_bias bias[] = { [BB_LINE_BIAS_AS_IS] = GPIOD_LINE_BIAS_AS_IS,
		                                     [BB_LINE_BIAS_OFF] = GPIOD_LINE_BIAS_DISABLED,
		                                     [BB_LINE_BIAS_UP] = GPIOD_LINE_BIAS_PULL_UP,
		                                     [BB_LINE_BIAS_DOWN] = GPIOD_LINE_BIAS_PULL_DOWN };

	gpiod_line_settings_set_active_low(s, r->active_low);
	if (gpiod_line_settings_set_direction(s, GPIOD_LINE_DIRECTION_INPUT) ||
	    gpiod_line_settings_set_edge_detection(s, GPIOD_LINE_EDGE_BOTH) ||
	    gpiod_line_settings_set_bias(s, bias[r->bias]))
		return -1;
	return gpiod_line_settings_set_event_clock(s, GPIOD_LINE_CLOCK_MONOTONIC);
}

static int request_lines(struct line *l, const struct bb_line_request *r, struct gpiod_line_settings *s)
{
	if (input_settings(s, r))
		return -1;
	l->in = request_one(l, r->line, s, r->n_buffer);
	if (!l->in)
		return -1;
	l->base.fd = gpiod_line_request_get_fd(l->in);
	if (r->out < 0)
		return 0;
	gpiod_line_settings_reset(s);
	if (gpiod_line_settings_set_direction(s, GPIOD_LINE_DIRECTION_OUTPUT) ||
	    gpiod_line_settings_set_output_value(s, GPIOD_LINE_VALUE_INACTIVE))
		return -1;
	l->out_offset = (unsigned)r->out;
	l->out = request_one(l, l->out_offset, s, 0);
	return l->out ? 0 : -1;
}

static int open_chip(struct line *l, const struct bb_line_request *r, const char **held_by)
{
	struct gpiod_line_settings *s;

	*held_by = NULL;
	l->chip = gpiod_chip_open(r->chip);
	l->buffer = gpiod_edge_event_buffer_new(AT_ONCE);
	s = gpiod_line_settings_new();
	const int failed = !l->chip || !l->buffer || !s || request_lines(l, r, s);
	const int why = errno;
	if (s)
		gpiod_line_settings_free(s);
	errno = why;
	return failed ? -1 : 0;
}

#endif

static const struct bb_line_ops ops = { line_read, line_set, line_close };

static enum bb_status line_open(void *ctx, const struct bb_line_request *r, struct bb_clock *clk,
                                struct bb_line_bus **out, struct bb_error *err)
{
	const char *held_by = NULL;
	struct line *l = calloc(1, sizeof(*l));

	(void)ctx;
	*out = NULL;
	if (!l)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "opening %s", r->chip);
	l->base = (struct bb_line_bus){ &ops, clk, -1 };
	if (open_chip(l, r, &held_by)) {
		const int why = errno;
		const enum bb_status status = bb_line_open_failed(r, why, held_by, err);
		drop(l);
		errno = why;
		return status;
	}
	*out = &l->base;
	return BB_OK;
}

const struct bb_line_opener bb_line_gpiod = { line_open, NULL };
