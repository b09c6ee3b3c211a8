/*
 * bench/optics/measure.h: an optical recording from disk, through the analyser: a CSV file, or a folder with recording.txt
 * (the same head and columns, no samples) and 000000.png, 000001.png ... of a high-speed camera whose picture's
 * upper, middle and lower tenths are the three bands. Read twice, never held. And what is said about it: a table, JSON, a plot.
 */
#ifndef BB_BENCH_OPTICS_MEASURE_H
#define BB_BENCH_OPTICS_MEASURE_H

#include <stdio.h>

#include "bench/result.h"
#include "hal/room.h"
#include "sync/optics/analyse.h"

struct json_t;

#define BB_MEASURE_CHECKS 256

struct bb_measure_check { /* one number against what the room promises */
	char what[64];         /* "front top left crosstalk" */
	struct bb_estimate value;
	double limit;          /* |value| for a phase, value for crosstalk; in unit */
	const char *unit;
	enum bb_verdict verdict; /* PASS, FAIL or INCONCLUSIVE */
};
struct bb_measure {
	struct bb_recording recording;
	struct bb_analyser *analyser;  /* owned: for the plot */
	struct bb_optics optics;
	size_t n_checks;
	struct bb_measure_check check[BB_MEASURE_CHECKS];
	enum bb_verdict verdict;       /* of all checks; SKIP without any */
};

/* fps: of pictures, over what recording.txt says; 0: as it says. Errors 1630..1641. */
BB_MUST_CHECK enum bb_status bb_measure_read(const char *path, double fps, struct bb_measure *out, struct bb_error *err);
void bb_measure_free(struct bb_measure *m);
/* Order of the eyes always; with a room crosstalk, phase against the room's timing and skew as well. */
void bb_measure_judge(struct bb_measure *m, const struct bb_room *room, bool planned);
void bb_measure_print(const struct bb_measure *m, FILE *out);
struct json_t *bb_measure_json(const struct bb_measure *m);
/* The edges found, as `phase ROOM --measured` reads them. */
BB_MUST_CHECK enum bb_status bb_measure_edges(const struct bb_measure *m, const struct bb_room *room, const char *file,
                                              struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_measure_plot(const struct bb_measure *m, const char *file, struct bb_error *err);

#endif
