#include "hal/lc_guard.h"

#include <stdlib.h>
#include <string.h>

void bb_lc_init(struct bb_lc_guard *g)
{
	memset(g, 0, sizeof(*g));
}

static int64_t balance_ns(const struct bb_lc_cell *c, int64_t now_ns)
{
	const int64_t driven_ns = c->closed ? now_ns - c->closed_ns : 0;

	return c->turned ? c->balance_ns - driven_ns : c->balance_ns + driven_ns;
}

void bb_lc_edge(struct bb_lc_guard *g, enum bb_eye sees, int64_t at_ns)
{
	for (int i = 0; i < 2; i++) {
		struct bb_lc_cell *c = &g->cell[i];
		const bool closes = sees != (enum bb_eye)(BB_EYE_LEFT + i);

		if (sees == BB_EYE_NONE) {
			*c = (struct bb_lc_cell){ .turned = c->turned };
		} else if (closes != c->closed) {
			c->balance_ns = balance_ns(c, at_ns);
			c->closed = closes;
			c->closed_ns = at_ns;
			c->turned ^= closes;
		}
	}
}

int64_t bb_lc_bias_ns(const struct bb_lc_guard *g, int64_t now_ns)
{
	const int64_t left_ns = llabs(balance_ns(&g->cell[0], now_ns)), right_ns = llabs(balance_ns(&g->cell[1], now_ns));

	return left_ns > right_ns ? left_ns : right_ns;
}

bool bb_lc_harmed(const struct bb_lc_guard *g, int64_t now_ns)
{
	for (int i = 0; i < 2; i++)
		if (g->cell[i].closed && now_ns - g->cell[i].closed_ns > BB_LC_STILL_NS)
			return true;
	return bb_lc_bias_ns(g, now_ns) > BB_LC_BALANCE_NS;
}
