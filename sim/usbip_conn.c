/* sim/usbip_conn.c: see sim/usbip_conn.h. Numbers of the protocol stand here only; big-endian but for SETUP packets. */
#include "sim/usbip_conn.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VERSION 0x0111
#define OP_REQ_DEVLIST 0x8005
#define OP_REP_DEVLIST 0x0005
#define OP_REQ_IMPORT 0x8003
#define OP_REP_IMPORT 0x0003
#define CMD_SUBMIT 1
#define CMD_UNLINK 2
#define RET_SUBMIT 3
#define RET_UNLINK 4
#define HEADER 48
#define RECORD 312
#define BUSID 32
#define NOT_ISO 0xFFFFFFFFu
#define STATUS_NO_DEVICE 4

/* Linux's numbers, whatever this machine's are: they go over the wire. */
#define WIRE_EPIPE (-32)
#define WIRE_ECONNRESET (-104)
#define WIRE_EOVERFLOW (-75)

enum phase { ASKING, ATTACHED, DONE };

struct parked {
	uint32_t seqnum;
	uint8_t endpoint;         /* bit 7: IN */
	bool control;
	struct bb_usb_setup setup;
	size_t n;                 /* bytes wanted, or held in data */
	uint8_t *data;            /* OUT */
};

struct usbip_conn {
	struct usbip_exports *exports;
	struct usbip_export *item;
	struct sim_usb_device *device;
	enum phase phase;
	size_t n_in, n_out, n_parked;
	struct parked parked[USBIP_PARKED_MAX];
	uint8_t in[HEADER + USBIP_DATA_MAX];
	uint8_t out[USBIP_OUT_MAX];
	uint8_t data[USBIP_DATA_MAX];
};

static uint16_t get16(const uint8_t *p)
{
	return (uint16_t)(p[0] << 8 | p[1]);
}

static uint32_t get32(const uint8_t *p)
{
	return (uint32_t)get16(p) << 16 | get16(p + 2);
}

static void put16(uint8_t *p, uint32_t v)
{
	p[0] = (uint8_t)(v >> 8);
	p[1] = (uint8_t)v;
}

static void put32(uint8_t *p, uint32_t v)
{
	put16(p, v >> 16);
	put16(p + 2, v & 0xFFFF);
}

/* Room that must be there: usbip_conn_room() keeps the worst reply free. */
static uint8_t *reserve(struct usbip_conn *c, size_t n)
{
	uint8_t *at = c->out + c->n_out;

	if (n > sizeof(c->out) - c->n_out)
		return NULL;
	memset(at, 0, n);
	c->n_out += n;
	return at;
}

/* Lists */

static void put_record(uint8_t *p, const struct usbip_export *e)
{
	const struct sim_usb_device *d = e->device;

	snprintf((char *)p, 256, "/sys/devices/blackburst/usb%u/%s", e->busnum, e->busid);
	memcpy(p + 256, e->busid, BUSID);
	put32(p + 288, e->busnum);
	put32(p + 292, e->devnum);
	put32(p + 296, (uint32_t)d->speed);
	put16(p + 300, sim_usb_vendor(d));
	put16(p + 302, sim_usb_product(d));
	put16(p + 304, (uint32_t)d->device[12] | (uint32_t)d->device[13] << 8);
	memcpy(p + 306, d->device + 4, 3); /* class, subclass, protocol */
	p[309] = d->configuration;
	p[310] = d->device[17];
	p[311] = d->config[4];
}

/* Class, subclass and protocol of the interfaces, alternate settings left out; returns how many were found. */
static size_t put_interfaces(uint8_t *p, const struct sim_usb_device *d)
{
	size_t n = 0;

	for (size_t i = 0; i + 9 <= d->n_config && d->config[i]; i += d->config[i]) {
		const uint8_t *at = d->config + i;
		if (at[1] != 4 || at[3] || n == at[4] + 256u || n == d->config[4])
			continue;
		memcpy(p + 4 * n, at + 5, 3);
		n++;
	}
	return n;
}

