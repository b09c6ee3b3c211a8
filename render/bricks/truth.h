/*
 * render/bricks/truth.h: a brick file's finest level put together again, as a volume in memory: what a judge of pictures
 * needs to judge any file.
 */
#ifndef BB_RENDER_BRICKS_TRUTH_H
#define BB_RENDER_BRICKS_TRUTH_H

#include "render/bricks/bricks.h"
#include "render/volume/volume.h"

/*
 * Steps first .. first + n_steps - 1 (they become 0 .. n_steps - 1) as single precision, 0..1 of the file's range; the
 * caller's, bb_volume_free. Its last axis goes around where the file's does. cap_bytes bounds all memory taken. 1405,
 * 1441, 1450, 1702; BB_ERR_RANGE: no such steps.
 */
BB_MUST_CHECK enum bb_status bb_volume_of_bricks(const struct bb_bricks *b, uint32_t first, uint32_t n_steps,
						 uint64_t cap_bytes, struct bb_volume **out, struct bb_error *err);

#endif
