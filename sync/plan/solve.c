/*
 * sync/plan/solve.c: at every delay light grows with the opening, and so does, from some opening on, the crosstalk: the
 * longest opening within the limit is the best at its delay, and the delay is searched coarse to fine. One lens is
 * searched at a time: the glasses before frame-sequential walls, then the shutters of projectors behind them.
 */
#include "sync/plan/solve.h"

#include <math.h>

#define DELAYS 160       /* over a cycle */
#define OPENINGS 24
#define LEAST_OPEN_US 50 /* no lens does anything in less */
#define GAPS 8

const double plan_band_top[BB_PLAN_BANDS] = { 0, 0.45, 0.9 };
const double plan_band_bottom[BB_PLAN_BANDS] = { 0.1, 0.55, 1 };

struct search {
	const struct plan_task *task;
	bool external;        /* the projectors' shutters; else the glasses */
	double least, most;   /* opening */
	struct bb_plan_timing timing; /* of the other lens */
};

void plan_task_refresh(struct plan_task *t)
{
	t->period_us = plan_period_us(&t->chain);
	for (size_t i = 0; i < t->n_displays; i++)
		for (size_t b = 0; b < BB_PLAN_BANDS; b++)
			plan_band_init(&t->band[i][b], &t->display[i], t->period_us, plan_band_top[b], plan_band_bottom[b]);
}

static bool has(const struct plan_task *t, bool external)
{
	for (size_t i = 0; i < t->n_displays; i++)
		if (plan_external(&t->display[i]) == external)
			return true;
	return false;
}

static void take_worst(const struct plan_task *t, bool external, const struct plan_lenses *lenses,
                       struct bb_plan_light *worst)
{
	for (size_t i = 0; i < t->n_displays; i++)
		for (size_t b = 0; b < BB_PLAN_BANDS && plan_external(&t->display[i]) == external; b++) {
			/* without row times one strip of a display is like the other */
			const struct bb_plan_light l = plan_band_light(&t->band[i][b], lenses);

			worst->light_percent = fmin(worst->light_percent, l.light_percent);
			worst->crosstalk_percent = fmax(worst->crosstalk_percent, l.crosstalk_percent);
			if (external || t->display[i].scan == BB_SCAN_GLOBAL)
				break;
		}
}

struct bb_plan_light plan_task_light(const struct plan_task *t, const struct bb_plan_timing *timing)
{
	struct bb_plan_light worst = { (double)INFINITY, (double)-INFINITY };
	struct plan_lenses lenses;

	plan_lenses_init(&lenses, &t->chain, t->period_us, timing);
	take_worst(t, false, &lenses, &worst);
	take_worst(t, true, &lenses, &worst);
	return worst;
}

static struct bb_plan_timing with(const struct search *s, double at, double open)
{
	struct bb_plan_timing t = s->timing;

	*(s->external ? &t.shutter_at_us : &t.glasses_at_us) = at;
	*(s->external ? &t.shutter_open_us : &t.glasses_open_us) = open;
	return t;
}

static struct bb_plan_light probe(const struct search *s, double at, double open)
{
	const struct bb_plan_timing t = with(s, at, open);
	struct bb_plan_light worst = { (double)INFINITY, (double)-INFINITY };
	struct plan_lenses lenses;

	plan_lenses_init(&lenses, &s->task->chain, s->task->period_us, &t);
	take_worst(s->task, s->external, &lenses, &worst);
	return worst;
}

static double crosstalk(const struct search *s, double at, double open)
{
	return probe(s, at, open).crosstalk_percent;
}

/* The opening of least crosstalk between two: a lens that opens longer gains signal first and leakage later, so there is
 * one valley. */
