/*
 * render/bricks/bricks_read.c: a batch of bricks. Wants are put in the file's order, neighbours become one read (a run),
 * and each run goes to a staging memory that stays in the second cache; from there a brick that is stored as it is is
 * copied to its place past the caches while its CRC is made, and a packed one is unpacked. Reading straight into the slots
 * was slower: the kernel's copy has to fetch every line of the slot first.
 *
 * What the page cache has comes out of it. The rest comes straight from the disk, as many runs at once as staging has room
 * for: one after another a disk does not reach its rate, and through the page cache the kernel takes longer to make room
 * page by page than the disk to read (1.4 of 3.4 GB/s).
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
#define PIECE_BYTES 1024u /* so that small bricks can be large ones */
#else
#define PIECE_BYTES (768u << 10) /* of one read: it stays in the second cache; a row of four bricks of 34^3 floats */
#endif
#define HUGE_BYTES (2u << 20)
#define BOUNCE_BYTES (64u << 10) /* up to which unpacking in the caches and copying on is faster than unpacking in place */
#define PAGE_BYTES 4096u         /* what direct reads are multiples of */
#define GAP_BYTES (8u << 10)     /* unwanted bytes that cost less than one more read */
#define FLIGHTS 32               /* reads under way at once, if staging has room for so many */
#define TRUSTED 8                /* runs found in the page cache, until it is not asked what it has */
#define NOWHERE UINT32_MAX

struct key { /* a want that can be read */
	uint64_t offset;
	uint32_t want;
};

struct run { /* keys first .. first + n - 1 in one read; or, of one brick larger than a piece, what begins at `part` */
	uint64_t from;
	uint32_t bytes, first, n, part;
};

struct flight { /* a run that is under way to staging's bytes at .. at + bytes */
	uint32_t run, at, bytes;
	bool over;
	int64_t got; /* once it is over; below 0: an error */
};

struct bb_bricks_reader {
	const struct bb_bricks *b;
	struct bb_bricks_want *wants; /* of the batch in hand */
	struct bb_error *err;
	int direct_fd;       /* -1: nothing is read directly */
	bool probes, queues; /* asks the page cache first; has a queue */
	bool refused;        /* the file system opens files for direct reads and then has none: through the page cache */
	bool missed;         /* in this batch: the page cache lacked something */
	uint32_t n_cached;   /* runs found there since it did */
	uint32_t most;       /* keys of a batch */
	uint32_t n_runs, runs_most;
	uint32_t piece_bytes, ring_bytes;
	struct key *keys, *spare; /* [most] */
	struct run *runs;         /* [runs_most] */
	uint8_t *stage;           /* ring_bytes, used from front to back and over again */
	uint8_t *bounce;          /* behind it, of a brick: where small ones are unpacked; or NULL */
	uint32_t crc;             /* of the parts so far */
	struct bb_unpacker unpacker;
	struct bb_bricks_counts counts;
	uint64_t held_bytes;
	unsigned long queue;
	uint32_t oldest, n_flights, flights_most;
	struct flight *flights; /* [flights_most], ring */
};

/* ---- a reader ---- */

static size_t batch_bytes(const struct bb_bricks *b, uint32_t most)
{
	return bb_values_packed_cap(b->h.codec, bb_bricks_brick_bytes(&b->h)) * most;
}

/* The most a run may have: a piece, but a packed brick must fit, and no more than the batch can ask for. */
static size_t piece_of(const struct bb_bricks *b, uint32_t most)
{
	const size_t cap = batch_bytes(b, 1), all = batch_bytes(b, most), piece = all < PIECE_BYTES ? all : PIECE_BYTES;

	return b->h.codec != BB_BRICK_PLAIN && cap > piece ? cap : piece;
}

