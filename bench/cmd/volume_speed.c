/*
 * bench/cmd/volume_speed.c: `blackburst volume speed FILE`: how fast this machine hands over the bricks of a file, beside
 * what bounds it: memcpy of the same bricks (the codec's bare decoder where they are packed) for those in the page cache,
 * the disk's own sequential rate for those that are not. A command and not a test, because whether a streaming budget can
 * be met is a question about the disk and the memory of the machine that will show the data.
 *
 * The peers take turns round by round; a ratio is that of one round, and its median and quartiles over the rounds are told.
 * Both hand over the same bricks in the same order to the same slots, by as many threads, out of memory that is in no
 * cache. The bare decoder has all bricks packed, those too that the file has as they are because packing did not pay.
 */
#define _GNU_SOURCE /* O_DIRECT */
#include <fcntl.h>
#include <jansson.h>
#include <lz4.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bench/cmd/volume_make.h"
#include "bench/stats.h"
#include "render/bricks/bricks.h"
#include "render/bricks/values.h"
#include "render/parallel.h"

#define ROUNDS_MOST 999
#define ROUND_WARM_BYTES (8u << 20) /* or a batch: many times what starting a thread takes */
#define ROUND_COLD_BYTES (64u << 20)
#define POOL_BYTES (128u << 20)    /* of slots, for each thread: several times what the caches hold */
#define WAITING_BYTES (16u << 20)  /* and for each of those that wait for the disk */
#define SEQUENTIAL_BYTES (1u << 20) /* of one read of the disk's own rate */
#define PAGE_BYTES 4096u

