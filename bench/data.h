/*
 * bench/data.h: the data of a scene as a brick file. A file of bricks is opened as it is; anything else, a NIfTI or raw
 * file or a generated sequence, becomes bricks as the scene says first, in a file that has no name any more when
 * this returns and goes when it is closed.
 */
#ifndef BB_BENCH_DATA_H
#define BB_BENCH_DATA_H

#include "hal/scene.h"
#include "render/bricks/bricks.h"
#include "render/volume/steps.h"

/* 10xx, 14xx. */
BB_MUST_CHECK enum bb_status bb_data_open(const struct bb_scene *scene, struct bb_bricks **out, struct bb_error *err);

/* The same in its parts, for those who need other bricks of it. A folder of its own for what is unpacked or built (the
 * caller removes it); the scene's steps, which must not be a brick file; a brick file of them without a name. */
bool bb_data_is_bricks(const struct bb_scene *scene);
BB_MUST_CHECK enum bb_status bb_data_folder(char *dir, size_t cap, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_data_steps(const struct bb_scene *scene, const char *scratch, struct bb_steps **out,
					   struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_data_build(struct bb_steps *steps, uint32_t edge, enum bb_brick_type type,
					   const char *dir, struct bb_bricks **out, struct bb_error *err);

#endif
