/*
 * tests/guest/wire_pad.h: a simulated gamepad before the kernel of a guest: by uhid, or as a USB device behind vhci. The
 * peer and what carries it are a thread of their own, because the kernel asks them while a driver's call waits. What the
 * peer is told or asked from elsewhere happens between pad_wire_lock and pad_wire_unlock. Header only.
 */
#ifndef BB_TESTS_GUEST_WIRE_PAD_H
#define BB_TESTS_GUEST_WIRE_PAD_H

#include <poll.h>
#include <pthread.h>

#include "sim/uhid.h"
#include "tests/guest/usb_vhci.h"

#define PAD_WIRE_STEP_MS 1 /* how often the wire is looked at */

struct pad_wire {
	pthread_mutex_t lock;
	pthread_t thread;
	bool running, stop, usb, failed, attached;
	struct bb_clock *clk;
	struct sim_peer_pad *peer;
	struct sim_uhid *uhid;
	struct usbip_server *server;
	struct sim_xbox_receiver receiver;
	struct sim_usb_device *dev;
	size_t item;
	unsigned int port;
	int64_t said_ns; /* when the peer had its newest packet ready; CLOCK_MONOTONIC */
};

static inline void pad_wire_said(void *ctx)
{
	((struct pad_wire *)ctx)->said_ns = bb_clock_stopwatch_ns();
}

static inline void pad_wire_follow_plug(struct pad_wire *w)
{
	if (w->attached == sim_peer_pad_plugged(w->peer))
		return;
	w->attached = !w->attached;
	if (!w->attached) {
		usbip_server_withdraw(w->server, w->item);
		return;
	}
	w->port = (w->port + 1) % 8; /* never the one it was on */
	usbip_server_plug(w->server, w->item, w->dev);
	w->failed |= !vhci_attach(w->server, w->item, w->dev, w->port);
}

static inline void pad_wire_step(struct pad_wire *w)
{
	bb_clock_run_until(w->clk, bb_clock_now_ns(w->clk));
	if (w->uhid)
		w->failed |= sim_uhid_step(w->uhid) == BB_ERR_IO;
	if (!w->server)
		return;
	pad_wire_follow_plug(w);
	usbip_server_step(w->server, 0);
}

static inline void pad_wire_lock(struct pad_wire *w)
{
	pthread_mutex_lock(&w->lock);
}

static inline void pad_wire_unlock(struct pad_wire *w)
{
	pthread_mutex_unlock(&w->lock);
}

static inline void *pad_wire_main(void *arg)
{
	struct pad_wire *w = arg;
	bool stop = false;

	while (!stop) {
		pad_wire_lock(w);
		pad_wire_step(w);
		stop = w->stop;
		pad_wire_unlock(w);
		(void)poll(NULL, 0, PAD_WIRE_STEP_MS);
	}
	return NULL;
}

static inline enum bb_status pad_wire_usb(struct pad_wire *w)
{
	if (!vhci_there())
		return BB_ERR_UNSUPPORTED;
	sim_xbox_init(&w->receiver);
	w->receiver.pad[0] = w->peer;
	w->dev = sim_peer_pad_usb(w->peer) ? sim_peer_pad_usb(w->peer) : &w->receiver.usb;
	enum bb_status status = usbip_server_create(w->clk, &w->server);
	if (status == BB_OK)
		status = usbip_server_export(w->server, w->dev, &w->item);
	if (status != BB_OK)
		return status;
	w->attached = true;
	return vhci_attach(w->server, w->item, w->dev, w->port) ? BB_OK : BB_ERR_IO;
}

/* Behind vhci's port, or by uhid; script "" is one generated from the seed, counted from now. A wire that has begun is to
 * be ended, whatever this returns; BB_ERR_UNSUPPORTED: the kernel here has no such thing. */
static inline enum bb_status pad_wire_begin(struct pad_wire *w, enum sim_peer_kind kind, const char *script, bool usb,
					    unsigned int port)
{
	struct sim_peer_config c = { .kind = kind, .id = "A1", .script = script, .seed = 7 };

	*w = (struct pad_wire){ .usb = usb, .port = port };
	if (bb_clock_posix_create(&w->clk) != BB_OK)
		return BB_ERR_NOMEM;
	c.clk = w->clk;
	enum bb_status status = sim_peer_pad_create(&c, &w->peer);
	if (status == BB_OK)
		status = usb ? pad_wire_usb(w) : sim_uhid_create(w->peer, &w->uhid);
	if (status != BB_OK)
		return status;
	sim_peer_pad_listen(w->peer, pad_wire_said, w);
	pthread_mutex_init(&w->lock, NULL);
	w->running = !pthread_create(&w->thread, NULL, pad_wire_main, w);
	return w->running ? BB_OK : BB_ERR_NOMEM;
}

static inline void pad_wire_end(struct pad_wire *w)
{
	if (w->running) {
		pad_wire_lock(w);
		w->stop = true;
		pad_wire_unlock(w);
		pthread_join(w->thread, NULL);
	}
	sim_uhid_destroy(w->uhid);
	usbip_server_destroy(w->server);
	sim_peer_pad_destroy(w->peer);
	bb_clock_destroy(w->clk);
}

/* Returns when the kernel has been told. */
static inline void pad_wire_plug(struct pad_wire *w, bool on)
{
	pad_wire_lock(w);
	sim_peer_pad_unplug(w->peer, !on);
	pad_wire_step(w);
	pad_wire_unlock(w);
}

#endif
