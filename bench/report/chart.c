#include "bench/report/chart.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define TICK_SIZE 10.5
#define LABEL_SIZE 10.0
#define ROOM_LEFT 58.0
#define ROOM_RIGHT 16.0
#define ROOM_TOP 26.0
#define ROOM_BOTTOM 44.0
#define ZERO_ROOM 34.0 /* what a value of zero has on a logarithmic axis */
#define RADIUS 3.6
#define LABELS_MOST 64

struct axis {
	enum chart_scale scale;
	double low, high; /* of the data; logarithms on a logarithmic one */
	double from, to;  /* on the page */
	double zero;      /* where zero stands; NAN: there is none */
};

struct rectangle {
	double x, y, w, h;
};

struct drawn {
	cairo_t *cr;
	const struct chart *c;
	struct axis x, y;
	struct rectangle box;
	struct rectangle taken[LABELS_MOST];
	size_t n_taken;
};

/* ---- scales ---- */

static double scaled(const struct axis *a, double v)
{
	return a->scale == CHART_LINEAR ? v : a->scale == CHART_DECADES ? log10(v) : log2(v);
}

static double place(const struct axis *a, double v)
{
	if (a->scale != CHART_LINEAR && !(v > 0))
		return a->zero;
	return a->from + (scaled(a, v) - a->low) / (a->high - a->low) * (a->to - a->from);
}

static void extend(struct axis *a, double v, bool *zero)
{
	if (a->scale != CHART_LINEAR && !(v > 0)) {
		*zero = true;
		return;
	}
	a->low = fmin(a->low, scaled(a, v));
	a->high = fmax(a->high, scaled(a, v));
}

static struct axis fit(const struct chart *c, enum chart_scale scale, bool vertical, double from, double to)
{
	struct axis a = { scale, DBL_MAX, -DBL_MAX, from, to, (double)NAN };
	bool zero = false;

	for (size_t i = 0; i < c->n_series; i++)
		for (size_t k = 0; k < c->series[i].n; k++)
			if (isfinite(c->series[i].x[k]) && isfinite(c->series[i].y[k]))
				extend(&a, vertical ? c->series[i].y[k] : c->series[i].x[k], &zero);
	if (a.low > a.high)
		a.low = a.high = 0;
	const double air = a.high > a.low ? 0.06 * (a.high - a.low) : 0.5;
	a.low -= air;
	a.high += air;
	if (zero) {
		a.zero = from + (to > from ? 1 : -1) * ZERO_ROOM / 2;
		a.from += (to > from ? 1 : -1) * ZERO_ROOM;
	}
	return a;
}

/* ---- ticks ---- */

static double tick_step(double span, double n)
{
	const double raw = span / n, base = pow(10, floor(log10(raw))), digit = raw / base;

	return base * (digit <= 1 ? 1 : digit <= 2 ? 2 : digit <= 5 ? 5 : 10);
}

static void tick(const struct drawn *d, bool vertical, double at, const char *text)
{
	const struct rectangle *b = &d->box;

	if (vertical) {
		pen_line(d->cr, (struct pen_point){ b->x, at }, (struct pen_point){ b->x + b->w, at }, 0.5, pen_faint);
		pen_text(d->cr, (struct pen_point){ b->x - 7, at }, PEN_RIGHT, TICK_SIZE, false, pen_grey, "%s", text);
		return;
	}
	pen_line(d->cr, (struct pen_point){ at, b->y }, (struct pen_point){ at, b->y + b->h }, 0.5, pen_faint);
	pen_text(d->cr, (struct pen_point){ at, b->y + b->h + 12 }, PEN_CENTRE, TICK_SIZE, false, pen_grey, "%s", text);
}

static const char *number(char *out, size_t cap, double v)
{
	const double size = fabs(v);

	if (size >= 1e6 || (size > 0 && size < 1e-3))
		snprintf(out, cap, "%.0e", v);
	else
		snprintf(out, cap, "%.6g", size < 1e-12 ? 0 : v);
	return out;
}

/* 1, 2 and 5 of each decade as long as there are few; each octave, or every second or fourth. */
static void ticks_of_logarithm(const struct drawn *d, const struct axis *a, bool vertical)
{
	static const double few[] = { 1, 2, 5 }, many[] = { 1, 1.5, 2, 3, 4, 5, 6, 8 };
	const bool octaves = a->scale == CHART_OCTAVES;
	const double span = a->high - a->low, *digits = span < 1 ? many : few;
	const int every = octaves ? (span > 9 ? 2 : 1) : 1;
	const size_t n = octaves || span > 2.5 ? 1 : span < 1 ? BB_ARRAY_LEN(many) : BB_ARRAY_LEN(few);
	char text[32];

	for (int e = (int)floor(a->low) - 1; e <= (int)ceil(a->high); e++)
		for (size_t i = 0; i < n; i++) {
			const double v = (octaves ? exp2(e) : pow(10, e)) * digits[i];
			if (scaled(a, v) < a->low || scaled(a, v) > a->high || (e % every) != 0)
				continue;
			tick(d, vertical, place(a, v), number(text, sizeof(text), v));
		}
}

