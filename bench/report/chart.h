/*
 * bench/report/chart.h: x against y as an engineer reads it: axes with units and round ticks, linear or logarithmic (values
 * of zero stand before the break), points, lines, and labels that are left out rather than drawn over each other. No state.
 */
#ifndef BB_BENCH_CHART_H
#define BB_BENCH_CHART_H

#include "bench/report/drawing_pen.h"

enum chart_scale { CHART_LINEAR, CHART_DECADES, CHART_OCTAVES };
enum chart_mark { CHART_NONE, CHART_DOT, CHART_RING, CHART_DIAMOND, CHART_SQUARE };

struct chart_series {
	const char *name; /* in the legend; NULL: not there */
	struct pen_colour colour;
	const double *x, *y; /* pairs that are not finite are left out */
	size_t n;
	double width; /* of the line through the points; 0: none */
	bool stairs;  /* it goes along x first: a front */
	bool dashed;
	enum chart_mark mark;
};

struct chart_label {
	double x, y;
	char text[48];
};

struct chart {
	const char *title, *x_title, *y_title;
	enum chart_scale x_scale, y_scale;
	bool y_held; /* between y_low and y_high, not by the data */
	double y_low, y_high;
	const struct chart_series *series;
	size_t n_series;
	const struct chart_label *labels; /* the first ones go first */
	size_t n_labels;
};

/* In a box of the page, titles and ticks included; the legend is drawn apart. */
void chart_draw(cairo_t *cr, const struct chart *c, double left, double top, double width, double height);
/* Names of the series in one row from left; returns where it ends. */
double chart_legend(cairo_t *cr, const struct chart_series *series, size_t n, double left, double y);

#endif
