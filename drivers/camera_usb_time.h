/*
 * drivers/camera_usb_time.h: numbers and stamps of frames, from what a camera says and when it was heard. Inside of
 * drivers/camera_usb.c. ns.
 */
#ifndef BB_DRIVERS_CAMERA_USB_TIME_H
#define BB_DRIVERS_CAMERA_USB_TIME_H

#include "hal/dev_time.h"

struct camera_usb_time {
	int64_t period_ns, least_latency_ns;
	int64_t jitter_ns;         /* of arrivals, at most */
	bool any;                  /* a frame has been seen */
	bool broken;               /* the camera was away: its counters may have started again */
	uint32_t seq, counter;     /* of the last frame */
	int64_t arrived_ns, stamp_ns;
	struct bb_unwrap32 ticks;  /* microseconds */
	int64_t tick_offset_ns;    /* stamps go on over a restart of the device's clock */
	uint16_t usb_frame;
	int64_t usb_ms;            /* unwrapped */
};

struct camera_usb_mark { /* one frame's */
	bool stamped;
	uint32_t counter;  /* 8 bits when not stamped */
	uint32_t mid_us;
	uint16_t usb_frame;
	int64_t arrived_ns;
};

/* Gives the frame its number and stamp. False: a repetition, or a stamp that contradicts the USB frame number; the
 * frame is to be dropped. *lost: how many numbers are missing before it. */
bool camera_usb_time_add(struct camera_usb_time *t, const struct camera_usb_mark *mark, uint32_t *lost);

#endif
