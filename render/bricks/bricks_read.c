/*
 * render/bricks/bricks_read.c: a batch of bricks. Wants are put in the file's order, neighbours become one read, and
 * each read goes to a staging memory that stays in the second cache; from there a plain brick is copied to its place
 * past the caches while its CRC is made, and a packed one is unpacked. Reading straight into the slots was slower: the
 * kernel's copy has to fetch every line of the slot first.
 */
#define _GNU_SOURCE /* O_DIRECT */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "render/bricks/bricks_private.h"
#include "render/bricks/crc32c.h"
#include "render/bricks/values.h"

#ifdef BB_FUZZ
#define PIECE_CACHED_BYTES 1024u /* so that small bricks can be large ones */
#define PIECE_DIRECT_BYTES 1024u
#else
#define PIECE_CACHED_BYTES (256u << 10) /* of one read: the staging memory stays in the second cache */
#define PIECE_DIRECT_BYTES (1u << 20)   /* a disk waits longer for each read than for its bytes */
#endif
#define HUGE_BYTES (2u << 20)
#define BOUNCE_BYTES (64u << 10) /* up to which unpacking in the caches and copying on is faster than unpacking in place */
#define PAGE_BYTES 4096u             /* what direct reads are multiples of */
#define GAP_CACHED_BYTES (8u << 10)  /* unwanted bytes that cost less than a system call */
#define GAP_DIRECT_BYTES (32u << 10) /* and less than one more access to the disk */
#define PROBE_EVERY 8 /* runs; of these the first is asked for only if it is in the cache already */
#define AHEAD 16      /* runs the disk is told of in advance when it was not */

struct key { /* a want that can be read */
	uint64_t offset;
	uint32_t want;
};

struct run { /* keys first .. first + n - 1 in one read */
	uint64_t from;
	uint32_t bytes, first, n;
};

struct bb_bricks_reader {
	const struct bb_bricks *b;
	struct bb_bricks_want *wants; /* of the batch in hand */
	struct bb_error *err;
	int fd;
	bool direct, can_probe, cold;
	uint32_t most; /* keys of a batch */
	uint32_t n_runs, n_told;
	uint32_t gap_bytes, piece_bytes;
	struct key *keys, *spare; /* [most] */
	struct run *runs;         /* [most] */
	uint8_t *stage;           /* piece_bytes, and a page on either side */
	uint8_t *bounce;          /* behind it, of a brick: where small ones are unpacked; or NULL */
	struct bb_unpacker unpacker;
	struct bb_bricks_counts counts;
	uint64_t held_bytes;
};

/* ---- a reader ---- */

/* The most a run may have: a piece, but a packed brick must fit, and no more than the batch can ask for. */
static size_t piece_of(const struct bb_bricks *b, uint32_t most, bool direct)
{
	const size_t n = bb_bricks_brick_bytes(&b->h), cap = bb_values_packed_cap(b->h.codec, n), all = cap * most;
	const size_t usual = direct ? PIECE_DIRECT_BYTES : PIECE_CACHED_BYTES, piece = all < usual ? all : usual;

	return b->h.codec != BB_BRICK_PLAIN && cap > piece ? cap : piece;
}

