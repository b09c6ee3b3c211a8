/* bench/trade/gains_tell.c: the tables and figures of gains.h for people and programs. */
#include "bench/trade/gains.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"

#define PAGE_WIDTH 1240.0
#define PAGE_HEIGHT 1330.0
#define EXACT_DB 100.0

/* ---- programs ---- */

static json_t *real(double v)
{
	return isfinite(v) ? json_real(v) : json_null();
}

static json_t *value_json(const struct bb_gains_value *v, uint32_t memory, uint32_t stream)
{
	return json_pack("{s:i, s:i, s:o, s:o, s:o, s:o}", "memory_bricks", (int)memory, "stream_bricks", (int)stream,
			 "psnr_db", real(v->psnr_db), "ssim", real(v->ssim), "bricks_read", real(v->bricks), "frame_ms",
			 real(v->cpu_ms));
}

static json_t *curve_json(const struct bb_gains *g, const struct bb_gains_value *v, bool stream)
{
	json_t *list = json_array();

	for (size_t i = 0; i < g->n; i++)
		json_array_append_new(list, value_json(&v[i], stream ? g->leaves : g->budget[i], stream ? g->budget[i] : 0));
	return list;
}

static json_t *duel_json(const struct bb_gains *g, bool stream, enum bb_gains_selector other)
{
	const struct bb_gains_duel d = bb_gains_duel(g, stream, other);

	return json_pack("{s:s, s:s, s:i, s:i, s:i, s:o, s:o, s:o}", "budget", stream ? "stream" : "memory", "other",
			 bb_gains_selector_text(other), "n", (int)d.n, "won", (int)d.won, "lost", (int)d.lost, "mean_db",
			 real(d.mean_db), "least_db", real(d.least_db), "most_db", real(d.most_db));
}

json_t *bb_gains_json(const struct bb_gains *g)
{
	json_t *o = json_object(), *memory = json_object(), *stream = json_object(), *both = json_array();
	json_t *points = json_array(), *duels = json_array();

	for (int s = 0; s < BB_GAINS_SELECTORS; s++) {
		json_object_set_new(memory, bb_gains_selector_text((enum bb_gains_selector)s),
				    curve_json(g, g->memory[s], false));
		if (s == BB_GAINS_UNIFORM)
			continue;
		json_object_set_new(stream, bb_gains_selector_text((enum bb_gains_selector)s),
				    curve_json(g, g->stream[s], true));
	}
	for (size_t i = 0; i < g->n_both; i++)
		for (size_t k = 0; k < g->n_both; k++)
			json_array_append_new(both, value_json(&g->both[i][k], g->both_budget[i], g->both_budget[k]));
	for (int i = 0; i < 4; i++)
		json_array_append_new(points, value_json(&g->point[i], g->point_memory[i], g->point_stream[i]));
	for (int k = 0; k < 2; k++)
		for (int s = 0; s < (k ? BB_GAINS_UNIFORM : BB_GAINS_SELECTORS); s++)
			if (s != BB_GAINS_LEAF)
				json_array_append_new(duels, duel_json(g, k, (enum bb_gains_selector)s));
	json_object_set_new(o, "leaves", json_integer(g->leaves));
	json_object_set_new(o, "memory", memory);
	json_object_set_new(o, "stream", stream);
	json_object_set_new(o, "both", both);
	json_object_set_new(o, "points", points);
	json_object_set_new(o, "leaf_against", duels);
	return o;
}

/* ---- people ---- */

static void print_curves(const struct bb_gains *g, bool stream, FILE *out)
{
	const struct bb_gains_value(*v)[BB_GAINS_BUDGETS_MOST] = stream ? g->stream : g->memory;
	const int n = stream ? BB_GAINS_UNIFORM : BB_GAINS_SELECTORS;

	fprintf(out, "\n%s budget, PSNR dB / SSIM / processor ms a frame:\n\n| bricks |", stream ? "Streaming" : "Memory");
	for (int s = 0; s < n; s++)
		fprintf(out, " %s |", bb_gains_selector_text((enum bb_gains_selector)s));
	fprintf(out, "\n| --: |%s\n", n == 4 ? " --: | --: | --: | --: |" : " --: | --: | --: | --: | --: |");
	for (size_t i = 0; i < g->n; i++) {
		fprintf(out, "| %u |", g->budget[i]);
		for (int s = 0; s < n; s++)
			fprintf(out, " %.2f / %.4f / %.1f |", v[s][i].psnr_db, v[s][i].ssim, v[s][i].cpu_ms);
		fputc('\n', out);
	}
}

static void print_duel(const struct bb_gains *g, bool stream, enum bb_gains_selector other, FILE *out)
{
	const struct bb_gains_duel d = bb_gains_duel(g, stream, other);

	fprintf(out, "- %s budget, leaf against %s: better at %u, worse at %u of %u middle budgets; %+.2f dB (%+.2f to %+.2f)\n",
		stream ? "streaming" : "memory", bb_gains_selector_text(other), d.won, d.lost, d.n, d.mean_db, d.least_db,
		d.most_db);
}

void bb_gains_print(const struct bb_gains *g, FILE *out)
{
	static const double theirs[4][2] = { { 3.30, 0.9982 }, { 5.74, 0.9966 }, { 6.01, 0.9749 }, { 6.49, 0.8325 } };

	print_curves(g, false, out);
	print_curves(g, true, out);
	fprintf(out, "\n| point | memory | streaming | frames a processor second (theirs: a second) | SSIM (theirs) |\n| --: | --: | --: | --: | --: |\n");
	for (int i = 0; i < 4; i++)
		fprintf(out, "| %d | %u | %u | %.2f (%.2f) | %.4f (%.4f) |\n", i + 1, g->point_memory[i], g->point_stream[i],
			1e3 / g->point[i].cpu_ms, theirs[i][0], g->point[i].ssim, theirs[i][1]);
	fputc('\n', out);
	for (int k = 0; k < 2; k++)
		for (int s = 0; s < (k ? BB_GAINS_UNIFORM : BB_GAINS_SELECTORS); s++)
			if (s != BB_GAINS_LEAF)
				print_duel(g, k, (enum bb_gains_selector)s, out);
}

