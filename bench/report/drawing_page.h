/*
 * bench/report/drawing_page.h: a page that is drawn with cairo and becomes SVG or PNG, whichever a file's name says. No
 * state; text becomes outlines, so nothing a file says can reach the page as markup.
 */
#ifndef BB_BENCH_DRAWING_PAGE_H
#define BB_BENCH_DRAWING_PAGE_H

#include <cairo.h>

#include "hal/status.h"

struct bb_page {
	double width, height;                /* points */
	const char *prefix;                  /* of ids inside an <svg>: two drawings of a page must differ */
	void (*paint)(cairo_t *cr, void *ctx); /* may be called on any surface */
	void *ctx;
};

/* As an <svg> element, malloc'ed; NULL: out of memory. The same for the same strokes, always. */
char *bb_page_svg(const struct bb_page *page);
/* Can a file have this name? Before hours are spent on what is to be drawn. 1850: not .svg or .png; 1001: too long. */
BB_MUST_CHECK enum bb_status bb_page_check(const char *file, struct bb_error *err);
/* By the file's extension; written to a temporary name and renamed. 1001, 1850, 1901. */
BB_MUST_CHECK enum bb_status bb_page_write(const struct bb_page *page, const char *file, struct bb_error *err);

#endif
