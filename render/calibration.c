/*
 * render/calibration.c: the picture by which a person checks a screen: is it the right one, for the right eye, the
 * right way up, of the right size, and does the tracked cursor stand where the wand is? No volume, no GL. Pixels of the
 * picture; lengths on the wall in metres. cairo is used in this file only (of render/).
 *
 * Grid lines lie where the room's own coordinate along the wall's edges is a multiple of 10 cm, so that they run on
 * from tile to tile and a tape measure laid on the wall agrees with them.
 */
#include <cairo.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/renderer.h"

#define GRID_M 0.1
#define LINES_MOST 2000 /* beyond this a grid is a grey area: a wall of 200 m, or a broken one */
#define TURN (2 * 3.14159265358979323846)

struct colour {
	double r, g, b;
};

static const struct colour background = { 0.035, 0.045, 0.065 }, fine = { 0.16, 0.20, 0.26 },
			   whole = { 0.36, 0.44, 0.54 }, frame = { 0.93, 0.95, 0.97 }, quiet = { 0.60, 0.66, 0.74 },
			   pointer = { 1.0, 0.86, 0.24 }, left_eye = { 0.28, 0.78, 1.0 },
			   right_eye = { 1.0, 0.50, 0.30 };

struct sheet { /* what all parts of the picture share */
	cairo_t *cr;
	const struct bb_view *view;
	double width, height; /* px */
	double width_m, height_m;
	double unit; /* px: everything that is not on the wall's own scale is a multiple of this */
};

static void ink(const struct sheet *s, struct colour c, double line_units)
{
	cairo_set_source_rgb(s->cr, c.r, c.g, c.b);
	cairo_set_line_width(s->cr, fmax(1, line_units * s->unit));
}

static void line(const struct sheet *s, double x0, double y0, double x1, double y1)
{
	cairo_move_to(s->cr, x0, y0);
	cairo_line_to(s->cr, x1, y1);
	cairo_stroke(s->cr);
}

/* Text with its middle at (x, y). */
static void text(const struct sheet *s, double x, double y, double size_px, cairo_font_weight_t weight,
		 const char *words)
{
	cairo_text_extents_t e;

	cairo_select_font_face(s->cr, "sans", CAIRO_FONT_SLANT_NORMAL, weight);
	cairo_set_font_size(s->cr, size_px);
	cairo_text_extents(s->cr, words, &e);
	cairo_move_to(s->cr, x - e.width / 2 - e.x_bearing, y - e.height / 2 - e.y_bearing);
	cairo_show_text(s->cr, words);
}

/* Lines across one edge: `from_m` is the room's coordinate at pixel 0 and it grows by length_m over `px` pixels. */
static void grid_lines(const struct sheet *s, double from_m, double length_m, bool upright, bool metres)
{
	const double px = upright ? s->width : s->height;
	const double first = ceil(from_m / GRID_M), n = floor((from_m + length_m) / GRID_M) - first;

	if (!(n >= 0 && n <= LINES_MOST))
		return;
	for (int i = 0; i <= (int)n; i++) {
		const double number = first + i;
		if ((fmod(number, 10) == 0) != metres)
			continue;
		/* From the lower left corner; half a pixel in, so that a thin line is one row of pixels; a line between
		 * two pixels takes the second whichever way it was rounded. */
		const double along = (number * GRID_M - from_m) / length_m * px;
		const double at = floor((upright ? along : px - along) + 1e-6) + 0.5;
		if (upright)
			line(s, at, 0, at, s->height);
		else
			line(s, 0, at, s->width, at);
	}
}

static void draw_grid(const struct sheet *s)
{
	const double x_m = bb_vec3_dot(s->view->corners.lower_left, s->view->right);
	const double y_m = bb_vec3_dot(s->view->corners.lower_left, s->view->up);

	ink(s, fine, 0.08);
	grid_lines(s, x_m, s->width_m, true, false);
	grid_lines(s, y_m, s->height_m, false, false);
	ink(s, whole, 0.16);
	grid_lines(s, x_m, s->width_m, true, true);
	grid_lines(s, y_m, s->height_m, false, true);
}

