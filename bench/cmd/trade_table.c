/*
 * bench/cmd/trade_table.c: `blackburst trade --table gains`: chapter 5 of Carlsson and Tjernstroem 2016 on generated data,
 * from outside and from inside (bench/trade/gains.h).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/cmd/trade.h"
#include "bench/file.h"
#include "bench/trade/gains.h"

#define BRICK 8 /* as theirs */

struct table {
	const struct bb_cli *cli;
	struct bb_trade_config config;
	struct bb_scene scene;
	struct bb_transfer transfer;
	struct bb_gains gains;
	double scale;
	char now[48]; /* what is being measured */
	bool shown, any;
	json_t *list;
};

static void progress(void *ctx, size_t done, size_t of)
{
	const struct table *t = ctx;
	char text[100];

	bb_text_format(text, sizeof(text), "%s: %zu of %zu pictures", t->now, done, of);
	if (t->shown)
		bb_trade_say(text);
}

/* "gains.svg" -> "gains-enlil-filled-inside.svg" */
static void file_for(const struct table *t, const char *path, char *out, size_t cap)
{
	const char *dot = strrchr(path, '.');
	char name[48];

	snprintf(name, sizeof(name), "%s", t->now);
	for (char *c = name; *c; c++)
		*c = *c == ' ' ? '-' : *c;
	snprintf(out, cap, "%.*s-%s%s", dot ? (int)(dot - path) : (int)strlen(path), path, name, dot ? dot : "");
}

static enum bb_status tell(struct table *t, const struct bb_trade *trade, const struct bb_gains_set *set, bool inside,
			   struct bb_error *err)
{
	const uint32_t *dim = bb_trade_header(trade)->tree.dim;
	const char *plot = bb_cli_get(t->cli, "plot", NULL);
	char path[BB_PATH_MAX_BYTES], title[160];

	bb_text_format(title, sizeof(title), "%s, %u x %u x %u voxels, %u steps, bricks of %d^3, the eye %s", set->name, dim[0],
		       dim[1], dim[2], set->n_steps, BRICK, inside ? "inside" : "outside");
	if (t->shown)
		bb_trade_say("");
	json_t *o = bb_gains_json(&t->gains);
	json_object_set_new(o, "set", json_string(set->name));
	json_object_set_new(o, "eye", json_string(inside ? "inside" : "outside"));
	json_object_set_new(o, "reference", json_string(bb_trade_reference(trade)));
	json_object_set_new(o, "dim", json_pack("[i,i,i]", (int)dim[0], (int)dim[1], (int)dim[2]));
	json_array_append_new(t->list, o);
	if (!bb_cli_has(t->cli, "json")) {
		printf("## %s\n\nCompared with %s.\n", title, bb_trade_reference(trade));
		bb_gains_print(&t->gains, stdout);
		putchar('\n');
		fflush(stdout);
	}
	if (!plot)
		return BB_OK;
	file_for(t, plot, path, sizeof(path));
	return bb_gains_plot(&t->gains, title, path, err);
}

static void prepare(struct table *t, const struct bb_gains_set *set)
{
	t->scene = (struct bb_scene){ .technique = BB_TECHNIQUE_VOLUME };
	t->scene.data.loop = BB_LOOP_HOLD;
	t->scene.data.seconds_per_step = 1.0 / BB_TRADE_RATE_HZ; /* a frame is a step */
	t->scene.data.width_m = 1.2;
	t->scene.data.centre_m = (struct bb_vec3){ 0, 1.2, -0.8 };
	t->scene.data.yaw_deg = 30;
	t->scene.data.step_voxels = 1;
	t->config.scene = &t->scene;
	t->config.transfer = &t->transfer;
	t->config.generate = set->kind;
	for (int a = 0; a < 3; a++)
		t->config.dim[a] = (uint32_t)fmax(16, rint(set->dim[a] * t->scale / 100));
	t->config.n_steps = set->n_steps;
	t->config.seed = 1;
	t->config.eye = (struct bb_vec3){ 0.25, 1.55, 0.6 };
	t->config.within = (struct bb_vec3){ set->within_x, 0.06, 0.24 };
	t->config.n_frames = BB_GAINS_STEP + 1;
	t->config.n_drawn = 1;
	t->config.n_timed = 2;
	t->config.reference_step = 1;
	t->config.reference_brick = BRICK;
}

static enum bb_status measure(struct table *t, const struct bb_gains_set *set, struct bb_error *err)
{
	struct bb_trade *trade = NULL;
	enum bb_status status = bb_transfer_load(bb_cli_get(t->cli, "tf", set->tf), &t->transfer, err);

	prepare(t, set);
	snprintf(t->now, sizeof(t->now), "%s", set->name);
	if (t->shown)
		bb_trade_say(t->now);
	if (!status)
		status = bb_trade_begin(t->cli, &t->config, &trade, err);
	for (int inside = 0; inside < 2 && !status; inside++) {
		snprintf(t->now, sizeof(t->now), "%s %s", set->name, inside ? "inside" : "outside");
		if (inside)
			status = bb_trade_turn(trade, true, err);
		if (!status)
			status = bb_gains_measure(trade, BRICK, BB_BRICK_F32, progress, t, &t->gains, err);
		if (!status)
			status = tell(t, trade, set, inside, err);
	}
	bb_trade_destroy(trade);
	return status;
}

static enum bb_status measure_all(struct table *t, struct bb_error *err)
{
	const char *name = bb_cli_get(t->cli, "set", NULL);
	enum bb_status status = BB_OK;

	for (const struct bb_gains_set *set = bb_gains_sets; set->name && !status; set++) {
		if (name ? strcmp(name, set->name) && strcmp(name, "all") : !set->usual)
			continue;
		t->any = true;
		status = measure(t, set, err);
	}
	if (!status && !t->any)
		return bb_fail(err, BB_ERR_USAGE, 1483, NULL, "--set '%.40s'", name);
	return status;
}

int bb_trade_table_run(const struct bb_cli *cli)
{
	struct table *t = calloc(1, sizeof(*t));
	struct bb_error err = { 0 };
	enum bb_status status = t ? BB_OK : bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "a table");
	int code = BB_EXIT_OK;

	if (!status && strcmp(bb_cli_get(cli, "table", ""), "gains"))
		status = bb_fail(&err, BB_ERR_USAGE, 1483, NULL, "--table '%.40s'", bb_cli_get(cli, "table", ""));
	if (!status)
		status = bb_cli_number(cli, "scale", 50, 5, 400, &t->scale, &err);
	if (!status)
		status = bb_trade_size(cli, "200x150", &t->config.width_px, &t->config.height_px, &err);
	if (status) {
		free(t);
		return bb_cli_fail(status, &err);
	}
	t->cli = cli;
	t->shown = isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet");
	t->list = json_array();
	status = measure_all(t, &err);
	json_t *root = json_pack("{s:s, s:f, s:o}", "kind", "blackburst-trade-gains", "scale", t->scale, "sets", t->list);
	if (status)
		code = bb_cli_fail(status, &err);
	if (!status && bb_cli_has(cli, "json"))
		code = bb_cli_print_json(root);
	else
		json_decref(root);
	bb_renderer_destroy(t->config.renderer);
	free(t);
	return code;
}
