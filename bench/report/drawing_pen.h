/*
 * bench/report/drawing_pen.h: the few strokes technical drawings are made of, over cairo: lines, labels, dimensions, arrows,
 * a scale bar. Lengths in points of the page. No state of its own.
 */
#ifndef BB_BENCH_DRAWING_PEN_H
#define BB_BENCH_DRAWING_PEN_H

#include <cairo.h>

#include "hal/base.h"

struct pen_colour {
	double r, g, b, a;
};
struct pen_point {
	double x, y;
};
enum pen_anchor { PEN_LEFT, PEN_CENTRE, PEN_RIGHT };

extern const struct pen_colour pen_ink, pen_grey, pen_faint, pen_paper, pen_truth, pen_tracked, pen_camera, pen_door;

struct pen_colour pen_node_colour(size_t node); /* muted, far apart for neighbours */
struct pen_colour pen_alpha(struct pen_colour c, double a);
void pen_set(cairo_t *cr, struct pen_colour c);
void pen_line(cairo_t *cr, struct pen_point a, struct pen_point b, double width, struct pen_colour c);
void pen_rect(cairo_t *cr, double x, double y, double w, double h, struct pen_colour fill, struct pen_colour edge);
/* y is the middle of the capitals. Text that is not UTF-8 is drawn with '?' for each odd byte. */
BB_PRINTF(7, 8)
void pen_text(cairo_t *cr, struct pen_point at, enum pen_anchor anchor, double size, bool bold, struct pen_colour c,
              const char *fmt, ...);
double pen_text_width(cairo_t *cr, double size, const char *text);
/* A dimension line between two points with ticks and its text; turned upright for vertical ones. */
BB_PRINTF(4, 5)
void pen_dimension(cairo_t *cr, struct pen_point a, struct pen_point b, const char *fmt, ...);
/* A bar of a round length: its length in metres is chosen so that it is at most `most` points long. */
void pen_scale_bar(cairo_t *cr, struct pen_point at, double points_per_m, double most);

#endif
