/*
 * bench/watch.h: the health of every device and node through a run: who was not OK, from when to when, why. A slot
 * becomes bad at once and good again only after `settle_ns` of good reports, so that a flapping fault is one incident.
 * Memory is taken at creation. One thread.
 */
#ifndef BB_BENCH_WATCH_H
#define BB_BENCH_WATCH_H

#include "bench/result.h"

struct bb_watch;

BB_MUST_CHECK enum bb_status bb_watch_create(size_t n_slots, struct bb_eventlog *events, int64_t settle_ns,
                                             struct bb_watch **out);
void bb_watch_destroy(struct bb_watch *w);
/* A new slot "class/id"; returns its index (the last one when full). */
size_t bb_watch_slot(struct bb_watch *w, const char *class_name, const char *id);
/* Bad in state `health` (DEGRADED, HOLDOVER, LOST): what says why, in words for a person. */
BB_PRINTF(5, 6)
void bb_watch_bad(struct bb_watch *w, size_t slot, int64_t now_ns, enum bb_health health, const char *fmt, ...);
/* Says it anew while it lasts, if what was said so far begins with this word: a share, an age. */
BB_PRINTF(4, 5)
void bb_watch_say(struct bb_watch *w, size_t slot, const char *word, const char *fmt, ...);
/* Something a person should know that is no failure: an incident in state WARNING, until it is over or for good; budgets
 * decide. Returns what bb_watch_over takes. */
BB_PRINTF(4, 5)
size_t bb_watch_warn(struct bb_watch *w, size_t slot, int64_t now_ns, const char *fmt, ...);
void bb_watch_over(struct bb_watch *w, size_t warning, int64_t now_ns);
void bb_watch_good(struct bb_watch *w, size_t slot, int64_t now_ns);
enum bb_health bb_watch_health(const struct bb_watch *w, size_t slot);
/* Closes open incidents at now; afterwards the two below tell. */
void bb_watch_finish(struct bb_watch *w, int64_t now_ns);
double bb_watch_longest_bad_s(const struct bb_watch *w, size_t slot);
double bb_watch_bad_s(const struct bb_watch *w, size_t slot);
const char *bb_watch_name(const struct bb_watch *w, size_t slot);
size_t bb_watch_slots(const struct bb_watch *w);
size_t bb_watch_incidents(const struct bb_watch *w, const struct bb_incident **out);

#endif