/* ---- figures ---- */

static const struct pen_colour colours[BB_GAINS_SELECTORS] = {
	{ 0.34, 0.71, 0.91, 1 }, { 0.00, 0.45, 0.70, 1 }, { 0.84, 0.37, 0.00, 1 }, { 0.00, 0.62, 0.45, 1 },
	{ 0.45, 0.48, 0.52, 1 },
};
enum what { PSNR, SSIM, TIME };

struct page {
	const struct bb_gains *g;
	const char *title;
};

static double value_of(const struct bb_gains_value *v, enum what what)
{
	return what == PSNR ? fmin(v->psnr_db, EXACT_DB) : what == SSIM ? v->ssim : v->cpu_ms;
}

static void curve(cairo_t *cr, const struct bb_gains *g, bool stream, enum what what, double left, double top)
{
	static const char *const y_titles[] = { "PSNR, dB", "SSIM", "processor time, ms a frame" };
	const struct bb_gains_value(*v)[BB_GAINS_BUDGETS_MOST] = stream ? g->stream : g->memory;
	double x[BB_GAINS_BUDGETS_MOST], y[BB_GAINS_SELECTORS][BB_GAINS_BUDGETS_MOST];
	struct chart_series series[BB_GAINS_SELECTORS] = { 0 };
	struct chart c = { .title = stream ? "all leaves in memory" : "no streaming budget",
			   .x_title = stream ? "streaming budget, bricks a frame" : "memory budget, bricks",
			   .y_title = y_titles[what], .x_scale = CHART_OCTAVES, .series = series };

	for (int s = stream ? BB_GAINS_CHILD : BB_GAINS_UNIFORM; s >= 0; s--) { /* the leaf error on top */
		for (size_t i = 0; i < g->n; i++) {
			x[i] = g->budget[i];
			y[s][i] = value_of(&v[s][i], what);
		}
		series[c.n_series++] = (struct chart_series){ .colour = colours[s], .x = x, .y = y[s], .n = g->n, .width = 1.6,
							      .mark = CHART_DOT, .dashed = s == BB_GAINS_UNIFORM };
	}
	chart_draw(cr, &c, left, top, 600, 300);
}

static void scatter(cairo_t *cr, const struct bb_gains *g, double left, double top)
{
	double x[BB_GAINS_BUDGETS_MOST * BB_GAINS_BUDGETS_MOST], y[BB_ARRAY_LEN(x)], px[4], py[4];
	struct chart_label label[4];
	size_t n = 0;

	for (size_t i = 0; i < g->n_both; i++)
		for (size_t k = 0; k < g->n_both; k++, n++) {
			x[n] = 1e3 / g->both[i][k].cpu_ms;
			y[n] = g->both[i][k].ssim;
		}
	for (int i = 0; i < 4; i++) {
		px[i] = 1e3 / g->point[i].cpu_ms;
		py[i] = g->point[i].ssim;
		label[i] = (struct chart_label){ .x = px[i], .y = py[i] };
		snprintf(label[i].text, sizeof(label[i].text), "%d: %u / %u", i + 1, g->point_memory[i], g->point_stream[i]);
	}
	const struct chart_series series[] = {
		{ .colour = pen_alpha(colours[BB_GAINS_FAR], 0.6), .x = x, .y = y, .n = n, .mark = CHART_DOT },
		{ .colour = pen_ink, .x = px, .y = py, .n = 4, .mark = CHART_RING },
	};
	const struct chart c = { .title = "Far error, both budgets; ringed: the points of table 5.2, memory / streaming",
				 .x_title = "frames a second of processor time", .y_title = "SSIM", .series = series, .n_series = 2,
				 .labels = label, .n_labels = 4 };
	chart_draw(cr, &c, left, top, 1210, 320);
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct page *p = ctx;
	struct chart_series legend[BB_GAINS_SELECTORS] = { 0 };
	static const char *const names[] = { "leaf error", "far error (ours)", "opacity", "child error", "uniform level" };

	pen_set(cr, pen_paper);
	cairo_paint(cr);
	pen_text(cr, (struct pen_point){ 24, 26 }, PEN_LEFT, 16, true, pen_ink, "%s", p->title);
	for (int s = 0; s < BB_GAINS_SELECTORS; s++)
		legend[s] = (struct chart_series){ .name = names[s], .colour = colours[s], .n = 1, .width = 1.6,
						   .mark = CHART_DOT };
	chart_legend(cr, legend, BB_GAINS_SELECTORS, 24, 52);
	for (int what = PSNR; what <= TIME; what++)
		for (int k = 0; k < 2; k++)
			curve(cr, p->g, k == 1, (enum what)what, 14 + 612.0 * k, 70 + 306.0 * what);
	scatter(cr, p->g, 14, 70 + 3 * 306.0);
}

enum bb_status bb_gains_plot(const struct bb_gains *g, const char *title, const char *path, struct bb_error *err)
{
	struct page p = { g, title };
	const struct bb_page page = { PAGE_WIDTH, PAGE_HEIGHT, "gains-", paint, &p };

	return bb_page_write(&page, path, err);
}
