/*
 * bench/loop/seeing.h: blobs of cameras that deliver pictures (limits.grey): one finder a camera, one picture at a time.
 * All memory is taken at creation. One thread.
 */
#ifndef BB_BENCH_SEEING_H
#define BB_BENCH_SEEING_H

#include "hal/camera.h"

struct bb_seeing;
/* *out stays NULL where no camera (entries may be NULL) delivers pictures. */
BB_MUST_CHECK enum bb_status bb_seeing_create(const struct bb_camera_config *configs, struct bb_camera *const *cameras,
                                              size_t n, struct bb_seeing **out, struct bb_error *err);
void bb_seeing_destroy(struct bb_seeing *s);
/* As bb_camera_read; a picture is turned into the frame's blobs. s may be NULL. */
BB_MUST_CHECK enum bb_status bb_seeing_read(struct bb_seeing *s, size_t camera, struct bb_camera *cam,
                                            struct bb_camera_frame *frame);

#endif
