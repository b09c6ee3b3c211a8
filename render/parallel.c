#include "render/parallel.h"

#include <pthread.h>
#include <stdatomic.h>
#include <unistd.h>

struct job {
	void (*each)(void *ctx, size_t i, unsigned thread);
	void *ctx;
	size_t n;
	atomic_size_t next;
};

struct worker {
	struct job *job;
	unsigned index;
	pthread_t thread;
	bool started;
};

static void *work(void *arg)
{
	struct worker *w = arg;
	size_t i;

	while ((i = atomic_fetch_add(&w->job->next, 1)) < w->job->n)
		w->job->each(w->job->ctx, i, w->index);
	return NULL;
}

void bb_parallel(unsigned threads, size_t n, void (*each)(void *ctx, size_t i, unsigned thread), void *ctx)
{
	struct job job = { each, ctx, n, 0 };
	struct worker workers[BB_PARALLEL_MOST];

	if (threads > BB_PARALLEL_MOST)
		threads = BB_PARALLEL_MOST;
	if (threads > n)
		threads = n ? (unsigned)n : 1;
	for (unsigned i = 0; i < threads; i++)
		workers[i] = (struct worker){ .job = &job, .index = i };
	for (unsigned i = 1; i < threads; i++)
		workers[i].started = pthread_create(&workers[i].thread, NULL, work, &workers[i]) == 0;
	if (threads)
		work(&workers[0]);
	for (unsigned i = 1; i < threads; i++)
		if (workers[i].started)
			pthread_join(workers[i].thread, NULL);
}

unsigned bb_parallel_processors(void)
{
	const long n = sysconf(_SC_NPROCESSORS_ONLN);

	return n < 1 ? 1 : n > BB_PARALLEL_MOST ? BB_PARALLEL_MOST : (unsigned)n;
}
