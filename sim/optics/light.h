/*
 * sim/optics/light.h: light in a stereo room, in small steps of time: pixels that follow what scan-out wrote into their
 * row, liquid-crystal cells that follow their drive, a display's own dark times and strobes. First principles only: a
 * state, a target, a time constant; whoever wants a closed form finds it elsewhere and can compare.
 *
 * Events (a vblank with its picture, a drive) are told in order of time and at most a few ahead; then time is stepped
 * past them. Between two steps everything is exact, whatever events fall inside. One thread, no allocation.
 */
#ifndef BB_SIM_LIGHT_H
#define BB_SIM_LIGHT_H

#include "hal/display.h"

#define SIM_LIGHT_AHEAD 16 /* events waiting, at most; what is told beyond that pushes out the newest */
#define SIM_ROWS 4         /* of the display a spot averages over */

struct sim_drive {
	int64_t at_ns;
	double target;
};
struct sim_drives {
	struct sim_drive wait[SIM_LIGHT_AHEAD];
	unsigned n;
};

struct sim_cell { /* one lens, or one shutter before a projector */
	double x, target;              /* 0 closed .. 1 open */
	double open_tau_ns, close_tau_ns, leak, transmission;
	struct sim_drives drives;
};
void sim_cell_init(struct sim_cell *cell, const struct bb_cell *config);
void sim_cell_drive(struct sim_cell *cell, int64_t at_ns, bool open);
/* Steps to `to_ns` and returns the mean light let through on the way, as a share of what falls on it. */
double sim_cell_step(struct sim_cell *cell, int64_t from_ns, int64_t to_ns);

struct sim_patch { /* a small part of a display, as a sensor sees it */
	const struct bb_display_config *display;
	double rise_tau_ns, fall_tau_ns;
	unsigned n_rows;               /* 1 when all rows change at once */
	struct {
		double place;          /* 0: the first row scanned .. 1: the last */
		double x, target;
		struct sim_drives drives;
	} row[SIM_ROWS];
	int64_t vblank_ns;             /* of the frame being shown; dark times and strobes count from it */
	int64_t ahead_ns[SIM_LIGHT_AHEAD];
	unsigned n_ahead;
};
/* height: 0 top .. 1 bottom; spread: of the spot, as a share of the display's height. */
void sim_patch_init(struct sim_patch *p, const struct bb_display_config *display, double height, double spread);
/* A frame begins: its picture is this bright here (0..1), from when scan-out reaches the rows. */
void sim_patch_frame(struct sim_patch *p, int64_t vblank_ns, double light);
/* A vblank without a new picture: the old one stays, and the backlight goes on as ever. */
void sim_patch_vblank(struct sim_patch *p, int64_t vblank_ns);
double sim_patch_step(struct sim_patch *p, int64_t from_ns, int64_t to_ns);

#endif
