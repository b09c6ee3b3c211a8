/*
 * tests/test_bricks_hostile.c: brick files that were cut, damaged or made to mislead. Each row is one file: a sound one
 * with something done to it, its checksums made right again so that what stands behind them is reached (unless the row
 * is about them). It must end in the row's error, when it is opened, or in some bricks or histograms and no others; never
 * in a crash, never in more memory than the file has bytes and 64 MiB more. Every row is printed.
 */
#define _GNU_SOURCE
#include "tests/brick_rig.h"
#include "tests/heap.h"

#include <fcntl.h>
#include <lz4.h>
#include <sys/stat.h>
#include <zstd.h>

#define MOST_RISE (UINT64_C(64) << 20)
#define SOUND 0
#define ROOM (1u << 20)

enum { AT_EXTENT = 80, AT_INDEX = 160, AT_MOMENTS = 184, AT_CRC = BB_BRICKS_HEADER_BYTES - 4 };

/* A file in memory. victim: the brick that rows about bricks change. */
struct image {
	uint8_t bytes[ROOM];
	size_t n;
	uint64_t victim;
};

static struct {
	struct brick_rig rig;
	struct image sound[BB_BRICK_CODECS]; /* 12 x 9 x 10, two steps, bricks of 4^3 and a border: f32 */
	uint8_t *all;                        /* its bricks */
	size_t n_brick;
	uint64_t n_bricks;
	int rows, failed;
} the;

static struct image now; /* the file in hand */

/* ---- changing a file ---- */

static uint64_t section_of(int at, bool size)
{
	return bb_get_u64(now.bytes + at + (size ? 8 : 0));
}

static uint8_t *record_of(bool histograms)
{
	return histograms ? now.bytes + section_of(AT_MOMENTS, false) + now.victim * BB_BRICKS_MOMENTS_BYTES + 28 :
			    now.bytes + section_of(AT_INDEX, false) + now.victim * BB_BRICKS_INDEX_BYTES;
}

/* Every checksum of sections and header as it should be for what is there. */
static void seal(void)
{
	for (int at = AT_INDEX; at <= AT_MOMENTS; at += AT_MOMENTS - AT_INDEX) {
		const uint64_t from = section_of(at, false), n = section_of(at, true);
		if (from <= now.n && n <= now.n - from)
			bb_put_u32(now.bytes + at + 16, bb_crc32c(0, now.bytes + from, n));
	}
	if (now.n >= BB_BRICKS_HEADER_BYTES)
		bb_put_u32(now.bytes + AT_CRC, bb_crc32c(0, now.bytes, AT_CRC));
}

/* Other bytes for the victim's record, behind the file's end, with a right checksum. */
static void replace(bool histograms, const uint8_t *bytes, size_t n)
{
	const struct bb_bricks_record r = { now.n, (uint32_t)n, bb_crc32c(0, bytes, n) };

	assert_true(now.n + n <= sizeof(now.bytes));
	memcpy(now.bytes + now.n, bytes, n);
	now.n += n;
	bb_bricks_record_write(&r, record_of(histograms));
	seal();
}

/* ---- judging it ---- */

struct result {
	int open;               /* error number, 0: it opened */
	int brick, histogram;   /* the first error among them */
	uint64_t n_bricks, n_histograms; /* that failed */
	bool others_differ;     /* a brick that came is not the sound file's */
	uint64_t rise;
};

static void put(const char *path)
{
	const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);

	assert_true(fd >= 0 && write(fd, now.bytes, now.n) == (ssize_t)now.n);
	close(fd);
}

static void read_all(const struct bb_bricks *b, struct result *out)
{
	static struct bb_bricks_want wants[4096];
	static uint8_t bytes[1u << 23];
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
	uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
	struct bb_bricks_reader *r = NULL;

	assert_true(n <= BB_ARRAY_LEN(wants) && n * n_brick <= sizeof(bytes));
	assert_int_equal(bb_bricks_reader_create(b, 64, BB_BRICKS_CACHED, &r, NULL), BB_OK);
	for (uint64_t i = 0; i < n; i++)
		wants[i] = (struct bb_bricks_want){ .brick = i, .out = bytes + i * n_brick };
	(void)bb_bricks_read_many(r, wants, n, NULL);
	for (uint64_t i = 0; i < n; i++) {
		struct bb_error one = { 0 }, err = { 0 };
		uint8_t *alone = bytes + sizeof(bytes) - n_brick;
		out->n_bricks += wants[i].status != BB_OK;
		out->brick = out->brick ? out->brick : wants[i].number;
		if (wants[i].status == BB_OK && the.n_bricks == n && the.n_brick == n_brick)
			out->others_differ |= memcmp(wants[i].out, the.all + i * n_brick, n_brick) != 0;
		assert_int_equal(bb_bricks_read(b, i, alone, &one), wants[i].status); /* one by one it is no other */
		assert_int_equal(one.number, wants[i].number);
		if (bb_bricks_histograms(b, i, h, &err) != BB_OK) {
			out->n_histograms++;
			out->histogram = out->histogram ? out->histogram : err.number;
		}
	}
	bb_bricks_reader_destroy(r);
}