/* A border whose outermost pixels are lit: what the screen's own overscan or a bezel hides is seen at once. */
static void draw_frame(const struct sheet *s)
{
	const double w = fmax(1, floor(0.2 * s->unit)), arm = 3 * s->unit, gap = 1.2 * s->unit;

	ink(s, frame, 0);
	cairo_set_line_width(s->cr, w);
	cairo_rectangle(s->cr, w / 2, w / 2, s->width - w, s->height - w);
	cairo_stroke(s->cr);
	ink(s, frame, 0.35);
	for (int corner = 0; corner < 4; corner++) {
		const double sx = corner % 2 ? -1 : 1, sy = corner / 2 ? -1 : 1;
		const double x = corner % 2 ? s->width - gap : gap, y = corner / 2 ? s->height - gap : gap;
		cairo_move_to(s->cr, x + sx * arm, y);
		cairo_line_to(s->cr, x, y);
		cairo_line_to(s->cr, x, y + sy * arm);
		cairo_stroke(s->cr);
	}
}

static void draw_centre(const struct sheet *s)
{
	const double x = s->width / 2, y = s->height / 2, arm = 1.6 * s->unit;

	ink(s, frame, 0.18);
	line(s, x - arm, y, x + arm, y);
	line(s, x, y - arm, x, y + arm);
	cairo_new_path(s->cr);
	cairo_arc(s->cr, x, y, arm * 0.55, 0, TURN);
	cairo_stroke(s->cr);
}

/* Letter, shape, colour and side differ: one of them is left even on a screen without colour or in a torn picture. */
static void draw_eye(const struct sheet *s, bool is_left)
{
	const double r = 4.6 * s->unit, x = s->width * (is_left ? 0.27 : 0.73), y = s->height / 2;

	ink(s, background, 0);
	if (is_left)
		cairo_arc(s->cr, x, y, r, 0, TURN);
	else
		cairo_rectangle(s->cr, x - r * 0.92, y - r * 0.92, r * 1.84, r * 1.84);
	cairo_fill_preserve(s->cr);
	ink(s, is_left ? left_eye : right_eye, 0.6);
	cairo_stroke(s->cr);
	text(s, x, y, r * 1.25, CAIRO_FONT_WEIGHT_BOLD, is_left ? "L" : "R");
}

/* Text on a plate of background, so that no grid line runs through it. */
static void plate(const struct sheet *s, double y, double size_px, cairo_font_weight_t weight, struct colour c,
		  const char *words)
{
	cairo_text_extents_t e;

	cairo_select_font_face(s->cr, "sans", CAIRO_FONT_SLANT_NORMAL, weight);
	cairo_set_font_size(s->cr, size_px);
	cairo_text_extents(s->cr, words, &e);
	/* A long id is made to fit. */
	const double fit = fmin(1, s->width * 0.86 / fmax(1, e.width)), pad = size_px * fit * 0.35;
	ink(s, background, 0);
	cairo_rectangle(s->cr, s->width / 2 - e.width * fit / 2 - pad, y - size_px * fit / 2 - pad,
			e.width * fit + 2 * pad, size_px * fit + 2 * pad);
	cairo_fill(s->cr);
	ink(s, c, 0);
	text(s, s->width / 2, y, size_px * fit, weight, words);
}

static void draw_words(const struct sheet *s, const char *screen_id)
{
	char words[96];

	plate(s, s->height * 0.19, 4.2 * s->unit, CAIRO_FONT_WEIGHT_BOLD, frame, screen_id);
	snprintf(words, sizeof(words), "%.2f x %.2f m    %.0f x %.0f px    grid 10 cm", s->width_m, s->height_m,
		 s->width, s->height);
	plate(s, s->height * 0.19 + 4.6 * s->unit, 1.35 * s->unit, CAIRO_FONT_WEIGHT_NORMAL, quiet, words);
	/* An arrow up: which way the picture hangs. */
	const double x = s->width / 2, y = 2.2 * s->unit;
	ink(s, quiet, 0);
	cairo_move_to(s->cr, x, y - s->unit);
	cairo_line_to(s->cr, x + 0.8 * s->unit, y + 0.5 * s->unit);
	cairo_line_to(s->cr, x - 0.8 * s->unit, y + 0.5 * s->unit);
	cairo_close_path(s->cr);
	cairo_fill(s->cr);
}

