/* bench/phase/drawing.c: the tracks from the top down, each one a function that draws at a height and says what it took. */
#include "bench/phase/drawing.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"
#include "sync/plan/tokens.h"
#include "sync/plan/wave.h"

#define PAGE_WIDTH 1240.0
#define LEFT 206.0     /* of the time axis */
#define RIGHT 1012.0
#define TOP 104.0
#define GAP 14.0
#define PICTURE 92.0   /* heights of tracks */
#define CURVE 58.0
#define ROW 17.0
#define LN9 2.1972245773362196

static const struct pen_colour eye_colour[2] = { { 0.00, 0.45, 0.70, 1 }, { 0.84, 0.37, 0.00, 1 } };
static const struct pen_colour night = { 0.22, 0.24, 0.27, 0.80 };
static const struct pen_colour measured_colour = { 0.05, 0.45, 0.38, 1 };

struct page {
	cairo_t *cr;
	const struct bb_room *room;
	const struct bb_plan *plan;
	const struct bb_phase_edges *measured;
	double height;
};

static double x_of(const struct page *p, double us)
{
	return LEFT + us / (2 * p->plan->period_us) * (RIGHT - LEFT);
}

/* --- pieces ------------------------------------------------------------------------------------------------------- */

static void title(const struct page *p, double y, double height, const char *name, const char *note)
{
	pen_text(p->cr, (struct pen_point){ LEFT - 12, y + height / 2 - (*note ? 6 : 0) }, PEN_RIGHT, 12, true, pen_ink,
	         "%s", name);
	if (*note)
		pen_text(p->cr, (struct pen_point){ LEFT - 12, y + height / 2 + 8 }, PEN_RIGHT, 10, false, pen_grey, "%s",
		         note);
}

static void frame(const struct page *p, double y, double height)
{
	cairo_rectangle(p->cr, LEFT, y, RIGHT - LEFT, height);
	pen_set(p->cr, pen_faint);
	cairo_set_line_width(p->cr, 0.6);
	cairo_stroke(p->cr);
}

/* A bar in the cycle, around its end if need be. */
static void bar(const struct page *p, double from_us, double length_us, double y, double height, struct pen_colour fill)
{
	const double cycle = 2 * p->plan->period_us;
	const double from = from_us - cycle * floor(from_us / cycle);

	for (int k = -1; k <= 0; k++) {
		const double a = fmax(from + k * cycle, 0), z = fmin(from + k * cycle + length_us, cycle);

		if (z > a) {
			pen_set(p->cr, fill);
			cairo_rectangle(p->cr, x_of(p, a), y, fmax(x_of(p, z) - x_of(p, a), 1.2), height);
			cairo_fill(p->cr);
		}
	}
}

static void curve(const struct page *p, const struct bb_wave *w, double y, double height, struct pen_colour colour)
{
	const double cycle = 2 * p->plan->period_us;

	for (int fill = 1; fill >= 0; fill--) {
		if (fill)
			cairo_move_to(p->cr, LEFT, y + height);
		for (int i = 0; i <= 834; i++) {
			const double us = fmin(cycle * i / 834, cycle * (1 - 1e-9)), v = bb_wave_at(w, us);
			cairo_line_to(p->cr, x_of(p, us), y + height * (1 - 0.92 * v));
		}
		if (fill)
			cairo_line_to(p->cr, RIGHT, y + height);
		pen_set(p->cr, fill ? pen_alpha(colour, 0.18) : colour);
		cairo_set_line_width(p->cr, 1.4);
		if (fill)
			cairo_fill(p->cr);
		else
			cairo_stroke(p->cr);
	}
}

/* --- tracks ------------------------------------------------------------------------------------------------------- */

static void axis(const struct page *p, double y, double bottom)
{
	const double cycle = 2 * p->plan->period_us;

	for (int ms = 0; ms * 1000 <= cycle; ms++) {
		const double x = x_of(p, ms * 1000.0);

		pen_line(p->cr, (struct pen_point){ x, y }, (struct pen_point){ x, bottom }, 0.5, pen_faint);
		pen_text(p->cr, (struct pen_point){ x, y - 9 }, PEN_CENTRE, 10, false, pen_grey, "%d", ms);
	}
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y - 9 }, PEN_LEFT, 10, false, pen_grey, "ms");
	for (int eye = 0; eye < 2; eye++) {
		const double x = x_of(p, eye * p->plan->period_us);

		pen_line(p->cr, (struct pen_point){ x, y - 18 }, (struct pen_point){ x, bottom }, 1.4, eye_colour[eye]);
		pen_text(p->cr, (struct pen_point){ x + 4, y - 24 }, PEN_LEFT, 11, true, eye_colour[eye],
		         eye ? "edge of the right eye" : "edge of the left eye");
	}
}

