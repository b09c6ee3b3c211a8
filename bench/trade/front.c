#include "bench/trade/front.h"

#include <math.h>

static bool takes_part(const struct bb_front_point *p)
{
	return isfinite(p->quality) && isfinite(p->cost);
}

static bool beats(const struct bb_front_point *a, const struct bb_front_point *b)
{
	return takes_part(a) && a->quality >= b->quality && a->cost <= b->cost &&
	       (a->quality > b->quality || a->cost < b->cost);
}

void bb_front_mark(struct bb_front_point *p, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		p[i].on_front = takes_part(&p[i]);
		for (size_t k = 0; k < n && p[i].on_front; k++)
			p[i].on_front = !beats(&p[k], &p[i]);
	}
}

size_t bb_front_best(const struct bb_front_point *p, size_t n, double cost_most)
{
	size_t best = BB_FRONT_NONE;

	for (size_t i = 0; i < n; i++) {
		if (!takes_part(&p[i]) || p[i].cost > cost_most)
			continue;
		if (best == BB_FRONT_NONE || p[i].quality > p[best].quality || beats(&p[i], &p[best]))
			best = i;
	}
	return best;
}

size_t bb_front_cheapest(const struct bb_front_point *p, size_t n, double quality_least)
{
	size_t best = BB_FRONT_NONE;

	for (size_t i = 0; i < n; i++) {
		if (!takes_part(&p[i]) || p[i].quality < quality_least)
			continue;
		if (best == BB_FRONT_NONE || p[i].cost < p[best].cost || beats(&p[i], &p[best]))
			best = i;
	}
	return best;
}
