/*
 * drivers/camera_usb.h: TrackIR-class cameras over hal/bus.h. Device "usb:131d:0157?serial=A1". Options: serial;
 * threshold=30..253 (default 96); stamps=device for cameras that stamp their frames and take a sync input (kind 6 of
 * trackir_wire.h), otherwise stamps are made from arrivals.
 *
 * The vendor's firmware is never sent: a camera without it is refused with a word.
 *
 * Recovery. A stalled endpoint is cleared once; a second stall before three good frames resets the device; more than
 * three resets in a minute, or five re-opens, are QUARANTINED until stop + start. A camera that was unplugged is looked
 * for by its serial every 100 ms, on any port, set up again, and goes on where it was: frame numbers and stamps
 * continue. Nothing here waits: every read does what can be done at once.
 */
#ifndef BB_DRIVERS_CAMERA_USB_H
#define BB_DRIVERS_CAMERA_USB_H

#include "hal/bus.h"
#include "hal/camera.h"

extern const struct bb_camera_driver bb_camera_usb_driver;

/* Opens on a given host instead of libusb's. */
BB_MUST_CHECK enum bb_status camera_usb_open_on(struct bb_usb_host *host, const struct bb_camera_config *config,
                                                const struct bb_open *open, struct bb_camera **out);

/* What the driver knows of its device. `fault` is the name of the row of the fault matrix, "" when there is none. */
struct camera_usb_health {
	enum bb_health health;
	const char *fault;
	uint64_t frames, lost;         /* delivered; missing from the numbers */
	uint64_t partial, bad;         /* packets dropped: cut short; not packets */
	uint64_t blind;                /* times it saw nothing for five frames */
	uint64_t stalls, resets, reopens;
	char serial[64];
};
const struct camera_usb_health *camera_usb_health(const struct bb_camera *cam);

#endif