static void slanted(const struct page *p, double y, double top_us, double bottom_us, double length_us,
                    struct pen_colour fill)
{
	cairo_move_to(p->cr, x_of(p, top_us), y);
	cairo_line_to(p->cr, x_of(p, top_us + length_us), y);
	cairo_line_to(p->cr, x_of(p, bottom_us + length_us), y + PICTURE);
	cairo_line_to(p->cr, x_of(p, bottom_us), y + PICTURE);
	cairo_close_path(p->cr);
	pen_set(p->cr, fill);
	cairo_fill(p->cr);
}

static void pictures(const struct page *p, const struct bb_display_config *d, double y)
{
	const double T = p->plan->period_us, vblank = bb_display_vblank_us(d);
	const double settle = d->pixel_fall_us / LN9 * log(100 / p->plan->limit_percent);
	const double top = vblank + (d->scan == BB_SCAN_UP ? T - vblank : 0);
	const double bottom = vblank + (d->scan == BB_SCAN_DOWN ? T - vblank : 0);

	for (int k = -2; k <= 2; k++) {
		const double at = k * T;

		slanted(p, y, at + top, at + bottom, T, pen_alpha(eye_colour[k & 1], 0.42));
		slanted(p, y, at + top, at + bottom, fmin(settle, T), pen_alpha(eye_colour[1 - (k & 1)], 0.30));
		pen_line(p->cr, (struct pen_point){ x_of(p, at + top), y },
		         (struct pen_point){ x_of(p, at + bottom), y + PICTURE }, 0.8, pen_alpha(pen_ink, 0.6));
	}
	for (int k = 0; k < 2; k++) {
		if (d->kind == BB_DISPLAY_STROBED)
			bar(p, k * T + d->strobe_at_us + d->strobe_us, T - d->strobe_us, y, PICTURE, night);
		else if (d->dark_us > 0)
			bar(p, k * T + vblank - d->dark_us, d->dark_us, y, PICTURE, night);
	}
}

static const char *const kinds[] = { "lcd, sample and hold", "dlp", "strobed" };

static double wall_track(const struct page *p, const struct bb_plan_wall *w, size_t n_alike, double y)
{
	const struct bb_display_config *d = w->display;
	const double T = p->plan->period_us;
	char note[64];

	snprintf(note, sizeof(note), n_alike > 1 ? "%s, and %zu walls like it" : "%s", kinds[d->kind], n_alike - 1);
	title(p, y, PICTURE, w->id, note);
	for (int k = 0; k < 2; k++)
		bar(p, k * T, bb_display_vblank_us(d), y, 7, pen_grey);
	cairo_save(p->cr);
	cairo_rectangle(p->cr, LEFT, y + 9, RIGHT - LEFT, PICTURE);
	cairo_clip(p->cr);
	pictures(p, d, y + 9);
	cairo_restore(p->cr);
	frame(p, y + 9, PICTURE);
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + 4 }, PEN_LEFT, 10, false, pen_grey, "vblank %.0f us",
	         bb_display_vblank_us(d));
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + 20 }, PEN_LEFT, 10, false, pen_grey, "top row");
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + PICTURE }, PEN_LEFT, 10, false, pen_grey, "bottom row");
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + PICTURE / 2 + 9 }, PEN_LEFT, 10, false, pen_grey,
	         "pixels %.0f / %.0f us", d->pixel_rise_us, d->pixel_fall_us);
	return y + 9 + PICTURE + GAP;
}

static double bands(const struct page *p, const struct bb_plan_wall *w, double y)
{
	for (size_t b = 0; b < BB_PLAN_BANDS; b++) {
		const struct bb_plan_band *band = &w->band[b];
		const double from = (double)band->window_from_ns / 1e3, length = (double)band->window_to_ns / 1e3 - from;
		const bool over = band->light.crosstalk_percent > p->plan->limit_percent;

		pen_text(p->cr, (struct pen_point){ LEFT - 12, y + ROW / 2 }, PEN_RIGHT, 10, false, pen_ink, "%s: one eye alone",
		         bb_phase_band[b]);
		for (int eye = 0; eye < 2 && length > 0; eye++)
			bar(p, from + eye * p->plan->period_us, length, y + 3, ROW - 6, pen_alpha(eye_colour[eye], 0.75));
		if (!(length > 0))
			pen_text(p->cr, (struct pen_point){ (LEFT + RIGHT) / 2, y + ROW / 2 }, PEN_CENTRE, 10, false, pen_camera,
			         "never: %.0f us are lacking", -length);
		pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + ROW / 2 }, PEN_LEFT, 10.5, over, over ? pen_camera : pen_ink,
		         "light %.2f %%, crosstalk %.2f %%", band->light.light_percent, band->light.crosstalk_percent);
		y += ROW;
	}
	return y + GAP;
}

