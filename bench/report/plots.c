/*
 * bench/report/plots.c: the report's figures as inline SVG: the way of a frame, distributions, every frame over time.
 * Coordinates are user units of an SVG 1048 wide; long runs are reduced to one minimum and maximum a column.
 */
#include "bench/report/html.h"

#include "bench/file.h"
#include "bench/stats.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH 1048.0
#define INK "#1b2430"
#define SOFT "#5d6978"
#define FAINT "#98a2b0"
#define RULE "#e3e7ec"
#define ACCENT "#24527a"
#define LIMIT "#b3261e"

/* Cameras in greens, tracking and nodes in blues, displays in ochres: the three wings of the way to the photon. */
const char *bb_stage_colour(enum bb_stage stage)
{
	static const char *const colour[BB_STAGE_COUNT] = {
		[BB_STAGE_EXPOSE] = "#2f6f62", [BB_STAGE_TRANSFER] = "#5d968a", [BB_STAGE_WAIT] = "#9cc2b8",
		[BB_STAGE_TRACK] = "#1d3f60",  [BB_STAGE_STATE] = "#3b6a97",    [BB_STAGE_SELECT] = "#6d97bf",
		[BB_STAGE_DRAW] = "#24527a",   [BB_STAGE_BARRIER] = "#a9c4de",  [BB_STAGE_PRESENT] = "#8d6a2b",
		[BB_STAGE_SCANOUT] = "#b8924f", [BB_STAGE_SHUTTER] = "#dcc391",
	};

	return (size_t)stage < BB_STAGE_COUNT ? colour[stage] : FAINT;
}

struct axes { /* data range and the box it is drawn in */
	double x_low, x_high, y_low, y_high;
	double left, right, top, bottom;
};

static double x_of(const struct axes *a, double v)
{
	return a->left + (v - a->x_low) / (a->x_high - a->x_low) * (a->right - a->left);
}

static double y_of(const struct axes *a, double v)
{
	return a->bottom - (v - a->y_low) / (a->y_high - a->y_low) * (a->bottom - a->top);
}

/* 1, 2 or 5 times a power of ten, so that about n steps fill the span. */
static double tick_step(double span, double n)
{
	const double raw = span / n, base = pow(10, floor(log10(raw)));
	const double digit = raw / base;

	return base * (digit <= 1 ? 1 : digit <= 2 ? 2 : digit <= 5 ? 5 : 10);
}

/* With a halo of paper, so that a line behind a label does not strike it out. */
static void put_label(FILE *f, double x, double y, const char *anchor, const char *fill, const char *text)
{
	fprintf(f, "<text class=\"halo\" x=\"%.1f\" y=\"%.1f\" font-size=\"12\" text-anchor=\"%s\" fill=\"%s\">", x, y,
	        anchor, fill);
	bb_put_markup(f, text);
	fputs("</text>", f);
}

static void put_text(FILE *f, double x, double y, const char *anchor, const char *fill, const char *text)
{
	fprintf(f, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"12\" text-anchor=\"%s\" fill=\"%s\">", x, y, anchor, fill);
	bb_put_markup(f, text);
	fputs("</text>", f);
}

static void put_line(FILE *f, double x1, double y1, double x2, double y2, const char *stroke, const char *more)
{
	fprintf(f, "<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\"%s/>", x1, y1, x2, y2, stroke,
	        more);
}

static const char *tick_text(char *out, size_t cap, double v)
{
	if (fabs(v) < 1e-12)
		v = 0;
	bb_text_format(out, cap, "%.6g", v);
	return out;
}

