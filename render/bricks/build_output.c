/*
 * render/bricks/build_output.c: the result on its way to the disk. Threads fill places of a ring in memory, given in
 * the order of turns, so that the file is the same whatever their number; one more thread writes what is whole, in
 * blocks and past the page cache where the file system lets it. So nobody waits for the disk but when the ring is full,
 * nobody for the file's lock (two threads that wrote to one file spent a tenth of their time there), and a result of any
 * size drives nothing out of memory.
 */
#include "render/bricks/build_private.h"
#include "render/parallel.h"

#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define BLOCK 4096u         /* of every disk that there is, or a multiple of it */
#define BLOCKS_AT_ONCE 512u /* of one call; a disk is as fast as it can be with these */
#define PLACES_MOST (2 * BB_PARALLEL_MOST)

struct bb_build_output {
	pthread_mutex_t lock;
	pthread_cond_t moved, much; /* for those who want a place; for the thread that writes */
	pthread_t thread;
	bool runs, stop, flush, failed;
	size_t turn;
	/* Positions in the file. Below `written` all is on its way to the disk, below `filled` in the ring. */
	uint64_t written, filled, given;
	struct {
		uint64_t to;
		bool is_full;
	} place[PLACES_MOST]; /* given ones, a ring of their own */
	size_t first, n_places;
	uint8_t *ring, *memory;
	size_t bytes, at_once, most; /* of the ring; written at a time; of a place, which the ring goes on for */
};

/* ---- sizes ---- */

static uint64_t blocks(uint64_t n)
{
	return (n + BLOCK - 1) / BLOCK * BLOCK;
}

/* A ring with room for two places of `most` bytes beside what is less than a write, or for more. */
static void choose_sizes(const struct bb_build *b, size_t most, struct bb_build_output *o)
{
	const uint64_t wanted = b->config->memory_bytes / 32;

	o->most = blocks(most);
	o->at_once = BLOCKS_AT_ONCE * BLOCK;
	while (o->at_once > BLOCK && 4 * o->at_once > wanted)
		o->at_once /= 2;
	const uint64_t least = 2 * o->most + 2 * o->at_once;
	o->bytes = blocks(wanted > 16u << 20 ? 16u << 20 : wanted);
	o->bytes = o->bytes < least ? least : o->bytes;
}

/* ---- the thread that writes ---- */

/* How much may be written now: whole blocks, up to the ring's end. */
static size_t ready(const struct bb_build_output *o)
{
	const size_t whole = (size_t)(o->filled - o->written) / BLOCK * BLOCK;
	const size_t to_end = o->bytes - (size_t)(o->written % o->bytes), n = whole < to_end ? whole : to_end;

	if (n < o->at_once && n < to_end && !o->flush)
		return 0;
	return n < o->at_once ? n : o->at_once;
}

static void *write_on(void *arg)
{
	struct bb_build *b = arg;
	struct bb_build_output *o = b->output;
	size_t n;

	pthread_mutex_lock(&o->lock);
	while (!o->stop) {
		if (o->failed || !(n = ready(o))) {
			pthread_cond_wait(&o->much, &o->lock);
			continue;
		}
		const uint64_t at = o->written;
		pthread_mutex_unlock(&o->lock);
		const bool ok = bb_build_pwrite(b, b->fd, o->ring + at % o->bytes, n, at);
		pthread_mutex_lock(&o->lock);
		o->written += n;
		o->failed |= !ok;
		pthread_cond_broadcast(&o->moved);
	}
	pthread_mutex_unlock(&o->lock);
	return NULL;
}

/* ---- places ---- */

uint8_t *bb_build_output_take(struct bb_build *b, size_t turn, size_t n, uint64_t *at)
{
	struct bb_build_output *o = b->output;

	pthread_mutex_lock(&o->lock);
	while (!o->failed && (o->turn != turn || o->n_places == PLACES_MOST || o->given + n - o->written > o->bytes))
		pthread_cond_wait(&o->moved, &o->lock);
	*at = o->given;
	if (!o->failed) {
		o->given += n;
		o->place[(o->first + o->n_places++) % PLACES_MOST].to = o->given;
		o->turn++;
	}
	uint8_t *place = o->failed ? NULL : o->ring + *at % o->bytes;
	pthread_cond_broadcast(&o->moved);
	pthread_mutex_unlock(&o->lock);
	return place;
}

