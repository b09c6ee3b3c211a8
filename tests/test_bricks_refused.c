/*
 * tests/test_bricks_refused.c: a file system that opens files for direct reads and then refuses them, at once or after a
 * while, with reads under way or one by one: bricks come through the page cache then. The functions of
 * render/bricks/bricks_file.c stand here for such a one.
 */
#define _GNU_SOURCE /* O_DIRECT */
#include "render/bricks/bricks_private.h"
#include "tests/brick_rig.h"

#include <errno.h>
#include <fcntl.h>

static struct {
	bool has_queue;
	unsigned left; /* direct reads that it lets through */
	unsigned refused, plain;
	struct {
		uint64_t tag;
		int64_t got;
	} over[64];
	size_t n_over;
} disk;

ssize_t bb_bricks_file_read(int fd, void *buf, size_t n, uint64_t at)
{
	const bool direct = fcntl(fd, F_GETFL) & O_DIRECT;

	if (direct && !disk.left) {
		disk.refused++;
		errno = EINVAL;
		return -1;
	}
	disk.left -= direct;
	disk.plain += !direct;
	return pread(fd, buf, n, (off_t)at);
}

ssize_t bb_bricks_file_peek(int fd, void *buf, size_t n, uint64_t at)
{
	(void)fd;
	(void)buf;
	(void)n;
	(void)at;
	errno = EAGAIN;
	return -1;
}

int bb_bricks_file_cached(int fd, size_t n, uint64_t at)
{
	(void)fd;
	(void)n;
	(void)at;
	return 0;
}

bool bb_bricks_file_queue(unsigned depth, unsigned long *queue)
{
	*queue = 1;
	return disk.has_queue && depth <= BB_ARRAY_LEN(disk.over);
}

void bb_bricks_file_unqueue(unsigned long queue)
{
	(void)queue;
}

bool bb_bricks_file_begin(unsigned long queue, int fd, void *buf, size_t n, uint64_t at, uint64_t tag)
{
	(void)queue;
	disk.over[disk.n_over].tag = tag;
	disk.over[disk.n_over++].got = bb_bricks_file_read(fd, buf, n, at);
	return true;
}

uint64_t bb_bricks_file_end(unsigned long queue, int64_t *got)
{
	(void)queue;
	*got = disk.over[--disk.n_over].got;
	return disk.over[disk.n_over].tag;
}

static void refused_reads_come_through_the_page_cache(void **state)
{
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 40, 40, 40, 2, 8);
	struct bb_bricks *b = rig_build(&r);
	const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b)), n = bb_bricks_header(b)->tree.n_bricks / 3;
	struct bb_bricks_want *wants = calloc(n, sizeof(*wants));
	uint8_t *out = malloc(n * n_brick), *alone = malloc(n_brick);
	assert_true(wants && out && alone);
	for (unsigned i = 0; i < 8; i++) {
		struct bb_bricks_reader *reader;
		disk.has_queue = i % 2;
		disk.left = i / 2 * 3;
		disk.refused = disk.plain = 0;
		assert_int_equal(bb_bricks_reader_create(b, 16, BB_BRICKS_CACHED, &reader, NULL), BB_OK);
		for (size_t k = 0; k < n; k++)
			wants[k] = (struct bb_bricks_want){ .brick = 3 * k, .out = out + k * n_brick };
		assert_int_equal(bb_bricks_read_many(reader, wants, n, NULL), BB_OK);
		const unsigned plain = disk.plain;
		for (size_t k = 0; k < n; k++) {
			assert_int_equal(bb_bricks_read(b, wants[k].brick, alone, NULL), BB_OK);
			assert_memory_equal(wants[k].out, alone, n_brick);
		}
		print_message("%s, %u let through: %u refused, %u through the page cache\n",
			      disk.has_queue ? "under way together" : "one by one", i / 2 * 3, disk.refused, plain);
		assert_true(disk.refused > 0 && disk.refused <= 64 && plain > 0 && disk.left == 0); /* it learns */
		bb_bricks_reader_destroy(reader);
	}
	free(wants);
	free(out);
	free(alone);
	bb_bricks_close(b);
	rig_end(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(refused_reads_come_through_the_page_cache),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
