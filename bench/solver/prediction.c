#include "bench/solver/prediction.h"

#include <math.h>
#include <stdlib.h>

#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"
#include "bench/stats.h"
#include "hal/clock.h"

#define STEP_MS 5.0
#define WARM_UP 24     /* solutions before the filter's speed is its own */
#define TIMED 20000
#define PAGE_WIDTH 760.0
#define PAGE_HEIGHT 760.0

struct row { /* of one horizon */
	double *mm[2], *deg[2]; /* with and without */
	bool *in_mm, *in_deg;
	double stated_mm2, stated_deg2;
};

struct work {
	struct row row[BB_PREDICTION_HORIZONS];
	size_t n, cap;
};

static bool take(struct work *w, size_t cap)
{
	bool ok = true;

	w->cap = cap;
	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		struct row *r = &w->row[h];
		for (int k = 0; k < 2; k++) {
			r->mm[k] = calloc(cap, sizeof(double));
			r->deg[k] = calloc(cap, sizeof(double));
			ok = ok && r->mm[k] && r->deg[k];
		}
		r->in_mm = calloc(cap, sizeof(bool));
		r->in_deg = calloc(cap, sizeof(bool));
		ok = ok && r->in_mm && r->in_deg;
	}
	return ok;
}

static void release(struct work *w)
{
	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		for (int k = 0; k < 2; k++) {
			free(w->row[h].mm[k]);
			free(w->row[h].deg[k]);
		}
		free(w->row[h].in_mm);
		free(w->row[h].in_deg);
	}
}

static void judge(struct work *w, const struct bb_studio *s, const struct bb_track_solution *sol)
{
	const struct bb_vec3 still = bb_pose_apply(&sol->body, s->room->bodies[0].eye_centre);

	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		struct row *r = &w->row[h];
		const int64_t at_ns = sol->at_ns + (int64_t)(h * STEP_MS * 1e6);
		const struct bb_pose truth = sim_world_body(s->world, 0, at_ns);
		const struct bb_vec3 eyes = bb_pose_apply(&truth, s->room->bodies[0].eye_centre);
		const struct bb_track_pose p = bb_tracker_pose(s->tracker, 0, at_ns);
		const struct bb_vec3 off = bb_vec3_scale(bb_vec3_sub(p.eyes.p, eyes), 1e3);
		const struct bb_vec3 turn = bb_walk_turn_deg(truth.q, p.eyes.q);
		r->mm[0][w->n] = bb_vec3_norm(off);
		r->deg[0][w->n] = bb_vec3_norm(turn);
		r->mm[1][w->n] = 1e3 * bb_vec3_norm(bb_vec3_sub(still, eyes));
		r->deg[1][w->n] = bb_vec3_norm(bb_walk_turn_deg(truth.q, sol->body.q));
		r->in_mm[w->n] = bb_walk_distance2(p.covariance_mm2, off) < BB_CHI2_3_95;
		r->in_deg[w->n] = bb_walk_distance2(p.covariance_deg2, turn) < BB_CHI2_3_95;
		r->stated_mm2 += p.covariance_mm2[0] + p.covariance_mm2[3] + p.covariance_mm2[5];
		r->stated_deg2 += p.covariance_deg2[0] + p.covariance_deg2[3] + p.covariance_deg2[5];
	}
	w->n++;
}

static double rms(const double *v, size_t n)
{
	double sum = 0;

	for (size_t i = 0; i < n; i++)
		sum += v[i] * v[i];
	return n ? sqrt(sum / (double)n) : 0;
}

static double p99(double *v, size_t n)
{
	bb_stats_sort(v, n);
	return bb_stats_nearest_rank(v, n, 0.99);
}

