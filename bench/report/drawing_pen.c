#include "bench/report/drawing_pen.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const struct pen_colour pen_ink = { 0.13, 0.15, 0.18, 1 };
const struct pen_colour pen_grey = { 0.45, 0.48, 0.52, 1 };
const struct pen_colour pen_faint = { 0.80, 0.82, 0.85, 1 };
const struct pen_colour pen_paper = { 1, 1, 1, 1 };
const struct pen_colour pen_truth = { 0.10, 0.36, 0.68, 1 };
const struct pen_colour pen_tracked = { 0.86, 0.42, 0.08, 1 };
const struct pen_colour pen_camera = { 0.62, 0.11, 0.16, 1 };
const struct pen_colour pen_door = { 0.05, 0.45, 0.38, 1 };

struct pen_colour pen_alpha(struct pen_colour c, double a)
{
	c.a = a;
	return c;
}

/* Hues a golden angle apart, two lightnesses in turn: neighbours differ, ink stays readable on all of them. */
struct pen_colour pen_node_colour(size_t node)
{
	const double hue = fmod(0.58 + 0.6180339887498949 * (double)node, 1), light = node & 1 ? 0.70 : 0.80;
	const double strength = 0.45 * (1 - fabs(2 * light - 1));
	double rgb[3];

	for (int i = 0; i < 3; i++) {
		const double h = fmod(hue + (3 - i) / 3.0, 1) * 6;
		rgb[i] = light + strength * (fmin(fmax(fabs(h - 3) - 1, 0), 1) - 0.5);
	}
	return (struct pen_colour){ rgb[0], rgb[1], rgb[2], 1 };
}

void pen_set(cairo_t *cr, struct pen_colour c)
{
	cairo_set_source_rgba(cr, c.r, c.g, c.b, c.a);
}

void pen_line(cairo_t *cr, struct pen_point a, struct pen_point b, double width, struct pen_colour c)
{
	pen_set(cr, c);
	cairo_set_line_width(cr, width);
	cairo_move_to(cr, a.x, a.y);
	cairo_line_to(cr, b.x, b.y);
	cairo_stroke(cr);
}

void pen_rect(cairo_t *cr, double x, double y, double w, double h, struct pen_colour fill, struct pen_colour edge)
{
	cairo_rectangle(cr, x, y, w, h);
	pen_set(cr, fill);
	cairo_fill_preserve(cr);
	pen_set(cr, edge);
	cairo_set_line_width(cr, 0.6);
	cairo_stroke(cr);
}

static size_t utf8_length(const unsigned char *s)
{
	const size_t n = s[0] < 0x80 ? 1 : s[0] < 0xC2 || s[0] > 0xF4 ? 0 : s[0] < 0xE0 ? 2 : s[0] < 0xF0 ? 3 : 4;

	for (size_t i = 1; i < n; i++)
		if ((s[i] & 0xC0) != 0x80)
			return 0;
	if (n == 3 && ((s[0] == 0xE0 && s[1] < 0xA0) || (s[0] == 0xED && s[1] > 0x9F)))
		return 0;
	return n == 4 && ((s[0] == 0xF0 && s[1] < 0x90) || (s[0] == 0xF4 && s[1] > 0x8F)) ? 0 : n;
}

/* One odd byte would put the whole drawing into cairo's error state. */
static void clean(char *text)
{
	for (unsigned char *s = (unsigned char *)text; *s;) {
		const size_t n = utf8_length(s);
		if (!n || *s < 0x20)
			*s = '?';
		s += n ? n : 1;
	}
}

static void font(cairo_t *cr, double size, bool bold)
{
	cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL,
	                       bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
	cairo_set_font_size(cr, size);
}

static void put(cairo_t *cr, struct pen_point at, enum pen_anchor anchor, double size, const char *text)
{
	cairo_text_extents_t e;

	cairo_text_extents(cr, text, &e);
	const double shift = anchor == PEN_LEFT ? 0 : anchor == PEN_CENTRE ? e.x_advance / 2 : e.x_advance;
	cairo_move_to(cr, at.x - shift, at.y + 0.36 * size);
	cairo_show_text(cr, text);
}

void pen_text(cairo_t *cr, struct pen_point at, enum pen_anchor anchor, double size, bool bold, struct pen_colour c,
              const char *fmt, ...)
{
	char text[256];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	clean(text);
	font(cr, size, bold);
	pen_set(cr, c);
	put(cr, at, anchor, size, text);
}

double pen_text_width(cairo_t *cr, double size, const char *text)
{
	cairo_text_extents_t e;

	font(cr, size, false);
	cairo_text_extents(cr, text, &e);
	return e.x_advance;
}

void pen_dimension(cairo_t *cr, struct pen_point a, struct pen_point b, const char *fmt, ...)
{
	const double length = hypot(b.x - a.x, b.y - a.y), angle = atan2(b.y - a.y, b.x - a.x), size = 10.5;
	char text[64];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	clean(text);
	cairo_save(cr);
	cairo_translate(cr, a.x, a.y);
	cairo_rotate(cr, angle);
	pen_line(cr, (struct pen_point){ 0, 0 }, (struct pen_point){ length, 0 }, 0.7, pen_grey);
	for (int end = 0; end < 2; end++) { /* slanted ticks, as architects draw them */
		const double x = end * length;
		pen_line(cr, (struct pen_point){ x, -6 }, (struct pen_point){ x, 6 }, 0.7, pen_grey);
		pen_line(cr, (struct pen_point){ x - 3, 3 }, (struct pen_point){ x + 3, -3 }, 1.2, pen_ink);
	}
	const double width = pen_text_width(cr, size, text) + 8;
	cairo_rectangle(cr, length / 2 - width / 2, -7, width, 14);
	pen_set(cr, pen_paper);
	cairo_fill(cr);
	font(cr, size, false);
	pen_set(cr, pen_ink);
	put(cr, (struct pen_point){ length / 2, 0 }, PEN_CENTRE, size, text);
	cairo_restore(cr);
}

void pen_scale_bar(cairo_t *cr, struct pen_point at, double points_per_m, double most)
{
	const double decade = pow(10, floor(log10(most / points_per_m)));
	const double lead = most / points_per_m / decade, metres = decade * (lead >= 5 ? 5 : lead >= 2 ? 2 : 1);
	const double part = metres * points_per_m / 4;

	for (int i = 0; i < 4; i++)
		pen_rect(cr, at.x + i * part, at.y, part, 5, i & 1 ? pen_paper : pen_ink, pen_ink);
	pen_text(cr, (struct pen_point){ at.x, at.y + 14 }, PEN_CENTRE, 10, false, pen_ink, "0");
	if (metres >= 1)
		pen_text(cr, (struct pen_point){ at.x + 4 * part, at.y + 14 }, PEN_CENTRE, 10, false, pen_ink, "%g m", metres);
	else
		pen_text(cr, (struct pen_point){ at.x + 4 * part, at.y + 14 }, PEN_CENTRE, 10, false, pen_ink, "%g cm",
		         metres * 100);
}
