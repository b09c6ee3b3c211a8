/* drivers/bus_usb.c: see drivers/bus_usb.h. The only file that knows libusb. One event thread a bus; `lock` guards
 * everything the callbacks touch. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* pthread_clockjoin_np */
#endif
#include "drivers/bus_usb.h"

#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <libusb-1.0/libusb.h>

#define IN_ENDPOINTS 4
#define IN_FLIGHT 4
#define RING 16
#define BULK_BYTES 16384
#define OUT_SLOTS 16
#define OUT_BYTES 1024
#define CANCEL_NS INT64_C(100000000)

enum reset_state { RESET_NONE, RESET_ASKED, RESET_DONE };

struct in_endpoint {
	struct bus *bus;
	uint8_t address;
	size_t size;                 /* of one transfer */
	struct libusb_transfer *transfer[IN_FLIGHT];
	uint8_t *bytes;              /* IN_FLIGHT buffers, then RING buffers */
	struct {
		size_t n;
		int64_t at_ns;
	} ring[RING];
	size_t head, n_ring, in_flight;
	enum bb_status status;       /* why it stands still */
	uint64_t dropped;
};

struct out_slot {
	struct bus *bus;
	struct libusb_transfer *transfer;
	bool busy;
	uint8_t bytes[OUT_BYTES];
};

struct bus {
	struct bb_usb_bus base;
	libusb_context *ctx;
	libusb_device_handle *handle;
	int interface;
	bool claimed, threaded, lost, stop;
	pthread_t thread;
	pthread_mutex_t lock;
	pthread_cond_t changed;
	enum reset_state reset;
	enum bb_status reset_status, out_status;
	size_t n_in, n_out_busy;
	struct in_endpoint in[IN_ENDPOINTS];
	struct out_slot out[OUT_SLOTS];
	uint8_t type[32];            /* by endpoint number, + 16 for IN; 0xFF: none */
	uint16_t packet_bytes[32];
};

static struct bus *own(struct bb_usb_bus *bus)
{
	return bb_container_of(bus, struct bus, base);
}

static size_t slot_of(uint8_t endpoint)
{
	return (endpoint & 0x0F) + (endpoint & 0x80 ? 16u : 0u);
}

static enum bb_status status_of(int rc)
{
	switch (rc) {
	case LIBUSB_SUCCESS:
		return BB_OK;
	case LIBUSB_ERROR_NO_DEVICE:
	case LIBUSB_ERROR_NOT_FOUND:
		return BB_ERR_LOST;
	case LIBUSB_ERROR_TIMEOUT:
		return BB_TIMEOUT;
	case LIBUSB_ERROR_BUSY:
		return BB_ERR_BUSY;
	case LIBUSB_ERROR_NO_MEM:
		return BB_ERR_NOMEM;
	default:
		return BB_ERR_IO;
	}
}

/* Waits for a change until a time of the bus's clock; the lock is held. False: the time has come. */
static bool wait_change(struct bus *b, int64_t until_ns)
{
	const int64_t left_ns = until_ns - bb_clock_now_ns(b->base.clk);

	if (left_ns <= 0)
		return false;
	const int64_t at_ns = bb_clock_stopwatch_ns() + left_ns; /* the condition waits on the same clock */
	const struct timespec t = { .tv_sec = at_ns / BB_NS_PER_S, .tv_nsec = at_ns % BB_NS_PER_S };
	return pthread_cond_timedwait(&b->changed, &b->lock, &t) != ETIMEDOUT;
}

/* IN: callbacks of the event thread */

static void keep(struct in_endpoint *e, const struct libusb_transfer *t)
{
	if (e->n_ring == RING) {
		e->head = (e->head + 1) % RING;
		e->n_ring--;
		e->dropped++;
	}
	const size_t i = (e->head + e->n_ring++) % RING;
	e->ring[i].n = (size_t)t->actual_length;
	e->ring[i].at_ns = bb_clock_now_ns(e->bus->base.clk);
	memcpy(e->bytes + (IN_FLIGHT + i) * e->size, t->buffer, e->ring[i].n);
}