static void put_x_axis(FILE *f, const struct axes *a, double n, const char *unit)
{
	const double step = tick_step(a->x_high - a->x_low, n);
	char text[32];

	put_line(f, a->left, a->bottom, a->right, a->bottom, FAINT, "");
	for (long i = lround(ceil(a->x_low / step - 1e-9)); (double)i * step <= a->x_high * (1 + 1e-9); i++) {
		const double x = x_of(a, (double)i * step);
		put_line(f, x, a->bottom, x, a->bottom + 4, FAINT, "");
		put_text(f, x, a->bottom + 17, "middle", SOFT, tick_text(text, sizeof(text), (double)i * step));
	}
	if (unit)
		put_text(f, a->right, a->bottom + 31, "end", SOFT, unit);
}

static void put_y_axis(FILE *f, const struct axes *a, double n)
{
	const double step = tick_step(a->y_high - a->y_low, n);
	char text[32];

	for (long i = lround(ceil(a->y_low / step - 1e-9)); (double)i * step <= a->y_high + step * 1e-9; i++) {
		const double y = y_of(a, (double)i * step);
		put_line(f, a->left, y, a->right, y, RULE, "");
		put_text(f, a->left - 8, y + 4, "end", SOFT, tick_text(text, sizeof(text), (double)i * step));
	}
}

static void begin_svg(FILE *f, double width, double height, const char *label)
{
	fprintf(f, "<svg viewBox=\"0 0 %.0f %.0f\" role=\"img\" aria-label=\"", width, height);
	bb_put_markup(f, label);
	fputs("\">", f);
}

/* ---- the way of a frame ---- */

static enum bb_stage stage_of(int link)
{
	static const enum bb_stage stage[BB_LINK_COUNT] = {
		BB_STAGE_EXPOSE, BB_STAGE_EXPOSE, BB_STAGE_TRANSFER, BB_STAGE_WAIT, BB_STAGE_TRACK, BB_STAGE_TRACK, BB_STAGE_TRACK,
		BB_STAGE_STATE, BB_STAGE_SELECT, BB_STAGE_DRAW, BB_STAGE_BARRIER, BB_STAGE_PRESENT, BB_STAGE_SCANOUT,
		BB_STAGE_SHUTTER,
	};

	return stage[link];
}

#define ROW 19.0

/* A bar from where the ones before end on average, as long as its mean; the whisker ends at its 99th percentile. */
static void put_link(FILE *f, const struct axes *a, const struct bb_latency_link *k, int i, double from_ms)
{
	const double y = a->top + ROW * i, x = x_of(a, from_ms), w = x_of(a, from_ms + fmax(k->summary.mean, 0)) - x;
	const char *colour = bb_stage_colour(stage_of(i));
	char text[64];

	put_text(f, a->left - 8, y + 14, "end", INK, k->name);
	fprintf(f, "<rect x=\"%.2f\" y=\"%.1f\" width=\"%.2f\" height=\"%.1f\" fill=\"%s\"%s><title>", x, y + 3, fmax(w, 0.8), ROW - 6,
	        colour, k->modelled ? " fill-opacity=\"0.45\" stroke-dasharray=\"3 2\" stroke=\"" SOFT "\"" : "");
	bb_put_markupf(f, "%s: %s", k->name, k->help);
	fputs("</title></rect>", f);
	if (k->summary.p99 > k->summary.mean)
		put_line(f, x + w, y + ROW / 2, fmin(x_of(a, from_ms + k->summary.p99), a->right), y + ROW / 2, colour,
		         " stroke-width=\"1.5\"");
	bb_text_format(text, sizeof(text), "%.2f, p99 %.2f%s", k->summary.mean, k->summary.p99, k->modelled ? ", modelled" : "");
	put_text(f, WIDTH, y + 14, "end", SOFT, text);
}

