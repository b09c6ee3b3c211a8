/* render/bricks/bricks_private.h: an open brick file, as its readers share it. Never written after it is open. */
#ifndef BB_RENDER_BRICKS_PRIVATE_H
#define BB_RENDER_BRICKS_PRIVATE_H

#include "render/bricks/bricks.h"

struct bb_bricks {
	char path[BB_PATH_MAX_BYTES];
	int fd;
	uint64_t file_bytes; /* when it was opened; it may have changed since, so every read counts what it gets */
	struct bb_bricks_header h;
	struct bb_bricks_record *index;
	struct bb_bricks_moments *moments;
};

#endif