static size_t up(size_t n)
{
	return (n + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
}

/*
 * In a huge page: a disk reads twice as fast into it as into scattered small ones (its list of where the bytes go is
 * short), and scattered pages share the second cache unevenly. Not where it would be more than the bytes deserve. In two
 * where a batch is more than that: what is under way while the last bytes are copied keeps the disk busy.
 */
static uint8_t *stage_of(size_t *n, size_t batch)
{
	const bool huge = *n > HUGE_BYTES / 16;
	const size_t align = huge ? HUGE_BYTES : PAGE_BYTES;

	*n = *n < 2 * HUGE_BYTES && batch >= 2 * HUGE_BYTES ? 2 * HUGE_BYTES : (*n + align - 1) / align * align;
	uint8_t *stage = aligned_alloc(align, *n);
	if (stage && huge)
		(void)madvise(stage, *n, MADV_HUGEPAGE);
	return stage;
}

static bool hold(struct bb_bricks_reader *r)
{
	const size_t n_brick = bb_bricks_brick_bytes(&r->b->h);
	const bool bounces = r->b->h.codec != BB_BRICK_PLAIN && n_brick <= BOUNCE_BYTES &&
			     bb_crc32c_has(BB_CRC32C_FOLDED);
	const size_t bounce = bounces ? up(n_brick) : 0;
	size_t stage = up(r->piece_bytes) + 2 * PAGE_BYTES + bounce;

	r->runs_most = r->most * (uint32_t)((n_brick + r->piece_bytes - 1) / r->piece_bytes);
	r->keys = calloc(r->most, sizeof(*r->keys));
	r->spare = calloc(r->most, sizeof(*r->spare));
	r->runs = calloc(r->runs_most, sizeof(*r->runs));
	r->stage = stage_of(&stage, batch_bytes(r->b, r->most));
	if (!r->keys || !r->spare || !r->runs || !r->stage || !bb_unpacker_init(&r->unpacker, r->b->h.codec))
		return false;
	r->ring_bytes = (uint32_t)(stage - bounce);
	r->flights_most = r->ring_bytes / PAGE_BYTES < FLIGHTS ? r->ring_bytes / PAGE_BYTES : FLIGHTS;
	r->flights = calloc(r->flights_most, sizeof(*r->flights));
	if (!r->flights)
		return false;
	r->bounce = bounces ? r->stage + r->ring_bytes : NULL;
	r->held_bytes = sizeof(*r) + stage + r->most * 2 * sizeof(*r->keys) + r->runs_most * sizeof(*r->runs) +
			r->flights_most * sizeof(*r->flights) + bb_unpacker_bytes(&r->unpacker);
	return true;
}

/* The same file, whatever its name means by now. Through the page cache it must also be possible to ask what is there. */
static bool open_direct(struct bb_bricks_reader *r)
{
	char self[32], byte;

	if (r->probes && bb_bricks_file_peek(r->b->fd, &byte, 1, 0) < 0 && errno != EAGAIN)
		return false;
	snprintf(self, sizeof(self), "/proc/self/fd/%d", r->b->fd);
	r->direct_fd = open(self, O_RDONLY | O_CLOEXEC | O_DIRECT);
	r->queues = r->direct_fd >= 0 && bb_bricks_file_queue(FLIGHTS, &r->queue);
	return r->direct_fd >= 0;
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
					.direct_fd = -1,
					.probes = way == BB_BRICKS_CACHED,
					.most = most < 1 ? 1 : most > BB_BRICKS_BATCH_MOST ? BB_BRICKS_BATCH_MOST : most };
	r->piece_bytes = (uint32_t)piece_of(b, r->most);
	if (!open_direct(r) && way == BB_BRICKS_DIRECT) {
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
	if (r->queues)
		bb_bricks_file_unqueue(r->queue);
	if (r->direct_fd >= 0)
		close(r->direct_fd);
	bb_unpacker_fini(&r->unpacker);
	free(r->keys);
	free(r->spare);
	free(r->runs);
	free(r->stage);
	free(r->flights);
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

/* A plain brick of more than a piece: as many runs as it takes, one behind the other. */
static void make_parts(struct bb_bricks_reader *r, uint32_t first)
{
	const struct key *k = &r->keys[first];
	const uint32_t n = bytes_of(r, k);

	for (uint32_t at = 0; at < n; at += r->piece_bytes)
		r->runs[r->n_runs++] = (struct run){ k->offset + at, n - at < r->piece_bytes ? n - at : r->piece_bytes,
						     first, 1, at };
}

static bool is_part(const struct bb_bricks_reader *r, const struct run *u)
{
	return u->bytes < bytes_of(r, &r->keys[u->first]);
}

/* A record that begins before the last one's end (twice the same brick, or a liar's file) begins a run of its own. */
static void make_runs(struct bb_bricks_reader *r, uint32_t n_keys)
{
	r->n_runs = 0;
	for (uint32_t i = 0; i < n_keys; i++) {
		const struct key *k = &r->keys[i];
		const uint32_t n = bytes_of(r, k);
		const bool first = !r->n_runs;
		struct run *last = &r->runs[first ? 0 : r->n_runs - 1];
		const uint64_t end = first ? 0 : last->from + last->bytes;
		if (n > r->piece_bytes) {
			make_parts(r, i);
			continue;
		}
		if (!first && k->offset >= end && k->offset - end <= GAP_BYTES &&
		    k->offset + n - last->from <= r->piece_bytes) {
			last->bytes = (uint32_t)(k->offset + n - last->from);
			last->n++;
			continue;
		}
		r->runs[r->n_runs++] = (struct run){ k->offset, n, i, 1, 0 };
	}
}

/* ---- bytes that have come ---- */

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
	const bool as_is = bb_bricks_as_is(&r->b->h, n);
	const uint32_t crc = as_is ? bb_crc32c_copy(0, w->out, bytes, n) : bb_crc32c(0, bytes, n);

	if (!is_whole(r, w, crc))
		fail(r, w, BB_ERR_FORMAT, 1441, "");
	else if (!as_is && !unpack(r, bytes, n, w->out))
		fail(r, w, BB_ERR_FORMAT, 1450, "");
	else
		r->counts.bricks++;
}

/* Parts come in their order. */
static void deliver_part(struct bb_bricks_reader *r, const struct run *u, const uint8_t *bytes, size_t got, int failure)
{
	struct bb_bricks_want *w = &r->wants[r->keys[u->first].want];

	if (w->status) /* an earlier part has failed */
		return;
	if (got < u->bytes) {
		fail_short(r, w, failure);
		return;
	}
	r->crc = bb_crc32c_copy(u->part ? r->crc : 0, w->out + u->part, bytes, u->bytes);
	if (u->part + u->bytes < r->b->index[w->brick].bytes)
		return;
	if (is_whole(r, w, r->crc))
		r->counts.bricks++;
	else
		fail(r, w, BB_ERR_FORMAT, 1441, "");
}

/* ---- reading ---- */

/* Bytes of staging a run takes: where they begin in their page does not change. */
static uint32_t span_of(const struct run *u)
{
	return (uint32_t)up(u->from % PAGE_BYTES + u->bytes);
}

/* A run's bytes to staging at `at`, where `done` of them (direct: of its pages) are already. Returns how many there are:
 * fewer at the file's end, and after an error, which is then in *failure. */
static size_t fetch(struct bb_bricks_reader *r, const struct run *u, uint32_t at, size_t done, bool direct, int *failure)
{
	const size_t before = u->from % PAGE_BYTES, skip = direct ? before : 0, want = direct ? span_of(u) : u->bytes;
	uint8_t *const to = r->stage + at + before - skip;

	*failure = 0;
	while (done < want && !(direct && done % PAGE_BYTES)) { /* a part of a page: the file's last bytes */
		const ssize_t got = bb_bricks_file_read(direct ? r->direct_fd : r->b->fd, to + done, want - done,
							u->from - skip + done);
		r->counts.reads++;
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0 && errno == EINVAL && direct && r->probes) {
			r->refused = true;
			return fetch(r, u, at, 0, false, failure);
		}
		if (got < 0)
			*failure = errno;
		if (got <= 0)
			break;
		r->counts.read_bytes += (size_t)got;
		done += (size_t)got;
	}
	return done <= skip ? 0 : done - skip < u->bytes ? done - skip : u->bytes;
}

