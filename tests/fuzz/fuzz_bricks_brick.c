/*
 * tests/fuzz/fuzz_bricks_brick.c: any bytes as bricks of all codecs and as coded histograms, read in a batch, one at a
 * time and past the page cache. Index and moments are what opening a file lets through; the file is in memory: the
 * functions of render/bricks/bricks_file.c stand here for that.
 *
 * First byte: codec, type, padding, whether the reads are direct, and whether direct ones are refused. Second: what the disk does. Then for each of three
 * bricks: where it lies, its bytes, where its histograms lie, their bytes; two bytes each. Then a byte each for six
 * wants. What follows is the file behind its header.
 */
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>

#include "render/bricks/bricks_private.h"
#include "render/bricks/crc32c.h"
#include "render/bricks/values.h"
#include "tests/fuzz/fuzz.h"

#define BRICKS 3 /* of two steps of 4^3 */
#define WANTS 6
#define FILE_MOST (BB_BRICKS_HEADER_BYTES + 4096)

/* One for each codec, type and padding; made when it is first met. */
struct stand {
	struct bb_bricks file;
	struct bb_bricks_record index[BRICKS];
	struct bb_bricks_moments moments[BRICKS];
	struct bb_bricks_reader *reader[2]; /* cached, direct */
	size_t n_brick;
	uint8_t *out[WANTS], *alone;
};

/* ---- a disk ---- */

enum mood { /* bits */
	CUT = 1,       /* the file has become shorter */
	BAD = 2,       /* its second half cannot be read */
	BREAKS = 4,    /* a signal comes during the first read */
	SMALL = 8,     /* reads give less than was asked for */
	COLD = 16,     /* nothing is in the page cache, */
	HALF_COLD = 32, /* only the first half of what is asked for is, */
	CANNOT = 64,   /* or it cannot be asked; */
	FULL = 128,    /* no reads can be under way */
};

static struct {
	const uint8_t *body;
	uint64_t n; /* the header included */
	unsigned mood;
	bool broke;
	int plain_fd;
	unsigned direct_left; /* direct reads before they are refused */
} disk;

ssize_t bb_bricks_file_read(int fd, void *buf, size_t n, uint64_t at)
{
	if (fd != disk.plain_fd && !disk.direct_left) {
		errno = EINVAL;
		return -1;
	}
	disk.direct_left -= fd != disk.plain_fd;
	if (disk.mood & BREAKS && !disk.broke) {
		disk.broke = true;
		errno = EINTR;
		return -1;
	}
	if (disk.mood & BAD && at + n > BB_BRICKS_HEADER_BYTES + (disk.n - BB_BRICKS_HEADER_BYTES) / 2) {
		errno = EIO;
		return -1;
	}
	if (at >= disk.n || !n)
		return 0;
	n = n < disk.n - at ? n : disk.n - at;
	if (disk.mood & SMALL && n > 8 && at % 4096)
		n = (n + 1) / 2;
	memset(buf, 0, n); /* what is read of the header's page is nobody's */
	const uint64_t from = at > BB_BRICKS_HEADER_BYTES ? at : BB_BRICKS_HEADER_BYTES;
	if (from < at + n)
		memcpy((uint8_t *)buf + (from - at), disk.body + (from - BB_BRICKS_HEADER_BYTES), at + n - from);
	return (ssize_t)n;
}

ssize_t bb_bricks_file_peek(int fd, void *buf, size_t n, uint64_t at)
{
	if (disk.mood & (COLD | CANNOT)) {
		errno = disk.mood & COLD ? EAGAIN : EOPNOTSUPP;
		return -1;
	}
	return bb_bricks_file_read(fd, buf, disk.mood & HALF_COLD ? n / 2 : n, at);
}

int bb_bricks_file_cached(int fd, size_t n, uint64_t at)
{
	(void)fd;
	fuzz_must(at >= BB_BRICKS_HEADER_BYTES && n <= FILE_MOST);
	return disk.mood & CANNOT ? -1 : disk.mood & COLD ? 0 : 1; /* half of it is a lie: some of it has gone since */
}

