/*
 * tests/fuzz/fuzz_bricks_header.c: any bytes as a brick file's header, index and moments, opened. Of the header's page
 * the first 320 bytes are the input's, behind its page comes the rest of the input; one of less than eight bytes is a
 * file of less than a header. The file that is opened is one of holes: its bytes are in memory, and
 * render/bricks/bricks_file.c's reading stands here for that. What opens keeps every promise that bricks are read by.
 */
#define _GNU_SOURCE /* memfd_create */
#include <math.h>
#include <stdio.h>
#include <sys/mman.h>
#include <unistd.h>

#include "render/bricks/bricks_private.h"
#include "tests/fuzz/fuzz.h"

#define HEAD_BYTES 320

static uint8_t file[BB_BRICKS_HEADER_BYTES + 2048];

ssize_t bb_bricks_file_read(int fd, void *buf, size_t n, uint64_t at)
{
	(void)fd;
	if (at >= sizeof(file))
		return 0;
	n = n < sizeof(file) - at ? n : sizeof(file) - at;
	memcpy(buf, file + at, n);
	return (ssize_t)n;
}

static bool within(const struct bb_bricks_record *r, uint64_t n)
{
	return r->offset >= BB_BRICKS_HEADER_BYTES && r->offset <= n && r->bytes <= n - r->offset;
}

static void keeps_its_promises(const struct bb_bricks *b, uint64_t n)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);

	fuzz_must(h->tree.n_bricks && h->tree.n_bricks <= n / (BB_BRICKS_INDEX_BYTES + BB_BRICKS_MOMENTS_BYTES));
	fuzz_must(h->tree.n_bricks == (uint64_t)h->tree.n_nodes * h->tree.n_times);
	fuzz_must(bb_bricks_brick_bytes(h) && bb_bricks_brick_bytes(h) <= 68u * 68 * 68 * 4);
	fuzz_must(h->most >= h->least && isfinite(h->most - h->least));
	fuzz_must(memchr(h->name, 0, sizeof(h->name)) != NULL);
	fuzz_must(bb_brick_type_text(h->type) && bb_brick_codec_text(h->codec));
	for (uint64_t i = 0; i < h->tree.n_bricks; i++) {
		const struct bb_bricks_moments *m = &bb_bricks_moments(b)[i];
		fuzz_must(within(&bb_bricks_index(b)[i], n) && within(&m->histograms, n));
		fuzz_must(m->histograms.bytes <= BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST);
		fuzz_must(isfinite(m->mean) && m->deviation >= 0 && m->least <= m->most && m->leaf_error >= 0);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static char path[64];
	static int fd = -1; /* made once */
	const size_t head = size < HEAD_BYTES ? size : HEAD_BYTES;
	const size_t tail = size - head < 2048 ? size - head : 2048;
	const size_t n = size < 8 ? size * 512 : BB_BRICKS_HEADER_BYTES + tail;
	struct bb_bricks *b = NULL;
	struct bb_error err = { 0 };

	if (fd < 0) {
		fd = memfd_create("fuzz", MFD_CLOEXEC);
		snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	}
	memset(file, 0, HEAD_BYTES);
	memcpy(file, data, head);
	memcpy(file + BB_BRICKS_HEADER_BYTES, data + head, tail);
	fuzz_must(fd >= 0 && !ftruncate(fd, (off_t)n));
	if (bb_bricks_open(path, &b, &err) == BB_OK)
		keeps_its_promises(b, n);
	else
		fuzz_must(!b && err.number >= 1000);
	bb_bricks_close(b);
	return 0;
}