static void hand_over(struct bb_bricks_reader *r, const struct run *u, uint32_t at, size_t got, int failure);

static bool is_direct(const struct bb_bricks_reader *r)
{
	return r->direct_fd >= 0 && !r->refused;
}

static void read_run(struct bb_bricks_reader *r, const struct run *u, uint32_t at)
{
	int failure;
	const size_t got = fetch(r, u, at, 0, is_direct(r), &failure);

	hand_over(r, u, at, got, failure);
}

static void hand_over(struct bb_bricks_reader *r, const struct run *u, uint32_t at, size_t got, int failure)
{
	const uint8_t *bytes = r->stage + at + u->from % PAGE_BYTES;

	if (is_part(r, u)) {
		deliver_part(r, u, bytes, got, failure);
		return;
	}
	for (uint32_t i = u->first; i < u->first + u->n; i++) {
		const struct key *k = &r->keys[i];
		const uint64_t end = k->offset - u->from + bytes_of(r, k);
		if (end <= got)
			deliver(r, &r->wants[k->want], bytes + (k->offset - u->from));
		else if (failure && u->n > 1) /* a bad sector is one brick's, not its neighbours' */
			read_run(r, &(struct run){ k->offset, bytes_of(r, k), i, 1, 0 }, at);
		else
			fail_short(r, &r->wants[k->want], failure);
	}
}

