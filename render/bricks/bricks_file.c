/*
 * render/bricks/bricks_file.c: the system calls of brick files, and nothing else: a fuzz target has its own. The file is
 * never mapped: one that shrinks would be a SIGBUS, here it is a short read.
 */
#define _GNU_SOURCE /* preadv2, syscall */
#include <fcntl.h>
#include <linux/aio_abi.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include "render/bricks/bricks_private.h"

#define SYS_CACHESTAT 451L /* on every processor that Debian 12 is for */
#define PAGE_BYTES 4096u

ssize_t bb_bricks_file_read(int fd, void *buf, size_t n, uint64_t at)
{
	return pread(fd, buf, n, (off_t)at);
}

ssize_t bb_bricks_file_peek(int fd, void *buf, size_t n, uint64_t at)
{
	return preadv2(fd, &(struct iovec){ buf, n }, 1, (off_t)at, RWF_NOWAIT);
}

int bb_bricks_file_cached(int fd, size_t n, uint64_t at)
{
	const uint64_t from = at / PAGE_BYTES * PAGE_BYTES, pages = (at + n - from + PAGE_BYTES - 1) / PAGE_BYTES;
	const struct {
		uint64_t from, bytes;
	} range = { from, pages * PAGE_BYTES };
	struct { /* linux/mman.h since 6.5 */
		uint64_t cached, dirty, written, evicted, recently;
	} found = { 0 };

	if (syscall(SYS_CACHESTAT, fd, &range, &found, 0))
		return -1;
	return found.cached >= pages;
}

bool bb_bricks_file_queue(unsigned depth, unsigned long *queue)
{
	*queue = 0;
	return syscall(SYS_io_setup, depth, queue) == 0;
}

void bb_bricks_file_unqueue(unsigned long queue)
{
	(void)syscall(SYS_io_destroy, queue);
}

bool bb_bricks_file_begin(unsigned long queue, int fd, void *buf, size_t n, uint64_t at, uint64_t tag)
{
	struct iocb read = { .aio_data = tag,
			     .aio_lio_opcode = IOCB_CMD_PREAD,
			     .aio_fildes = (uint32_t)fd,
			     .aio_buf = (uintptr_t)buf,
			     .aio_nbytes = n,
			     .aio_offset = (int64_t)at };

	return syscall(SYS_io_submit, queue, 1L, (struct iocb *[]){ &read }) == 1;
}

uint64_t bb_bricks_file_end(unsigned long queue, int64_t *got)
{
	struct io_event event = { 0 };

	while (syscall(SYS_io_getevents, queue, 1L, 1L, &event, NULL) != 1)
		; /* a signal; nothing else can come between */
	*got = event.res;
	return event.data;
}
