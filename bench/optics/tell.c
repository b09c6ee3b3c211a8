/* bench/optics/tell.c: what a recording says, as a table, as JSON, and against what the room promises. */
#include <jansson.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "bench/file.h"
#include "bench/optics/measure.h"
#include "bench/stats.h"
#include "sync/plan.h"

static const char *const bands[BB_BANDS] = { "top", "middle", "bottom" };
static const char *const eyes[2] = { "left", "right" };

/* ---- judging ---- */

static double budget(const struct bb_room *room, enum bb_metric metric, double fallback)
{
	for (size_t i = 0; i < room->n_budgets; i++)
		if (room->budgets[i].metric == metric)
			return room->budgets[i].limit;
	return fallback;
}

static const enum bb_verdict verdict_of[] = { [BB_HOLDS] = BB_PASS, [BB_MISSES] = BB_FAIL,
	                                      [BB_UNDECIDED] = BB_INCONCLUSIVE };

static void add(struct bb_measure *m, struct bb_measure_check check)
{
	static const int rank[] = { [BB_SKIP] = 0, [BB_PASS] = 1, [BB_INCONCLUSIVE] = 2, [BB_FAIL] = 3 };

	if (m->n_checks < BB_MEASURE_CHECKS)
		m->check[m->n_checks++] = check;
	if (rank[check.verdict] > rank[m->verdict])
		m->verdict = check.verdict;
}

BB_PRINTF(5, 6)
static void check_most(struct bb_measure *m, struct bb_estimate value, double limit, const char *unit, const char *what, ...)
{
	struct bb_measure_check c = { .value = value, .limit = limit, .unit = unit };
	va_list args;

	va_start(args, what);
	vsnprintf(c.what, sizeof(c.what), what, args);
	va_end(args);
	const bool leak = !strcmp(unit, "%"); /* may be negative, which is no fault; a phase to either side is one */
	const struct bb_estimate size = { leak ? value.value : fabs(value.value), value.sigma };
	c.verdict = verdict_of[bb_optics_judge(size, limit)];
	add(m, c);
}

static const struct bb_screen *screen_of(const struct bb_room *room, const char *wall)
{
	for (size_t i = 0; i < room->n_screens; i++)
		if (!strcmp(room->screens[i].id, wall))
			return &room->screens[i];
	return NULL;
}

/* Did somebody look at this wall through both lenses? */
static bool has_lenses(const struct bb_recording *r, const char *wall)
{
	bool lens[BB_LENS_COUNT] = { false };

	for (size_t i = 0; i < r->n_channels; i++)
		if (!strcmp(r->channel[i].wall, wall))
			lens[r->channel[i].lens] = true;
	return lens[BB_LENS_LEFT] && lens[BB_LENS_RIGHT];
}

/* When a band lights up after a lens opened, us, as the timing wants it. */
static double wanted_us(const struct bb_room *room, const struct bb_screen *s, const struct bb_plan_timing *t, int band)
{
	const struct bb_display_config *d = &s->display;
	const double vblank = bb_display_vblank_us(d), period = 1e6 / bb_rate_hz(d->rate);
	const double place = d->scan == BB_SCAN_GLOBAL ? 0 : d->scan == BB_SCAN_UP ? 1 - band / 2.0 : band / 2.0;

	(void)room;
	if (d->stereo == BB_STEREO_DUAL_PROJECTOR)
		return t->shutter_at_us - t->glasses_at_us;
	return vblank + place * (period - vblank) - t->glasses_at_us;
}

static void judge_wall(struct bb_measure *m, const struct bb_optics_wall *w, const struct bb_room *room,
                       const struct bb_plan_timing *timing)
{
	const struct bb_screen *s = screen_of(room, w->id);
	const double phase_us = budget(room, BB_METRIC_PHASE, 300), cycle_us = w->cycle_ns.value * 1e-3;

	for (int b = 0; b < BB_BANDS; b++)
		for (int e = 0; e < 2; e++) {
			struct bb_estimate phase = w->band[b].phase_ns[e];
			if (isfinite(w->band[b].crosstalk[e].value))
				check_most(m, w->band[b].crosstalk[e], bb_plan_limit(room), "%", "%s %s %s crosstalk", w->id,
				           bands[b], eyes[e]);
			if (!isfinite(phase.value) || !s)
				continue;
			phase.value = remainder(phase.value * 1e-3 - wanted_us(room, s, timing, b), cycle_us);
			phase.sigma *= 1e-3;
			check_most(m, phase, phase_us, "us", "%s %s %s phase off plan", w->id, bands[b], eyes[e]);
		}
	const struct bb_estimate skew = { w->skew_ns.value * 1e-3, w->skew_ns.sigma * 1e-3 };
	if (isfinite(skew.value) && w != m->optics.wall)
		check_most(m, skew, budget(room, BB_METRIC_SCANOUT_SKEW, phase_us), "us", "%s skew to %s", w->id,
		           m->optics.wall[0].id);
}

