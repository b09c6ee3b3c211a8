/*
 * render/bricks/format.h: a brick file, NAME.bricks, version 2. Little-endian; every section has a CRC-32C (Castagnoli,
 * as in iSCSI, RFC 3720 appendix B.4), so has every brick.
 *
 *   0            header, one page of 4096 bytes; its last 4 bytes are the CRC of the others
 *   ...          bricks, each (edge + 2 pad)^3 values, x fastest, as they are or packed (of a file with a codec those
 *                that have as many bytes as their values are as they are; in version 1 they were packed, too); and
 *                histograms
 *   index        a record of 16 bytes for each brick, in order of its number: offset u64, bytes u32, CRC u32
 *   moments      a record of 48 bytes for each brick: mean, deviation, least, most, temporal deviation, temporal
 *                coefficient of variation, mean absolute error against the leaves, all f32; then, as in the
 *                index, where its histograms lie; 4 bytes of nothing
 *
 * A brick's histograms are coded one behind the other (stats.h): of values, of errors against the leaves, against its
 * spatial children, against its temporal children.
 * A padding voxel is the true neighbour of the same level and time, at the volume's faces the nearest voxel of it.
 * Voxels of a brick that lie outside the volume repeat the nearest one inside.
 *
 * Spherical grids: x, y, z are r, theta (from the pole) and phi. Voxel i of n of the finest level has its middle at
 * from + (i + 0.5) / n * (to - from) of the extent. Where phi goes all the way round (bb_bricks_wraps) there is no face
 * across phi: the neighbour of its last voxel is its first one of that level. The `pad` voxels beyond either end are
 * those across the seam, whether they lie in a brick's padding or, where the last brick is not full, in the brick;
 * what is farther outside repeats them. r and theta have faces as all other grids.
 */
#ifndef BB_RENDER_BRICKS_FORMAT_H
#define BB_RENDER_BRICKS_FORMAT_H

#include "render/bricks/tree.h"

#define BB_BRICKS_VERSION 2 /* 1 is read, too */
#define BB_BRICKS_HEADER_BYTES 4096
#define BB_BRICKS_INDEX_BYTES 16
#define BB_BRICKS_MOMENTS_BYTES 48
#define BB_BRICKS_PAD_MOST 2

enum bb_brick_type { BB_BRICK_U8, BB_BRICK_U16, BB_BRICK_F16, BB_BRICK_F32, BB_BRICK_TYPES };
enum bb_brick_codec { BB_BRICK_PLAIN, BB_BRICK_LZ4, BB_BRICK_ZSTD, BB_BRICK_CODECS };
enum bb_brick_grid { BB_BRICK_CARTESIAN, BB_BRICK_SPHERICAL, BB_BRICK_GRIDS };

/* Kinds of histograms, in the file's order. */
enum bb_brick_histogram { BB_HIST_VALUE, BB_HIST_LEAF, BB_HIST_SPACE, BB_HIST_TIME, BB_HIST_KINDS };

const char *bb_brick_type_text(enum bb_brick_type type);
const char *bb_brick_codec_text(enum bb_brick_codec codec);
size_t bb_brick_type_bytes(enum bb_brick_type type);

struct bb_bricks_section {
	uint64_t offset, bytes;
	uint32_t crc;
};

struct bb_bricks_header {
	char name[64];
	uint32_t version; /* as read; what is written is BB_BRICKS_VERSION */
	struct bb_tree tree;
	uint32_t pad;
	enum bb_brick_type type;
	enum bb_brick_codec codec;
	enum bb_brick_grid grid;
	double spacing_mm[3];
	double extent[6];     /* spherical: r from, to; theta from, to (from the pole); phi from, to; radians */
	double least, most;   /* of the finite values; u8 and u16 are parts of this range */
	uint64_t n_nonfinite; /* voxels that were NaN or infinite and were filled with `least` */
	struct bb_bricks_section index, moments;
};

/* Does phi go all the way round? True of a spherical grid whose extent of phi is 2 pi, to a thousandth. */
static inline bool bb_bricks_wraps(const struct bb_bricks_header *h)
{
	const double short_of = 6.283185307179586 - (h->extent[5] - h->extent[4]);

	return h->grid == BB_BRICK_SPHERICAL && short_of < 1e-3 && short_of > -1e-3;
}

/* Of one brick as it lies in memory: (edge + 2 pad)^3 values. */
size_t bb_bricks_brick_bytes(const struct bb_bricks_header *h);
/* Are a brick's n bytes in the file its values as they are? */
bool bb_bricks_as_is(const struct bb_bricks_header *h, size_t n);

void bb_bricks_header_write(const struct bb_bricks_header *h, uint8_t out[BB_BRICKS_HEADER_BYTES]);
/*
 * Believes nothing: the CRC, then every field, then that all sections lie within a file of file_bytes, apart, as large
 * as the tree demands. 1440 to 1445, 1451. Allocates nothing.
 */
BB_MUST_CHECK enum bb_status bb_bricks_header_read(const uint8_t in[BB_BRICKS_HEADER_BYTES], uint64_t file_bytes,
						   const struct bb_where *where, struct bb_bricks_header *out,
						   struct bb_error *err);

uint32_t bb_crc32c(uint32_t crc, const void *bytes, size_t n); /* begin with 0; pieces one after another */

struct bb_bricks_record { /* where something lies in the file */
	uint64_t offset;
	uint32_t bytes, crc;
};

struct bb_bricks_moments { /* of a brick, as in the file */
	float mean, deviation, least, most, time_dev, time_cov, leaf_error;
	struct bb_bricks_record histograms;
};
void bb_bricks_record_write(const struct bb_bricks_record *r, uint8_t out[BB_BRICKS_INDEX_BYTES]);
struct bb_bricks_record bb_bricks_record_read(const uint8_t in[BB_BRICKS_INDEX_BYTES]);
void bb_bricks_moments_write(const struct bb_bricks_moments *m, uint8_t out[BB_BRICKS_MOMENTS_BYTES]);
struct bb_bricks_moments bb_bricks_moments_read(const uint8_t in[BB_BRICKS_MOMENTS_BYTES]);

void bb_put_u32(uint8_t *to, uint32_t v);
void bb_put_u64(uint8_t *to, uint64_t v);
uint32_t bb_get_u32(const uint8_t *from);
uint64_t bb_get_u64(const uint8_t *from);

#endif
