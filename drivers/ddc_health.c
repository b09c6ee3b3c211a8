/* drivers/ddc_health.c: see drivers/ddc_health.h. */
#include "drivers/ddc_health.h"

#define GOOD_IN_A_ROW 3
#define GOOD_FOR_NS INT64_C(500000000)
#define GAP_LEAST 1000
#define GAP_MOST 2000
#define GAP_DOWN 50
#define GAP_UP 100
#define TRIAL_AFTER 2
#define PATIENCE_LEAST 8
#define PATIENCE_MOST 1024

const char *ddc_fault_text(enum ddc_fault fault)
{
	static const char *const text[] = {
#define X(name, word) word,
		DDC_FAULT_LIST(X)
#undef X
	};
	return (size_t)fault < BB_ARRAY_LEN(text) ? text[fault] : "unknown";
}

static int gravity(enum bb_health health)
{
	switch (health) {
	case BB_HEALTH_QUARANTINED:
		return 3;
	case BB_HEALTH_LOST:
		return 2;
	case BB_HEALTH_DEGRADED:
	case BB_HEALTH_HOLDOVER:
		return 1;
	case BB_HEALTH_INIT:
	case BB_HEALTH_OK:
	case BB_HEALTH_RECOVERING:
		break;
	}
	return 0;
}

/* What was found out about the display says more than one more failed transfer, and must not be hidden by it. */
static bool stands(const struct ddc_health *h, enum bb_health health, enum ddc_fault fault)
{
	if (!gravity(h->health) || gravity(health) > gravity(h->health))
		return false;
	if (fault == h->fault)
		return true;
	return h->fault >= DDC_FAULT_STANDBY && fault < DDC_FAULT_STANDBY;
}

bool ddc_health_bad(struct ddc_health *h, enum bb_health health, enum ddc_fault fault, int64_t at_ns)
{
	h->count[fault]++;
	h->n_good = 0;
	if (stands(h, health, fault))
		return false;
	h->health = health;
	h->fault = fault;
	h->found_ns = at_ns;
	return true;
}

bool ddc_health_good(struct ddc_health *h, int64_t at_ns)
{
	switch (h->health) {
	case BB_HEALTH_OK:
		return false;
	case BB_HEALTH_INIT:
		h->health = BB_HEALTH_OK;
		return true;
	case BB_HEALTH_RECOVERING:
		if (!h->n_good)
			h->first_good_ns = at_ns;
		if (++h->n_good < GOOD_IN_A_ROW && at_ns - h->first_good_ns < GOOD_FOR_NS)
			return false;
		h->health = BB_HEALTH_OK;
		h->fault = DDC_FAULT_NONE;
		h->recovered_ns = at_ns;
		return true;
	case BB_HEALTH_DEGRADED:
	case BB_HEALTH_HOLDOVER:
	case BB_HEALTH_LOST:
	case BB_HEALTH_QUARANTINED:
		break;
	}
	h->health = BB_HEALTH_RECOVERING;
	h->n_good = 1;
	h->first_good_ns = at_ns;
	return true;
}

void ddc_gap_init(struct ddc_gap *g)
{
	*g = (struct ddc_gap){ .permille = GAP_LEAST, .patience = PATIENCE_LEAST };
}

void ddc_gap_stretch(struct ddc_gap *g)
{
	g->slow = true;
	g->permille = GAP_MOST;
	g->n_clean = 0;
}

/* Down a little after some clean exchanges; up at once when that was too far, and then twice as patient. */
void ddc_gap_note(struct ddc_gap *g, bool clean)
{
	if (!g->slow)
		return;
	if (g->on_trial && clean) {
		ddc_gap_init(g);
		return;
	}
	if (g->on_trial)
		ddc_gap_stretch(g);
	g->on_trial = false;
	if (!clean) {
		g->permille = g->permille + GAP_UP > GAP_MOST ? GAP_MOST : g->permille + GAP_UP;
		g->patience = g->patience * 2 > PATIENCE_MOST ? PATIENCE_MOST : g->patience * 2;
		g->n_clean = 0;
		return;
	}
	if (++g->n_clean >= TRIAL_AFTER && !g->tried) {
		g->tried = g->on_trial = true;
		g->permille = GAP_LEAST;
		return;
	}
	if (g->n_clean < g->patience)
		return;
	g->n_clean = 0;
	g->permille -= GAP_DOWN;
	if (g->permille <= GAP_LEAST)
		ddc_gap_init(g);
}

int64_t ddc_gap_ns(const struct ddc_gap *g, int64_t standard_ns)
{
	return standard_ns / 1000 * g->permille;
}