static void LIBUSB_CALL in_done(struct libusb_transfer *t)
{
	struct in_endpoint *e = t->user_data;
	struct bus *b = e->bus;
	bool again = false;

	pthread_mutex_lock(&b->lock);
	e->in_flight--;
	if (t->status == LIBUSB_TRANSFER_COMPLETED || t->status == LIBUSB_TRANSFER_OVERFLOW) {
		if (t->status == LIBUSB_TRANSFER_COMPLETED && t->actual_length > 0)
			keep(e, t);
		again = e->status == BB_OK && !b->stop && b->reset == RESET_NONE;
	} else if (t->status == LIBUSB_TRANSFER_NO_DEVICE) {
		b->lost = true;
	} else if (t->status != LIBUSB_TRANSFER_CANCELLED && e->status == BB_OK) {
		e->status = BB_ERR_IO;
	}
	if (again) {
		const int rc = libusb_submit_transfer(t);
		e->in_flight += rc == 0;
		b->lost |= rc == LIBUSB_ERROR_NO_DEVICE;
		if (rc && rc != LIBUSB_ERROR_NO_DEVICE)
			e->status = BB_ERR_IO;
	}
	pthread_cond_broadcast(&b->changed);
	pthread_mutex_unlock(&b->lock);
}

/* The lock is held. */
static void cancel_in(struct in_endpoint *e)
{
	for (size_t i = 0; i < IN_FLIGHT; i++)
		if (e->in_flight && e->transfer[i])
			(void)libusb_cancel_transfer(e->transfer[i]);
}

static enum bb_status submit_in(struct bus *b, struct in_endpoint *e)
{
	for (size_t i = 0; i < IN_FLIGHT; i++) {
		struct libusb_transfer *t = e->transfer[i];
		if (b->type[slot_of(e->address)] == LIBUSB_TRANSFER_TYPE_INTERRUPT)
			libusb_fill_interrupt_transfer(t, b->handle, e->address, e->bytes + i * e->size, (int)e->size,
			                               in_done, e, 0);
		else
			libusb_fill_bulk_transfer(t, b->handle, e->address, e->bytes + i * e->size, (int)e->size,
			                          in_done, e, 0);
		const int rc = libusb_submit_transfer(t);
		if (rc)
			return status_of(rc);
		e->in_flight++;
	}
	return BB_OK;
}

static struct in_endpoint *find_in(struct bus *b, uint8_t endpoint)
{
	for (size_t i = 0; i < b->n_in; i++)
		if (b->in[i].address == endpoint)
			return &b->in[i];
	return NULL;
}

static enum bb_status make_in(struct bus *b, uint8_t endpoint, struct in_endpoint **out)
{
	const size_t slot = slot_of(endpoint);
	struct in_endpoint *e = &b->in[b->n_in];

	if (b->type[slot] == 0xFF || b->n_in == IN_ENDPOINTS)
		return BB_ERR_USAGE;
	const bool bulk = b->type[slot] == LIBUSB_TRANSFER_TYPE_BULK;
	*e = (struct in_endpoint){ .bus = b, .address = endpoint,
		                   .size = bulk ? BULK_BYTES : b->packet_bytes[slot] };
	e->bytes = calloc(IN_FLIGHT + RING, e->size);
	if (!e->bytes)
		return BB_ERR_NOMEM;
	b->n_in++; /* from here on close() frees it */
	for (size_t i = 0; i < IN_FLIGHT; i++) {
		e->transfer[i] = libusb_alloc_transfer(0);
		if (!e->transfer[i])
			return BB_ERR_NOMEM;
	}
	*out = e;
	return BB_OK;
}

static enum bb_status take(struct in_endpoint *e, uint8_t *bytes, size_t *n_bytes)
{
	const size_t n = e->ring[e->head].n < *n_bytes ? e->ring[e->head].n : *n_bytes;

	memcpy(bytes, e->bytes + (IN_FLIGHT + e->head) * e->size, n);
	e->bus->base.arrived_ns = e->ring[e->head].at_ns;
	e->head = (e->head + 1) % RING;
	e->n_ring--;
	*n_bytes = n;
	return BB_OK;
}