static size_t up(size_t n)
{
	return (n + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
}

/*
 * In one huge page: a disk reads twice as fast into it as into scattered small ones (its list of where the bytes go is
 * short), and all of it finds room in the second cache, which scattered pages share unevenly. Not where it would be more
 * than the bytes deserve.
 */
static uint8_t *stage_of(size_t *n)
{
	const bool huge = *n > HUGE_BYTES / 16;
	const size_t align = huge ? HUGE_BYTES : PAGE_BYTES;

	*n = (*n + align - 1) / align * align;
	uint8_t *stage = aligned_alloc(align, *n);
	if (stage && huge)
		(void)madvise(stage, *n, MADV_HUGEPAGE);
	return stage;
}

static bool hold(struct bb_bricks_reader *r)
{
	const size_t n_brick = bb_bricks_brick_bytes(&r->b->h), room = up(r->piece_bytes) + 2 * PAGE_BYTES;
	const bool bounces = r->b->h.codec != BB_BRICK_PLAIN && n_brick <= BOUNCE_BYTES &&
			     bb_crc32c_has(BB_CRC32C_FOLDED);
	size_t stage = room + (bounces ? n_brick : 0);

	r->keys = calloc(r->most, sizeof(*r->keys));
	r->spare = calloc(r->most, sizeof(*r->spare));
	r->runs = calloc(r->most, sizeof(*r->runs));
	r->stage = stage_of(&stage);
	if (!r->keys || !r->spare || !r->runs || !r->stage || !bb_unpacker_init(&r->unpacker, r->b->h.codec))
		return false;
	r->bounce = bounces ? r->stage + room : NULL;
	r->held_bytes = sizeof(*r) + stage + r->most * (2 * sizeof(*r->keys) + sizeof(*r->runs)) +
			bb_unpacker_bytes(&r->unpacker);
	return true;
}

enum bb_status bb_bricks_reader_create(const struct bb_bricks *b, uint32_t most, enum bb_bricks_way way,
				       struct bb_bricks_reader **out, struct bb_error *err)
{
	const struct bb_where where = { b->path, 0, 0 };
	struct bb_bricks_reader *r = calloc(1, sizeof(*r));

	*out = NULL;
	if (!r)
		return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "a reader");
	*r = (struct bb_bricks_reader){ .b = b,
					.fd = b->fd,
					.direct = way == BB_BRICKS_DIRECT,
					.can_probe = way == BB_BRICKS_CACHED,
					.most = most < 1 ? 1 : most > BB_BRICKS_BATCH_MOST ? BB_BRICKS_BATCH_MOST : most,
					.gap_bytes = way == BB_BRICKS_DIRECT ? GAP_DIRECT_BYTES : GAP_CACHED_BYTES };
	r->piece_bytes = (uint32_t)piece_of(b, r->most, r->direct);
	if (r->direct) { /* the same file, whatever its name means by now */
		char self[32];
		snprintf(self, sizeof(self), "/proc/self/fd/%d", b->fd);
		r->fd = open(self, O_RDONLY | O_CLOEXEC | O_DIRECT);
	}
	if (r->fd < 0) {
		const enum bb_status status =
			bb_fail(err, BB_ERR_UNSUPPORTED, 1453, &where, "%s", strerror(errno));
		bb_bricks_reader_destroy(r);
		return status;
	}
	if (!hold(r)) {
		bb_bricks_reader_destroy(r);
		return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "staging for %u bricks", most);
	}
	*out = r;
	return BB_OK;
}

void bb_bricks_reader_destroy(struct bb_bricks_reader *r)
{
	if (!r)
		return;
	if (r->direct && r->fd >= 0)
		close(r->fd);
	bb_unpacker_fini(&r->unpacker);
	free(r->keys);
	free(r->spare);
	free(r->runs);
	free(r->stage);
	free(r);
}

uint64_t bb_bricks_reader_bytes(const struct bb_bricks_reader *r)
{
	return r->held_bytes;
}

struct bb_bricks_counts bb_bricks_reader_counts(const struct bb_bricks_reader *r)
{
	return r->counts;
}

/* ---- what to read ---- */

static void fail(struct bb_bricks_reader *r, struct bb_bricks_want *w, enum bb_status status, int number,
		 const char *what)
{
	w->status = bb_fail(r->err, status, number, &(struct bb_where){ r->b->path, 0, 0 }, "brick %llu%s%s",
			    (unsigned long long)w->brick, *what ? ": " : "", what);
	w->number = number;
	r->counts.failed++;
}

static uint32_t gather(struct bb_bricks_reader *r, size_t n)
{
	const size_t n_brick = bb_bricks_brick_bytes(&r->b->h);
	uint32_t n_keys = 0;

	for (size_t i = 0; i < n; i++) {
		struct bb_bricks_want *w = &r->wants[i];
		w->status = BB_OK;
		w->number = 0;
		if (w->brick >= r->b->h.tree.n_bricks) {
			fail(r, w, BB_ERR_USAGE, 1452, "");
			continue;
		}
		const struct bb_bricks_record *record = &r->b->index[w->brick];
		if (r->b->h.codec == BB_BRICK_PLAIN && record->bytes != n_brick)
			fail(r, w, BB_ERR_FORMAT, 1450, "it is not as large as the others");
		else
			r->keys[n_keys++] = (struct key){ record->offset, (uint32_t)i };
	}
	return n_keys;
}