static void conclude(struct work *w, struct bb_prediction *out)
{
	out->n = w->n;
	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		struct bb_prediction_point *p = &out->point[h];
		struct row *r = &w->row[h];
		p->horizon_ms = h * STEP_MS;
		for (int k = 0; k < 2; k++) {
			p->rms_mm[k] = rms(r->mm[k], w->n);
			p->rms_deg[k] = rms(r->deg[k], w->n);
			p->p99_mm[k] = p99(r->mm[k], w->n);
			p->p99_deg[k] = p99(r->deg[k], w->n);
		}
		p->stated_mm = w->n ? sqrt(r->stated_mm2 / (double)w->n) : 0;
		p->stated_deg = w->n ? sqrt(r->stated_deg2 / (double)w->n) : 0;
		p->inside_mm = bb_walk_share_of(r->in_mm, w->n);
		p->inside_deg = bb_walk_share_of(r->in_deg, w->n);
	}
}

static double cost_ns(const struct bb_studio *s)
{
	const int64_t from_ns = bb_clock_stopwatch_ns();
	double sum = 0;

	for (int i = 0; i < TIMED; i++)
		sum += bb_tracker_pose(s->tracker, 0, s->mid_ns + i * 1000).eyes.p.x;
	const double ns = (double)(bb_clock_stopwatch_ns() - from_ns) / TIMED;
	return isfinite(sum) ? ns : BB_UNKNOWN;
}

enum bb_status bb_prediction_measure(const struct bb_prediction_config *config, struct bb_prediction *out,
				     struct bb_error *err)
{
	const struct bb_studio_config c = { config->room, config->path, 1, config->seed };
	struct work w = { .n = 0 };
	struct bb_studio studio;
	struct bb_track_solution sol;
	bool solved;

	*out = (struct bb_prediction){ .room = config->room, .path = config->path, .seed = config->seed };
	enum bb_status status = bb_studio_open(&c, &studio, err);
	if (status)
		return status;
	if (!take(&w, config->n_frames + 1))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu frames", config->n_frames);
	out->rate_hz = 1e9 / (double)studio.period_ns;
	for (size_t i = 0; !status && i < config->n_frames && bb_studio_step(&studio, &sol, &solved); i++)
		if (solved && i >= WARM_UP)
			judge(&w, &studio, &sol);
	if (!status) {
		out->predict_ns = cost_ns(&studio);
		conclude(&w, out);
	}
	release(&w);
	bb_studio_close(&studio);
	return status;
}

const struct bb_prediction_point *bb_prediction_at(const struct bb_prediction *p, double horizon_ms)
{
	const double i = fmin(fmax(rint(horizon_ms / STEP_MS), 0), BB_PREDICTION_HORIZONS - 1);

	return &p->point[(int)i];
}

void bb_prediction_print(const struct bb_prediction *p, FILE *f)
{
	const struct bb_prediction_point *path = bb_prediction_at(p, BB_PREDICTION_PATH_MS);

	fprintf(f, "%s under the cameras of %s, %zu solutions at %.0f Hz; a prediction costs %.0f ns here\n\n", p->path,
		p->room, p->n, p->rate_hz, p->predict_ns);
	fprintf(f, "         eyes' position, mm: rms (p99)        stated  inside   orientation, deg: rms (p99)\n");
	fprintf(f, "   ms    predicted        as it was           rms mm  95 %%     predicted        as it was        "
		   "stated  inside\n");
	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		const struct bb_prediction_point *q = &p->point[h];
		fprintf(f, "%5.0f  %6.2f (%6.2f)  %6.2f (%7.2f)    %7.2f  %4.1f %%  %6.3f (%6.3f)  %6.3f (%6.3f)  %6.3f  %4.1f %%\n",
			q->horizon_ms, q->rms_mm[0], q->p99_mm[0], q->rms_mm[1], q->p99_mm[1], q->stated_mm,
			100 * q->inside_mm.share, q->rms_deg[0], q->p99_deg[0], q->rms_deg[1], q->p99_deg[1],
			q->stated_deg, 100 * q->inside_deg.share);
	}
	fprintf(f, "\nA path of %.0f ms: prediction divides the position's error by %.1f and the orientation's by %.1f.\n",
		path->horizon_ms, path->rms_mm[1] / path->rms_mm[0], path->rms_deg[1] / path->rms_deg[0]);
}

