/* sync/optics/tag.c: the patch that tells eye and frame, read from a sensor before it: left frames are white, right ones
 * carry one bit of a counter's sequence. */
#include "sync/optics/analyse_private.h"

#include <math.h>

#define WINDOW 0.15 /* of a cycle to both sides of a frame's middle: away from its edges */
#define LEAST_CONTRAST 1e-6

/* Left frames are the brighter ones, so the fundamental peaks in the middle of them. */
void bb_optics_tag_find(struct bb_analyser *a, size_t channel)
{
	struct optics_channel *ch = &a->channel[channel];
	const struct clock *k = &a->clock[ch->clock];
	const double w_ns = 6.283185307179586 / a->nominal_ns;
	double re = 0, im = 0;

	for (size_t s = 0; s < a->r.n_shows; s++) {
		const struct trend *t = &ch->part[s].trend;
		double slope, variance, scatter;
		if (!bb_trend_line(t, &slope, &variance, &scatter) || scatter > 1)
			continue;
		/* When the pulse nearest the middle of these cycles came, from the recording's middle. */
		const double from_ns = (double)(a->r.show[s].from_ns - a->middle_ns), at_ns = t->x / t->n * 1e9;
		const double pulse_ns = from_ns - t->y / t->n / w_ns;
		const double turns = round((at_ns - pulse_ns) / a->nominal_ns);
		const double phase = bb_optics_phase(k, pulse_ns + turns * a->nominal_ns) * w_ns * a->nominal_ns / k->cycle_ns;
		re += cos(phase) * t->n;
		im += sin(phase) * t->n;
	}
	ch->tag.centre_weight = hypot(re, im);
	ch->tag.centre_ns = bb_optics_phase(k, atan2(im, re) / 6.283185307179586 * k->cycle_ns);
	ch->tag.place = -1;
}

/* A right frame is over: with the left one before it, it is one cycle. */
static void read_cycle(struct tag *t)
{
	const double span = t->high - t->low, left = (t->sum[0] / t->n[0] - t->low) / span,
	             right = (t->sum[1] / t->n[1] - t->low) / span;

	t->cycles++;
	if (left < 0.7 || right > 0.7) {
		t->odd++;
		t->n_bits = 0;
		t->place = -1;
		return;
	}
	t->bits = (t->bits << 1 | (right > 0.25)) & ((1u << BB_TAG_BITS) - 1);
	if (++t->n_bits < BB_TAG_BITS)
		return;
	const int place = bb_tag_place(t->bits);
	t->gaps += place < 0 || (t->place >= 0 && place != (t->place + 1) % BB_TAG_CYCLES);
	t->place = place;
}

void bb_optics_tag_sample(struct bb_analyser *a, size_t channel, double since_ns, double volts)
{
	struct tag *t = &a->channel[channel].tag;
	const double cycle_ns = a->clock[a->channel[channel].clock].cycle_ns;
	const double off = remainder(since_ns - t->centre_ns, cycle_ns) / cycle_ns; /* -0.5 .. 0.5: left in the middle */
	const bool left = fabs(off) < WINDOW, right = fabs(off) > 0.5 - WINDOW;

	if (!(t->centre_weight > 0) || !(t->high - t->low > LEAST_CONTRAST))
		return;
	if (t->in_right && left) {
		if (t->n[0] && t->n[1])
			read_cycle(t);
		t->sum[0] = t->sum[1] = 0;
		t->n[0] = t->n[1] = 0;
	}
	t->in_right = right || (t->in_right && !left);
	if (left || right) {
		t->sum[right] += volts;
		t->n[right]++;
	}
}