static const struct bb_cli_option options[] = {
	{ "mib", "N", "of bricks; a round has a part of them (default 256)" },
	{ "rounds", "N", "for rows of the page cache; those of the disk have an eighth of it, and 5 (default 199)" },
	{ "batch", "N", "bricks asked for at once (default 64)" },
	{ "threads", "N", "warm rows for 1 and for N readers (default: one for each processor)" },
	{ "depth", "N", "cold rows for 1 and for N readers (default 8)" },
	{ "seed", "N", "of the random order (default 1)" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

enum way { FROM_MEMORY, THROUGH_CACHE, UNCHECKED, SEQUENTIAL, COLD_DIRECT, COLD_CACHED };

struct worker { /* a thread's own */
	struct bb_bricks_reader *reader[2]; /* by enum bb_bricks_way; direct may be NULL */
	struct bb_unpacker unpacker;
	uint8_t *pool; /* n_slots of stride bytes */
	size_t next, n_slots;
};

struct packed { /* a brick in memory, as the peer has it */
	uint64_t at;
	uint32_t bytes;
};

struct speed {
	const struct bb_bricks *b;
	int fd, direct_fd; /* -1: no direct reads here */
	size_t n_brick, stride;
	uint32_t batch, n;
	unsigned most_threads, depth;
	uint64_t sequential_at; /* where the next sequential read of the file begins */
	uint32_t from, to;  /* of the order, in this round */
	uint64_t *order;    /* [n] bricks */
	struct packed *copied; /* [n] */
	uint8_t *copy;
	uint64_t file_bytes, stored_bytes; /* of these bricks in the file */
	uint32_t as_is;                    /* of them are stored so, whatever the codec */
	struct worker worker[BB_PARALLEL_MOST];
	enum way way;
	atomic_uint failed;
};

/* ---- what is read ---- */

static uint64_t draw(uint64_t *state, uint64_t n)
{
	*state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return n ? (*state >> 33) % n : 0;
}

/* Bricks of the whole file, each at most once. */
static uint32_t order_random(const struct speed *s, uint64_t seed, uint32_t most)
{
	const uint32_t n_bricks = (uint32_t)bb_bricks_header(s->b)->tree.n_bricks;
	uint32_t *all = calloc(n_bricks, sizeof(*all));
	const uint32_t n = most < n_bricks ? most : n_bricks;

	for (uint32_t i = 0; all && i < n_bricks; i++)
		all[i] = i;
	for (uint32_t i = 0; all && i < n; i++) {
		const uint32_t k = i + (uint32_t)draw(&seed, n_bricks - i), take = all[k];
		all[k] = all[i];
		s->order[i] = take;
	}
	free(all);
	return all ? n : 0;
}

/* Boxes of 4 x 4 x 4 leaves of one step, somewhere, in any order: what a head that turns asks for. */
static uint32_t order_near(const struct speed *s, uint64_t seed, uint32_t most)
{
	const struct bb_tree *t = &bb_bricks_header(s->b)->tree;
	const uint32_t *grid = t->grid[t->n_levels - 1];
	uint32_t n = 0;

	while (n < most) {
		const uint64_t first = (uint64_t)bb_tree_leaf_time(t, (uint32_t)draw(&seed, t->n_steps)) * t->n_nodes;
		const uint32_t from = n, corner[3] = { (uint32_t)draw(&seed, grid[0]), (uint32_t)draw(&seed, grid[1]),
						       (uint32_t)draw(&seed, grid[2]) };
		for (uint32_t i = 0; i < 64 && n < most; i++) {
			const struct bb_tree_place p = { t->n_levels - 1,
							 { corner[0] + i % 4, corner[1] + i / 4 % 4, corner[2] + i / 16 } };
			if (p.at[0] < grid[0] && p.at[1] < grid[1] && p.at[2] < grid[2])
				s->order[n++] = first + bb_tree_node(t, &p);
		}
		for (uint32_t i = from; i + 1 < n; i++) {
			const uint32_t k = i + (uint32_t)draw(&seed, n - i);
			const uint64_t other = s->order[k];
			s->order[k] = s->order[i];
			s->order[i] = other;
		}
	}
	return n;
}

struct place { /* of a brick of the order */
	uint64_t offset;
	uint32_t i;
};

static int by_offset(const void *a, const void *b)
{
	const uint64_t x = ((const struct place *)a)->offset, y = ((const struct place *)b)->offset;

	return x < y ? -1 : x > y;
}

/* To s->copy + at, as the peer takes it from there; 0: it could not be read. */
static size_t copy_brick(struct speed *s, uint64_t brick, uint64_t at)
{
	const struct bb_bricks_header *h = bb_bricks_header(s->b);
	const struct bb_bricks_record *r = &bb_bricks_index(s->b)[brick];
	uint8_t *const to = s->copy + at, *const values = s->worker[0].pool;

	if (!values || pread(s->fd, values, r->bytes, (off_t)r->offset) != (ssize_t)r->bytes)
		return 0;
	s->stored_bytes += r->bytes;
	s->as_is += bb_bricks_as_is(h, r->bytes);
	if (h->codec == BB_BRICK_LZ4 && bb_bricks_as_is(h, r->bytes))
		return (size_t)LZ4_compress_default((const char *)values, (char *)to, (int)r->bytes,
						    LZ4_compressBound((int)r->bytes));
	memcpy(to, values, r->bytes);
	return r->bytes;
}

/* The bricks in memory, in the file's order and without what lies between them. */
static enum bb_status copy_file(struct speed *s, struct bb_error *err)
{
	const uint64_t cap = bb_values_packed_cap(bb_bricks_header(s->b)->codec, s->n_brick);
	struct place *place = calloc(s->n, sizeof(*place));
	uint64_t at = 0;

	s->stored_bytes = s->as_is = 0;
	free(s->copy);
	s->copy = malloc(cap * s->n);
	for (uint32_t i = 0; place && i < s->n; i++)
		place[i] = (struct place){ bb_bricks_index(s->b)[s->order[i]].offset, i };
	if (place)
		qsort(place, s->n, sizeof(*place), by_offset);
	for (uint32_t k = 0; place && s->copy && k < s->n; k++) {
		const uint32_t i = place[k].i;
		s->copied[i] = (struct packed){ at, (uint32_t)copy_brick(s, s->order[i], at) };
		at += s->copied[i].bytes;
		s->failed += !s->copied[i].bytes;
	}
	free(place);
	return place && s->copy ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a copy of the bricks");
}

/* ---- one round of one peer ---- */

static bool from_memory(const struct speed *s, struct worker *w, uint32_t i, uint8_t *slot)
{
	const uint8_t *from = s->copy + s->copied[i].at;
	const size_t n = s->copied[i].bytes;

	switch (bb_bricks_header(s->b)->codec) {
	case BB_BRICK_LZ4:
		return LZ4_decompress_safe((const char *)from, (char *)slot, (int)n, (int)s->n_brick) == (int)s->n_brick;
	case BB_BRICK_ZSTD:
		if (!bb_bricks_as_is(bb_bricks_header(s->b), n))
			return bb_values_unpack(&w->unpacker, from, n, slot, s->n_brick);
		/* fallthrough */
	case BB_BRICK_PLAIN:
	case BB_BRICK_CODECS:
		memcpy(slot, from, n);
	}
	return true;
}

static void sequential(struct speed *s, size_t i, struct worker *w)
{
	const uint64_t at = (s->sequential_at + i) % (s->file_bytes / SEQUENTIAL_BYTES) * SEQUENTIAL_BYTES;

	if (pread(s->direct_fd, w->pool, SEQUENTIAL_BYTES, (off_t)at) != SEQUENTIAL_BYTES)
		atomic_fetch_add(&s->failed, 1);
}

static void one_batch(void *ctx, size_t i, unsigned thread)
{
	struct speed *s = ctx;
	struct worker *w = &s->worker[thread];
	struct bb_bricks_want wants[BB_BRICKS_BATCH_MOST];
	const uint32_t from = s->from + (uint32_t)i * s->batch, n = s->to - from < s->batch ? s->to - from : s->batch;
	bool good = true;

	if (s->way == SEQUENTIAL) {
		sequential(s, i, w);
		return;
	}
	for (uint32_t k = 0; k < n; k++) {
		uint8_t *slot = w->pool + w->next * s->stride;
		w->next = (w->next + 1) % w->n_slots;
		wants[k] = (struct bb_bricks_want){ .brick = s->order[from + k], .out = slot };
		if (s->way == FROM_MEMORY)
			good &= from_memory(s, w, from + k, slot);
		else if (s->way == UNCHECKED)
			good &= pread(s->fd, slot, s->n_brick, (off_t)bb_bricks_index(s->b)[s->order[from + k]].offset) ==
				(ssize_t)s->n_brick;
	}
	if (s->way == THROUGH_CACHE || s->way == COLD_CACHED || s->way == COLD_DIRECT)
		good &= bb_bricks_read_many(w->reader[s->way == COLD_DIRECT], wants, n, NULL) == BB_OK;
	if (!good)
		atomic_fetch_add(&s->failed, 1);
}

static uint64_t stored_bytes(const struct speed *s)
{
	uint64_t n = 0;

	for (uint32_t i = s->from; i < s->to; i++)
		n += bb_bricks_index(s->b)[s->order[i]].bytes;
	return n;
}

/* Bytes a second; of bricks as they are in memory where `unpacked`, else of bytes of the file. */
static double rate(struct speed *s, enum way way, unsigned threads, bool unpacked)
{
	const uint64_t stored = stored_bytes(s);
	const size_t n_sequential = (size_t)(stored / SEQUENTIAL_BYTES) + 1;
	const size_t n = way == SEQUENTIAL ? n_sequential : (s->to - s->from + s->batch - 1) / s->batch;
	const double bytes = way == SEQUENTIAL ? (double)n_sequential * SEQUENTIAL_BYTES :
			     unpacked	       ? (double)(s->to - s->from) * (double)s->n_brick :
						 (double)stored;

	s->way = way;
	if (way == COLD_CACHED || way == SEQUENTIAL)
		(void)posix_fadvise(s->fd, 0, 0, POSIX_FADV_DONTNEED);
	const int64_t from_ns = bb_clock_stopwatch_ns();
	bb_parallel(threads, n, one_batch, s);
	s->sequential_at += way == SEQUENTIAL ? n : 0;
	return bytes * 1e9 / (double)(bb_clock_stopwatch_ns() - from_ns);
}

/* ---- rows ---- */

struct row {
	const char *what, *peer, *order;
	unsigned threads, peer_threads;
	double bytes_s, peer_bytes_s, ratio, must; /* medians; must 0: none is set */
	double least, most; /* quartiles of the ratio */
	double of_best; /* the best round's rate beside the peer's best: what a busy machine disturbs least */
};

static double median(double *v, size_t n)
{
	bb_stats_sort(v, n);
	return bb_stats_nearest_rank(v, n, 0.5);
}

/* Both peers have the next part of the order in each round, over and over: a round is short beside what else the
 * machine does, and still no brick is in the caches. */
static void compare(struct speed *s, enum way peer, enum way way, bool unpacked, unsigned rounds, struct row *out)
{
	double a[ROUNDS_MOST], b[ROUNDS_MOST], ratio[ROUNDS_MOST];
	const size_t bytes = unpacked ? (size_t)ROUND_WARM_BYTES * out->threads : ROUND_COLD_BYTES;
	const uint32_t fits = (uint32_t)(bytes / s->n_brick / s->batch) * s->batch,
		       least = s->batch * out->threads,
		       wanted = fits > least ? fits : least, part = wanted < s->n ? wanted : s->n, parts = part ? s->n / part : 0;

	for (unsigned i = 0; i < rounds; i++) {
		s->from = parts ? part * (i % parts) : 0;
		s->to = s->from + part;
		a[i] = rate(s, peer, out->peer_threads, unpacked);
		b[i] = rate(s, way, out->threads, unpacked);
		ratio[i] = b[i] / a[i];
	}
	out->peer_bytes_s = median(a, rounds);
	out->bytes_s = median(b, rounds);
	out->of_best = b[rounds - 1] / a[rounds - 1];
	out->ratio = median(ratio, rounds);
	out->least = ratio[rounds / 4]; /* a busy machine makes the ends mean nothing */
	out->most = ratio[rounds - 1 - rounds / 4];
}

/* Into the page cache from front to back, as a copy or a build leaves it: its pages are then large, and a read of them
 * costs half of what it does when bricks came one by one. */
static void fill_cache(struct speed *s)
{
	(void)posix_fadvise(s->fd, 0, 0, POSIX_FADV_DONTNEED);
	for (uint64_t at = 0; at < s->file_bytes; at += SEQUENTIAL_BYTES)
		if (pread(s->fd, s->worker[0].pool, SEQUENTIAL_BYTES, (off_t)at) <= 0)
			atomic_fetch_add(&s->failed, 1);
}

static void warm_rows(struct speed *s, const char *order, unsigned rounds, struct row *rows, size_t *n)
{
	const enum bb_brick_codec codec = bb_bricks_header(s->b)->codec;

	for (unsigned threads = 1;; threads = s->most_threads) {
		struct row *r = &rows[(*n)++];
		*r = (struct row){ .what = "page cache",
				   .order = order,
				   .peer = codec == BB_BRICK_PLAIN ? "memcpy" :
					   codec == BB_BRICK_LZ4   ? "liblz4 from memory" :
								     "libzstd from memory",
				   .threads = threads,
				   .peer_threads = threads,
				   .must = codec == BB_BRICK_PLAIN ? 0.8 : codec == BB_BRICK_LZ4 ? 0.85 : 0 };
		compare(s, FROM_MEMORY, THROUGH_CACHE, true, rounds, r);
		if (codec == BB_BRICK_PLAIN) {
			r = &rows[(*n)++];
			*r = (struct row){ .what = "  pread to its place, unchecked",
					   .order = order,
					   .peer = "memcpy",
					   .threads = threads,
					   .peer_threads = threads };
			compare(s, FROM_MEMORY, UNCHECKED, true, rounds, r);
		}
		if (threads == s->most_threads)
			return;
	}
}

/* Beside as many readers that read the file in order. The stream has one. */
static void cold_rows(struct speed *s, const char *order, unsigned rounds, struct row *rows, size_t *n)
{
	static const struct {
		enum way way;
		const char *what;
	} ways[] = { { COLD_CACHED, "cold, dropped from the page cache" }, { COLD_DIRECT, "cold, page cache not asked" } };
	const unsigned readers[][2] = { { 1, 1 }, { s->depth, s->depth } };

	for (size_t i = 0; i < (s->depth > 1 ? BB_ARRAY_LEN(readers) : 1); i++)
		for (size_t k = 0; k < BB_ARRAY_LEN(ways); k++) {
			struct row *r = &rows[(*n)++];
			*r = (struct row){ .what = ways[k].what,
					   .order = order,
					   .peer = "disk, in order",
					   .threads = readers[i][0],
					   .peer_threads = readers[i][1],
					   .must = s->n_brick > 100000 && i == 0 ? 0.9 : 0 };
			compare(s, SEQUENTIAL, ways[k].way, false, rounds / 8 + 5, r);
		}
}

static int tell_json(const struct speed *s, const struct row *rows, size_t n)
{
	const struct bb_bricks_header *h = bb_bricks_header(s->b);
	json_t *root = json_pack("{s:i, s:i, s:s, s:s, s:i, s:i, s:I, s:i, s:o}", "brick", (int)h->tree.edge, "pad", (int)h->pad,
				 "type", bb_brick_type_text(h->type), "codec", bb_brick_codec_text(h->codec), "bricks",
				 (int)s->n, "as_they_are", (int)s->as_is, "bytes_of_the_file", (json_int_t)s->stored_bytes, "batch", (int)s->batch,
				 "rows", json_array());
	json_t *list = json_object_get(root, "rows");

	for (size_t i = 0; i < n; i++) {
		const struct row *r = &rows[i];
		json_array_append_new(list,
				      json_pack("{s:s, s:s, s:s, s:i, s:i, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "what",
						r->what, "against", r->peer, "order", r->order, "readers",
						(int)r->threads, "against_readers", (int)r->peer_threads, "bytes_s", r->bytes_s, "against_bytes_s", r->peer_bytes_s, "ratio",
						r->ratio, "ratio_of_best", r->of_best, "ratio_quartile", r->least, "ratio_quartile_3", r->most, "must",
						r->must));
	}
	return bb_cli_print_json(root);
}

static int tell(const struct bb_cli *cli, const struct speed *s, const struct row *rows, size_t n, unsigned rounds)
{
	const struct bb_bricks_header *h = bb_bricks_header(s->b);

	if (bb_cli_has(cli, "json"))
		return tell_json(s, rows, n);
	printf("bricks of %u^3 and %u around them, %s, codec %s; %u bricks, %.1f MiB, in the file %.3f of that, %.3f of them "
	       "as they are; batches of %u; medians and quartiles of %u rounds\n",
	       h->tree.edge, h->pad, bb_brick_type_text(h->type), bb_brick_codec_text(h->codec), s->n,
	       (double)s->n * (double)s->n_brick / 1048576,
	       (double)s->stored_bytes / (double)s->n / (double)s->n_brick, (double)s->as_is / s->n, s->batch, rounds);
	printf("%-34s %-7s %7s %7s  %-20s %7s %7s %6s %17s %7s %4s\n", "what", "order", "readers", "GB/s", "against",
	       "readers", "GB/s", "ratio", "", "of best", "must");
	for (size_t i = 0; i < n; i++) {
		const struct row *r = &rows[i];
		printf("%-34s %-7s %7u %7.2f  %-20s %7u %7.2f %6.3f (%.3f .. %.3f) %7.3f", r->what, r->order, r->threads,
		       r->bytes_s * 1e-9, r->peer, r->peer_threads, r->peer_bytes_s * 1e-9, r->ratio, r->least, r->most,
		       r->of_best);
		if (r->must > 0)
			printf(" %4.2f %s", r->must, r->ratio >= r->must ? "held" : "MISSED");
		putchar('\n');
	}
	if (s->direct_fd < 0)
		printf("no cold rows: this file system has no direct reads\n");
	return BB_EXIT_OK;
}

/* ---- set up ---- */

static uint8_t *pool_of(size_t n)
{
	uint8_t *pool = aligned_alloc(2u << 20, (n + (2u << 20) - 1) / (2u << 20) * (2u << 20));

	if (pool) {
		(void)madvise(pool, n, MADV_HUGEPAGE); /* as an atlas is */
		memset(pool, 0, n);
	}
	return pool;
}

static unsigned workers_of(const struct speed *s)
{
	return s->most_threads > s->depth ? s->most_threads : s->depth;
}

static enum bb_status set_up(struct speed *s, const char *path, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_bricks_header(s->b);

	s->fd = open(path, O_RDONLY | O_CLOEXEC);
	s->direct_fd = open(path, O_RDONLY | O_CLOEXEC | O_DIRECT);
	if (s->fd < 0)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &(struct bb_where){ path, 0, 0 }, "opening it again");
	s->file_bytes = (uint64_t)lseek(s->fd, 0, SEEK_END);
	if (s->file_bytes < SEQUENTIAL_BYTES)
		return bb_fail(err, BB_ERR_CONFIG, 1701, NULL, "%s is too small to be measured", path);
	s->n_brick = bb_bricks_brick_bytes(h);
	s->stride = (s->n_brick + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
	for (unsigned i = 0; i < workers_of(s); i++) {
		struct worker *w = &s->worker[i];
		enum bb_status status =
			bb_bricks_reader_create(s->b, s->batch, BB_BRICKS_CACHED, &w->reader[BB_BRICKS_CACHED], err);
		if (!status && s->direct_fd >= 0)
			status = bb_bricks_reader_create(s->b, s->batch, BB_BRICKS_DIRECT,
							 &w->reader[BB_BRICKS_DIRECT], err);
		if (status)
			return status;
		const size_t pool = i < s->most_threads ? POOL_BYTES : WAITING_BYTES;
		w->pool = pool_of(pool);
		w->n_slots = pool / s->stride;
		if (!w->pool || !bb_unpacker_init(&w->unpacker, h->codec))
			return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "slots");
	}
	return BB_OK;
}

static void tear_down(struct speed *s)
{
	for (unsigned i = 0; i < workers_of(s); i++) {
		bb_bricks_reader_destroy(s->worker[i].reader[0]);
		bb_bricks_reader_destroy(s->worker[i].reader[1]);
		bb_unpacker_fini(&s->worker[i].unpacker);
		free(s->worker[i].pool);
	}
	free(s->order);
	free(s->copied);
	free(s->copy);
	if (s->fd >= 0)
		close(s->fd);
	if (s->direct_fd >= 0)
		close(s->direct_fd);
}

static enum bb_status measure(struct speed *s, double mib, uint64_t seed, unsigned rounds, struct row *rows, size_t *n,
			      struct bb_error *err)
{
	const double asked = mib * 1048576 / (double)s->n_brick + 1, all = (double)bb_bricks_header(s->b)->tree.n_bricks;
	const uint32_t most = (uint32_t)(asked < all ? asked : all);

	s->order = calloc(most, sizeof(*s->order));
	s->copied = calloc(most, sizeof(*s->copied));
	for (int near = 0; near < 2; near++) {
		s->n = !s->order || !s->copied ? 0 : near ? order_near(s, seed, most) : order_random(s, seed, most);
		if (!s->n)
			return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "an order of %u bricks", most);
		const enum bb_status status = copy_file(s, err);
		if (status)
			return status;
		fill_cache(s);
		warm_rows(s, near ? "near" : "random", rounds, rows, n);
		if (s->direct_fd >= 0)
			cold_rows(s, near ? "near" : "random", rounds, rows, n);
	}
	if (s->failed)
		return bb_fail(err, BB_ERR_FORMAT, 1441, NULL, "%u batches", s->failed);
	return BB_OK;
}

