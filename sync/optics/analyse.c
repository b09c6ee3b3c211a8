/*
 * sync/optics/analyse.c: the two passes over the samples, and what they are kept in. What is made of it stands in
 * sync/optics/conclude.c.
 */
#include "sync/optics/analyse_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEAST_CYCLES 4
#define NOISE_RAD2 0.25 /* what scatters more than that from cycle to cycle has no phase */

static const double turn = 6.283185307179586;

/* ---- making ---- */

static size_t clock_of(struct bb_analyser *a, const char *wall)
{
	for (size_t i = 0; i < a->n_clocks; i++)
		if (!strcmp(a->clock[i].wall, wall))
			return i;
	if (a->n_clocks == OPTICS_CLOCKS)
		return OPTICS_CLOCKS;
	memcpy(a->clock[a->n_clocks].wall, wall, sizeof(a->clock[0].wall));
	return a->n_clocks++;
}

/* Folds are taken where something is made of them: bare light of one eye, a lens before a lamp; the others for a
 * drawing. */
static bool take_folds(struct bb_analyser *a)
{
	for (size_t c = 0; c < a->r.n_channels; c++)
		for (int p = 0; p < BB_PATTERN_COUNT; p++) {
			const bool lamp = a->r.channel[c].spot == BB_SPOT_LAMP;
			if (a->r.channel[c].spot == BB_SPOT_TAG || (lamp && p))
				continue;
			a->channel[c].fold[p] = calloc(OPTICS_BINS, sizeof(struct bb_fold));
			if (!a->channel[c].fold[p])
				return false;
		}
	return true;
}

enum bb_status bb_analyser_create(const struct bb_recording *r, struct bb_analyser **out)
{
	struct bb_analyser *a;

	*out = NULL;
	if (!r->n_shows || !r->n_channels || !r->rate.num || !r->rate.den || r->n_shows > BB_SHOWS_MAX ||
	    r->n_channels > BB_CHANNELS_MAX)
		return BB_ERR_CONFIG;
	a = calloc(1, sizeof(*a));
	if (!a)
		return BB_ERR_NOMEM;
	a->r = *r;
	a->nominal_ns = 2e9 * r->rate.den / r->rate.num;
	a->middle_ns = r->show[0].from_ns + (r->show[r->n_shows - 1].to_ns - r->show[0].from_ns) / 2;
	a->tag_from_ns = r->show[0].from_ns + (int64_t)(OPTICS_GUARD * a->nominal_ns);
	for (size_t c = 0; c < r->n_channels; c++)
		a->channel[c].clock = clock_of(a, r->channel[c].wall);
	if (!take_folds(a)) {
		bb_analyser_destroy(a);
		return BB_ERR_NOMEM;
	}
	*out = a;
	return BB_OK;
}

void bb_analyser_destroy(struct bb_analyser *a)
{
	if (!a)
		return;
	for (size_t c = 0; c < a->r.n_channels; c++)
		for (int p = 0; p < BB_PATTERN_COUNT; p++)
			free(a->channel[c].fold[p]);
	free(a);
}

/* ---- the first pass ---- */

static int show_at(const struct bb_analyser *a, int64_t at_ns)
{
	for (size_t i = 0; i < a->r.n_shows; i++)
		if (at_ns >= a->r.show[i].from_ns && at_ns < a->r.show[i].to_ns)
			return (int)i;
	return -1;
}

static void trend_add(struct trend *t, double at_s, double value)
{
	t->n++;
	t->x += at_s;
	t->y += value;
	t->xx += at_s * at_s;
	t->xy += at_s * value;
	t->yy += value * value;
}

static void scatter_add(struct scatter *s, double value)
{
	for (unsigned i = 0; i < s->n_last; i++) {
		const double d = value - s->last[i];
		s->n[i]++;
		s->sum[i] += d;
		s->squares[i] += d * d;
	}
	for (unsigned i = OPTICS_LAGS - 1; i > 0; i--)
		s->last[i] = s->last[i - 1];
	s->last[0] = value;
	s->n_last += s->n_last < OPTICS_LAGS;
}