static void put_marker(FILE *f, const struct axes *a, double v, const char *name, const char *colour, bool dashed,
                       double label_y)
{
	char text[64], number[32];

	if (!isfinite(v) || v < a->x_low || v > a->x_high)
		return;
	put_line(f, x_of(a, v), label_y + 4, x_of(a, v), a->bottom + 1, colour,
	         dashed ? " stroke-width=\"1.4\" stroke-dasharray=\"5 3\"" : " stroke-width=\"1.2\"");
	bb_text_format(text, sizeof(text), "%s %s", name, bb_text_number(number, sizeof(number), v));
	put_label(f, x_of(a, v), label_y,
	          x_of(a, v) > a->right - 60  ? "end"
	          : x_of(a, v) < a->left + 60 ? "start"
	                                      : "middle",
	          colour, text);
}

/* The limit of a budget with the statistic it is meant for. */
static void put_limit_marker(FILE *f, const struct axes *a, const struct bb_budget_result *b, double label_y)
{
	char name[32];

	if (!b)
		return;
	bb_text_format(name, sizeof(name), "%s limit", bb_stat_text(b->budget.stat));
	put_marker(f, a, b->budget.limit, name, LIMIT, true, label_y);
}

void bb_plot_waterfall(FILE *f, const struct bb_run_result *r, const struct bb_latency *l)
{
	static const double goals[] = { 20, 50 };
	const double limit = bb_report_limit(r, BB_METRIC_HEAD_TO_PHOTON);
	const double high = fmax(fmax(52, isnan(limit) ? 0 : limit), l->total.p99) * 1.02;
	const struct axes a = { 0, high, 0, 1, 78, WIDTH - 168, 40, 40 + ROW * BB_LINK_COUNT + 4 };
	double from_ms = 0;
	char text[32];

	fputs("<figure><figcaption><b>From exposure to photon</b>, ms: each bar begins where the mean of those before ends; its whisker "
	      "is its p99; pale and dashed: modelled</figcaption>", f);
	begin_svg(f, WIDTH, a.bottom + 38, "Waterfall of the links from exposure to photon");
	for (size_t i = 0; i < BB_ARRAY_LEN(goals); i++) {
		bb_text_format(text, sizeof(text), "%.0f ms", goals[i]);
		put_line(f, x_of(&a, goals[i]), 20, x_of(&a, goals[i]), a.bottom, RULE, "");
		put_label(f, x_of(&a, goals[i]), 14, "middle", SOFT, text);
	}
	for (int i = 0; i < BB_LINK_COUNT; i++) {
		put_link(f, &a, &l->link[i], i, from_ms);
		from_ms += l->link[i].summary.mean;
	}
	put_x_axis(f, &a, 12, "ms");
	put_marker(f, &a, l->total.mean, "mean", INK, false, 30);
	put_marker(f, &a, l->total.p99, "p99", INK, false, 14);
	put_limit_marker(f, &a, bb_report_budget(r, BB_METRIC_HEAD_TO_PHOTON), 30);
	fputs("</svg></figure>\n", f);
}

/* ---- distributions ---- */

#define BINS 64

static size_t fill_bins(const struct bb_sample *s, size_t n, const struct axes *a, size_t bins[BINS])
{
	size_t most = 0;

	memset(bins, 0, BINS * sizeof(bins[0]));
	for (size_t i = 0; i < n; i++) {
		const double at = (s[i].value - a->x_low) / (a->x_high - a->x_low) * BINS;
		const size_t k = at <= 0 ? 0 : at >= BINS ? BINS - 1 : (size_t)at;
		most = ++bins[k] > most ? bins[k] : most;
	}
	return most;
}

/* Height by the square root: the twenty late frames of an hour must be seen beside the many that were in time. */
static void put_bars(FILE *f, const struct axes *a, const size_t bins[BINS], size_t most)
{
	const double w = (a->right - a->left) / BINS;

	for (size_t k = 0; k < BINS; k++) {
		const double h = sqrt((double)bins[k] / (double)most) * (a->bottom - a->top);
		if (!bins[k])
			continue;
		fprintf(f, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"#a9c4de\"><title>",
		        a->left + w * (double)k, a->bottom - h, fmax(w - 0.7, 0.5), h);
		bb_put_markupf(f, "%.4g to %.4g: %zu", a->x_low + (a->x_high - a->x_low) * (double)k / BINS,
		               a->x_low + (a->x_high - a->x_low) * (double)(k + 1) / BINS, bins[k]);
		fputs("</title></rect>", f);
	}
}

