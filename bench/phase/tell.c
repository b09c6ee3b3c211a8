#include "bench/phase/tell.h"

#include <math.h>
#include <string.h>

#include "bench/file.h"
#include "sync/plan/tokens.h"

const char *const bb_phase_band[BB_PLAN_BANDS] = { "top", "middle", "bottom" };

static const struct {
	const char *key, *name, *unit;
	double ideal;
} parts[BB_PLAN_PARTS] = {
	[BB_PLAN_PIXEL] = { "pixel_response_us", "pixel response", "us", 0 },
	[BB_PLAN_VBLANK] = { "vblank_us", "vertical blank", "us", (double)NAN },
	[BB_PLAN_OPENING] = { "cell_open_us", "opening of the cells", "us", 0 },
	[BB_PLAN_CLOSING] = { "cell_close_us", "closing of the cells", "us", 0 },
	[BB_PLAN_CONTRAST] = { "cell_contrast", "contrast of the cells", ": 1", 1e6 },
	[BB_PLAN_REFRESH] = { "refresh_hz", "refresh", "Hz", (double)NAN },
};

static bool any(const struct bb_plan *p, enum bb_stereo stereo)
{
	for (size_t i = 0; i < p->n_walls; i++)
		if (p->wall[i].display->stereo == stereo)
			return true;
	return false;
}

bool bb_phase_clear(const struct bb_plan *p)
{
	for (size_t i = 0; i < p->n_cameras; i++)
		if (p->camera[i].locked ? p->camera[i].margin_us < 0 : p->camera[i].mean_percent > 0)
			return false;
	return true;
}

/* A delay as the room file takes it: 0 .. one period; what does not fit belongs to the other eye's edge. */
static double in_file(double at_us, double period_us, bool *exchanged)
{
	const double edges = floor(at_us / period_us);

	*exchanged = fmod(edges, 2) != 0;
	return at_us - edges * period_us;
}

/* --- table -------------------------------------------------------------------------------------------------------- */

static void print_timing(const struct bb_plan *p, const char *what, FILE *out)
{
	const struct bb_plan_timing *t = &p->timing;

	fprintf(out, "%-12s light %.2f %%, crosstalk %.3g %%%s: a lens opens %+.1f us from its edge for %.1f us", what,
	        p->worst.light_percent, p->worst.crosstalk_percent, p->possible ? "" : ", too much", t->glasses_at_us,
	        t->glasses_open_us);
	if (any(p, BB_STEREO_DUAL_PROJECTOR))
		fprintf(out, ",\n%-12s a projector's shutter %+.1f us for %.1f us", "", t->shutter_at_us, t->shutter_open_us);
	fputs("\n", out);
}

static void print_file(const struct bb_plan *p, FILE *out)
{
	bool glasses, shutters;
	const double offset = in_file(p->timing.glasses_at_us, p->period_us, &glasses);
	const double delay = in_file(p->timing.shutter_at_us, p->period_us, &shutters);

	fprintf(out, "room file    emitter: {offset_us: %.1f, token_gap_us: %.1f}%s\n", offset,
	        p->period_us - p->timing.glasses_open_us, glasses ? ", left and right tokens exchanged" : "");
	if (any(p, BB_STEREO_DUAL_PROJECTOR))
		fprintf(out, "             chain: {shutter_delay_us: %.1f, shutter_duty_percent: %.2f}%s\n", delay,
		        100 * p->timing.shutter_open_us / p->period_us, shutters ? ", left and right exchanged" : "");
}

static bool same_band(const struct bb_plan_band *a, const struct bb_plan_band *b)
{
	return a->window_from_ns == b->window_from_ns && a->window_to_ns == b->window_to_ns &&
	       a->light.light_percent == b->light.light_percent &&
	       a->light.crosstalk_percent == b->light.crosstalk_percent;
}

bool bb_phase_alike(const struct bb_plan_wall *a, const struct bb_plan_wall *b)
{
	for (size_t i = 0; i < BB_PLAN_BANDS; i++)
		if (!same_band(&a->band[i], &b->band[i]))
			return false;
	return a->display->stereo == b->display->stereo && a->display->kind == b->display->kind;
}

