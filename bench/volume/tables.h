/*
 * bench/volume/tables.h: selectors measured on generated data sets of the sizes in Ellsworth, Chiang and Shen (2000,
 * table 1): what an edit of the transfer function costs and how well the cheap metrics rank (table 2), shares of voxels
 * and loads at three tolerances (tables 3 to 5), and budget-driven selectors at middle budgets (Carlsson and
 * Tjernstroem 2016, figure 5.1). Each measurement is a JSON object; counts are the same on every machine, times are
 * not.
 */
#ifndef BB_BENCH_VOLUME_TABLES_H
#define BB_BENCH_VOLUME_TABLES_H

#include <jansson.h>

#include "bench/volume/look.h"
#include "hal/clock.h"
#include "render/bricks/selector.h"

#define BB_TABLES_MEMORY_BYTES (UINT64_C(64) << 20) /* texture memory of theirs */
#define BB_TABLES_SLIGHT_LUV 0.5                    /* mean distance in L*u*v* that passes for slight, for moderate */
#define BB_TABLES_MODERATE_LUV 2.0

struct bb_tables_set {
	const char *name, *kind; /* of bb_steps_generate */
	const char *tf;          /* scenes/TF-sparse.tf, scenes/TF-filled.tf */
	uint32_t dim[3], n_steps;
	uint32_t brick; /* 0: as the part of the tables has it; else edits only */
};
extern const struct bb_tables_set bb_tables_sets[]; /* ends with name NULL */

struct bb_tables { /* one data set under one transfer function */
	struct bb_bricks *b;
	const struct bb_transfer *tf;
	struct bb_clock *clk; /* borrowed */
	struct bb_look look;
	struct bb_ratings ratings;
	struct bb_choice *heap, *out;
	float (*picture)[4];
	void (*progress)(const char *what); /* NULL: none */
};

/* The set as a brick file at path; scale: per cent of its voxels along each axis and of its steps. */
BB_MUST_CHECK enum bb_status bb_tables_build(const struct bb_tables_set *set, double scale, uint32_t brick,
					     const char *path, struct bb_error *err);
/* 10xx, 1440 to 1450, 1702. End it in any case. */
BB_MUST_CHECK enum bb_status bb_tables_begin(struct bb_tables *t, const char *path, const struct bb_transfer *tf,
					     struct bb_clock *clk, struct bb_error *err);
void bb_tables_end(struct bb_tables *t);

/* Each makes a new object, or leaves *out alone. */
BB_MUST_CHECK enum bb_status bb_tables_edits(struct bb_tables *t, json_t **out, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_tables_shares(struct bb_tables *t, json_t **out, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_tables_budgets(struct bb_tables *t, json_t **out, struct bb_error *err);

/* For people, as Markdown. */
void bb_tables_print(const json_t *root);

#endif