static enum bb_status read_in(struct bus *b, uint8_t endpoint, uint8_t *bytes, size_t *n_bytes, int64_t deadline_ns)
{
	struct in_endpoint *e = find_in(b, endpoint);
	enum bb_status status = e ? BB_OK : make_in(b, endpoint, &e);

	if (status == BB_OK && !e->in_flight && e->status == BB_OK && !b->lost)
		status = submit_in(b, e);
	if (status == BB_ERR_LOST)
		b->lost = true;
	if (status != BB_OK)
		return status;
	while (!e->n_ring && !b->lost && e->status == BB_OK)
		if (!wait_change(b, deadline_ns))
			break;
	if (e->n_ring)
		return take(e, bytes, n_bytes);
	*n_bytes = 0;
	return b->lost ? BB_ERR_LOST : e->status == BB_OK ? BB_TIMEOUT : e->status;
}

/* OUT */

static void LIBUSB_CALL out_done(struct libusb_transfer *t)
{
	struct out_slot *s = t->user_data;
	struct bus *b = s->bus;

	pthread_mutex_lock(&b->lock);
	s->busy = false;
	b->n_out_busy--;
	if (t->status == LIBUSB_TRANSFER_NO_DEVICE)
		b->lost = true;
	else if (t->status != LIBUSB_TRANSFER_COMPLETED && t->status != LIBUSB_TRANSFER_CANCELLED)
		b->out_status = BB_ERR_IO;
	pthread_cond_broadcast(&b->changed);
	pthread_mutex_unlock(&b->lock);
}

static enum bb_status write_out(struct bus *b, uint8_t endpoint, const uint8_t *bytes, size_t n)
{
	const enum bb_status before = b->out_status;
	struct out_slot *s = b->out;

	b->out_status = BB_OK;
	if (before != BB_OK)
		return before;
	if (n > OUT_BYTES || b->type[slot_of(endpoint)] == 0xFF)
		return BB_ERR_USAGE;
	while (s < b->out + OUT_SLOTS && s->busy)
		s++;
	if (s == b->out + OUT_SLOTS)
		return BB_ERR_BUSY;
	memcpy(s->bytes, bytes, n);
	if (b->type[slot_of(endpoint)] == LIBUSB_TRANSFER_TYPE_INTERRUPT)
		libusb_fill_interrupt_transfer(s->transfer, b->handle, endpoint, s->bytes, (int)n, out_done, s, 1000);
	else
		libusb_fill_bulk_transfer(s->transfer, b->handle, endpoint, s->bytes, (int)n, out_done, s, 1000);
	const int rc = libusb_submit_transfer(s->transfer);
	s->busy = rc == 0;
	b->n_out_busy += rc == 0;
	return status_of(rc);
}

static enum bb_status transfer(struct bb_usb_bus *bus, uint8_t endpoint, uint8_t *bytes, size_t *n_bytes,
                               int64_t deadline_ns)
{
	struct bus *b = own(bus);
	enum bb_status status;

	pthread_mutex_lock(&b->lock);
	if (b->reset != RESET_NONE)
		status = BB_ERR_BUSY;
	else if (endpoint & 0x80)
		status = read_in(b, endpoint, bytes, n_bytes, deadline_ns);
	else
		status = b->lost ? BB_ERR_LOST : write_out(b, endpoint, bytes, *n_bytes);
	pthread_mutex_unlock(&b->lock);
	return status;
}

static enum bb_status control(struct bb_usb_bus *bus, const struct bb_usb_setup *setup, uint8_t *bytes,
                              size_t *n_bytes, int64_t deadline_ns)
{
	struct bus *b = own(bus);
	const int64_t left_ms = (deadline_ns - bb_clock_now_ns(bus->clk)) / 1000000;
	const uint16_t n = *n_bytes < setup->length ? (uint16_t)*n_bytes : setup->length;

	*n_bytes = 0;
	if (left_ms <= 0)
		return BB_TIMEOUT;
	const int rc = libusb_control_transfer(b->handle, setup->request_type, setup->request, setup->value,
	                                       setup->index, bytes, n,
	                                       left_ms > 10000 ? 10000 : (unsigned)left_ms);
	if (rc >= 0)
		*n_bytes = (size_t)rc;
	return rc >= 0 ? BB_OK : status_of(rc);
}

