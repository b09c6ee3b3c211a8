/* bench/trade/tracking_tell.c: cameras, noise and fidelity against pose error and cost, as a table, JSON and curves. */
#include <math.h>

#include "bench/file.h"
#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"
#include "bench/stats.h"
#include "bench/trade/tracking.h"

#define PAGE_WIDTH 1040.0
#define PAGE_HEIGHT 760.0

static const char *const knob_text[BB_TRACKING_KNOBS] = { "cameras", "deck", "noise", "fidelity" };

static const char *title_of(enum bb_tracking_knob k)
{
	static const char *const text[BB_TRACKING_KNOBS] = {
		"cabin: cameras, taken away in turn where the weakest decile suffers least",
		"deck: cameras, evenly round the room", "cabin, eight cameras: noise of a blob's centre, px",
		"cabin, eight cameras: fidelity of the simulation"
	};

	return text[k];
}

void bb_tracking_print(const struct bb_tracking *t, FILE *f)
{
	fprintf(f,
		"scenes/walk.path, the viewer's body in the way, unpredicted pose of the glasses at mid-exposure, %u frames a "
		"line\nat most (%u at fidelity 2). rms over all frames with a pose, and over those in which four cameras see three "
		"markers;\nseeing: cameras that see three, mean; ms a frame by the stopwatch: median, p99.\n",
		t->n_frames, t->n_pictures);
	for (size_t i = 0; i < t->n; i++) {
		const struct bb_tracking_point *p = &t->point[i];
		char a[4][24];
		if (!i || p->knob != p[-1].knob)
			fprintf(f, "\n%s\n%8s %6s %8s %8s %7s %8s %8s %9s %9s %8s %8s  %s\n", title_of(p->knob), "cameras", "px",
				"fidelity", "pose %", "seeing", "mm rms", "p95 mm", "deg rms", "mm (>=4)", "ms p50", "ms p99",
				p->knob == BB_TRACKING_CAMERAS ? "left out" : "");
		fprintf(f, "%8u %6.2f %8d %8.2f %7.1f %8s %8s %9s %9s %8.3f %8.3f  %s\n", p->n_cameras, p->noise_px, p->fidelity,
			100 * p->solved, p->seeing, bb_text_number(a[0], sizeof(a[0]), p->rms_mm),
			bb_text_number(a[1], sizeof(a[1]), p->p95_mm), bb_text_number(a[2], sizeof(a[2]), p->rms_deg),
			bb_text_number(a[3], sizeof(a[3]), p->four_mm), p->solve_ms, p->solve_p99_ms, p->left_out);
	}
}

static json_t *number(double v)
{
	return isfinite(v) ? json_real(v) : json_null();
}

json_t *bb_tracking_json(const struct bb_tracking *t)
{
	json_t *points = json_array();

	for (size_t i = 0; i < t->n; i++) {
		const struct bb_tracking_point *p = &t->point[i];
		json_t *o = json_pack("{s:s, s:i, s:f, s:i, s:s, s:i, s:f, s:f, s:f, s:f, s:f}", "knob", knob_text[p->knob], "cameras",
				      (int)p->n_cameras, "noise_px", p->noise_px, "fidelity", p->fidelity, "left_out",
				      p->left_out, "frames", (int)p->n_frames, "solved", p->solved, "four", p->four, "seeing",
				      p->seeing, "solve_ms", p->solve_ms, "solve_p99_ms", p->solve_p99_ms);
		json_object_set_new(o, "rms_mm", number(p->rms_mm));
		json_object_set_new(o, "p95_mm", number(p->p95_mm));
		json_object_set_new(o, "rms_deg", number(p->rms_deg));
		json_object_set_new(o, "four_mm", number(p->four_mm));
		json_object_set_new(o, "four_deg", number(p->four_deg));
		json_array_append_new(points, o);
	}
	return json_pack("{s:s, s:I, s:o}", "kind", "blackburst-trade-tracking", "seed", (json_int_t)t->seed, "points", points);
}

/* ---- curves ---- */

struct curve {
	double x[BB_TRACKING_POINTS_MAX], y[BB_TRACKING_POINTS_MAX];
	size_t n;
};