/* Each show has its own trend: sums of squares about it are what adds up. */
void bb_scatter_pool(struct scatter *into, const struct scatter *s)
{
	for (unsigned i = 0; i < OPTICS_LAGS; i++)
		if (s->n[i] > 1) {
			into->n[i] += s->n[i] - 1;
			into->squares[i] += s->squares[i] - s->sum[i] * s->sum[i] / s->n[i];
		}
}

double bb_scatter_variance(const struct scatter *s)
{
	double least = (double)NAN;

	for (unsigned i = 0; i < OPTICS_LAGS; i++)
		if (s->n[i] > 2)
			least = fmin(least, fmax(s->squares[i], 0) / s->n[i] / 2); /* fmin passes over NAN */
	return least;
}

/* A whole cycle is over: its phasor says when the pulse came, its integral how much light there was. */
static void close_cycle(struct bb_analyser *a, struct part *p, double at_s)
{
	double phase = atan2(p->im, p->re);

	if (p->trend.n > 0)
		phase = p->last_phase + remainder(phase - p->last_phase, turn);
	p->last_phase = phase;
	p->amplitude += hypot(p->re, p->im) / a->nominal_ns;
	p->samples += p->n;
	trend_add(&p->trend, at_s, phase);
	trend_add(&p->mean, at_s, p->area / a->nominal_ns);
	scatter_add(&p->phase_scatter, phase);
	scatter_add(&p->mean_scatter, p->area / a->nominal_ns);
	p->re = p->im = p->area = p->n = 0;
}

struct turned {
	double re, im;
};

/* The trapezoid between two samples, and the phasor of it. */
static void integrate(struct part *p, double y0, double y1, struct turned w0, struct turned w1, double dt_ns)
{
	p->re += (y0 * w0.re + y1 * w1.re) * dt_ns / 2;
	p->im += (y0 * w0.im + y1 * w1.im) * dt_ns / 2;
	p->area += (y0 + y1) / 2 * dt_ns;
	p->n++;
}

static struct turned phasor(const struct bb_analyser *a, double since_ns)
{
	const double angle = -turn * since_ns / a->nominal_ns;

	return (struct turned){ cos(angle), sin(angle) };
}

/* One interval of one show; it may end a cycle. */
static void step_show(struct bb_analyser *a, const struct bb_showing *show, size_t s, int64_t at_ns, const double *volts)
{
	const double t0 = (double)(a->last_ns - show->from_ns), t1 = (double)(at_ns - show->from_ns);
	const double cycle = floor(t1 / a->nominal_ns), edge = cycle * a->nominal_ns;
	const bool ends = edge > t0;
	const double share = ends ? (edge - t0) / (t1 - t0) : 0;
	const struct turned w0 = phasor(a, t0), w1 = phasor(a, t1), we = phasor(a, edge);

	if (t1 < (OPTICS_GUARD - 1) * a->nominal_ns || t1 - t0 > a->nominal_ns / 4)
		return;
	for (size_t c = 0; c < a->r.n_channels; c++) {
		struct part *p = &a->channel[c].part[s];
		const double y0 = a->last[c], y1 = volts[c];
		if (!ends) {
			integrate(p, y0, y1, w0, w1, t1 - t0);
			continue;
		}
		const double ye = y0 + share * (y1 - y0);
		integrate(p, y0, ye, w0, we, edge - t0);
		if (cycle > OPTICS_GUARD + 0.5)
			close_cycle(a, p, (edge - a->nominal_ns / 2 + (double)(show->from_ns - a->middle_ns)) * 1e-9);
		p->re = p->im = p->area = p->n = 0;
		integrate(p, ye, y1, we, w1, t1 - edge);
	}
}