static void ticks(const struct drawn *d, const struct axis *a, bool vertical)
{
	char text[32];

	if (isfinite(a->zero))
		tick(d, vertical, a->zero, "0");
	if (a->scale != CHART_LINEAR) {
		ticks_of_logarithm(d, a, vertical);
		return;
	}
	const double step = tick_step(a->high - a->low, vertical ? 7 : 8);
	const double first = ceil(a->low / step), n = floor(a->high / step + 1e-9) - first + 1;
	for (int i = 0; i < 64 && i < n; i++) {
		const double v = (first + i) * step;
		tick(d, vertical, place(a, v), number(text, sizeof(text), v));
	}
}

static void frame(const struct drawn *d)
{
	const struct chart *c = d->c;
	const struct rectangle *b = &d->box;

	ticks(d, &d->x, false);
	ticks(d, &d->y, true);
	pen_line(d->cr, (struct pen_point){ b->x, b->y }, (struct pen_point){ b->x, b->y + b->h }, 0.9, pen_grey);
	pen_line(d->cr, (struct pen_point){ b->x, b->y + b->h }, (struct pen_point){ b->x + b->w, b->y + b->h }, 0.9,
	         pen_grey);
	pen_text(d->cr, (struct pen_point){ b->x, b->y - 14 }, PEN_LEFT, 12, true, pen_ink, "%s", c->title);
	pen_text(d->cr, (struct pen_point){ b->x + b->w, b->y + b->h + 29 }, PEN_RIGHT, 11, false, pen_ink, "%s", c->x_title);
	cairo_save(d->cr);
	cairo_translate(d->cr, b->x - ROOM_LEFT + 11, b->y);
	cairo_rotate(d->cr, -1.5707963267948966);
	pen_text(d->cr, (struct pen_point){ 0, 0 }, PEN_RIGHT, 11, false, pen_ink, "%s", c->y_title);
	cairo_restore(d->cr);
}

/* ---- what is drawn into it ---- */

static void mark_at(cairo_t *cr, enum chart_mark mark, struct pen_colour colour, double x, double y)
{
	pen_set(cr, colour);
	cairo_new_path(cr);
	if (mark == CHART_DIAMOND) {
		cairo_move_to(cr, x, y - RADIUS - 0.8);
		cairo_line_to(cr, x + RADIUS + 0.8, y);
		cairo_line_to(cr, x, y + RADIUS + 0.8);
		cairo_line_to(cr, x - RADIUS - 0.8, y);
		cairo_close_path(cr);
	} else if (mark == CHART_SQUARE) {
		cairo_rectangle(cr, x - RADIUS + 0.5, y - RADIUS + 0.5, 2 * RADIUS - 1, 2 * RADIUS - 1);
	} else {
		cairo_arc(cr, x, y, mark == CHART_RING ? RADIUS + 2.4 : RADIUS, 0, 6.283185307179586);
	}
	cairo_set_line_width(cr, 1.4);
	if (mark == CHART_RING) {
		cairo_stroke(cr);
		return;
	}
	cairo_fill_preserve(cr);
	pen_set(cr, pen_paper); /* neighbours stay apart */
	cairo_set_line_width(cr, 0.7);
	cairo_stroke(cr);
}

static void draw_line(const struct drawn *d, const struct chart_series *s)
{
	static const double dash[] = { 5, 3 };
	double last_y = 0;
	bool begun = false;

	cairo_save(d->cr);
	if (s->dashed)
		cairo_set_dash(d->cr, dash, 2, 0);
	pen_set(d->cr, s->colour);
	cairo_set_line_width(d->cr, s->width);
	cairo_set_line_join(d->cr, CAIRO_LINE_JOIN_ROUND);
	for (size_t i = 0; i < s->n; i++) {
		if (!isfinite(s->x[i]) || !isfinite(s->y[i]))
			continue;
		const double x = place(&d->x, s->x[i]), y = place(&d->y, s->y[i]);
		if (!begun)
			cairo_move_to(d->cr, x, y);
		else if (s->stairs)
			cairo_line_to(d->cr, x, last_y);
		if (begun)
			cairo_line_to(d->cr, x, y);
		last_y = y;
		begun = true;
	}
	cairo_stroke(d->cr);
	cairo_restore(d->cr);
}

static void draw_series(const struct drawn *d, const struct chart_series *s)
{
	if (s->width > 0)
		draw_line(d, s);
	for (size_t i = 0; i < s->n && s->mark != CHART_NONE; i++)
		if (isfinite(s->x[i]) && isfinite(s->y[i]))
			mark_at(d->cr, s->mark, s->colour, place(&d->x, s->x[i]), place(&d->y, s->y[i]));
}

/* ---- labels ---- */

static bool apart(const struct rectangle *a, const struct rectangle *b)
{
	return a->x + a->w <= b->x || b->x + b->w <= a->x || a->y + a->h <= b->y || b->y + b->h <= a->y;
}

