/* sync/plan/plan.c: a room into a task, the answer into a plan: walls, cameras, drift. */
#include "sync/plan.h"

#include <math.h>
#include <string.h>

#include "hal/cvt.h"
#include "sync/plan/collide.h"
#include "sync/plan/solve.h"

double bb_plan_limit(const struct bb_room *room)
{
	for (size_t i = 0; i < room->n_budgets; i++)
		if (room->budgets[i].metric == BB_METRIC_CROSSTALK)
			return room->budgets[i].limit;
	return BB_PLAN_LIMIT_PERCENT;
}

struct bb_plan_timing bb_plan_configured(const struct bb_shutter_config *chain)
{
	const double period_us = plan_period_us(chain);

	return (struct bb_plan_timing){ chain->emitter_offset_us, period_us - chain->token_gap_us, chain->shutter_delay_us,
		                        period_us * chain->shutter_duty_percent / 100 };
}

/* --- the task ----------------------------------------------------------------------------------------------------- */

static bool alike(const struct bb_display_config *a, const struct bb_display_config *b)
{
	return a->stereo == b->stereo && a->kind == b->kind && a->rate.num == b->rate.num && a->rate.den == b->rate.den &&
	       a->scan == b->scan && a->vblank_us == b->vblank_us && a->pixel_rise_us == b->pixel_rise_us &&
	       a->pixel_fall_us == b->pixel_fall_us && a->dark_us == b->dark_us && a->strobe_at_us == b->strobe_at_us &&
	       a->strobe_us == b->strobe_us;
}

static bool add_kind(struct plan_task *t, const struct bb_display_config *d)
{
	for (size_t i = 0; i < t->n_displays; i++)
		if (alike(&t->display[i], d))
			return true;
	if (t->n_displays == PLAN_DISPLAYS_MAX)
		return false;
	t->display[t->n_displays++] = *d;
	return true;
}

/* A wall's tiles are alike: its first screen speaks for it. */
static enum bb_status add_walls(const struct bb_room *room, struct plan_task *t, struct bb_plan *p, struct bb_error *err)
{
	for (size_t i = 0; i < room->n_screens; i++) {
		const struct bb_screen *s = &room->screens[i];

		if (s->display.stereo == BB_STEREO_MONO || (i > 0 && room->screens[i - 1].wall == s->wall))
			continue;
		if (p->n_walls == BB_PLAN_WALLS_MAX || !add_kind(t, &s->display))
			return bb_fail(err, BB_ERR_CONFIG, 1611, NULL, "%d walls of %d kinds", BB_PLAN_WALLS_MAX,
			               PLAN_DISPLAYS_MAX);
		struct bb_plan_wall *w = &p->wall[p->n_walls++];
		memcpy(w->id, room->walls[s->wall].id, sizeof(w->id));
		w->display = &s->display;
	}
	if (!p->n_walls || !room->has_chain)
		return bb_fail(err, BB_ERR_CONFIG, 1610, NULL, "%.80s", room->name);
	return BB_OK;
}

static enum bb_status prepare(const struct bb_room *room, double limit_percent, struct plan_task *t, struct bb_plan *p,
                              struct bb_error *err)
{
	const struct bb_ir_protocol *tokens = bb_ir_protocol(room->chain.emitter_protocol);

	t->chain = room->chain;
	t->n_displays = 0;
	t->limit_percent = limit_percent;
	t->edges_least_hz = 2 * room->safety.shutter_least_hz;
	*p = (struct bb_plan){ .limit_percent = limit_percent, .tokens = bb_ir_known(tokens) ? tokens : NULL };
	t->gap_least_us = p->tokens ? bb_ir_least_gap_us(tokens) : 0;
	t->paired = p->tokens && tokens->paired;
	const enum bb_status status = add_walls(room, t, p, err);
	if (!status)
		plan_task_refresh(t);
	p->period_us = t->period_us;
	return status;
}

/* --- cameras ------------------------------------------------------------------------------------------------------ */

static void lock(struct bb_plan_camera *c, const struct bb_light_span *spans, size_t n, struct bb_rate edges,
                 const struct bb_camera_config *camera)
{
	const double ratio = bb_rate_hz(camera->rate) / bb_rate_hz(edges);
	struct bb_collisions hits;
	struct bb_rate rate;

	c->multiplier = ratio >= 1 ? (unsigned)floor(ratio + 1e-9) : 1;
	c->divider = ratio >= 1 ? 1 : (unsigned)ceil(1 / ratio - 1e-9);
	rate = (struct bb_rate){ edges.num * c->multiplier, edges.den * c->divider };
	c->rate_hz = bb_rate_hz(rate);
	bb_collisions(spans, n, edges, rate, c->exposure_us, &hits);
	c->margin_us = hits.margin_us;
	c->phases = hits.phases;
	c->most_percent = hits.most_percent;
	/* All phases are met, so any of the places a fold apart will do: the one next to where the camera is now. */
	c->offset_us = hits.free_us + hits.fold_us * round((camera->sync_offset_us - hits.free_us) / hits.fold_us);
	c->offset_us += c->offset_us < 0 ? hits.fold_us : 0;
}

