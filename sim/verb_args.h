/*
 * sim/verb_args.h: arguments of fault verbs, checked: only known keys, numbers in range, whole where they count
 * something. A bad one is error 1605. No state.
 */
#ifndef BB_SIM_VERB_ARGS_H
#define BB_SIM_VERB_ARGS_H

#include "sim/faults.h"

/* known: the keys the verb takes, separated by blanks; "" when it takes none. */
BB_MUST_CHECK enum bb_status sim_args_only(const struct sim_fault_args *args, const char *known, struct bb_error *err);
/* A whole number, decimal or 0x hexadecimal; fallback where the key is missing. */
BB_MUST_CHECK enum bb_status sim_args_whole(const struct sim_fault_args *args, const char *key, long fallback,
                                            long least, long most, long *out, struct bb_error *err);
BB_MUST_CHECK enum bb_status sim_args_real(const struct sim_fault_args *args, const char *key, double fallback,
                                           double least, double most, double *out, struct bb_error *err);
/* The key must be there. */
BB_MUST_CHECK enum bb_status sim_args_need(const struct sim_fault_args *args, const char *key, struct bb_error *err);

#endif
