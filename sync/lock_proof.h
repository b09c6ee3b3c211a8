/*
 * sync/lock_proof.h: are displays locked? Equal frame counters at a common instant, and vblanks that begin together: the
 * same proof for swap groups (GLX_NV_swap_group: the counter is common to all locked systems), for DRM flip events with
 * their sequence, for simulated displays and for recordings of any of them. A counter that steps by more than the time
 * says has dropped a frame, which turns the eyes of a frame-sequential display around. Stamps are of one clock, each with
 * its uncertainty; what is smaller than that is INCONCLUSIVE. No clock, no allocation. One thread.
 */
#ifndef BB_SYNC_LOCK_PROOF_H
#define BB_SYNC_LOCK_PROOF_H

#include "hal/rate.h"
#include "hal/status.h"

#define BB_LOCK_PROOF_DISPLAYS_MAX 512

enum bb_lock_verdict {
	BB_LOCK_PROVEN,
	BB_LOCK_COUNTERS_APART,
	BB_LOCK_PHASES_APART,
	BB_LOCK_INCONCLUSIVE, /* too few displays or samples, stamps too old, or uncertainty beyond the limit */
};

struct bb_lock_display { /* newest sample */
	bool any;
	uint64_t counter;       /* of the vblank that began at vblank_ns */
	int64_t vblank_ns, uncertainty_ns;
	uint64_t skips;         /* steps that do not fit the time between two samples */
};

struct bb_lock_proof {
	unsigned n;
	struct bb_rate rate;
	int64_t phase_limit_ns;
	struct bb_lock_display display[BB_LOCK_PROOF_DISPLAYS_MAX];
};

struct bb_lock_finding {
	enum bb_lock_verdict verdict;
	unsigned display;       /* the one farthest from the others */
	int64_t counters_apart; /* its counter minus that of most displays */
	int64_t phase_ns;       /* its vblank after the middle one's, within half a period */
	int64_t uncertainty_ns; /* of that */
	uint64_t skips;         /* of all */
};

/* More displays than fit are cut off. */
void bb_lock_proof_init(struct bb_lock_proof *p, unsigned n, struct bb_rate rate, int64_t phase_limit_ns);
/* Strangers, samples older than the newest, stamps not within -2^60 .. 3 * 2^61 ns and uncertainties not within 0 .. 2^60 ns
 * are ignored: false. */
bool bb_lock_proof_add(struct bb_lock_proof *p, unsigned display, uint64_t counter, int64_t vblank_ns, int64_t uncertainty_ns);
struct bb_lock_finding bb_lock_proof_judge(const struct bb_lock_proof *p, int64_t at_ns);
/* A recording: a line a sample, "DISPLAY COUNTER VBLANK_NS UNCERTAINTY_NS" in whole numbers; '#' begins a comment. Adds all;
 * returns 0, or the number of the first line that is no sample of these displays, and stops there. */
unsigned bb_lock_proof_read(struct bb_lock_proof *p, const char *text, size_t n_bytes);
const char *bb_lock_verdict_text(enum bb_lock_verdict v);

#endif