static double valley(const struct search *s, double at, double low, double high)
{
	const double golden = 0.6180339887498949;
	double a = high - golden * (high - low), b = low + golden * (high - low);
	double at_a = crosstalk(s, at, a), at_b = crosstalk(s, at, b);

	while (high - low > 1) {
		if (at_a < at_b) {
			high = b;
			b = a;
			at_b = at_a;
			a = high - golden * (high - low);
			at_a = crosstalk(s, at, a);
		} else {
			low = a;
			a = b;
			at_a = at_b;
			b = low + golden * (high - low);
			at_b = crosstalk(s, at, b);
		}
	}
	return (low + high) / 2;
}

/* The longest opening within the limit at a delay; 0: none. */
static double widest(const struct search *s, double at)
{
	const double limit = s->task->limit_percent, step = (s->most - s->least) / OPENINGS;
	double good = 0, bad = s->most, least = (double)INFINITY, deepest = s->most;

	for (int i = 0; i <= (step > 0 ? OPENINGS : 0) && !(good > 0); i++) {
		const double open = s->most - step * i, percent = crosstalk(s, at, open);

		*(percent <= limit ? &good : &bad) = open;
		if (percent < least) {
			least = percent;
			deepest = open;
		}
	}
	if (!(good > 0) && step > 0 && least < 2 * limit) { /* the valley may lie between two steps */
		deepest = valley(s, at, fmax(deepest - step, s->least), fmin(deepest + step, s->most));
		good = crosstalk(s, at, deepest) <= limit ? deepest : 0;
		bad = fmin(deepest + step, s->most);
	}
	for (int i = 0; i < 20 && good > 0 && good < s->most; i++) {
		const double open = (good + bad) / 2;

		*(crosstalk(s, at, open) <= limit ? &good : &bad) = open;
	}
	return good;
}

struct choice {
	double at, open, light;
};

static void consider(const struct search *s, double at, struct choice *best)
{
	const double open = widest(s, at), light = open > 0 ? probe(s, at, open).light_percent : 0;

	if (light > best->light)
		*best = (struct choice){ at, open, light };
}

/* The brightest from a delay on either side, ever closer. */
static void sharpen(const struct search *s, double span, struct choice *best)
{
	for (int round = 0; round < 8; round++) { /* 104 us to 2 ns */
		const double centre = best->at;

		for (int i = -4; i <= 4; i++)
			consider(s, centre + span * i / 4, best);
		span /= 4;
	}
}

/* The least crosstalk there is, whatever the light. */
static struct choice nearest(const struct search *s, double *percent_out)
{
	const double cycle = 2 * s->task->period_us, ratio = s->most / s->least;
	struct choice best = { 0, s->most, 0 };
	const double factor = pow(ratio, 1.0 / 12);
	double least = (double)INFINITY, span = cycle / 32;

	for (int i = 0; i < 32; i++)
		for (int k = 0; k <= 12; k++) {
			const double at = span * i, open = s->least * pow(factor, k);
			const double percent = probe(s, at, open).crosstalk_percent;

			if (percent < least) {
				least = percent;
				best = (struct choice){ at, open, 0 };
			}
		}
	/* Each delay with its own best opening: what one band gains another loses, and the floor runs aslant. */
	const double low = fmax(best.open / factor / factor, s->least), high = fmin(best.open * factor * factor, s->most);
	while (span > 1) {
		const double centre = best.at;

		for (int i = -2; i <= 2; i++) {
			const double at = centre + span * i / 2, open = valley(s, at, low, high);
			const double percent = crosstalk(s, at, open);

			if (percent < least) {
				least = percent;
				best = (struct choice){ at, open, 0 };
			}
		}
		span /= 2;
	}
	*percent_out = least;
	return best;
}

static struct search search_for(const struct plan_task *t, bool external, const struct bb_plan_timing *timing)
{
	struct search s = { t, external, LEAST_OPEN_US, t->period_us, *timing };

	if (!external)
		s.most = t->period_us - t->gap_least_us;
	if (!external && t->paired)
		s.least = s.most = t->period_us;
	return s;
}