/* Reads under way are over at once, and are heard of from the last to the first. */
static struct {
	uint64_t tag;
	int64_t got;
} over[64];
static size_t n_over;

bool bb_bricks_file_queue(unsigned depth, unsigned long *queue)
{
	*queue = 1;
	return depth <= 64;
}

void bb_bricks_file_unqueue(unsigned long queue)
{
	fuzz_must(queue == 1 && !n_over);
}

bool bb_bricks_file_begin(unsigned long queue, int fd, void *buf, size_t n, uint64_t at, uint64_t tag)
{
	fuzz_must(queue == 1 && n_over < 64 && at % 4096 == 0 && n % 4096 == 0);
	if (disk.mood & FULL)
		return false;
	over[n_over].tag = tag;
	over[n_over++].got = bb_bricks_file_read(fd, buf, n, at);
	return true;
}

uint64_t bb_bricks_file_end(unsigned long queue, int64_t *got)
{
	fuzz_must(queue == 1 && n_over > 0);
	*got = over[--n_over].got;
	return over[n_over].tag;
}

/* ---- bricks ---- */

static struct stand *stand_of(unsigned kind)
{
	static struct stand stands[BB_BRICK_CODECS][BB_BRICK_TYPES][BB_BRICKS_PAD_MOST + 1];
	const unsigned codec = kind % BB_BRICK_CODECS, type = kind / 3 % BB_BRICK_TYPES,
		       pad = kind / 12 % (BB_BRICKS_PAD_MOST + 1);
	struct stand *s = &stands[codec][type][pad];
	struct bb_bricks_header *h = &s->file.h;

	if (s->alone)
		return s;
	fuzz_must(bb_tree_init(&h->tree, (const uint32_t[3]){ 4, 4, 4 }, 2, 4) && h->tree.n_bricks == BRICKS);
	h->codec = (enum bb_brick_codec)codec;
	h->type = (enum bb_brick_type)type;
	h->pad = pad;
	h->most = 1;
	h->version = BB_BRICKS_VERSION;
	s->file.fd = open("/proc/self/exe", O_RDONLY | O_CLOEXEC); /* any file will do */
	s->file.index = s->index;
	s->file.moments = s->moments;
	s->file.file_bytes = FILE_MOST;
	s->n_brick = bb_bricks_brick_bytes(h);
	for (int i = 0; i < WANTS; i++)
		s->out[i] = malloc(s->n_brick); /* exactly: an overrun is seen */
	s->alone = malloc(s->n_brick);
	disk.mood = 0;
	disk.plain_fd = s->file.fd;
	fuzz_must(bb_bricks_reader_create(&s->file, 4, BB_BRICKS_CACHED, &s->reader[0], NULL) == BB_OK);
	if (bb_bricks_reader_create(&s->file, WANTS, BB_BRICKS_DIRECT, &s->reader[1], NULL) != BB_OK)
		s->reader[1] = s->reader[0];
	return s;
}

static unsigned word(struct fuzz_input *in)
{
	const unsigned low = fuzz_byte(in);

	return low | (unsigned)fuzz_byte(in) << 8;
}

/* Somewhere in the file, and no larger than `most`, as it was when the file was opened. */
static struct bb_bricks_record record_in(struct fuzz_input *in, uint64_t file_bytes, size_t most)
{
	const uint64_t body = file_bytes - BB_BRICKS_HEADER_BYTES, at = word(in) % (body + 1);
	uint64_t n = word(in) % (most + 1);

	n = n < body - at ? n : body - at;
	return (struct bb_bricks_record){ BB_BRICKS_HEADER_BYTES + at, (uint32_t)n, 0 };
}