static void put_cumulative(FILE *f, const struct axes *a, const size_t bins[BINS], size_t n)
{
	size_t below = 0;

	fprintf(f, "<path fill=\"none\" stroke=\"" ACCENT "\" stroke-width=\"1.5\" d=\"M%.1f %.1f", a->left, a->bottom);
	for (size_t k = 0; k < BINS; k++) {
		below += bins[k];
		fprintf(f, "L%.1f %.1f", a->left + (a->right - a->left) * (double)(k + 1) / BINS,
		        a->bottom - (a->bottom - a->top) * (double)below / (double)n);
	}
	fputs("\"/>", f);
}

void bb_plot_distribution(FILE *f, const struct bb_run_result *r, enum bb_metric metric, const char *title)
{
	const struct bb_metric_info *info = bb_metric_info(metric);
	const struct bb_summary all = bb_ledger_metric(r->ledger, metric);
	const double limit = bb_report_limit(r, metric);
	const struct bb_sample *sample;
	const size_t n = bb_ledger_samples(r->ledger, metric, &sample);
	size_t bins[BINS];

	if (!n)
		return;
	double low = fmin(all.min, isnan(limit) ? all.min : limit), high = fmax(all.max, isnan(limit) ? all.max : limit);
	const double pad = fmax((high - low) * 0.05, fmax(fabs(high) * 1e-3, 1e-9));
	const struct axes a = { low < pad && low >= 0 ? 0 : low - pad, high + pad, 0, 1, 0, 504, 52, 190 };
	const size_t most = fill_bins(sample, n, &a, bins);

	fputs("<figure><figcaption><b>", f);
	bb_put_markup(f, title);
	fputs("</b>", f);
	fprintf(f, ", %s; bars: samples (root scale), line: share of all at or below</figcaption>", info->unit);
	begin_svg(f, 504, 228, title);
	put_bars(f, &a, bins, most);
	put_cumulative(f, &a, bins, n);
	put_x_axis(f, &a, 8, bb_report_unit(info->unit));
	put_marker(f, &a, all.p50, "median", INK, false, 12);
	put_marker(f, &a, all.p99, "p99", INK, false, 27);
	put_limit_marker(f, &a, bb_report_budget(r, metric), 42);
	fputs("</svg></figure>\n", f);
}

/* ---- over time ---- */

enum row_value {
	ROW_HEAD_TO_PHOTON,
	ROW_FRAME,
	ROW_SWAP_SKEW,
	ROW_PHASE,
	ROW_PHOTON_ERROR,
	ROW_BRICKS_LOADED,
	ROW_BRICKS_MISSING,
	ROW_DEFICIT
};

static double row_value(const struct bb_frame_row *row, enum row_value which)
{
	switch (which) {
	case ROW_HEAD_TO_PHOTON:
		return row->head_to_photon_ms;
	case ROW_FRAME:
		return row->frame_ms;
	case ROW_SWAP_SKEW:
		return row->swap_skew_us;
	case ROW_PHASE:
		return row->phase_us;
	case ROW_PHOTON_ERROR:
		return row->photon_error_mm;
	case ROW_BRICKS_LOADED:
		return row->bricks_loaded;
	case ROW_BRICKS_MISSING:
		return row->bricks_missing;
	case ROW_DEFICIT:
		return (double)row->deficit;
	}
	return BB_UNKNOWN;
}

struct panel {
	enum row_value value;
	enum bb_metric metric; /* BB_METRIC_COUNT: none, */
	const char *title;
	const char *unit;      /* then this */
};

#define COLUMNS 880

