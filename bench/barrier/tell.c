/* bench/barrier/tell.c: the simulated bake-off as text, JSON and a chart. */
#include "bench/barrier/table.h"
#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"

#include <math.h>
#include <string.h>

#define PAGE_WIDTH 1240
#define PAGE_HEIGHT 720

static double period_us(const struct bb_barrier_table *t)
{
	return (double)bb_rate_period_ns(t->usual.rate) * 1e-3;
}

/* ---- text ---- */

static void print_row(const struct bb_barrier_table *t, const struct bb_barrier_row *row, FILE *out)
{
	const struct bb_troupe_result *r = &row->result;

	if (!r->frames) {
		fprintf(out, "%9u  %-13s no frame came together\n", row->n_nodes, bb_lock_method_text(row->method));
		return;
	}
	fprintf(out, "%9u  %-13s %9.1f %9.1f %9.1f %9.1f %9.1f %9.1f %9.1f %8.4f %9.1f %9.1f\n", row->n_nodes,
	        bb_lock_method_text(row->method), r->skew.p50, r->skew.p99, r->skew.max, row->skew_model_us, r->cost.p50,
	        r->cost.p99, row->cost_model_us, r->cost.p50 / period_us(t), r->messages, row->messages_model);
}

static void print_sizes(const struct bb_barrier_table *t, FILE *out)
{
	fprintf(out, "endpoints  method         skew p50       p99       max     model  cost p50       p99     model   frames  "
	             "messages     least\n");
	for (size_t i = 0; i < t->n_sizes; i++)
		for (int m = 0; m < BB_LOCK_METHODS; m++)
			print_row(t, bb_barrier_row(t, i, (enum bb_lock_method)m), out);
}

static void print_loss(const struct bb_barrier_table *t, const struct bb_barrier_row *row, FILE *out)
{
	const struct bb_troupe_result *r = &row->result;

	fprintf(out, "%9u %7.3g  %-13s ", row->n_nodes, row->loss * 100, bb_lock_method_text(row->method));
	if (!r->frames) {
		fprintf(out, "no frame came together\n");
		return;
	}
	fprintf(out, "%9.1f %9.1f %9.1f %9.1f %9.1f %13.4f %8.2f %9.1f %9.2f %7llu", r->skew.p50, r->skew.p99, r->skew.max,
	        r->cost.p50, r->cost.p99, r->frames_lost, r->torn * 100, r->messages, r->resent, (unsigned long long)r->epochs);
	if (r->frames < t->usual.frames)
		fprintf(out, "  %llu frames", (unsigned long long)r->frames);
	fprintf(out, "%s\n", row->ended ? "" : "  stood still");
}

static void print_losses(const struct bb_barrier_table *t, FILE *out)
{
	fprintf(out, "\nendpoints  lost %%  method         skew p50       p99       max  cost p50       p99  late vblanks   "
	             "torn %%  messages    resent  epochs\n");
	for (size_t i = 0; i < BB_BARRIER_LOSS_SIZES && t->loss_sizes[i]; i++)
		for (size_t k = 0; k < t->n_losses; k++)
			for (int m = 0; m < BB_LOCK_METHODS; m++)
				print_loss(t, bb_barrier_loss_row(t, i, k, (enum bb_lock_method)m), out);
}

static const struct pair {
	enum bb_lock_method better, than;
	const char *why;
} pairs[] = {
	{ BB_LOCK_TREE, BB_LOCK_CENTRAL, "the root's sends in a row take longer than the tree's hops one after another" },
	{ BB_LOCK_DISSEMINATION, BB_LOCK_CENTRAL, "the root's sends in a row take longer than the rounds" },
	{ BB_LOCK_DISSEMINATION, BB_LOCK_TREE, "a round is one send and one hop, a level of the tree up to two sends, up and down" },
};

static void print_from(FILE *out, unsigned from)
{
	if (from)
		fprintf(out, " from %u endpoints on", from);
	else
		fprintf(out, " nowhere");
}

static void print_crossovers(const struct bb_barrier_table *t, FILE *out)
{
	fputc('\n', out);
	for (size_t i = 0; i < BB_ARRAY_LEN(pairs); i++)
		for (int cost = 0; cost < 2; cost++) {
			const struct pair *p = &pairs[i];
			fprintf(out, "%s: %s beats %s", cost ? "cost" : "skew", bb_lock_method_text(p->better),
			        bb_lock_method_text(p->than));
			print_from(out, bb_barrier_crossover(t, p->better, p->than, cost));
			fprintf(out, "; the model says");
			print_from(out, bb_barrier_crossover_model(t, p->better, p->than, cost));
			fprintf(out, cost ? "\n" : " (%s)\n", p->why);
		}
}

