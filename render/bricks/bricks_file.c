/*
 * render/bricks/bricks_file.c: the system calls of brick files, and nothing else: a fuzz target has its own. The file is
 * never mapped: one that shrinks would be a SIGBUS, here it is a short read.
 */
#define _GNU_SOURCE /* preadv2 */
#include <fcntl.h>
#include <sys/uio.h>
#include <unistd.h>

#include "render/bricks/bricks_private.h"

ssize_t bb_bricks_file_read(int fd, void *buf, size_t n, uint64_t at)
{
	return pread(fd, buf, n, (off_t)at);
}

ssize_t bb_bricks_file_peek(int fd, void *buf, size_t n, uint64_t at)
{
	return preadv2(fd, &(struct iovec){ buf, n }, 1, (off_t)at, RWF_NOWAIT);
}

void bb_bricks_file_expect(int fd, size_t n, uint64_t at)
{
	(void)posix_fadvise(fd, (off_t)at, (off_t)n, POSIX_FADV_WILLNEED);
}
