#include "bench/trade/clocks.h"

#include <math.h>
#include <string.h>

#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"
#include "bench/stats.h"
#include "hal/clock.h"
#include "sim/world.h"
#include "sync/exchange.h"

#define NODES 6 /* the head is one of them */
#define RUNS 8
#define FLIPS 250
#define FRAME_HZ 120.0
#define DELAY_NS 100000.0
#define P99_NS 200000.0
#define RATE 1e-4 /* clocks lie within so much of the head's */
#define AHEAD_FRAMES 2
#define PAGE_WIDTH 760.0
#define PAGE_HEIGHT 480.0
#define LIMIT_US 20.0 /* of a timed flip over 64 exchanges */

struct follower {    /* a node that follows the head: remote is the head's clock */
	double rate; /* of its own clock against the head's */
	struct sim_rng rng;
	struct bb_clockfit fit;
};

/* Of one node, at one moment. */
struct estimate {
	double error_ns[BB_CLOCKS_WAYS], stated_ns;
};

static const char *way_text(enum bb_clocks_way way)
{
	static const char *const text[BB_CLOCKS_WAYS] = { "mean of the window", "least round trip", "line of greatest margin" };

	return text[way];
}

static double delay_ns(struct sim_rng *rng)
{
	return DELAY_NS - (P99_NS - DELAY_NS) / log(100) * log(1 - sim_rng_uniform(rng));
}

/* The node's clock at a time of the head's. */
static int64_t own_ns(const struct follower *n, double head_ns)
{
	return llrint(head_ns * (1 + n->rate));
}

static int64_t exchange(struct follower *n, double head_ns)
{
	const double arrives_ns = head_ns + delay_ns(&n->rng), back_ns = arrives_ns + delay_ns(&n->rng);
	const struct bb_exchange x = { own_ns(n, head_ns), llrint(arrives_ns), llrint(arrives_ns), own_ns(n, back_ns) };
	const int64_t start_ns = bb_clock_stopwatch_ns();

	bb_clockfit_add(&n->fit, &x);
	return bb_clock_stopwatch_ns() - start_ns;
}

/* The customary ways, over the same exchanges: head less own clock. */
static void simple_offsets(const struct bb_clockfit *f, double *mean_ns, double *least_ns)
{
	int64_t least_trip_ns = INT64_MAX;

	*mean_ns = 0;
	for (unsigned i = 0; i < f->n; i++) {
		const struct bb_exchange *x = &f->held[i];
		const double offset_ns = ((double)(x->t2_ns - x->t1_ns) + (double)(x->t3_ns - x->t4_ns)) / 2;
		const int64_t trip_ns = (x->t4_ns - x->t1_ns) - (x->t3_ns - x->t2_ns);
		*mean_ns += offset_ns / f->n;
		if (trip_ns < least_trip_ns) {
			least_trip_ns = trip_ns;
			*least_ns = offset_ns;
		}
	}
}

/* How late, by the head's clock, the node would flip at that time of it. */
static struct estimate estimate(const struct follower *n, double flip_ns)
{
	struct estimate e;
	double mean_ns, least_ns = 0;
	int64_t unsure_ns;

	simple_offsets(&n->fit, &mean_ns, &least_ns);
	const double flip[BB_CLOCKS_WAYS] = { flip_ns - mean_ns, flip_ns - least_ns,
					      (double)bb_clockfit_local_ns(&n->fit, llrint(flip_ns), &unsure_ns) };
	for (int w = 0; w < BB_CLOCKS_WAYS; w++)
		e.error_ns[w] = flip[w] / (1 + n->rate) - flip_ns;
	e.stated_ns = (double)unsure_ns;
	return e;
}

struct skews {
	double us[BB_CLOCKS_WAYS][RUNS * FLIPS];
	size_t n;
	double stated_us, inside;
	int64_t cost_ns;
	uint64_t n_adds;
};