void bb_barrier_table_print(const struct bb_barrier_table *t, FILE *out)
{
	const struct bb_troupe_config *c = &t->usual;

	fprintf(out,
	        "simulated: %.4g us + exponential of mean %.4g us one way, %.4g us a send, clocks within %.4g ppm known from "
	        "%u exchanges, %.5g Hz, %u frames, seed %llu\n"
	        "skew: last minus first release of a frame, root included; cost: last release minus last node drawn; us\n\n",
	        c->link.delay_us, c->link.jitter_us, c->link.send_us, c->drift_ppm, t->net.window, bb_rate_hz(c->rate), c->frames,
	        (unsigned long long)c->seed);
	print_sizes(t, out);
	print_crossovers(t, out);
	if (t->n_losses)
		print_losses(t, out);
}

/* ---- JSON ---- */

static json_t *spread_json(const struct bb_spread *s)
{
	return json_pack("{s:f,s:f,s:f}", "p50", s->p50, "p99", s->p99, "max", s->max);
}

/* Of no frame nothing is known but that there was none. */
static json_t *row_json(const struct bb_barrier_table *t, const struct bb_barrier_row *row)
{
	const struct bb_troupe_result *r = &row->result;
	json_t *o = json_pack("{s:i,s:s,s:f,s:b,s:I,s:f,s:f,s:f,s:I}", "endpoints", (int)row->n_nodes, "method",
	                      bb_lock_method_text(row->method), "loss_percent", row->loss * 100, "ended", (int)row->ended, "frames",
	                      (json_int_t)r->frames, "skew_model_us", row->skew_model_us, "cost_model_us", row->cost_model_us,
	                      "messages_least", row->messages_model, "epochs", (json_int_t)r->epochs);

	if (r->frames)
		json_object_update_new(o, json_pack("{s:o,s:o,s:f,s:f,s:f,s:f,s:f,s:f}", "skew_us", spread_json(&r->skew),
		                                    "cost_us", spread_json(&r->cost), "cost_frames", r->cost.p50 / period_us(t),
		                                    "late_vblanks", r->frames_lost, "torn_percent", r->torn * 100,
		                                    "late_percent", r->late * 100, "messages", r->messages, "resent", r->resent));
	return o;
}

static json_t *crossovers_json(const struct bb_barrier_table *t)
{
	json_t *list = json_array();

	for (size_t i = 0; i < BB_ARRAY_LEN(pairs); i++)
		for (int cost = 0; cost < 2; cost++)
			json_array_append_new(list, json_pack("{s:s,s:s,s:s,s:i,s:i}", "of", cost ? "cost" : "skew", "better",
			                                      bb_lock_method_text(pairs[i].better), "than",
			                                      bb_lock_method_text(pairs[i].than), "endpoints",
			                                      (int)bb_barrier_crossover(t, pairs[i].better, pairs[i].than, cost),
			                                      "endpoints_model",
			                                      (int)bb_barrier_crossover_model(t, pairs[i].better, pairs[i].than,
			                                                                      cost)));
	return list;
}

json_t *bb_barrier_table_json(const struct bb_barrier_table *t)
{
	const struct bb_troupe_config *c = &t->usual;
	json_t *rows = json_array();

	for (size_t i = 0; i < t->n_rows; i++)
		json_array_append_new(rows, row_json(t, &t->rows[i]));
	return json_pack("{s:f,s:f,s:f,s:f,s:i,s:f,s:i,s:I,s:o,s:o}", "delay_us", c->link.delay_us, "jitter_us", c->link.jitter_us,
	                 "send_us", c->link.send_us, "drift_ppm", c->drift_ppm, "window", (int)t->net.window, "rate_hz",
	                 bb_rate_hz(c->rate), "frames", (int)c->frames, "seed", (json_int_t)c->seed, "rows", rows, "crossovers",
	                 crossovers_json(t));
}

/* ---- chart ---- */

static const struct pen_colour colours[BB_LOCK_METHODS] = {
	{ 0.84, 0.37, 0.00, 1 }, { 0.00, 0.62, 0.45, 1 }, { 0.00, 0.45, 0.70, 1 }, { 0.55, 0.25, 0.60, 1 }
};

enum panel { SKEW, COST };

static double value_of(const struct bb_barrier_row *row, enum panel panel)
{
	return panel == SKEW ? row->result.skew.p50 : row->result.cost.p50;
}

