/*
 * bench/report/room_drawing.h: a room drawn to scale: from above, from the left side, and its walls unrolled with the node
 * that draws each tile. One drawing for `room draw` and for the report. No state; text becomes outlines, so nothing a
 * file says can reach the page as markup.
 */
#ifndef BB_BENCH_ROOM_DRAWING_H
#define BB_BENCH_ROOM_DRAWING_H

#include "bench/result.h"

/*
 * The drawing as an <svg> element, malloc'ed, for a page or a file; NULL: out of memory. path may be NULL: the head's
 * way, truth and tracked, points that are not finite are left out. Ids inside begin with "room-".
 */
char *bb_room_drawing_svg(const struct bb_room *room, const struct bb_path_point *path, size_t n_path);
/* By the file's extension, .svg or .png (error 1850 for another); written to a temporary name and renamed. */
BB_MUST_CHECK enum bb_status bb_room_drawing_write(const struct bb_room *room, const char *file, struct bb_error *err);
/*
 * Give back what cairo and fontconfig keep for the life of a process (a leak checker counts it). Last thing in main();
 * nothing may be drawn afterwards.
 */
void bb_drawing_forget_fonts(void);

#endif
