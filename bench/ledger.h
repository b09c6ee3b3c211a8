/*
 * bench/ledger.h: what every stage of every frame cost, counted into memory taken before the run. Nothing here
 * allocates, logs or locks between a sync edge and the swap. One thread.
 */
#ifndef BB_BENCH_LEDGER_H
#define BB_BENCH_LEDGER_H

#include "hal/metric.h"

/* Stages in the order a frame meets them: name, what it covers */
#define BB_STAGE_LIST(X)                                                                                             \
	X(BB_STAGE_EXPOSE, "expose", "mid-exposure to end of read-out")                                              \
	X(BB_STAGE_TRANSFER, "transfer", "read-out end to arrival on the host")                                      \
	X(BB_STAGE_WAIT, "wait", "arrival to the begin of the frame that uses it")                                   \
	X(BB_STAGE_TRACK, "track", "blobs to a predicted pose")                                                      \
	X(BB_STAGE_STATE, "state", "scene state sent to a node")                                                     \
	X(BB_STAGE_SELECT, "select", "bricks selected and streamed")                                                 \
	X(BB_STAGE_DRAW, "draw", "both eyes of every screen of a node")                                              \
	X(BB_STAGE_BARRIER, "barrier", "image ready to release")                                                     \
	X(BB_STAGE_PRESENT, "present", "release to the vblank of the flip")                                          \
	X(BB_STAGE_SCANOUT, "scanout", "flip to the middle row")                                                     \
	X(BB_STAGE_SHUTTER, "shutter", "middle row to an open shutter")

enum bb_stage {
#define X(id, name, help) id,
	BB_STAGE_LIST(X)
#undef X
	BB_STAGE_COUNT
};
const char *bb_stage_text(enum bb_stage stage);

struct bb_span {
	uint64_t frame;
	int64_t start_ns, end_ns; /* clock time */
	uint16_t stage;
	uint16_t node;            /* index in the room; 0xFFFF: the whole room */
	uint32_t tag;             /* screen or camera index, 0 if none */
};

struct bb_mark { /* an instant for the timeline */
	int64_t at_ns;
	uint8_t track;            /* enum bb_track_kind */
	uint8_t eye;              /* enum bb_eye: that begins to see, or whose picture it is */
	uint16_t index;           /* node, screen, stage or camera */
	int32_t value;
};
enum bb_track_kind { BB_TRACK_VSYNC, BB_TRACK_SHUTTER, BB_TRACK_STROBE, BB_TRACK_BARRIER, BB_TRACK_KIND_COUNT };

struct bb_sample { /* one value of one metric */
	double value;
	double uncertainty;       /* one sigma, same unit; 0: exact */
	uint64_t frame;
	int64_t at_ns;
	uint16_t node;            /* who spent it; 0xFFFF: nobody in particular */
	uint16_t stage;           /* the stage that spent most; BB_STAGE_COUNT: none */
};

#define BB_LINKS 14
struct bb_frame_row { /* a line of frames.csv; NAN is written as NA */
	uint64_t frame;
	int64_t start_ns;
	double head_to_photon_ms, frame_ms, swap_skew_us, scanout_skew_us, phase_us, pose_age_ms, pose_error_mm,
		photon_error_mm;
	uint32_t cameras, bricks_wanted, bricks_missing, bricks_loaded, late_node; /* late_node: 0xFFFFFFFF none */
	uint64_t bytes, deficit;  /* deficit: leaf cells coarser than planned, all nodes */
	double upload_ms;         /* spent on bricks by the node that spent most */
	unsigned flags;           /* enum bb_frame_flags */
	double unpredicted_mm, photon_error_deg, unpredicted_deg; /* of the eyes at the photon; unpredicted: the newest
	                                                             solution's pose as it stands */
	double horizon_ms, pose_sigma_mm, solved_sigma_mm; /* predicted so far; of the pose the pictures used; of the solution */
	bool chained;             /* the links below add up to head_to_photon_ms */
	int32_t link_ns[BB_LINKS]; /* bench/latency.h */
};
enum bb_frame_flags { BB_FRAME_TORN = 1, BB_FRAME_EYES_SWAPPED = 2, BB_FRAME_MONO = 4, BB_FRAME_POSE_OLD = 8, BB_FRAME_VIEW_CLAMPED = 16 };

struct bb_ledger;
/* Capacity for n_frames; what does not fit is counted in `dropped`, the statistics still see every sample's value. */
BB_MUST_CHECK enum bb_status bb_ledger_create(size_t n_frames, size_t n_nodes, struct bb_ledger **out);
void bb_ledger_destroy(struct bb_ledger *l);
void bb_ledger_span(struct bb_ledger *l, uint64_t frame, enum bb_stage stage, uint16_t node, uint32_t tag,
                    int64_t start_ns, int64_t end_ns);
void bb_ledger_mark(struct bb_ledger *l, enum bb_track_kind track, uint16_t index, int64_t at_ns, int32_t value,
                    uint8_t eye);
void bb_ledger_sample(struct bb_ledger *l, enum bb_metric metric, const struct bb_sample *sample);
void bb_ledger_row(struct bb_ledger *l, const struct bb_frame_row *row);

struct bb_summary { /* of one metric or one stage; all NAN when n is 0 */
	size_t n;
	double min, p50, p99, max, mean, rms, max_abs;
	double uncertainty;       /* of the worst sample, one sigma */
	struct bb_sample worst;   /* the sample furthest on the wrong side */
};
struct bb_summary bb_ledger_metric(const struct bb_ledger *l, enum bb_metric metric);
/* Durations of a stage in ms; node 0xFFFF: all nodes. */
struct bb_summary bb_ledger_stage(const struct bb_ledger *l, enum bb_stage stage, uint16_t node);
size_t bb_ledger_spans(const struct bb_ledger *l, const struct bb_span **out);
size_t bb_ledger_marks(const struct bb_ledger *l, const struct bb_mark **out);
size_t bb_ledger_rows(const struct bb_ledger *l, const struct bb_frame_row **out);
size_t bb_ledger_samples(const struct bb_ledger *l, enum bb_metric metric, const struct bb_sample **out);
uint64_t bb_ledger_dropped(const struct bb_ledger *l);
double bb_summary_stat(const struct bb_summary *s, enum bb_stat stat);

#endif
