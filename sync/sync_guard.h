/*
 * sync/sync_guard.h: what the chain's edges allow the outputs to show. Stereo needs a rhythm that is heard, of the room's
 * rate, with known eyes, and cells that are driven evenly; without one of these the room opens (hal/safe_state.h makes
 * that safe however often it happens), and tries again later, each time twice as long later.
 *
 *   silence   (row G1) 1.5 periods without an edge of some stage: HOLDOVER for as long as the phase is known to a tenth of
 *             a period and the chain goes on by itself, then open
 *   flaps     disturbances that add up to 3 within the transition gap: open. 1: a missed edge, or one of the glasses 8 %
 *             of a period off; 2: a doubled edge, one for the same eye again, a silence. A silence stands for the missed
 *             edges of its own stages and for nothing else
 *   rate      (row G7) half a period off over up to 32 edges: open
 *   gone      the chain does not answer: open
 *   drive     a cell keeps a bias (hal/lc_guard.h): open
 *   parity    (row G8) a disturbance of a chain that does not tell eyes: mono from then on
 *
 * Back to stereo after 8 edges within 2 % of a period, of all stages. While the shutters are open a chain tells no edges,
 * so trying means letting it run, in mono, and opening at the first disturbance. Pure; fed after sync/phase.h, once a frame. One thread.
 */
#ifndef BB_SYNC_SYNC_GUARD_H
#define BB_SYNC_SYNC_GUARD_H

#include "hal/lc_guard.h"
#include "hal/safe_state.h"
#include "sync/phase.h"

enum bb_guard_cause { BB_GUARD_NONE, BB_GUARD_SILENT, BB_GUARD_FLAPS, BB_GUARD_RATE, BB_GUARD_GONE, BB_GUARD_DRIVE,
                      BB_GUARD_PARITY };
const char *bb_guard_cause_text(enum bb_guard_cause cause); /* "SYNC_LOST" ... */

enum bb_guard_state {
	BB_GUARD_GOOD,
	BB_GUARD_HOLDOVER, /* silent, and trusted for a while */
	BB_GUARD_OPEN,     /* waits until it may try again */
	BB_GUARD_TRY       /* is let run, and listened to */
};

struct bb_guard_config {
	struct bb_safety safety;
	unsigned n_stages;      /* that report edges */
	int64_t coast_ns;       /* the chain goes on by itself for so long without hearing the sync; 0: it does not */
	int64_t stamp_error_ns;
};

#define BB_GUARD_RING 32
#define BB_GUARD_EVENTS 8

struct bb_sync_guard {
	struct bb_guard_config c;
	enum bb_guard_state state;
	enum bb_guard_cause cause;   /* of not being GOOD; PARITY also while it is */
	unsigned silent_stage;       /* who: a stage, or BB_STAGE_EMITTER */
	int64_t since_ns;            /* of the state */
	int64_t heard_ns;            /* HOLDOVER: the last edge before the silence */
	int64_t runs_ns;             /* since when edges are expected; BB_NEVER: they are not */
	int64_t retry_ns;
	unsigned failures;           /* tries in a row */
	unsigned good;               /* edges in a row */
	unsigned n;                  /* of the ring: the emitter's edges since the shutters run */
	struct { uint32_t seq; int64_t at_ns; } ring[BB_GUARD_RING];
	struct bb_lc_guard lc[BB_STAGES_MAX + 1]; /* the emitter's is last */
	uint64_t slips[BB_STAGES_MAX + 1];        /* edges whose eye is not the other one's, */
	uint64_t offs;                            /* and of the emitter's those that are off */
	struct bb_shutter_edge last[BB_STAGES_MAX + 1];
	double off_ns;                            /* of the emitter's last edge from where the ones before put it */
	uint8_t jittery;                          /* bit i: the emitter's last edge but i was 2 % of a period off */
	uint64_t disturbed[BB_STAGES_MAX + 1];    /* missed, doubled and slipped edges that are accounted for */
	struct { int64_t at_ns; unsigned weight; } event[BB_GUARD_EVENTS];
	unsigned n_events;
	bool quiet[BB_STAGES_MAX + 1]; /* rows whose silence is among the events, */
	int64_t silence_ns;          /* and the last edge before the newest of these */
	bool parity_lost;
};

void bb_guard_init(struct bb_sync_guard *g, const struct bb_guard_config *c, int64_t now_ns);
/* Every edge that sync/phase.h was given, after it. */
void bb_guard_edge(struct bb_sync_guard *g, const struct bb_phase *p, const struct bb_shutter_edge *e);
/* Once a frame. gone: the chain does not answer; runs: the shutters have been told to. */
enum bb_show bb_guard_step(struct bb_sync_guard *g, const struct bb_phase *p, bool gone, bool runs, int64_t now_ns);
/* Row O4, the owner was away, before and after it reads what came meanwhile: edges that were lost tell nothing, those that
 * were read tell what people saw. After that the rhythm is learnt anew, from a new sync/phase.h. */
void bb_guard_away(struct bb_sync_guard *g);
void bb_guard_back(struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns);
/* When it wants its next step: when the next edge of some stage will be missing; while one is, while it tries, or was
 * disturbed a moment ago, half a period from now. Of shutters that run. */
int64_t bb_guard_due_ns(const struct bb_sync_guard *g, const struct bb_phase *p, int64_t now_ns);
/* Row G6: three of its last eight edges were away from their places. */
bool bb_guard_jittery(const struct bb_sync_guard *g);
/* How long a silence that began with the last edge may be coasted over. */
int64_t bb_guard_holdover_ns(const struct bb_sync_guard *g, const struct bb_phase *p);

#endif