/* The lock is held: cancelled transfers come back through the event thread. */
static void drain_in(struct bus *b, struct in_endpoint *e)
{
	const int64_t until_ns = bb_clock_now_ns(b->base.clk) + CANCEL_NS;

	cancel_in(e);
	while (e->in_flight && wait_change(b, until_ns))
		;
	e->n_ring = 0;
}

static enum bb_status clear_halt(struct bb_usb_bus *bus, uint8_t endpoint)
{
	struct bus *b = own(bus);

	pthread_mutex_lock(&b->lock);
	struct in_endpoint *e = find_in(b, endpoint);
	if (e) {
		if (e->status == BB_OK)
			e->status = BB_ERR_IO; /* nothing is submitted while it is drained */
		drain_in(b, e);
	}
	const bool lost = b->lost;
	pthread_mutex_unlock(&b->lock);
	if (lost)
		return BB_ERR_LOST;
	const int rc = libusb_clear_halt(b->handle, endpoint);
	pthread_mutex_lock(&b->lock);
	if (e && rc == 0 && !e->in_flight)
		e->status = BB_OK;
	pthread_mutex_unlock(&b->lock);
	return status_of(rc);
}

static enum bb_status bus_reset(struct bb_usb_bus *bus)
{
	struct bus *b = own(bus);
	enum bb_status status = BB_TIMEOUT;

	pthread_mutex_lock(&b->lock);
	if (b->lost) {
		status = BB_ERR_LOST;
	} else if (b->reset == RESET_NONE) {
		b->reset = RESET_ASKED;
		libusb_interrupt_event_handler(b->ctx);
	} else if (b->reset == RESET_DONE) {
		b->reset = RESET_NONE;
		status = b->reset_status;
	}
	pthread_mutex_unlock(&b->lock);
	return status;
}

/* Event thread: takes long, which is why it is here. */
static void do_reset(struct bus *b)
{
	struct timeval wait = { 0, 10000 };
	size_t in_flight = 1;

	for (int i = 0; i < 100 && in_flight; i++) {
		pthread_mutex_lock(&b->lock);
		in_flight = b->n_out_busy;
		for (size_t k = 0; k < b->n_in; k++) {
			if (!i)
				cancel_in(&b->in[k]);
			in_flight += b->in[k].in_flight;
		}
		pthread_mutex_unlock(&b->lock);
		if (in_flight)
			libusb_handle_events_timeout_completed(b->ctx, &wait, NULL);
	}
	const int rc = libusb_reset_device(b->handle);
	pthread_mutex_lock(&b->lock);
	for (size_t k = 0; k < b->n_in; k++) {
		b->in[k].n_ring = 0;
		b->in[k].status = BB_OK;
	}
	b->out_status = BB_OK;
	b->reset_status = status_of(rc);
	b->lost |= b->reset_status == BB_ERR_LOST;
	b->reset = RESET_DONE;
	pthread_mutex_unlock(&b->lock);
}

static void *events(void *arg)
{
	struct bus *b = arg;
	bool stop = false;

	while (!stop) {
		struct timeval wait = { 0, 100000 };
		const int rc = libusb_handle_events_timeout_completed(b->ctx, &wait, NULL);
		pthread_mutex_lock(&b->lock);
		if (rc && rc != LIBUSB_ERROR_INTERRUPTED && rc != LIBUSB_ERROR_TIMEOUT)
			b->lost = true;
		stop = b->stop;
		const bool reset = b->reset == RESET_ASKED;
		pthread_mutex_unlock(&b->lock);
		if (reset && !stop)
			do_reset(b);
	}
	return NULL;
}

/* Close */

