#include "sim/optics/optics.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sim/optics/light.h"

struct projector {
	bool shuttered;
	enum bb_eye eye;                    /* of the pair; NONE: shows both in turn */
	struct sim_patch patch[SIM_LANES][SIM_HEIGHTS];
	struct sim_patch tag;
	struct sim_cell shutter;
};
struct screen {
	const struct bb_display_config *display;
	int stage;                          /* of the chain; -1: none */
	unsigned n_projectors;
	struct projector projector[2];
	uint64_t cycle;                     /* counts for the tag */
	double bare[SIM_LANES][SIM_HEIGHTS], tag;
};
struct sim_optics {
	struct sim_look look;
	int64_t edge_ns;                    /* nominal, of an edge period */
	int64_t glasses_ns, shutter_ns;     /* open after their edge */
	int64_t now_ns;
	bool begun;
	enum bb_pattern pattern[SIM_LANES];
	struct sim_cell lens[2];
	double lens_light[2];
	size_t n_screens;
	struct screen screen[];
};

static int stage_of(const struct bb_room *room, const struct bb_screen *s)
{
	for (int i = 0; i < room->chain.n_stages; i++)
		if (!strcmp(room->chain.stage[i], room->walls[s->wall].id))
			return i;
	return -1;
}

struct sim_look sim_look_bands(void)
{
	return (struct sim_look){ .n_heights = BB_BANDS, .height = { 0, 0.5, 1 }, .spread = 0.005, .lanes = 1 };
}

static void init_screen(struct screen *s, const struct bb_room *room, size_t index, const struct sim_look *look)
{
	const struct bb_screen *from = &room->screens[index];
	const bool pair = from->display.stereo == BB_STEREO_DUAL_PROJECTOR;

	s->display = &from->display;
	s->stage = stage_of(room, from);
	s->n_projectors = pair ? 2 : 1;
	for (unsigned i = 0; i < s->n_projectors; i++) {
		struct projector *p = &s->projector[i];
		p->eye = !pair ? BB_EYE_NONE : i ? BB_EYE_RIGHT : BB_EYE_LEFT;
		p->shuttered = pair && s->stage >= 0;
		sim_cell_init(&p->shutter, &room->chain.cell);
		sim_patch_init(&p->tag, s->display, 1, look->spread);
		for (unsigned lane = 0; lane < look->lanes; lane++)
			for (size_t h = 0; h < look->n_heights; h++)
				sim_patch_init(&p->patch[lane][h], s->display, look->height[h], look->spread);
	}
}

enum bb_status sim_optics_create(const struct bb_room *room, const size_t *screens, size_t n, const struct sim_look *look,
                                 struct sim_optics **out)
{
	*out = NULL;
	if (!room->has_chain || look->n_heights > SIM_HEIGHTS || look->lanes > SIM_LANES)
		return BB_ERR_UNSUPPORTED;
	struct sim_optics *o = calloc(1, sizeof(*o) + n * sizeof(o->screen[0]));
	if (!o)
		return BB_ERR_NOMEM;
	o->look = *look;
	o->edge_ns = bb_rate_period_ns(room->chain.rate);
	sim_optics_set_open(o, (double)o->edge_ns * 1e-3 - room->chain.token_gap_us,
	                    (double)o->edge_ns * 1e-3 * room->chain.shutter_duty_percent / 100);
	o->n_screens = n;
	for (int lane = 0; lane < SIM_LANES; lane++)
		o->pattern[lane] = BB_PATTERN_BLACK_BLACK;
	for (int eye = 0; eye < 2; eye++)
		sim_cell_init(&o->lens[eye], &room->chain.glasses);
	for (size_t i = 0; i < n; i++)
		init_screen(&o->screen[i], room, screens[i], look);
	*out = o;
	return BB_OK;
}

void sim_optics_destroy(struct sim_optics *o)
{
	free(o);
}

void sim_optics_set_open(struct sim_optics *o, double glasses_us, double shutter_us)
{
	o->glasses_ns = llround(glasses_us * 1e3);
	o->shutter_ns = llround(shutter_us * 1e3);
}

void sim_optics_show(struct sim_optics *o, unsigned lane, enum bb_pattern pattern)
{
	o->pattern[lane] = pattern;
}

/* ---- events ---- */

