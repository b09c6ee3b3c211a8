/*
 * bench/optics/sense.h: what light sensors in a simulated room would record: its shutters and displays run at fidelity 2
 * on a virtual clock, patterns follow each other on every wall, and photodiodes or a high-speed camera look on. The files
 * are what bench/optics/measure.h reads.
 */
#ifndef BB_BENCH_OPTICS_SENSE_H
#define BB_BENCH_OPTICS_SENSE_H

#include "hal/room.h"

struct bb_sense_options {
	uint64_t seed;
	bool configured;       /* shutters as the room file says instead of as planned */
	bool swapped;          /* glasses on the wrong way round: what the plan is there to find */
	int64_t cycles;        /* of a pattern, each of which is shown twice */
	double noise;          /* times the sensor's own */
	const char *wall;      /* of a camera; NULL: the first */
	const char *lens;      /* of a camera: bare, left, right */
};

/* A CSV file of photodiodes: three bands of every wall, bare and through both lenses, the tag, both lenses at a lamp. */
BB_MUST_CHECK enum bb_status bb_sense_diodes(const struct bb_room *room, const struct bb_sense_options *options,
                                             const char *file, struct bb_error *err);
/* A folder with recording.txt and pictures of one wall through one lens. Errors 1640, 1901, 1905. */
BB_MUST_CHECK enum bb_status bb_sense_pictures(const struct bb_room *room, const struct bb_sense_options *options,
                                               const char *dir, struct bb_error *err);

#endif
