/*
 * bench/pictures.h: the pictures a scene asks for: drawn from the node's own bricks at that frame, compared with the
 * same view at full resolution, written as PNG into the result folder.
 */
#ifndef BB_BENCH_PICTURES_H
#define BB_BENCH_PICTURES_H

#include "bench/result.h"
#include "render/stream/stream.h"

struct bb_pictures;

struct bb_pictures_config {
	const struct bb_room *room;
	const struct bb_scene *scene;
	const char *dir;               /* NULL: measured, not written */
	struct bb_renderer *renderer;  /* NULL for calibration scenes */
	struct bb_stream *full;        /* every brick resident; NULL: no PSNR */
};
BB_MUST_CHECK enum bb_status bb_pictures_create(const struct bb_pictures_config *config, struct bb_pictures **out);
void bb_pictures_destroy(struct bb_pictures *p);
/* Is a picture due at this scene time (the first frame at or after each at_s)? Call once per frame. */
bool bb_pictures_due(struct bb_pictures *p, double scene_s);
bool bb_pictures_wants(const struct bb_pictures *p, uint16_t wall);
/* From now on pictures are so bright (1: as drawn), and show the scene's patch as at this time. */
void bb_pictures_fade(struct bb_pictures *p, double light, double scene_s);
/* Draws one screen for one eye (0 left, 1 right; n_eyes 1: mono). stream NULL: calibration with the cursor. */
BB_MUST_CHECK enum bb_status bb_pictures_take(struct bb_pictures *p, uint16_t screen, unsigned eye, unsigned n_eyes,
                                              const struct bb_view *view, const struct bb_stream *stream,
                                              const struct bb_vec3 *cursor, struct bb_error *err);
size_t bb_pictures_count(const struct bb_pictures *p, const struct bb_picture_result **out);

#endif
