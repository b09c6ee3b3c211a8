/*
 * bench/cmd/trade_scene.c: `blackburst trade SCENE`: plays a scene, a brick file or generated data under a grid of settings,
 * says what each gives and takes, and answers which is best within a budget.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/cmd/trade.h"
#include "bench/file.h"
#include "bench/stats.h"
#include "bench/trade/grid.h"
#include "bench/trade/tell.h"

struct job {
	const struct bb_cli *cli;
	struct bb_scene *scene;
	struct bb_transfer *transfer;
	struct bb_trade_config config;
	struct bb_trade *trade;
	struct bb_trade_grid grid;
	struct bb_trade_item *item; /* [n] */
	struct bb_trade_point *point;
	size_t n;
	bool shown; /* progress */
	double frame_ms, psnr_db, ssim;
};

/* ---- what to play ---- */

static bool ends_in(const char *text, const char *tail)
{
	const size_t n = strlen(text), m = strlen(tail);

	return n > m && !strcmp(text + n - m, tail);
}

/* A volume of 1.2 m in front of the wall, for data that comes without a scene. */
static enum bb_status plain_scene(struct job *j, const char *file, struct bb_error *err)
{
	struct bb_scene *s = calloc(1, sizeof(*s));

	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a scene");
	snprintf(s->data.file, sizeof(s->data.file), "%s", file);
	s->technique = BB_TECHNIQUE_VOLUME;
	s->data.seconds_per_step = 0.4;
	s->data.loop = BB_LOOP_PING_PONG;
	s->data.width_m = 1.2;
	s->data.centre_m = (struct bb_vec3){ 0, 1.4, -0.8 };
	s->data.step_voxels = 1;
	s->data.brick_voxels = 16;
	s->data.values = BB_BRICK_U16;
	s->data.gain = BB_GAIN_FAR;
	s->data.predict = true;
	const char *slash = strrchr(file, '/');
	bb_text_clean(s->name, sizeof(s->name), slash ? slash + 1 : file);
	j->scene = s;
	return BB_OK;
}

static enum bb_status read_generated(struct job *j, const char *kind, struct bb_error *err)
{
	const struct bb_cli *cli = j->cli;
	double seed = 1, steps = 8;
	enum bb_status status = bb_cli_whole(cli, "seed", 1, 0, UINT32_MAX, &seed, err);

	if (!status)
		status = bb_cli_whole(cli, "steps", 8, 1, 65536, &steps, err);
	if (!status && !bb_cli_whole_numbers(bb_cli_get(cli, "dim", "128x128x128"), 'x', j->config.dim, 3))
		status = bb_fail(err, BB_ERR_USAGE, 1481, NULL, "--dim: '%.40s'", bb_cli_get(cli, "dim", ""));
	j->config.generate = kind;
	j->config.n_steps = (uint32_t)steps;
	j->config.seed = (uint32_t)seed;
	return status ? status : plain_scene(j, kind, err);
}

static enum bb_status read_scene(struct job *j, struct bb_error *err)
{
	const char *kind = bb_cli_get(j->cli, "generate", NULL), *arg = j->cli->n_args ? j->cli->arg[0] : "";

	if (kind)
		return read_generated(j, kind, err);
	if (!ends_in(arg, ".yaml") && !ends_in(arg, ".yml"))
		return plain_scene(j, arg, err);
	enum bb_status status = bb_scene_load(arg, &j->scene, err);
	if (!status && j->scene->technique != BB_TECHNIQUE_VOLUME)
		status = bb_fail(err, BB_ERR_CONFIG, 1484, NULL, "%s", arg);
	return status;
}

static enum bb_status read_files(struct job *j, struct bb_error *err)
{
	const char *kind = j->config.generate;
	char usual[64];

	bb_text_format(usual, sizeof(usual), kind && strcmp(kind, "cme") ? "scenes/%s-filled.tf" : "scenes/cme.tf",
		       kind ? kind : "");
	if (j->scene->transfer_function[0])
		bb_text_format(usual, sizeof(usual), "%s", "");
	const char *file = bb_cli_get(j->cli, "tf", usual[0] ? usual : j->scene->transfer_function);
	j->transfer = calloc(1, sizeof(*j->transfer));
	if (!j->transfer)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a transfer function");
	enum bb_status status = bb_transfer_load(file, j->transfer, err);
	if (!status && j->scene->head_path[0])
		status = bb_path_load(j->scene->head_path, &j->config.head, err);
	j->config.scene = j->scene;
	j->config.transfer = j->transfer;
	j->config.eye = (struct bb_vec3){ 0.25, 1.62, 0.5 };
	j->config.within = (struct bb_vec3){ 0.08, 0.06, 0.24 };
	j->config.inside = bb_cli_has(j->cli, "inside");
	return status;
}

