/*
 * sim/uhid.h: puts a HID peer before the kernel as a uhid device: hidraw and input nodes appear, reports flow both
 * ways. Needs /dev/uhid and the right to write to it. sim_uhid_step moves what waits and never blocks; the peer
 * outlives it. One thread.
 */
#ifndef BB_SIM_UHID_H
#define BB_SIM_UHID_H

#include "sim/peer_pads.h"

struct sim_uhid;
/* BB_ERR_UNSUPPORTED: no /dev/uhid here, or an Xbox pad; BB_ERR_IO: it refuses. */
BB_MUST_CHECK enum bb_status sim_uhid_create(struct sim_peer_pad *peer, struct sim_uhid **out);
/* Also follows the peer's plug: unplugged takes the kernel's device away, plugged in makes a new one. */
BB_MUST_CHECK enum bb_status sim_uhid_step(struct sim_uhid *u);
void sim_uhid_destroy(struct sim_uhid *u);
unsigned long sim_uhid_opens(const struct sim_uhid *u); /* how often somebody opened it: leaks show */
bool sim_uhid_is_open(const struct sim_uhid *u);

#endif
