/*
 * render/transfer.c: transfer functions: loading, looking up, and the range question that decides which bricks can be
 * seen. The same interpolation answers all of them, so a brick called empty never shows a sample.
 */
#include "render/transfer.h"

#include "render/text.h"

#include <math.h>
#include <string.h>

static enum bb_status read_point(char *line, const struct bb_where *where, struct bb_transfer_point *out,
                                 struct bb_error *err)
{
	static const char *const name[5] = { "value", "red", "green", "blue", "opacity" };
	double v[5], spare;

	for (int i = 0; i < 5; i++) {
		switch (bb_text_read_number(&line, &v[i])) {
		case BB_TEXT_END:
			return bb_fail(err, BB_ERR_FORMAT, 1301, where, "%d numbers instead of five", i);
		case BB_TEXT_NOT_A_NUMBER:
			return bb_fail(err, BB_ERR_FORMAT, 1302, where, "the %s is not a finite number", name[i]);
		case BB_TEXT_NUMBER:
			break;
		}
		if (!(v[i] >= 0 && v[i] <= 1))
			return bb_fail(err, BB_ERR_FORMAT, 1303, where, "the %s is %g", name[i], v[i]);
	}
	if (bb_text_read_number(&line, &spare) != BB_TEXT_END)
		return bb_fail(err, BB_ERR_FORMAT, 1301, where, "more than five words");
	*out = (struct bb_transfer_point){ v[0], v[1], v[2], v[3], v[4] };
	return BB_OK;
}

static enum bb_status read_points(struct bb_text *text, struct bb_transfer *tf, struct bb_error *err)
{
	char *line;

	while ((line = bb_text_next(text))) {
		struct bb_transfer_point p;
		const enum bb_status status = read_point(line, &text->where, &p, err);
		if (status)
			return status;
		if (tf->n == BB_TRANSFER_POINTS_MAX)
			return bb_fail(err, BB_ERR_FORMAT, 1306, &text->where, "more than %d points",
			               BB_TRANSFER_POINTS_MAX);
		if (tf->n && !(p.value > tf->point[tf->n - 1].value))
			return bb_fail(err, BB_ERR_FORMAT, 1304, &text->where, "%g does not come after %g", p.value,
			               tf->point[tf->n - 1].value);
		tf->point[tf->n++] = p;
	}
	text->where.line = 0;
	if (tf->n < 2)
		return bb_fail(err, BB_ERR_FORMAT, 1305, &text->where, "%zu points", tf->n);
	return BB_OK;
}

static double least_visible(const struct bb_transfer *tf)
{
	if (tf->point[0].opacity > 0)
		return 0; /* below the first point its opacity goes on */
	for (size_t i = 1; i < tf->n; i++)
		if (tf->point[i].opacity > 0)
			return tf->point[i - 1].value;
	return 2;
}

enum bb_status bb_transfer_load(const char *path, struct bb_transfer *out, struct bb_error *err)
{
	struct bb_text text;

	memset(out, 0, sizeof(*out));
	out->least_visible = 2;
	enum bb_status status = bb_text_open(path, 1307, &text, err);
	if (status)
		return status;
	status = read_points(&text, out, err);
	bb_text_release(&text);
	if (!status)
		out->least_visible = least_visible(out);
	return status;
}

static double unit(double v)
{
	return v > 0 ? (v < 1 ? v : 1) : 0; /* NaN is 0 */
}

/* Index of the last point at or below v; 0 when there is none. */
static size_t segment(const struct bb_transfer *tf, double v)
{
	size_t lo = 0, hi = tf->n;

	while (hi - lo > 1) {
		const size_t mid = lo + (hi - lo) / 2;
		if (tf->point[mid].value <= v)
			lo = mid;
		else
			hi = mid;
	}
	return lo;
}

/* Rounding must not lift a sample over both ends, or an empty brick could show one. */
static double between(double a, double b, double t)
{
	const double v = a + (b - a) * t;
	const double least = a < b ? a : b, most = a < b ? b : a;

	return v < least ? least : v > most ? most : v;
}

void bb_transfer_at(const struct bb_transfer *tf, double v, double rgba[4])
{
	static const struct bb_transfer_point nothing;
	const size_t i = segment(tf, v = unit(v));
	const struct bb_transfer_point *a = tf->n ? &tf->point[i] : &nothing, *b = i + 1 < tf->n ? a + 1 : a;
	const double t = b == a || v <= a->value ? 0 : (v - a->value) / (b->value - a->value);

	rgba[0] = between(a->r, b->r, t);
	rgba[1] = between(a->g, b->g, t);
	rgba[2] = between(a->b, b->b, t);
	rgba[3] = between(a->opacity, b->opacity, t);
}

double bb_transfer_most_opacity(const struct bb_transfer *tf, double lo, double hi)
{
	double a[4], b[4];

	lo = unit(lo);
	hi = unit(hi);
	if (lo > hi) {
		const double swap = lo;
		lo = hi;
		hi = swap;
	}
	bb_transfer_at(tf, lo, a);
	bb_transfer_at(tf, hi, b);
	double most = a[3] > b[3] ? a[3] : b[3];
	for (size_t i = segment(tf, lo); i < tf->n && tf->point[i].value <= hi; i++)
		if (tf->point[i].value >= lo && tf->point[i].opacity > most)
			most = tf->point[i].opacity;
	return most;
}

double bb_transfer_opacity_for_step(double opacity, double step_ratio)
{
	if (!(opacity > 0) || !(step_ratio > 0))
		return 0;
	if (opacity >= 1)
		return 1;
	return -expm1(step_ratio * log1p(-opacity));
}