static double lenses(const struct page *p, const char *name, const struct bb_cell *c, double at_us, double open_us,
                     double y)
{
	const double T = p->plan->period_us;
	char note[64];

	snprintf(note, sizeof(note), "%+.0f us, for %.0f us", at_us, open_us);
	title(p, y, CURVE, name, note);
	frame(p, y, CURVE);
	for (int eye = 0; eye < 2; eye++) {
		struct bb_wave w;

		bb_wave_cell(&w, 2 * T, at_us + eye * T, open_us, c->open_us, c->close_us, 1 / c->contrast, 1);
		curve(p, &w, y, CURVE, eye_colour[eye]);
	}
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + CURVE / 2 - 7 }, PEN_LEFT, 10, false, pen_grey,
	         "opens in %.0f us, closes in %.0f", c->open_us, c->close_us);
	pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + CURVE / 2 + 7 }, PEN_LEFT, 10, false, pen_grey,
	         "%.0f : 1, %.0f %% when open", c->contrast, c->transmission_percent);
	return y + CURVE + GAP;
}

static double tokens(const struct page *p, double y)
{
	static const char *const text[BB_TOKENS] = { "open L", "close L", "open R", "close R" };
	struct bb_light_span spans[BB_TOKENS];
	bool low = false; /* labels of neighbours stand on two lines */

	title(p, y, 3 * ROW, "tokens", p->plan->tokens ? p->plan->tokens->name : "none known");
	frame(p, y, 3 * ROW);
	if (!p->plan->tokens)
		return y + 3 * ROW + GAP;
	const size_t n = bb_ir_spans(p->plan->tokens, p->plan->period_us, p->plan->timing.glasses_at_us,
	                             p->plan->timing.glasses_open_us, spans);
	for (size_t i = 0; i < n; i++, low = !low) {
		const int eye = spans[i].token == BB_TOKEN_OPEN_RIGHT || spans[i].token == BB_TOKEN_CLOSE_RIGHT;
		const bool last = x_of(p, spans[i].from) > RIGHT - 46;
		const struct pen_point at = { last ? RIGHT - 2 : x_of(p, spans[i].from), y + (low ? 2.5 : 1.5) * ROW };

		bar(p, spans[i].from, spans[i].to - spans[i].from, y + 2, ROW - 4, eye_colour[eye]);
		pen_text(p->cr, at, last ? PEN_RIGHT : PEN_LEFT, 9.5, false, eye_colour[eye], "%s", text[spans[i].token]);
	}
	return y + 3 * ROW + GAP;
}

static double cameras(const struct page *p, double y)
{
	for (size_t i = 0; i < p->plan->n_cameras; i++) {
		const struct bb_plan_camera *c = &p->plan->camera[i];
		const double cycle = 2 * p->plan->period_us, step = 1e6 / c->rate_hz;
		char name[64];

		snprintf(name, sizeof(name), c->n > 1 ? "%s + %zu, %g Hz" : "%s%.0zu, %g Hz", c->first, c->n - 1, c->rate_hz);
		pen_text(p->cr, (struct pen_point){ LEFT - 12, y + ROW / 2 }, PEN_RIGHT, 10, false, pen_ink, "strobe %s", name);
		frame(p, y + 1, ROW - 2);
		for (int k = 0; c->locked && k * step < fmax(cycle, step) - 1; k++)
			bar(p, c->offset_us + k * step, c->exposure_us, y + 3, ROW - 6, pen_alpha(pen_camera, 0.8));
		if (!c->locked)
			bar(p, 0, cycle, y + 3, ROW - 6, pen_alpha(pen_camera, 0.15));
		if (c->locked)
			pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + ROW / 2 }, PEN_LEFT, 10, false, pen_ink,
			         c->margin_us >= 0 ? "%.0f us from a token" : "meets tokens (%.0f us)", c->margin_us);
		else
			pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + ROW / 2 }, PEN_LEFT, 10, true, pen_camera,
			         "free: %.1f %% meet tokens", c->mean_percent);
		y += ROW;
	}
	return y + (p->plan->n_cameras ? GAP : 0);
}