static struct result judge(const char *path)
{
	struct result out = { 0 };
	struct bb_error err = { 0 };
	struct bb_bricks *b;
	const uint64_t begun = heap_begin();
	const enum bb_status status = bb_bricks_open(path, &b, &err);

	out.open = err.number;
	assert_true((status == BB_OK) == (b != NULL) && (status == BB_OK || err.number >= 1000));
	if (b)
		read_all(b, &out);
	bb_bricks_close(b);
	out.rise = heap_rise(begun);
	return out;
}

/* want: of the opening when it is there, else of a brick, else of a histogram; how many of these may fail. */
static void row(const char *name, int want, uint64_t most_failed)
{
	struct stat st;
	char path[200];

	snprintf(path, sizeof(path), "%s/hostile.bricks", the.rig.dir);
	put(path);
	const struct result r = judge(path);
	const int got = r.open ? r.open : r.brick ? r.brick : r.histogram;
	const uint64_t failed = r.n_bricks > r.n_histograms ? r.n_bricks : r.n_histograms;
	assert_int_equal(stat(path, &st), 0);
	const bool good = got == want && (r.open || (failed <= most_failed && (want || !failed))) &&
			  r.rise <= (uint64_t)st.st_size + MOST_RISE && !(want != SOUND && r.others_differ);
	the.rows++;
	the.failed += !good;
	print_message("hostile | %-44s | %s%04d | %-10s %4llu | %6llu KiB%s\n", name, got ? "BB" : "ok", got,
		      r.open	  ? "opening" :
		      r.brick	  ? "bricks" :
		      r.histogram ? "histograms" :
				    "nothing",
		      (unsigned long long)failed, (unsigned long long)r.rise >> 10, good ? "" : "  <-- wrong");
}

static void begin(enum bb_brick_codec codec)
{
	now = the.sound[codec];
	now.victim = 7;
}

/* ---- the header ---- */

struct field {
	const char *name;
	int at, bytes; /* 8 and a value: f64 when `real` says so */
	bool real;
	uint64_t value;
	double number;
	int want;
};

#define U32(name, at, value, want) { name, at, 4, false, value, 0, want }
#define U64(name, at, value, want) { name, at, 8, false, value, 0, want }
#define F64(name, at, number, want) { name, at, 8, true, 0, number, want }

static void set(const struct field *f)
{
	uint64_t bits = f->value;

	if (f->real)
		memcpy(&bits, &f->number, 8);
	if (f->bytes == 4)
		bb_put_u32(now.bytes + f->at, (uint32_t)bits);
	else
		bb_put_u64(now.bytes + f->at, bits);
}