static void flip(const struct follower *node, double flip_ns, struct skews *s)
{
	double first[BB_CLOCKS_WAYS] = { 0 }, last[BB_CLOCKS_WAYS] = { 0 }; /* the head flips exactly then */

	for (unsigned i = 0; i < NODES - 1; i++) {
		const struct estimate e = estimate(&node[i], flip_ns);
		for (int w = 0; w < BB_CLOCKS_WAYS; w++) {
			first[w] = fmin(first[w], e.error_ns[w]);
			last[w] = fmax(last[w], e.error_ns[w]);
		}
		s->stated_us += e.stated_ns * 1e-3;
		s->inside += fabs(e.error_ns[BB_CLOCKS_LINE]) <= e.stated_ns;
	}
	for (int w = 0; w < BB_CLOCKS_WAYS; w++)
		s->us[w][s->n] = (last[w] - first[w]) * 1e-3;
	s->n++;
}

static void play(uint64_t seed, unsigned run, unsigned window, struct skews *s)
{
	static struct follower node[NODES - 1];
	const double frame_ns = 1e9 / FRAME_HZ;

	for (unsigned i = 0; i < NODES - 1; i++) {
		char id[32];
		snprintf(id, sizeof(id), "%u/%u", run, i);
		sim_rng_seed(&node[i].rng, seed, "clocks", id);
		node[i].rate = RATE * (2 * sim_rng_uniform(&node[i].rng) - 1);
		bb_clockfit_init(&node[i].fit, window);
	}
	for (unsigned frame = 0; frame < window + FLIPS; frame++) {
		for (unsigned i = 0; i < NODES - 1; i++) {
			s->cost_ns += exchange(&node[i], frame * frame_ns);
			s->n_adds++;
		}
		if (frame >= window)
			flip(node, (frame + 1 + AHEAD_FRAMES) * frame_ns, s);
	}
}

void bb_clocks_measure(uint64_t seed, struct bb_clocks *out)
{
	static struct skews s;

	*out = (struct bb_clocks){ .seed = seed,
				   .n_nodes = NODES,
				   .n_runs = RUNS,
				   .n_flips = FLIPS,
				   .delay_us = DELAY_NS * 1e-3,
				   .p99_us = P99_NS * 1e-3,
				   .rate_ppm = RATE * 1e6,
				   .frame_hz = FRAME_HZ };
	for (unsigned k = 0; k < BB_CLOCKS_WINDOWS; k++) {
		struct bb_clocks_point *p = &out->point[k];
		memset(&s, 0, sizeof(s));
		p->window = 4u << k;
		p->fill_s = p->window / FRAME_HZ;
		for (unsigned run = 0; run < RUNS; run++)
			play(seed, run, p->window, &s);
		for (int w = 0; w < BB_CLOCKS_WAYS; w++) {
			bb_stats_sort(s.us[w], s.n);
			p->p50_us[w] = bb_stats_nearest_rank(s.us[w], s.n, 0.50);
			p->p99_us[w] = bb_stats_nearest_rank(s.us[w], s.n, 0.99);
			p->max_us[w] = s.us[w][s.n - 1];
		}
		p->stated_us = s.stated_us / (double)(s.n * (NODES - 1));
		p->inside = s.inside / (double)(s.n * (NODES - 1));
		p->add_ns = (double)s.cost_ns / (double)s.n_adds;
	}
}

/* ---- telling ---- */

void bb_clocks_print(const struct bb_clocks *c, FILE *f)
{
	fprintf(f,
		"%u nodes within %.0f ppm, one way %.0f us + queueing (p99 %.0f us), an exchange a frame at %.0f Hz, "
		"flips agreed "
		"%d frames ahead; %u flips each. Skew, p50 / p99 us:\n\n",
		c->n_nodes, c->rate_ppm, c->delay_us, c->p99_us, c->frame_hz, AHEAD_FRAMES, c->n_runs * c->n_flips);
	fprintf(f, "%9s %7s", "exchanges", "full s");
	for (int w = 0; w < BB_CLOCKS_WAYS; w++)
		fprintf(f, " %24s", way_text((enum bb_clocks_way)w));
	fprintf(f, " %10s %8s %8s\n", "stated us", "inside %", "ns each");
	for (unsigned k = 0; k < BB_CLOCKS_WINDOWS; k++) {
		const struct bb_clocks_point *p = &c->point[k];
		fprintf(f, "%9u %7.2f", p->window, p->fill_s);
		for (int w = 0; w < BB_CLOCKS_WAYS; w++)
			fprintf(f, "%15.2f / %7.2f", p->p50_us[w], p->p99_us[w]);
		fprintf(f, " %10.2f %8.1f %8.0f\n", p->stated_us, p->inside * 100, p->add_ns);
	}
}