/* "100:500": microseconds a brick, megabytes a second. */
static enum bb_status read_disk(struct job *j, struct bb_error *err)
{
	const char *text = bb_cli_get(j->cli, "disk", NULL);
	uint32_t v[2];

	if (!text)
		return BB_OK;
	if (!bb_cli_whole_numbers(text, ':', v, 2) || !v[1])
		return bb_fail(err, BB_ERR_USAGE, 1481, NULL, "--disk: '%.40s'", text);
	j->config.disk_read_ns = 1e3 * v[0];
	j->config.disk_byte_ns = 1e3 / v[1];
	return BB_OK;
}

static enum bb_status read_numbers(struct job *j, struct bb_error *err)
{
	const struct bb_cli *cli = j->cli;
	double frames = 120, pictures = 3, timed = 3;
	enum bb_status status = bb_trade_size(cli, "320x240", &j->config.width_px, &j->config.height_px, err);

	if (!status)
		status = bb_cli_whole(cli, "frames", 120, 1, 100000, &frames, err);
	if (!status)
		status = bb_cli_whole(cli, "pictures", 3, 1, fmin(frames, BB_TRADE_DRAWN_MOST), &pictures, err);
	if (!status)
		status = bb_cli_whole(cli, "timed", 3, 1, BB_TRADE_TIMED_MOST, &timed, err);
	if (!status)
		status = bb_cli_number(cli, "frame-ms", BB_UNKNOWN, 0, 1e9, &j->frame_ms, err);
	if (!status)
		status = bb_cli_number(cli, "psnr", BB_UNKNOWN, 0, 200, &j->psnr_db, err);
	if (!status)
		status = bb_cli_number(cli, "ssim", BB_UNKNOWN, 0, 1, &j->ssim, err);
	j->config.n_frames = (unsigned)frames;
	j->config.n_drawn = (unsigned)pictures;
	j->config.n_timed = (unsigned)timed;
	j->config.reference_step = 0.5;
	j->config.settled = bb_cli_has(cli, "settled");
	return status ? status : read_disk(j, err);
}

/* ---- the grid ---- */

static double complete_mib(const struct bb_trade *t, const struct bb_trade_setting *own)
{
	const struct bb_tree *tree = &bb_trade_header(t)->tree;
	double bricks = 1, stored = own->brick + 2.0;

	for (int a = 0; a < 3; a++)
		bricks *= ceil((double)tree->dim[a] / own->brick);
	return 2 * bricks * stored * stored * stored * (double)bb_brick_type_bytes(own->type) / 1048576;
}

static enum bb_status make_grid(struct job *j, struct bb_error *err)
{
	struct bb_trade_setting own = bb_trade_own(j->trade);
	const char *grid = bb_cli_get(j->cli, "grid", "one");
	const double all_mib = complete_mib(j->trade, &own);
	enum bb_status status = BB_OK;

	if (strcmp(grid, "one") && strcmp(grid, "full"))
		return bb_fail(err, BB_ERR_USAGE, 1481, NULL, "--grid: '%.40s'", grid);
	if (!(own.memory_mib > 0)) /* nothing would be selected */
		own.memory_mib = all_mib / 4;
	bb_trade_grid_usual(&j->grid, &own, bb_trade_rebuilds(j->trade), all_mib);
	for (enum bb_trade_knob knob = 0; knob < BB_KNOBS && !status; knob++)
		if (bb_cli_has(j->cli, bb_trade_knob_text(knob)))
			status = bb_trade_grid_read(&j->grid, knob, bb_cli_get(j->cli, bb_trade_knob_text(knob), ""), err);
	for (size_t i = 0; i < j->grid.n[BB_KNOB_BRICK] && !status; i++)
		if (!bb_trade_rebuilds(j->trade) && j->grid.brick[i] != own.brick)
			status = bb_fail(err, BB_ERR_USAGE, 1482, NULL, "--brick %u of %s", j->grid.brick[i], j->scene->name);
	for (size_t i = 0; i < j->grid.n[BB_KNOB_TYPE] && !status; i++)
		if (!bb_trade_rebuilds(j->trade) && j->grid.type[i] != own.type)
			status = bb_fail(err, BB_ERR_USAGE, 1482, NULL, "--type %s of %s",
					 bb_brick_type_text(j->grid.type[i]), j->scene->name);
	return status ? status : bb_trade_grid_make(&j->grid, !strcmp(grid, "full"), &j->item, &j->n, err);
}