static int command(const struct bb_cli *cli)
{
	static struct speed s;
	double mib = 0, rounds = 0, batch = 0, depth = 0, seed = 0;
	unsigned threads = 0;
	struct bb_error err = { 0 };
	struct bb_bricks *b = NULL;
	struct row rows[32];
	size_t n = 0;

	enum bb_status status = bb_cli_number(cli, "mib", 256, 1, 1 << 16, &mib, &err);
	if (!status)
		status = bb_cli_whole(cli, "rounds", 199, 1, ROUNDS_MOST, &rounds, &err);
	if (!status)
		status = bb_cli_whole(cli, "batch", 64, 1, BB_BRICKS_BATCH_MOST, &batch, &err);
	if (!status)
		status = bb_volume_threads(cli, &threads, &err);
	if (!status)
		status = bb_cli_whole(cli, "depth", 8, 1, BB_PARALLEL_MOST, &depth, &err);
	if (!status)
		status = bb_cli_whole(cli, "seed", 1, 0, 1e9, &seed, &err);
	if (!status)
		status = bb_bricks_open(cli->arg[0], &b, &err);
	if (status)
		return bb_cli_fail(status, &err);
	s = (struct speed){ .b = b,
			     .fd = -1,
			     .direct_fd = -1,
			     .batch = (uint32_t)batch,
			     .most_threads = threads,
			     .depth = (unsigned)depth };
	status = set_up(&s, cli->arg[0], &err);
	if (!status)
		status = measure(&s, mib, (uint64_t)seed, (unsigned)rounds, rows, &n, &err);
	const int code = status ? bb_cli_fail(status, &err) : tell(cli, &s, rows, n, (unsigned)rounds);
	tear_down(&s);
	bb_bricks_close(b);
	return code;
}

const struct bb_command bb_cmd_volume_speed = {
	"volume speed", "how fast bricks come from page cache and disk, beside memcpy, bare decoder and disk",
	"FILE [--mib N] [--rounds N] [--batch N] [--threads N] [--depth N] [--seed N] [--json]", options, 1, 1, command,
};