static void drain_all(struct bus *b)
{
	const int64_t until_ns = bb_clock_now_ns(b->base.clk) + 20 * CANCEL_NS;
	bool busy = true;

	pthread_mutex_lock(&b->lock);
	/* What was said last, such as "lamps off", may still go out. */
	const int64_t polite_ns = bb_clock_now_ns(b->base.clk) + CANCEL_NS;
	while (b->n_out_busy && !b->lost && wait_change(b, polite_ns))
		;
	for (size_t i = 0; i < b->n_in; i++)
		b->in[i].status = BB_ERR_LOST;
	for (size_t i = 0; i < OUT_SLOTS; i++)
		if (b->out[i].busy)
			(void)libusb_cancel_transfer(b->out[i].transfer);
	for (size_t i = 0; i < b->n_in; i++)
		cancel_in(&b->in[i]);
	while (busy) {
		busy = b->n_out_busy > 0;
		for (size_t i = 0; i < b->n_in; i++)
			busy |= b->in[i].in_flight > 0;
		if (busy && !wait_change(b, until_ns))
			break;
	}
	b->stop = true;
	pthread_mutex_unlock(&b->lock);
}

static void bus_close(struct bb_usb_bus *bus)
{
	struct bus *b = own(bus);

	if (b->threaded) {
		drain_all(b);
		libusb_interrupt_event_handler(b->ctx);
		pthread_join(b->thread, NULL);
	}
	for (size_t i = 0; i < OUT_SLOTS; i++)
		libusb_free_transfer(b->out[i].transfer);
	for (size_t i = 0; i < b->n_in; i++) {
		for (size_t k = 0; k < IN_FLIGHT; k++)
			libusb_free_transfer(b->in[i].transfer[k]);
		free(b->in[i].bytes);
	}
	if (b->claimed)
		(void)libusb_release_interface(b->handle, b->interface);
	if (b->handle)
		libusb_close(b->handle);
	if (b->ctx)
		libusb_exit(b->ctx);
	pthread_cond_destroy(&b->changed);
	pthread_mutex_destroy(&b->lock);
	free(b);
}

static const struct bb_usb_ops ops = { control, transfer, clear_halt, bus_close, bus_reset };

/* Open */

static void learn_endpoints(struct bus *b, const struct libusb_interface_descriptor *d)
{
	for (int i = 0; i < d->bNumEndpoints; i++) {
		const struct libusb_endpoint_descriptor *e = &d->endpoint[i];
		const uint8_t type = e->bmAttributes & 3;
		const uint16_t bytes = e->wMaxPacketSize & 0x7FF;
		if ((type != LIBUSB_TRANSFER_TYPE_BULK && type != LIBUSB_TRANSFER_TYPE_INTERRUPT) || !bytes)
			continue;
		b->type[slot_of(e->bEndpointAddress)] = type;
		b->packet_bytes[slot_of(e->bEndpointAddress)] = bytes;
	}
}

static int learn(struct bus *b, libusb_device *device)
{
	struct libusb_config_descriptor *config;
	const int rc = libusb_get_active_config_descriptor(device, &config);

	memset(b->type, 0xFF, sizeof(b->type));
	if (rc)
		return rc;
	for (int i = 0; i < config->bNumInterfaces; i++)
		if (config->interface[i].num_altsetting > 0 &&
		    config->interface[i].altsetting[0].bInterfaceNumber == b->interface)
			learn_endpoints(b, &config->interface[i].altsetting[0]);
	libusb_free_config_descriptor(config);
	return 0;
}

static void read_serial(libusb_device_handle *handle, uint8_t index, char *out, size_t cap)
{
	unsigned char text[64] = "";
	const int n = index ? libusb_get_string_descriptor_ascii(handle, index, text, sizeof(text)) : 0;

	snprintf(out, cap, "%.*s", n > 0 ? n : 0, (const char *)text);
}