/* By offset, a byte at a time from the lowest: stable, and no comparison to mispredict. */
static void sort(struct bb_bricks_reader *r, uint32_t n)
{
	for (uint32_t shift = 0; shift < 64 && r->b->file_bytes >> shift; shift += 8) {
		uint32_t place[257] = { 0 };
		for (uint32_t i = 0; i < n; i++)
			place[(r->keys[i].offset >> shift & 0xff) + 1]++;
		for (uint32_t i = 0; i < 256; i++)
			place[i + 1] += place[i];
		for (uint32_t i = 0; i < n; i++)
			r->spare[place[r->keys[i].offset >> shift & 0xff]++] = r->keys[i];
		struct key *const sorted = r->spare;
		r->spare = r->keys;
		r->keys = sorted;
	}
}

static uint32_t bytes_of(const struct bb_bricks_reader *r, const struct key *k)
{
	return r->b->index[r->wants[k->want].brick].bytes;
}

/* A record that begins before the last one's end (twice the same brick, or a liar's file) begins a run of its own. */
static void make_runs(struct bb_bricks_reader *r, uint32_t n_keys)
{
	r->n_runs = 0;
	for (uint32_t i = 0; i < n_keys; i++) {
		const struct key *k = &r->keys[i];
		struct run *last = r->n_runs ? &r->runs[r->n_runs - 1] : NULL;
		const uint64_t end = last ? last->from + last->bytes : 0;
		if (last && k->offset >= end && k->offset - end <= r->gap_bytes &&
		    k->offset + bytes_of(r, k) - last->from <= r->piece_bytes) {
			last->bytes = (uint32_t)(k->offset + bytes_of(r, k) - last->from);
			last->n++;
			continue;
		}
		r->runs[r->n_runs++] = (struct run){ k->offset, bytes_of(r, k), i, 1 };
	}
}

/* ---- reading ---- */

/* Tells the disk of the runs to come. Nothing is owed if it does not listen. */
static void tell_ahead(struct bb_bricks_reader *r, uint32_t now)
{
	if (r->n_told < now)
		r->n_told = now;
	for (; r->n_told < r->n_runs && r->n_told < now + AHEAD; r->n_told++) {
		const struct run *u = &r->runs[r->n_told];
		bb_bricks_file_expect(r->fd, u->bytes, u->from);
	}
}

/* Is a run in the page cache? Reads what is; the disk hears of this one and the next ones if it is not. */
static size_t probe(struct bb_bricks_reader *r, uint32_t now)
{
	const struct run *u = &r->runs[now];
	const ssize_t got = bb_bricks_file_peek(r->fd, r->stage, u->bytes, u->from);

	r->counts.reads++;
	if (got < 0 && errno != EAGAIN)
		r->can_probe = false; /* not on this file system; an error comes again in the read that counts */
	else if (got < (ssize_t)u->bytes)
		r->cold = true;
	return got > 0 ? (size_t)got : 0;
}

/* n bytes from `from`, of which `done` are in the staging memory already; *out is where they stand. Returns how many
 * there are: fewer at the file's end, and after an error, which is then in *failure. */
static size_t fetch(struct bb_bricks_reader *r, uint64_t from, size_t n, size_t done, const uint8_t **out, int *failure)
{
	const uint64_t begin = r->direct ? from / PAGE_BYTES * PAGE_BYTES : from;
	const size_t before = (size_t)(from - begin), want = r->direct ? up(before + n) : n;

	*out = r->stage + before;
	*failure = 0;
	while (done < want) {
		const ssize_t got = bb_bricks_file_read(r->fd, r->stage + done, want - done, begin + done);
		r->counts.reads++;
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0)
			*failure = errno;
		if (got <= 0)
			break;
		done += (size_t)got;
		if (r->direct && done % PAGE_BYTES) /* the file's last bytes */
			break;
	}
	r->counts.read_bytes += done;
	return done <= before ? 0 : done - before < n ? done - before : n;
}

static void fail_short(struct bb_bricks_reader *r, struct bb_bricks_want *w, int failure)
{
	if (failure)
		fail(r, w, BB_ERR_IO, 1002, strerror(failure));
	else
		fail(r, w, BB_ERR_FORMAT, 1406, "the file has become shorter");
}