/* ---- reads under way ---- */

static struct flight *flight_of(struct bb_bricks_reader *r, uint32_t i)
{
	return &r->flights[(r->oldest + i) % r->flights_most];
}

/* Waits for the one that has been under way for longest: runs are handed over in their order. */
static void finish_one(struct bb_bricks_reader *r)
{
	struct flight *f = flight_of(r, 0);

	while (!f->over) {
		int64_t got;
		struct flight *over = &r->flights[bb_bricks_file_end(r->queue, &got)];
		over->over = true;
		over->got = got;
	}
	const struct run *u = &r->runs[f->run];
	int failure;
	if (f->got > 0)
		r->counts.read_bytes += (uint64_t)f->got;
	const size_t got = fetch(r, u, f->at, f->got > 0 ? (size_t)f->got : 0, true, &failure);
	hand_over(r, u, f->at, got, failure);
	r->oldest = (r->oldest + 1) % r->flights_most;
	r->n_flights--;
}

static void finish_all(struct bb_bricks_reader *r)
{
	while (r->n_flights)
		finish_one(r);
}

/* Where staging has room for n bytes beside what is under way. */
static uint32_t room_for(struct bb_bricks_reader *r, uint32_t n)
{
	if (!r->n_flights)
		return 0;
	if (r->n_flights == r->flights_most)
		return NOWHERE;
	const struct flight *newest = flight_of(r, r->n_flights - 1);
	const uint32_t begin = flight_of(r, 0)->at, end = newest->at + newest->bytes;
	if (end <= begin)
		return begin - end >= n ? end : NOWHERE;
	return r->ring_bytes - end >= n ? end : n <= begin ? 0 : NOWHERE;
}

static bool begin_run(struct bb_bricks_reader *r, uint32_t run, uint32_t at)
{
	const struct run *u = &r->runs[run];
	const uint32_t i = (r->oldest + r->n_flights) % r->flights_most, bytes = span_of(u);

	if (!r->queues || r->refused || !bb_bricks_file_begin(r->queue, r->direct_fd, r->stage + at, bytes,
						u->from / PAGE_BYTES * PAGE_BYTES, i))
		return false;
	r->flights[i] = (struct flight){ .run = run, .at = at, .bytes = bytes };
	r->n_flights++;
	r->counts.reads++;
	return true;
}

/* Is it worth while to look into the page cache? Where it lacks something, looking makes the kernel fetch it, so it is
 * asked first, but not when it has had everything lately. */
static bool may_be_cached(struct bb_bricks_reader *r, const struct run *u)
{
	if (!r->probes || !is_direct(r))
		return false;
	if (r->n_cached >= TRUSTED)
		return true;
	const int cached = bb_bricks_file_cached(r->b->fd, u->bytes, u->from);
	return cached < 0 ? !r->missed : cached > 0;
}

/* Of a run, what the page cache has. */
static size_t probe(struct bb_bricks_reader *r, const struct run *u, uint32_t at)
{
	const ssize_t got =
		bb_bricks_file_peek(r->b->fd, r->stage + at + u->from % PAGE_BYTES, u->bytes, u->from);

	r->counts.reads++;
	if (got > 0)
		r->counts.read_bytes += (size_t)got;
	return got > 0 ? (size_t)got : 0;
}

static void start(struct bb_bricks_reader *r, uint32_t run)
{
	const struct run *u = &r->runs[run];
	uint32_t at;

	while ((at = room_for(r, span_of(u))) == NOWHERE)
		finish_one(r);
	const size_t got = may_be_cached(r, u) ? probe(r, u, at) : 0;
	r->n_cached = got == u->bytes ? r->n_cached + 1 : 0;
	r->missed |= got < u->bytes;
	if (got < u->bytes && begin_run(r, run, at))
		return;
	if (is_part(r, u)) /* behind those that are under way: they share a CRC */
		finish_all(r);
	if (got == u->bytes)
		hand_over(r, u, at, got, 0);
	else
		read_run(r, u, at);
}

static void read_batch(struct bb_bricks_reader *r, size_t n)
{
	const uint32_t n_keys = gather(r, n);

	sort(r, n_keys);
	make_runs(r, n_keys);
	r->missed = false;
	for (uint32_t i = 0; i < r->n_runs; i++)
		start(r, i);
	finish_all(r);
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
