#include "render/bricks/format.h"

#include <math.h>
#include <string.h>

enum { /* offsets in the header */
       AT_MAGIC = 0,
       AT_VERSION = 8,
       AT_DIM = 16,
       AT_STEPS = 28,
       AT_EDGE = 32,
       AT_PAD = 36,
       AT_TYPE = 40,
       AT_CODEC = 44,
       AT_GRID = 48,
       AT_SPACING = 56,
       AT_EXTENT = 80,
       AT_LEAST = 128,
       AT_MOST = 136,
       AT_NONFINITE = 144,
       AT_BRICKS = 152,
       AT_INDEX = 160,
       AT_MOMENTS = 184,
       AT_NAME = 256,
       AT_CRC = BB_BRICKS_HEADER_BYTES - 4
};

static const char magic[8] = "BBRICKS";

const char *bb_brick_type_text(enum bb_brick_type type)
{
	static const char *const text[BB_BRICK_TYPES] = { "u8", "u16", "f16", "f32" };

	return text[type];
}

const char *bb_brick_codec_text(enum bb_brick_codec codec)
{
	static const char *const text[BB_BRICK_CODECS] = { "none", "lz4", "zstd" };

	return text[codec];
}

size_t bb_brick_type_bytes(enum bb_brick_type type)
{
	static const uint8_t bytes[BB_BRICK_TYPES] = { 1, 2, 2, 4 };

	return bytes[type];
}

size_t bb_bricks_brick_bytes(const struct bb_bricks_header *h)
{
	const size_t side = h->tree.edge + 2 * h->pad;

	return side * side * side * bb_brick_type_bytes(h->type);
}

bool bb_bricks_as_is(const struct bb_bricks_header *h, size_t n)
{
	return h->codec == BB_BRICK_PLAIN || (h->version > 1 && n == bb_bricks_brick_bytes(h));
}

void bb_put_u32(uint8_t *to, uint32_t v)
{
	for (int i = 0; i < 4; i++)
		to[i] = (uint8_t)(v >> 8 * i);
}

void bb_put_u64(uint8_t *to, uint64_t v)
{
	bb_put_u32(to, (uint32_t)v);
	bb_put_u32(to + 4, (uint32_t)(v >> 32));
}

uint32_t bb_get_u32(const uint8_t *from)
{
	return (uint32_t)from[0] | (uint32_t)from[1] << 8 | (uint32_t)from[2] << 16 | (uint32_t)from[3] << 24;
}

uint64_t bb_get_u64(const uint8_t *from)
{
	return bb_get_u32(from) | (uint64_t)bb_get_u32(from + 4) << 32;
}

static void put_f64(uint8_t *to, double v)
{
	uint64_t bits;

	memcpy(&bits, &v, 8);
	bb_put_u64(to, bits);
}

static double get_f64(const uint8_t *from)
{
	const uint64_t bits = bb_get_u64(from);
	double v;

	memcpy(&v, &bits, 8);
	return v;
}

static void put_section(uint8_t *to, const struct bb_bricks_section *s)
{
	bb_put_u64(to, s->offset);
	bb_put_u64(to + 8, s->bytes);
	bb_put_u32(to + 16, s->crc);
}

void bb_bricks_header_write(const struct bb_bricks_header *h, uint8_t out[BB_BRICKS_HEADER_BYTES])
{
	memset(out, 0, BB_BRICKS_HEADER_BYTES);
	memcpy(out + AT_MAGIC, magic, sizeof(magic));
	bb_put_u32(out + AT_VERSION, BB_BRICKS_VERSION);
	for (size_t a = 0; a < 3; a++) {
		bb_put_u32(out + AT_DIM + 4 * a, h->tree.dim[a]);
		put_f64(out + AT_SPACING + 8 * a, h->spacing_mm[a]);
	}
	for (size_t i = 0; i < 6; i++)
		put_f64(out + AT_EXTENT + 8 * i, h->extent[i]);
	bb_put_u32(out + AT_STEPS, h->tree.n_steps);
	bb_put_u32(out + AT_EDGE, h->tree.edge);
	bb_put_u32(out + AT_PAD, h->pad);
	bb_put_u32(out + AT_TYPE, (uint32_t)h->type);
	bb_put_u32(out + AT_CODEC, (uint32_t)h->codec);
	bb_put_u32(out + AT_GRID, (uint32_t)h->grid);
	put_f64(out + AT_LEAST, h->least);
	put_f64(out + AT_MOST, h->most);
	bb_put_u64(out + AT_NONFINITE, h->n_nonfinite);
	bb_put_u64(out + AT_BRICKS, h->tree.n_bricks);
	put_section(out + AT_INDEX, &h->index);
	put_section(out + AT_MOMENTS, &h->moments);
	memcpy(out + AT_NAME, h->name, strnlen(h->name, sizeof(h->name) - 1));
	bb_put_u32(out + AT_CRC, bb_crc32c(0, out, AT_CRC));
}

