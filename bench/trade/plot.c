/*
 * bench/trade/plot.c: quality against frame time, quality against bytes streamed: every setting a dot in the colour of what
 * was changed, the front as stairs with the names of what stands on it.
 */
#include "bench/trade/tell.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/file.h"
#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"

#define PAGE_WIDTH 1240.0
#define PAGE_HEIGHT 560.0
#define EXACT_DB 100.0 /* more than 8 bits of a few pixels can say: equal pictures are drawn here */

/* Hues that stay apart for most eyes; the scene's own setting in ink. */
static const struct pen_colour colours[BB_KNOBS + 1] = {
	{ 0.00, 0.45, 0.70, 1 }, { 0.00, 0.62, 0.45, 1 }, { 0.84, 0.37, 0.00, 1 }, { 0.80, 0.47, 0.65, 1 },
	{ 0.90, 0.62, 0.00, 1 }, { 0.34, 0.71, 0.91, 1 }, { 0.50, 0.40, 0.30, 1 }, { 0.13, 0.15, 0.18, 1 },
};

struct panel {
	struct chart chart;
	struct chart_series series[BB_KNOBS + 3];
	double *x, *y; /* of each knob behind the other, then of the front */
	struct chart_label *label;
};

struct page {
	const struct bb_trade_told *told;
	struct panel panel[2];
};

static double cost_of(const struct bb_trade_point *p, bool bytes)
{
	return bytes ? p->bytes_mean / 1024 : p->frame_ms;
}

static double quality_of(const struct bb_trade_point *p)
{
	return p->failed ? (double)NAN : fmin(p->psnr_db, EXACT_DB);
}

/* What was changed, or all that tells settings of a full grid apart. */
static void name_of(const struct bb_trade_point *p, bool full, char *out, size_t cap)
{
	const struct bb_trade_setting *s = &p->setting;
	char budget[32] = "no budget";

	if (s->memory_mib > 0)
		bb_text_format(budget, sizeof(budget), "%.3g MiB", s->memory_mib);
	if (full)
		bb_text_format(out, cap, "%s %s, step %.3g, %u^3 %s", s->selector->name, budget, s->step_voxels, s->brick,
			       bb_brick_type_text(s->type));
	else if (p->knob == BB_KNOB_MEMORY)
		bb_text_format(out, cap, "%s", budget);
	else if (p->knob == BB_KNOB_STREAM && !s->bricks_per_frame)
		bb_text_format(out, cap, "no limit");
	else if (p->knob == BB_KNOB_STREAM)
		bb_text_format(out, cap, "%u bricks", s->bricks_per_frame);
	else if (p->knob == BB_KNOB_TOLERANCE)
		bb_text_format(out, cap, "tolerance %.3g", s->tolerance);
	else if (p->knob == BB_KNOB_STEP)
		bb_text_format(out, cap, "step %.3g", s->step_voxels);
	else if (p->knob == BB_KNOB_BRICK)
		bb_text_format(out, cap, "%u^3", s->brick);
	else
		bb_text_format(out, cap, "%s", p->knob == BB_KNOB_TYPE       ? bb_brick_type_text(s->type)
					       : p->knob == BB_KNOB_SELECTOR ? s->selector->name
									     : "the scene's own");
}

static int by_cost(const void *a, const void *b)
{
	const double *p = a, *q = b;

	return p[0] < q[0] ? -1 : p[0] > q[0] ? 1 : p[1] < q[1] ? -1 : p[1] > q[1];
}

/* The front in the order of its costs; labels from the best down. */
static void front(const struct bb_trade_told *t, bool bytes, struct panel *p, double *pairs)
{
	struct chart_series *s = &p->series[BB_KNOBS + 1];
	double *x = p->x + t->n, *y = p->y + t->n;
	size_t n = 0;

	for (size_t i = 0; i < t->n; i++) {
		const struct bb_trade_point *q = &t->point[i];
		if (!(bytes ? q->on_bytes_front : q->on_time_front))
			continue;
		pairs[2 * n] = cost_of(q, bytes);
		pairs[2 * n++ + 1] = quality_of(q);
		struct chart_label *l = &p->label[p->chart.n_labels++];
		l->x = cost_of(q, bytes);
		l->y = quality_of(q);
		name_of(q, t->full, l->text, sizeof(l->text));
	}
	qsort(pairs, n, 2 * sizeof(*pairs), by_cost);
	for (size_t i = 0; i < n; i++) {
		x[i] = pairs[2 * i];
		y[i] = pairs[2 * i + 1];
	}
	*s = (struct chart_series){ .name = "Pareto front", .colour = pen_ink, .x = x, .y = y, .n = n, .width = 1.3, .stairs = true,
				    .mark = CHART_RING };
	for (size_t i = 0; i < t->n && !t->full; i++) { /* the others, where there is room */
		const struct bb_trade_point *q = &t->point[i];
		if ((bytes ? q->on_bytes_front : q->on_time_front) || q->failed)
			continue;
		struct chart_label *l = &p->label[p->chart.n_labels++];
		l->x = cost_of(q, bytes);
		l->y = quality_of(q);
		name_of(q, t->full, l->text, sizeof(l->text));
	}
}

