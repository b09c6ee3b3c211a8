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

/* 10xx, 1440 to 1445. */
BB_MUST_CHECK enum bb_status bb_bricks_open(const char *path, struct bb_bricks **out, struct bb_error *err);
void bb_bricks_close(struct bb_bricks *b);
const struct bb_bricks_header *bb_bricks_header(const struct bb_bricks *b);
const struct bb_bricks_moments *bb_bricks_moments(const struct bb_bricks *b); /* [n_bricks] */
const struct bb_bricks_record *bb_bricks_index(const struct bb_bricks *b);    /* [n_bricks] */
/* bb_bricks_brick_bytes(header) bytes as they are stored, unpacked; bb_values_load makes them floats. 1441, 1450. */
BB_MUST_CHECK enum bb_status bb_bricks_read(const struct bb_bricks *b, uint64_t brick, uint8_t *out,
					    struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_bricks_histograms(const struct bb_bricks *b, uint64_t brick,
						  uint16_t out[BB_HIST_KINDS][BB_STATS_BINS], struct bb_error *err);

#endif