static void print_walls(const struct bb_plan *p, FILE *out)
{
	fprintf(out, "\n%-24s %-7s %20s %8s %12s %22s\n", "wall", "rows", "one eye alone, us", "light %", "crosstalk %",
	        "us to the neighbours");
	for (size_t i = 0; i < p->n_walls; i++) {
		const struct bb_plan_wall *w = &p->wall[i];

		if (i > 0 && bb_phase_alike(w - 1, w)) {
			fprintf(out, "%-24s the same\n", w->id);
			continue;
		}
		for (size_t b = 0; b < BB_PLAN_BANDS; b++) {
			const struct bb_plan_band *band = &w->band[b];
			const double from = (double)band->window_from_ns / 1e3, to = (double)band->window_to_ns / 1e3;
			char window[48] = "never";

			if (to > from)
				snprintf(window, sizeof(window), "%.0f .. %.0f", from, to);
			fprintf(out, "%-24s %-7s %20s %8.2f %12.3f %+11.0f %+10.0f\n", b ? "" : w->id, bb_phase_band[b],
			        window, band->light.light_percent, band->light.crosstalk_percent, band->margin_before_us,
			        band->margin_after_us);
		}
	}
}

static void print_needs(const struct bb_plan *p, FILE *out)
{
	fprintf(out, "\n%-24s %14s %16s   %s\n", "what would help alone", "now", "needed", "crosstalk with an ideal one");
	for (size_t i = 0; i < BB_PLAN_PARTS; i++) {
		const struct bb_plan_need *n = &p->need[i];
		char needed[32] = "no value does";

		if (isfinite(n->needed))
			snprintf(needed, sizeof(needed), "%.4g %s", n->needed, parts[i].unit);
		fprintf(out, "%-24s %10.4g %-3s %16s   %.3g %%\n", parts[i].name, n->now, parts[i].unit, needed,
		        n->ideal_percent);
	}
}

static void print_verdict(const struct bb_plan *p, FILE *out)
{
	const struct bb_plan_need *n = &p->need[p->stops];

	if (p->possible)
		return;
	fprintf(out, "NOT POSSIBLE at %g %%: the least crosstalk there is is %.3g %%. The %s stops it", p->limit_percent,
	        p->worst.crosstalk_percent, parts[p->stops].name);
	if (isfinite(n->needed))
		fprintf(out, ": %.4g %s, %.4g needed.\n", n->now, parts[p->stops].unit, n->needed);
	else
		fprintf(out, " more than any other part, and yet an ideal one would leave %.3g %%.\n", n->ideal_percent);
}

static void print_cameras(const struct bb_plan *p, FILE *out)
{
	for (size_t i = 0; i < p->n_cameras; i++) {
		const struct bb_plan_camera *c = &p->camera[i];

		fprintf(out, "%-12s %s", i ? "" : "cameras", c->first);
		if (c->n > 1)
			fprintf(out, " and %zu like it", c->n - 1);
		if (c->locked)
			fprintf(out, ": %g Hz (edges x %u / %u), %.0f us of strobe at %.1f us", c->rate_hz, c->multiplier,
			        c->divider, c->exposure_us, c->offset_us);
		else
			fprintf(out, ": %g Hz running free, %.0f us of strobe", c->rate_hz, c->exposure_us);
		if (!p->tokens)
			fputs("\n", out);
		else if (c->locked && c->margin_us >= 0)
			fprintf(out, ", %.0f us from the nearest token\n", c->margin_us);
		else if (c->locked)
			fprintf(out, ": COLLIDES with tokens at any offset, %.0f us too long\n", -2 * c->margin_us);
		else
			fprintf(out,
			        ": meets %llu phases; %.0f %% of start phases COLLIDE, the worst in %.1f %% of exposures;\n"
			        "%-12s once drift has swept all, %.2f %%. Lock it: sync: shutters\n",
			        (unsigned long long)c->phases, c->phases_hit_percent, c->most_percent, "", c->mean_percent);
	}
}

static void print_drift(const struct bb_plan *p, FILE *out)
{
	for (size_t i = 0; i < p->n_drifts && i < BB_PLAN_DRIFTS_MAX; i++)
		fprintf(out, "%-12s %s runs at %.3f Hz, %s at %.3f: a whole frame in %.1f s. Same mode, or genlock\n",
		        i ? "" : "DRIFT", p->drift[i].a, p->drift[i].a_hz, p->drift[i].b, p->drift[i].b_hz,
		        p->drift[i].frame_s);
	if (p->n_drifts > BB_PLAN_DRIFTS_MAX)
		fprintf(out, "%-12s ... and %zu more pairs\n", "", p->n_drifts - BB_PLAN_DRIFTS_MAX);
}