static void every_field_of_the_header(void **state)
{
	const struct field fields[] = {
		U64("magic: nothing", 0, 0, 1440),
		U64("magic: of another file", 0, 0x0a1a0a0d474e5089, 1440),
		U32("version: 0", 8, 0, 1440),
		U32("version: one too many", 8, BB_BRICKS_VERSION + 1, 1440),
		U32("version: largest", 8, UINT32_MAX, 1440),
		U32("x: 0", 16, 0, 1442),
		U32("x: largest", 16, UINT32_MAX, 1442),
		U32("x: one too many", 16, BB_TREE_DIM_MAX + 1, 1442),
		U32("x: a brick more", 16, 13, 1442),
		U32("y: 0", 20, 0, 1442),
		U32("y: below zero", 20, (uint32_t)-9, 1442),
		U32("y: the most there can be", 20, BB_TREE_DIM_MAX, 1442),
		U32("z: 0", 24, 0, 1442),
		U32("z: below zero", 24, (uint32_t)-1, 1442),
		U32("z: a brick less", 24, 8, 1442),
		U32("x: one less, and as many bricks", 16, 11, SOUND),
		U32("steps: 0", 28, 0, 1442),
		U32("steps: 1", 28, 1, 1442),
		U32("steps: 3", 28, 3, 1442),
		U32("steps: one too many", 28, BB_TREE_STEPS_MAX + 1, 1442),
		U32("steps: largest", 28, UINT32_MAX, 1442),
		U32("edge: 0", 32, 0, 1442),
		U32("edge: 2", 32, 2, 1442),
		U32("edge: odd", 32, 5, 1442),
		U32("edge: 6", 32, 6, 1442),
		U32("edge: 64", 32, 64, 1442),
		U32("edge: 66", 32, 66, 1442),
		U32("edge: largest", 32, UINT32_MAX, 1442),
		U32("padding: 3", 36, 3, 1443),
		U32("padding: largest", 36, UINT32_MAX, 1443),
		U32("type: one too many", 40, BB_BRICK_TYPES, 1443),
		U32("type: below zero", 40, (uint32_t)-1, 1443),
		U32("type: u8 of f32 bricks", 40, BB_BRICK_U8, 1445),
		U32("codec: one too many", 44, BB_BRICK_CODECS, 1443),
		U32("codec: below zero", 44, (uint32_t)-1, 1443),
		U32("grid: one too many", 48, BB_BRICK_GRIDS, 1443),
		U32("grid: below zero", 48, (uint32_t)-1, 1443),
		U32("grid: spherical, of no extent", 48, BB_BRICK_SPHERICAL, 1444),
		F64("spacing: 0", 56, 0, 1444),
		F64("spacing: below zero", 64, -1, 1444),
		F64("spacing: NaN", 72, (double)NAN, 1444),
		F64("spacing: infinite", 56, (double)INFINITY, 1444),
		F64("spacing: too small", 56, 9e-7, 1444),
		F64("spacing: too large", 56, 1.1e6, 1444),
		F64("extent: NaN", AT_EXTENT, (double)NAN, 1444),
		F64("extent: infinite", AT_EXTENT + 8, (double)-INFINITY, 1444),
		F64("extent: too large", AT_EXTENT + 40, 1e13, 1444),
		F64("least: NaN", 128, (double)NAN, 1444),
		F64("least: infinite", 128, (double)-INFINITY, 1444),
		F64("least: above most", 128, 1e6, 1444),
		F64("most: NaN", 136, (double)NAN, 1444),
		F64("most: infinite", 136, (double)INFINITY, 1444),
		F64("most: below least", 136, -1e6, 1444),
		F64("least: the range is infinite", 128, -1.7e308, SOUND),
		U64("not finite voxels: largest", 144, UINT64_MAX, SOUND),
		U64("bricks: 0", 152, 0, 1442),
		U64("bricks: one less", 152, 0, 1442),
		U64("bricks: one more", 152, 0, 1442),
		U64("bricks: largest", 152, UINT64_MAX, 1442),
		U64("index: at 0", 160, 0, 1445),
		U64("index: in the header", 160, 4095, 1445),
		U64("index: at the end", 160, 0, 1445),
		U64("index: far beyond", 160, UINT64_MAX, 1445),
		U64("index: of no bytes", 168, 0, 1445),
		U64("index: of a record less", 168, 0, 1445),
		U64("index: of a record more", 168, 0, 1445),
		U64("index: of all bytes there are", 168, UINT64_MAX, 1445),
		U64("moments: at 0", 184, 0, 1445),
		U64("moments: one byte too far", 184, 0, 1445),
		U64("moments: far beyond", 184, UINT64_MAX - 15, 1445),
		U64("moments: of no bytes", 192, 0, 1445),
		U64("moments: of a record less", 192, 0, 1445),
		U64("moments: of all bytes there are", 192, UINT64_MAX, 1445),
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(fields); i++) {
		struct field f = fields[i];
		begin(BB_BRICK_PLAIN);
		/* What the sound file has, a little beside it. */
		const uint64_t index = section_of(AT_INDEX, true), moments = section_of(AT_MOMENTS, true);
		if (f.at == 152 && !f.value && i % 3)
			f.value = the.n_bricks + (strstr(f.name, "more") ? 1 : (uint64_t)-1);
		if (strstr(f.name, "a record"))
			f.value = (f.at == 168 ? index : moments) + (strstr(f.name, "more") ? 16 : (uint64_t)-16);
		if (strstr(f.name, "at the end"))
			f.value = now.n;
		if (strstr(f.name, "one byte too far"))
			f.value = section_of(AT_MOMENTS, false) + 1;
		set(&f);
		if (strstr(f.name, "range is infinite")) { /* both ends are finite, their distance is not */
			set(&(struct field)F64("", 136, 1.7e308, 0));
			f.want = 1444;
		}
		seal();
		row(f.name, f.want, 0);
	}
}