static void drive_pair(struct sim_cell *left, struct sim_cell *right, enum bb_eye eye, int64_t at_ns, int64_t open_ns,
                       bool by_itself)
{
	struct sim_cell *opens = eye == BB_EYE_RIGHT ? right : left, *closes = eye == BB_EYE_RIGHT ? left : right;

	if (eye == BB_EYE_NONE)
		left->drives.n = right->drives.n = 0; /* whatever was about to close stays open */
	sim_cell_drive(opens, at_ns, true);
	sim_cell_drive(closes, at_ns, eye == BB_EYE_NONE);
	if (eye == BB_EYE_NONE)
		return;
	if (by_itself)
		sim_cell_drive(opens, at_ns + open_ns, false);
}

void sim_optics_edge(struct sim_optics *o, const struct bb_shutter_edge *e)
{
	const enum bb_eye eye = (enum bb_eye)e->eye;

	if (e->stage == BB_STAGE_EMITTER) {
		drive_pair(&o->lens[0], &o->lens[1], eye, e->at_ns, o->glasses_ns, o->glasses_ns < o->edge_ns);
		return;
	}
	for (size_t i = 0; i < o->n_screens; i++) {
		struct screen *s = &o->screen[i];
		if (s->stage == e->stage && s->projector[0].shuttered)
			drive_pair(&s->projector[0].shutter, &s->projector[1].shutter, eye, e->at_ns, o->shutter_ns,
			           o->shutter_ns < o->edge_ns);
	}
}

void sim_optics_frame(struct sim_optics *o, size_t screen, int64_t vblank_ns, enum bb_eye eye)
{
	struct screen *s = &o->screen[screen];

	if (eye != BB_EYE_RIGHT)
		s->cycle++;
	for (unsigned i = 0; i < s->n_projectors; i++) {
		struct projector *p = &s->projector[i];
		const enum bb_eye shown = p->eye ? p->eye : eye;
		sim_patch_frame(&p->tag, vblank_ns, bb_tag_light(s->cycle, shown));
		for (unsigned lane = 0; lane < o->look.lanes; lane++)
			for (size_t h = 0; h < o->look.n_heights; h++)
				sim_patch_frame(&p->patch[lane][h], vblank_ns, bb_pattern_light(o->pattern[lane], shown));
	}
}

void sim_optics_vblank(struct sim_optics *o, size_t screen, int64_t vblank_ns)
{
	struct screen *s = &o->screen[screen];

	for (unsigned i = 0; i < s->n_projectors; i++) {
		sim_patch_vblank(&s->projector[i].tag, vblank_ns);
		for (unsigned lane = 0; lane < o->look.lanes; lane++)
			for (size_t h = 0; h < o->look.n_heights; h++)
				sim_patch_vblank(&s->projector[i].patch[lane][h], vblank_ns);
	}
}

/* ---- time ---- */

static void step_screen(const struct sim_optics *o, struct screen *s, int64_t to_ns)
{
	memset(s->bare, 0, sizeof(s->bare));
	s->tag = 0;
	for (unsigned i = 0; i < s->n_projectors; i++) {
		struct projector *p = &s->projector[i];
		const double through = p->shuttered ? sim_cell_step(&p->shutter, o->now_ns, to_ns) : 1;
		for (unsigned lane = 0; lane < o->look.lanes; lane++)
			for (size_t h = 0; h < o->look.n_heights; h++)
				s->bare[lane][h] += through * sim_patch_step(&p->patch[lane][h], o->now_ns, to_ns);
		if (o->look.tag)
			s->tag += through * sim_patch_step(&p->tag, o->now_ns, to_ns);
	}
}

void sim_optics_step(struct sim_optics *o, int64_t to_ns)
{
	if (!o->begun || to_ns <= o->now_ns) {
		o->now_ns = o->begun ? o->now_ns : to_ns;
		o->begun = true;
		return;
	}
	for (int eye = 0; eye < 2; eye++)
		o->lens_light[eye] = sim_cell_step(&o->lens[eye], o->now_ns, to_ns);
	for (size_t i = 0; i < o->n_screens; i++)
		step_screen(o, &o->screen[i], to_ns);
	o->now_ns = to_ns;
}

double sim_optics_lens(const struct sim_optics *o, enum bb_eye eye)
{
	return o->lens_light[eye == BB_EYE_RIGHT];
}

double sim_optics_bare(const struct sim_optics *o, size_t screen, size_t height, unsigned lane)
{
	return o->screen[screen].bare[lane][height];
}

double sim_optics_tag(const struct sim_optics *o, size_t screen)
{
	return o->screen[screen].tag;
}