static double measured(const struct page *p, double y)
{
	const struct bb_phase_edges *e = p->measured;
	const double scale = 2 * p->plan->period_us / e->cycle_us;

	pen_text(p->cr, (struct pen_point){ LEFT, y + 6 }, PEN_LEFT, 12, true, measured_colour,
	         "measured: cycles of %.2f us, begun by the left edges of %s", e->cycle_us, e->reference);
	y += 2 * ROW - 6;
	for (size_t i = 0; i < e->n_groups; i++) {
		const struct bb_phase_group *g = &e->group[i];
		const double spread = g->most_us - g->least_us;
		const bool loose = bb_phase_loose(e, g);

		pen_text(p->cr, (struct pen_point){ LEFT - 12, y + ROW / 2 }, PEN_RIGHT, 10, false, pen_ink, "%s%s %s", g->track,
		         g->eye == BB_EYE_LEFT ? " L" : g->eye == BB_EYE_RIGHT ? " R" : "", g->event);
		frame(p, y + 1, ROW - 2);
		for (int k = 0; k < (g->eye == BB_EYE_NONE ? 2 : 1); k++) {
			const double x = x_of(p, g->planned_us + k * p->plan->period_us);

			bar(p, (g->mean_us + g->least_us) * scale + k * p->plan->period_us, spread * scale, y + 4, ROW - 8,
			    pen_alpha(measured_colour, loose ? 0.2 : 0.8));
			if (isfinite(x))
				pen_line(p->cr, (struct pen_point){ x, y + 1 }, (struct pen_point){ x, y + ROW - 1 }, 1.6, pen_ink);
		}
		if (loose)
			pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + ROW / 2 }, PEN_LEFT, 10, true, pen_camera,
			         "%zu edges, not locked", g->n);
		else if (isfinite(g->planned_us))
			pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + ROW / 2 }, PEN_LEFT, 10, false, pen_ink,
			         "%+.1f us from plan, spread %.1f", bb_phase_off_us(e, g), spread);
		else
			pen_text(p->cr, (struct pen_point){ RIGHT + 12, y + ROW / 2 }, PEN_LEFT, 10, false, pen_ink,
			         "at %.1f us, spread %.1f", g->mean_us, spread);
		y += ROW;
	}
	return y + GAP;
}

/* --- the page ----------------------------------------------------------------------------------------------------- */

static void legend(const struct page *p)
{
	static const char *const text[] = { "left eye", "right eye", "pixels settling", "dark", "vblank" };
	const struct pen_colour colour[] = { pen_alpha(eye_colour[0], 0.6), pen_alpha(eye_colour[1], 0.6),
		                             { 0.65, 0.64, 0.60, 1 }, night, pen_grey };
	double x = RIGHT - 470;

	for (size_t i = 0; i < BB_ARRAY_LEN(text); i++) {
		pen_rect(p->cr, x, 20, 14, 10, colour[i], colour[i]);
		pen_text(p->cr, (struct pen_point){ x + 19, 25 }, PEN_LEFT, 11, false, pen_ink, "%s", text[i]);
		x += 36 + pen_text_width(p->cr, 11, text[i]);
	}
}

static void head(const struct page *p)
{
	const struct bb_plan *plan = p->plan;

	pen_text(p->cr, (struct pen_point){ 24, 26 }, PEN_LEFT, 16, true, pen_ink, "%s: one stereo cycle", p->room->name);
	pen_text(p->cr, (struct pen_point){ 24, 48 }, PEN_LEFT, 11.5, !plan->possible, plan->possible ? pen_grey : pen_camera,
	         plan->possible ? "planned for %g %% of crosstalk: light %.2f %%, crosstalk %.2f %%"
				: "NOT POSSIBLE for %g %% of crosstalk; the nearest there is: light %.2f %%, crosstalk %.2f %%",
	         plan->limit_percent, plan->worst.light_percent, plan->worst.crosstalk_percent);
	legend(p);
}

/* Has a wall before i the same picture? How many from i on do? */
static size_t n_alike(const struct bb_plan *plan, size_t i)
{
	size_t n = 0;

	for (size_t k = 0; k < plan->n_walls; k++)
		if (bb_phase_alike(&plan->wall[k], &plan->wall[i])) {
			if (k < i)
				return 0;
			n++;
		}
	return n;
}