void bb_build_output_put(struct bb_build *b, uint64_t at, size_t n)
{
	struct bb_build_output *o = b->output;
	const uint64_t to = at + n;
	const size_t begin = (size_t)(at % o->bytes);

	if (begin + n > o->bytes) /* what went over the ring's end belongs to its beginning */
		memcpy(o->ring, o->ring + o->bytes, begin + n - o->bytes);
	pthread_mutex_lock(&o->lock);
	const bool none_left = o->n_places == PLACES_MOST;
	for (size_t i = 0; i < o->n_places; i++)
		if (o->place[(o->first + i) % PLACES_MOST].to == to)
			o->place[(o->first + i) % PLACES_MOST].is_full = true;
	while (o->n_places && o->place[o->first].is_full) {
		o->filled = o->place[o->first].to;
		o->place[o->first].is_full = false;
		o->first = (o->first + 1) % PLACES_MOST;
		o->n_places--;
	}
	if (none_left && o->n_places < PLACES_MOST)
		pthread_cond_broadcast(&o->moved);
	if (ready(o))
		pthread_cond_signal(&o->much);
	pthread_mutex_unlock(&o->lock);
}

void bb_build_output_fail(struct bb_build *b)
{
	pthread_mutex_lock(&b->output->lock);
	b->output->failed = true;
	pthread_cond_broadcast(&b->output->moved);
	pthread_mutex_unlock(&b->output->lock);
}

void bb_build_output_begin(struct bb_build *b)
{
	b->output->turn = 0;
}

size_t bb_build_output_most(const struct bb_build *b)
{
	return b->output->most;
}

uint64_t bb_build_output_end(const struct bb_build *b)
{
	return b->output->given;
}

/* ---- ends ---- */

/* All that was given is in the file, which is no longer than that. */
void bb_build_output_flush(struct bb_build *b)
{
	struct bb_build_output *o = b->output;

	pthread_mutex_lock(&o->lock);
	o->flush = true;
	pthread_cond_signal(&o->much);
	while (!o->failed && o->filled - o->written >= BLOCK)
		pthread_cond_wait(&o->moved, &o->lock);
	o->flush = false;
	const size_t begin = (size_t)(o->written % o->bytes), rest = (size_t)(o->filled - o->written);
	const bool failed = o->failed;
	pthread_mutex_unlock(&o->lock);
	if (failed)
		return;
	memset(o->ring + begin + rest, 0, BLOCK - rest);
	if (rest && !bb_build_pwrite(b, b->fd, o->ring + begin, BLOCK, o->written))
		return;
	if (ftruncate(b->fd, (off_t)o->filled))
		bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
}

void bb_build_output_open(struct bb_build *b, size_t most)
{
	struct bb_build_output *o = b->output = calloc(1, sizeof(*o));

	if (!o) {
		bb_build_fail(b, BB_ERR_NOMEM, 1702, "the result's ring");
		return;
	}
	pthread_mutex_init(&o->lock, NULL);
	pthread_cond_init(&o->moved, NULL);
	pthread_cond_init(&o->much, NULL);
	choose_sizes(b, most, o);
	o->memory = bb_build_alloc(b, o->bytes + o->most + BLOCK, 1, "bricks on their way to the file");
	o->ring = o->memory ? o->memory + -(uintptr_t)o->memory % BLOCK : NULL;
}

void bb_build_output_start(struct bb_build *b, uint64_t at)
{
	struct bb_build_output *o = b->output;

	o->filled = o->given = at;
	o->written = at / BLOCK * BLOCK;
	const size_t before = (size_t)(at - o->written); /* of its first block: written again with the rest */
	if (before && !bb_build_pread(b, b->fd, o->ring + o->written % o->bytes, before, o->written))
		return;
	(void)bb_build_past_cache(b->fd, true); /* else through it */
	o->runs = pthread_create(&o->thread, NULL, write_on, b) == 0;
	if (!o->runs)
		bb_build_fail(b, BB_ERR_NOMEM, 1702, "a thread that writes");
}

void bb_build_output_close(struct bb_build *b)
{
	struct bb_build_output *o = b->output;

	if (!o)
		return;
	pthread_mutex_lock(&o->lock);
	o->stop = true;
	pthread_cond_signal(&o->much);
	pthread_mutex_unlock(&o->lock);
	if (o->runs)
		pthread_join(o->thread, NULL);
	pthread_cond_destroy(&o->much);
	pthread_cond_destroy(&o->moved);
	pthread_mutex_destroy(&o->lock);
	if (b->fd >= 0)
		bb_build_past_cache(b->fd, false);
	bb_build_release(b, o->memory, o->bytes + o->most + BLOCK, 1);
	free(o);
	b->output = NULL;
}
