/*
 * sim/optics/optics.h: the light of a stereo room at fidelity 2: screens, the shutters before their projectors, the
 * lenses of the glasses, stepped through time by the edges and vblanks of simulated (or recorded) devices.
 *
 * Model. An edge opens its eye's cell and closes the other one's; the cell closes by itself after its duty (a lens: one
 * token gap before the next edge is due). Two projectors behind shutters show one eye each, all the time; a
 * frame-sequential display shows the eye of the frame that flipped, and keeps it when a flip is missing. A display's black
 * is a thousandth of its white. Lanes are the same room with other patterns on its screens, at the same instant.
 * Events are told in order, at most a few ahead; time is stepped past them. One thread.
 */
#ifndef BB_SIM_OPTICS_H
#define BB_SIM_OPTICS_H

#include "hal/optics.h"
#include "hal/room.h"

#define SIM_LANES 2

struct sim_optics;
/* The screens named by index (no more than 32; borrowed room). with_tag: the patch in a corner, too, which costs. */
BB_MUST_CHECK enum bb_status sim_optics_create(const struct bb_room *room, const size_t *screens, size_t n, bool with_tag,
                                               struct sim_optics **out);
void sim_optics_destroy(struct sim_optics *o);
/* The pattern of a lane from the next frame on. Lanes that are never told one show black. */
void sim_optics_show(struct sim_optics *o, unsigned lane, enum bb_pattern pattern);
/* e->eye NONE: both open and stay so. Edges of stages without a screen here are ignored. */
void sim_optics_edge(struct sim_optics *o, const struct bb_shutter_edge *e);
/* Screen (by its place in `screens`) begins a frame with a picture for an eye (NONE: of dual projectors, or mono); or, a
 * vblank without one. */
void sim_optics_frame(struct sim_optics *o, size_t screen, int64_t vblank_ns, enum bb_eye eye);
void sim_optics_vblank(struct sim_optics *o, size_t screen, int64_t vblank_ns);
/* Goes on to a time, in one step: a few us for a sensor, more where only integrals matter. The first call sets the
 * beginning. Then the means over that step: of a lens, 0..1; of a screen without glasses, in units of its white. */
void sim_optics_step(struct sim_optics *o, int64_t to_ns);
double sim_optics_lens(const struct sim_optics *o, enum bb_eye eye);
double sim_optics_bare(const struct sim_optics *o, size_t screen, enum bb_spot spot, unsigned lane);

#endif