static void print_known(const char *protocol, FILE *out)
{
	const struct bb_ir_protocol *p;

	fprintf(out, "tokens       none known for '%s': whether exposures meet them is not judged; known:", protocol);
	for (size_t i = 0; (p = bb_ir_protocol_nth(i)); i++)
		if (bb_ir_known(p))
			fprintf(out, " %s", p->name);
	fputs("\n", out);
}

void bb_phase_print(const struct bb_room *room, const struct bb_plan *p, const struct bb_plan *now, FILE *out)
{
	fprintf(out, "%s: %g edges a second, one in %.1f us; crosstalk at most %g %%\n", room->name,
	        bb_rate_hz(room->chain.rate), p->period_us, p->limit_percent);
	print_verdict(p, out);
	print_timing(p, p->possible ? "planned" : "nearest", out);
	print_timing(now, "as in file", out);
	print_walls(p, out);
	if (!p->possible)
		print_needs(p, out);
	fputs("\n", out);
	if (p->possible)
		print_file(p, out);
	if (p->tokens)
		fprintf(out, "tokens       %s, the lens switches at the %s\n", p->tokens->glasses,
		        p->tokens->acts_us ? "token's begin and a delay" : "token's end");
	else
		print_known(room->chain.emitter_protocol, out);
	print_cameras(p, out);
	print_drift(p, out);
}

/* --- JSON --------------------------------------------------------------------------------------------------------- */

static json_t *number(double v)
{
	return isfinite(v) ? json_real(v) : json_null();
}

static json_t *timing_json(const struct bb_plan *p)
{
	return json_pack("{s:b, s:f, s:f, s:f, s:f, s:f, s:f}", "possible", p->possible, "light_percent",
	                 p->worst.light_percent, "crosstalk_percent", p->worst.crosstalk_percent, "glasses_at_us",
	                 p->timing.glasses_at_us, "glasses_open_us", p->timing.glasses_open_us, "shutter_at_us",
	                 p->timing.shutter_at_us, "shutter_open_us", p->timing.shutter_open_us);
}

static json_t *walls_json(const struct bb_plan *p)
{
	json_t *walls = json_array();

	for (size_t i = 0; i < p->n_walls; i++) {
		json_t *bands = json_array();

		for (size_t b = 0; b < BB_PLAN_BANDS; b++) {
			const struct bb_plan_band *band = &p->wall[i].band[b];

			json_array_append_new(bands, json_pack("{s:s, s:f, s:f, s:I, s:I, s:f, s:f, s:f, s:f}", "rows",
			                                       bb_phase_band[b], "top", band->top, "bottom", band->bottom,
			                                       "window_from_ns", (json_int_t)band->window_from_ns,
			                                       "window_to_ns", (json_int_t)band->window_to_ns,
			                                       "light_percent", band->light.light_percent,
			                                       "crosstalk_percent", band->light.crosstalk_percent,
			                                       "margin_before_us", band->margin_before_us,
			                                       "margin_after_us", band->margin_after_us));
		}
		json_array_append_new(walls, json_pack("{s:s, s:o}", "id", p->wall[i].id, "bands", bands));
	}
	return walls;
}

static json_t *needs_json(const struct bb_plan *p)
{
	json_t *o = json_object();

	for (size_t i = 0; i < BB_PLAN_PARTS; i++)
		json_object_set_new(o, parts[i].key,
		                    json_pack("{s:f, s:o, s:f}", "now", p->need[i].now, "needed", number(p->need[i].needed),
		                              "ideal_crosstalk_percent", p->need[i].ideal_percent));
	return o;
}

static json_t *cameras_json(const struct bb_plan *p)
{
	json_t *list = json_array();

	for (size_t i = 0; i < p->n_cameras; i++) {
		const struct bb_plan_camera *c = &p->camera[i];
		json_t *o = json_pack("{s:s, s:I, s:b, s:f, s:f, s:I, s:f}", "first", c->first, "n", (json_int_t)c->n, "locked",
		                      c->locked, "rate_hz", c->rate_hz, "exposure_us", c->exposure_us, "phases",
		                      (json_int_t)c->phases, "most_percent", c->most_percent);

		if (c->locked)
			json_object_update_new(o, json_pack("{s:i, s:i, s:f, s:f}", "multiplier", (int)c->multiplier, "divider",
			                                    (int)c->divider, "offset_us", c->offset_us, "margin_us",
			                                    c->margin_us));
		else
			json_object_update_new(o, json_pack("{s:f, s:f}", "phases_hit_percent", c->phases_hit_percent,
			                                    "mean_percent", c->mean_percent));
		json_array_append_new(list, o);
	}
	return list;
}

