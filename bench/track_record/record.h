/*
 * bench/track_record/record.h: everything a tracker sees and says, as a text file, zstd-compressed when its name ends
 * in .zst: docs/streaming.md has the format. Numbers are written so that they read back bit for bit. Written line by line
 * beside its name and renamed when it is whole; read line by line with bounded memory, whatever is in it.
 */
#ifndef BB_BENCH_RECORD_H
#define BB_BENCH_RECORD_H

#include "bench/file.h"
#include "hal/room.h"
#include "sync/track/tracker.h"

#define BB_RECORD_CAMERAS_MAX 256
#define BB_RECORD_PADS_MAX 16

struct bb_record_head {
	char room[64];           /* its name */
	char sha256[65];         /* of its file; "-": there was none (an import) */
	bool has_tracker;
	double sigma_px;         /* as in bb_tracker_config, */
	int64_t group_ns, freeze_ns;
	struct bb_vec3 room_min, room_max;
	struct bb_pose neutral;  /* so that the same tracker can be made again */
	size_t n_cameras, n_bodies, n_pads;
	char camera[BB_RECORD_CAMERAS_MAX][BB_ID_MAX];
	struct bb_body body[BB_BODIES_MAX]; /* imports: without markers */
	char pad[BB_RECORD_PADS_MAX][BB_ID_MAX];
};
void bb_record_head_of(struct bb_record_head *h, const struct bb_room *room, const struct bb_tracker_config *tracker);

enum bb_record_kind {
	BB_RECORD_FRAME,         /* one camera's */
	BB_RECORD_SOLVE,         /* the tracker was asked to solve what it has */
	BB_RECORD_POSE,          /* what it said then */
	BB_RECORD_PAD,           /* a gamepad's report */
	BB_RECORD_END
};

struct bb_record_frame {
	uint16_t camera;
	uint32_t seq;
	int64_t device_ns, arrived_ns, mid_ns; /* mid_ns: mid-exposure as the tracker was told it */
	bool overflow;
	bool given;              /* to the tracker; not of a camera that was knocked */
	size_t n;
	const struct bb_blob *blobs;
};

struct bb_record_pose {
	uint16_t body;
	struct bb_track_solution solution; /* centroid and n_blobs are not recorded */
};

struct bb_record_item {
	enum bb_record_kind kind;
	int64_t now_ns;          /* of a solve */
	struct bb_record_frame frame;
	struct bb_record_pose pose;
	struct { uint16_t pad; struct bb_pad_report report; } pad;
};

/* ---- writing ---- */

struct bb_recorder;
BB_MUST_CHECK enum bb_status bb_recorder_create(const char *path, const struct bb_record_head *head,
                                                struct bb_recorder **out, struct bb_error *err);
void bb_recorder_put(struct bb_recorder *r, const struct bb_record_item *item); /* any but the end */
/* The end, sync, rename; frees r. What went wrong since the beginning is told here: 1901. */
BB_MUST_CHECK enum bb_status bb_recorder_commit(struct bb_recorder *r, struct bb_error *err);
void bb_recorder_abort(struct bb_recorder *r); /* no file is left; NULL is allowed */

/* ---- reading ---- */

struct bb_record_reader;
/* The head is read. 1001; 1762 with the line. */
BB_MUST_CHECK enum bb_status bb_record_open(const char *path, struct bb_record_reader **out, struct bb_error *err);
/* From memory, which is borrowed; *reader NULL makes one, otherwise it begins again. */
BB_MUST_CHECK enum bb_status bb_record_open_bytes(const uint8_t *bytes, size_t n, struct bb_record_reader **reader,
                                                  struct bb_error *err);
void bb_record_close(struct bb_record_reader *r); /* NULL is allowed */
const struct bb_record_head *bb_record_head(const struct bb_record_reader *r);
/* The next item; blobs are good until the next call. 1762; 1763 when the file ends without its end: everything before
 * that has been given. After an error only closing is allowed. */
BB_MUST_CHECK enum bb_status bb_record_next(struct bb_record_reader *r, struct bb_record_item *item,
                                            struct bb_error *err);

/* Lines, for both: what one may be long, a frame of most blobs with every number at its longest. */
#ifdef BB_FUZZ
#define BB_RECORD_LINE 400 /* reached by short inputs */
#else
#define BB_RECORD_LINE (256 + 3 * 18 * BB_CAMERA_BLOBS_MAX)
#endif
/* A word of a line: printable, no spaces, at most BB_ID_MAX - 1; others become '_'. */
void bb_record_word(char out[BB_ID_MAX], const char *text);

#endif
