/*
 * bench/result.h: everything a run has to say. result.json is the master; junit.xml, frames.csv, trace.json and
 * report.html are derived from the same struct and contain nothing else. Times are clock time in ns unless named.
 */
#ifndef BB_BENCH_RESULT_H
#define BB_BENCH_RESULT_H

#include "bench/ledger.h"
#include "hal/room.h"
#include "hal/scene.h"

#define BB_RESULT_SCHEMA 1

#define BB_VERDICT_LIST(X)                                                                                           \
	X(BB_PASS, "PASS")                                                                                           \
	X(BB_MARGINAL, "MARGINAL")                                                                                   \
	X(BB_INCONCLUSIVE, "INCONCLUSIVE")                                                                           \
	X(BB_FAIL, "FAIL")                                                                                           \
	X(BB_SKIP, "SKIP")

enum bb_verdict {
#define X(id, text) id,
	BB_VERDICT_LIST(X)
#undef X
};
const char *bb_verdict_text(enum bb_verdict v);

struct bb_budget_result {
	struct bb_budget budget;
	enum bb_verdict verdict;
	double value, uncertainty; /* of the budget's statistic */
	struct bb_summary summary;
	char culprit[64];          /* "camera/c3", "node/right"; "" when it holds */
	char cause[200];           /* "node/right draw took 24.9 ms at 3.012 s (limit 8.33 ms), 20 frames"; or why skipped */
	int64_t cause_ns;          /* scene time */
};

struct bb_stage_result {
	enum bb_stage stage;
	uint16_t node;             /* 0xFFFF: whole room */
	struct bb_summary summary; /* ms */
};

struct bb_device_result {
	char class_name[16], id[BB_ID_MAX], backend[16];
	int fidelity;              /* BB_NOT_NEEDED: not opened, 0 events, 0 cost */
	char health[16];           /* at the end */
	double longest_bad_s, bad_s;
	uint64_t events, ops;      /* counted cost */
	char note[160];            /* identity, battery, hours, last error */
};

struct bb_incident { /* a stretch in which a device or node was not OK */
	char culprit[64];
	char what[160];
	char state[16];            /* worst state reached */
	int64_t from_ns, to_ns;    /* scene time; to = BB_NEVER: until the end */
};

struct bb_fault_result {
	char text[160];
	int64_t set_ns, detected_ns; /* scene time; detected BB_NEVER: nothing noticed */
	char detected_by[64];
};

struct bb_picture_result {
	char file[96];             /* inside the result folder */
	uint16_t screen;           /* index in the room */
	char wall[BB_ID_MAX];
	char eye[8];               /* "left", "right", "mono" */
	double at_s;
	uint32_t width, height;
	double psnr_db;            /* NAN: not measured */
	bool identical;
	uint64_t rays, samples;
};

struct bb_stream_load { /* what one frame of one node spent on bricks */
	uint64_t frame;
	int64_t at_ns;             /* scene time */
	uint32_t bricks;
	uint64_t bytes;
	double ms, frame_ms;       /* spent on them; on the whole frame, them included */
};

struct bb_stream_total {           /* over the frames of a node */
	uint64_t sum, most;
};

struct bb_stream_node {
	uint64_t frames;           /* 0: the node draws no volume */
	uint64_t budget_bytes, held_bytes; /* of memory, 0: no limit; held at most, at the end of any frame */
	uint32_t budget_bricks;    /* a frame; 0: no limit */
	struct bb_stream_total loaded, bytes, drawn, missing, deficit; /* deficit: leaf cells coarser than planned */
	uint64_t evicted, prefetched, failed, odd; /* odd: values out of range, in all bricks read */
	double load_sum_ms;
	struct bb_stream_load most; /* the frame that spent most on bricks */
	uint64_t late;             /* frames over the limit that would have held it without their bricks */
	struct bb_stream_load worst; /* of them, the longest */
	int error;                 /* why the last brick that failed could not be read; 0: none */
	char error_text[160];
};

struct bb_stream_result {          /* n_nodes 0: there is no volume */
	uint64_t data_bytes;       /* the values of all steps as the bricks keep them, padding not counted */
	uint64_t leaf_bytes;       /* the same as bricks in memory */
	uint64_t leaf_cells;       /* of one step */
	uint64_t brick_bytes;      /* of one in memory */
	double limit_ms;           /* what a frame may take: the room's or the scene's budget, or the time to the next one */
	bool measured;             /* posix: times are real ones */
	size_t n_nodes;
	struct bb_stream_node *nodes; /* by room node */
};

#define BB_BLACK_MOST 4
#define BB_BLACK_CAUSES 5

