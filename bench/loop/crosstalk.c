#include "bench/loop/crosstalk.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/optics/optics.h"
#include "sim/sim_display.h"

#define STEP_NS 20000 /* cells and pixels are exact at any step; their product is within 1e-4 at this one */
#define SETTLE 6      /* frames of both eyes a screen has shown before it counts */
#define FLIPS 8
#define MOST_PERCENT 1e4 /* an eye that sees nothing of its own picture */

struct light { /* integrals over a frame: own white, the other's white, black, through one lens */
	double own, other, black;
};
struct watched {
	uint16_t screen;
	int64_t next_k;       /* vblank that has not been told */
	unsigned shown;       /* frames */
	struct {
		uint32_t seq;
		enum bb_eye eye;
		bool fresh;
	} flip[FLIPS];
	struct light light[BB_BANDS][2];
};
struct bb_crosstalk {
	const struct bb_rig *rig;
	struct sim_optics *optics;
	int64_t cycle_ns, now_ns;
	unsigned edges;        /* of the glasses since the last frame */
	bool open;             /* the shutters do not run */
	size_t n;
	struct watched watched[];
};

static bool is_sim(const char *device)
{
	return !*device || !strncmp(device, "sim:", 4);
}

static bool worth_it(const struct bb_rig *rig)
{
	return rig->shutter && rig->needs[BB_CLASS_SHUTTERS] >= 2 && rig->needs[BB_CLASS_DISPLAYS] >= 2 &&
	       is_sim(rig->room->chain.device);
}

static size_t stereo_screens(const struct bb_room *room, size_t *out)
{
	size_t n = 0;

	for (size_t i = 0; i < room->n_screens; i++)
		if (room->screens[i].display.stereo != BB_STEREO_MONO && is_sim(room->screens[i].display.device))
			out[n++] = i;
	return n;
}

static enum bb_status watch_screens(const struct bb_rig *rig, const size_t *screens, size_t n, struct bb_crosstalk **out)
{
	struct sim_look look = sim_look_bands();
	struct bb_crosstalk *x = calloc(1, sizeof(*x) + n * sizeof(x->watched[0]));

	if (!x)
		return BB_ERR_NOMEM;
	look.lanes = 3;
	const enum bb_status status = sim_optics_create(rig->room, screens, n, &look, &x->optics);
	if (status != BB_OK) {
		free(x);
		return status;
	}
	sim_optics_show(x->optics, 0, BB_PATTERN_WHITE_BLACK);
	sim_optics_show(x->optics, 1, BB_PATTERN_BLACK_WHITE);
	x->rig = rig;
	x->cycle_ns = 2 * bb_rate_period_ns(rig->room->chain.rate);
	x->open = true;
	x->n = n;
	for (size_t i = 0; i < n; i++)
		x->watched[i].screen = (uint16_t)screens[i];
	*out = x;
	return BB_OK;
}

enum bb_status bb_crosstalk_create(const struct bb_rig *rig, struct bb_crosstalk **out)
{
	*out = NULL;
	if (!worth_it(rig))
		return BB_OK;
	size_t *screens = calloc(rig->room->n_screens + 1, sizeof(*screens));
	const size_t n = screens ? stereo_screens(rig->room, screens) : 0;
	const enum bb_status status = !screens ? BB_ERR_NOMEM : n ? watch_screens(rig, screens, n, out) : BB_OK;

	free(screens);
	return status;
}

void bb_crosstalk_destroy(struct bb_crosstalk *x)
{
	if (!x)
		return;
	sim_optics_destroy(x->optics);
	free(x);
}

/* ---- what happens ---- */

void bb_crosstalk_edge(struct bb_crosstalk *x, const struct bb_shutter_edge *e)
{
	if (!x)
		return;
	sim_optics_edge(x->optics, e);
	x->edges += e->stage == BB_STAGE_EMITTER;
	x->open = e->eye == BB_EYE_NONE;
}

void bb_crosstalk_flip(struct bb_crosstalk *x, uint16_t screen, const struct bb_flip *flip)
{
	for (size_t i = 0; x && i < x->n; i++)
		if (x->watched[i].screen == screen) {
			struct watched *w = &x->watched[i];
			w->flip[flip->seq % FLIPS].seq = flip->seq;
			w->flip[flip->seq % FLIPS].eye = (enum bb_eye)flip->eye;
			w->flip[flip->seq % FLIPS].fresh = true;
		}
}

