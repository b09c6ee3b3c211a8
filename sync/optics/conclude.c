/* sync/optics/conclude.c: from folds and means to pulses, phases, skew, order and crosstalk. */
#include "sync/optics/analyse_private.h"

#include <math.h>
#include <string.h>

static const struct bb_estimate unknown = { (double)NAN, (double)NAN };

/* ---- estimates ---- */

static struct bb_estimate sum_of(struct bb_estimate a, double factor, struct bb_estimate b)
{
	return (struct bb_estimate){ a.value + factor * b.value, hypot(a.sigma, factor * b.sigma) };
}

static struct bb_estimate ratio(struct bb_estimate a, struct bb_estimate b, double unit)
{
	const double q = a.value / b.value;

	if (!(b.value > 3 * b.sigma)) /* nothing is a share of nothing */
		return unknown;
	return (struct bb_estimate){ unit * q, unit * hypot(a.sigma, q * b.sigma) / b.value };
}

static bool known(struct bb_estimate e)
{
	return isfinite(e.value) && isfinite(e.sigma);
}

/* Many estimates of one number. */
struct pool {
	double sum, weight, first;
	double cycle; /* they are phases: apart by whole cycles is not apart; 0: they are not */
};

static void pool_add(struct pool *p, struct bb_estimate e)
{
	if (!known(e))
		return;
	const double weight = 1 / fmax(e.sigma * e.sigma, 1e-12);
	if (!(p->weight > 0))
		p->first = e.value;
	const double value = p->cycle > 0 ? p->first + remainder(e.value - p->first, p->cycle) : e.value;
	p->sum += weight * value;
	p->weight += weight;
}

static struct bb_estimate pool_value(const struct pool *p)
{
	return p->weight > 0 ? (struct bb_estimate){ p->sum / p->weight, 1 / sqrt(p->weight) } : unknown;
}

/* ---- what a channel says ---- */

static int find_channel(const struct bb_analyser *a, const char *wall, int spot, int lens)
{
	for (size_t c = 0; c < a->r.n_channels; c++) {
		const struct bb_channel *ch = &a->r.channel[c];
		if (!strcmp(ch->wall, wall) && ch->spot == spot && ch->lens == lens)
			return (int)c;
	}
	return -1;
}

/* Mean light with a pattern: the scatter from cycle to cycle says how sure. */
static struct bb_estimate mean_of(const struct bb_analyser *a, int channel, enum bb_pattern pattern)
{
	struct scatter pooled = { .n_last = 0 };
	double n = 0, sum = 0;

	for (size_t s = 0; channel >= 0 && s < a->r.n_shows; s++) {
		const struct part *p = &a->channel[channel].part[s];
		if (a->r.show[s].pattern != pattern)
			continue;
		n += p->mean.n;
		sum += p->mean.y;
		bb_scatter_pool(&pooled, &p->mean_scatter);
	}
	const double variance = bb_scatter_variance(&pooled);
	return n > 0 && isfinite(variance) ? (struct bb_estimate){ sum / n, sqrt(variance / n) } : unknown;
}

/* How unsure a phase is beside its fit: jitter from cycle to cycle, less what the samples' own noise makes of it, and
 * the period over the way to the middle. */
static double wander_ns(const struct bb_analyser *a, size_t channel, int pattern, double noise)
{
	const struct clock *k = &a->clock[a->channel[channel].clock];
	struct scatter pooled = { .n_last = 0 };
	double n = 0, at = 0, amplitude = 0, samples = 0;

	for (size_t s = 0; s < a->r.n_shows; s++) {
		const struct part *p = &a->channel[channel].part[s];
		if (pattern >= 0 && (int)a->r.show[s].pattern != pattern)
			continue;
		n += p->trend.n;
		at += p->trend.x;
		amplitude += p->amplitude;
		samples += p->samples;
		bb_scatter_pool(&pooled, &p->phase_scatter);
	}
	const double scatter = bb_scatter_variance(&pooled), of_noise = noise * noise / (2 * samples / n * pow(amplitude / n, 2));
	if (!(n > 0) || !isfinite(scatter))
		return (double)INFINITY;
	const double jitter_ns = sqrt(fmax(scatter - of_noise, 0) / n) * k->cycle_ns / 6.283185307179586;
	return hypot(jitter_ns, k->cycle_sigma_ns / k->cycle_ns * at / n * 1e9);
}

