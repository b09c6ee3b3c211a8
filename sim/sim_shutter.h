/*
 * sim/sim_shutter.h: the stereo shutter chain as the world sees it: what light gets through, and verbs for what happens
 * outside. For bench/ and tests/ only.
 *
 * Model. Edge n of the world's sync generator begins the left eye when n is even. Stage i hears it (i + 1) stage delays
 * later; a controller knows its nominal delay, so set_phase(delay) makes the stage switch at edge + delay + its unit's
 * own small error. Until set_phase a stage switches when it hears the edge, the glasses at emitter_offset_us. A new
 * handle is in mode OPEN, where nothing switches and no edge is reported. An edge is the begin of a transition; the
 * opening shutter follows 1 - exp(-t / tau), the closing one exp(-t / tau), with 10-90 % times open_us and close_us.
 * A stage that hears no edge goes on by its own clock for coast_s, without a word, and opens both eyes then; without such
 * a clock it stands as it is, and opens after 100 ms. Opening (by mode, close, watchdog or a lost chain) is an event
 * with eye NONE.
 */
#ifndef BB_SIM_SHUTTER_H
#define BB_SIM_SHUTTER_H

#include "hal/shutter.h"

/* Light let through to an eye at a stage (or BB_STAGE_EMITTER), 0..1, for times from a few edges ago to now. */
double sim_shutter_transmission(const struct bb_shutter *sh, uint8_t stage, enum bb_eye eye, int64_t at_ns);
/* Edges that nobody read in time. */
uint64_t sim_shutter_dropped(const struct bb_shutter *sh);

#endif