void bb_measure_judge(struct bb_measure *m, const struct bb_room *room, bool planned)
{
	struct bb_plan_timing timing = { 0 };
	struct bb_plan *plan = room && planned ? calloc(1, sizeof(*plan)) : NULL;

	if (room)
		timing = bb_plan_configured(&room->chain);
	if (plan && bb_plan_room(room, bb_plan_limit(room), plan, NULL) == BB_OK)
		timing = plan->timing;
	m->verdict = BB_SKIP;
	m->n_checks = 0;
	for (size_t i = 0; i < m->optics.n_walls; i++) {
		const struct bb_optics_wall *w = &m->optics.wall[i];
		struct bb_measure_check c = { .value = { w->order == BB_ORDER_SWAPPED, 0 }, .unit = "" };
		c.verdict = w->order == BB_ORDER_RIGHT     ? BB_PASS
		            : w->order == BB_ORDER_SWAPPED ? BB_FAIL
		                                           : BB_INCONCLUSIVE;
		snprintf(c.what, sizeof(c.what), "%s eyes swapped", w->id);
		if (has_lenses(&m->recording, w->id))
			add(m, c);
		if (room)
			judge_wall(m, w, room, &timing);
	}
	free(plan);
}

/* ---- a table ---- */

static const char *order_text(enum bb_order o)
{
	return o == BB_ORDER_RIGHT ? "each eye sees its own picture" : o == BB_ORDER_SWAPPED ? "SWAPPED" : "not known";
}

static const char *show(char *out, size_t cap, struct bb_estimate e, double unit, int digits)
{
	if (!isfinite(e.value))
		snprintf(out, cap, "-");
	else
		snprintf(out, cap, "%.*f +- %.*f", digits, e.value * unit, digits, e.sigma * unit);
	return out;
}

static void print_band(const struct bb_optics_band *b, int band, int e, FILE *out)
{
	char text[6][48];

	fprintf(out, "    %-7s %-5s %19s %17s %19s %17s %15s\n", bands[band], eyes[e],
	        show(text[0], 48, b->white[e].found ? b->white[e].rise_ns : (struct bb_estimate){ BB_UNKNOWN, BB_UNKNOWN }, 1e-3, 1),
	        show(text[1], 48, b->white[e].found ? b->white[e].fall_ns : (struct bb_estimate){ BB_UNKNOWN, BB_UNKNOWN }, 1e-3, 1),
	        show(text[2], 48, b->phase_ns[e], 1e-3, 1), show(text[3], 48, b->crosstalk[e], 1, 3),
	        show(text[4], 48, b->light[e], 1, 2));
}

static void print_wall(const struct bb_optics_wall *w, size_t index, const char *first, FILE *out)
{
	char text[2][48];

	fprintf(out, "  %s: %s Hz, %s\n", w->id,
	        show(text[0], 48, (struct bb_estimate){ 2e9 / w->cycle_ns.value, 2e9 / w->cycle_ns.value * w->cycle_ns.sigma / w->cycle_ns.value }, 1, 4),
	        order_text(w->order));
	if (index && isfinite(w->skew_ns.value))
		fprintf(out, "    %s us behind %s\n", show(text[0], 48, w->skew_ns, 1e-3, 1), first);
	if (isfinite(w->scan_ns.value))
		fprintf(out, "    bottom lights up %s us after top\n", show(text[0], 48, w->scan_ns, 1e-3, 1));
	if (w->tag.seen)
		fprintf(out, "    tag: %llu cycles, %llu gaps, %llu odd levels; its eyes: %s\n",
		        (unsigned long long)w->tag.cycles, (unsigned long long)w->tag.gaps, (unsigned long long)w->tag.odd,
		        order_text(w->tag.order));
	fprintf(out, "    %-13s %19s %17s %19s %17s %15s\n", "", "lights up us", "dark again us", "after the lens us",
	        "crosstalk %", "light %");
	for (int b = 0; b < BB_BANDS; b++)
		for (int e = 0; e < 2 && w->band[b].seen; e++)
			print_band(&w->band[b], b, e, out);
}

/* What holds is counted; what does not is told. */
static void print_checks(const struct bb_measure *m, FILE *out)
{
	char text[48];
	size_t n_pass = 0;

	for (size_t i = 0; i < m->n_checks; i++) {
		const struct bb_measure_check *c = &m->check[i];
		n_pass += c->verdict == BB_PASS;
		if (c->verdict == BB_PASS)
			continue;
		if (!*c->unit)
			fprintf(out, "  %-13s %s: %s\n", bb_verdict_text(c->verdict), c->what, c->verdict == BB_INCONCLUSIVE ? "cannot tell" : c->value.value > 0 ? "yes" : "no");
		else
			fprintf(out, "  %-13s %s: %s %s, limit %g\n", bb_verdict_text(c->verdict), c->what,
			        show(text, sizeof(text), c->value, 1, 3), c->unit, c->limit);
	}
	if (m->n_checks)
		fprintf(out, "%s: %zu of %zu checks hold\n", bb_verdict_text(m->verdict), n_pass, m->n_checks);
}