static struct bb_pulse pulse_of(const struct bb_analyser *a, int channel, int pattern)
{
	struct bb_pulse p = { .found = false };

	if (channel < 0 || !a->clock[a->channel[channel].clock].settled)
		return p;
	const struct bb_pulse_task task = {
		.fold = a->channel[channel].fold[pattern < 0 ? 0 : pattern],
		.n_bins = OPTICS_BINS,
		.cycle_ns = a->clock[a->channel[channel].clock].cycle_ns,
		.sensor_tau_ns = a->r.bandwidth_hz > 0 ? 1e9 / (6.283185307179586 * a->r.bandwidth_hz) : 0,
		.aperture_ns = a->r.aperture_us * 1e3,
	};
	p = bb_pulse_fit(&task);
	const double wander = p.found ? wander_ns(a, (size_t)channel, pattern, p.rms) : 0;
	p.rise_ns.sigma = hypot(p.rise_ns.sigma, wander);
	p.fall_ns.sigma = hypot(p.fall_ns.sigma, wander);
	return p;
}

/* ---- what a wall says ---- */

static const enum bb_pattern white_for[2] = { BB_PATTERN_WHITE_BLACK, BB_PATTERN_BLACK_WHITE };

static void conclude_band(const struct bb_analyser *a, const struct bb_optics *o, const char *wall, int spot,
                          struct bb_optics_band *b)
{
	const int bare = find_channel(a, wall, spot, BB_LENS_BARE);
	const struct bb_estimate open = sum_of(mean_of(a, bare, BB_PATTERN_WHITE_WHITE), -1,
	                                       mean_of(a, bare, BB_PATTERN_BLACK_BLACK));

	for (int eye = 0; eye < 2; eye++) {
		const int through = find_channel(a, wall, spot, BB_LENS_LEFT + eye);
		const struct bb_estimate black = mean_of(a, through, BB_PATTERN_BLACK_BLACK);
		const struct bb_estimate signal = sum_of(mean_of(a, through, white_for[eye]), -1, black);
		const struct bb_estimate leak = sum_of(mean_of(a, through, white_for[!eye]), -1, black);
		b->crosstalk[eye] = ratio(leak, signal, 100);
		b->light[eye] = ratio(signal, open, 100);
		b->white[eye] = pulse_of(a, bare, (int)white_for[eye]);
		b->phase_ns[eye] = unknown;
		if (b->white[eye].found && o->has_lens[eye]) {
			b->phase_ns[eye] = sum_of(b->white[eye].rise_ns, -1, o->lens[eye].rise_ns);
			b->phase_ns[eye].value = remainder(b->phase_ns[eye].value, o->cycle_ns.value);
		}
		b->seen |= bare >= 0 || through >= 0;
	}
}

static double by_eye(const struct bb_analyser *a, const char *wall, int spot, int lens, double *variance)
{
	const int c = find_channel(a, wall, spot, lens);
	const struct bb_estimate d =
		sum_of(mean_of(a, c, BB_PATTERN_WHITE_BLACK), -1, mean_of(a, c, BB_PATTERN_BLACK_WHITE));

	if (!known(d))
		return 0;
	*variance += d.sigma * d.sigma;
	return d.value;
}

static enum bb_order order_of(const struct bb_analyser *a, const char *wall)
{
	double own[2] = { 0, 0 }, variance = 0;

	for (int spot = 0; spot < BB_BANDS; spot++) {
		own[0] += by_eye(a, wall, spot, BB_LENS_LEFT, &variance);
		own[1] -= by_eye(a, wall, spot, BB_LENS_RIGHT, &variance);
	}
	const double least = 4 * sqrt(variance);
	if (own[0] > least && own[1] > least)
		return BB_ORDER_RIGHT;
	return own[0] < -least && own[1] < -least ? BB_ORDER_SWAPPED : BB_ORDER_UNKNOWN;
}

