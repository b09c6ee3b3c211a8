/*
 * bench/room_check.h: what `room check` says about a room: a summary and the findings of the lint, for people or as JSON.
 */
#ifndef BB_BENCH_ROOM_CHECK_H
#define BB_BENCH_ROOM_CHECK_H

#include <stdio.h>

#include "hal/room.h"

/* Prints to `out`; returns how many findings are errors (severity 1). */
int bb_room_check_print(const struct bb_room *room, FILE *out, bool json);

#endif
