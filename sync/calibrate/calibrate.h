/*
 * sync/calibrate/calibrate.h: from a sequence of wand and floor square to cameras: lens, place and orientation of each.
 *
 * choose.c labels every picture and chooses wands, even over time, cameras and their pictures; calibrate.c starts from
 * cameras as planned (tens of centimetres and degrees off is near enough), adjusts under a loss that narrows from 40 px to
 * three times the noise, looks for knocked cameras (knock.c) and leaves out what they saw before, leaves out what is beyond
 * 4 sigma, and adjusts the rest by squares, with what was seen before a knock as one more camera of the same lens (before.c);
 * align.c puts the result where the square says the room is.
 */
#ifndef BB_SYNC_CALIBRATE_CALIBRATE_H
#define BB_SYNC_CALIBRATE_CALIBRATE_H

#include "sync/calibrate/bundle.h"
#include "sync/calibrate/sequence.h"

#define BB_CALIBRATE_RODS 4000

struct bb_calibrate_config {
	const struct bb_camera_config *cameras; /* borrowed: as planned, in the sequence's order */
	size_t n_cameras;
	const struct bb_sequence *sequence;     /* borrowed */
	size_t rods_most;                       /* 0: 200 a camera, BB_CALIBRATE_RODS at most */
};

struct bb_calibrate_camera {
	size_t n_pictures;     /* in which the wand was made out */
	size_t n_used, n_out;  /* markers */
	double rms_px;         /* per coordinate, corrected for degrees of freedom */
	double covered;        /* share of 8 x 6 parts of its picture that a used marker lies in */
	bool knocked;
	int64_t knocked_ns;    /* on the sequence's clock */
	double knock_px;       /* by how much its picture moved, about */
};

struct bb_calibration { /* owns what it points to */
	size_t n_cameras;
	struct bb_camera_config *cameras;
	struct bb_calibrate_camera *report;
	struct bb_bundle bundle; /* its rods and observations, for pictures of what is left over */
	int64_t *rod_ns;         /* when each was seen */
	size_t n_lines, n_pictures; /* pictures with three blobs or more; those in which a wand was made out */
	size_t n_used, n_out, n_knocked;
	double freedom;          /* degrees of, of the last adjustment */
	double rms_px;           /* per coordinate, corrected for them */
	double square_rms_mm;    /* of the square's markers, after alignment */
	size_t square_cameras;   /* that saw it */
	unsigned steps;
};

/* 1733 the cameras are not the sequence's; 1734 a camera saw too little of the wand; 1735 the square does not fit;
 * 1736 no solution; 1743 a knocked camera saw too little afterwards; 1702. */
BB_MUST_CHECK enum bb_status bb_calibrate(const struct bb_calibrate_config *config, struct bb_calibration *out,
                                          struct bb_error *err);
void bb_calibration_free(struct bb_calibration *c);

#endif
