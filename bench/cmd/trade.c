/*
 * bench/cmd/trade.c: `blackburst trade`: what a setting costs and what it gives. ROOM SCENE --device: the fidelities of one
 * device class (trade_device.c). SCENE: budgets, selectors, steps and bricks of a volume (trade_scene.c). --table: the
 * tables of a paper (trade_table.c).
 */
#include "bench/cmd/trade.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/report/drawing_page.h"
#include "bench/trade/trade.h"
#include "render/parallel.h"

static const struct bb_cli_option options[] = {
	{ "device", "CLASS", "of ROOM SCENE: shutters, cameras, displays, monitors, power or gamepads" },
	{ "from", "N", "of --device: fidelities N and N + 1, N is 0 or 1 (0)" },
	{ "duration", "S", "of ROOM SCENE: seconds of the scene to run (as the scene says)" },
	{ "seed", "N", "of ROOM SCENE, --table prediction and tracking (7), of what is generated and --table clocks (1)" },
	{ "grid", "one|full", "one: every knob about the scene's own setting (default); full: all combinations" },
	{ "memory", "MIB,...", "memory budgets; all: none (default: about the scene's own)" },
	{ "stream", "N,...", "streaming budgets, bricks a frame; all: no limit" },
	{ "selector", "NAME,...", "far, leaf, opacity, child (streamed); leaf!, uniform, colour, ... (read at once)" },
	{ "tolerance", "E,...", "of selectors by tolerance" },
	{ "step", "VOXELS,...", "step lengths" },
	{ "brick", "N,...", "brick edges, 4 to 64; not of a brick file" },
	{ "type", "u8|u16|f16|f32,...", "how values are stored; not of a brick file" },
	{ "frame-ms", "MS", "which setting is best within this frame time?" },
	{ "psnr", "DB", "which is cheapest that reaches this PSNR?" },
	{ "ssim", "S", "which is cheapest that reaches this SSIM?" },
	{ "generate", "KIND", "no scene: cme, enlil, delta, wing or shock" },
	{ "dim", "XxYxZ", "voxels of what is generated (128x128x128)" },
	{ "steps", "N", "its steps (8)" },
	{ "tf", "FILE", "a transfer function (the scene's own, or scenes/KIND-filled.tf)" },
	{ "inside", NULL, "the eye in the middle of the volume" },
	{ "size", "WxH", "of a picture (320x240; of a table 200x150)" },
	{ "frames", "N", "of a play, at 60 Hz (120); of --table prediction (100000) and, after the first 60, tracking (7200)" },
	{ "pictures", "N", "of them that are drawn and compared, evenly apart (3)" },
	{ "timed", "N", "frames drawn for each picture whose time counts, 1 to 8 (3)" },
	{ "settled", NULL, "pictures of what was selected when all of it has been read: no streaming" },
	{ "disk", "US:MB", "a disk: microseconds a brick, megabytes a second (default: the next frame has what was asked for)" },
	{ "draw", "auto|cpu|osmesa|egl", "back end (auto: cpu, then OpenGL)" },
	{ "table", "gains|clocks|prediction|tracking", "gains: Carlsson and Tjernstroem 2016 on generated data; clocks: exchanges against skew; prediction: of the head; tracking: cameras and noise" },
	{ "set", "NAME", "of --table: one data set" },
	{ "scale", "PERCENT", "of --table: of the voxels along each axis (50)" },
	{ "plot", "FILE", "draw the fronts into a .svg or .png file" },
	{ "csv", "FILE", "a line for each setting" },
	{ "json", NULL, "machine-readable" },
	{ "quiet", NULL, "no progress" },
	{ NULL, NULL, NULL },
};

enum bb_status bb_trade_size(const struct bb_cli *cli, const char *usual, uint32_t *width_px, uint32_t *height_px, struct bb_error *err)
{
	const char *text = bb_cli_get(cli, "size", usual);
	uint32_t size[2];

	if (!bb_cli_whole_numbers(text, 'x', size, 2) || size[0] < 16 || size[1] < 16 || size[0] > 4096 || size[1] > 4096)
		return bb_fail(err, BB_ERR_USAGE, 1481, NULL, "--size: '%.40s'", text);
	*width_px = size[0];
	*height_px = size[1];
	return BB_OK;
}

static enum bb_status begin_with(const char *kind, struct bb_trade_config *config, struct bb_trade **out,
				 struct bb_error *err)
{
	bb_renderer_destroy(config->renderer);
	config->renderer = NULL;
	const enum bb_status status = !strcmp(kind, "cpu") ? bb_renderer_cpu_create("auto", bb_parallel_processors(), &config->renderer, err)
							   : bb_renderer_gl_create(kind, &config->renderer, err);
	return status ? status : bb_trade_create(config, out, err);
}

enum bb_status bb_trade_begin(const struct bb_cli *cli, struct bb_trade_config *config, struct bb_trade **out,
			      struct bb_error *err)
{
	const char *kind = bb_cli_get(cli, "draw", "auto");
	struct bb_error first = { 0 };

	if (strcmp(kind, "auto") && strcmp(kind, "cpu") && strcmp(kind, "osmesa") && strcmp(kind, "egl"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--draw cannot be '%.40s'", kind);
	if (strcmp(kind, "auto"))
		return begin_with(kind, config, out, err);
	const enum bb_status status = begin_with("cpu", config, out, &first);
	if (!status)
		return BB_OK;
	if (first.number == 1480 || first.number == 1801) /* not on this machine, or not this data */
		return begin_with("auto", config, out, err);
	*err = first;
	return status;
}

void bb_trade_say(const char *text)
{
	fprintf(stderr, "\r%-100.100s%s", text, *text ? "" : "\r");
	fflush(stderr);
}

static int trade_run(const struct bb_cli *cli)
{
	const char *table = bb_cli_get(cli, "table", NULL);
	const char *plot = bb_cli_get(cli, "plot", NULL);
	const size_t rooms = table && !strcmp(table, "prediction");
	struct bb_error err = { 0 };
	const enum bb_status drawn = plot ? bb_page_check(plot, &err) : BB_OK;

	if (drawn)
		return bb_cli_fail(drawn, &err);
	if (table && (size_t)cli->n_args > rooms)
		return bb_cli_fail(bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "--table %.40s is not of '%.60s'", table, cli->arg[rooms]), &err);
	if (rooms)
		return bb_trade_prediction_run(cli);
	if (table && !strcmp(table, "tracking"))
		return bb_trade_tracking_run(cli);
	if (cli->n_args == 2 || bb_cli_has(cli, "device"))
		return bb_trade_device_run(cli);
	if (table && !strcmp(table, "clocks"))
		return bb_trade_clocks_run(cli);
	if (table)
		return bb_trade_table_run(cli);
	if (cli->n_args == 1 || bb_cli_has(cli, "generate"))
		return bb_trade_scene_run(cli);
	return bb_cli_fail(bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "trade: give a scene, a brick file or --generate KIND"),
			   &err);
}

const struct bb_command bb_cmd_trade = {
	.name = "trade",
	.line = "what quality costs: budgets, selectors, steps and bricks of a scene; or a device class's fidelities",
	.usage = "SCENE|FILE.bricks [options]; or ROOM SCENE --device CLASS; or --table gains|clocks|prediction|tracking",
	.options = options,
	.least_args = 0,
	.most_args = 2,
	.run = trade_run,
};
