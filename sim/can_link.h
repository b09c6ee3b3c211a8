/*
 * sim/can_link.h: puts the peers of a medium (sim/bus_sim_can.h) on a SocketCAN interface: what they say goes out of
 * one raw socket, which hears its own frames back with the kernel's stamp and so knows when each was sent. Nothing of
 * drivers/ is in here. One thread; nothing blocks. Linux.
 */
#ifndef BB_SIM_CAN_LINK_H
#define BB_SIM_CAN_LINK_H

#include "sim/bus_sim_can.h"

struct sim_can_link;

/* Before any peer is attached. Errors 1530 .. 1533 as of drivers/bus_can.h. */
BB_MUST_CHECK enum bb_status sim_can_link_open(const char *interface, struct sim_can *can, struct bb_clock *clk,
                                               struct sim_can_link **out, struct bb_error *err);
void sim_can_link_close(struct sim_can_link *l); /* before the medium goes; NULL is allowed */
int sim_can_link_fd(const struct sim_can_link *l); /* readable while something waits */
void sim_can_link_serve(struct sim_can_link *l);   /* hands it to the peers */
/* Is this an interface without a cable (vcan, vxcan), so that no real device can be on its bus? */
bool sim_can_link_is_virtual(const char *interface);

#endif