/* The cross where the room point is seen through the wall; nothing when it is behind the eye or off the screen. */
static void draw_cursor(const struct sheet *s, struct bb_vec3 cursor)
{
	const double arm = 2.4 * s->unit, hole = 0.5 * s->unit;
	double ndc[3], w;
	char words[64];

	if (!isfinite(cursor.x) || !isfinite(cursor.y) || !isfinite(cursor.z))
		return;
	bb_view_project(s->view, cursor, ndc, &w);
	if (!(w > 0) || !(fabs(ndc[0]) < 1.5 && fabs(ndc[1]) < 1.5))
		return;
	const double x = (ndc[0] + 1) / 2 * s->width, y = (1 - ndc[1]) / 2 * s->height;
	for (int pass = 0; pass < 2; pass++) { /* a dark rim first: it stays visible on anything */
		ink(s, pass ? pointer : background, pass ? 0.28 : 0.75);
		line(s, x - arm, y, x - hole, y);
		line(s, x + hole, y, x + arm, y);
		line(s, x, y - arm, x, y - hole);
		line(s, x, y + hole, x, y + arm);
	}
	snprintf(words, sizeof(words), "%.2f  %.2f  %.2f m", cursor.x, cursor.y, cursor.z);
	text(s, x, y + arm + 1.1 * s->unit, 1.2 * s->unit, CAIRO_FONT_WEIGHT_NORMAL, words);
}

static void draw_all(const struct sheet *s, const char *screen_id, bool is_left, const struct bb_vec3 *cursor)
{
	cairo_set_source_rgb(s->cr, background.r, background.g, background.b);
	cairo_paint(s->cr);
	draw_grid(s);
	draw_frame(s);
	draw_centre(s);
	draw_words(s, screen_id);
	draw_eye(s, is_left);
	if (cursor)
		draw_cursor(s, *cursor);
}

/* cairo's pixels are native-endian 0xAARRGGBB words, ours are bytes in the order R, G, B, A. */
static void take_pixels(cairo_surface_t *surface, struct bb_image *image)
{
	const uint8_t *rows = cairo_image_surface_get_data(surface);
	const size_t stride = (size_t)cairo_image_surface_get_stride(surface);

	cairo_surface_flush(surface);
	for (size_t y = 0; y < image->height; y++)
		for (size_t x = 0; x < image->width; x++) {
			uint8_t *out = image->rgba + (y * image->width + x) * 4;
			uint32_t word;
			memcpy(&word, rows + y * stride + x * 4, sizeof(word));
			out[0] = (uint8_t)(word >> 16);
			out[1] = (uint8_t)(word >> 8);
			out[2] = (uint8_t)word;
			out[3] = 255;
		}
}

enum bb_status bb_calibration_draw(const struct bb_view *view, const char *screen_id, int eye_is_left,
				   const struct bb_vec3 *cursor, struct bb_image *image)
{
	if (!image->rgba)
		return BB_ERR_USAGE;
	cairo_surface_t *surface =
		cairo_image_surface_create(CAIRO_FORMAT_RGB24, (int)image->width, (int)image->height);
	struct sheet s = {
		.cr = cairo_create(surface),
		.view = view,
		.width = image->width,
		.height = image->height,
		.width_m = bb_vec3_norm(bb_vec3_sub(view->corners.lower_right, view->corners.lower_left)),
		.height_m = bb_vec3_norm(bb_vec3_sub(view->corners.upper_left, view->corners.lower_left)),
	};

	s.unit = fmin(s.width, s.height * 4 / 3) / 64;
	if (cairo_status(s.cr) == CAIRO_STATUS_SUCCESS)
		draw_all(&s, screen_id ? screen_id : "", eye_is_left != 0, cursor);
	/* Text that is not UTF-8 stops cairo half-way: an error of the caller's. */
	const cairo_status_t status = cairo_status(s.cr);
	if (status == CAIRO_STATUS_SUCCESS)
		take_pixels(surface, image);
	cairo_destroy(s.cr);
	cairo_surface_destroy(surface);
	return status == CAIRO_STATUS_SUCCESS ? BB_OK : status == CAIRO_STATUS_NO_MEMORY ? BB_ERR_NOMEM : BB_ERR_USAGE;
}
