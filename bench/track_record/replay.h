/*
 * bench/track_record/replay.h: a recording's frames through the tracker once more, and whether it says the same again.
 */
#ifndef BB_BENCH_REPLAY_H
#define BB_BENCH_REPLAY_H

#include "bench/track_record/record.h"
#include "hal/clock.h"

struct bb_replay_config {
	const char *path;
	const struct bb_room *room; /* the one it was recorded in; NULL: only read it */
	bool any_room;              /* its file may have changed since */
	double speed;               /* 1: as it was; 0: as fast as it goes */
	const char *csv;            /* the poses the tracker gives now (room NULL: the recorded ones); NULL: none */
};

struct bb_replay {
	char room[64];
	uint64_t frames, blobs, solves, pad_reports;
	uint64_t poses_recorded, poses_replayed, same; /* same: bit for bit, in its place */
	int64_t first_ns, last_ns;                     /* of the solves */
	bool truncated;                                /* err says after what */
};

/* BB_OK: read to its end, or to where it was cut (truncated, with 1763 in err). 1001, 1762, 1764, 1901. */
BB_MUST_CHECK enum bb_status bb_replay_run(const struct bb_replay_config *config, struct bb_replay *out,
                                           struct bb_error *err);

/* Poses as CSV: units in the names of columns; see docs/streaming.md. */
void bb_poses_csv_head(FILE *out);
void bb_poses_csv_row(FILE *out, const char *body, const struct bb_track_solution *s);

#endif
