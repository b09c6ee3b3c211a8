/* bench/cmd/volume_info.c: `blackburst volume info|verify`: what a brick file holds, and whether all of it is whole. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "bench/cli.h"
#include "hal/clock.h"
#include "render/bricks/metric.h"

#define DAMAGED_SHOWN 20

static const struct bb_cli_option options[] = {
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};
static const struct bb_cli_option info_options[] = {
	{ "tf", "FILE", "rate all bricks by this transfer function, and say what that takes" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

/* ---- info ---- */

struct level { /* of a level's bricks in all time nodes, and in single steps alone */
	uint64_t n, packed_bytes, n_steps, flat;
	double error, step_error;
};

static struct level sum_level(const struct bb_bricks *b, uint32_t level)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	struct level out = { 0 };

	for (uint32_t tau = 0; tau < t->n_times; tau++) {
		const struct bb_tree_span s = bb_tree_span(t, tau);
		for (uint32_t n = t->first[level]; n < t->first[level + 1]; n++) {
			const uint64_t id = (uint64_t)tau * t->n_nodes + n;
			const struct bb_bricks_moments *m = &bb_bricks_moments(b)[id];
			const bool step = s.to - s.from == 1;
			out.n++;
			out.packed_bytes += bb_bricks_index(b)[id].bytes;
			out.flat += m->least >= m->most;
			out.error += (double)m->leaf_error;
			out.n_steps += step;
			out.step_error += step ? (double)m->leaf_error : 0;
		}
	}
	return out;
}

static json_t *level_json(const struct bb_bricks *b, uint32_t l)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	const struct level s = sum_level(b, l);

	return json_pack("{s:i, s:[iii], s:[iii], s:I, s:I, s:I, s:f, s:f}", "level", (int)l, "voxels",
			 (int)t->voxels[l][0], (int)t->voxels[l][1], (int)t->voxels[l][2], "grid", (int)t->grid[l][0],
			 (int)t->grid[l][1], (int)t->grid[l][2], "bricks", (json_int_t)s.n, "bytes",
			 (json_int_t)s.packed_bytes, "flat", (json_int_t)s.flat, "mean_error", s.error / (double)s.n,
			 "mean_error_of_steps", s.step_error / (double)s.n_steps);
}

/* What an edit of a transfer function costs, from its points to an order of all bricks; and what it leaves to be drawn.
 */
struct rating {
	double table_ms, rate_ms, order_ms, bound_ms; /* bound: reading the statistics once */
	uint64_t hidden, flat; /* of the leaves of single steps: not to be seen at all; of one colour */
};

static double ms_since(const struct bb_clock *clk, int64_t *from_ns)
{
	const int64_t now_ns = bb_clock_now_ns(clk);
	const double ms = (double)(now_ns - *from_ns) * 1e-6;

	*from_ns = now_ns;
	return ms;
}

static void count_leaves(const struct bb_bricks *b, const struct bb_metric_colours *c, const float *space,
			 struct rating *out)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	const double per = h->most > h->least ? 1 / (h->most - h->least) : 0;

	for (uint32_t step = 0; step < t->n_steps; step++)
		for (uint32_t n = t->first[t->n_levels - 1]; n < t->n_nodes; n++) {
			const uint64_t id = (uint64_t)bb_tree_leaf_time(t, step) * t->n_nodes + n;
			const struct bb_bricks_moments *m = &bb_bricks_moments(b)[id];
			const bool seen = bb_metric_visible(c, ((double)m->least - h->least) * per,
							    ((double)m->most - h->least) * per);
			out->hidden += !seen;
			out->flat += seen && !(space[id] > 0);
		}
}

static enum bb_status rate(const struct bb_bricks *b, const char *path, struct rating *out, struct bb_error *err)
{
	static struct bb_metric_colours colours;
	static struct bb_metric_table table;
	const uint32_t n = (uint32_t)bb_bricks_header(b)->tree.n_bricks;
	float *space = calloc(n, sizeof(*space)), *time = calloc(n, sizeof(*time));
	uint32_t *order = calloc(n, sizeof(*order));
	uint64_t *scratch = calloc(n, sizeof(*scratch));
	struct bb_transfer tf;
	struct bb_clock *clk = NULL;
	enum bb_status status =
		space && time && order && scratch ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ratings");

