/*
 * drivers/bus_usb.h: USB through libusb-1.0 behind hal/bus.h. IN endpoints have several transfers in flight and a ring
 * of what they brought, stamped on arrival by a thread of the bus's own; reading takes from the ring and does not
 * wait when the deadline has passed. OUT transfers are queued; a failed one is reported by the next. Posix clock only.
 */
#ifndef BB_DRIVERS_BUS_USB_H
#define BB_DRIVERS_BUS_USB_H

#include "hal/bus.h"
#include "hal/uri.h"

/* The one host there is: stateless, each open bus has its own libusb context. */
void bb_usb_host_init(struct bb_usb_host *host);
/* "131d:0157" and option serial of a device URI. False: malformed. */
BB_MUST_CHECK bool bb_usb_match_read(const struct bb_uri *uri, struct bb_usb_match *out);

#endif
