/*
 * drivers/bus_can.h: a hal/bus.h CAN bus on a SocketCAN interface. Frames carry the controller's or the kernel's
 * receive stamp in host time. One thread; nothing blocks.
 */
#ifndef BB_DRIVERS_BUS_CAN_H
#define BB_DRIVERS_BUS_CAN_H

#include "hal/bus.h"

/* "can0", "vcan0". 1530 the kernel has no CAN, 1531 no such interface, 1532 it is down, 1533 no socket. */
BB_MUST_CHECK enum bb_status bb_can_bus_open(const char *interface, struct bb_clock *clk, struct bb_can_bus **out,
                                             struct bb_error *err);

#endif