static bool holds(const struct rectangle *r, double x, double y)
{
	return x > r->x - RADIUS && x < r->x + r->w + RADIUS && y > r->y - RADIUS && y < r->y + r->h + RADIUS;
}

/* Marks of this chart that a label would cover; those of lines without marks do not count. */
static bool covers_a_mark(const struct drawn *d, const struct rectangle *r)
{
	for (size_t i = 0; i < d->c->n_series; i++) {
		const struct chart_series *s = &d->c->series[i];
		for (size_t k = 0; k < s->n && s->mark != CHART_NONE; k++)
			if (isfinite(s->x[k]) && isfinite(s->y[k]) && holds(r, place(&d->x, s->x[k]), place(&d->y, s->y[k])))
				return true;
	}
	return false;
}

static bool is_free(const struct drawn *d, const struct rectangle *r)
{
	const struct rectangle *b = &d->box;

	if (r->x < b->x + 2 || r->y < b->y - 4 || r->x + r->w > b->x + b->w + ROOM_RIGHT - 2 || r->y + r->h > b->y + b->h - 1)
		return false;
	for (size_t i = 0; i < d->n_taken; i++)
		if (!apart(r, &d->taken[i]))
			return false;
	return !covers_a_mark(d, r);
}

/* Beside its point if there is room, else above or below it, else farther off with a hair line, else not at all. */
static void draw_label(struct drawn *d, const struct chart_label *l)
{
	static const double way[][2] = { { 1, 0 },   { -1, 0 },   { 0, -1 },   { 0, 1 },    { 1, -1 }, { -1, -1 },
					 { 1, 1 },   { -1, 1 },   { 1, -2.2 }, { -1, -2.2 }, { 1, 2.2 }, { -1, 2.2 },
					 { 2.5, -3 }, { -2.5, -3 }, { 2.5, 3 },  { -2.5, 3 } };
	const double w = pen_text_width(d->cr, LABEL_SIZE, l->text), h = LABEL_SIZE + 2;
	const double x = place(&d->x, l->x), y = place(&d->y, l->y);

	for (size_t i = 0; i < BB_ARRAY_LEN(way) && d->n_taken < LABELS_MOST; i++) {
		const double cx = x + way[i][0] * (RADIUS + 5) + (way[i][0] > 0 ? w / 2 : way[i][0] < 0 ? -w / 2 : 0);
		const double cy = y + way[i][1] * (h + 1);
		const struct rectangle r = { cx - w / 2, cy - h / 2, w, h };
		if (!is_free(d, &r))
			continue;
		if (fabs(way[i][1]) > 1.5)
			pen_line(d->cr, (struct pen_point){ x, y },
			         (struct pen_point){ way[i][0] > 0 ? r.x : r.x + w, cy }, 0.5, pen_grey);
		pen_set(d->cr, pen_alpha(pen_paper, 0.85)); /* a line behind it does not strike it out */
		cairo_rectangle(d->cr, r.x - 1, r.y, r.w + 2, r.h);
		cairo_fill(d->cr);
		pen_text(d->cr, (struct pen_point){ cx, cy }, PEN_CENTRE, LABEL_SIZE, false, pen_ink, "%s", l->text);
		d->taken[d->n_taken++] = r;
		return;
	}
}

void chart_draw(cairo_t *cr, const struct chart *c, double left, double top, double width, double height)
{
	struct drawn d = { .cr = cr, .c = c };

	d.box = (struct rectangle){ left + ROOM_LEFT, top + ROOM_TOP, width - ROOM_LEFT - ROOM_RIGHT,
				    height - ROOM_TOP - ROOM_BOTTOM };
	d.x = fit(c, c->x_scale, false, d.box.x, d.box.x + d.box.w);
	d.y = fit(c, c->y_scale, true, d.box.y + d.box.h, d.box.y);
	if (c->y_held) {
		d.y.low = c->y_low;
		d.y.high = c->y_high;
	}
	frame(&d);
	cairo_save(cr);
	cairo_rectangle(cr, d.box.x, d.box.y - 8, d.box.w + 8, d.box.h + 16);
	cairo_clip(cr);
	for (size_t i = 0; i < c->n_series; i++)
		draw_series(&d, &c->series[i]);
	cairo_restore(cr);
	for (size_t i = 0; i < c->n_labels; i++)
		draw_label(&d, &c->labels[i]);
}

double chart_legend(cairo_t *cr, const struct chart_series *series, size_t n, double left, double y)
{
	for (size_t i = 0; i < n; i++) {
		const struct chart_series *s = &series[i];
		if (!s->name || !s->n)
			continue;
		if (s->width > 0)
			pen_line(cr, (struct pen_point){ left, y }, (struct pen_point){ left + 18, y }, s->width, s->colour);
		if (s->mark != CHART_NONE)
			mark_at(cr, s->mark, s->colour, left + 9, y);
		pen_text(cr, (struct pen_point){ left + 24, y }, PEN_LEFT, 11, false, pen_ink, "%s", s->name);
		left += 24 + pen_text_width(cr, 11, s->name) + 18;
	}
	return left;
}
