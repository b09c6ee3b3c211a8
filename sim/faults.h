/*
 * sim/faults.h: faults are data: "at 2.0s camera/c3 cover for 3s", "at 0s shutter/chain stage_offset stage=left us=900",
 * "at 3s node/right late frames=1 for 20 frames", "at boot power/pdu1 stick outlet=2". Times count from the scene's
 * start; "at boot" is before bring-up; without "for" a fault stays. Durations are "3s", "250ms" or "20 frames" (of the
 * loop). Each sim lists its verbs as data; the class "node" and "world" are faults.c's own.
 */
#ifndef BB_SIM_FAULTS_H
#define BB_SIM_FAULTS_H

#include <math.h>

#include "sim/world.h"

#define SIM_FAULT_ARGS_MAX 6
#define SIM_FAULTS_MAX 4096

struct sim_fault_args {
	const struct bb_where *where; /* set while arguments are checked, for messages; else NULL */
	size_t n;
	struct {
		char key[24];
		char value[40];
	} arg[SIM_FAULT_ARGS_MAX];
};
/* The value of a key, or NULL; the number of a key, or fallback (false when it is there and is no finite number). */
const char *sim_fault_arg(const struct sim_fault_args *args, const char *key);
bool sim_fault_number(const struct sim_fault_args *args, const char *key, double fallback, double *out);
/* The same with a range and error 1605. */
#define SIM_FAULT_REQUIRED ((double)NAN) /* as fallback: the key must be given */
BB_MUST_CHECK enum bb_status sim_fault_range(const struct sim_fault_args *args, const char *key, double fallback,
                                             double least, double most, double *out, struct bb_error *err);

struct sim_verb { /* a table ends with name == NULL */
	const char *name;
	const char *args;    /* "stage=ID us=N", ""; =N takes a number; [..] around what may be left out. The keys
	                        stage and node are checked against the room when planted. */
	const char *meaning;
	const char *example; /* of the arguments, for the test that plants every verb */
	/* on: set the fault; !on: it is over. BB_ERR_CONFIG with detail for bad arguments (checked before the run by a
	 * call with device == NULL). */
	enum bb_status (*apply)(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err);
};

struct sim_fault {
	char text[160];
	char class_name[16], id[BB_ID_MAX], verb[24];
	bool at_boot;
	int64_t at_ns;       /* from scene start */
	int64_t for_ns;      /* BB_NEVER: stays */
	int64_t for_frames;  /* > 0: counts instead of for_ns */
	struct sim_fault_args args;
};

/* 1601 syntax, 1602 no such class or verb (with the known ones), 1603 bad time, 1604 no such device, 1605 bad
 * argument, 1606 the scene does not model that device, 1607 too many. */
BB_MUST_CHECK enum bb_status sim_fault_parse(const char *text, struct sim_fault *out, const struct bb_where *where,
                                             struct bb_error *err);
/* One fault a line, # comments. *out is malloc'ed. */
BB_MUST_CHECK enum bb_status sim_fault_file(const char *path, struct sim_fault **out, size_t *n_out,
                                            struct bb_error *err);
/* Check every fault against the open devices and set those "at boot"; the others are armed by _start. The array is
 * borrowed. frame_ns: the loop's period, for durations in frames. */
BB_MUST_CHECK enum bb_status sim_faults_plant(struct sim_world *w, const struct sim_fault *faults, size_t n,
                                              int64_t frame_ns, struct bb_error *err);
BB_MUST_CHECK enum bb_status sim_faults_start(struct sim_world *w); /* scene start is known */
/* What became of fault i: clock times (BB_NEVER: not yet) and whether its device took it. false past the end. */
struct sim_fault_state {
	int64_t set_ns, cleared_ns;
	enum bb_status status;
};
bool sim_fault_state(const struct sim_world *w, size_t i, struct sim_fault_state *out);
/* Row i of all verbs of all classes, for --list-faults; class_out its class; NULL past the end. */
const struct sim_verb *sim_fault_verb(size_t i, const char **class_out);

#endif
