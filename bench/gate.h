/*
 * bench/gate.h: the numbers a regression gate compares: counters, stage times on the virtual clock in whole ns, the
 * event log's hash and picture quality in micro-dB. Same inputs must give the same numbers; a cost that grew or a change
 * nobody can explain fails, a cost that shrank is an improvement.
 *
 * Inputs are room, scene, seed, clock and every fact whose key ends in "_sha256" (data, cost profile...). The fact
 * "machine" says whether event logs and pictures may be compared at all: across machines only counters are. One thread.
 */
#ifndef BB_BENCH_GATE_H
#define BB_BENCH_GATE_H

#include "bench/result.h"

#include <jansson.h>
#include <stdio.h>

enum bb_gate_outcome { BB_GATE_SAME, BB_GATE_IMPROVED, BB_GATE_REGRESSED, BB_GATE_CHANGED, BB_GATE_INCOMPARABLE };
const char *bb_gate_text(enum bb_gate_outcome o); /* "same", "improved" ... */

/* What one run contributes, as a new JSON object (the caller's reference): inputs and values. */
json_t *bb_gate_section(const struct bb_run_result *r);

/* A bench file: the sections of several scenarios, what they ran on, and the git revision. */
json_t *bb_gate_file(void);
void bb_gate_file_add(json_t *file, const char *scenario, const struct bb_run_result *r);
BB_MUST_CHECK enum bb_status bb_gate_store(const json_t *file, const char *path, struct bb_error *err);
/* A bench file or a result.json, brought to the form of a bench file. 1902 no such file (BB_ERR_IO), 1903 not ours or
 * another schema. *out is the caller's reference. */
BB_MUST_CHECK enum bb_status bb_gate_load(const char *path, json_t **out, struct bb_error *err);

struct bb_gate_line { /* one difference */
	char scenario[64], name[64];
	char base[68], now[68];
	double percent;          /* NAN where it makes no sense */
	enum bb_gate_outcome outcome;
	char reason[120];
};
#define BB_GATE_LINES_MAX 256

struct bb_gate_report {
	enum bb_gate_outcome outcome; /* REGRESSED before CHANGED before INCOMPARABLE before IMPROVED */
	size_t n_compared;            /* values */
	size_t n_lines, n_unlisted;   /* differences; those past the maximum are only counted */
	struct bb_gate_line line[BB_GATE_LINES_MAX];
};
/* Never allocates. */
void bb_gate_compare(const json_t *base, const json_t *now, struct bb_gate_report *out);
int bb_gate_exit_code(const struct bb_gate_report *report);
void bb_gate_print(const struct bb_gate_report *report, FILE *out, bool colour);
json_t *bb_gate_report_json(const struct bb_gate_report *report);

#endif