/* Every vblank is told, with the picture that flipped at it, if any did. */
static void tell_vblanks(struct bb_crosstalk *x, size_t i, int64_t now_ns)
{
	struct watched *w = &x->watched[i];
	const struct bb_display *d = x->rig->displays[w->screen];

	for (int64_t at_ns; (at_ns = sim_display_vblank_ns(d, w->next_k)) <= now_ns; w->next_k++) {
		const size_t slot = (uint32_t)w->next_k % FLIPS;
		if (at_ns < x->now_ns - x->cycle_ns)
			continue; /* before the scene */
		if (w->flip[slot].fresh && w->flip[slot].seq == (uint32_t)w->next_k) {
			sim_optics_frame(x->optics, i, at_ns, w->flip[slot].eye);
			w->flip[slot].fresh = false;
			w->shown++;
		} else {
			sim_optics_vblank(x->optics, i, at_ns);
		}
	}
}

/* ---- light ---- */

static void gather(struct bb_crosstalk *x, double dt_ns)
{
	for (size_t i = 0; i < x->n; i++)
		for (size_t h = 0; h < BB_BANDS; h++)
			for (unsigned e = 0; e < 2; e++) {
				struct light *l = &x->watched[i].light[h][e];
				const double through = sim_optics_lens(x->optics, e ? BB_EYE_RIGHT : BB_EYE_LEFT) * dt_ns;
				l->own += through * sim_optics_bare(x->optics, i, h, e);
				l->other += through * sim_optics_bare(x->optics, i, h, !e);
				l->black += through * sim_optics_bare(x->optics, i, h, 2);
			}
}

static bool worst(const struct bb_crosstalk *x, double *percent, uint16_t *screen)
{
	*percent = (double)-INFINITY;
	for (size_t i = 0; i < x->n; i++)
		for (size_t h = 0; h < BB_BANDS; h++)
			for (unsigned e = 0; e < 2; e++) {
				const struct light *l = &x->watched[i].light[h][e];
				const double own = fmax(l->own - l->black, (l->other - l->black) * 100 / MOST_PERCENT);
				const double c = 100 * (l->other - l->black) / own;
				if (x->watched[i].shown < 2 * SETTLE || !(own > 0) || !(c > *percent))
					continue;
				*percent = c;
				*screen = x->watched[i].screen;
			}
	return isfinite(*percent);
}

void bb_crosstalk_frame(struct bb_crosstalk *x, uint64_t frame, int64_t now_ns, struct bb_ledger *ledger)
{
	double percent;
	uint16_t screen = 0;

	if (!x)
		return;
	for (size_t i = 0; i < x->n; i++) {
		memset(x->watched[i].light, 0, sizeof(x->watched[i].light));
		tell_vblanks(x, i, now_ns);
	}
	const int64_t from_ns = x->now_ns, span_ns = now_ns - from_ns;
	const double cycles = (double)span_ns / (double)x->cycle_ns;
	/* Only whole cycles are all of the light, and only if every edge came. */
	const bool whole = fabs(cycles - round(cycles)) < 0.02 && x->edges == 2 * (unsigned)llround(cycles) && !x->open;
	for (int64_t at_ns = from_ns; from_ns && at_ns < now_ns;) {
		const int64_t to_ns = at_ns + STEP_NS < now_ns ? at_ns + STEP_NS : now_ns;
		sim_optics_step(x->optics, to_ns);
		gather(x, (double)(to_ns - at_ns));
		at_ns = to_ns;
	}
	if (!from_ns)
		sim_optics_step(x->optics, now_ns);
	x->now_ns = now_ns;
	x->edges = 0;
	if (!whole || !worst(x, &percent, &screen))
		return;
	const struct bb_sample s = { .value = percent, .frame = frame, .at_ns = now_ns,
		                     .node = x->rig->room->screens[screen].node, .stage = BB_STAGE_SHUTTER };
	bb_ledger_sample(ledger, BB_METRIC_CROSSTALK, &s);
}
