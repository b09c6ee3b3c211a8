/*
 * render/bricks/bricks.h: a brick file (format.h) open for reading. The file is hostile until checked: header, index
 * and moments when it is opened, each brick and histogram by its CRC when it is read; one that is damaged is a numbered
 * error and nothing else is. All calls but open and close are thread-safe. Memory: 64 bytes a brick.
 */
#ifndef BB_RENDER_BRICKS_BRICKS_H
#define BB_RENDER_BRICKS_BRICKS_H

#include "render/bricks/format.h"
#include "render/bricks/stats.h"

struct bb_bricks;

/* 10xx, 1406, 1440 to 1445, 1451, 1454. */
BB_MUST_CHECK enum bb_status bb_bricks_open(const char *path, struct bb_bricks **out, struct bb_error *err);
void bb_bricks_close(struct bb_bricks *b);
const struct bb_bricks_header *bb_bricks_header(const struct bb_bricks *b);
const struct bb_bricks_moments *bb_bricks_moments(const struct bb_bricks *b); /* [n_bricks] */
const struct bb_bricks_record *bb_bricks_index(const struct bb_bricks *b);    /* [n_bricks] */
/* bb_bricks_brick_bytes(header) bytes as they are stored, unpacked; bb_values_load makes them floats. Allocates a packed
 * brick's bytes. 1002, 1406, 1441, 1450. */
BB_MUST_CHECK enum bb_status bb_bricks_read(const struct bb_bricks *b, uint64_t brick, uint8_t *out,
					    struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_bricks_histograms(const struct bb_bricks *b, uint64_t brick,
						  uint16_t out[BB_HIST_KINDS][BB_STATS_BINS], struct bb_error *err);

/*
 * Batches. A reader is what one thread reads with: as many readers as threads, all of one open file, each used by one
 * thread at a time and destroyed before the file is closed. It holds all the memory that reading takes; a batch
 * allocates nothing.
 */
#define BB_BRICKS_BATCH_MOST 4096

struct bb_bricks_want {
	uint64_t brick;
	uint8_t *out;          /* bb_bricks_brick_bytes(header); holds anything when the brick failed */
	enum bb_status status; /* out: of this brick alone */
	int number;            /* out: of hal/errors.def; 0 when it is there */
};

struct bb_bricks_counts { /* since the reader was created */
	uint64_t bricks, failed;
	uint64_t reads, read_bytes; /* asked of the file, after neighbours were joined */
};

enum bb_bricks_way {
	BB_BRICKS_CACHED, /* what the page cache has comes from it, the rest directly if the file system can */
	BB_BRICKS_DIRECT  /* all of it from the disk, by O_DIRECT: many reads at once, no trace in the page cache */
};

struct bb_bricks_reader;
/*
 * For up to `most` bricks at a time (larger batches are cut). It holds 2 MiB when so many bricks are more than about
 * 128 KiB, else little more than their bytes. 1453: this file system has no direct reads; 1702.
 */
BB_MUST_CHECK enum bb_status bb_bricks_reader_create(const struct bb_bricks *b, uint32_t most, enum bb_bricks_way way,
						     struct bb_bricks_reader **out, struct bb_error *err);
void bb_bricks_reader_destroy(struct bb_bricks_reader *r);                 /* NULL is allowed */
uint64_t bb_bricks_reader_bytes(const struct bb_bricks_reader *r);         /* all it holds, from create to destroy */
struct bb_bricks_counts bb_bricks_reader_counts(const struct bb_bricks_reader *r);
/*
 * Reads n bricks, in the file's order whatever theirs is; the same one may be wanted twice. A brick that fails fails
 * alone: 1002, 1406 (the file was cut short), 1441, 1450, 1452 in its want; err has the first one's words, and the
 * status is that of the first want that failed.
 */
enum bb_status bb_bricks_read_many(struct bb_bricks_reader *r, struct bb_bricks_want *wants, size_t n,
				   struct bb_error *err);

#endif
