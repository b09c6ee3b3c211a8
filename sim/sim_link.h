/*
 * sim/sim_link.h: the network between the nodes as the world sees it. For bench/ and tests/ only.
 *
 * Model. A sender is busy with each copy of a datagram for send_us, one after another. The copy is lost with loss_ppm, or
 * arrives delay + jitter * |normal| (at most 4 sd) or delay + exponential of mean jitter after it left, and once more with
 * duplicate_ppm, at a queue of 64 per node (4 n in a network of more than 16); order is not kept, and a full queue loses
 * its oldest. At arrival the node's timer is armed, or brought forward, never put off. Fidelity 0: no jitter, no loss.
 */
#ifndef BB_SIM_LINK_H
#define BB_SIM_LINK_H

#include "hal/link.h"

struct sim_link_counts { /* copies: a message to all counts once per receiver */
	uint64_t sent, lost, received, overflowed, duplicated;
};
struct sim_link_counts sim_link_counts(const struct bb_link *l);

#endif