void bb_analyser_scan(struct bb_analyser *a, int64_t at_ns, const double *volts)
{
	const int s = a->n_samples ? show_at(a, a->last_ns) : -1;

	if (s >= 0) /* the interval that ends a show may end its last cycle, too */
		step_show(a, &a->r.show[s], (size_t)s, at_ns, volts);
	for (size_t c = 0; c < a->r.n_channels; c++) {
		struct tag *t = &a->channel[c].tag;
		t->low = a->n_samples ? fmin(t->low, volts[c]) : volts[c];
		t->high = a->n_samples ? fmax(t->high, volts[c]) : volts[c];
	}
	a->last_ns = at_ns;
	memcpy(a->last, volts, a->r.n_channels * sizeof(double));
	a->n_samples++;
}

/* ---- between the passes ---- */

struct line {
	double slope, variance, at, value; /* value at the middle of the points, and its scatter about the line */
	double scatter;
};

bool bb_trend_line(const struct trend *t, double *slope, double *slope_variance, double *scatter)
{
	const double n = t->n, sxx = t->xx - t->x * t->x / n, sxy = t->xy - t->x * t->y / n, syy = t->yy - t->y * t->y / n;

	if (n < LEAST_CYCLES || !(sxx > 0))
		return false;
	*slope = sxy / sxx;
	*scatter = fmax((syy - *slope * sxy) / (n - 2), 1e-18);
	*slope_variance = *scatter / sxx;
	return true;
}

static bool line_of(const struct trend *t, struct line *out)
{
	out->at = t->x / t->n;
	out->value = t->y / t->n;
	return bb_trend_line(t, &out->slope, &out->variance, &out->scatter);
}

/* Does this channel with this pattern pulse once a cycle? */
static bool pulses(const struct bb_channel *c, enum bb_pattern p)
{
	return c->spot == BB_SPOT_LAMP || (c->spot != BB_SPOT_TAG && p <= BB_PATTERN_BLACK_WHITE);
}

static void weigh(struct weighted *w, double slope, double variance)
{
	w->slope += slope / variance;
	w->weight += 1 / variance;
}

/* Two shows of one pattern: the slope within them tells how many turns lie between, the turns give a finer slope. */
static bool bridge(struct clock *k, const struct line *a, const struct line *b, double n)
{
	const double dt = b->at - a->at, rough = k->rough.slope / k->rough.weight, sigma = sqrt(1 / k->rough.weight);

	if (sigma * dt > 0.3)
		return false;
	const double jump = b->value - a->value - rough * dt;
	weigh(&k->fine, rough + remainder(jump, turn) / dt, (a->scatter + b->scatter) / n / (dt * dt));
	return true;
}

/* Phasors count from the begin of their own show: the earlier one's onto the later one's axis. */
static bool bridge_to(const struct bb_analyser *a, struct clock *k, size_t channel, size_t s, size_t e, const struct line *l)
{
	const bool lamp = a->r.channel[channel].spot == BB_SPOT_LAMP;
	const int64_t apart_ns = a->r.show[s].from_ns - a->r.show[e].from_ns;
	struct line earlier;

	if (!lamp && a->r.show[e].pattern != a->r.show[s].pattern)
		return false;
	if (!line_of(&a->channel[channel].part[e].trend, &earlier))
		return false;
	earlier.value += turn * remainder((double)apart_ns / a->nominal_ns, 1);
	return bridge(k, &earlier, l, a->channel[channel].part[s].trend.n);
}

static void find_slope(struct bb_analyser *a, struct clock *k, size_t index, bool finer)
{
	for (size_t c = 0; c < a->r.n_channels; c++)
		for (size_t s = 0; s < a->r.n_shows && a->channel[c].clock == index; s++) {
			bool done = false;
			struct line l;
			if (!pulses(&a->r.channel[c], a->r.show[s].pattern) || !line_of(&a->channel[c].part[s].trend, &l) ||
			    l.scatter > NOISE_RAD2)
				continue;
			if (!finer)
				weigh(&k->rough, l.slope, l.variance);
			for (size_t e = 0; finer && e < s && !done; e++) /* the longest way that can be bridged */
				done = bridge_to(a, k, c, s, e, &l);
		}
}