void bb_measure_print(const struct bb_measure *m, FILE *out)
{
	const struct bb_optics *o = &m->optics;
	char text[4][48];

	fprintf(out, "%llu samples of %zu channels; times are us in a cycle of both eyes, with one sigma\n",
	        (unsigned long long)o->n_samples, m->recording.n_channels);
	for (int e = 0; e < 2; e++)
		if (o->has_lens[e])
			fprintf(out, "  %-5s lens: opens at %s, closes at %s us; 10-90 %% in %s and %s us\n", eyes[e],
			        show(text[0], 48, o->lens[e].rise_ns, 1e-3, 1), show(text[1], 48, o->lens[e].fall_ns, 1e-3, 1),
			        show(text[2], 48, o->lens[e].rise_tau_ns, 2.1972245773362196e-3, 0),
			        show(text[3], 48, o->lens[e].fall_tau_ns, 2.1972245773362196e-3, 0));
	for (size_t i = 0; i < o->n_walls; i++)
		print_wall(&o->wall[i], i, o->wall[0].id, out);
	print_checks(m, out);

}

/* ---- JSON ---- */

static json_t *json_estimate(struct bb_estimate e, double unit)
{
	if (!isfinite(e.value))
		return json_null();
	/* How sure a value is may be unknown, and JSON has no word for that. */
	return json_pack("{s:f, s:o}", "value", e.value * unit, "sigma",
	                 isfinite(e.sigma) ? json_real(e.sigma * unit) : json_null());
}

static json_t *json_pulse(const struct bb_pulse *p)
{
	if (!p->found)
		return json_null();
	return json_pack("{s:o, s:o, s:o, s:o}", "on_us", json_estimate(p->rise_ns, 1e-3), "off_us",
	                 json_estimate(p->fall_ns, 1e-3), "on_tau_us", json_estimate(p->rise_tau_ns, 1e-3), "off_tau_us",
	                 json_estimate(p->fall_tau_ns, 1e-3));
}

static json_t *json_bands(const struct bb_optics_wall *w)
{
	json_t *list = json_array();

	for (int b = 0; b < BB_BANDS; b++)
		for (int e = 0; e < 2 && w->band[b].seen; e++)
			json_array_append_new(
				list, json_pack("{s:s, s:s, s:o, s:o, s:o, s:o}", "band", bands[b], "eye", eyes[e], "white",
			                        json_pulse(&w->band[b].white[e]), "after_lens_us",
			                        json_estimate(w->band[b].phase_ns[e], 1e-3), "crosstalk_percent",
			                        json_estimate(w->band[b].crosstalk[e], 1), "light_percent",
			                        json_estimate(w->band[b].light[e], 1)));
	return list;
}

static json_t *json_wall(const struct bb_optics_wall *w)
{
	static const char *const order[] = { "unknown", "right", "swapped" };
	json_t *o = json_pack("{s:s, s:o, s:s, s:o, s:o, s:o}", "wall", w->id, "cycle_us", json_estimate(w->cycle_ns, 1e-3),
	                      "order", order[w->order], "skew_us", json_estimate(w->skew_ns, 1e-3), "scan_us",
	                      json_estimate(w->scan_ns, 1e-3), "bands", json_bands(w));

	if (w->tag.seen)
		json_object_set_new(o, "tag", json_pack("{s:I, s:I, s:I, s:s}", "cycles", (json_int_t)w->tag.cycles, "gaps",
		                                        (json_int_t)w->tag.gaps, "odd", (json_int_t)w->tag.odd, "order",
		                                        order[w->tag.order]));
	return o;
}

json_t *bb_measure_json(const struct bb_measure *m)
{
	const struct bb_optics *o = &m->optics;
	json_t *walls = json_array(), *checks = json_array();

	for (size_t i = 0; i < o->n_walls; i++)
		json_array_append_new(walls, json_wall(&o->wall[i]));
	for (size_t i = 0; i < m->n_checks; i++) {
		const struct bb_measure_check *c = &m->check[i];
		json_array_append_new(checks, json_pack("{s:s, s:o, s:f, s:s, s:s}", "what", c->what, "value",
		                                        json_estimate(c->value, 1), "limit", c->limit, "unit", c->unit,
		                                        "verdict", bb_verdict_text(c->verdict)));
	}
	return json_pack("{s:I, s:o, s:o, s:o, s:o, s:o, s:s}", "samples", (json_int_t)o->n_samples, "cycle_us",
	                 json_estimate(o->cycle_ns, 1e-3), "left_lens", json_pulse(&o->lens[0]), "right_lens",
	                 json_pulse(&o->lens[1]), "walls", walls, "checks", checks, "verdict", bb_verdict_text(m->verdict));
}