/* A section that lies in the file, behind the header. */
static bool read_section(const uint8_t *in, uint64_t file_bytes, struct bb_bricks_section *out)
{
	*out = (struct bb_bricks_section){ bb_get_u64(in), bb_get_u64(in + 8), bb_get_u32(in + 16) };
	return out->offset >= BB_BRICKS_HEADER_BYTES && out->offset <= file_bytes &&
	       out->bytes <= file_bytes - out->offset;
}

static enum bb_status read_shape(const uint8_t *in, const struct bb_where *where, struct bb_bricks_header *out,
				 struct bb_error *err)
{
	const uint32_t dim[3] = { bb_get_u32(in + AT_DIM), bb_get_u32(in + AT_DIM + 4), bb_get_u32(in + AT_DIM + 8) };
	const uint32_t steps = bb_get_u32(in + AT_STEPS), edge = bb_get_u32(in + AT_EDGE);

	if (!bb_tree_init(&out->tree, dim, steps, edge))
		return bb_fail(err, BB_ERR_FORMAT, 1442, where, "%u x %u x %u voxels, %u steps, bricks of %u", dim[0],
			       dim[1], dim[2], steps, edge);
	if (bb_get_u64(in + AT_BRICKS) != out->tree.n_bricks)
		return bb_fail(err, BB_ERR_FORMAT, 1442, where, "it says %llu bricks, that shape has %llu",
			       (unsigned long long)bb_get_u64(in + AT_BRICKS), (unsigned long long)out->tree.n_bricks);
	out->pad = bb_get_u32(in + AT_PAD);
	const uint32_t type = bb_get_u32(in + AT_TYPE), codec = bb_get_u32(in + AT_CODEC),
		       grid = bb_get_u32(in + AT_GRID);
	if (out->pad > BB_BRICKS_PAD_MOST || type >= BB_BRICK_TYPES || codec >= BB_BRICK_CODECS ||
	    grid >= BB_BRICK_GRIDS)
		return bb_fail(err, BB_ERR_FORMAT, 1443, where, "padding %u, type %u, codec %u, grid %u", out->pad,
			       type, codec, grid);
	out->type = (enum bb_brick_type)type;
	out->codec = (enum bb_brick_codec)codec;
	out->grid = (enum bb_brick_grid)grid;
	return BB_OK;
}

static enum bb_status read_numbers(const uint8_t *in, const struct bb_where *where, struct bb_bricks_header *out,
				   struct bb_error *err)
{
	bool sane = true;

	for (size_t a = 0; a < 3; a++) {
		out->spacing_mm[a] = get_f64(in + AT_SPACING + 8 * a);
		sane &= out->spacing_mm[a] >= 1e-6 && out->spacing_mm[a] <= 1e6;
	}
	for (size_t i = 0; i < 6; i++) {
		out->extent[i] = get_f64(in + AT_EXTENT + 8 * i);
		sane &= fabs(out->extent[i]) <= 1e12;
		sane &= out->grid == BB_BRICK_CARTESIAN || i % 2 == 0 || out->extent[i] > out->extent[i - 1];
	}
	out->least = get_f64(in + AT_LEAST);
	out->most = get_f64(in + AT_MOST);
	out->n_nonfinite = bb_get_u64(in + AT_NONFINITE);
	sane &= out->most >= out->least && isfinite(out->most - out->least);
	if (!sane)
		return bb_fail(err, BB_ERR_FORMAT, 1444, where, "spacing, extent or value range");
	memcpy(out->name, in + AT_NAME, sizeof(out->name));
	out->name[sizeof(out->name) - 1] = '\0';
	for (char *c = out->name; *c; c++) /* it goes to terminals and into JSON */
		if (*c < ' ' || *c > '~')
			*c = '?';
	return BB_OK;
}

