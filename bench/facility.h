/*
 * bench/facility.h: the slow half of a room: outlets and monitors. Bring-up switches the outlets on one after another
 * (stagger of hal/safety.h), verifies every contact, reads each monitor's EDID, writes and verifies its settings and
 * checks its input; afterwards a patrol keeps asking. Every monitor is its own state machine on the clock, so 416 of
 * them take as long as one. What is not as it should be goes to the watch.
 */
#ifndef BB_BENCH_FACILITY_H
#define BB_BENCH_FACILITY_H

#include "bench/rig.h"
#include "bench/watch.h"

struct bb_facility;

BB_MUST_CHECK enum bb_status bb_facility_create(struct bb_rig *rig, struct bb_clock *clk, struct bb_watch *watch,
                                                struct bb_facility **out);
void bb_facility_destroy(struct bb_facility *f);
/* Starts outlets, then monitors; the clock must run. */
BB_MUST_CHECK enum bb_status bb_facility_start(struct bb_facility *f);
/* Outlets commanded and every monitor through its bring-up (well or not). */
bool bb_facility_ready(const struct bb_facility *f);
/* "Samsung S27A850D, 1234 h, input 0x0f" of a monitor; "6 outlets on, 8.2 A" of a strip. */
void bb_facility_monitor_note(const struct bb_facility *f, size_t monitor, char *buf, size_t cap);
void bb_facility_power_note(const struct bb_facility *f, size_t pdu, char *buf, size_t cap);

#endif
