#include "sync/plan/wave.h"

#include <assert.h>
#include <math.h>

#define LN9 2.1972245773362196

static double modulo(double t, double period)
{
	const double m = fmod(t, period);

	return m < 0 ? fmin(m + period, nextafter(period, 0)) : m;
}

static double piece_at(const struct bb_wave_piece *p, double t)
{
	return p->swing == 0 ? p->rest : p->rest + p->swing * exp(-p->rate * (t - p->from));
}

/* The piece that holds t, in [0, period). */
static unsigned find(const struct bb_wave *w, double t)
{
	unsigned i = w->n - 1;

	while (i > 0 && w->piece[i].from > t)
		i--;
	return i;
}

double bb_wave_at(const struct bb_wave *w, double t)
{
	const double m = modulo(t, w->period);

	return piece_at(&w->piece[find(w, m)], m);
}

/* Makes t, in [0, period], the begin of a piece; returns its index, n for the period itself. */
static unsigned cut(struct bb_wave *w, double t)
{
	const unsigned i = find(w, t);
	struct bb_wave_piece *p = &w->piece[i];

	if (p->from == t)
		return i;
	if (t >= w->period)
		return w->n;
	assert(w->n < BB_WAVE_PIECES);
	for (unsigned k = w->n++; k > i + 1; k--)
		w->piece[k] = w->piece[k - 1];
	p[1] = (struct bb_wave_piece){ t, p->rest, p->swing == 0 ? 0 : p->swing * exp(-p->rate * (t - p->from)), p->rate };
	return i + 1;
}

static void fill(struct bb_wave *w, double from, double to, const struct bb_wave_piece *value)
{
	const unsigned first = cut(w, from), last = cut(w, to);

	for (unsigned i = first; i < last; i++) {
		const double late = w->piece[i].from - value->from;

		w->piece[i].rest = value->rest;
		w->piece[i].rate = value->rate;
		w->piece[i].swing = value->swing == 0 ? 0 : value->swing * exp(-value->rate * late);
	}
}

/* From value->from, in [0, period), for length < period: over the end of the period if need be. */
static void fill_around(struct bb_wave *w, struct bb_wave_piece value, double length)
{
	const double to = value.from + length;

	fill(w, value.from, fmin(to, w->period), &value);
	if (to <= w->period)
		return;
	value.from -= w->period;
	fill(w, 0, to - w->period, &value);
}

void bb_wave_cell(struct bb_wave *w, double period, double at, double open, double rise_10_90, double fall_10_90,
                  double low, double high)
{
	const double up = rise_10_90 > 0 ? LN9 / rise_10_90 : 0, down = fall_10_90 > 0 ? LN9 / fall_10_90 : 0;
	const double left_up = up > 0 ? exp(-up * open) : 0, left_down = down > 0 ? exp(-down * (period - open)) : 0;
	const double top = (1 - left_up) / (1 - left_up * left_down); /* where opening gets to, in the steady state ... */
	const double span = high - low, foot = top * left_down;       /* ... and closing */
	const double opens = modulo(at, period), closes = modulo(at + open, period);

	*w = (struct bb_wave){ .period = period, .n = 1, .piece = { { 0, high, 0, 0 } } };
	if (open >= period)
		return;
	fill_around(w, (struct bb_wave_piece){ opens, high, up > 0 ? -span * (1 - foot) : 0, up }, open);
	fill_around(w, (struct bb_wave_piece){ closes, low, down > 0 ? span * top : 0, down }, period - open);
}

void bb_wave_blank(struct bb_wave *w, double from, double to)
{
	if (to > from)
		fill_around(w, (struct bb_wave_piece){ .from = modulo(from, w->period) }, to - from);
}

/* Integral of exp(-rate t) over a length. */
static double decay(double rate, double length)
{
	return rate > 0 ? -expm1(-rate * length) / rate : length;
}

double bb_wave_mean(const struct bb_wave *a, const struct bb_wave *b)
{
	double sum = 0, t = 0;
	unsigned i = 0, k = 0;

	while (t < a->period) {
		const struct bb_wave_piece *p = &a->piece[i], *q = &b->piece[k];
		const double p_end = i + 1 < a->n ? p[1].from : a->period, q_end = k + 1 < b->n ? q[1].from : b->period;
		const double end = fmin(p_end, q_end), length = end - t;
		const double p_swing = p->swing == 0 ? 0 : p->swing * exp(-p->rate * (t - p->from));
		const double q_swing = q->swing == 0 ? 0 : q->swing * exp(-q->rate * (t - q->from));

		sum += p->rest * q->rest * length;
		if (p_swing != 0)
			sum += p_swing * q->rest * decay(p->rate, length);
		if (q_swing != 0)
			sum += q_swing * p->rest * decay(q->rate, length);
		if (p_swing != 0 && q_swing != 0)
			sum += p_swing * q_swing * decay(p->rate + q->rate, length);
		i += p_end <= end;
		k += q_end <= end;
		t = end;
	}
	return sum / a->period;
}
