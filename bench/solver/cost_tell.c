/* bench/solver/cost_tell.c: the solver's cost as text, JSON and charts. */
#include <math.h>

#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"
#include "bench/solver/cost.h"

#define PAGE_WIDTH 760.0
#define PAGE_HEIGHT 760.0

static void print_head(FILE *f, const char *first)
{
	fprintf(f, "%8s  %9s %9s %9s  %9s %9s   %7s %7s   %s\n", first, "median us", "p99 us", "most us", "cold us",
		"cold most", "solved", "cold", "most pairs, points, poses; floods");
}

static void print_row(FILE *f, size_t first, const struct bb_cost *c)
{
	const struct bb_track_work *w = &c->work, *k = &c->cold_work;

	fprintf(f, "%8zu  %9.0f %9.0f %9.0f  %9.0f %9.0f   %5.1f %% %5.1f %%   %u, %u, %u; %llu\n", first, c->median_us,
		c->p99_us, c->most_us, c->cold_median_us, c->cold_most_us, 100 * c->solved, 100 * c->cold_solved,
		k->pairs > w->pairs ? k->pairs : w->pairs, k->points > w->points ? k->points : w->points,
		k->poses > w->poses ? k->poses : w->poses, (unsigned long long)c->floods);
}

void bb_cost_print(const struct bb_cost_table *t, FILE *f)
{
	const struct bb_cost *u = &t->usual;

	fprintf(f, "%zu cameras like those of %s, %zu bodies, %zu stray blobs a frame, processor time of one core; a period is %.0f us\n\n",
		u->n_cameras, t->room, u->n_bodies, u->n_clutter, u->period_us);
	print_head(f, "cameras");
	print_row(f, u->n_cameras, u);
	if (t->n_by_cameras) {
		fprintf(f, "\nBy cameras:\n");
		print_head(f, "cameras");
	}
	for (size_t i = 0; i < t->n_by_cameras; i++)
		print_row(f, t->by_cameras[i].n_cameras, &t->by_cameras[i]);
	if (t->n_by_clutter) {
		fprintf(f, "\nBy stray blobs in every frame of every camera:\n");
		print_head(f, "blobs");
	}
	for (size_t i = 0; i < t->n_by_clutter; i++)
		print_row(f, t->by_clutter[i].n_clutter, &t->by_clutter[i]);
}

static json_t *work_json(const struct bb_track_work *w)
{
	return json_pack("{s:i, s:i, s:i}", "pairs", (int)w->pairs, "points", (int)w->points, "poses", (int)w->poses);
}

static json_t *one_json(const struct bb_cost *c)
{
	return json_pack("{s:I, s:I, s:I, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:I, s:I, s:o, s:o}", "cameras",
			 (json_int_t)c->n_cameras, "bodies", (json_int_t)c->n_bodies, "clutter",
			 (json_int_t)c->n_clutter, "period_us", c->period_us, "median_us", c->median_us, "p99_us",
			 c->p99_us, "most_us", c->most_us, "cold_median_us", c->cold_median_us, "cold_most_us",
			 c->cold_most_us, "blobs", c->blobs, "solved", c->solved, "cold_solved", c->cold_solved,
			 "floods", (json_int_t)c->floods, "wrong", (json_int_t)c->wrong, "work", work_json(&c->work),
			 "cold_work", work_json(&c->cold_work));
}

static json_t *list_json(const struct bb_cost *c, size_t n)
{
	json_t *list = json_array();

	for (size_t i = 0; i < n; i++)
		json_array_append_new(list, one_json(&c[i]));
	return list;
}

json_t *bb_cost_json(const struct bb_cost_table *t)
{
	return json_pack("{s:s, s:s, s:I, s:o, s:o, s:o}", "kind", "blackburst-bench-track", "room", t->room, "seed",
			 (json_int_t)t->seed, "usual", one_json(&t->usual), "by_cameras",
			 list_json(t->by_cameras, t->n_by_cameras), "by_clutter",
			 list_json(t->by_clutter, t->n_by_clutter));
}

static const struct pen_colour blue = { 0.00, 0.45, 0.70, 1 }, red = { 0.84, 0.37, 0.00, 1 };

static void paint_one(cairo_t *cr, const struct bb_cost *c, size_t n, bool clutter, double top)
{
	double x[BB_COST_POINTS_MAX], y[3][BB_COST_POINTS_MAX], limit[BB_COST_POINTS_MAX];

	for (size_t i = 0; i < n; i++) {
		x[i] = (double)(clutter ? c[i].n_clutter : c[i].n_cameras);
		y[0][i] = c[i].median_us;
		y[1][i] = c[i].p99_us;
		y[2][i] = c[i].cold_median_us;
		limit[i] = c[i].period_us;
	}
	const struct chart_series series[] = {
		{ .name = "warm, median", .colour = blue, .x = x, .y = y[0], .n = n, .width = 1.3, .mark = CHART_DOT },
		{ .name = "warm, p99", .colour = blue, .x = x, .y = y[1], .n = n, .width = 1.3, .dashed = true },
		{ .name = "first set, median", .colour = red, .x = x, .y = y[2], .n = n, .width = 1.3, .mark = CHART_RING },
		{ .name = "a camera's period", .colour = pen_grey, .x = x, .y = limit, .n = n, .width = 1 },
	};
	const struct chart chart = { .title = clutter ? "By stray blobs in every frame" : "By cameras",
				     .x_title = clutter ? "stray blobs a frame" : "cameras",
				     .y_title = "one set, us",
				     .x_scale = clutter ? CHART_DECADES : CHART_OCTAVES,
				     .y_scale = CHART_DECADES,
				     .series = series,
				     .n_series = 4 };
	chart_draw(cr, &chart, 30, top + 40, 700, 320);
	chart_legend(cr, series, 4, 60, top + 24);
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct bb_cost_table *t = ctx;

	pen_rect(cr, 0, 0, PAGE_WIDTH, PAGE_HEIGHT, pen_paper, pen_paper);
	paint_one(cr, t->by_cameras, t->n_by_cameras, false, 0);
	paint_one(cr, t->by_clutter, t->n_by_clutter, true, PAGE_HEIGHT / 2);
}

enum bb_status bb_cost_plot(const struct bb_cost_table *t, const char *path, struct bb_error *err)
{
	struct bb_cost_table copy = *t;
	const struct bb_page page = {
		.width = PAGE_WIDTH, .height = PAGE_HEIGHT, .prefix = "cost", .paint = paint, .ctx = &copy
	};

	return bb_page_write(&page, path, err);
}