static void read_bricks(struct stand *s, const uint8_t *which, struct bb_bricks_reader *reader)
{
	struct bb_bricks_want wants[WANTS];

	disk.broke = false;
	for (int i = 0; i < WANTS; i++)
		wants[i] = (struct bb_bricks_want){ .brick = which[i] % (BRICKS + 1u), .out = s->out[i] };
	const enum bb_status status = bb_bricks_read_many(reader, wants, WANTS, NULL);
	for (int i = 0; i < WANTS; i++) {
		fuzz_must((wants[i].status == BB_OK) == (wants[i].number == 0));
		fuzz_must(status != BB_OK || wants[i].status == BB_OK);
		/* Alone zstd makes a context each time; and a direct read of good bytes takes bad ones with it. */
		if (s->file.h.codec == BB_BRICK_ZSTD || disk.mood & BAD)
			continue;
		fuzz_must(bb_bricks_read(&s->file, wants[i].brick, s->alone, NULL) == wants[i].status);
		fuzz_must(wants[i].status != BB_OK || !memcmp(s->alone, wants[i].out, s->n_brick));
	}
}

/* A reader remembers it for good, so each such input has its own. */
static void read_refused(struct stand *s, const uint8_t *which, unsigned direct_left)
{
	const unsigned mood = disk.mood;
	struct bb_bricks_reader *reader;

	disk.mood = 0;
	fuzz_must(bb_bricks_reader_create(&s->file, WANTS, BB_BRICKS_CACHED, &reader, NULL) == BB_OK);
	disk.mood = mood;
	disk.direct_left = direct_left;
	read_bricks(s, which, reader);
	bb_bricks_reader_destroy(reader);
}

static void read_histograms(struct stand *s)
{
	uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];

	for (uint64_t i = 0; i <= BRICKS; i++)
		fuzz_must((bb_bricks_histograms(&s->file, i, h, NULL) == BB_ERR_USAGE) == (i == BRICKS));
}

/* The same bytes with no slack around them. */
static void decode(struct stand *s, const uint8_t *body, size_t n)
{
	static uint16_t one[BB_STATS_BINS];
	const struct bb_unpacker none = { BB_BRICK_LZ4, NULL };

	const size_t used = bb_histogram_decode(fuzz_exact(body, n), n, one);
	fuzz_must(used <= n);
	if (used) { /* what it says can be said again */
		uint8_t again[BB_HISTOGRAM_CODED_MOST];
		uint16_t same[BB_STATS_BINS];
		const size_t m = bb_histogram_encode(one, again);
		fuzz_must(m <= sizeof(again) && bb_histogram_decode(again, m, same) == m && !memcmp(one, same, sizeof(one)));
	}
	(void)bb_values_unpack(&none, fuzz_exact(body, n), n, s->alone, s->n_brick);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct fuzz_input in = { data, size };
	const uint8_t kind = fuzz_byte(&in), mood = fuzz_byte(&in), refusing = kind / 72; /* 1: at once; 2: after a while */
	struct stand *s = stand_of(kind % 36);
	const size_t head = 8 * BRICKS + WANTS, n_body = in.left > head ? in.left - head : 0;
	const uint64_t file_bytes = BB_BRICKS_HEADER_BYTES + n_body;
	const size_t cap = bb_values_packed_cap(s->file.h.codec, s->n_brick);
	uint8_t which[WANTS];

	if (file_bytes > FILE_MOST)
		return 0;
	for (int i = 0; i < BRICKS; i++) {
		s->index[i] = record_in(&in, file_bytes, cap);
		s->moments[i].histograms = record_in(&in, file_bytes, BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST);
	}
	for (int i = 0; i < WANTS; i++)
		which[i] = fuzz_byte(&in);
	disk.body = in.at;
	disk.n = file_bytes - (mood & CUT ? n_body / 3 : 0);
	disk.mood = mood;
	disk.plain_fd = s->file.fd;
	disk.direct_left = UINT_MAX;
	if (refusing == 1 || refusing == 2)
		read_refused(s, which, refusing - 1);
	else
		read_bricks(s, which, s->reader[kind / 36 % 2]);
	disk.direct_left = UINT_MAX;
	read_histograms(s);
	decode(s, in.at, n_body);
	return 0;
}