static void conclude_tag(const struct bb_analyser *a, struct bb_optics_wall *w)
{
	const int c = find_channel(a, w->id, BB_SPOT_TAG, BB_LENS_BARE);

	if (c < 0 || !(a->channel[c].tag.centre_weight > 0))
		return;
	const struct tag *t = &a->channel[c].tag;
	w->tag.seen = t->cycles > 0;
	w->tag.cycles = t->cycles;
	w->tag.gaps = t->gaps;
	w->tag.odd = t->odd;
	for (int spot = 0; spot < BB_BANDS && w->tag.order == BB_ORDER_UNKNOWN; spot++) {
		const struct bb_pulse *p = &w->band[spot].white[0];
		if (!p->found)
			continue;
		const double cycle = w->cycle_ns.value, on = fmod(p->fall_ns.value - p->rise_ns.value + cycle, cycle);
		const double off = remainder(t->centre_ns - p->rise_ns.value - on / 2, cycle);
		w->tag.order = fabs(off) < cycle / 4 ? BB_ORDER_RIGHT : BB_ORDER_SWAPPED;
	}
}

static struct bb_estimate scan_of(const struct bb_optics_wall *w)
{
	struct pool p = { .cycle = w->cycle_ns.value };

	for (int eye = 0; eye < 2; eye++) {
		const struct bb_pulse *top = &w->band[BB_SPOT_TOP].white[eye], *bottom = &w->band[BB_SPOT_BOTTOM].white[eye];
		struct bb_estimate e = sum_of(bottom->rise_ns, -1, top->rise_ns);
		e.value = remainder(e.value, w->cycle_ns.value);
		if (top->found && bottom->found)
			pool_add(&p, e);
	}
	return pool_value(&p);
}

static struct bb_estimate skew_of(const struct bb_optics_wall *w, const struct bb_optics_wall *first)
{
	struct pool p = { .cycle = first->cycle_ns.value };

	for (int spot = 0; spot < BB_BANDS; spot++)
		for (int eye = 0; eye < 2; eye++) {
			const struct bb_pulse *a = &w->band[spot].white[eye], *b = &first->band[spot].white[eye];
			struct bb_estimate e = sum_of(a->rise_ns, -1, b->rise_ns);
			e.value = remainder(e.value, p.cycle);
			if (a->found && b->found)
				pool_add(&p, e);
		}
	return pool_value(&p);
}

static void conclude_wall(const struct bb_analyser *a, const struct clock *k, struct bb_optics *o)
{
	struct bb_optics_wall *w = &o->wall[o->n_walls++];

	memcpy(w->id, k->wall, sizeof(w->id));
	w->cycle_ns = k->settled ? (struct bb_estimate){ k->cycle_ns, k->cycle_sigma_ns } : unknown;
	for (int spot = 0; spot < BB_BANDS; spot++)
		conclude_band(a, o, w->id, spot, &w->band[spot]);
	w->order = order_of(a, w->id);
	w->scan_ns = scan_of(w);
	w->skew_ns = skew_of(w, &o->wall[0]);
	conclude_tag(a, w);
}

void bb_analyser_finish(struct bb_analyser *a, struct bb_optics *o)
{
	memset(o, 0, sizeof(*o));
	o->cycle_ns = unknown;
	o->middle_ns = a->middle_ns;
	o->n_samples = a->n_samples;
	for (size_t i = 0; i < a->n_clocks; i++)
		if (!*a->clock[i].wall && a->clock[i].settled)
			o->cycle_ns = (struct bb_estimate){ a->clock[i].cycle_ns, a->clock[i].cycle_sigma_ns };
	for (int eye = 0; eye < 2; eye++) {
		o->lens[eye] = pulse_of(a, find_channel(a, "", BB_SPOT_LAMP, BB_LENS_LEFT + eye), -1);
		o->has_lens[eye] = o->lens[eye].found;
	}
	for (size_t i = 0; i < a->n_clocks && o->n_walls < BB_OPTICS_WALLS_MAX; i++)
		if (*a->clock[i].wall)
			conclude_wall(a, &a->clock[i], o);
}

enum bb_judgement bb_optics_judge(struct bb_estimate e, double most)
{
	if (!known(e) || fabs(e.value - most) < 2 * e.sigma)
		return BB_UNDECIDED;
	return e.value <= most ? BB_HOLDS : BB_MISSES;
}
