/*
 * bench/barrier/table.h: the simulated bake-off: every method at every number of endpoints, and under loss; told as text,
 * JSON and a chart, with the model beside it. One thread; memory is the caller's to release.
 */
#ifndef BB_BENCH_BARRIER_TABLE_H
#define BB_BENCH_BARRIER_TABLE_H

#include <jansson.h>
#include <stdio.h>

#include "bench/barrier/model.h"
#include "bench/barrier/sim.h"

#define BB_BARRIER_SIZES_MAX 32
#define BB_BARRIER_LOSSES_MAX 16
#define BB_BARRIER_LOSS_SIZES 2

struct bb_barrier_row {
	unsigned n_nodes;
	double loss;               /* share */
	enum bb_lock_method method;
	bool ended;                /* no: it stood still */
	struct bb_troupe_result result;
	double skew_model_us, cost_model_us, messages_model;
};

struct bb_barrier_table {
	struct bb_troupe_config usual;   /* everything but method, nodes, loss */
	struct bb_barrier_network net;   /* the same as the model sees it */
	unsigned sizes[BB_BARRIER_SIZES_MAX];
	size_t n_sizes;
	double losses[BB_BARRIER_LOSSES_MAX]; /* shares */
	size_t n_losses;
	unsigned loss_sizes[BB_BARRIER_LOSS_SIZES]; /* at these endpoints; 0: not */
	struct bb_barrier_row *rows;     /* sizes x methods, then loss sizes x losses x methods */
	size_t n_rows;
	void (*progress)(const char *text); /* may be NULL */
};

/* Runs all; rows are calloc'ed. */
BB_MUST_CHECK enum bb_status bb_barrier_table_run(struct bb_barrier_table *t);
void bb_barrier_table_release(struct bb_barrier_table *t);
const struct bb_barrier_row *bb_barrier_row(const struct bb_barrier_table *t, size_t size, enum bb_lock_method m);
const struct bb_barrier_row *bb_barrier_loss_row(const struct bb_barrier_table *t, size_t size, size_t loss,
                                                 enum bb_lock_method m);
/* The first size from which on `better` has the lesser skew (or cost) in the middle; 0: none. By measuring at the sizes
 * listed, and by the model at every number of endpoints up to the largest. */
unsigned bb_barrier_crossover(const struct bb_barrier_table *t, enum bb_lock_method better, enum bb_lock_method than, bool cost);
unsigned bb_barrier_crossover_model(const struct bb_barrier_table *t, enum bb_lock_method better, enum bb_lock_method than,
                                    bool cost);

const char *bb_lock_method_text(enum bb_lock_method m);
void bb_barrier_table_print(const struct bb_barrier_table *t, FILE *out);
json_t *bb_barrier_table_json(const struct bb_barrier_table *t);
BB_MUST_CHECK enum bb_status bb_barrier_table_plot(const struct bb_barrier_table *t, const char *path, struct bb_error *err);

#endif
