/*
 * drivers/edge_lock.h: what the edges of one stereo sync line mean: which are real, which frame each begins and for
 * which eye, and what is wrong with the signal. Algorithm only: fed with events and times, no bus, no allocation.
 *
 * Each edge begins a frame; high is the left eye (VESA). A phase-locked loop numbers the frames by time, so the number
 * survives lost edges. An eye is told only when the level is confirmed: by the parity of the numbers once that is
 * known, or else by an alternating pair one period apart. After events were lost the parity is unknown until such a
 * pair (a tagged edge) comes; nothing is guessed. A line without event numbers (libgpiod 1.x) loses events without a
 * word: there a repeated level or a gap above 1.5 periods counts as a loss.
 */
#ifndef BB_DRIVERS_EDGE_LOCK_H
#define BB_DRIVERS_EDGE_LOCK_H

#include "hal/bus.h"
#include "hal/shutter.h"

/* Rows G1-G4 and G6-G9 of the fault matrix; G5 (drift) is a number, not a fault. Set: since when and until when. */
#define BB_SYNC_FAULTS(X)                                                                                            \
	X(BB_SYNC_LOST, "SYNC_LOST")       /* silent for 1.5 periods; until 8 good edges (at once after 1 or 2) */    \
	X(BB_SYNC_GLITCH, "GLITCH")        /* a spurious edge, dropped; set above 1 % of the edges of a minute */     \
	X(BB_SYNC_MISSED, "MISSED")        /* 1 or 2 frames without an edge; over when it is known */                 \
	X(BB_SYNC_OVERRUN, "EVT_OVERRUN")  /* events were lost on the way; until the parity is known again */         \
	X(BB_SYNC_JITTER, "JITTER")        /* edges away from their places; until 8 good edges */                     \
	X(BB_SYNC_RATE, "RATE_CHANGE")     /* another period; until 8 good edges of it */                             \
	X(BB_SYNC_SWAP, "EYE_SWAP")        /* levels against the parity; until 10 frames agree */                     \
	X(BB_SYNC_GONE, "GONE")            /* the chip is not there; until it is open again */

enum bb_sync_fault {
#define X(name, text) name,
	BB_SYNC_FAULTS(X)
#undef X
	BB_SYNC_FAULT_COUNT
};
const char *bb_sync_fault_text(enum bb_sync_fault fault);

struct bb_sync_fault_state {
	bool set;
	uint64_t n;         /* occurrences; frames for MISSED */
	int64_t set_ns, cleared_ns;
};

#define BB_LOCK_INTERVALS 4
#define BB_LOCK_SECONDS 60

struct bb_edge_lock {
	int64_t nominal_ns;
	double holdover_ppm;   /* how far the period may be off while nobody hears it */
	struct bb_sync_fault_state fault[BB_SYNC_FAULT_COUNT];
	uint32_t news;         /* bit per fault that occurred; the reader clears it */
	uint64_t edges, unmatched; /* accepted; of them with a level against the parity */
	/* the loop */
	bool any, locked, silent, lost, numbered; /* lost: silent beyond the time-box */
	double period_ns, sigma_ns;
	int64_t ref_ns;        /* where frame `tick` is, filtered */
	uint32_t tick;
	int64_t edge_ns;       /* newest accepted edge */
	int64_t raw_ns;        /* newest edge that was no bounce; the begin, before any */
	bool level;
	unsigned fresh, good, strays; /* accepted since the loop began, good and stray edges in a row */
	int64_t interval_ns[BB_LOCK_INTERVALS];
	unsigned n_intervals;
	double innovation_ns[3];
	unsigned n_innovations;
	/* the eyes */
	bool parity_known, parity_before, even_level;
	unsigned alternating, against, agreeing;
	/* the minute */
	int64_t second;
	uint16_t glitch_in[BB_LOCK_SECONDS], edge_in[BB_LOCK_SECONDS];
	uint32_t glitches_min, edges_min;
	/* drift of the rate, measured over spans of 1 s */
	int64_t span_ns;
	uint32_t span_tick;
	bool span_any, drift_known;
	double drift_ppm;
};

void bb_edge_lock_init(struct bb_edge_lock *l, struct bb_rate rate, double holdover_ppm, int64_t now_ns);
/* Takes one event. True: it is a frame's edge and stands in *out (stage is not set). */
bool bb_edge_lock_event(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t now_ns,
                        struct bb_shutter_edge *out);
/* To be called when time has passed and every event was taken. */
void bb_edge_lock_pass(struct bb_edge_lock *l, int64_t now_ns);
/* When silence will mean something next; BB_NEVER: it means nothing more. */
int64_t bb_edge_lock_wake_ns(const struct bb_edge_lock *l);
/* The bus was opened anew: numbers and levels begin again, time and frame numbers go on. */
void bb_edge_lock_reopened(struct bb_edge_lock *l);

void bb_edge_lock_raise(struct bb_edge_lock *l, enum bb_sync_fault fault, uint64_t n, int64_t now_ns);
void bb_edge_lock_clear(struct bb_edge_lock *l, enum bb_sync_fault fault, int64_t now_ns);

enum bb_health bb_edge_lock_health(const struct bb_edge_lock *l);
/* The period is not the configured one (beyond 1 %). */
bool bb_edge_lock_off_rate(const struct bb_edge_lock *l);
/* How much of the time-box is left; 0 when it is over. */
int64_t bb_edge_lock_holdover_ns(const struct bb_edge_lock *l, int64_t now_ns);
double bb_edge_lock_jitter_ns(const struct bb_edge_lock *l);

#endif
