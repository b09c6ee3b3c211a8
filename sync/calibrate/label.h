/*
 * sync/calibrate/label.h: which blobs of one picture are the wand, or the floor square, and which is which. By shape alone:
 * no calibration is needed yet, only a lens that makes straight lines nearly straight. Pure.
 */
#ifndef BB_SYNC_CALIBRATE_LABEL_H
#define BB_SYNC_CALIBRATE_LABEL_H

#include "sync/calibrate/sequence.h"
#include "sync/track/lens.h"

/* Three blobs on a line, the middle one nearer to the first end: their indices in the wand's order. false: none, or more
 * than one choice. */
bool bb_label_wand(const struct bb_lens *lens, const struct bb_sequence *s, const float (*px)[2], size_t n, int out[3]);
/* Corner, short end, long middle, long end; seen from above, as every camera that sees both arms does. */
bool bb_label_square(const struct bb_lens *lens, const struct bb_sequence *s, const float (*px)[2], size_t n, int out[4]);

#endif
