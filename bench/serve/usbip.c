/*
 * bench/serve/usbip.c: the USB devices of a room on one USB/IP port: IR cameras, RumblePads 2, SpaceMice, receivers of
 * Xbox 360 pads, four to one, and monitors, each behind an I2C adapter of its own. A class more is a row of `classes`. Whoever attaches them needs Linux with vhci-hcd.
 */
#include "bench/serve/serve.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/trackir_wire.h"
#include "hal/uri.h"
#include "sim/peer_camera.h"
#include "sim/peer_pads.h"
#include "sim/sim.h"
#include "sim/usb_monitor.h"
#include "sim/usbip_server.h"

#define LOOK_NS (BB_NS_PER_S / 2000) /* how often devices are asked while somebody is there */
#define SEED 1

struct usb {
	struct usbip_server *server;
	uint16_t port;
	size_t n_cameras, n_pads, n_monitors;
	struct served_camera {
		struct bb_uri uri;
		struct bb_camera *model;
		struct peer_camera *peer;
	} *camera;
	struct sim_peer_pad **pad;
	struct usb_monitor *monitor;
	struct sim_xbox_receiver *receiver;
	size_t receiver_row; /* of the newest */
};

/* Exports the device and says how to get it. */
static enum bb_status put(struct bb_serve *s, struct usb *u, const char *class_name, const char *id,
                          struct sim_usb_device *device, struct bb_error *err)
{
	struct bb_serve_row *row = bb_serve_add(s, "usbip", class_name, id, err);
	char port[24] = "";
	size_t item;

	if (!row)
		return BB_ERR_RANGE;
	if (usbip_server_export(u->server, device, &item) != BB_OK)
		return bb_fail(err, BB_ERR_RANGE, 1571, NULL, "more than %d USB devices", USBIP_EXPORTS);
	if (u->port != USBIP_PORT)
		snprintf(port, sizeof(port), " --tcp-port %u", u->port);
	snprintf(row->where, sizeof(row->where), "%s:%u 1-%zu", s->bind, u->port, item + 1);
	snprintf(row->attach, sizeof(row->attach), "modprobe vhci-hcd; usbip%s attach -r %s -b 1-%zu", port, s->bind,
	         item + 1);
	return BB_OK;
}

/* Its model is in the world, where faults find it. */
static enum bb_status open_camera(struct bb_serve *s, struct served_camera *c, const struct bb_camera_config *config,
                                  struct bb_error *err)
{
	const struct peer_camera_options options = { .serial = config->id, .stamped = true,
		                                     .offset_ns = (int64_t)(config->sync_offset_us * 1000) };
	const struct bb_open open = { .clk = s->clk, .uri = &c->uri, .seed = SEED, .fidelity = 1, .world = s->world };
	enum bb_status status = bb_uri_parse(config->device[0] ? config->device : "sim:", &c->uri, NULL, err);

	if (status != BB_OK)
		return status;
	status = bb_camera_open(&sim_camera_driver, config, &open, &c->model);
	if (status == BB_OK)
		status = peer_camera_create(c->model, &options, &c->peer);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1503, NULL, "camera/%s", config->id);
}

static enum bb_status put_cameras(struct bb_serve *s, struct usb *u, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < s->room->n_cameras && status == BB_OK; i++) {
		const struct bb_camera_config *config = &s->room->cameras[i];
		if (!bb_serve_simulated(config->device))
			continue;
		if (config->width_px > TRACKIR_WIDTH_PX || config->height_px > TRACKIR_HEIGHT_PX) {
			fprintf(stderr, "camera/%s is not served: cameras of this kind have %d x %d pixels at most\n",
			        config->id, TRACKIR_WIDTH_PX, TRACKIR_HEIGHT_PX);
			continue;
		}
		struct served_camera *c = &u->camera[u->n_cameras++];
		status = open_camera(s, c, config, err);
		if (status == BB_OK)
			status = put(s, u, "camera", config->id, peer_camera_usb(c->peer), err);
	}
	return status;
}

/* A receiver is what has the plug: it is exported when its first pad is known. */
static struct sim_usb_device *receiver_of(struct usb *u, struct sim_peer_pad *pad, size_t n_xbox)
{
	struct sim_xbox_receiver *r = &u->receiver[n_xbox / SIM_XBOX_SLOTS];

	if (n_xbox % SIM_XBOX_SLOTS == 0)
		sim_xbox_init(r);
	r->pad[n_xbox % SIM_XBOX_SLOTS] = pad;
	return n_xbox % SIM_XBOX_SLOTS ? NULL : &r->usb;
}

/* One more pad of the newest receiver. */
static enum bb_status put_beside(struct bb_serve *s, const struct usb *u, const char *id, struct bb_error *err)
{
	struct bb_serve_row *row = bb_serve_add(s, "usbip", "gamepad", id, err);

	if (!row)
		return BB_ERR_RANGE;
	memcpy(row->where, s->row[u->receiver_row].where, sizeof(row->where));
	snprintf(row->attach, sizeof(row->attach), "the same receiver");
	return BB_OK;
}

static enum bb_status put_pads(struct bb_serve *s, struct usb *u, struct bb_error *err)
{
	static const enum sim_peer_kind kinds[] = { [BB_PAD_RUMBLEPAD2] = SIM_PEER_RUMBLEPAD2_WIRELESS,
		                                    [BB_PAD_SPACEMOUSE] = SIM_PEER_SPACEMOUSE_WIRELESS,
		                                    [BB_PAD_XBOX360] = SIM_PEER_XBOX_PAD };
	size_t n_xbox = 0;