	if (!status)
		status = bb_transfer_load(path, &tf, err);
	if (!status)
		status = bb_clock_posix_create(&clk);
	if (!status) {
		volatile float sum = 0;
		int64_t from_ns = bb_clock_now_ns(clk);
		bb_metric_colours(&tf, &colours);
		bb_metric_table(&colours, &table);
		out->table_ms = ms_since(clk, &from_ns);
		bb_metric_rate(b, &table, space, time);
		out->rate_ms = ms_since(clk, &from_ns);
		bb_metric_order(space, n, scratch, order);
		out->order_ms = ms_since(clk, &from_ns);
		for (uint32_t i = 0; i < n; i++)
			sum += bb_bricks_moments(b)[i].mean;
		(void)sum;
		out->bound_ms = ms_since(clk, &from_ns);
		count_leaves(b, &colours, space, out);
	}
	bb_clock_destroy(clk);
	free(space);
	free(time);
	free(order);
	free(scratch);
	return status;
}

static int info_json(const struct bb_bricks *b, const struct rating *rated)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	json_t *root = json_pack("{s:s, s:[iii], s:i, s:i, s:i, s:s, s:s, s:s, s:f, s:f, s:I, s:I}", "name", h->name,
				 "voxels", (int)h->tree.dim[0], (int)h->tree.dim[1], (int)h->tree.dim[2], "steps",
				 (int)h->tree.n_steps, "brick", (int)h->tree.edge, "pad", (int)h->pad, "type",
				 bb_brick_type_text(h->type), "codec", bb_brick_codec_text(h->codec), "grid",
				 h->grid ? "spherical" : "cartesian", "least", h->least, "most", h->most, "nonfinite",
				 (json_int_t)h->n_nonfinite, "bricks", (json_int_t)h->tree.n_bricks);
	json_t *levels = json_array();

	for (uint32_t l = 0; l < h->tree.n_levels; l++)
		json_array_append_new(levels, level_json(b, l));
	json_object_set_new(root, "levels", levels);
	if (h->grid == BB_BRICK_SPHERICAL) {
		const double *e = h->extent;
		json_object_set_new(root, "extent",
				    json_pack("{s:[ff], s:[ff], s:[ff], s:b}", "r", e[0], e[1], "theta_rad", e[2], e[3],
					      "phi_rad", e[4], e[5], "wraps", bb_bricks_wraps(h)));
	}
	if (rated)
		json_object_set_new(root, "edit",
				    json_pack("{s:f, s:f, s:f, s:f, s:I, s:I}", "table_ms", rated->table_ms, "rate_ms",
					      rated->rate_ms, "order_ms", rated->order_ms, "read_once_ms",
					      rated->bound_ms, "hidden_leaves", (json_int_t)rated->hidden,
					      "flat_leaves", (json_int_t)rated->flat));
	return bb_cli_print_json(root);
}

