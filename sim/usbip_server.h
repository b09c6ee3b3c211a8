/*
 * sim/usbip_server.h: simulated USB devices on sockets other programs can use: USB/IP on a loopback port (`usbip list`,
 * `usbip attach`), or one end of a socket pair whose other end is given to vhci. Nothing but 127.0.0.1 is ever bound.
 * A client that asks for nothing is dropped after a second; at most 64 are served. One thread; time by the clock.
 */
#ifndef BB_SIM_USBIP_SERVER_H
#define BB_SIM_USBIP_SERVER_H

#include "sim/usbip_conn.h"

#define USBIP_PORT 3240
#define USBIP_CLIENTS 64

struct usbip_server;

BB_MUST_CHECK enum bb_status usbip_server_create(struct bb_clock *clk, struct usbip_server **out);
void usbip_server_destroy(struct usbip_server *s);

/* Exports a device as "1-N", N counting from 1; *item is its place. It must outlive the server or be withdrawn. */
BB_MUST_CHECK enum bb_status usbip_server_export(struct usbip_server *s, struct sim_usb_device *device, size_t *item);
/* Unplug, and plug in again: whoever has it loses the connection. */
void usbip_server_withdraw(struct usbip_server *s, size_t item);
void usbip_server_plug(struct usbip_server *s, size_t item, struct sim_usb_device *device);
/* What vhci is to be told as devid. */
uint32_t usbip_server_devid(const struct usbip_server *s, size_t item);

/* Listens on 127.0.0.1; port 0 lets the system choose. *port says which it is. BB_ERR_BUSY: taken. */
BB_MUST_CHECK enum bb_status usbip_server_listen(struct usbip_server *s, uint16_t *port);
/* A connected socket whose client has said these bytes so far; it becomes the server's own, who closes it when full. */
void usbip_server_take(struct usbip_server *s, int fd, const uint8_t *bytes, size_t n);
/* Serves a device on a connected socket, which becomes the server's own. */
BB_MUST_CHECK enum bb_status usbip_server_adopt(struct usbip_server *s, size_t item, int fd);

/* Moves what can be moved; waits at most that long for something to come. */
void usbip_server_step(struct usbip_server *s, int wait_ms);
size_t usbip_server_clients(const struct usbip_server *s);

#endif
