/* bench/calibrate/tell.h: what came of a calibration, as a table, JSON, a picture, and the room's side file. */
#ifndef BB_BENCH_CALIBRATE_TELL_H
#define BB_BENCH_CALIBRATE_TELL_H

#include <jansson.h>
#include <stdio.h>

#include "bench/calibrate/dance.h"
#include "bench/cli.h"
#include "hal/room/calibration.h"
#include "sync/calibrate/calibrate.h"

struct bb_calibrate_outcome {
	const struct bb_room *room;               /* as planned */
	const struct bb_camera_config *planned;   /* in the sequence's order */
	const struct bb_calibration *calibration;
	const struct bb_sequence *sequence;
	const struct bb_dance *dance;             /* NULL: it was no simulation */
	double noise_px;                          /* of the simulation */
	double seconds;                           /* of this machine */
	/* bb_calibrate_judge fills in, for a simulation: against the truth */
	double worst_m, worst_deg;
	size_t n_wrong, n_found, n_falsely;       /* markers of chosen moments: outliers, those left out, others left out */
	bool holds;                               /* 2 mm, 0.05 degrees, noise within 10 % */
};

void bb_calibrate_judge(struct bb_calibrate_outcome *o);
void bb_calibrate_print(const struct bb_calibrate_outcome *o, FILE *out);
json_t *bb_calibrate_json(const struct bb_calibrate_outcome *o);
/* .svg or .png: what is left over, camera by camera. */
BB_MUST_CHECK enum bb_status bb_calibrate_draw(const struct bb_calibrate_outcome *o, const char *file, struct bb_error *err);
/* 1701 when a file that the command would write is this one, which it reads. */
BB_MUST_CHECK enum bb_status bb_calibrate_spare(const struct bb_cli *cli, const char *input, struct bb_error *err);
/* Atomically; moved is what was aligned since. */
BB_MUST_CHECK enum bb_status bb_calibrate_save(const char *file, const struct bb_calibration_head *head,
                                               const struct bb_camera_config *cameras, size_t n, struct bb_error *err);
/* The head of a new side file. */
void bb_calibrate_head(const struct bb_room *planned, const char *made, struct bb_calibration_head *out);
/* A simulated sequence as the file a real one would be. */
BB_MUST_CHECK enum bb_status bb_calibrate_save_sequence(const char *file, const struct bb_sequence *s, struct bb_error *err);

#endif