	for (size_t i = 0; i < s->room->n_gamepads; i++) {
		const struct bb_gamepad_config *config = &s->room->gamepads[i];
		const struct sim_peer_config c = { .kind = kinds[config->model], .id = config->id,
			                           .script = config->script, .seed = SEED, .clk = s->clk,
			                           .world = s->world };
		struct sim_peer_pad **pad = &u->pad[u->n_pads];
		if (!bb_serve_simulated(config->device))
			continue;
		enum bb_status status = sim_peer_pad_create(&c, pad);
		if (status != BB_OK)
			return bb_fail(err, status, 1503, NULL, "gamepad/%s", config->id);
		u->n_pads++;
		if (config->model == BB_PAD_XBOX360 && n_xbox % SIM_XBOX_SLOTS == 0)
			u->receiver_row = s->n_rows;
		struct sim_usb_device *device = config->model == BB_PAD_XBOX360 ? receiver_of(u, *pad, n_xbox++)
		                                                               : sim_peer_pad_usb(*pad);
		status = device ? put(s, u, "gamepad", config->id, device, err) : put_beside(s, u, config->id, err);
		if (status != BB_OK)
			return status;
	}
	return BB_OK;
}

/* As many as the port holds: a wall has more monitors than USB/IP has places. */
static enum bb_status put_monitors(struct bb_serve *s, struct usb *u, struct bb_error *err)
{
	const size_t room_left = USBIP_EXPORTS - u->n_cameras - u->n_pads;
	size_t left_out = 0;

	for (size_t i = 0; i < s->room->n_monitors; i++) {
		const struct bb_monitor_config *config = &s->room->monitors[i];
		struct usb_monitor *m = &u->monitor[u->n_monitors];
		if (!bb_serve_simulated(config->device))
			continue;
		if (u->n_monitors == room_left) {
			left_out++;
			continue;
		}
		enum bb_status status = usb_monitor_init(m, config, s->world, SEED, s->clk);
		if (status != BB_OK)
			return bb_fail(err, status, 1503, NULL, "monitor/%s", config->id);
		u->n_monitors++;
		status = put(s, u, "monitor", config->id, usb_monitor_device(m), err);
		if (status != BB_OK)
			return status;
	}
	if (left_out)
		fprintf(stderr, "%zu monitors are not served: one port holds %d USB devices\n", left_out, USBIP_EXPORTS);
	return BB_OK;
}

static enum bb_status (*const classes[])(struct bb_serve *s, struct usb *u, struct bb_error *err) = { put_cameras, put_pads,
	                                                                                              put_monitors };

static void welcome(void *peer, int fd, const uint8_t *bytes, size_t n)
{
	usbip_server_take(((struct usb *)peer)->server, fd, bytes, n);
}

static const struct sim_wire_protocol protocol = { .name = "usbip", .adopt = welcome };

static bool anything(const struct bb_room *room)
{
	for (size_t i = 0; i < room->n_cameras; i++)
		if (bb_serve_simulated(room->cameras[i].device))
			return true;
	for (size_t i = 0; i < room->n_gamepads; i++)
		if (bb_serve_simulated(room->gamepads[i].device))
			return true;
	for (size_t i = 0; i < room->n_monitors; i++)
		if (bb_serve_simulated(room->monitors[i].device))
			return true;
	return false;
}

static bool set_up(struct bb_serve *s, struct usb *u)
{
	u->camera = calloc(s->room->n_cameras + 1, sizeof(*u->camera));
	u->pad = calloc(s->room->n_gamepads + 1, sizeof(*u->pad));
	u->receiver = calloc(s->room->n_gamepads + 1, sizeof(*u->receiver));
	u->monitor = calloc(s->room->n_monitors + 1, sizeof(*u->monitor));
	return u->camera && u->pad && u->receiver && u->monitor && usbip_server_create(s->clk, &u->server) == BB_OK;
}

static enum bb_status attach(struct bb_serve *s, void **state, struct bb_error *err)
{
	double port;
	enum bb_status status = bb_cli_whole(s->cli, "usbip-port", USBIP_PORT, 0, 65535, &port, err);

	if (status != BB_OK || !anything(s->room))
		return status;
	struct usb *u = calloc(1, sizeof(*u));
	*state = u;
	if (!u || !set_up(s, u))
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "USB/IP");
	const struct sim_wire_listen at = { s->bind, (uint16_t)port, s->token };
	status = sim_wire_tcp(s->wire, &at, &protocol, u, &u->port, err);
	for (size_t i = 0; i < BB_ARRAY_LEN(classes) && status == BB_OK; i++)
		status = classes[i](s, u, err);
	return status;
}

static int64_t step(struct bb_serve *s, void *state, int64_t now_ns)
{
	struct usb *u = state;

	(void)s;
	if (!u)
		return BB_NEVER;
	for (size_t i = 0; i < u->n_monitors; i++)
		(void)usb_monitor_step(&u->monitor[i], now_ns); /* the look below comes before it would want to */
	usbip_server_step(u->server, 0);
	return usbip_server_clients(u->server) ? now_ns + LOOK_NS : BB_NEVER;
}

static void detach(struct bb_serve *s, void *state)
{
	struct usb *u = state;

	(void)s;
	if (!u)
		return;
	usbip_server_destroy(u->server);
	for (size_t i = 0; i < u->n_cameras; i++) {
		peer_camera_destroy(u->camera[i].peer);
		bb_camera_close(u->camera[i].model);
	}
	for (size_t i = 0; i < u->n_pads; i++)
		sim_peer_pad_destroy(u->pad[i]);
	for (size_t i = 0; i < u->n_monitors; i++)
		usb_monitor_fini(&u->monitor[i]);
	free(u->monitor);
	free(u->camera);
	free(u->pad);
	free(u->receiver);
	free(u);
}

const struct bb_serve_kind bb_serve_usbip = { "usbip", attach, step, detach };
