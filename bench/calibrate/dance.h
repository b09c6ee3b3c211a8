/*
 * bench/calibrate/dance.h: a simulated calibration: somebody lays a floor square into the middle of a room, then dances with
 * a wand through all of it. Cameras hang where nobody planned them, off by decimetres and degrees, and are drawn by the
 * simulation's own optics (sim/sim_camera.h), not by what calibrates.
 *
 * Same seed, same room, same numbers.
 */
#ifndef BB_BENCH_CALIBRATE_DANCE_H
#define BB_BENCH_CALIBRATE_DANCE_H

#include "hal/room.h"
#include "sync/calibrate/sequence.h"

#define BB_DANCE_OFF_M 0.3     /* where a camera really hangs: up to that far on each axis from its plan */
#define BB_DANCE_OFF_DEG 6.0   /* and turned by up to that much */
#define BB_DANCE_KNOCK_DEG 0.4
#define BB_DANCE_KNOCK_M 0.004

struct bb_dance_config {
	const struct bb_room *room;
	size_t n_cameras;        /* the first ones of the room; 0: all */
	double seconds, rate_hz, noise_px;
	double outlier_share;    /* of the wand's markers: alone by 2-25 px, or all three of a picture by 4-60 px */
	int knocked;             /* which camera, half way through; -1: none */
	uint64_t seed;
};

struct bb_dance { /* owns what it points to */
	struct bb_sequence sequence;
	struct bb_camera_config *truth; /* as they hang at the end */
	size_t n_cameras;
	int64_t knock_ns;
	uint8_t *wrong;                 /* per blob of the sequence: an outlier */
	size_t n_wrong;
};

BB_MUST_CHECK enum bb_status bb_dance_make(const struct bb_dance_config *config, struct bb_dance *out);
void bb_dance_free(struct bb_dance *d);

#endif