struct column {
	double low, high;
	bool rising; /* the minimum came first */
	bool used;
};

static size_t reduce(const struct bb_frame_row *row, size_t n, enum row_value which, double low, double high,
                     struct column *column)
{
	size_t used = 0;

	memset(column, 0, COLUMNS * sizeof(*column));
	for (size_t i = 0; i < n; i++) {
		const double v = row_value(&row[i], which),
			     at = ((double)row[i].start_ns - low) / (high - low) * COLUMNS;
		struct column *c = &column[at <= 0 ? 0 : at >= COLUMNS ? COLUMNS - 1 : (size_t)at];
		if (!isfinite(v))
			continue;
		used++;
		if (!c->used)
			*c = (struct column){ v, v, true, true };
		c->rising = v > c->high ? true : v < c->low ? false : c->rising;
		c->low = fmin(c->low, v);
		c->high = fmax(c->high, v);
	}
	return used;
}

static void put_curve(FILE *f, const struct axes *a, const struct column *column)
{
	char command = 'M';

	fputs("<path fill=\"none\" stroke=\"" ACCENT "\" stroke-width=\"1\" stroke-linejoin=\"round\" d=\"", f);
	for (size_t k = 0; k < COLUMNS; k++) {
		const struct column *c = &column[k];
		const double x = a->left + (a->right - a->left) * ((double)k + 0.5) / COLUMNS;
		if (!c->used)
			continue;
		fprintf(f, "%c%.1f %.1f", command, x, y_of(a, c->rising ? c->low : c->high));
		command = 'L';
		if (c->high > c->low)
			fprintf(f, "V%.1f", y_of(a, c->rising ? c->high : c->low));
	}
	fputs("\"/>", f);
}

static void put_bands(FILE *f, const struct bb_run_result *r, const struct axes *a)
{
	for (size_t i = 0; i < r->n_incidents; i++) {
		const struct bb_incident *in = &r->incidents[i];
		const double to_s = in->to_ns == BB_NEVER ? a->x_high : (double)in->to_ns * 1e-9;
		const double x1 = fmax(x_of(a, (double)in->from_ns * 1e-9), a->left), x2 = fmin(x_of(a, to_s), a->right);
		if (x2 <= x1)
			continue;
		fprintf(f,
		        "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"" LIMIT
		        "\" opacity=\"0.09\"><title>",
		        x1, a->top, fmax(x2 - x1, 1), a->bottom - a->top);
		bb_put_markupf(f, "%s %s: %s", in->culprit, in->state, in->what);
		fputs("</title></rect>", f);
	}
	for (size_t i = 0; i < r->n_faults; i++) {
		const double x = x_of(a, (double)r->faults[i].set_ns * 1e-9);
		if (x < a->left || x > a->right)
			continue;
		fprintf(f, "<path d=\"M%.1f %.1fl-4 -7h8z\" fill=\"" LIMIT "\"><title>", x, a->top);
		bb_put_markup(f, r->faults[i].text);
		fputs("</title></path>", f);
	}
}

/* The limit belongs into the picture unless it would press the curve flat. */
static void put_limit(FILE *f, const struct axes *a, const struct bb_budget_result *b, const char *unit)
{
	const double limit = b ? b->budget.limit : 0, y = y_of(a, limit);
	char text[64], number[32];

	if (!b)
		return;
	bb_text_format(text, sizeof(text), "%s limit %s %s%s", bb_stat_text(b->budget.stat),
	               bb_text_number(number, sizeof(number), limit), unit, limit > a->y_high ? " (off scale)" : "");
	if (limit <= a->y_high) {
		put_line(f, a->left, y, a->right, y, LIMIT, " stroke-width=\"1.2\" stroke-dasharray=\"5 3\"");
		if (a->y_low < 0 && -limit >= a->y_low)
			put_line(f, a->left, y_of(a, -limit), a->right, y_of(a, -limit), LIMIT,
			         " stroke-width=\"1.2\" stroke-dasharray=\"5 3\"");
	}
	put_text(f, a->right, 14, "end", LIMIT, text);
}