static bool is_whole(const struct bb_bricks_reader *r, const struct bb_bricks_want *w, uint32_t crc)
{
#ifdef BB_FUZZ
	(void)r;
	(void)w;
	(void)crc;
	return true;
#else
	return crc == r->b->index[w->brick].crc;
#endif
}

static bool unpack(struct bb_bricks_reader *r, const uint8_t *bytes, size_t n, uint8_t *out)
{
	const size_t n_brick = bb_bricks_brick_bytes(&r->b->h);

	if (!r->bounce)
		return bb_values_unpack(&r->unpacker, bytes, n, out, n_brick);
	if (!bb_values_unpack(&r->unpacker, bytes, n, r->bounce, n_brick))
		return false;
	(void)bb_crc32c_copy(0, out, r->bounce, n_brick);
	return true;
}

static void deliver(struct bb_bricks_reader *r, struct bb_bricks_want *w, const uint8_t *bytes)
{
	const size_t n = r->b->index[w->brick].bytes;
	const bool plain = r->b->h.codec == BB_BRICK_PLAIN;
	const uint32_t crc = plain ? bb_crc32c_copy(0, w->out, bytes, n) : bb_crc32c(0, bytes, n);

	if (!is_whole(r, w, crc))
		fail(r, w, BB_ERR_FORMAT, 1441, "");
	else if (!plain && !unpack(r, bytes, n, w->out))
		fail(r, w, BB_ERR_FORMAT, 1450, "");
	else
		r->counts.bricks++;
}

/* A plain brick of more than a piece: as many as it takes. */
static void read_large(struct bb_bricks_reader *r, struct bb_bricks_want *w)
{
	const struct bb_bricks_record *record = &r->b->index[w->brick];
	const uint8_t *bytes;
	uint32_t crc = 0;
	int failure;

	for (size_t at = 0, part; at < record->bytes; at += part) {
		part = record->bytes - at < r->piece_bytes ? record->bytes - at : r->piece_bytes;
		if (fetch(r, record->offset + at, part, 0, &bytes, &failure) < part) {
			fail_short(r, w, failure);
			return;
		}
		crc = bb_crc32c_copy(crc, w->out + at, bytes, part);
	}
	if (is_whole(r, w, crc))
		r->counts.bricks++;
	else
		fail(r, w, BB_ERR_FORMAT, 1441, "");
}

static void read_run(struct bb_bricks_reader *r, const struct run *u, size_t done)
{
	const uint8_t *bytes;
	int failure;

	if (u->bytes > r->piece_bytes) {
		read_large(r, &r->wants[r->keys[u->first].want]);
		return;
	}
	const size_t got = fetch(r, u->from, u->bytes, done, &bytes, &failure);
	for (uint32_t i = u->first; i < u->first + u->n; i++) {
		const struct key *k = &r->keys[i];
		const uint64_t end = k->offset - u->from + bytes_of(r, k);
		if (end <= got)
			deliver(r, &r->wants[k->want], bytes + (k->offset - u->from));
		else if (failure && u->n > 1) /* a bad sector is one brick's, not its neighbours' */
			read_run(r, &(struct run){ k->offset, bytes_of(r, k), i, 1 }, 0);
		else
			fail_short(r, &r->wants[k->want], failure);
	}
}

static void read_batch(struct bb_bricks_reader *r, size_t n)
{
	const uint32_t n_keys = gather(r, n);

	sort(r, n_keys);
	make_runs(r, n_keys);
	r->cold = false;
	r->n_told = 0;
	for (uint32_t i = 0; i < r->n_runs; i++) {
		const bool asks = r->can_probe && !r->cold && i % PROBE_EVERY == 0 &&
				  r->runs[i].bytes <= r->piece_bytes;
		const size_t done = asks ? probe(r, i) : 0;
		if (r->cold)
			tell_ahead(r, i);
		read_run(r, &r->runs[i], done);
	}
}

enum bb_status bb_bricks_read_many(struct bb_bricks_reader *r, struct bb_bricks_want *wants, size_t n,
				   struct bb_error *err)
{
	enum bb_status status = BB_OK;

	r->err = err;
	for (size_t at = 0; at < n; at += r->most) {
		r->wants = wants + at;
		read_batch(r, n - at < r->most ? n - at : r->most);
	}
	r->err = NULL;
	r->wants = NULL;
	bb_crc32c_copied();
	for (size_t i = 0; i < n && !status; i++)
		status = wants[i].status;
	return status;
}