/* Two fields at once, each of them possible. */
static void fields_that_do_not_belong_together(void **state)
{
	static const struct {
		const char *name;
		enum bb_brick_codec from, to;
		uint32_t type, pad;
		int want;
	} rows[] = {
		/* Of a file with a codec they are those that did not pack. */
		{ "plain bricks said to be lz4", BB_BRICK_PLAIN, BB_BRICK_LZ4, BB_BRICK_F32, 1, SOUND },
		{ "plain bricks said to be zstd", BB_BRICK_PLAIN, BB_BRICK_ZSTD, BB_BRICK_F32, 1, SOUND },
		{ "plain bricks said to be lz4, and larger", BB_BRICK_PLAIN, BB_BRICK_LZ4, BB_BRICK_F32, 2, 1450 },
		{ "lz4 bricks said to be zstd", BB_BRICK_LZ4, BB_BRICK_ZSTD, BB_BRICK_F32, 1, 1450 },
		{ "zstd bricks said to be lz4", BB_BRICK_ZSTD, BB_BRICK_LZ4, BB_BRICK_F32, 1, 1450 },
		{ "zstd bricks said to be smaller", BB_BRICK_ZSTD, BB_BRICK_ZSTD, BB_BRICK_F32, 0, 1445 },
		{ "zstd bricks said to be larger", BB_BRICK_ZSTD, BB_BRICK_ZSTD, BB_BRICK_F32, 2, 1450 },
		{ "lz4 bricks said to be larger", BB_BRICK_LZ4, BB_BRICK_LZ4, BB_BRICK_F32, 2, 1450 },
		{ "plain bricks said to be larger", BB_BRICK_PLAIN, BB_BRICK_PLAIN, BB_BRICK_F32, 2, 1450 },
		{ "plain bricks said to be smaller", BB_BRICK_PLAIN, BB_BRICK_PLAIN, BB_BRICK_F32, 0, 1445 },
		{ "f32 said to be u16, and larger", BB_BRICK_PLAIN, BB_BRICK_PLAIN, BB_BRICK_U16, 2, 1450 },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		begin(rows[i].from);
		bb_put_u32(now.bytes + 44, (uint32_t)rows[i].to);
		bb_put_u32(now.bytes + 40, rows[i].type);
		bb_put_u32(now.bytes + 36, rows[i].pad);
		seal();
		row(rows[i].name, rows[i].want, the.n_bricks);
	}
	begin(BB_BRICK_PLAIN);
	bb_put_u32(now.bytes + 48, BB_BRICK_SPHERICAL);
	for (int k = 0; k < 6; k++) /* from 6 down to 1 */
		set(&(struct field)F64("", AT_EXTENT + 8 * k, 6 - k, 0));
	seal();
	row("spherical, its extents turned round", 1444, 0);
	begin(BB_BRICK_PLAIN);
	memset(now.bytes + 256, 0x1b, 64);
	seal();
	row("name: escapes for a terminal", SOUND, 0);
}

static void sections_that_overlap(void **state)
{
	(void)state;

	begin(BB_BRICK_PLAIN);
	bb_put_u64(now.bytes + AT_INDEX, section_of(AT_MOMENTS, false));
	seal();
	row("the index is the moments' beginning", 1451, 0);
	begin(BB_BRICK_PLAIN);
	bb_put_u64(now.bytes + AT_INDEX, section_of(AT_MOMENTS, false) + section_of(AT_MOMENTS, true) -
						 section_of(AT_INDEX, true));
	seal();
	row("the index is the moments' end", 1451, 0);
	begin(BB_BRICK_PLAIN);
	bb_put_u64(now.bytes + AT_MOMENTS, section_of(AT_INDEX, false) + 1);
	now.n += 64;
	seal();
	row("the moments begin in the index", 1451, 0);
	begin(BB_BRICK_PLAIN);
	bb_put_u64(now.bytes + AT_INDEX, 4096);
	seal();
	row("the index is the first bricks", 1445, 0);
	begin(BB_BRICK_PLAIN);
	bb_put_u64(now.bytes + AT_MOMENTS, 4096);
	seal();
	row("the moments are the first bricks", 1445, 0);
	begin(BB_BRICK_PLAIN);
	const uint64_t index = section_of(AT_INDEX, false), moments = section_of(AT_MOMENTS, false);
	bb_put_u64(now.bytes + AT_INDEX, moments);
	bb_put_u64(now.bytes + AT_MOMENTS, index);
	seal();
	row("index and moments changed places", 1451, 0);
}