static int info(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_bricks *b;
	const bool rated = bb_cli_has(cli, "tf");
	struct rating rating = { 0 };
	enum bb_status status = bb_bricks_open(cli->arg[0], &b, &err);

	if (status)
		return bb_cli_fail(status, &err);
	if (rated)
		status = rate(b, bb_cli_get(cli, "tf", ""), &rating, &err);
	if (status || bb_cli_has(cli, "json")) {
		const int code = status ? bb_cli_fail(status, &err) : info_json(b, rated ? &rating : NULL);
		bb_bricks_close(b);
		return code;
	}
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	printf("%s: %u x %u x %u voxels, %u steps, %s grid, values %.6g .. %.6g", h->name, t->dim[0], t->dim[1],
	       t->dim[2], t->n_steps, h->grid ? "spherical" : "Cartesian", h->least, h->most);
	if (h->n_nonfinite)
		printf(" (%llu not finite)", (unsigned long long)h->n_nonfinite);
	if (h->grid == BB_BRICK_SPHERICAL)
		printf("\nr %.6g .. %.6g, theta %.6g .. %.6g, phi %.6g .. %.6g radians%s", h->extent[0], h->extent[1],
		       h->extent[2], h->extent[3], h->extent[4], h->extent[5],
		       bb_bricks_wraps(h) ? ", all the way round" : "");
	printf("\nbricks of %u^3 and %u around them, %s, codec %s; %llu in %u levels and %u time nodes\n\n", t->edge,
	       h->pad, bb_brick_type_text(h->type), bb_brick_codec_text(h->codec), (unsigned long long)t->n_bricks,
	       t->n_levels, t->n_times);
	printf("%5s %18s %14s %9s %10s %7s %16s %16s\n", "level", "voxels", "grid", "bricks", "MiB", "flat",
	       "error of steps", "error, all nodes");
	for (uint32_t l = 0; l < t->n_levels; l++) {
		const struct level s = sum_level(b, l);
		char voxels[40], grid[40];
		snprintf(voxels, sizeof(voxels), "%ux%ux%u", t->voxels[l][0], t->voxels[l][1], t->voxels[l][2]);
		snprintf(grid, sizeof(grid), "%ux%ux%u", t->grid[l][0], t->grid[l][1], t->grid[l][2]);
		printf("%5u %18s %14s %9llu %10.2f %6.1f%% %16.6g %16.6g\n", l, voxels, grid, (unsigned long long)s.n,
		       (double)s.packed_bytes / 1048576, 100 * (double)s.flat / (double)s.n,
		       s.step_error / (double)s.n_steps, s.error / (double)s.n);
	}
	if (rated) {
		const double leaves = (double)(t->n_nodes - t->first[t->n_levels - 1]) * t->n_steps;
		printf("\nan edit of the transfer function: %.1f ms (table %.1f, %llu bricks rated %.1f, ordered "
		       "%.1f); reading the "
		       "statistics once: %.1f\nof the leaves %.1f %% cannot be seen, %.1f %% are of one colour\n",
		       rating.table_ms + rating.rate_ms + rating.order_ms, rating.table_ms,
		       (unsigned long long)t->n_bricks, rating.rate_ms, rating.order_ms, rating.bound_ms,
		       100 * (double)rating.hidden / leaves, 100 * (double)rating.flat / leaves);
	}
	bb_bricks_close(b);
	return BB_EXIT_OK;
}

/* ---- verify ---- */

static int verify(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_bricks *b;
	enum bb_status status = bb_bricks_open(cli->arg[0], &b, &err);
	uint16_t histograms[BB_HIST_KINDS][BB_STATS_BINS];
	const bool shown = isatty(STDERR_FILENO);
	uint64_t damaged = 0;
	json_t *list = json_array();

	if (status) {
		json_decref(list);
		return bb_cli_fail(status, &err);
	}
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	uint8_t *brick = malloc(bb_bricks_brick_bytes(bb_bricks_header(b)));
	if (!brick) {
		bb_bricks_close(b);
		json_decref(list);
		return bb_cli_fail(bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "a brick"), &err);
	}
	for (uint64_t id = 0; id < n; id++) {
		err = (struct bb_error){ 0 };
		status = bb_bricks_read(b, id, brick, &err);
		if (!status)
			status = bb_bricks_histograms(b, id, histograms, &err);
		if (status) {
			if (damaged++ < DAMAGED_SHOWN)
				fprintf(stderr, "%s\n", err.text);
			json_array_append_new(list, json_integer((json_int_t)id));
		}
		if (shown && id % 4096 == 0)
			fprintf(stderr, "\r%5.1f %% ", 100 * (double)id / (double)n);
	}
	if (shown)
		fprintf(stderr, "\r%20s\r", "");
	bb_bricks_close(b);
	if (bb_cli_has(cli, "json")) {
		bb_cli_print_json(json_pack("{s:I, s:I, s:o}", "bricks", (json_int_t)n, "damaged", (json_int_t)damaged,
					    "list", list));
	} else {
		json_decref(list);
		printf("%llu bricks, %llu damaged\n", (unsigned long long)n, (unsigned long long)damaged);
	}
	free(brick);
	return damaged ? BB_EXIT_FAILED : BB_EXIT_OK;
}

const struct bb_command bb_cmd_volume_info = {
	"volume info", "what a brick file holds, level by level", "FILE [--tf FILE] [--json]", info_options, 1, 1, info,
};

const struct bb_command bb_cmd_volume_verify = {
	"volume verify", "read every brick of a file and name the damaged ones", "FILE [--json]", options, 1, 1, verify,
};
