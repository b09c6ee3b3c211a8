/*
 * sync/phase.h: period and phase of the shutter chain from its edges: the sync period with its jitter, each stage's
 * switching instant against the glasses' (the emitter's) for the same sync edge, missed and double edges, and whether
 * walls and glasses open for the same eye. Also predicts when an eye next sees a wall.
 * Algorithm only, fed with edges in any order within a few periods. No allocation. One thread.
 */
#ifndef BB_SYNC_PHASE_H
#define BB_SYNC_PHASE_H

#include "hal/shutter.h"

struct bb_phase_stage {
	uint64_t n;
	uint32_t seq;          /* of the newest edge */
	int64_t at_ns;
	uint8_t eye;
	uint64_t missed, doubled;
	int64_t offset_ns;     /* newest: this stage less the emitter at the same seq, less what is planned */
	bool paired;           /* offset_ns and eye_differs are of seq pair_seq */
	uint32_t pair_seq;
	bool eye_differs;      /* opened for the other eye than the glasses did */
};

struct bb_phase {
	int64_t nominal_ns;
	int64_t planned_ns;    /* a stage less the emitter as it should be; 0 after init */
	unsigned n_stages;
	struct bb_phase_stage stage[BB_STAGES_MAX];
	struct bb_phase_stage emitter;
	struct { /* the emitter's last edges, to pair stages with */
		uint32_t seq;
		int64_t at_ns;
		uint8_t eye;
		bool valid;
	} ring[8];
	int64_t first_ns;      /* emitter: for the period */
	uint32_t first_seq;
	double recent_ns;      /* decaying mean interval of the emitter: follows a change of rate within some 16 edges */
	double jitter_sq_ns2;  /* decaying mean square of (interval - recent_ns) */
};

void bb_phase_init(struct bb_phase *p, struct bb_rate rate, unsigned n_stages);
void bb_phase_edge(struct bb_phase *p, const struct bb_shutter_edge *edge);
/* Measured over all edges so far; the nominal one before the second edge. */
double bb_phase_period_ns(const struct bb_phase *p);
double bb_phase_jitter_ns(const struct bb_phase *p);
/* Largest |offset| of the paired stages and which; false before any pair. */
bool bb_phase_worst(const struct bb_phase *p, int64_t *offset_ns, unsigned *stage);
/* When, at or after at_ns, does this eye see through the glasses: at_ns itself if it is its half period, else the next
 * opening. Answers at_ns before any edge. */
int64_t bb_phase_open_ns(const struct bb_phase *p, enum bb_eye eye, int64_t at_ns);
/* The eye the glasses let see at a time, by the newest edge and the period; NONE before any edge or when untagged. */
enum bb_eye bb_phase_eye_at(const struct bb_phase *p, int64_t at_ns);

#endif