/* ---- what is missing, what is damaged ---- */

static void files_cut_at_every_boundary(void **state)
{
	begin(BB_BRICK_PLAIN);
	const uint64_t index = section_of(AT_INDEX, false), moments = section_of(AT_MOMENTS, false);
	const struct {
		const char *name;
		size_t n;
		int want;
	} cuts[] = {
		{ "cut: nothing is left", 0, 1440 },
		{ "cut: a byte is left", 1, 1440 },
		{ "cut: in the header", 2048, 1440 },
		{ "cut: a byte before the header's end", 4095, 1440 },
		{ "cut: behind the header", 4096, 1445 },
		{ "cut: in the first brick", 4100, 1445 },
		{ "cut: in the middle of the bricks", (4096 + index) / 2, 1445 },
		{ "cut: a byte before the index", index - 1, 1445 },
		{ "cut: before the index", index, 1445 },
		{ "cut: in the index", index + 17, 1445 },
		{ "cut: before the moments", moments, 1445 },
		{ "cut: in the moments", moments + 1000, 1445 },
		{ "cut: by the last byte", the.sound[0].n - 1, 1445 },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(cuts); i++) {
		begin(BB_BRICK_PLAIN);
		now.n = cuts[i].n;
		row(cuts[i].name, cuts[i].want, 0);
	}
	begin(BB_BRICK_PLAIN);
	now.n += 5000;
	row("longer than it was", SOUND, 0);
}

static void bits_that_turned(void **state)
{
	static const char *const codecs[] = { "bit of a plain brick", "bit of an lz4 brick", "bit of a zstd brick" };
	(void)state;

	for (int c = 0; c < BB_BRICK_CODECS; c++) {
		begin((enum bb_brick_codec)c);
		const struct bb_bricks_record r = bb_bricks_record_read(record_of(false));
		now.bytes[r.offset + r.bytes / 2] ^= 1;
		row(codecs[c], 1441, 1);
	}
	begin(BB_BRICK_PLAIN);
	now.bytes[bb_bricks_record_read(record_of(true)).offset] ^= 0x80;
	row("bit of a histogram", 1441, 1);
	begin(BB_BRICK_PLAIN);
	now.bytes[section_of(AT_INDEX, false) + 12] ^= 4; /* a brick's checksum */
	row("bit of the index", 1441, 0);
	begin(BB_BRICK_PLAIN);
	now.bytes[section_of(AT_MOMENTS, false) + 1] ^= 4;
	row("bit of the moments", 1441, 0);
	begin(BB_BRICK_PLAIN);
	now.bytes[500] ^= 0x10;
	row("bit of the header where nothing is", 1441, 0);
	begin(BB_BRICK_PLAIN);
	now.bytes[AT_CRC] ^= 1;
	row("bit of the header's checksum", 1441, 0);
	begin(BB_BRICK_PLAIN);
	now.bytes[record_of(false) - now.bytes + 12] ^= 4;
	seal();
	row("a brick's checksum, all others right", 1441, 1);
	begin(BB_BRICK_PLAIN);
	memset(now.bytes + BB_BRICKS_HEADER_BYTES, 0, now.n - BB_BRICKS_HEADER_BYTES);
	seal();
	row("a hole where all the bricks were", 1445, 0);
}

/* ---- records ---- */

