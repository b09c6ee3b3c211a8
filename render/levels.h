/*
 * render/levels.h: how fine each part of a picture is: a volume's cells in the colour of their brick's level, the nearer
 * ones in front, as far as the transfer function shows anything of them. Between two steps it shows the one that counts
 * for more. A picture to look at; not exact.
 */
#ifndef BB_RENDER_LEVELS_H
#define BB_RENDER_LEVELS_H

#include "render/renderer.h"

#define BB_LEVELS_COLOURS 6 /* levels above the leaves; the last one is for all beyond */

extern const char *const bb_levels_colour[BB_LEVELS_COLOURS]; /* "#rrggbb" */
/* The image's size is the picture's. Colour premultiplied over black. BB_ERR_RANGE: no size. */
BB_MUST_CHECK enum bb_status bb_levels_draw(const struct bb_view *view, const struct bb_layer *layer, struct bb_image *image);

#endif
