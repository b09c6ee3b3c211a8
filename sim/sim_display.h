/*
 * sim/sim_display.h: scan-outs as the world sees them. For bench/ and tests/ only.
 *
 * Model. Vblank k of a genlocked display is instant k of its rate on the room's sync reference plus a seeded offset
 * below 5 us; of a free one, frame k of its own crystal (rate_error_ppm, or seeded within +-20 ppm) from a seeded
 * phase. Numbers and times of vblanks are computed when somebody asks, so a display at rest costs nothing. An image flips at
 * its target vblank, or at the next one when that has passed, one image a vblank, in order of presentation.
 * Fidelity 0: offset, rate error and phase are zero and stamps exact; at 1 stamps are whole microseconds.
 */
#ifndef BB_SIM_DISPLAY_H
#define BB_SIM_DISPLAY_H

#include "hal/display.h"

/* Where vblank k (from now on) truly begins. */
int64_t sim_display_vblank_ns(const struct bb_display *d, int64_t k);
/* Flip results that nobody read in time; images that a fault swallowed. */
uint64_t sim_display_unread(const struct bb_display *d);
uint64_t sim_display_swallowed(const struct bb_display *d);

#endif