static void records_that_lie(void **state)
{
	begin(BB_BRICK_PLAIN);
	const struct bb_bricks_record b = bb_bricks_record_read(record_of(false)), h = bb_bricks_record_read(record_of(true));
	const struct {
		const char *name;
		bool histograms;
		struct bb_bricks_record r;
		int want;
	} rows[] = {
		{ "brick: in the header", false, { 4095, b.bytes, b.crc }, 1445 },
		{ "brick: a byte over the end", false, { now.n - b.bytes + 1, b.bytes, b.crc }, 1445 },
		{ "brick: its end wraps round", false, { UINT64_MAX - 8, b.bytes, b.crc }, 1445 },
		{ "brick: of no bytes", false, { b.offset, 0, 0 }, 1450 },
		{ "brick: a byte short", false, { b.offset, b.bytes - 1, b.crc }, 1450 },
		{ "brick: a byte long", false, { b.offset, b.bytes + 1, b.crc }, 1445 },
		{ "brick: of 4 GiB", false, { b.offset, UINT32_MAX, b.crc }, 1445 },
		{ "brick: a byte aside", false, { b.offset + 1, b.bytes, b.crc }, 1441 },
		{ "brick: in the index", false, { section_of(AT_INDEX, false), b.bytes, b.crc }, 1441 },
		{ "histograms: in the header", true, { 0, h.bytes, h.crc }, 1445 },
		{ "histograms: of no bytes", true, { h.offset, 0, 0 }, 1450 },
		{ "histograms: a byte short", true, { h.offset, h.bytes - 1, h.crc }, 1441 },
		{ "histograms: larger than any", true, { h.offset, BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST + 1, h.crc }, 1445 },
		{ "histograms: its end wraps round", true, { UINT64_MAX, h.bytes, h.crc }, 1445 },
		{ "histograms: of 4 GiB", true, { h.offset, UINT32_MAX, h.crc }, 1445 },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		begin(BB_BRICK_PLAIN);
		bb_bricks_record_write(&rows[i].r, record_of(rows[i].histograms));
		seal();
		row(rows[i].name, rows[i].want, 1);
	}
	begin(BB_BRICK_LZ4);
	const struct bb_bricks_record r = bb_bricks_record_read(record_of(false));
	for (uint64_t i = 0; i < the.n_bricks; i++) /* a whole file in one brick's bytes: the records overlap */
		bb_bricks_record_write(&r, now.bytes + section_of(AT_INDEX, false) + i * BB_BRICKS_INDEX_BYTES);
	seal();
	row("all bricks are one", SOUND, 0);
}

static void statistics_that_cannot_be(void **state)
{
	static const struct {
		const char *name;
		size_t at;
		float value;
	} rows[] = {
		{ "mean: NaN", 0, NAN },           { "mean: infinite", 0, INFINITY },
		{ "deviation: NaN", 4, NAN },      { "deviation: below zero", 4, -1 },
		{ "least: NaN", 8, NAN },          { "least: above most", 8, 1e9f },
		{ "most: infinite", 12, INFINITY }, { "most: below least", 12, -1e9f },
		{ "change over time: NaN", 16, NAN }, { "change over time: infinite", 20, INFINITY },
		{ "error: below zero", 24, -1e-3f }, { "error: NaN", 24, NAN },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		uint32_t bits;
		begin(BB_BRICK_PLAIN);
		memcpy(&bits, &rows[i].value, 4);
		bb_put_u32(record_of(true) - 28 + rows[i].at, bits);
		seal();
		row(rows[i].name, 1454, 0);
	}
}

/* ---- codes ---- */

static void histograms_that_lie(void **state)
{
	static const struct {
		const char *name;
		uint8_t bytes[12];
		size_t n;
		int want;
	} rows[] = {
		{ "codes: four flat ones", { 191, 191, 191, 191 }, 4, SOUND },
		{ "codes: three of four", { 191, 191, 191 }, 3, 1450 },
		{ "codes: a run beyond the last bin", { 63, 191, 191, 191, 191 }, 5, 1450 },
		{ "codes: a token there is not", { 193, 191, 191, 191, 191 }, 5, 1450 },
		{ "codes: the highest byte", { 255, 255, 255, 255 }, 4, 1450 },
		{ "codes: a wide one cut", { 191, 191, 191, 190, 192, 1 }, 6, 1450 },
		{ "codes: a wide one that wraps", { 192, 255, 255, 190, 191, 191, 191 }, 7, SOUND },
		{ "codes: bytes behind the fourth", { 191, 191, 191, 191, 7, 7 }, 6, SOUND },
		{ "codes: one bin too few", { 191, 191, 191, 190 }, 4, 1450 },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		begin(BB_BRICK_PLAIN);
		replace(true, rows[i].bytes, rows[i].n);
		row(rows[i].name, rows[i].want, 1);
	}
}

/* Of n_raw bytes of nothing; cut to less than a brick's own bytes, which are taken as they are. */
static size_t bomb(enum bb_brick_codec codec, size_t n_raw, uint8_t *out, size_t cap)
{
	static uint8_t packed[1 << 20];
	uint8_t *raw = calloc(1, n_raw);

	assert_non_null(raw);
	const size_t n = codec == BB_BRICK_LZ4 ? (size_t)LZ4_compress_default((const char *)raw, (char *)packed, (int)n_raw,
									      sizeof(packed)) :
						 ZSTD_compress(packed, sizeof(packed), raw, n_raw, 19);
	free(raw);
	assert_true(n > 0 && n <= sizeof(packed));
	const size_t kept = n < cap ? n : cap - 1;
	memcpy(out, packed, kept);
	return kept;
}