/* The phase of exp(-i w t) against a pulse train of another period falls by w (1 - nominal / true) a second. */
static bool settle(const struct bb_analyser *a, struct clock *k)
{
	const double w = turn * 1e9 / a->nominal_ns;
	const struct weighted *best = k->fine.weight > k->rough.weight ? &k->fine : &k->rough;

	if (!(best->weight > 0))
		return false;
	k->cycle_ns = a->nominal_ns / (1 + best->slope / best->weight / w);
	k->cycle_sigma_ns = a->nominal_ns / w / sqrt(best->weight);
	return k->cycle_ns > a->nominal_ns * 0.8 && k->cycle_ns < a->nominal_ns * 1.25;
}

bool bb_analyser_turn(struct bb_analyser *a)
{
	bool any = false;

	for (size_t i = 0; i < a->n_clocks; i++) {
		struct clock *k = &a->clock[i];
		find_slope(a, k, i, false);
		if (k->rough.weight > 0)
			find_slope(a, k, i, true);
		k->settled = settle(a, k);
		any |= k->settled;
	}
	for (size_t c = 0; c < a->r.n_channels; c++)
		if (a->r.channel[c].spot == BB_SPOT_TAG && a->clock[a->channel[c].clock].settled)
			bb_optics_tag_find(a, c);
	return any;
}

/* ---- the second pass ---- */

double bb_optics_phase(const struct clock *k, double since_ns)
{
	const double phase = fmod(since_ns, k->cycle_ns);

	return phase < 0 ? phase + k->cycle_ns : phase;
}

static void put(struct bb_fold *fold, double phase_ns, double cycle_ns, double volts)
{
	const double bin_ns = cycle_ns / OPTICS_BINS;
	const double bin = fmin(floor(phase_ns / bin_ns), OPTICS_BINS - 1);
	struct bb_fold *f = &fold[(size_t)bin];

	f->sum += volts;
	f->phase_sum += phase_ns - bin * bin_ns;
	f->n++;
}

void bb_analyser_fold(struct bb_analyser *a, int64_t at_ns, const double *volts)
{
	const int s = show_at(a, at_ns);
	const bool steady = s >= 0 && (double)(at_ns - a->r.show[s].from_ns) >= OPTICS_GUARD * a->nominal_ns;
	const double since_ns = (double)(at_ns - a->middle_ns);
	double phase[OPTICS_CLOCKS];

	for (size_t i = 0; i < a->n_clocks; i++)
		phase[i] = a->clock[i].settled ? bb_optics_phase(&a->clock[i], since_ns) : 0;
	for (size_t c = 0; c < a->r.n_channels; c++) {
		const struct clock *k = &a->clock[a->channel[c].clock];
		const uint8_t spot = a->r.channel[c].spot;
		if (!k->settled)
			continue;
		if (spot == BB_SPOT_TAG && at_ns >= a->tag_from_ns)
			bb_optics_tag_sample(a, c, since_ns, volts[c]);
		else if (spot != BB_SPOT_TAG && steady)
			put(a->channel[c].fold[spot == BB_SPOT_LAMP ? 0 : a->r.show[s].pattern], phase[a->channel[c].clock],
			    k->cycle_ns, volts[c]);
	}
}

bool bb_analyser_wave(const struct bb_analyser *a, size_t channel, enum bb_pattern pattern, double *out, size_t n)
{
	const bool lamp = a->r.channel[channel].spot == BB_SPOT_LAMP;
	const struct bb_fold *fold = a->channel[channel].fold[lamp ? 0 : pattern];

	for (size_t o = 0; fold && o < n; o++) {
		double sum = 0, count = 0;
		for (size_t i = o * OPTICS_BINS / n; i < (o + 1) * OPTICS_BINS / n; i++) {
			sum += fold[i].sum;
			count += fold[i].n;
		}
		out[o] = count > 0 ? sum / count : (double)NAN;
	}
	return fold && a->clock[a->channel[channel].clock].settled;
}
