/* render/bricks/build_means.c: what all parts of the builder use: counted reading, writing and memory, and the first
 * failure. */
#define _GNU_SOURCE /* O_DIRECT */
#include "render/bricks/build_private.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER; /* of the first failure */

/* ---- what any thread may call ---- */

void bb_build_fail(struct bb_build *b, enum bb_status status, int number, const char *what)
{
	pthread_mutex_lock(&lock);
	if (!b->status)
		b->status = bb_fail(b->err, status, number, &(struct bb_where){ b->config->path, 0, 0 }, "%s", what);
	pthread_mutex_unlock(&lock);
}

static void count(uint64_t *counter, uint64_t n)
{
	__atomic_fetch_add(counter, n, __ATOMIC_RELAXED);
}

bool bb_build_data(struct bb_build *b, uint32_t step, uint32_t z, uint32_t y, uint32_t n, float *out)
{
	const struct bb_steps *s = b->config->steps;
	struct bb_error err = { 0 };
	const enum bb_status status = bb_steps_rows(s, step, z, y, n, out, &err);

	count(&b->report->bytes_read, s->value_bytes / s->n_steps / s->dim[2] / s->dim[1] * n);
	if (!status)
		return true;
	pthread_mutex_lock(&lock);
	if (!b->status && b->err)
		*b->err = err;
	b->status = b->status ? b->status : status;
	pthread_mutex_unlock(&lock);
	return false;
}

bool bb_build_pread(struct bb_build *b, int fd, void *buf, size_t n, uint64_t at)
{
	count(&b->report->bytes_read, n);
	for (size_t done = 0; done < n;) {
		const ssize_t got = pread(fd, (char *)buf + done, n - done, (off_t)(at + done));
		if (got < 0 && errno == EINTR)
			continue;
		if (got <= 0) {
			bb_build_fail(b, BB_ERR_IO, 1002, got ? strerror(errno) : "a scratch file has become shorter");
			return false;
		}
		done += (size_t)got;
	}
	return true;
}

bool bb_build_past_cache(int fd, bool yes)
{
	const int flags = fcntl(fd, F_GETFL), wanted = yes ? flags | O_DIRECT : flags & ~O_DIRECT;

	return flags >= 0 && flags != wanted && fcntl(fd, F_SETFL, wanted) == 0;
}

bool bb_build_pwrite(struct bb_build *b, int fd, const void *buf, size_t n, uint64_t at)
{
	count(&b->report->bytes_written, n);
	count(&b->since_checkpoint, n);
	for (size_t done = 0; done < n;) {
		const ssize_t put = pwrite(fd, (const char *)buf + done, n - done, (off_t)(at + done));
		if (put < 0 && errno == EINTR)
			continue;
		if (put < 0 && errno == EINVAL && bb_build_past_cache(fd, false)) /* not this file system, or not so */
			continue;
		if (put <= 0) {
			bb_build_fail(b, BB_ERR_IO, 1901, strerror(errno));
			return false;
		}
		done += (size_t)put;
	}
	return true;
}

/* ---- memory ---- */

void *bb_build_alloc(struct bb_build *b, size_t n, size_t bytes, const char *what)
{
	uint64_t wanted;
	char text[160];

	if (b->status)
		return NULL;
	if (__builtin_mul_overflow((uint64_t)n, (uint64_t)bytes, &wanted))
		wanted = UINT64_MAX / 2;
	if (b->held_bytes + wanted > b->config->memory_bytes) {
		snprintf(text, sizeof(text), "%s: %llu MiB are wanted, %llu of %llu are taken", what,
			 (unsigned long long)(wanted >> 20) + 1, (unsigned long long)(b->held_bytes >> 20),
			 (unsigned long long)(b->config->memory_bytes >> 20));
		bb_build_fail(b, BB_ERR_CONFIG, 1447, text);
		return NULL;
	}
	void *p = calloc(n ? n : 1, bytes);
	if (!p) {
		bb_build_fail(b, BB_ERR_NOMEM, 1702, what);
		return NULL;
	}
	const size_t page = 2u << 20, begin = ((uintptr_t)p + page - 1) / page * page - (uintptr_t)p;
	if (wanted > 2 * page) /* walks across planes miss the TLB with every row otherwise */
		(void)madvise((char *)p + begin, (wanted - begin) / page * page, MADV_HUGEPAGE);
	b->held_bytes += wanted;
	if (b->held_bytes > b->report->peak_bytes)
		b->report->peak_bytes = b->held_bytes;
	return p;
}

void bb_build_release(struct bb_build *b, void *p, size_t n, size_t bytes)
{
	if (p)
		b->held_bytes -= (uint64_t)n * bytes;
	free(p);
}