static void packed_bricks_that_lie(void **state)
{
	static const char *const names[][5] = {
		{ "lz4: more than a brick", "lz4: a byte more", "lz4: a byte less", "lz4: half a brick", "lz4: a bomb" },
		{ "zstd: more than a brick", "zstd: a byte more", "zstd: a byte less", "zstd: half a brick", "zstd: a bomb" },
	};
	static const struct {
		const char *name;
		enum bb_brick_codec codec;
		uint8_t bytes[40];
		size_t n;
	} rows[] = {
		{ "lz4: a match before the beginning", BB_BRICK_LZ4, { 0x0f, 0x01, 0x00, 0xff, 0xff, 0x00 }, 6 },
		{ "lz4: a match of offset 0", BB_BRICK_LZ4, { 0x4f, 1, 2, 3, 4, 0, 0, 0xff, 0xff, 0 }, 10 },
		{ "lz4: a length without an end", BB_BRICK_LZ4,
		  { 0xf0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff }, 11 },
		{ "lz4: literals that are not there", BB_BRICK_LZ4, { 0xf0, 0xff, 0xff, 0xff, 0x10, 1, 2, 3 }, 8 },
		{ "zstd: another magic", BB_BRICK_ZSTD, { 0x28, 0xb5, 0x2f, 0xfc, 0, 0, 0 }, 7 },
		{ "zstd: says it is 16 EiB", BB_BRICK_ZSTD,
		  { 0x28, 0xb5, 0x2f, 0xfd, 0xe0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 0, 0 }, 16 },
		{ "zstd: a window of 2 TiB", BB_BRICK_ZSTD, { 0x28, 0xb5, 0x2f, 0xfd, 0x00, 0xff, 1, 0, 0 }, 9 },
		{ "zstd: a dictionary nobody has", BB_BRICK_ZSTD,
		  { 0x28, 0xb5, 0x2f, 0xfd, 0x23, 1, 2, 3, 4, 8, 1, 0, 0 }, 13 },
		{ "zstd: a reserved block", BB_BRICK_ZSTD, { 0x28, 0xb5, 0x2f, 0xfd, 0x20, 8, 7, 0, 0, 1 }, 10 },
		{ "zstd: a block of 2 MiB of one byte", BB_BRICK_ZSTD,
		  { 0x28, 0xb5, 0x2f, 0xfd, 0x20, 8, 0xfb, 0xff, 0xff, 0x55 }, 10 },
		{ "zstd: only a frame to skip", BB_BRICK_ZSTD, { 0x50, 0x2a, 0x4d, 0x18, 0, 0, 0, 0 }, 8 },
		{ "zstd: a frame to skip of 4 GiB", BB_BRICK_ZSTD, { 0x50, 0x2a, 0x4d, 0x18, 0xff, 0xff, 0xff, 0xff }, 8 },
	};
	uint8_t bytes[2048];
	(void)state;

	for (int c = BB_BRICK_LZ4; c <= BB_BRICK_ZSTD; c++) {
		const size_t n = the.n_brick, raw[] = { 2 * n, n + 1, n - 1, n / 2, 100u << 20 };
		for (size_t i = 0; i < BB_ARRAY_LEN(raw); i++) {
			begin((enum bb_brick_codec)c);
			replace(false, bytes, bomb((enum bb_brick_codec)c, raw[i], bytes, n));
			row(names[c - 1][i], 1450, 1);
		}
	}
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		begin(rows[i].codec);
		replace(false, rows[i].bytes, rows[i].n);
		row(rows[i].name, 1450, 1);
	}
}

/* ---- while it is open ---- */

static void files_that_change_while_open(void **state)
{
	static const struct {
		const char *name;
		int64_t by;
		int want;
	} rows[] = {
		{ "open, then cut to its header", -1000000, 1406 }, { "open, then cut to nothing", -2000000, 1406 },
		{ "open, then grown", 70000, SOUND },
	};
	char path[200];
	(void)state;

	snprintf(path, sizeof(path), "%s/changing.bricks", the.rig.dir);
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		struct result r = { 0 };
		struct bb_bricks *b;
		begin(BB_BRICK_PLAIN);
		put(path);
		const uint64_t begun = heap_begin();
		assert_int_equal(bb_bricks_open(path, &b, NULL), BB_OK);
		const int64_t n = rows[i].by > 0 ? (int64_t)now.n + rows[i].by : rows[i].by == -1000000 ? 4096 : 0;
		assert_int_equal(truncate(path, (off_t)n), 0);
		read_all(b, &r);
		bb_bricks_close(b);
		const bool good = r.brick == rows[i].want && r.histogram == rows[i].want &&
				  r.n_bricks == (rows[i].want ? the.n_bricks : 0) &&
				  heap_rise(begun) <= now.n + MOST_RISE;
		the.rows++;
		the.failed += !good;
		print_message("hostile | %-44s | %s%04d | %-10s %4llu | %6llu KiB%s\n", rows[i].name,
			      r.brick ? "BB" : "ok", r.brick, r.brick ? "bricks" : "nothing",
			      (unsigned long long)r.n_bricks, (unsigned long long)heap_rise(begun) >> 10,
			      good ? "" : "  <-- wrong");
	}
}