enum field { RMS_MM, P95_MM, RMS_DEG, SOLVE_MS };

static struct curve curve_of(const struct bb_tracking *t, enum bb_tracking_knob knob, enum field field)
{
	struct curve c = { .n = 0 };

	for (size_t i = 0; i < t->n; i++) {
		const struct bb_tracking_point *p = &t->point[i];
		const double y[] = { p->rms_mm, p->p95_mm, p->rms_deg, p->solve_ms };
		if (p->knob != knob)
			continue;
		c.x[c.n] = knob == BB_TRACKING_NOISE ? p->noise_px : p->n_cameras;
		c.y[c.n++] = y[field];
	}
	return c;
}

static struct chart_series series(const char *name, const struct curve *c, int colour, bool dashed)
{
	static const struct pen_colour colours[] = { { 0.00, 0.45, 0.70, 1 }, { 0.84, 0.37, 0.00, 1 }, { 0.00, 0.62, 0.45, 1 } };

	return (struct chart_series){ .name = name, .colour = colours[colour], .x = c->x, .y = c->y, .n = c->n, .width = 1.4,
				      .dashed = dashed, .mark = CHART_DOT };
}

static void draw(cairo_t *cr, const char *title, const char *x, const char *y, enum chart_scale x_scale,
		 enum chart_scale y_scale, const struct chart_series *s, size_t n, double left, double top)
{
	const struct chart chart = { .title = title, .x_title = x, .y_title = y, .x_scale = x_scale,
				     .y_scale = y_scale, .series = s, .n_series = n };

	chart_draw(cr, &chart, left, top, PAGE_WIDTH / 2 - 40, PAGE_HEIGHT / 2 - 50);
	chart_legend(cr, s, n, left + 60, top - 8);
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct bb_tracking *t = ctx;
	const double right = PAGE_WIDTH / 2 + 10, low = PAGE_HEIGHT / 2 + 30;
	struct curve c[8];

	pen_rect(cr, 0, 0, PAGE_WIDTH, PAGE_HEIGHT, pen_paper, pen_paper);
	c[0] = curve_of(t, BB_TRACKING_CAMERAS, RMS_MM);
	c[1] = curve_of(t, BB_TRACKING_CAMERAS, P95_MM);
	c[2] = curve_of(t, BB_TRACKING_DECK, RMS_MM);
	c[3] = curve_of(t, BB_TRACKING_CAMERAS, SOLVE_MS);
	c[4] = curve_of(t, BB_TRACKING_DECK, SOLVE_MS);
	c[5] = curve_of(t, BB_TRACKING_NOISE, RMS_MM);
	c[6] = curve_of(t, BB_TRACKING_NOISE, RMS_DEG);
	const struct chart_series where[] = { series("cabin, rms", &c[0], 0, false), series("cabin, p95", &c[1], 0, true),
					      series("deck, rms", &c[2], 1, false) };
	const struct chart_series cost[] = { series("cabin", &c[3], 0, false), series("deck", &c[4], 1, false) };
	const struct chart_series mm[] = { series("position, mm rms", &c[5], 0, false) };
	const struct chart_series deg[] = { series("angle, degrees rms", &c[6], 2, false) };
	draw(cr, "Position error by number of cameras", "cameras", "mm", CHART_LINEAR, CHART_DECADES, where, 3, 20, 30);
	draw(cr, "Solving a frame", "cameras", "ms, median", CHART_LINEAR, CHART_LINEAR, cost, 2, right, 30);
	draw(cr, "Position error by blob noise, eight cameras", "noise of a blob's centre, px", "mm", CHART_DECADES, CHART_DECADES, mm, 1, 20, low);
	draw(cr, "Angle error by blob noise, eight cameras", "noise of a blob's centre, px", "degrees", CHART_DECADES, CHART_DECADES, deg, 1,
	     right, low);
}

enum bb_status bb_tracking_plot(const struct bb_tracking *t, const char *path, struct bb_error *err)
{
	struct bb_tracking copy = *t;
	const struct bb_page page = {
		.width = PAGE_WIDTH, .height = PAGE_HEIGHT, .prefix = "tracking", .paint = paint, .ctx = &copy
	};

	return bb_page_write(&page, path, err);
}