/* The count and, when the first has been played, what all of them may take. */
static void say(const struct job *j, size_t i, double took_s)
{
	char text[160], setting[128];

	bb_trade_setting_text(&j->item[i].setting, setting, sizeof(setting));
	if (i)
		bb_text_format(text, sizeof(text), "%zu of %zu settings, about %.0f s left: %s", i, j->n,
			       took_s / (double)i * (double)(j->n - i), setting);
	else
		bb_text_format(text, sizeof(text), "%zu settings: %s", j->n, setting);
	if (j->shown)
		bb_trade_say(text);
}

static enum bb_status play_all(struct job *j, struct bb_error *err)
{
	const int64_t from_ns = bb_clock_stopwatch_ns();
	enum bb_status status = BB_OK;

	j->point = calloc(j->n, sizeof(*j->point));
	if (!j->point)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu points", j->n);
	for (size_t i = 0; i < j->n && !status; i++) {
		const double took_s = (double)(bb_clock_stopwatch_ns() - from_ns) * 1e-9;
		say(j, i, took_s);
		if (i == 1 && j->n > 100 && !bb_cli_has(j->cli, "quiet"))
			fprintf(stderr, "%s%zu settings, about %.0f s\n", j->shown ? "\n" : "", j->n, took_s * (double)j->n);
		status = bb_trade_play(j->trade, &j->item[i].setting, &j->point[i], err);
		j->point[i].knob = j->item[i].knob;
	}
	if (j->shown)
		bb_trade_say("");
	if (!status)
		bb_trade_mark(j->point, j->n);
	return status;
}

/* ---- what is told ---- */

static int tell(struct job *j, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_trade_header(j->trade);
	const char *plot = bb_cli_get(j->cli, "plot", NULL), *csv = bb_cli_get(j->cli, "csv", NULL);
	char data[96];

	bb_text_format(data, sizeof(data), "%u x %u x %u voxels%s, %u steps", h->tree.dim[0], h->tree.dim[1], h->tree.dim[2],
		       h->grid == BB_BRICK_SPHERICAL ? " (r, theta, phi)" : "", h->tree.n_steps);
	const struct bb_trade_told t = { .point = j->point, .n = j->n, .name = j->scene->name,
					 .reference = bb_trade_reference(j->trade), .data = data,
					 .width_px = j->config.width_px, .height_px = j->config.height_px,
					 .n_frames = j->config.n_frames, .n_drawn = j->config.n_drawn,
					 .full = !strcmp(bb_cli_get(j->cli, "grid", "one"), "full"),
					 .frame_ms = j->frame_ms, .psnr_db = j->psnr_db, .ssim = j->ssim };
	const struct bb_trade_answers answers = bb_trade_ask(&t);
	enum bb_status status = csv ? bb_trade_csv(&t, csv, err) : BB_OK;
	int code = BB_EXIT_OK;

	if (!status && plot)
		status = bb_trade_plot(&t, plot, err);
	if (status)
		return bb_cli_fail(status, err);
	if (bb_cli_has(j->cli, "json"))
		code = bb_cli_print_json(bb_trade_json(&t));
	else
		bb_trade_print(&t, stdout);
	return code ? code : bb_trade_answered(&answers) ? BB_EXIT_OK : BB_EXIT_FAILED;
}

static void release(struct job *j)
{
	bb_trade_destroy(j->trade);
	bb_renderer_destroy(j->config.renderer);
	bb_path_free(j->config.head);
	bb_scene_free(j->scene);
	free(j->transfer);
	free(j->item);
	free(j->point);
}

int bb_trade_scene_run(const struct bb_cli *cli)
{
	struct job j = { .cli = cli, .shown = isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet") };
	struct bb_error err = { 0 };
	enum bb_status status = read_numbers(&j, &err);

	if (!status)
		status = read_scene(&j, &err);
	if (!status)
		status = read_files(&j, &err);
	if (!status && j.shown)
		bb_trade_say("the pictures everything is compared with");
	if (!status)
		status = bb_trade_begin(cli, &j.config, &j.trade, &err);
	if (!status)
		status = make_grid(&j, &err);
	if (!status)
		status = play_all(&j, &err);
	const int code = status ? bb_cli_fail(status, &err) : tell(&j, &err);
	release(&j);
	return code;
}
