#include "sync/plan/optics.h"

#include <math.h>

#define LN9 2.1972245773362196

/* Nodes and weights on 0..1 (M. Abramowitz and I. Stegun, table 25.4). */
static const double node[PLAN_ROWS] = { 0.069431844202973712, 0.33000947820757187, 0.66999052179242813,
	                                0.93056815579702629 };
static const double weight[PLAN_ROWS] = { 0.17392742256872693, 0.32607257743127307, 0.32607257743127307,
	                                  0.17392742256872693 };

static bool strobed(const struct bb_display_config *d)
{
	return d->kind == BB_DISPLAY_STROBED && d->strobe_us < 1e6 / bb_rate_hz(d->rate);
}

/* A row's change after vblank; p from the picture's upper edge. */
static double written_us(const struct bb_display_config *d, double period_us, double p)
{
	const double vblank_us = bb_display_vblank_us(d);

	if (d->scan == BB_SCAN_GLOBAL)
		return vblank_us;
	return vblank_us + (d->scan == BB_SCAN_UP ? 1 - p : p) * (period_us - vblank_us);
}

/* No light: before the next picture of a dlp, outside the strobe. */
static void blank(struct bb_wave *w, const struct bb_display_config *d, double period_us)
{
	const double picture_us = bb_display_vblank_us(d);

	for (int k = 0; k < 2; k++) {
		const double at = k * period_us;

		if (d->dark_us > 0)
			bb_wave_blank(w, at + picture_us - d->dark_us, at + picture_us);
		if (strobed(d))
			bb_wave_blank(w, at + d->strobe_at_us + d->strobe_us, at + d->strobe_at_us + period_us);
	}
}

static void row_init(struct bb_wave *w, const struct bb_display_config *d, double period_us, double at_us)
{
	bb_wave_cell(w, 2 * period_us, at_us, period_us, d->pixel_rise_us, d->pixel_fall_us, 0, 1);
	blank(w, d, period_us);
}

void plan_band_init(struct plan_band *b, const struct bb_display_config *d, double period_us, double top, double bottom)
{
	const double frame_us = 1e6 / bb_rate_hz(d->rate);

	*b = (struct plan_band){ .external = plan_external(d), .share = 1 };
	if (b->external) {
		b->share = (strobed(d) ? d->strobe_us / frame_us : 1) * (1 - d->dark_us / frame_us);
		return;
	}
	b->n = d->scan == BB_SCAN_GLOBAL || bottom <= top ? 1 : PLAN_ROWS;
	for (unsigned i = 0; i < b->n; i++) {
		const double at_us = written_us(d, period_us, b->n == 1 ? top : top + node[i] * (bottom - top));

		b->weight[i] = b->n == 1 ? 1 : weight[i];
		row_init(&b->own[i], d, period_us, at_us);
		row_init(&b->other[i], d, period_us, at_us + period_us);
	}
}

static void lens(struct bb_wave *w, const struct bb_cell *c, double period_us, double at_us, double open_us)
{
	const double high = c->transmission_percent / 100;

	bb_wave_cell(w, 2 * period_us, at_us, open_us, c->open_us, c->close_us, high / c->contrast, high);
}

void plan_lenses_init(struct plan_lenses *l, const struct bb_shutter_config *chain, double period_us,
                      const struct bb_plan_timing *t)
{
	lens(&l->glasses, &chain->glasses, period_us, t->glasses_at_us, t->glasses_open_us);
	lens(&l->own_shutter, &chain->cell, period_us, t->shutter_at_us, t->shutter_open_us);
	lens(&l->other_shutter, &chain->cell, period_us, t->shutter_at_us + period_us, t->shutter_open_us);
}

struct bb_plan_light plan_band_light(const struct plan_band *b, const struct plan_lenses *l)
{
	double signal = 0, leakage = 0;

