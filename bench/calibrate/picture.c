/* bench/calibrate/picture.c: what a calibration left over: every camera's picture with its markers' residuals as strokes. */
#include <math.h>

#include "bench/calibrate/tell.h"
#include "bench/report/drawing_page.h"
#include "bench/report/drawing_pen.h"

#define PANEL 170.0
#define GAP 26.0
#define TOP 64.0
#define SIDE 24.0
#define STROKES_MOST 600 /* of a camera: more is one grey */

struct sheet {
	double width, height;
	const struct bb_calibrate_outcome *o;
	int columns;
	double longer; /* points a pixel of residual */
	double tall;   /* of a panel */
};

/* A stroke ten times the noise would be a third of a panel. */
static void draw_markers(cairo_t *cr, const struct sheet *s, size_t camera, double left, double top, double scale)
{
	const struct bb_bundle *b = &s->o->calibration->bundle;
	const struct bb_calibrate_camera *r = &s->o->calibration->report[camera];
	const size_t every = (r->n_used + r->n_out) / STROKES_MOST + 1;
	size_t seen = 0;

	for (size_t i = 0; i < b->n_obs; i++) {
		const struct bb_bundle_obs *o = &b->obs[i];
		if (o->camera != camera || seen++ % every || !isfinite(o->off_px[0]))
			continue;
		if (r->knocked && s->o->calibration->rod_ns[o->rod] < r->knocked_ns)
			continue;
		const struct pen_point at = { left + o->px[0] * scale, top + o->px[1] * scale };
		const double x = (double)o->off_px[0] * s->longer, y = (double)o->off_px[1] * s->longer;
		const double shrink = fmin(1, PANEL / 6 / fmax(hypot(x, y), 1e-9));
		const struct pen_point to = { at.x + x * shrink, at.y + y * shrink };
		pen_line(cr, at, to, 0.6, o->out ? pen_alpha(pen_camera, 0.35) : pen_alpha(pen_truth, 0.6));
	}
}

static void draw_panel(cairo_t *cr, const struct sheet *s, size_t i, double left, double top)
{
	const struct bb_camera_config *c = &s->o->calibration->cameras[i];
	const struct bb_calibrate_camera *r = &s->o->calibration->report[i];
	const double scale = PANEL / (double)c->width_px;

	pen_rect(cr, left, top, PANEL, scale * (double)c->height_px, pen_paper, pen_faint);
	cairo_save(cr);
	cairo_rectangle(cr, left, top, PANEL, scale * (double)c->height_px);
	cairo_clip(cr);
	draw_markers(cr, s, i, left, top, scale);
	cairo_restore(cr);
	pen_text(cr, (struct pen_point){ left, top - 8 }, PEN_LEFT, 9, true, pen_ink, "%s", c->id);
	pen_text(cr, (struct pen_point){ left + PANEL, top - 8 }, PEN_RIGHT, 8, false, r->knocked ? pen_camera : pen_grey,
	         r->knocked ? "%.3f px, %zu, knocked at %.1f s" : "%.3f px, %zu markers", r->rms_px, r->n_used,
	         (double)r->knocked_ns * 1e-9);
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct sheet *s = ctx;
	const struct bb_calibration *c = s->o->calibration;

	pen_rect(cr, 0, 0, s->width, s->height, pen_paper, pen_paper);
	pen_text(cr, (struct pen_point){ SIDE, 20 }, PEN_LEFT, 13, true, pen_ink, "%s: what calibration leaves over", s->o->room->name);
	pen_text(cr, (struct pen_point){ SIDE, 38 }, PEN_LEFT, 9, false, pen_grey,
	         "%.4f px rms per coordinate; strokes %.0f times too long; red: left out", c->rms_px,
	         s->longer / (PANEL / (double)c->cameras[0].width_px));
	for (size_t i = 0; i < c->n_cameras; i++) {
		const size_t column = i % (size_t)s->columns, row = i / (size_t)s->columns;
		draw_panel(cr, s, i, SIDE + (double)column * (PANEL + GAP / 2), TOP + GAP / 2 + (double)row * (s->tall + GAP));
	}
}

enum bb_status bb_calibrate_draw(const struct bb_calibrate_outcome *o, const char *file, struct bb_error *err)
{
	const struct bb_calibration *c = o->calibration;
	struct sheet s = { .o = o, .columns = c->n_cameras > 12 ? 6 : 4 };

	for (size_t i = 0; i < c->n_cameras; i++)
		s.tall = fmax(s.tall, PANEL * (double)c->cameras[i].height_px / (double)c->cameras[i].width_px);
	s.longer = PANEL / 30 / fmax(c->rms_px, 1e-6);
	const double rows = ceil((double)c->n_cameras / s.columns);
	s.width = 2 * SIDE + s.columns * (PANEL + GAP / 2);
	s.height = TOP + GAP + rows * (s.tall + GAP);
	const struct bb_page page = { .width = s.width,
		                      .height = s.height,
		                      .prefix = "calibration",
		                      .paint = paint,
		                      .ctx = &s };
	return bb_page_write(&page, file, err);
}