static bool is_there(const struct usbip_export *e)
{
	return e->device && e->device->ops->present(e->device);
}

static bool list(struct usbip_conn *c)
{
	uint8_t *head = reserve(c, 12);
	uint32_t n = 0;

	if (!head)
		return false;
	for (size_t i = 0; i < c->exports->n; i++) {
		const struct usbip_export *e = &c->exports->item[i];
		if (!is_there(e) || e->taken)
			continue;
		uint8_t *p = reserve(c, RECORD + 4u * e->device->config[4]);
		if (!p)
			return false;
		put_record(p, e);
		put_interfaces(p + RECORD, e->device);
		n++;
	}
	put16(head, VERSION);
	put16(head + 2, OP_REP_DEVLIST);
	put32(head + 8, n);
	c->phase = DONE;
	return true;
}

static struct usbip_export *find(struct usbip_conn *c, const uint8_t *busid)
{
	for (size_t i = 0; i < c->exports->n; i++) {
		struct usbip_export *e = &c->exports->item[i];
		if (is_there(e) && !e->taken && !memcmp(e->busid, busid, BUSID))
			return e;
	}
	return NULL;
}

static void attach(struct usbip_conn *c, struct usbip_export *e)
{
	c->item = e;
	c->device = e->device;
	c->phase = ATTACHED;
	e->taken = true;
	sim_usb_reset(e->device);
}

static bool import(struct usbip_conn *c, const uint8_t *busid)
{
	struct usbip_export *e = find(c, busid);
	uint8_t *p = reserve(c, e ? 8 + RECORD : 8);

	if (!p)
		return false;
	put16(p, VERSION);
	put16(p + 2, OP_REP_IMPORT);
	if (!e) {
		put32(p + 4, STATUS_NO_DEVICE);
		c->phase = DONE;
		return true;
	}
	put_record(p + 8, e);
	attach(c, e);
	return true;
}

/* Transfers */

static bool reply_submit(struct usbip_conn *c, uint32_t seqnum, int32_t status, const uint8_t *data, size_t n,
                         size_t actual)
{
	uint8_t *p = reserve(c, HEADER + n);

	if (!p)
		return false;
	put32(p, RET_SUBMIT);
	put32(p + 4, seqnum);
	put32(p + 20, (uint32_t)status);
	put32(p + 24, (uint32_t)actual);
	if (n)
		memcpy(p + HEADER, data, n);
	return true;
}

static int ask_device(struct usbip_conn *c, const struct parked *u)
{
	uint8_t *bytes = u->data ? u->data : c->data;

	if (u->control)
		return sim_usb_control(c->device, &u->setup, bytes, u->n);
	return sim_usb_transfer(c->device, u->endpoint, bytes, u->n);
}

/* True: answered. False in *alive: the connection must end. */
static bool try_transfer(struct usbip_conn *c, const struct parked *u, bool *alive)
{
	const int moved = ask_device(c, u);
	const bool in = (u->endpoint & 0x80) != 0;

	if (moved == SIM_USB_NAK)
		return false;
	if (moved == SIM_USB_GONE) {
		*alive = false;
		return true;
	}
	if (moved < 0)
		*alive = reply_submit(c, u->seqnum, WIRE_EPIPE, NULL, 0, 0);
	else if ((size_t)moved > u->n)
		*alive = reply_submit(c, u->seqnum, WIRE_EOVERFLOW, NULL, 0, 0);
	else
		*alive = reply_submit(c, u->seqnum, 0, c->data, in ? (size_t)moved : 0, (size_t)moved);
	return true;
}

static void forget(struct usbip_conn *c, size_t i)
{
	free(c->parked[i].data);
	memmove(&c->parked[i], &c->parked[i + 1], (--c->n_parked - i) * sizeof(c->parked[0]));
}

