/*
 * sim/peer_camera.h: a TrackIR-class camera at the far end of the wire, for the shipped driver. What it sees comes
 * from a camera model of the world (any bb_camera, normally a sim); this file turns pictures into bytes: bright spots
 * on a sensor, stripes above the threshold, packets of drivers/trackir_wire.h. Its encoding is its own.
 *
 * A spot is a Gaussian integrated over pixels, of peak 250 and so wide that it exceeds the threshold over the blob's
 * area; its counters begin again with every power-up; a point weighs what it exceeds the threshold by, plus one. Firmware is any bytes: they are summed, not run.
 */
#ifndef BB_SIM_PEER_CAMERA_H
#define BB_SIM_PEER_CAMERA_H

#include "hal/camera.h"
#include "sim/sim_usb_device.h"

struct peer_camera_options {
	const char *serial;     /* outlives the peer; NULL: none */
	bool stamped;           /* kind 6: with a clock and a sync input */
	bool no_firmware;       /* starts without; takes an upload */
	bool needs_reload;      /* asks for its settings to be reloaded once */
	uint32_t clock_us;      /* added to its stamps: to begin near the wrap */
	uint32_t counter;       /* added to its frame numbers */
	int64_t offset_ns;      /* after its sync edge, while nobody tells it another */
	size_t most_in_bytes;   /* an IN transfer carries at most that much; 0: all */
};

struct peer_camera;

/* Drives the model (starts, stops, exposes, reads it); the model outlives the peer. */
BB_MUST_CHECK enum bb_status peer_camera_create(struct bb_camera *model, const struct peer_camera_options *options,
                                                struct peer_camera **out);
void peer_camera_destroy(struct peer_camera *p);
struct sim_usb_device *peer_camera_usb(struct peer_camera *p);
bool peer_camera_streams(const struct peer_camera *p);
uint16_t peer_camera_firmware_sum(const struct peer_camera *p);
bool peer_camera_lamps(const struct peer_camera *p); /* is the IR ring lit? */

/* What happens outside. Counts are of what is still to come. */
void peer_camera_world_stall(struct peer_camera *p, uint32_t times);   /* the IN endpoint halts, and after each cure */
void peer_camera_world_cut(struct peer_camera *p, uint32_t packets);   /* packets that lose their end */
void peer_camera_world_damage(struct peer_camera *p, uint32_t packets); /* packets with a wrong byte */
void peer_camera_world_drop(struct peer_camera *p, uint32_t frames);   /* frames that are never sent */
void peer_camera_world_mute(struct peer_camera *p, bool mute);         /* takes everything, says nothing */

#endif
