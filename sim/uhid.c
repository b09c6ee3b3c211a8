/* sim/uhid.c: see sim/uhid.h. */
#include "sim/uhid.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/input.h>
#include <linux/uhid.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "drivers/pad_wire.h"

struct sim_uhid {
	struct sim_peer_pad *peer;
	int fd;
	bool created;
	unsigned long opens, closes;
};

/* hid-logitech claims Logitech's ids on USB and then refuses what has no USB parent; on another bus it leaves them to
 * hid-generic. Behind the kernel's own Logitech driver they are by their USB face. */
static const struct {
	const char *name;
	uint16_t vendor, product;
	uint16_t bus;
} identities[SIM_PEER_KINDS] = {
	[SIM_PEER_RUMBLEPAD2_WIRED] = { "Logitech RumblePad 2 USB", PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_RUMBLEPAD2_WIRED,
					BUS_BLUETOOTH },
	[SIM_PEER_RUMBLEPAD2_WIRELESS] = { "Logitech Cordless RumblePad 2", PAD_WIRE_VENDOR_LOGITECH,
					   PAD_WIRE_RUMBLEPAD2_WIRELESS, BUS_BLUETOOTH },
	[SIM_PEER_SPACENAVIGATOR] = { "3Dconnexion SpaceNavigator", PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACENAVIGATOR,
				      BUS_BLUETOOTH },
	[SIM_PEER_SPACEMOUSE_WIRELESS] = { "3Dconnexion SpaceMouse Wireless", PAD_WIRE_VENDOR_3DCONNEXION,
					   PAD_WIRE_SPACEMOUSE_WIRELESS, BUS_USB },
};

static enum bb_status post(struct sim_uhid *u, const struct uhid_event *e)
{
	const ssize_t n = write(u->fd, e, sizeof(*e));

	return n == (ssize_t)sizeof(*e) ? BB_OK : BB_ERR_IO;
}

static enum bb_status plug(struct sim_uhid *u)
{
	struct uhid_event e = { .type = UHID_CREATE2 };
	struct uhid_create2_req *c = &e.u.create2;
	const enum sim_peer_kind kind = sim_peer_pad_kind(u->peer);
	size_t n = 0;
	const uint8_t *descriptor = sim_peer_pad_descriptor(u->peer, &n);

	if (n > sizeof(c->rd_data))
		return BB_ERR_IO;
	snprintf((char *)c->name, sizeof(c->name), "%s", identities[kind].name);
	snprintf((char *)c->uniq, sizeof(c->uniq), "%s", sim_peer_pad_serial(u->peer));
	memcpy(c->rd_data, descriptor, n);
	c->rd_size = (uint16_t)n;
	c->bus = identities[kind].bus;
	c->vendor = identities[kind].vendor;
	c->product = identities[kind].product;
	const enum bb_status status = post(u, &e);
	u->created = status == BB_OK;
	return status;
}

static enum bb_status unplug(struct sim_uhid *u)
{
	const struct uhid_event e = { .type = UHID_DESTROY };

	u->created = false;
	u->closes = u->opens; /* the kernel does not say when what was pulled out is let go */
	return post(u, &e);
}

/* An output report. Where the device has no ids, one written to hidraw still has the 0 in front, one from a driver of
 * the kernel has nothing. */
static void give(struct sim_uhid *u, const uint8_t *bytes, size_t n)
{
	uint8_t with_id[64] = { 0 };
	const bool lacks_id = sim_peer_pad_kind(u->peer) == SIM_PEER_RUMBLEPAD2_WIRED && n == PAD_WIRE_RUMBLE_BYTES;

	if (n + 1 > sizeof(with_id))
		return;
	memcpy(with_id + lacks_id, bytes, n);
	(void)!sim_peer_pad_give(u->peer, with_id, n + lacks_id);
}

static void answer(struct sim_uhid *u, const struct uhid_event *e)
{
	struct uhid_event reply = { 0 };

	switch (e->type) {
	case UHID_OPEN:
		u->opens++;
		break;
	case UHID_CLOSE:
		u->closes++;
		break;
	case UHID_OUTPUT:
		if (e->u.output.size <= sizeof(e->u.output.data))
			give(u, e->u.output.data, e->u.output.size);
		break;
	case UHID_SET_REPORT:
		reply.type = UHID_SET_REPORT_REPLY;
		reply.u.set_report_reply.id = e->u.set_report.id;
		if (e->u.set_report.size <= sizeof(e->u.set_report.data))
			give(u, e->u.set_report.data, e->u.set_report.size);
		(void)!post(u, &reply);
		break;
	case UHID_GET_REPORT:
		reply.type = UHID_GET_REPORT_REPLY;
		reply.u.get_report_reply.id = e->u.get_report.id;
		reply.u.get_report_reply.err = EIO;
		(void)!post(u, &reply);
		break;
	default:
		break;
	}
}

static enum bb_status send(struct sim_uhid *u)
{
	struct uhid_event e = { .type = UHID_INPUT2 };
	int64_t at_ns;
	size_t n = 0;

	const enum bb_status status = sim_peer_pad_take(u->peer, e.u.input2.data, SIM_PEER_PACKET_BYTES, &n, &at_ns);
	if (status != BB_OK)
		return status;
	e.u.input2.size = (uint16_t)n;
	return post(u, &e);
}

enum bb_status sim_uhid_step(struct sim_uhid *u)
{
	struct uhid_event e;
	enum bb_status status = BB_OK;

	if (u->created && !sim_peer_pad_plugged(u->peer))
		return unplug(u);
	if (!u->created && sim_peer_pad_plugged(u->peer))
		status = plug(u);
	if (status != BB_OK || !u->created)
		return status;
	while (read(u->fd, &e, sizeof(e)) > 0) /* the kernel gives whole events */
		answer(u, &e);
	while ((status = send(u)) == BB_OK)
		;
	return status == BB_TIMEOUT ? BB_OK : status;
}

enum bb_status sim_uhid_create(struct sim_peer_pad *peer, struct sim_uhid **out)
{
	size_t n = 0;

	*out = NULL;
	if (!sim_peer_pad_descriptor(peer, &n))
		return BB_ERR_UNSUPPORTED;
	const int fd = open("/dev/uhid", O_RDWR | O_CLOEXEC | O_NONBLOCK);
	if (fd < 0)
		return errno == ENOENT || errno == ENODEV ? BB_ERR_UNSUPPORTED : BB_ERR_IO;
	struct sim_uhid *u = calloc(1, sizeof(*u));
	if (!u) {
		close(fd);
		return BB_ERR_NOMEM;
	}
	*u = (struct sim_uhid){ .peer = peer, .fd = fd };
	const enum bb_status status = sim_peer_pad_plugged(peer) ? plug(u) : BB_OK;
	if (status != BB_OK) {
		sim_uhid_destroy(u);
		return status;
	}
	*out = u;
	return BB_OK;
}

void sim_uhid_destroy(struct sim_uhid *u)
{
	if (!u)
		return;
	if (u->created)
		(void)!unplug(u);
	close(u->fd);
	free(u);
}

unsigned long sim_uhid_opens(const struct sim_uhid *u)
{
	return u->opens;
}

bool sim_uhid_is_open(const struct sim_uhid *u)
{
	return u->opens > u->closes;
}
