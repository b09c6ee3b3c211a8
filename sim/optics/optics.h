/*
 * sim/optics/optics.h: the light of a stereo room at fidelity 2: screens, the shutters before their projectors, the
 * lenses of the glasses, stepped through time by the edges and vblanks of simulated (or recorded) devices.
 *
 * Model. An edge opens its eye's cell and closes the other one's; the cell closes by itself after its duty (a lens: one
 * token gap before the next edge is due) unless that is a whole edge period or more. Two projectors behind shutters show one eye each, all the time; a
 * frame-sequential display shows the eye of the frame that flipped, and keeps it when a flip is missing. A display's black
 * is a thousandth of its white. Lanes are the same room with other patterns on its screens, at the same instant.
 * Events are told in order, at most a few ahead; time is stepped past them. One thread.
 */
#ifndef BB_SIM_OPTICS_H
#define BB_SIM_OPTICS_H

#include "hal/optics.h"
#include "hal/room.h"

#define SIM_LANES 3

#define SIM_HEIGHTS 24
struct sim_look {                 /* where every screen is looked at: what is not costs nothing */
	size_t n_heights;
	double height[SIM_HEIGHTS]; /* 0 top .. 1 bottom */
	double spread;            /* of a spot, as a share of the screen's height */
	bool tag;                 /* the patch in the lowest row, too */
	unsigned lanes;
};
/* Three photodiodes with tubes: the edges and the middle. In the order of enum bb_spot. */
struct sim_look sim_look_bands(void);

struct sim_optics;
/* The screens named by index; borrowed room. */
BB_MUST_CHECK enum bb_status sim_optics_create(const struct bb_room *room, const size_t *screens, size_t n,
                                               const struct sim_look *look, struct sim_optics **out);
void sim_optics_destroy(struct sim_optics *o);
/* How long lenses and shutters stay open after their edge, other than the room file says. */
void sim_optics_set_open(struct sim_optics *o, double glasses_us, double shutter_us);
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
double sim_optics_bare(const struct sim_optics *o, size_t screen, size_t height, unsigned lane);
double sim_optics_tag(const struct sim_optics *o, size_t screen);

#endif