struct bb_latency_test { /* light of a patch that copies a lamp, by a photodiode: bench/loop/diode.h; n 0: there was none */
	size_t n;                  /* times it lit up */
	double end_ms, most_ms;    /* lamp to light at the wall: mean, most; what no link counts included: the wait for an exposure */
	double links_ms;           /* exposure to light by the sum of the links: mean */
	double off_ms, scatter_ms; /* light as seen less light as the links have it: mean; the most a single one lies off that */
};

struct bb_black_cause {
	double score;
	char culprit[64], text[240];
};

struct bb_black_result { /* a moment at which something went wrong, and why: bench/blackbox.h */
	char what[120];
	int64_t at_ns;             /* scene time */
	size_t n_causes;           /* most likely first */
	struct bb_black_cause cause[BB_BLACK_CAUSES];
};

struct bb_counter {
	char name[48];             /* "bytes_streamed", "bricks_loaded" ... deterministic on the virtual clock */
	uint64_t value;
};
#define BB_COUNTERS_MAX 96

struct bb_path_point {
	double t_s;
	struct bb_vec3 truth, tracked; /* eyes' midpoint; NAN where unknown */
};

struct bb_text_pair {
	char key[48], value[256];
};

struct bb_run_result {
	const struct bb_room *room;   /* borrowed */
	const struct bb_scene *scene; /* borrowed */
	struct bb_ledger *ledger;     /* owned */
	enum bb_verdict verdict;
	int exit_code;
	uint64_t seed;
	char clock[12];               /* "virtual", "posix" */
	char event_log_sha256[65];
	uint64_t n_events;
	double duration_s;            /* of the scene, as run */
	double scene_start_s;         /* clock time */
	double wall_time_s;           /* real time spent: not part of anything gated */
	double stamp_error_ms[3];     /* one sigma: a camera's on host time, a display's, the shutters' */
	bool truncated;               /* interrupted */
	bool allow_flash;             /* asked for: flashes are measured and not judged */
	char summary[256];            /* one sentence for a person: the verdict and its first cause */

	size_t n_budgets;
	struct bb_budget_result *budgets;
	size_t n_stages;
	struct bb_stage_result *stages;
	size_t n_devices;
	struct bb_device_result *devices;
	size_t n_incidents;
	struct bb_incident *incidents;
	size_t n_faults;
	struct bb_fault_result *faults;
	size_t n_black;
	struct bb_black_result black[BB_BLACK_MOST];
	size_t n_pictures;
	struct bb_picture_result *pictures;
	size_t n_counters;
	struct bb_counter counters[BB_COUNTERS_MAX];
	struct bb_stream_result streaming;
	struct bb_latency_test latency_test;
	size_t n_path;
	struct bb_path_point *path;
	size_t n_facts;               /* versions, hashes, cost profile, GL, build, machine */
	struct bb_text_pair facts[48];
};

void bb_run_result_free(struct bb_run_result *r); /* NULL allowed */
/* Adds to a counter by name, creating it at 0. */
void bb_result_count(struct bb_run_result *r, const char *name, uint64_t add);
BB_PRINTF(3, 4)
void bb_result_fact(struct bb_run_result *r, const char *key, const char *fmt, ...);

/* Did brick loads make frames late, and which one most? A sentence for a person; "" without a volume. */
void bb_result_loads(const struct bb_run_result *r, char *out, size_t cap);

/* Judge every budget of room and scene by the ledger; fills r->budgets, r->verdict, r->exit_code. See bench/budget.c. */
BB_MUST_CHECK enum bb_status bb_result_judge(struct bb_run_result *r);

/* Writers. dir exists. Each file is written to a temporary name, synced and renamed. */
BB_MUST_CHECK enum bb_status bb_result_write_json(const struct bb_run_result *r, const char *path, struct bb_error *err);
char *bb_result_json_text(const struct bb_run_result *r); /* malloc'ed; NULL: out of memory */
BB_MUST_CHECK enum bb_status bb_result_write_junit(const struct bb_run_result *r, const char *path, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_result_write_csv(const struct bb_run_result *r, const char *path, struct bb_error *err);
/* What a mark belongs to: the id of a screen, stage, camera or node, "glasses"; NULL: nothing in the room. */
const char *bb_result_track_member(const struct bb_room *room, const struct bb_mark *m);
/* edges.csv: vblanks, shutters, glasses and strobes, for `phase --measured` (bench/phase/edges.h). */
BB_MUST_CHECK enum bb_status bb_result_write_edges(const struct bb_run_result *r, const char *path, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_result_write_trace(const struct bb_run_result *r, const char *path, struct bb_error *err);
/* The verdict table for a terminal. */
void bb_result_print(const struct bb_run_result *r, void *stream_FILE, bool colour);

#endif
