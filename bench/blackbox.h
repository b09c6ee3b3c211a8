/*
 * bench/blackbox.h: what happened just before it went wrong. A ring of the last events of all devices and nodes, of fixed
 * size; on loss of lock, a late frame or a frame that some screen never showed it is kept as it is, up to four times a run,
 * a second apart. When the run is over each of these gets its causes, ranked: who was not well then and could be behind
 * it, and which node spent its time on what ("node/n3 late at frame 8123: bricks took 41 ms"). The planted faults are
 * not looked at. Written as blackbox.json and blackbox.txt. One thread; nothing is allocated after creation.
 */
#ifndef BB_BENCH_BLACKBOX_H
#define BB_BENCH_BLACKBOX_H

#include "bench/result.h"
#include "hal/eventlog.h"

#define BB_BLACKBOX_EVENTS 1024 /* half a second of a cabin, five frames of 416 screens */

enum bb_black_kind { BB_BLACK_LOCK, BB_BLACK_LATE, BB_BLACK_UNSEEN };

struct bb_black_trigger {
	enum bb_black_kind kind;
	int64_t at_ns;            /* clock time */
	uint64_t frame;
	uint16_t node;            /* whose frame it was; 0xFFFF: nobody's */
	uint64_t missing;         /* LATE: nodes that did not come, bits; */
	bool all_missing;         /* all that draw */
	bool unheard;             /* `node` never heard of the frame */
	int64_t state_ns, load_ns, select_ns, draw_ns; /* LATE: what `node` spent; select without load */
	char culprit[64];         /* LOCK, UNSEEN: the device itself */
};

struct bb_blackbox;

BB_MUST_CHECK enum bb_status bb_blackbox_create(struct bb_eventlog *events, struct bb_blackbox **out);
void bb_blackbox_destroy(struct bb_blackbox *b); /* NULL allowed */
/* The event log's sink calls this with every block. */
void bb_blackbox_events(struct bb_blackbox *b, const struct bb_event *events, size_t n);
/* NULL allowed: nothing happens. */
void bb_blackbox_trigger(struct bb_blackbox *b, const struct bb_black_trigger *t);
/* Ranks the causes into r->black. Incidents, devices and stages of r are complete, budgets need not be. */
void bb_blackbox_rank(const struct bb_blackbox *b, struct bb_run_result *r);
/* blackbox.json and blackbox.txt into dir when there is something to tell. */
BB_MUST_CHECK enum bb_status bb_blackbox_write(const struct bb_blackbox *b, const struct bb_run_result *r, const char *dir,
                                               struct bb_error *err);

#endif
