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
/* These bytes will be read: fetch them meanwhile. Nothing is owed. */
void bb_bricks_file_expect(int fd, size_t n, uint64_t at);

#endif