/* Near the edge it follows, -T/2 .. 3/2 T. */
static double normal(double at, double period_us)
{
	const double cycle = 2 * period_us;

	return at - cycle * floor((at + period_us / 2) / cycle);
}

static bool solve_lens(const struct search *s, struct choice *best)
{
	const double span = 2 * s->task->period_us / DELAYS;
	double percent;

	*best = (struct choice){ 0, 0, 0 };
	for (int i = 0; i < DELAYS; i++)
		consider(s, span * i, best);
	if (!(best->light > 0)) {
		*best = nearest(s, &percent);
		if (percent > s->task->limit_percent) {
			best->at = normal(best->at, s->task->period_us);
			return false;
		}
		best->light = probe(s, best->at, best->open).light_percent;
		consider(s, best->at, best);
	}
	sharpen(s, span, best);
	best->at = normal(best->at, s->task->period_us);
	return true;
}

/* Glasses that switch as the room says, but for the gap between them, which is chosen with the shutters. */
static bool solve_shutters(const struct plan_task *t, bool gap_is_free, struct bb_plan_timing *timing)
{
	const double widest_us = t->paired ? t->period_us : t->period_us - t->gap_least_us;
	struct choice best = { 0, 0, 0 };
	bool ok = false;

	for (int i = 0; i <= (gap_is_free && !t->paired ? GAPS : 0); i++) {
		struct bb_plan_timing trial = *timing;
		struct choice c;

		if (gap_is_free)
			trial.glasses_open_us = widest_us - t->period_us / 4 * i * i / (GAPS * GAPS);
		const struct search s = search_for(t, true, &trial);
		const bool solved = solve_lens(&s, &c);
		if (solved > ok || (solved == ok && c.light > best.light) || i == 0) {
			best = c;
			*timing = with(&s, c.at, c.open);
			ok = solved;
		}
	}
	return ok;
}

bool plan_solve(const struct plan_task *t, struct bb_plan_timing *out)
{
	const bool pictures = has(t, false), external = has(t, true);
	bool ok = true;

	*out = bb_plan_configured(&t->chain);
	if (pictures) {
		const struct search s = search_for(t, false, out);
		struct choice c;

		ok = solve_lens(&s, &c);
		*out = with(&s, c.at, c.open);
	}
	if (external)
		ok = solve_shutters(t, !pictures, out) && ok;
	return ok;
}

/* --- what it would take ------------------------------------------------------------------------------------------- */

static double of_cells(const struct plan_task *t, size_t member, bool most)
{
	const double *glasses = (const double *)(const void *)((const char *)&t->chain.glasses + member);
	const double *cell = (const double *)(const void *)((const char *)&t->chain.cell + member);

	if (!has(t, true))
		return *glasses;
	return most ? fmax(*glasses, *cell) : fmin(*glasses, *cell);
}

static void limit_cells(struct plan_task *t, size_t member, double value, bool most)
{
	double *const members[] = { (double *)(void *)((char *)&t->chain.glasses + member),
		                    (double *)(void *)((char *)&t->chain.cell + member) };

	for (size_t i = 0; i < 2; i++)
		*members[i] = most ? fmin(*members[i], value) : fmax(*members[i], value);
}

static double now(const struct plan_task *t, enum bb_plan_part part)
{
	double value = 0;

	switch (part) {
	case BB_PLAN_OPENING:
		return of_cells(t, offsetof(struct bb_cell, open_us), true);
	case BB_PLAN_CLOSING:
		return of_cells(t, offsetof(struct bb_cell, close_us), true);
	case BB_PLAN_CONTRAST:
		return of_cells(t, offsetof(struct bb_cell, contrast), false);
	case BB_PLAN_REFRESH:
		return bb_rate_hz(t->chain.rate);
	default:
		break;
	}
	for (size_t i = 0; i < t->n_displays; i++) {
		const struct bb_display_config *d = &t->display[i];
		const double v = part == BB_PLAN_PIXEL ? fmax(d->pixel_rise_us, d->pixel_fall_us) : bb_display_vblank_us(d);

		value = part == BB_PLAN_VBLANK && i ? fmin(value, v) : fmax(value, v);
	}
	return value;
}