/* Opens every device of that kind until the serial fits; with no serial asked for there must be one only. */
static int pick(struct bus *b, libusb_device **list, ssize_t n, struct bb_usb_match *match, size_t *n_fit)
{
	libusb_device_handle *handle;
	char serial[64];
	int trouble = 0;

	for (ssize_t i = 0; i < n; i++) {
		struct libusb_device_descriptor d;
		if (libusb_get_device_descriptor(list[i], &d) || d.idVendor != match->vendor ||
		    d.idProduct != match->product)
			continue;
		const int rc = libusb_open(list[i], &handle);
		if (rc) {
			trouble = rc;
			continue;
		}
		read_serial(handle, d.iSerialNumber, serial, sizeof(serial));
		if ((*match->serial && strcmp(serial, match->serial)) || ++*n_fit > 1) {
			libusb_close(handle);
			continue;
		}
		b->handle = handle;
	}
	return *n_fit ? 0 : trouble;
}

static int find(struct bus *b, struct bb_usb_match *match, size_t *n_fit)
{
	libusb_device **list;
	const ssize_t n = libusb_get_device_list(b->ctx, &list);

	if (n < 0)
		return (int)n;
	const int rc = pick(b, list, n, match, n_fit);
	libusb_free_device_list(list, 1);
	return rc;
}

static int claim(struct bus *b, struct bb_usb_match *match)
{
	struct libusb_device_descriptor d;
	libusb_device *device = libusb_get_device(b->handle);
	int rc = libusb_get_device_descriptor(device, &d);

	(void)libusb_set_auto_detach_kernel_driver(b->handle, 1);
	if (!rc)
		rc = libusb_claim_interface(b->handle, b->interface);
	b->claimed = rc == 0;
	if (!rc)
		rc = learn(b, device);
	if (!rc)
		read_serial(b->handle, d.iSerialNumber, match->serial, sizeof(match->serial));
	return rc;
}

static bool init_sync(struct bus *b)
{
	pthread_condattr_t attr;

	if (pthread_mutex_init(&b->lock, NULL))
		return false;
	pthread_condattr_init(&attr);
	pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
	const int rc = pthread_cond_init(&b->changed, &attr);
	pthread_condattr_destroy(&attr);
	return rc == 0;
}

static bool begin(struct bus *b)
{
	for (size_t i = 0; i < OUT_SLOTS; i++) {
		b->out[i].bus = b;
		b->out[i].transfer = libusb_alloc_transfer(0);
		if (!b->out[i].transfer)
			return false;
	}
	b->threaded = pthread_create(&b->thread, NULL, events, b) == 0;
	return b->threaded;
}

static enum bb_status explain(struct bb_usb_host *host, const struct bb_usb_match *match, int rc, size_t n_fit)
{
	const char *serial = *match->serial ? " of that serial" : "";

	if (n_fit > 1) {
		snprintf(host->why, sizeof(host->why), "%zu devices %04x:%04x: say which by serial", n_fit,
		         match->vendor, match->product);
		return BB_ERR_BUSY;
	}
	if (!rc) {
		snprintf(host->why, sizeof(host->why), "no %04x:%04x%s is plugged in", match->vendor, match->product,
		         serial);
		return BB_ERR_LOST;
	}
	snprintf(host->why, sizeof(host->why), "%04x:%04x: %s%s", match->vendor, match->product,
	         libusb_strerror((enum libusb_error)rc),
	         rc == LIBUSB_ERROR_ACCESS ? ": install the udev rule" : "");
	return status_of(rc);
}

/* What one open needs and finds: on a thread of its own, because the kernel may keep it waiting. */
struct opening {
	pthread_t thread;
	struct bb_usb_host said; /* its why */
	struct bb_usb_match match;
	struct bb_clock *clk;
	enum bb_status status;
	struct bus *bus;
};

static enum bb_status open_now(struct opening *o)
{
	struct bus *b = calloc(1, sizeof(*b));
	size_t n_fit = 0;

	if (!b)
		return BB_ERR_NOMEM;
	b->base = (struct bb_usb_bus){ .ops = &ops, .clk = o->clk };
	b->interface = o->match.interface;
	if (!init_sync(b)) {
		free(b);
		return BB_ERR_NOMEM;
	}
	int rc = libusb_init(&b->ctx);
	if (!rc)
		rc = find(b, &o->match, &n_fit);
	if (rc || n_fit != 1 || (rc = claim(b, &o->match)) != 0) {
		const enum bb_status status = explain(&o->said, &o->match, rc, n_fit);
		bus_close(&b->base);
		return status;
	}
	if (!begin(b)) {
		bus_close(&b->base);
		return BB_ERR_NOMEM;
	}
	o->bus = b;
	return BB_OK;
}

