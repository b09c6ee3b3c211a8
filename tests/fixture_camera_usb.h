/*
 * tests/fixture_camera_usb.h: the USB camera driver over a bus in this process, a simulated camera at its far end, and
 * the model the camera sees by. Header only. Include after tests/fixture_room.h.
 */
#ifndef BB_TESTS_FIXTURE_CAMERA_USB_H
#define BB_TESTS_FIXTURE_CAMERA_USB_H

#include "drivers/camera_usb.h"
#include "sim/bus_sim_usb.h"
#include "sim/peer_camera.h"

struct usb_rig {
	struct bus_sim_usb host;
	struct peer_camera *peer;
	struct bb_camera *model;
	struct bb_uri uri;
};

static inline void usb_rig_open(struct usb_rig *u, struct rig *r, size_t i, const struct peer_camera_options *options,
                                const char *uri, struct bb_camera **cam)
{
	struct bb_open open = rig_open(r);

	open.events = NULL; /* what is heard goes into the log, not what is seen */
	assert_int_equal(bb_camera_open(&sim_camera_driver, &r->fix.cameras[i], &open, &u->model), BB_OK);
	assert_int_equal(peer_camera_create(u->model, options, &u->peer), BB_OK);
	bus_sim_usb_init(&u->host);
	assert_true(bus_sim_usb_plug(&u->host, 2, peer_camera_usb(u->peer)));
	assert_int_equal(bb_uri_parse(uri, &u->uri, NULL, NULL), BB_OK);
	open.events = r->log;
	open.uri = &u->uri;
	open.world = NULL;
	assert_int_equal(camera_usb_open_on(&u->host.host, &r->fix.cameras[i], &open, cam), BB_OK);
}

static inline void usb_rig_close(struct usb_rig *u, struct bb_camera *cam)
{
	bb_camera_close(cam);
	peer_camera_destroy(u->peer);
	bb_camera_close(u->model);
}

#endif
