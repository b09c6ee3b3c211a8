/*
 * sim/peer_i2c_tiny_usb.h: an i2c-tiny-usb adapter at the far end of USB, with a monitor or other targets on its bus;
 * the kernel's own driver makes /dev/i2c-N of it. Low speed, control transfers only, 1C40:0534.
 */
#ifndef BB_SIM_PEER_I2C_TINY_USB_H
#define BB_SIM_PEER_I2C_TINY_USB_H

#include "sim/peer_ddcci.h"
#include "sim/sim_i2c_target.h"
#include "sim/sim_usb_device.h"

#define PEER_I2C_TARGETS 16

struct peer_i2c_tiny_usb; /* opaque */

BB_MUST_CHECK enum bb_status peer_i2c_tiny_usb_create(const char *serial, struct peer_i2c_tiny_usb **out);
void peer_i2c_tiny_usb_destroy(struct peer_i2c_tiny_usb *p);
struct sim_usb_device *peer_i2c_tiny_usb_device(struct peer_i2c_tiny_usb *p);
/* Asked in order until one acknowledges. False: no place. */
bool peer_i2c_tiny_usb_add(struct peer_i2c_tiny_usb *p, const struct sim_i2c_target *target);
/* A monitor (borrowed), asked before the targets. From now on a message takes as long as its bits do, by this clock:
 * until then the host's transfer is left waiting. */
void peer_i2c_tiny_usb_monitor(struct peer_i2c_tiny_usb *p, struct peer_ddcci *monitor, const struct bb_clock *clk);
/* When the message that is on the wire is over; BB_NEVER: there is none. Whoever carries the USB transfers comes back. */
int64_t peer_i2c_tiny_usb_due_ns(const struct peer_i2c_tiny_usb *p);
uint16_t peer_i2c_tiny_usb_delay_us(const struct peer_i2c_tiny_usb *p); /* a bit, as told */

/* What happens outside. */
void peer_i2c_tiny_usb_world_plug(struct peer_i2c_tiny_usb *p, bool plugged);
void peer_i2c_tiny_usb_world_nak(struct peer_i2c_tiny_usb *p, uint32_t messages);  /* that many are not acknowledged */
void peer_i2c_tiny_usb_world_stall(struct peer_i2c_tiny_usb *p, uint32_t messages); /* STALL instead of data */
void peer_i2c_tiny_usb_world_mute(struct peer_i2c_tiny_usb *p, bool mute);          /* withholds every answer */

#endif