json_t *bb_prediction_json(const struct bb_prediction *p)
{
	json_t *points = json_array();

	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		const struct bb_prediction_point *q = &p->point[h];
		json_array_append_new(
			points,
			json_pack("{s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "horizon_ms",
				  q->horizon_ms, "rms_mm", q->rms_mm[0], "p99_mm", q->p99_mm[0], "still_rms_mm",
				  q->rms_mm[1], "still_p99_mm", q->p99_mm[1], "rms_deg", q->rms_deg[0], "p99_deg",
				  q->p99_deg[0], "still_rms_deg", q->rms_deg[1], "still_p99_deg", q->p99_deg[1],
				  "stated_mm", q->stated_mm, "stated_deg", q->stated_deg, "inside_mm",
				  q->inside_mm.share, "inside_deg", q->inside_deg.share));
	}
	return json_pack("{s:s, s:s, s:s, s:I, s:I, s:f, s:f, s:o}", "kind", "blackburst-trade-prediction", "room",
			 p->room, "path", p->path, "seed", (json_int_t)p->seed, "solutions", (json_int_t)p->n,
			 "rate_hz", p->rate_hz, "predict_ns", p->predict_ns, "points", points);
}

static const struct pen_colour colours[2] = { { 0.00, 0.45, 0.70, 1 }, { 0.84, 0.37, 0.00, 1 } };

static void paint_one(cairo_t *cr, const struct bb_prediction *p, bool turn, double top)
{
	double x[BB_PREDICTION_HORIZONS], y[5][BB_PREDICTION_HORIZONS];
	struct chart_series series[5];

	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		const struct bb_prediction_point *q = &p->point[h];
		x[h] = q->horizon_ms;
		for (int k = 0; k < 2; k++) {
			y[k][h] = turn ? q->rms_deg[k] : q->rms_mm[k];
			y[2 + k][h] = turn ? q->p99_deg[k] : q->p99_mm[k];
		}
		y[4][h] = turn ? q->stated_deg : q->stated_mm;
	}
	for (int i = 0; i < 5; i++)
		series[i] = (struct chart_series){ .name = i == 0   ? "predicted, rms"
							   : i == 1 ? "last pose, rms"
							   : i == 4 ? "as the tracker states"
								    : NULL,
						   .colour = i < 4 ? colours[i % 2] : pen_grey,
						   .x = x,
						   .y = y[i],
						   .n = BB_PREDICTION_HORIZONS,
						   .width = 1.3,
						   .dashed = i == 2 || i == 3,
						   .mark = i < 2 ? CHART_DOT : CHART_NONE };
	const struct chart chart = { .title = turn ? "Orientation at photon: rms, and p99 dashed"
						   : "Eyes' position at photon: rms, and p99 dashed",
				     .x_title = "mid-exposure to photon, ms",
				     .y_title = turn ? "error, deg" : "error, mm",
				     .y_scale = CHART_DECADES,
				     .series = series,
				     .n_series = 5 };
	chart_draw(cr, &chart, 30, top + 40, 700, 320);
	chart_legend(cr, series, 5, 60, top + 24);
}

static void paint(cairo_t *cr, void *ctx)
{
	pen_rect(cr, 0, 0, PAGE_WIDTH, PAGE_HEIGHT, pen_paper, pen_paper);
	paint_one(cr, ctx, false, 0);
	paint_one(cr, ctx, true, PAGE_HEIGHT / 2);
}

enum bb_status bb_prediction_plot(const struct bb_prediction *p, const char *path, struct bb_error *err)
{
	struct bb_prediction copy = *p;
	const struct bb_page page = {
		.width = PAGE_WIDTH, .height = PAGE_HEIGHT, .prefix = "prediction", .paint = paint, .ctx = &copy
	};

	return bb_page_write(&page, path, err);
}
