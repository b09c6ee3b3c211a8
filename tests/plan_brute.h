/*
 * tests/plan_brute.h: the phase plan's oracle: light of a display and of a lens stepped through time, microsecond by
 * microsecond, with no formula shared with sync/plan/; and a search of every delay and opening on that grid.
 *
 * For one delay all openings cost one addition each: with x the lens, e the light behind it and d the delay, the integral
 * of e x over the opening is a running sum, and that over the closing follows from the integral K of e against one
 * decaying exponential, which does not depend on where the lens opened.
 */
#ifndef BB_TESTS_PLAN_BRUTE_H
#define BB_TESTS_PLAN_BRUTE_H

#include <math.h>
#include <stdlib.h>

#include "sync/plan.h"

#define BRUTE_ROWS 24
#define BRUTE_LN9 2.1972245773362196

struct brute_grid {
	size_t n, period;      /* steps of a cycle, of half of it */
	double step_us;
	size_t n_bands;
	double *own[BB_PLAN_BANDS], *other[BB_PLAN_BANDS]; /* mean light in a step, n each */
};

static inline double brute_tau(double us_10_90)
{
	return us_10_90 > 0 ? us_10_90 / BRUTE_LN9 : 1e-6;
}

/* x follows a target that is 1 from step `at` for `open` steps; adds its mean in each step of the steady state to out. */
static inline void brute_follow(const struct brute_grid *g, double at_us, double open_us, double rise_us, double fall_us,
                                double weight, double *out)
{
	const double cycle = g->step_us * (double)g->n;
	double x = 0;

	for (int round = 0; round < 3; round++)
		for (size_t i = 0; i < g->n; i++) {
			double left = g->step_us, t = g->step_us * (double)i, sum = 0;

			while (left > 1e-9) { /* at most three parts: the target may change within the step */
				double since = fmod(t - at_us, cycle);
				since += since < 0 ? cycle : 0;
				const bool on = since < open_us;
				const double until = fmin(left, (on ? open_us : cycle) - since + 1e-9);
				const double tau = brute_tau(on ? rise_us : fall_us), target = on ? 1 : 0;

				sum += target * until + (x - target) * tau * (1 - exp(-until / tau));
				x = target + (x - target) * exp(-until / tau);
				t += until;
				left -= until;
			}
			if (round == 2)
				out[i] += weight * sum / g->step_us;
		}
}

/* Share of step i in which a display shines. */
static inline double brute_gate(const struct brute_grid *g, const struct bb_display_config *d, size_t i)
{
	const double period = g->step_us * (double)g->n / 2;
	double lit = 0;

	for (int k = 0; k < 32; k++) {
		const double t = g->step_us * ((double)i + (k + 0.5) / 32);
		const double to_picture = fmod(bb_display_vblank_us(d) - t + 4 * period, period);
		const double since_strobe = fmod(t - d->strobe_at_us + 4 * period, period);

		lit += (d->kind != BB_DISPLAY_STROBED || since_strobe < d->strobe_us) && to_picture >= d->dark_us;
	}
	return lit / 32;
}

static inline void brute_display(struct brute_grid *g, const struct bb_display_config *d)
{
	const double period = g->step_us * (double)g->n / 2, vblank = bb_display_vblank_us(d);

	for (size_t b = 0; b < g->n_bands; b++) {
		const double top = b == 0 ? 0 : b == 1 ? 0.45 : 0.9;
		const int rows = d->scan == BB_SCAN_GLOBAL ? 1 : BRUTE_ROWS;

		for (int r = 0; r < rows; r++) {
			const double p = top + 0.1 * (r + 0.5) / rows, y = d->scan == BB_SCAN_UP ? 1 - p : p;
			const double at = vblank + (d->scan == BB_SCAN_GLOBAL ? 0 : y * (period - vblank));

			brute_follow(g, at, period, d->pixel_rise_us, d->pixel_fall_us, 1.0 / rows, g->own[b]);
		}
		for (size_t i = 0; i < g->n; i++)
			g->own[b][i] *= brute_gate(g, d, i);
	}
}

static inline void brute_init(struct brute_grid *g, double period_us, size_t n_bands)
{
	g->n = (size_t)llround(period_us) * 2;
	g->period = g->n / 2;
	g->step_us = 2 * period_us / (double)g->n;
	g->n_bands = n_bands;
	for (size_t b = 0; b < n_bands; b++) {
		g->own[b] = calloc(g->n, sizeof(double));
		g->other[b] = calloc(g->n, sizeof(double));
	}
}