static bool waits(const struct usbip_conn *c, uint8_t endpoint)
{
	for (size_t i = 0; i < c->n_parked; i++)
		if (c->parked[i].endpoint == endpoint)
			return true;
	return false;
}

static bool park(struct usbip_conn *c, const struct parked *u)
{
	struct parked *p = &c->parked[c->n_parked];

	if (c->n_parked == USBIP_PARKED_MAX)
		return false;
	*p = *u;
	if (u->data) {
		p->data = malloc(u->n ? u->n : 1);
		if (!p->data)
			return false;
		memcpy(p->data, u->data, u->n);
	}
	c->n_parked++;
	return true;
}

static struct bb_usb_setup read_setup(const uint8_t *p)
{
	return (struct bb_usb_setup){ .request_type = p[0], .request = p[1], .value = (uint16_t)(p[2] | p[3] << 8),
		                      .index = (uint16_t)(p[4] | p[5] << 8), .length = (uint16_t)(p[6] | p[7] << 8) };
}

/* How many bytes the command at the head of the buffer has; 0: it is not one. */
static size_t command_length(const uint8_t *p)
{
	const uint32_t length = get32(p + 24), packets = get32(p + 32);

	if (get32(p + 12) > 1 || get32(p + 16) > 15)
		return 0;
	if (get32(p) == CMD_UNLINK)
		return HEADER;
	if (get32(p) != CMD_SUBMIT || length > USBIP_DATA_MAX || (packets != 0 && packets != NOT_ISO))
		return 0;
	return get32(p + 12) ? HEADER : HEADER + length;
}

static bool submit(struct usbip_conn *c, uint8_t *p)
{
	const bool in = get32(p + 12) == 1;
	struct parked u = { .seqnum = get32(p + 4), .n = get32(p + 24), .data = in ? NULL : p + HEADER };
	bool alive = true;

	u.endpoint = (uint8_t)(get32(p + 16) | (in ? 0x80 : 0));
	u.control = get32(p + 16) == 0;
	if (u.control) {
		u.setup = read_setup(p + 40);
		if (((u.setup.request_type & 0x80) != 0) != in && u.setup.length)
			return reply_submit(c, u.seqnum, WIRE_EPIPE, NULL, 0, 0);
	}
	/* Nothing overtakes on one endpoint. */
	if (waits(c, u.endpoint) || !try_transfer(c, &u, &alive))
		return park(c, &u);
	return alive;
}

static bool unlink_urb(struct usbip_conn *c, const uint8_t *p)
{
	const uint32_t seqnum = get32(p + 20);
	uint8_t *reply = reserve(c, HEADER);
	int32_t status = 0;

	if (!reply)
		return false;
	for (size_t i = 0; i < c->n_parked; i++)
		if (c->parked[i].seqnum == seqnum) {
			forget(c, i);
			status = WIRE_ECONNRESET;
			break;
		}
	put32(reply, RET_UNLINK);
	put32(reply + 4, get32(p + 4));
	put32(reply + 20, (uint32_t)status);
	return true;
}

/* One request or command from the head of the buffer. *used 0: it is not whole yet. */
static bool ask_one(struct usbip_conn *c, size_t *used)
{
	const uint8_t *p = c->in;

	if (c->n_in < 8)
		return true;
	if (get16(p) != VERSION || get32(p + 4))
		return false;
	if (get16(p + 2) == OP_REQ_DEVLIST) {
		*used = 8;
		return list(c);
	}
	if (get16(p + 2) != OP_REQ_IMPORT)
		return false;
	if (c->n_in < 8 + BUSID)
		return true;
	*used = 8 + BUSID;
	return import(c, p + 8);
}