	if (b->external) {
		signal = bb_wave_mean(&l->own_shutter, &l->glasses) * b->share;
		leakage = bb_wave_mean(&l->other_shutter, &l->glasses) * b->share;
	}
	for (unsigned i = 0; i < b->n; i++) {
		signal += b->weight[i] * bb_wave_mean(&b->own[i], &l->glasses);
		leakage += b->weight[i] * bb_wave_mean(&b->other[i], &l->glasses);
	}
	return (struct bb_plan_light){ 100 * signal, 100 * leakage / signal };
}

struct bb_plan_light bb_plan_strip(const struct bb_display_config *display, const struct bb_shutter_config *chain,
                                   const struct bb_plan_timing *timing, double top, double bottom)
{
	const double period_us = plan_period_us(chain);
	struct plan_lenses lenses;
	struct plan_band band;

	plan_band_init(&band, display, period_us, top, bottom);
	plan_lenses_init(&lenses, chain, period_us, timing);
	return plan_band_light(&band, &lenses);
}

double plan_settle_us(double us_10_90, double limit_percent)
{
	return us_10_90 / LN9 * log(100 / fmax(limit_percent, 1e-3));
}

/* When a display shines: from `on` for `length` of every period. */
struct gate {
	double period, on, length;
};

static struct gate gate_of(const struct bb_display_config *d, double period_us)
{
	if (strobed(d))
		return (struct gate){ period_us, d->strobe_at_us, d->strobe_us };
	return (struct gate){ period_us, bb_display_vblank_us(d), period_us - d->dark_us };
}

/* Begin of the newest shining before t. */
static double newest_on(const struct gate *g, double t)
{
	const double k = ceil((t - g->on) / g->period) - 1;

	return g->on + k * g->period;
}

static double off_since(const struct gate *g, double t)
{
	return fmin(t, newest_on(g, t) + g->length);
}

static double on_from(const struct gate *g, double t)
{
	return newest_on(g, t) + g->length > t ? t : newest_on(g, t) + g->period;
}

struct window {
	double gone, from, to, comes; /* the other eye's last light; this eye alone from .. to; the other's next light */
};

/* By the other projector's shutter. */
static struct window external_window(const struct bb_shutter_config *chain, const struct bb_plan_timing *t,
                                     double limit_percent)
{
	const double period_us = plan_period_us(chain);
	const double gone = t->shutter_at_us + t->shutter_open_us - period_us +
			    plan_settle_us(chain->cell.close_us, limit_percent);
	const double comes = t->shutter_at_us + period_us;

	return (struct window){ gone, gone, comes, comes };
}

static struct window picture_window(const struct bb_plan_band *b, const struct bb_display_config *d, double period_us,
                                    double limit_percent)
{
	const double top_us = written_us(d, period_us, b->top), bottom_us = written_us(d, period_us, b->bottom);
	const double settle_us = plan_settle_us(d->pixel_fall_us, limit_percent);
	const struct gate g = gate_of(d, period_us);
	/* Mirrors that move in the dark are not seen to move; what is left of it stands in the crosstalk. */
	const double settled = fmax(top_us, bottom_us) + (settle_us <= d->dark_us ? 0 : settle_us);
	const double next = fmin(top_us, bottom_us) + period_us;
	const double from = on_from(&g, settled + 1e-9), on = newest_on(&g, from + 1e-9);

	return (struct window){ off_since(&g, settled), from, fmin(next, on + g.length), on_from(&g, next + 1e-9) };
}

void plan_window(struct bb_plan_band *b, const struct bb_display_config *d, const struct bb_shutter_config *chain,
                 const struct bb_plan_timing *t, double limit_percent)
{
	const double closed_us =
		t->glasses_at_us + t->glasses_open_us + plan_settle_us(chain->glasses.close_us, limit_percent);
	const struct window w = plan_external(d) ? external_window(chain, t, limit_percent)
						 : picture_window(b, d, plan_period_us(chain), limit_percent);

	b->window_from_ns = llround(w.from * 1000);
	b->window_to_ns = llround(w.to * 1000);
	b->margin_before_us = t->glasses_at_us - w.gone;
	b->margin_after_us = w.comes - closed_us;
}