static void range_of(const struct column *column, double limit, struct axes *a)
{
	double low = 0, high = 0;

	for (size_t k = 0; k < COLUMNS; k++)
		if (column[k].used) {
			low = fmin(low, column[k].low);
			high = fmax(high, column[k].high);
		}
	if (low < 0) /* a signed value: zero in the middle */
		low = -(high = fmax(high, -low));
	if (!isnan(limit) && limit > high && limit < 4 * high) {
		high = limit;
		low = low < 0 ? -limit : 0;
	}
	a->y_high = high > 0 ? high * 1.08 : 1;
	a->y_low = low * 1.08;
}

static void put_panel(FILE *f, const struct bb_run_result *r, const struct panel *p, struct column *column)
{
	const char *unit = p->unit ? p->unit : bb_report_unit(bb_metric_info(p->metric)->unit);
	const double limit = bb_report_limit(r, p->metric);
	const struct bb_frame_row *row;
	const size_t n = bb_ledger_rows(r->ledger, &row);
	struct axes a = { 0, r->duration_s, 0, 1, 46, WIDTH, 30, 122 };

	if (!n || !(r->duration_s > 0))
		return;
	const double low = r->scene_start_s * 1e9;
	if (!reduce(row, n, p->value, low, low + r->duration_s * 1e9, column))
		return;
	range_of(column, limit, &a);
	fputs("<figure>", f);
	begin_svg(f, WIDTH, 144, p->title);
	fprintf(f, "<text x=\"0\" y=\"14\" font-size=\"13\"><tspan font-weight=\"600\" fill=\"" INK "\">%s</tspan>"
	           "<tspan fill=\"" SOFT "\" dx=\"6\">%s</tspan></text>",
	        p->title, unit);
	put_y_axis(f, &a, 3);
	put_bands(f, r, &a);
	put_curve(f, &a, column);
	put_limit(f, &a, bb_report_budget(r, p->metric), unit);
	put_x_axis(f, &a, 10, NULL);
	fputs("</svg></figure>\n", f);
}

static void put_panels(FILE *f, const struct bb_run_result *r, const struct panel *panels, size_t n)
{
	struct column *column = calloc(COLUMNS, sizeof(*column));

	for (size_t i = 0; column && i < n; i++)
		put_panel(f, r, &panels[i], column);
	free(column);
}

void bb_plot_series(FILE *f, const struct bb_run_result *r)
{
	static const struct panel panels[] = {
		{ ROW_HEAD_TO_PHOTON, BB_METRIC_HEAD_TO_PHOTON, "Head to photon", NULL },
		{ ROW_FRAME, BB_METRIC_FRAME, "Frame time, slowest node", NULL },
		{ ROW_SWAP_SKEW, BB_METRIC_SWAP_SKEW, "Swap skew", NULL },
		{ ROW_PHASE, BB_METRIC_PHASE, "Shutter phase, worst stage", NULL },
		{ ROW_PHOTON_ERROR, BB_METRIC_PHOTON_ERROR, "Head position error at the photon", NULL },
	};

	put_panels(f, r, panels, BB_ARRAY_LEN(panels));
}

void bb_plot_streaming(FILE *f, const struct bb_run_result *r)
{
	static const struct panel panels[] = {
		{ ROW_BRICKS_LOADED, BB_METRIC_COUNT, "Bricks read in a frame", "all nodes" },
		{ ROW_BRICKS_MISSING, BB_METRIC_COUNT, "Bricks missing", "all nodes" },
		{ ROW_DEFICIT, BB_METRIC_COUNT, "Cells drawn coarser than planned", "all nodes, in bricks of full resolution" },
	};

	put_panels(f, r, panels, BB_ARRAY_LEN(panels));
}
