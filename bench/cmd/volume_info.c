/* bench/cmd/volume_info.c: `blackburst volume info|verify`: what a brick file holds, and whether all of it is whole. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "bench/cli.h"
#include "render/bricks/bricks.h"

#define DAMAGED_SHOWN 20

static const struct bb_cli_option options[] = {
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

static int print_json(json_t *root)
{
	char *text = json_dumps(root, JSON_INDENT(2));

	json_decref(root);
	if (!text)
		return BB_EXIT_INTERNAL;
	puts(text);
	free(text);
	return BB_EXIT_OK;
}

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

static int info_json(const struct bb_bricks *b)
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
	return print_json(root);
}

static int info(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_bricks *b;
	const enum bb_status status = bb_bricks_open(cli->arg[0], &b, &err);

	if (status)
		return bb_cli_fail(status, &err);
	if (bb_cli_has(cli, "json")) {
		const int code = info_json(b);
		bb_bricks_close(b);
		return code;
	}
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	printf("%s: %u x %u x %u voxels, %u steps, %s grid, values %.6g .. %.6g", h->name, t->dim[0], t->dim[1],
	       t->dim[2], t->n_steps, h->grid ? "spherical" : "Cartesian", h->least, h->most);
	if (h->n_nonfinite)
		printf(" (%llu not finite)", (unsigned long long)h->n_nonfinite);
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
	for (uint64_t id = 0; id < n && brick; id++) {
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
		print_json(json_pack("{s:I, s:I, s:o}", "bricks", (json_int_t)n, "damaged", (json_int_t)damaged, "list",
				     list));
	} else {
		json_decref(list);
		printf("%llu bricks, %llu damaged\n", (unsigned long long)n, (unsigned long long)damaged);
	}
	const bool whole = brick && !damaged;
	free(brick);
	return whole ? BB_EXIT_OK : BB_EXIT_FAILED;
}

const struct bb_command bb_cmd_volume_info = {
	"volume info", "what a brick file holds, level by level", "FILE [--json]", options, 1, 1, info,
};

const struct bb_command bb_cmd_volume_verify = {
	"volume verify", "read every brick of a file and name the damaged ones", "FILE [--json]", options, 1, 1, verify,
};