static double walls(const struct page *p, double y)
{
	const struct bb_plan_timing *t = &p->plan->timing;
	bool shutters = false;

	for (size_t i = 0; i < p->plan->n_walls; i++) {
		const struct bb_plan_wall *w = &p->plan->wall[i];
		const size_t n = n_alike(p->plan, i);

		if (!n)
			continue;
		if (w->display->stereo == BB_STEREO_FRAME_SEQUENTIAL) {
			y = wall_track(p, w, n, y);
		} else if (!shutters) {
			y = lenses(p, "projector shutters", &p->room->chain.cell, t->shutter_at_us, t->shutter_open_us, y);
			shutters = true;
		}
	}
	y = lenses(p, "glasses", &p->room->chain.glasses, t->glasses_at_us, t->glasses_open_us, y);
	for (size_t i = 0; i < p->plan->n_walls; i++) {
		const size_t n = n_alike(p->plan, i);

		if (!n)
			continue;
		pen_text(p->cr, (struct pen_point){ 24, y + ROW / 2 }, PEN_LEFT, 10.5, true, pen_ink, n > 1 ? "%s + %zu" : "%s%.0zu",
		         p->plan->wall[i].id, n - 1);
		y = bands(p, &p->plan->wall[i], y);
	}
	return y;
}

static double tracks(struct page *p)
{
	double y = TOP;

	y = walls(p, y);
	y = tokens(p, y);
	y = cameras(p, y);
	return p->measured ? measured(p, y) : y;
}

static void paint(cairo_t *cr, void *ctx)
{
	struct page *p = ctx;

	p->cr = cr;
	pen_set(cr, pen_paper);
	cairo_paint(cr);
	head(p);
	axis(p, TOP - 8, p->height - GAP);
	tracks(p);
}

enum bb_status bb_phase_draw(const struct bb_room *room, const struct bb_plan *plan,
                             const struct bb_phase_edges *edges, const char *file, struct bb_error *err)
{
	struct page p = { .room = room, .plan = plan, .measured = edges };
	cairo_surface_t *nowhere = cairo_recording_surface_create(CAIRO_CONTENT_COLOR_ALPHA, NULL);

	p.cr = cairo_create(nowhere); /* drawn once for its height */
	p.height = tracks(&p) + GAP;
	cairo_destroy(p.cr);
	cairo_surface_destroy(nowhere);
	const struct bb_page out = { PAGE_WIDTH, p.height, "phase-", paint, &p };
	return bb_page_write(&out, file, err);
}

/* --- the trade ---------------------------------------------------------------------------------------------------- */

struct trade_page {
	const struct bb_room *room;
	const struct bb_phase_trade *trade;
	struct chart chart;
	struct chart_series series;
	double x[BB_ARRAY_LEN(((struct bb_phase_trade *)0)->point)], y[BB_ARRAY_LEN(((struct bb_phase_trade *)0)->point)];
};

static void paint_trade(cairo_t *cr, void *ctx)
{
	struct trade_page *p = ctx;

	pen_set(cr, pen_paper);
	cairo_paint(cr);
	pen_text(cr, (struct pen_point){ 24, 26 }, PEN_LEFT, 16, true, pen_ink, "%s: crosstalk against light", p->room->name);
	pen_text(cr, (struct pen_point){ 24, 47 }, PEN_LEFT, 11, false, pen_grey, "below %.3g %% nothing goes",
	         p->trade->least_percent);
	chart_draw(cr, &p->chart, 14, 64, 700, 430);
}

enum bb_status bb_phase_draw_trade(const struct bb_room *room, const struct bb_phase_trade *trade, const char *file,
                                   struct bb_error *err)
{
	struct trade_page p = { .room = room, .trade = trade };
	const struct bb_page page = { 728, 510, "phase-trade-", paint_trade, &p };

	for (size_t i = 0; i < trade->n; i++) {
		p.x[i] = trade->point[i].light.light_percent;
		p.y[i] = trade->point[i].light.crosstalk_percent;
	}
	p.series = (struct chart_series){ .colour = eye_colour[0], .x = p.x, .y = p.y, .n = trade->n, .width = 1.3,
		                          .mark = CHART_DOT };
	p.chart = (struct chart){ .title = "The brightest timing for each limit", .x_title = "light of the darkest rows, %",
		                  .y_title = "crosstalk of the worst rows, %", .series = &p.series, .n_series = 1 };
	return bb_page_write(&page, file, err);
}