static bool command_one(struct usbip_conn *c, size_t *used)
{
	if (c->n_in < HEADER)
		return true;
	const size_t n = command_length(c->in);
	if (!n || get32(c->in + 8) != (c->item->busnum << 16 | c->item->devnum))
		return false;
	if (c->n_in < n)
		return true;
	*used = n;
	return get32(c->in) == CMD_SUBMIT ? submit(c, c->in) : unlink_urb(c, c->in);
}

static bool has_room(const struct usbip_conn *c)
{
	return sizeof(c->out) - c->n_out >= HEADER + USBIP_DATA_MAX;
}

static bool work(struct usbip_conn *c)
{
	while (has_room(c) && c->phase != DONE) {
		size_t used = 0;
		if (!(c->phase == ASKING ? ask_one(c, &used) : command_one(c, &used)))
			return false;
		if (!used)
			return true;
		memmove(c->in, c->in + used, c->n_in - used);
		c->n_in -= used;
	}
	if (c->phase == DONE)
		c->n_in = 0; /* whatever it still says */
	return true;
}

size_t usbip_conn_room(const struct usbip_conn *c)
{
	return has_room(c) ? sizeof(c->in) - c->n_in : 0;
}

bool usbip_conn_feed(struct usbip_conn *c, const uint8_t *bytes, size_t n)
{
	while (n) {
		size_t take = sizeof(c->in) - c->n_in;
		take = take < n ? take : n;
		if (!take)
			return false; /* more than there was room for */
		memcpy(c->in + c->n_in, bytes, take);
		c->n_in += take;
		bytes += take;
		n -= take;
		if (!work(c))
			return false;
	}
	return true;
}

bool usbip_conn_step(struct usbip_conn *c)
{
	uint32_t blocked = 0; /* endpoints whose oldest transfer still waits */
	bool alive = true;

	if (c->phase != ATTACHED)
		return true;
	if (!is_there(c->item) || c->item->device != c->device)
		return false;
	for (size_t i = 0; i < c->n_parked && has_room(c) && alive;) {
		const uint32_t bit = 1u << ((c->parked[i].endpoint & 0x0F) + (c->parked[i].endpoint & 0x80 ? 16 : 0));
		if (!(blocked & bit) && try_transfer(c, &c->parked[i], &alive)) {
			forget(c, i);
			continue;
		}
		blocked |= bit;
		i++;
	}
	return alive && work(c);
}

const uint8_t *usbip_conn_out(const struct usbip_conn *c, size_t *n)
{
	*n = c->n_out;
	return c->out;
}

void usbip_conn_sent(struct usbip_conn *c, size_t n)
{
	memmove(c->out, c->out + n, c->n_out - n);
	c->n_out -= n;
}

bool usbip_conn_is_attached(const struct usbip_conn *c)
{
	return c->phase == ATTACHED;
}

bool usbip_conn_is_done(const struct usbip_conn *c)
{
	return c->phase == DONE && !c->n_out;
}

enum bb_status usbip_conn_create(struct usbip_exports *exports, struct usbip_conn **out)
{
	struct usbip_conn *c = calloc(1, sizeof(*c));

	*out = c;
	if (!c)
		return BB_ERR_NOMEM;
	c->exports = exports;
	return BB_OK;
}

enum bb_status usbip_conn_create_attached(struct usbip_exports *exports, size_t item, struct usbip_conn **out)
{
	*out = NULL;
	if (item >= exports->n || exports->item[item].taken || !is_there(&exports->item[item]))
		return BB_ERR_BUSY;
	const enum bb_status status = usbip_conn_create(exports, out);
	if (status == BB_OK)
		attach(*out, &exports->item[item]);
	return status;
}

void usbip_conn_destroy(struct usbip_conn *c)
{
	if (!c)
		return;
	while (c->n_parked)
		forget(c, c->n_parked - 1);
	if (c->item) {
		c->item->taken = false;
		if (c->item->device == c->device && c->device)
			sim_usb_reset(c->device); /* unplugged from that host */
	}
	free(c);
}
