/*
 * sim/usbip_conn.h: one USB/IP connection as bytes, without a socket: what came in, what is to go out. The other end
 * is hostile: lengths are bounded, an unknown command or a lie ends the connection. One thread.
 */
#ifndef BB_SIM_USBIP_CONN_H
#define BB_SIM_USBIP_CONN_H

#include "sim/sim_usb_device.h"

#define USBIP_EXPORTS 120        /* as many as one kernel can attach */
#ifdef BB_FUZZ
#define USBIP_DATA_MAX 1024      /* less to clear before each input */
#else
#define USBIP_DATA_MAX 65536     /* of one transfer */
#endif
#define USBIP_PARKED_MAX 64      /* transfers that wait for the device */
#define USBIP_OUT_MAX (4 * USBIP_DATA_MAX)

struct usbip_export {
	char busid[32];               /* "1-3" */
	uint32_t busnum, devnum;
	struct sim_usb_device *device; /* NULL: free; not plugged in */
	bool taken;                   /* by a connection */
};

struct usbip_exports {
	struct usbip_export item[USBIP_EXPORTS];
	size_t n;
};

struct usbip_conn;

/* A fresh connection: the client asks for the list or for a device. */
BB_MUST_CHECK enum bb_status usbip_conn_create(struct usbip_exports *exports, struct usbip_conn **out);
/* One that begins with transfers: vhci was told the device by its attach file. */
BB_MUST_CHECK enum bb_status usbip_conn_create_attached(struct usbip_exports *exports, size_t item,
                                                        struct usbip_conn **out);
/* Gives the device back. */
void usbip_conn_destroy(struct usbip_conn *c);

/* How many bytes it takes now; 0: let some go out first. */
size_t usbip_conn_room(const struct usbip_conn *c);
/* Takes what came in; false: the connection is to be closed. */
BB_MUST_CHECK bool usbip_conn_feed(struct usbip_conn *c, const uint8_t *bytes, size_t n);
/* Asks the device again for what is parked; false: it is gone, close. */
BB_MUST_CHECK bool usbip_conn_step(struct usbip_conn *c);
/* What is to go out, and how much of it went. */
const uint8_t *usbip_conn_out(const struct usbip_conn *c, size_t *n);
void usbip_conn_sent(struct usbip_conn *c, size_t n);
/* Has it been served something a client may wait for ever after (a device)? Until then it may be timed out. */
bool usbip_conn_is_attached(const struct usbip_conn *c);
/* After a list it is to be closed as soon as everything is out. */
bool usbip_conn_is_done(const struct usbip_conn *c);

#endif