static enum bb_status read_sections(const uint8_t *in, uint64_t file_bytes, const struct bb_where *where,
				    struct bb_bricks_header *out, struct bb_error *err)
{
	const uint64_t n = out->tree.n_bricks;

	if (!read_section(in + AT_INDEX, file_bytes, &out->index) ||
	    !read_section(in + AT_MOMENTS, file_bytes, &out->moments))
		return bb_fail(err, BB_ERR_FORMAT, 1445, where, "a section lies outside the file's %llu bytes",
			       (unsigned long long)file_bytes);
	if (out->index.bytes != n * BB_BRICKS_INDEX_BYTES || out->moments.bytes != n * BB_BRICKS_MOMENTS_BYTES)
		return bb_fail(err, BB_ERR_FORMAT, 1445, where, "a section is not as large as %llu bricks need",
			       (unsigned long long)n);
	if (out->index.offset < out->moments.offset + out->moments.bytes &&
	    out->moments.offset < out->index.offset + out->index.bytes)
		return bb_fail(err, BB_ERR_FORMAT, 1451, where, "the index and the moments");
	return BB_OK;
}

enum bb_status bb_bricks_header_read(const uint8_t in[BB_BRICKS_HEADER_BYTES], uint64_t file_bytes,
				     const struct bb_where *where, struct bb_bricks_header *out, struct bb_error *err)
{
	enum bb_status status;

	memset(out, 0, sizeof(*out));
	if (memcmp(in + AT_MAGIC, magic, sizeof(magic)))
		return bb_fail(err, BB_ERR_FORMAT, 1440, where, "it does not begin with %s", magic);
	out->version = bb_get_u32(in + AT_VERSION);
	if (out->version < 1 || out->version > BB_BRICKS_VERSION)
		return bb_fail(err, BB_ERR_FORMAT, 1440, where, "version %u, this program reads 1 to %d", out->version,
			       BB_BRICKS_VERSION);
#ifndef BB_FUZZ
	if (bb_get_u32(in + AT_CRC) != bb_crc32c(0, in, AT_CRC))
		return bb_fail(err, BB_ERR_FORMAT, 1441, where, "the header");
#endif
	status = read_shape(in, where, out, err);
	if (!status)
		status = read_numbers(in, where, out, err);
	if (!status)
		status = read_sections(in, file_bytes, where, out, err);
	return status;
}

void bb_bricks_record_write(const struct bb_bricks_record *r, uint8_t out[BB_BRICKS_INDEX_BYTES])
{
	bb_put_u64(out, r->offset);
	bb_put_u32(out + 8, r->bytes);
	bb_put_u32(out + 12, r->crc);
}

struct bb_bricks_record bb_bricks_record_read(const uint8_t in[BB_BRICKS_INDEX_BYTES])
{
	return (struct bb_bricks_record){ bb_get_u64(in), bb_get_u32(in + 8), bb_get_u32(in + 12) };
}

void bb_bricks_moments_write(const struct bb_bricks_moments *m, uint8_t out[BB_BRICKS_MOMENTS_BYTES])
{
	const float value[7] = { m->mean, m->deviation, m->least, m->most, m->time_dev, m->time_cov, m->leaf_error };

	memset(out, 0, BB_BRICKS_MOMENTS_BYTES);
	for (size_t i = 0; i < 7; i++) {
		uint32_t bits;
		memcpy(&bits, &value[i], 4);
		bb_put_u32(out + 4 * i, bits);
	}
	bb_bricks_record_write(&m->histograms, out + 28);
}

struct bb_bricks_moments bb_bricks_moments_read(const uint8_t in[BB_BRICKS_MOMENTS_BYTES])
{
	float value[7];

	for (size_t i = 0; i < 7; i++) {
		const uint32_t bits = bb_get_u32(in + 4 * i);
		memcpy(&value[i], &bits, 4);
	}
	return (struct bb_bricks_moments){ value[0], value[1], value[2], value[3],
					   value[4], value[5], value[6], bb_bricks_record_read(in + 28) };
}
