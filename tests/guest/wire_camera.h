/*
 * tests/guest/wire_camera.h: a simulated camera before the kernel of a guest, as a USB device behind vhci. Model, peer
 * and USB/IP server are a thread of their own, because the kernel asks them while a driver's call waits. What the model
 * is told from elsewhere happens between camera_wire_lock and camera_wire_unlock. Header only; after fixture_room.h.
 */
#ifndef BB_TESTS_GUEST_WIRE_CAMERA_H
#define BB_TESTS_GUEST_WIRE_CAMERA_H

#include <poll.h>
#include <pthread.h>
#include <time.h>

#include "sim/peer_camera.h"
#include "tests/guest/usb_vhci.h"

#define CAMERA_WIRE_LOOK_NS (200 * US) /* how often the wire is looked at */

struct camera_wire {
	pthread_mutex_t lock;
	pthread_t thread;
	bool running, stop, failed, attached;
	struct rig rig;
	struct bb_camera *model;
	struct peer_camera *peer;
	struct usbip_server *server;
	size_t item;
	unsigned port;
};

static inline void camera_wire_lock(struct camera_wire *w)
{
	pthread_mutex_lock(&w->lock);
}

static inline void camera_wire_unlock(struct camera_wire *w)
{
	pthread_mutex_unlock(&w->lock);
}

static inline void camera_wire_step(struct camera_wire *w)
{
	struct sim_usb_device *dev = peer_camera_usb(w->peer);

	rig_run(&w->rig, 0);
	const bool there = dev->ops->present(dev);
	if (there != w->attached) {
		w->attached = there;
		if (!there)
			usbip_server_withdraw(w->server, w->item);
		else {
			w->port = (w->port + 1) % 8; /* never the one it was on */
			usbip_server_plug(w->server, w->item, dev);
			w->failed |= !vhci_attach(w->server, w->item, dev, w->port);
		}
	}
	usbip_server_step(w->server, 0);
}

static inline void *camera_wire_main(void *arg)
{
	const struct timespec look = { .tv_nsec = CAMERA_WIRE_LOOK_NS };
	struct camera_wire *w = arg;
	bool stop = false;

	while (!stop) {
		camera_wire_lock(w);
		camera_wire_step(w);
		stop = w->stop;
		camera_wire_unlock(w);
		nanosleep(&look, NULL);
	}
	return NULL;
}

/* Camera i of the fixture room with a serial number of its own. False: not here, or it failed; to be ended anyway. */
static inline bool camera_wire_begin(struct camera_wire *w, size_t i, uint64_t seed, int fidelity,
                                     const struct peer_camera_options *options, unsigned port)
{
	memset(w, 0, sizeof(*w));
	w->port = port;
	fixture_room_init(&w->rig.fix);
	if (!vhci_there() || bb_clock_posix_create(&w->rig.clk) != BB_OK)
		return false;
	rig_world(&w->rig, seed, fidelity);
	w->model = rig_camera(&w->rig, i);
	if (peer_camera_create(w->model, options, &w->peer) != BB_OK ||
	    usbip_server_create(w->rig.clk, &w->server) != BB_OK ||
	    usbip_server_export(w->server, peer_camera_usb(w->peer), &w->item) != BB_OK ||
	    !vhci_attach(w->server, w->item, peer_camera_usb(w->peer), port))
		return false;
	w->attached = true;
	pthread_mutex_init(&w->lock, NULL);
	w->running = !pthread_create(&w->thread, NULL, camera_wire_main, w);
	return w->running;
}

static inline void camera_wire_end(struct camera_wire *w)
{
	if (w->running) {
		camera_wire_lock(w);
		w->stop = true;
		camera_wire_unlock(w);
		pthread_join(w->thread, NULL);
	}
	usbip_server_destroy(w->server);
	peer_camera_destroy(w->peer);
	bb_camera_close(w->model);
	if (w->rig.clk)
		rig_done(&w->rig);
}

/* A fault of the model, "unplug" too. */
static inline void camera_wire_fault(struct camera_wire *w, const char *verb_and_args, bool on)
{
	camera_wire_lock(w);
	rig_fault(&w->rig, "camera/c1", verb_and_args, on);
	camera_wire_unlock(w);
}

#endif