static void let_run(struct bb_plan_camera *c, const struct bb_light_span *spans, size_t n, struct bb_rate edges,
                    const struct bb_camera_config *camera)
{
	struct bb_collisions hits;

	bb_collisions(spans, n, edges, camera->rate, c->exposure_us, &hits);
	c->rate_hz = bb_rate_hz(camera->rate);
	c->phases = hits.phases;
	c->phases_hit_percent = hits.hit_percent;
	c->mean_percent = hits.mean_percent;
	c->most_percent = hits.most_percent;
}

static bool same_camera(const struct bb_camera_config *a, const struct bb_camera_config *b)
{
	return a->sync == b->sync && a->rate.num == b->rate.num && a->rate.den == b->rate.den &&
	       a->exposure_us == b->exposure_us && a->sync_offset_us == b->sync_offset_us;
}

static enum bb_status plan_cameras(const struct bb_room *room, struct bb_plan *p, struct bb_error *err)
{
	size_t like[BB_PLAN_CAMERAS_MAX] = { 0 }; /* the first camera of each kind */
	struct bb_light_span spans[BB_TOKENS];
	size_t n = 0;

	if (p->tokens)
		n = bb_ir_spans(p->tokens, p->period_us, p->timing.glasses_at_us, p->timing.glasses_open_us, spans);
	for (size_t i = 0; i < room->n_cameras; i++) {
		const struct bb_camera_config *camera = &room->cameras[i];
		size_t k = 0;

		while (k < p->n_cameras && !same_camera(&room->cameras[like[k]], camera))
			k++;
		if (k == BB_PLAN_CAMERAS_MAX)
			return bb_fail(err, BB_ERR_CONFIG, 1612, NULL, "%d kinds of cameras", BB_PLAN_CAMERAS_MAX);
		struct bb_plan_camera *c = &p->camera[k];
		if (k < p->n_cameras) {
			c->n++;
			continue;
		}
		like[p->n_cameras++] = i;
		*c = (struct bb_plan_camera){ .n = 1, .locked = camera->sync != BB_SYNC_FREE,
			                      .exposure_us = camera->exposure_us };
		memcpy(c->first, camera->id, sizeof(c->first));
		(c->locked ? lock : let_run)(c, spans, n, room->chain.rate, camera);
	}
	return BB_OK;
}

/* --- drift -------------------------------------------------------------------------------------------------------- */

/* Of a display that nothing locks. A whole number is the one on the box: the mode it is driven in has another. */
static double true_hz(const struct bb_display_config *d)
{
	struct bb_cvt mode;
	double hz = bb_rate_hz(d->rate);

	if (d->rate.den == 1 && bb_cvt_rb((int)d->width_px, (int)d->height_px, d->rate, &mode) == BB_OK)
		hz = bb_cvt_rate_hz(&mode);
	return isnan(d->rate_error_ppm) ? hz : hz * (1 + d->rate_error_ppm * 1e-6);
}

static void plan_drift(struct bb_plan *p)
{
	for (size_t i = 0; i < p->n_walls; i++)
		for (size_t k = i + 1; k < p->n_walls; k++) {
			const struct bb_plan_wall *a = &p->wall[i], *b = &p->wall[k];
			const double a_hz = true_hz(a->display), b_hz = true_hz(b->display);

			if (a->display->genlock || b->display->genlock || a_hz == b_hz)
				continue;
			if (p->n_drifts < BB_PLAN_DRIFTS_MAX) {
				struct bb_plan_drift *d = &p->drift[p->n_drifts];
				*d = (struct bb_plan_drift){ .a_hz = a_hz, .b_hz = b_hz, .frame_s = 1 / fabs(a_hz - b_hz) };
				memcpy(d->a, a->id, sizeof(d->a));
				memcpy(d->b, b->id, sizeof(d->b));
			}
			p->n_drifts++;
		}
}

/* ------------------------------------------------------------------------------------------------------------------ */

static enum bb_status fill(const struct bb_room *room, const struct plan_task *t, struct bb_plan *p,
                           struct bb_error *err)
{
	p->worst = plan_task_light(t, &p->timing);
	for (size_t i = 0; i < p->n_walls; i++)
		for (size_t b = 0; b < BB_PLAN_BANDS; b++) {
			struct bb_plan_band *band = &p->wall[i].band[b];

			band->top = plan_band_top[b];
			band->bottom = plan_band_bottom[b];
			band->light = bb_plan_strip(p->wall[i].display, &t->chain, &p->timing, band->top, band->bottom);
			plan_window(band, p->wall[i].display, &t->chain, &p->timing, p->limit_percent);
		}
	plan_drift(p);
	return plan_cameras(room, p, err);
}

enum bb_status bb_plan_room(const struct bb_room *room, double limit_percent, struct bb_plan *out, struct bb_error *err)
{
	struct plan_task task;
	enum bb_status status = prepare(room, limit_percent, &task, out, err);

	if (status)
		return status;
	out->possible = plan_solve(&task, &out->timing);
	status = fill(room, &task, out, err);
	if (!out->possible)
		out->stops = plan_needs(&task, out->need);
	return status;
}

enum bb_status bb_plan_judge(const struct bb_room *room, double limit_percent, const struct bb_plan_timing *timing,
                             struct bb_plan *out, struct bb_error *err)
{
	struct plan_task task;
	enum bb_status status = prepare(room, limit_percent, &task, out, err);

	if (status)
		return status;
	out->timing = *timing;
	status = fill(room, &task, out, err);
	out->possible = out->worst.crosstalk_percent <= limit_percent;
	return status;
}
