/* render/bricks/bricks_private.h: an open brick file, as its readers share it. Never written after it is open. */
#ifndef BB_RENDER_BRICKS_PRIVATE_H
#define BB_RENDER_BRICKS_PRIVATE_H

#include <sys/types.h>

#include "render/bricks/bricks.h"

struct bb_bricks {
	char path[BB_PATH_MAX_BYTES];
	int fd;
	uint64_t file_bytes; /* when it was opened; it may have changed since, so every read counts what it gets */
	struct bb_bricks_header h;
	struct bb_bricks_record *index;
	struct bb_bricks_moments *moments;
};

/* As pread. */
ssize_t bb_bricks_file_read(int fd, void *buf, size_t n, uint64_t at);
/* As pread of what is in the page cache; EAGAIN: nothing of it is; another error: such a read cannot be asked for. */
ssize_t bb_bricks_file_peek(int fd, void *buf, size_t n, uint64_t at);
/* Is all of it in the page cache? 1, 0; -1: that cannot be asked. Unlike peeking it never makes the kernel read ahead. */
int bb_bricks_file_cached(int fd, size_t n, uint64_t at);
/* Reads under way at once, at most `depth`. false: this kernel has none to give. */
bool bb_bricks_file_queue(unsigned depth, unsigned long *queue);
void bb_bricks_file_unqueue(unsigned long queue); /* waits for what is under way */
/* As pread, but it may come later; false: it has not begun. */
bool bb_bricks_file_begin(unsigned long queue, int fd, void *buf, size_t n, uint64_t at, uint64_t tag);
/* Waits for any that has begun: its tag, and what pread would have returned (below 0: no more than that it failed). */
uint64_t bb_bricks_file_end(unsigned long queue, int64_t *got);

#endif