static void *opening(void *arg)
{
	struct opening *o = arg;

	o->status = open_now(o);
	return NULL;
}

static enum bb_status begin_open(struct bb_usb_host *host, const struct bb_usb_match *match, struct bb_clock *clk)
{
	struct opening *o = calloc(1, sizeof(*o));

	if (!o)
		return BB_ERR_NOMEM;
	o->match = *match;
	o->clk = clk;
	if (pthread_create(&o->thread, NULL, opening, o)) {
		free(o);
		return BB_ERR_NOMEM;
	}
	host->pending = o;
	return BB_OK;
}

/* The condition of joining waits on the stopwatch's clock, not on the bus's. */
static bool joined(struct opening *o, int64_t deadline_ns)
{
	const int64_t at_ns = bb_clock_stopwatch_ns() + deadline_ns - bb_clock_now_ns(o->clk);
	const struct timespec t = { .tv_sec = at_ns / BB_NS_PER_S, .tv_nsec = at_ns % BB_NS_PER_S };

	if (pthread_tryjoin_np(o->thread, NULL) == 0)
		return true;
	return deadline_ns > bb_clock_now_ns(o->clk) &&
	       pthread_clockjoin_np(o->thread, NULL, CLOCK_MONOTONIC, &t) == 0;
}

static enum bb_status host_open(struct bb_usb_host *host, struct bb_usb_match *match, struct bb_clock *clk,
                                int64_t deadline_ns, struct bb_usb_bus **out)
{
	*out = NULL;
	if (bb_clock_is_virtual(clk)) {
		snprintf(host->why, sizeof(host->why), "a real bus needs the posix clock");
		return BB_ERR_UNSUPPORTED;
	}
	const enum bb_status begun = host->pending ? BB_OK : begin_open(host, match, clk);
	if (begun != BB_OK)
		return begun;
	struct opening *o = host->pending;
	if (!joined(o, deadline_ns))
		return BB_TIMEOUT;
	const enum bb_status status = o->status;
	memcpy(host->why, o->said.why, sizeof(host->why));
	if (status == BB_OK) {
		*match = o->match;
		*out = &o->bus->base;
	}
	host->pending = NULL;
	free(o);
	return status;
}

static void host_close(struct bb_usb_host *host)
{
	struct opening *o = host->pending;

	if (!o)
		return;
	pthread_join(o->thread, NULL);
	if (o->bus)
		bus_close(&o->bus->base);
	free(o);
	host->pending = NULL;
}

void bb_usb_host_init(struct bb_usb_host *host)
{
	*host = (struct bb_usb_host){ .open = host_open, .close = host_close };
}

static bool hex4(const char *s, uint16_t *out)
{
	uint32_t v = 0;

	for (int i = 0; i < 4; i++) {
		const char *digits = "0123456789abcdef";
		const char c = (char)(s[i] >= 'A' && s[i] <= 'F' ? s[i] - 'A' + 'a' : s[i]);
		const char *at = c ? strchr(digits, c) : NULL;
		if (!at)
			return false;
		v = v << 4 | (uint32_t)(at - digits);
	}
	*out = (uint16_t)v;
	return true;
}

bool bb_usb_match_read(const struct bb_uri *uri, struct bb_usb_match *out)
{
	memset(out, 0, sizeof(*out));
	if (strlen(uri->path) != 9 || uri->path[4] != ':' || !hex4(uri->path, &out->vendor) ||
	    !hex4(uri->path + 5, &out->product))
		return false;
	for (size_t i = 0; i < uri->n_options; i++)
		if (!strcmp(uri->option[i].key, "serial"))
			snprintf(out->serial, sizeof(out->serial), "%s", uri->option[i].value);
	return true;
}