static void fill(const struct bb_trade_told *t, bool bytes, struct panel *p, double *pairs)
{
	size_t at = 0;

	for (int k = 0; k <= BB_KNOBS; k++) {
		p->series[k] = (struct chart_series){ .name = bb_trade_knob_text((enum bb_trade_knob)k), .colour = colours[k],
						      .x = p->x + at, .y = p->y + at,
						      .mark = k == BB_KNOB_NONE ? CHART_DIAMOND : CHART_DOT };
		for (size_t i = 0; i < t->n; i++) {
			if ((int)t->point[i].knob != k || t->point[i].failed)
				continue;
			p->x[at] = cost_of(&t->point[i], bytes);
			p->y[at++] = quality_of(&t->point[i]);
			p->series[k].n++;
		}
	}
	p->chart = (struct chart){ .title = bytes ? "Quality against what is streamed" : "Quality against frame time",
				   .x_title = bytes ? "streamed, KiB a frame" : "select, read and draw, ms a frame",
				   .y_title = "PSNR, dB",
				   .x_scale = CHART_DECADES,
				   .series = p->series,
				   .n_series = BB_KNOBS + 2,
				   .labels = p->label };
	front(t, bytes, p, pairs);
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct page *page = ctx;
	const struct bb_trade_told *t = page->told;

	pen_set(cr, pen_paper);
	cairo_paint(cr);
	pen_text(cr, (struct pen_point){ 24, 26 }, PEN_LEFT, 16, true, pen_ink, "What %s trades", t->name);
	pen_text(cr, (struct pen_point){ 24, 47 }, PEN_LEFT, 11, false, pen_grey,
	         "%s; %u frames at %d Hz, %u pictures of %u x %u; compared with %s", t->data, t->n_frames, BB_TRADE_RATE_HZ,
	         t->n_drawn, t->width_px, t->height_px, t->reference);
	pen_text(cr, (struct pen_point){ 24, 70 }, PEN_LEFT, 11, true, pen_ink, "changed:");
	chart_legend(cr, page->panel[0].series, BB_KNOBS + 2, 84, 70);
	chart_draw(cr, &page->panel[0].chart, 14, 88, 606, PAGE_HEIGHT - 96);
	chart_draw(cr, &page->panel[1].chart, 624, 88, 606, PAGE_HEIGHT - 96);
}

enum bb_status bb_trade_plot(const struct bb_trade_told *t, const char *path, struct bb_error *err)
{
	struct page page = { .told = t };
	const struct bb_page out = { PAGE_WIDTH, PAGE_HEIGHT, "trade-", paint, &page };
	double *pairs = calloc(2 * t->n + 2, sizeof(*pairs));
	bool ok = pairs != NULL;

	for (int k = 0; k < 2; k++) {
		struct panel *p = &page.panel[k];
		p->x = calloc(2 * t->n + 1, sizeof(*p->x));
		p->y = calloc(2 * t->n + 1, sizeof(*p->y));
		p->label = calloc(t->n + 1, sizeof(*p->label));
		ok = ok && p->x && p->y && p->label;
	}
	for (int k = 0; k < 2 && ok; k++)
		fill(t, k == 1, &page.panel[k], pairs);
	const enum bb_status status = ok ? bb_page_write(&out, path, err)
					 : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a plot of %zu points", t->n);
	for (int k = 0; k < 2; k++) {
		free(page.panel[k].x);
		free(page.panel[k].y);
		free(page.panel[k].label);
	}
	free(pairs);
	return status;
}
