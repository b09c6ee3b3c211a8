#include "render/stream/io.h"

#include "render/stream/stream_private.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

/* A slot is taken while its brick is read, so n_slots entries hold every request and every answer there can be. */
struct bb_stream_io {
	struct bb_loader base;
	struct bb_stream *s;
	pthread_t thread;
	pthread_mutex_t lock; /* of everything below; held for copies of a few words only, never while reading */
	pthread_cond_t work, idle;
	struct bb_load *asked; /* ring */
	size_t first, n_asked, cap;
	struct bb_load *ready;
	size_t n_ready;
	bool reading, held, stop;
	struct bb_error error; /* of the last read that failed */
};

static void submit(struct bb_loader *loader, const struct bb_load *loads, size_t n, int64_t now_ns)
{
	struct bb_stream_io *io = bb_container_of(loader, struct bb_stream_io, base);

	(void)now_ns;
	pthread_mutex_lock(&io->lock);
	for (size_t i = 0; i < n; i++)
		io->asked[(io->first + io->n_asked++) % io->cap] = loads[i];
	pthread_cond_signal(&io->work);
	pthread_mutex_unlock(&io->lock);
}

static size_t collect(struct bb_loader *loader, struct bb_load *done, size_t cap, int64_t now_ns)
{
	struct bb_stream_io *io = bb_container_of(loader, struct bb_stream_io, base);

	(void)now_ns;
	pthread_mutex_lock(&io->lock);
	const size_t n = io->n_ready < cap ? io->n_ready : cap;
	memcpy(done, io->ready, n * sizeof(*done));
	memmove(io->ready, io->ready + n, (io->n_ready - n) * sizeof(*done));
	io->n_ready -= n;
	if (io->error.number)
		io->s->error = io->error;
	pthread_mutex_unlock(&io->lock);
	return n;
}

/* With the lock held; lets go of it while bricks are read. Their slots are pending: nobody else touches their memory. */
static void read_some(struct bb_stream_io *io)
{
	struct bb_load batch[BB_READ_MOST];
	struct bb_error err = { 0 };
	size_t n = 0;

	for (; n < BB_READ_MOST && io->n_asked; n++, io->n_asked--) {
		batch[n] = io->asked[io->first];
		io->first = (io->first + 1) % io->cap;
	}
	io->reading = true;
	pthread_mutex_unlock(&io->lock);
	bb_stream_read(io->s, batch, n, &err);
	pthread_mutex_lock(&io->lock);
	memcpy(io->ready + io->n_ready, batch, n * sizeof(*batch));
	io->n_ready += n;
	if (err.number)
		io->error = err;
	io->reading = false;
}

static void *run(void *arg)
{
	struct bb_stream_io *io = arg;

	pthread_mutex_lock(&io->lock);
	while (!io->stop) {
		if (io->n_asked && !io->held) {
			read_some(io);
			continue;
		}
		pthread_cond_broadcast(&io->idle);
		pthread_cond_wait(&io->work, &io->lock);
	}
	pthread_mutex_unlock(&io->lock);
	return NULL;
}

static void release(struct bb_stream_io *io)
{
	pthread_cond_destroy(&io->work);
	pthread_cond_destroy(&io->idle);
	pthread_mutex_destroy(&io->lock);
	free(io->asked);
	free(io->ready);
	free(io);
}

enum bb_status bb_stream_io_start(struct bb_stream *s, struct bb_stream_io **out)
{
	*out = NULL;
	if (s->loader != &s->now)
		return BB_ERR_BUSY;
	struct bb_stream_io *io = calloc(1, sizeof(*io));
	if (!io)
		return BB_ERR_NOMEM;
	io->base = (struct bb_loader){ submit, collect };
	io->s = s;
	io->cap = s->slots.n;
	io->asked = calloc(io->cap, sizeof(*io->asked));
	io->ready = calloc(io->cap, sizeof(*io->ready));
	pthread_mutex_init(&io->lock, NULL);
	pthread_cond_init(&io->work, NULL);
	pthread_cond_init(&io->idle, NULL);
	if (!io->asked || !io->ready || pthread_create(&io->thread, NULL, run, io)) {
		release(io);
		return BB_ERR_NOMEM;
	}
	s->loader = &io->base;
	*out = io;
	return BB_OK;
}

void bb_stream_io_hold(struct bb_stream_io *io, bool held)
{
	pthread_mutex_lock(&io->lock);
	io->held = held;
	pthread_cond_signal(&io->work);
	pthread_mutex_unlock(&io->lock);
}

void bb_stream_io_drain(struct bb_stream_io *io)
{
	pthread_mutex_lock(&io->lock);
	while (io->n_asked || io->reading)
		pthread_cond_wait(&io->idle, &io->lock);
	pthread_mutex_unlock(&io->lock);
}

void bb_stream_io_stop(struct bb_stream_io *io)
{
	struct bb_stream_counts counts = { 0 };

	if (!io)
		return;
	bb_stream_io_hold(io, false);
	bb_stream_io_drain(io);
	pthread_mutex_lock(&io->lock);
	io->stop = true;
	pthread_cond_signal(&io->work);
	pthread_mutex_unlock(&io->lock);
	pthread_join(io->thread, NULL);
	bb_stream_commit(io->s, SIZE_MAX, 0, &counts);
	io->s->loader = &io->s->now;
	release(io);
}
