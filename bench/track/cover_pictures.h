/*
 * bench/track/cover_pictures.h: coverage drawn: clouds of what at least so many cameras see, and slices as heat maps of
 * the expected error. As PNG, as SVG, and together on one page that works offline.
 */
#ifndef BB_BENCH_TRACK_COVER_PICTURES_H
#define BB_BENCH_TRACK_COVER_PICTURES_H

#include "bench/report/drawing_page.h"
#include "bench/track/cover.h"

#define BB_COVER_CLOUDS_MAX 4 /* side by side */

struct bb_cover_clouds { /* one or two covers, a row of clouds each */
	const struct bb_cover *cover[2];
	enum bb_coverage_body body[2];
	const char *title[2];
	size_t n_rows;
	unsigned level[BB_COVER_CLOUDS_MAX];
	size_t n_levels;
};
/* Draws the clouds' pixels; NULL title: none. The page borrows *c and is released by bb_cover_clouds_end. */
struct bb_cloud_page;
BB_MUST_CHECK enum bb_status bb_cover_clouds_begin(const struct bb_cover_clouds *c, struct bb_cloud_page **out,
						   struct bb_page *page);
void bb_cover_clouds_end(struct bb_cloud_page *p);

struct bb_cover_slices {
	const struct bb_cover *cover;
	enum bb_coverage_body body;
	double height_m; /* of the level one; the upright one goes through the middle */
	double least_mm, most_mm; /* of the scale; bb_cover_slices_fit sets both */
};
/* The scale takes in all but the worst few of what the slices show. */
void bb_cover_slices_fit(struct bb_cover_slices *s);
/* Borrows *s. */
struct bb_page bb_cover_slices_page(struct bb_cover_slices *s);

/* One HTML file: the tables and both drawings. */
BB_MUST_CHECK enum bb_status bb_cover_html(const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
					   const unsigned *levels, size_t n_levels, const struct bb_page *clouds,
					   const struct bb_page *slices, const char *path, struct bb_error *err);

#endif