static double ideal(const struct plan_task *t, enum bb_plan_part part)
{
	switch (part) {
	case BB_PLAN_VBLANK:
		return 0.9 * t->period_us;
	case BB_PLAN_CONTRAST:
		return 1e6;
	case BB_PLAN_REFRESH:
		return fmin(t->edges_least_hz, bb_rate_hz(t->chain.rate));
	default:
		return 0;
	}
}

/* The task with a part at a value, all else as it is: refresh keeps vblank, dark time and strobe. */
static void set(struct plan_task *t, enum bb_plan_part part, double value)
{
	const double slower = bb_rate_hz(t->chain.rate) / value;

	if (part == BB_PLAN_OPENING)
		limit_cells(t, offsetof(struct bb_cell, open_us), value, true);
	if (part == BB_PLAN_CLOSING)
		limit_cells(t, offsetof(struct bb_cell, close_us), value, true);
	if (part == BB_PLAN_CONTRAST)
		limit_cells(t, offsetof(struct bb_cell, contrast), value, false);
	if (part == BB_PLAN_REFRESH)
		t->chain.rate = bb_rate_from_hz(value);
	for (size_t i = 0; i < t->n_displays; i++) {
		struct bb_display_config *d = &t->display[i];

		if (part == BB_PLAN_PIXEL) {
			d->pixel_rise_us = fmin(d->pixel_rise_us, value);
			d->pixel_fall_us = fmin(d->pixel_fall_us, value);
		} else if (part == BB_PLAN_VBLANK) {
			d->vblank_us = fmax(bb_display_vblank_us(d), value);
		} else if (part == BB_PLAN_REFRESH) {
			d->vblank_us = bb_display_vblank_us(d);
			d->rate = bb_rate_from_hz(bb_rate_hz(d->rate) / slower);
		}
	}
	plan_task_refresh(t);
}

static double least_percent(const struct plan_task *t)
{
	const bool external = !has(t, false);
	const struct bb_plan_timing timing = bb_plan_configured(&t->chain);
	const struct search s = search_for(t, external, &timing);
	double percent;

	nearest(&s, &percent);
	return percent;
}

static double with_part(const struct plan_task *t, enum bb_plan_part part, double value)
{
	struct plan_task other = *t;

	set(&other, part, value);
	return least_percent(&other);
}

enum bb_plan_part plan_needs(const struct plan_task *t, struct bb_plan_need need[BB_PLAN_PARTS])
{
	enum bb_plan_part stops = BB_PLAN_PIXEL;
	double shortest = (double)INFINITY, least = (double)INFINITY;

	for (int p = 0; p < BB_PLAN_PARTS; p++) {
		const enum bb_plan_part part = (enum bb_plan_part)p;
		struct bb_plan_need *n = &need[p];
		double bad = now(t, part), good = ideal(t, part);

		*n = (struct bb_plan_need){ bad, (double)NAN, with_part(t, part, good) };
		for (int i = 0; i < 12 && n->ideal_percent <= t->limit_percent; i++) {
			const double middle = part == BB_PLAN_CONTRAST ? sqrt(good * bad) : (good + bad) / 2;

			*(with_part(t, part, middle) <= t->limit_percent ? &good : &bad) = middle;
			n->needed = good;
		}
		const double way = isnan(n->needed) ? (double)INFINITY
						    : fabs(log(fmax(n->needed, 1e-3) / fmax(n->now, 1e-3)));
		if (way < shortest || (isinf(shortest) && n->ideal_percent < least))
			stops = part;
		shortest = fmin(shortest, way);
		least = fmin(least, n->ideal_percent);
	}
	return stops;
}
