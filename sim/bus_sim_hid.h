/*
 * sim/bus_sim_hid.h: a hal/bus.h HID bus whose far end is a peer in this process. It is a handle of one plugging: after
 * an unplug it says BB_ERR_LOST for ever. The peer outlives it. One thread.
 */
#ifndef BB_SIM_BUS_SIM_HID_H
#define BB_SIM_BUS_SIM_HID_H

#include "sim/peer_pads.h"

/* BB_ERR_LOST: it is not plugged in. */
BB_MUST_CHECK enum bb_status sim_hid_bus_open(struct sim_peer_pad *peer, struct bb_clock *clk, struct bb_hid_bus **out);

#endif
