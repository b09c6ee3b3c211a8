#include "hal/safe_state.h"

#define STEP_PARTS 20 /* of a fade: as far as one call moves it, however late it comes */

void bb_safe_init(struct bb_safe_state *s, const struct bb_safety *limits, double dim, enum bb_show show, int64_t now_ns)
{
	*s = (struct bb_safe_state){ .fade_ns = (int64_t)(limits->fade_ms * 1e6),
		                     .gap_ns = (int64_t)(limits->transition_gap_s * 1e9),
		                     .dim = dim,
		                     .show = show,
		                     .stepped_ns = now_ns };
#ifdef BB_SAFE_UNLATCHED /* one test is built like this, to see the flash meter find what the latch prevents */
	s->gap_ns = 0;
	s->fade_ns = 1;
#endif
	s->moved_ns = now_ns - s->gap_ns;
	s->out = (struct bb_safe_output){ show == BB_SHOW_OPEN, show == BB_SHOW_STEREO, show != BB_SHOW_BLACK };
}

static double slew(double from, double to, double most)
{
	if (to > from + most)
		return from + most;
	if (to < from - most)
		return from - most;
	return to;
}

static bool runs(enum bb_show show)
{
	return show == BB_SHOW_STEREO || show == BB_SHOW_MONO;
}

static void move(struct bb_safe_state *s, double most)
{
	struct bb_safe_output *o = &s->out;
	const bool closing = o->open && runs(s->show);
	const double light = s->show == BB_SHOW_BLACK ? 0 : closing ? s->dim : 1;
	const double depth = s->show == BB_SHOW_STEREO && !o->open;

	o->light = slew(o->light, light, most);
	o->depth = slew(o->depth, depth, most);
	if (closing && o->light <= s->dim) {
		o->open = false;
		o->light /= s->dim;
	}
}

struct bb_safe_output bb_safe_step(struct bb_safe_state *s, enum bb_show want, int64_t now_ns)
{
	const int64_t passed_ns = now_ns - s->stepped_ns, most_ns = s->fade_ns / STEP_PARTS;
	const int64_t step_ns = passed_ns < most_ns ? passed_ns : most_ns;
	const bool free = now_ns - s->moved_ns >= s->gap_ns;

	if (want != s->show && (want == BB_SHOW_OPEN || free)) {
		s->show = want;
		s->moved_ns = now_ns;
	}
	if (s->show == BB_SHOW_OPEN) {
		s->out.open = true;
		s->out.depth = 0;
	}
	s->stepped_ns = now_ns;
	move(s, (double)step_ns / (double)s->fade_ns);
	return s->out;
}