/* A file of holes whose header asks for as many bricks as there can be: what it says is looked at before it is believed,
 * and its 128 GiB are not taken. */
static void a_large_file_of_nothing(void **state)
{
	const uint64_t n_bricks = (UINT64_C(1) << 30) + 1, n = n_bricks * (16 + 48) + BB_BRICKS_HEADER_BYTES;
	struct bb_error err = { 0 };
	struct bb_bricks *b;
	char path[200];
	(void)state;

	begin(BB_BRICK_PLAIN);
	now.n = BB_BRICKS_HEADER_BYTES;
	bb_put_u32(now.bytes + 16, 4096);
	bb_put_u32(now.bytes + 20, 4096);
	bb_put_u32(now.bytes + 24, 4096);
	bb_put_u64(now.bytes + 152, n_bricks);
	seal();
	snprintf(path, sizeof(path), "%s/holes.bricks", the.rig.dir);
	put(path);
	if (truncate(path, (off_t)n)) {
		print_message("hostile | a file of holes: not on this file system\n");
		return;
	}
	const uint64_t begun = heap_begin();
	assert_int_equal(bb_bricks_open(path, &b, &err), BB_ERR_FORMAT);
	assert_int_equal(err.number, 1442);
	assert_true(heap_rise(begun) < MOST_RISE);
	the.rows++;
	print_message("hostile | %-44s | BB%04d | %-10s %4d | %6llu KiB\n", "64 GiB of holes, 2^30 bricks", err.number,
		      "opening", 0, (unsigned long long)heap_rise(begun) >> 10);
}

static void there_were_enough(void **state)
{
	(void)state;

	print_message("hostile | %d files, %d not as they should be; memory %s\n", the.rows, the.failed,
		      HEAP_COUNTED ? "counted" : "not counted under a sanitizer");
	assert_int_equal(the.failed, 0);
	assert_true(the.rows >= 60);
}

static int set_up(void **state)
{
	(void)state;

	rig_begin(&the.rig, 12, 9, 10, 2, 4);
	for (int c = 0; c < BB_BRICK_CODECS; c++) {
		the.rig.config.codec = (enum bb_brick_codec)c;
		struct bb_bricks *b = rig_build(&the.rig);
		FILE *f = fopen(the.rig.result, "rb");
		assert_non_null(f);
		the.sound[c].n = fread(the.sound[c].bytes, 1, ROOM, f);
		fclose(f);
		assert_true(the.sound[c].n > BB_BRICKS_HEADER_BYTES && the.sound[c].n < ROOM / 2);
		if (!c) {
			the.n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
			the.n_bricks = bb_bricks_header(b)->tree.n_bricks;
			the.all = malloc(the.n_brick * the.n_bricks);
			for (uint64_t i = 0; i < the.n_bricks; i++)
				assert_int_equal(bb_bricks_read(b, i, the.all + i * the.n_brick, NULL), BB_OK);
		}
		bb_bricks_close(b);
	}
	return 0;
}

static int tear_down(void **state)
{
	(void)state;

	free(the.all);
	rig_end(&the.rig);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_field_of_the_header),
		cmocka_unit_test(fields_that_do_not_belong_together),
		cmocka_unit_test(sections_that_overlap),
		cmocka_unit_test(files_cut_at_every_boundary),
		cmocka_unit_test(bits_that_turned),
		cmocka_unit_test(records_that_lie),
		cmocka_unit_test(statistics_that_cannot_be),
		cmocka_unit_test(histograms_that_lie),
		cmocka_unit_test(packed_bricks_that_lie),
		cmocka_unit_test(files_that_change_while_open),
		cmocka_unit_test(a_large_file_of_nothing),
		cmocka_unit_test(there_were_enough),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