static void by_size(cairo_t *cr, const struct bb_barrier_table *t, enum panel panel, double left, double top)
{
	double x[BB_BARRIER_SIZES_MAX], y[BB_LOCK_METHODS][BB_BARRIER_SIZES_MAX], model[BB_LOCK_METHODS][BB_BARRIER_SIZES_MAX];
	struct chart_series series[2 * BB_LOCK_METHODS] = { 0 };
	struct chart c = { .title = panel == SKEW ? "last minus first flip (dashed: the model)" : "what a flip waits for the network",
		           .x_title = "endpoints", .y_title = panel == SKEW ? "skew p50, us" : "cost p50, us",
		           .x_scale = CHART_OCTAVES, .y_scale = CHART_DECADES, .series = series };

	for (int m = 0; m < (panel == SKEW ? BB_LOCK_METHODS : BB_LOCK_TIMED); m++) {
		for (size_t i = 0; i < t->n_sizes; i++) {
			const struct bb_barrier_row *row = bb_barrier_row(t, i, (enum bb_lock_method)m);
			x[i] = t->sizes[i];
			y[m][i] = value_of(row, panel);
			model[m][i] = panel == SKEW ? row->skew_model_us : row->cost_model_us;
		}
		series[c.n_series++] = (struct chart_series){ .colour = pen_alpha(colours[m], 0.6), .x = x, .y = model[m],
			                                      .n = t->n_sizes, .width = 1, .dashed = true };
		series[c.n_series++] = (struct chart_series){ .colour = colours[m], .x = x, .y = y[m], .n = t->n_sizes, .width = 1.6,
			                                      .mark = CHART_DOT };
	}
	chart_draw(cr, &c, left, top, 606, 310);
}

static void by_loss(cairo_t *cr, const struct bb_barrier_table *t, size_t size, double left, double top)
{
	double x[BB_BARRIER_LOSSES_MAX], y[BB_LOCK_METHODS][BB_BARRIER_LOSSES_MAX];
	struct chart_series series[BB_LOCK_METHODS] = { 0 };
	char title[64];
	struct chart c = { .title = title, .x_title = "messages lost, %", .y_title = "vblanks lost, per 100 frames",
		           .series = series, .n_series = BB_LOCK_METHODS };

	snprintf(title, sizeof(title), "%u endpoints: what loss costs", t->loss_sizes[size]);
	for (int m = 0; m < BB_LOCK_METHODS; m++) {
		for (size_t k = 0; k < t->n_losses; k++) {
			x[k] = t->losses[k] * 100;
			y[m][k] = 100 * bb_barrier_loss_row(t, size, k, (enum bb_lock_method)m)->result.frames_lost;
		}
		series[m] = (struct chart_series){ .colour = colours[m], .x = x, .y = y[m], .n = t->n_losses, .width = 1.6,
			                           .mark = CHART_DOT };
	}
	chart_draw(cr, &c, left, top, 606, 310);
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct bb_barrier_table *t = ctx;
	const struct bb_link_config *l = &t->usual.link;
	struct chart_series legend[BB_LOCK_METHODS] = { 0 };

	pen_set(cr, pen_paper);
	cairo_paint(cr);
	pen_text(cr, (struct pen_point){ 24, 26 }, PEN_LEFT, 16, true, pen_ink,
	         "Flips together: %.4g us + exponential of %.4g us one way, %.3g us a send, clocks within %.4g ppm, %.4g Hz",
	         l->delay_us, l->jitter_us, l->send_us, t->usual.drift_ppm, bb_rate_hz(t->usual.rate));
	for (int m = 0; m < BB_LOCK_METHODS; m++)
		legend[m] = (struct chart_series){ .name = bb_lock_method_text((enum bb_lock_method)m), .colour = colours[m], .n = 1,
			                           .width = 1.6, .mark = CHART_DOT };
	chart_legend(cr, legend, BB_LOCK_METHODS, 24, 52);
	by_size(cr, t, SKEW, 14, 72);
	by_size(cr, t, COST, 626, 72);
	for (size_t i = 0; i < BB_BARRIER_LOSS_SIZES && t->loss_sizes[i] && t->n_losses; i++)
		by_loss(cr, t, i, i ? 626 : 14, 392);
}

enum bb_status bb_barrier_table_plot(const struct bb_barrier_table *t, const char *path, struct bb_error *err)
{
	struct bb_barrier_table copy = *t;
	const struct bb_page page = { PAGE_WIDTH, PAGE_HEIGHT, "barrier-", paint, &copy };

	return bb_page_write(&page, path, err);
}
