#include "sync/plan/collide.h"

#include <math.h>

#define PHASES_MOST 4096

static uint64_t gcd(uint64_t a, uint64_t b)
{
	while (b) {
		const uint64_t r = a % b;

		a = b;
		b = r;
	}
	return a;
}

static double modulo(double t, double period)
{
	const double m = fmod(t, period);

	return m < 0 ? m + period : m;
}

/* Is a begin at `start` inside a stretch of `length` that begins at `from`, on a circle? */
static bool inside(double start, double from, double length, double circle)
{
	return modulo(start - from, circle) < length;
}

/* A begin hurts from a token's begin less the exposure until the token's end. Tokens that overlap for one exposure count
 * once: hit by either of them is hit. */
double bb_collisions_at(const struct bb_light_span *spans, size_t n, const struct bb_collisions *c, double exposure_us,
                        double start_us)
{
	uint64_t hits = 0;

	for (uint64_t k = 0; k < c->phases; k++) {
		const double start = start_us + (double)k * c->fold_us; /* all phases, in another order */
		bool hit = false;

		for (size_t i = 0; i < n && !hit; i++)
			hit = inside(start, spans[i].from - exposure_us, spans[i].to - spans[i].from + exposure_us, c->cycle_us);
		hits += hit;
	}
	return 100.0 * (double)hits / (double)c->phases;
}

struct edges { /* where, in [0, fold), the answer changes */
	size_t n;
	double at[2 * BB_TOKENS + 2];
};

static void add_edge(struct edges *e, double at)
{
	size_t i = e->n++;

	for (; i > 0 && e->at[i - 1] > at; i--)
		e->at[i] = e->at[i - 1];
	e->at[i] = at;
}

/* Longest run of stretches without a hit, around the end of the circle if need be. */
static void widest_free(const struct edges *e, const bool *hit, double fold_us, struct bb_collisions *out)
{
	const size_t n = e->n - 1;

	out->margin_us = -1;
	for (size_t i = 0; i < n; i++) {
		double length = 0;

		for (size_t k = i; k < i + n && !hit[k % n]; k++)
			length += e->at[k % n + 1] - e->at[k % n];
		if (length / 2 > out->margin_us && length > 0) {
			out->margin_us = length / 2;
			out->free_us = modulo(e->at[i] + length / 2, fold_us);
		}
	}
}

/* With nowhere to go: how much shorter the exposure would have to be, at least, for one to fit. */
static double lacking(const struct bb_light_span *spans, size_t n, const struct bb_collisions *c, double exposure_us)
{
	double low = 0, high = exposure_us;

	for (int i = 0; i < 40; i++) {
		const double mid = (low + high) / 2;
		bool free = false;

		for (size_t k = 0; k < n && !free; k++) /* the first moment after a token is the one that frees up */
			free = bb_collisions_at(spans, n, c, mid, spans[k].to + 1e-6) == 0;
		*(free ? &low : &high) = mid;
	}
	return (exposure_us - low) / 2;
}

static void fold_and_count(const struct bb_light_span *spans, size_t n, double exposure_us, struct bb_collisions *out)
{
	struct edges e = { .n = 0 };
	bool hit[2 * BB_TOKENS + 2] = { false };

	add_edge(&e, 0);
	add_edge(&e, out->fold_us);
	for (size_t i = 0; i < n; i++) {
		add_edge(&e, modulo(spans[i].from - exposure_us, out->fold_us));
		add_edge(&e, modulo(spans[i].to, out->fold_us));
	}
	for (size_t i = 0; i + 1 < e.n; i++) {
		const double length = e.at[i + 1] - e.at[i], middle = (e.at[i] + e.at[i + 1]) / 2;
		const double percent = length > 0 ? bb_collisions_at(spans, n, out, exposure_us, middle) : 0;

		hit[i] = percent > 0;
		out->hit_percent += hit[i] ? 100 * length / out->fold_us : 0;
		out->mean_percent += percent * length / out->fold_us;
		out->most_percent = fmax(out->most_percent, percent);
	}
	widest_free(&e, hit, out->fold_us, out);
	if (out->margin_us < 0)
		out->margin_us = -lacking(spans, n, out, exposure_us);
}

void bb_collisions(const struct bb_light_span *spans, size_t n, struct bb_rate edges, struct bb_rate exposures,
                   double exposure_us, struct bb_collisions *out)
{
	/* step / cycle = (den_e / num_e) / (2 den / num): reduced, its denominator counts the phases */
	const uint64_t up = (uint64_t)exposures.den * edges.num, down = (uint64_t)exposures.num * 2 * edges.den;

	*out = (struct bb_collisions){ .cycle_us = 2e6 / bb_rate_hz(edges), .phases = down / gcd(up, down) };
	if (out->phases <= PHASES_MOST) {
		out->fold_us = out->cycle_us / (double)out->phases;
		fold_and_count(spans, n, exposure_us, out);
		return;
	}
	/* As good as all phases there are: whatever the start, the share of the cycle that hurts. */
	struct bb_collisions all = { .cycle_us = out->cycle_us, .phases = 1, .fold_us = out->cycle_us };
	fold_and_count(spans, n, exposure_us, &all);
	out->fold_us = out->cycle_us / (double)out->phases;
	out->hit_percent = n ? 100 : 0;
	out->mean_percent = out->most_percent = all.mean_percent;
	out->margin_us = n ? -exposure_us / 2 : out->fold_us / 2;
}
