/*
 * sim/bus_sim_input.h: a hal/bus_input.h bus whose far end is a peer in this process, with what the kernel's hid-input
 * and xpad do in between: fields become codes, and only changes are told. A handle of one plugging, as
 * sim/bus_sim_hid.h. One thread.
 */
#ifndef BB_SIM_BUS_SIM_INPUT_H
#define BB_SIM_BUS_SIM_INPUT_H

#include "hal/bus_input.h"
#include "sim/peer_pads.h"

/* BB_ERR_LOST: it is not plugged in. */
BB_MUST_CHECK enum bb_status sim_input_bus_open(struct sim_peer_pad *peer, struct bb_clock *clk,
						struct bb_input_bus **out);

#endif