static json_t *drifts_json(const struct bb_plan *p)
{
	json_t *list = json_array();

	for (size_t i = 0; i < p->n_drifts && i < BB_PLAN_DRIFTS_MAX; i++)
		json_array_append_new(list, json_pack("{s:s, s:s, s:f, s:f, s:f}", "a", p->drift[i].a, "b", p->drift[i].b,
		                                      "a_hz", p->drift[i].a_hz, "b_hz", p->drift[i].b_hz, "frame_s",
		                                      p->drift[i].frame_s));
	return list;
}

json_t *bb_phase_json(const struct bb_room *room, const struct bb_plan *p, const struct bb_plan *now)
{
	json_t *o = json_pack("{s:s, s:f, s:f, s:o, s:o, s:o, s:o, s:o}", "room", room->name, "period_us", p->period_us,
	                      "limit_percent", p->limit_percent, "planned", timing_json(p), "as_in_file", timing_json(now),
	                      "walls", walls_json(p), "cameras", cameras_json(p), "drift", drifts_json(p));

	if (o) {
		json_object_set_new(o, "tokens", p->tokens ? json_string(p->tokens->name) : json_null());
		json_object_set_new(o, "tokens_and_strobes_apart", p->tokens ? json_boolean(bb_phase_clear(p)) : json_null());
	}
	if (o && !p->possible) {
		json_object_set_new(o, "stops", json_string(parts[p->stops].key));
		json_object_set_new(o, "needs", needs_json(p));
	}
	return o;
}

/* --- trade -------------------------------------------------------------------------------------------------------- */

enum bb_status bb_phase_trade(const struct bb_room *room, struct bb_phase_trade *out, struct bb_error *err)
{
	const size_t most = BB_ARRAY_LEN(out->point);
	static struct bb_plan plan; /* large; one thread */
	enum bb_status status = bb_plan_room(room, 1e-3, &plan, err);
	double least, high;

	*out = (struct bb_phase_trade){ .n = 0 };
	if (status)
		return status;
	out->least_percent = least = plan.worst.crosstalk_percent;
	status = bb_plan_room(room, 100, &plan, err);
	high = fmax(plan.worst.crosstalk_percent, least * 1.01);
	for (size_t i = 0; i < most && !status; i++) {
		const double limit = least * 1.0005 * pow(high / least, (double)i / (double)(most - 1));

		status = bb_plan_room(room, limit, &plan, err);
		if (!status && plan.possible)
			out->point[out->n++] = (struct bb_phase_trade_point){ limit, plan.worst, plan.timing };
	}
	return status;
}

void bb_phase_trade_print(const struct bb_phase_trade *t, FILE *out)
{
	fprintf(out, "below %.4g %% of crosstalk nothing goes\n%12s %12s %12s %16s %16s\n", t->least_percent, "limit %",
	        "crosstalk %", "light %", "lens opens, us", "for, us");
	for (size_t i = 0; i < t->n; i++)
		fprintf(out, "%12.4g %12.4g %12.4g %16.1f %16.1f\n", t->point[i].limit_percent,
		        t->point[i].light.crosstalk_percent, t->point[i].light.light_percent, t->point[i].timing.glasses_at_us,
		        t->point[i].timing.glasses_open_us);
}

json_t *bb_phase_trade_json(const struct bb_phase_trade *t)
{
	json_t *points = json_array();

	for (size_t i = 0; i < t->n; i++)
		json_array_append_new(points,
		                      json_pack("{s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "limit_percent",
		                                t->point[i].limit_percent, "crosstalk_percent",
		                                t->point[i].light.crosstalk_percent, "light_percent",
		                                t->point[i].light.light_percent, "glasses_at_us",
		                                t->point[i].timing.glasses_at_us, "glasses_open_us",
		                                t->point[i].timing.glasses_open_us, "shutter_at_us",
		                                t->point[i].timing.shutter_at_us, "shutter_open_us",
		                                t->point[i].timing.shutter_open_us));
	return json_pack("{s:f, s:o}", "least_percent", t->least_percent, "points", points);
}