json_t *bb_clocks_json(const struct bb_clocks *c)
{
	json_t *points = json_array();

	for (unsigned k = 0; k < BB_CLOCKS_WINDOWS; k++) {
		const struct bb_clocks_point *p = &c->point[k];
		json_t *o = json_pack("{s:i, s:f, s:f, s:f, s:f}", "exchanges", (int)p->window, "fill_s", p->fill_s,
				      "stated_us", p->stated_us, "inside", p->inside, "add_ns", p->add_ns);
		for (int w = 0; w < BB_CLOCKS_WAYS; w++)
			json_object_set_new(o, way_text((enum bb_clocks_way)w),
					    json_pack("{s:f, s:f, s:f}", "p50_us", p->p50_us[w], "p99_us", p->p99_us[w],
						      "max_us", p->max_us[w]));
		json_array_append_new(points, o);
	}
	return json_pack("{s:s, s:I, s:i, s:i, s:f, s:f, s:f, s:f, s:o}", "kind", "blackburst-trade-clocks", "seed",
			 (json_int_t)c->seed, "nodes", (int)c->n_nodes, "flips", (int)(c->n_runs * c->n_flips),
			 "delay_us", c->delay_us, "p99_us", c->p99_us, "rate_ppm", c->rate_ppm, "frame_hz", c->frame_hz,
			 "points", points);
}

static const struct pen_colour colours[BB_CLOCKS_WAYS] = { { 0.84, 0.37, 0.00, 1 },
							   { 0.90, 0.62, 0.00, 1 },
							   { 0.00, 0.45, 0.70, 1 } };

static void paint(cairo_t *cr, void *ctx)
{
	const struct bb_clocks *c = ctx;
	struct chart_series series[2 * BB_CLOCKS_WAYS + 1];
	double x[BB_CLOCKS_WINDOWS], y[2 * BB_CLOCKS_WAYS][BB_CLOCKS_WINDOWS], limit[BB_CLOCKS_WINDOWS];

	pen_rect(cr, 0, 0, PAGE_WIDTH, PAGE_HEIGHT, pen_paper, pen_paper);
	for (unsigned k = 0; k < BB_CLOCKS_WINDOWS; k++) {
		x[k] = c->point[k].window;
		limit[k] = LIMIT_US;
		for (int w = 0; w < BB_CLOCKS_WAYS; w++) {
			y[w][k] = c->point[k].p99_us[w];
			y[w + BB_CLOCKS_WAYS][k] = c->point[k].p50_us[w];
		}
	}
	for (int i = 0; i < 2 * BB_CLOCKS_WAYS; i++) {
		const int w = i % BB_CLOCKS_WAYS;
		series[i] =
			(struct chart_series){ .name = i < BB_CLOCKS_WAYS ? way_text((enum bb_clocks_way)w)
									  : NULL,
					       .colour = colours[w],
					       .x = x,
					       .y = y[i],
					       .n = BB_CLOCKS_WINDOWS,
					       .width = 1.3,
					       .dashed = i >= BB_CLOCKS_WAYS,
					       .mark = CHART_DOT };
	}
	series[2 * BB_CLOCKS_WAYS] = (struct chart_series){ .name = "limit of a timed flip",
							    .colour = pen_grey,
							    .x = x,
							    .y = limit,
							    .n = BB_CLOCKS_WINDOWS,
							    .width = 1 };
	const struct chart chart = { .title = "Skew of a timed flip: p99, and p50 dashed",
				     .x_title = "exchanges per estimate",
				     .y_title = "skew, us",
				     .x_scale = CHART_OCTAVES,
				     .y_scale = CHART_DECADES,
				     .series = series,
				     .n_series = BB_ARRAY_LEN(series) };
	chart_draw(cr, &chart, 30, 40, 700, 420);
	chart_legend(cr, series, BB_ARRAY_LEN(series), 60, 24);
}

enum bb_status bb_clocks_plot(const struct bb_clocks *c, const char *path, struct bb_error *err)
{
	struct bb_clocks copy = *c;
	const struct bb_page page = {
		.width = PAGE_WIDTH, .height = PAGE_HEIGHT, .prefix = "clocks", .paint = paint, .ctx = &copy
	};

	return bb_page_write(&page, path, err);
}