static inline void brute_free(struct brute_grid *g)
{
	for (size_t b = 0; b < g->n_bands; b++) {
		free(g->own[b]);
		free(g->other[b]);
	}
}

/* The other eye's light is this eye's, half a cycle later. */
static inline void brute_other(struct brute_grid *g)
{
	for (size_t b = 0; b < g->n_bands; b++)
		for (size_t i = 0; i < g->n; i++)
			g->other[b][(i + g->period) % g->n] = g->own[b][i];
}

struct brute_sums { /* of one band's light e and a delay that moves */
	const double *e;
	double all;            /* of e, as steps */
	double *k;             /* K at the begin of each step */
	double run, decayed;   /* over the opening so far: of e, and of e exp(-(t - d) / tau_open) */
};

static inline void brute_sums_init(struct brute_sums *s, const struct brute_grid *g, const double *e, double tau_close)
{
	const double keep = exp(-g->step_us / tau_close), part = tau_close / g->step_us * (1 - keep);
	double k = 0;

	s->e = e;
	s->all = 0;
	s->k = calloc(g->n, sizeof(double));
	for (int round = 0; round < 20; round++)
		for (size_t i = g->n; i-- > 0;) {
			k = e[i] * part + keep * k;
			s->k[i] = k;
		}
	for (size_t i = 0; i < g->n; i++)
		s->all += e[i];
}

struct brute_best {
	double light_percent, crosstalk_percent, at_us, open_us, least_percent;
	uint64_t tried;
};

/* Every `stride`-th delay of the cycle and opening up to `most_us`. */
static inline struct brute_best brute_search(const struct brute_grid *g, const struct bb_cell *cell, double most_us,
                                             double limit_percent, size_t stride)
{
	const double tau_open = brute_tau(cell->open_us), tau_close = brute_tau(cell->close_us), c = 1 / cell->contrast;
	const double keep = exp(-g->step_us / tau_open), part = tau_open / g->step_us * (1 - keep);
	const size_t most = (size_t)(most_us / g->step_us), n_sums = 2 * g->n_bands;
	struct brute_best best = { .least_percent = (double)INFINITY };
	struct brute_sums s[2 * BB_PLAN_BANDS];
	double *top = calloc(most + 1, sizeof(*top)), *foot = calloc(most + 1, sizeof(*foot)),
	       *tail = calloc(most + 1, sizeof(*tail));

	for (size_t i = 0; i < n_sums; i++)
		brute_sums_init(&s[i], g, i % 2 ? g->other[i / 2] : g->own[i / 2], tau_close);
	for (size_t m = 1; m <= most; m++) { /* the lens after many cycles: iterated, not solved */
		const double up = exp(-g->step_us * (double)m / tau_open);
		const double down = exp(-g->step_us * (double)(g->n - m) / tau_close);

		for (int i = 0; i < 50; i++) {
			top[m] = 1 - (1 - foot[m]) * up;
			foot[m] = top[m] * down;
		}
		tail[m] = down;
	}
	for (size_t d = 0; d < g->n; d += stride) {
		double fade = 1;

		for (size_t i = 0; i < n_sums; i++)
			s[i].run = s[i].decayed = 0;
		for (size_t m = 1; m <= most; m++) {
			const size_t now = (d + m - 1) % g->n, end = (d + m) % g->n;
			double light = (double)INFINITY, crosstalk = 0, seen[2 * BB_PLAN_BANDS];

			for (size_t i = 0; i < n_sums; i++) {
				s[i].run += s[i].e[now];
				s[i].decayed += s[i].e[now] * fade * part;
			}
			fade *= keep;
			if (m % stride)
				continue;
			for (size_t i = 0; i < n_sums; i++)
				seen[i] = c * s[i].all + (1 - c) * (s[i].run - (1 - foot[m]) * s[i].decayed +
				                                    top[m] * (s[i].k[end] - tail[m] * s[i].k[d]));
			for (size_t b = 0; b < g->n_bands; b++) {
				light = fmin(light, seen[2 * b]);
				crosstalk = fmax(crosstalk, 100 * seen[2 * b + 1] / seen[2 * b]);
			}
			best.tried++;
			best.least_percent = fmin(best.least_percent, crosstalk);
			light *= cell->transmission_percent / (double)g->n;
			if (crosstalk <= limit_percent && light > best.light_percent)
				best = (struct brute_best){ light, crosstalk, g->step_us * (double)d, g->step_us * (double)m,
					                    best.least_percent, best.tried };
		}
	}
	for (size_t i = 0; i < n_sums; i++)
		free(s[i].k);
	free(top);
	free(foot);
	free(tail);
	return best;
}

#endif
