/*
 * bench/data.h: the data of a scene as a brick file. A file of bricks is opened as it is; anything else, a NIfTI or raw
 * file or a generated sequence, becomes bricks as the scene says first, in a file that has no name any more when
 * this returns and goes when it is closed.
 */
#ifndef BB_BENCH_DATA_H
#define BB_BENCH_DATA_H

#include "hal/scene.h"
#include "render/bricks/bricks.h"

/* 10xx, 14xx. */
BB_MUST_CHECK enum bb_status bb_data_open(const struct bb_scene *scene, struct bb_bricks **out, struct bb_error *err);

#endif
