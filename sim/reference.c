/*
 * sim/reference.c: the room's sync generator as a time base. Its own axis tau counts ideal ns since edge 0; a list of
 * linear pieces maps tau to clock time, so a rate error or a fault bends the map and instant k is still computed from
 * k alone. Units ns and ppb.
 */
#include "sim/world_impl.h"

#include <math.h>

#define PIECES_MAX (2 * SIM_FAULTS_MAX + 8)
#define PPB_LEAST INT64_C(-900000000)
#define PPB_MOST INT64_C(9000000000)

/* floor(a * b / c), c > 0: in 64 bits where the product fits, which it does for months of any sane rate. */
static int64_t mul_div(int64_t a, int64_t b, int64_t c)
{
	int64_t product;

	if (!__builtin_mul_overflow(a, b, &product))
		return product / c - (product % c < 0);
	const __int128 wide = (__int128)a * b;
	return (int64_t)(wide / c - (wide % c < 0));
}

static int64_t at_of_tau(const struct sim_world *w, int64_t tau_ns)
{
	size_t i = w->n_pieces - 1;

	while (i > 0 && w->piece[i].tau_ns > tau_ns)
		i--;
	const struct sim_piece *p = &w->piece[i];
	const int64_t dt_ns = tau_ns - p->tau_ns; /* dt / (1 + e) = dt - dt e / (1 + e) */
	return p->at_ns + dt_ns + mul_div(-dt_ns, p->ppb, BB_NS_PER_S + p->ppb);
}

static int64_t tau_of_at(const struct sim_world *w, int64_t at_ns)
{
	size_t i = w->n_pieces - 1;

	while (i > 0 && w->piece[i].at_ns > at_ns)
		i--;
	const struct sim_piece *p = &w->piece[i];
	const int64_t dt_ns = at_ns - p->at_ns;
	return p->tau_ns + dt_ns + mul_div(dt_ns, p->ppb, BB_NS_PER_S);
}

enum bb_status sim_reference_init(struct sim_world *w)
{
	const struct bb_room *room = w->room;
	struct sim_rng rng;

	w->sync_rate = room->has_chain ? room->chain.rate
	               : room->n_screens ? room->screens[0].display.rate : (struct bb_rate){ 60, 1 };
	if (!w->sync_rate.num || !w->sync_rate.den)
		return BB_ERR_CONFIG;
	if (!sim_grow((void **)&w->piece, sizeof(*w->piece), 0, &w->cap_pieces, PIECES_MAX))
		return BB_ERR_NOMEM;
	sim_rng_seed(&rng, w->seed, "world", "sync");
	const double phase_ns = sim_rng_uniform(&rng) * (double)bb_rate_period_ns(w->sync_rate);
	const double ppm = room->has_chain && isfinite(room->chain.rate_error_ppm) ? room->chain.rate_error_ppm : 0;
	w->piece[0] = (struct sim_piece){ 0, (int64_t)phase_ns, (int64_t)llround(fmin(fmax(ppm, -1e5), 1e5) * 1000) };
	w->n_pieces = 1;
	return BB_OK;
}

enum bb_status sim_world_set_sync_error(struct sim_world *w, int64_t from_ns, int64_t ppb)
{
	const struct sim_piece *last = &w->piece[w->n_pieces - 1];

	if (ppb < PPB_LEAST || ppb > PPB_MOST)
		return BB_ERR_RANGE;
	if (from_ns <= last->at_ns && w->n_pieces == 1) { /* before edge 0: the generator always ran like this */
		w->piece[0].ppb = ppb;
		w->n_bends++;
		return BB_OK;
	}
	if (from_ns < last->at_ns)
		return BB_ERR_USAGE;
	if (!sim_grow((void **)&w->piece, sizeof(*w->piece), w->n_pieces, &w->cap_pieces, PIECES_MAX))
		return BB_ERR_NOMEM;
	w->piece[w->n_pieces] = (struct sim_piece){ tau_of_at(w, from_ns), from_ns, ppb };
	w->n_pieces++;
	w->n_bends++;
	return BB_OK;
}

uint32_t sim_world_reference_bends(const struct sim_world *w)
{
	return w->n_bends;
}

int64_t sim_world_sync_error_ppb(const struct sim_world *w)
{
	return w->piece[w->n_pieces - 1].ppb;
}

struct bb_rate sim_world_sync_rate(const struct sim_world *w)
{
	return w->sync_rate;
}

int64_t sim_world_reference_ns(const struct sim_world *w, struct bb_rate rate, int64_t k)
{
	return at_of_tau(w, bb_rate_frame_ns(rate, k));
}

int64_t sim_world_reference_after(const struct sim_world *w, struct bb_rate rate, int64_t at_ns)
{
	const int64_t tau_ns = tau_of_at(w, at_ns);
	/* Both maps round down, so the guess is within an instant or two; start below and walk up. */
	int64_t k = mul_div(tau_ns, rate.num, (int64_t)rate.den * BB_NS_PER_S) - 2;

	if (k < 0)
		k = 0;
	while (sim_world_reference_ns(w, rate, k) < at_ns)
		k++;
	return k;
}

int64_t sim_world_sync_ns(const struct sim_world *w, int64_t n)
{
	return sim_world_reference_ns(w, w->sync_rate, n);
}

int64_t sim_world_sync_after(const struct sim_world *w, int64_t at_ns)
{
	return sim_world_sync_ns(w, sim_world_reference_after(w, w->sync_rate, at_ns));
}
