/*
 * render/stream/disk.c: the model of a disk: bricks come one after another, by a time of the disk's own that stands still
 * while it stalls. Their bytes are in the slot from the beginning; nobody looks at a slot that is pending.
 */
#include <stdlib.h>
#include <string.h>

#include "render/stream/io.h"
#include "render/stream/stream_private.h"

struct bb_stream_disk {
	struct bb_loader base;
	struct bb_stream *s;
	double read_ns, byte_ns;
	double disk_ns, free_ns; /* its own time; when it has done all that it was asked for */
	int64_t seen_ns;         /* up to here disk_ns has gone on */
	bool stalled;
	struct bb_load *queue; /* in the order of coming */
	double *ready_ns;
	size_t n, cap;
};

static void go_on(struct bb_stream_disk *d, int64_t now_ns)
{
	if (!d->stalled && now_ns > d->seen_ns)
		d->disk_ns += (double)(now_ns - d->seen_ns);
	d->seen_ns = now_ns > d->seen_ns ? now_ns : d->seen_ns;
}

static void submit(struct bb_loader *loader, const struct bb_load *loads, size_t n, int64_t now_ns)
{
	struct bb_stream_disk *d = bb_container_of(loader, struct bb_stream_disk, base);
	const double each_ns = d->read_ns + d->byte_ns * (double)d->s->atlas.slot_bytes;

	go_on(d, now_ns);
	d->free_ns = d->free_ns > d->disk_ns ? d->free_ns : d->disk_ns;
	memcpy(d->queue + d->n, loads, n * sizeof(*loads));
	for (size_t i = 0; i < n; i += BB_READ_MOST)
		bb_stream_read(d->s, d->queue + d->n + i, n - i < BB_READ_MOST ? n - i : BB_READ_MOST, &d->s->error);
	for (size_t i = 0; i < n; i++)
		d->ready_ns[d->n + i] = d->free_ns += each_ns;
	d->n += n;
}

static size_t collect(struct bb_loader *loader, struct bb_load *done, size_t cap, int64_t now_ns)
{
	struct bb_stream_disk *d = bb_container_of(loader, struct bb_stream_disk, base);
	size_t n = 0;

	go_on(d, now_ns);
	while (n < d->n && n < cap && d->ready_ns[n] <= d->disk_ns)
		n++;
	memcpy(done, d->queue, n * sizeof(*done));
	d->n -= n;
	memmove(d->queue, d->queue + n, d->n * sizeof(*d->queue));
	memmove(d->ready_ns, d->ready_ns + n, d->n * sizeof(*d->ready_ns));
	return n;
}

enum bb_status bb_stream_disk_start(struct bb_stream *s, double read_ns, double byte_ns, struct bb_stream_disk **out)
{
	*out = NULL;
	if (s->loader != &s->now)
		return BB_ERR_BUSY;
	struct bb_stream_disk *d = calloc(1, sizeof(*d));
	if (!d)
		return BB_ERR_NOMEM;
	*d = (struct bb_stream_disk){ .base = { submit, collect }, .s = s, .read_ns = read_ns, .byte_ns = byte_ns };
	d->cap = s->slots.n; /* a slot is taken while its brick is on the way */
	d->queue = calloc(d->cap, sizeof(*d->queue));
	d->ready_ns = calloc(d->cap, sizeof(*d->ready_ns));
	if (!d->queue || !d->ready_ns) {
		free(d->queue);
		free(d->ready_ns);
		free(d);
		return BB_ERR_NOMEM;
	}
	s->loader = &d->base;
	*out = d;
	return BB_OK;
}

void bb_stream_disk_stall(struct bb_stream_disk *d, bool stalled, int64_t now_ns)
{
	go_on(d, now_ns);
	d->stalled = stalled;
}

void bb_stream_disk_stop(struct bb_stream_disk *d)
{
	struct bb_stream_counts counts = { 0 };

	if (!d)
		return;
	d->stalled = false;
	d->disk_ns = d->free_ns;
	bb_stream_commit(d->s, SIZE_MAX, d->seen_ns, &counts);
	d->s->loader = &d->s->now;
	free(d->queue);
	free(d->ready_ns);
	free(d);
}
