/*
 * bench/cmd/bench.c: `bench`: fixed scenarios on the virtual clock, their numbers stored or compared with a baseline.
 * The scenarios are part of the baseline: change one and every stored baseline becomes not comparable, on purpose.
 */
#include "bench/cli.h"
#include "bench/gate.h"
#include "bench/run.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SEED 7

static const struct scenario {
	const char *name, *room, *scene;
	const char *data, *without; /* file the scene needs, and the scene to run where it is absent */
	double duration_s;
} scenarios[] = {
	{ "cabin", "rooms/cabin.yaml", "scenes/epi.yaml", "build/data/example4d.nii.gz", "scenes/cme.yaml", 4 },
	{ "cabin120", "rooms/cabin120.yaml", "scenes/epi.yaml", "build/data/example4d.nii.gz", "scenes/cme.yaml", 4 },
	{ "deck", "rooms/deck.yaml", "scenes/calibration.yaml", NULL, NULL, 2 },
};

static const struct bb_cli_option options[] = {
	{ "out", "FILE", "store the numbers: the next baseline" },
	{ "baseline", "FILE", "compare with this file; exit 1 on a regression, 5 when it is absent" },
	{ "only", "NAME", "one scenario: cabin, cabin120 or deck" },
	{ "pictures", "FOLDER", "draw the scenes' pictures into FOLDER and gate their quality, too" },
	{ "plant-draw-us", "N", "test of the gate: every draw takes N us longer" },
	{ "plant-bricks", "N", "test of the gate: N more bricks a frame" },
	{ "json", NULL, "print the numbers, or the differences, as JSON" },
	{ NULL, NULL, NULL },
};

static bool readable(const char *path)
{
	return !access(path, R_OK);
}

static enum bb_status run_options(const struct bb_cli *cli, const struct scenario *s, struct bb_run_options *o,
                                  struct bb_error *err)
{
	double draw_us, bricks;

	*o = bb_run_options_default();
	o->room_path = s->room;
	o->scene_path = !s->data || readable(s->data) ? s->scene : s->without;
	o->seed = SEED;
	o->posix_clock = false;
	o->out_dir = bb_cli_get(cli, "pictures", NULL);
	o->pictures = o->measure_psnr = o->out_dir != NULL;
	o->duration_s = s->duration_s;
	enum bb_status st = bb_cli_number(cli, "plant-draw-us", 0, -1e6, 1e6, &draw_us, err);
	if (st == BB_OK)
		st = bb_cli_whole(cli, "plant-bricks", 0, -1e6, 1e6, &bricks, err);
	if (st != BB_OK)
		return st;
	o->plant_draw_ns = (int64_t)(draw_us * 1e3);
	o->plant_bricks = (int64_t)bricks;
	return BB_OK;
}

static enum bb_status run_one(const struct bb_cli *cli, const struct scenario *s, json_t *file, struct bb_error *err)
{
	struct bb_run_options o;
	struct bb_run run = { 0 };
	enum bb_status st = run_options(cli, s, &o, err);

	if (st == BB_OK)
		st = bb_run(&o, &run, err);
	if (st != BB_OK)
		return st;
	bb_gate_file_add(file, s->name, run.result);
	if (!bb_cli_has(cli, "json")) {
		printf("%-10s %-12s %9llu events  %6.2f s  %s\n", s->name, bb_verdict_text(run.result->verdict),
		       (unsigned long long)run.result->n_events, run.result->wall_time_s, o.scene_path);
		fflush(stdout);
	}
	bb_run_free(&run);
	return BB_OK;
}

static enum bb_status run_all(const struct bb_cli *cli, json_t *file, struct bb_error *err)
{
	const char *only = bb_cli_get(cli, "only", NULL);
	bool any = false;

	for (size_t i = 0; i < BB_ARRAY_LEN(scenarios); i++) {
		if (only && strcmp(only, scenarios[i].name))
			continue;
		any = true;
		const enum bb_status st = run_one(cli, &scenarios[i], file, err);
		if (st != BB_OK)
			return st;
	}
	if (!any)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "bench: no scenario '%.40s'", only ? only : "");
	json_object_set_new(json_object_get(file, "facts"), "revision", json_string(bb_revision()));
	return BB_OK;
}

static int print_json(const json_t *o, int code)
{
	return json_dumpf(o, stdout, JSON_INDENT(2) | JSON_REAL_PRECISION(6)) || fputc('\n', stdout) == EOF
	               ? BB_EXIT_INTERNAL
	               : code;
}

/* The scenarios that were not asked for this time are not missing: they are left out of the baseline, too. */
static void keep_only(json_t *base, const char *only)
{
	json_t *scenario_list = json_object_get(base, "scenarios"), *keep = json_object();

	if (json_object_get(scenario_list, only))
		json_object_set(keep, only, json_object_get(scenario_list, only));
	json_object_set_new(base, "scenarios", keep);
}

static int judge(const struct bb_cli *cli, json_t *base, const json_t *now)
{
	struct bb_gate_report *report = malloc(sizeof(*report));
	const char *only = bb_cli_get(cli, "only", NULL);
	int code;

	if (!report)
		return bb_cli_fail(BB_ERR_NOMEM, NULL);
	if (only)
		keep_only(base, only);
	bb_gate_compare(base, now, report);
	code = bb_gate_exit_code(report);
	if (bb_cli_has(cli, "json")) {
		json_t *o = bb_gate_report_json(report);
		code = print_json(o, code);
		json_decref(o);
	} else {
		bb_gate_print(report, stdout, isatty(STDOUT_FILENO));
	}
	free(report);
	return code;
}

static int bench_run(const struct bb_cli *cli)
{
	const char *out = bb_cli_get(cli, "out", NULL), *baseline = bb_cli_get(cli, "baseline", NULL);
	struct bb_error err = { 0 }, lost = { 0 };
	json_t *base = NULL, *now = bb_gate_file();
	const enum bb_status base_st = baseline ? bb_gate_load(baseline, &base, &lost) : BB_OK;
	enum bb_status st = BB_OK;
	int code = BB_EXIT_OK;

	/* A minute of measuring is worth nothing when there is nothing to hold it against, unless it is to be stored. */
	if (base_st == BB_OK || out) {
		st = run_all(cli, now, &err);
		if (st == BB_OK && out)
			st = bb_gate_store(now, out, &err);
	}
	if (st != BB_OK)
		code = bb_cli_fail(st, &err);
	else if (base_st != BB_OK)
		code = bb_cli_fail(base_st, &lost);
	else if (base)
		code = judge(cli, base, now);
	else if (bb_cli_has(cli, "json"))
		code = print_json(now, code);
	json_decref(base);
	json_decref(now);
	return code;
}

const struct bb_command bb_cmd_bench = {
	.name = "bench",
	.line = "run the fixed scenarios on the virtual clock; store their numbers or compare with a baseline",
	.usage = "[--out FILE] [--baseline FILE] [--only NAME] [--pictures FOLDER] [--json]",
	.options = options,
	.least_args = 0,
	.most_args = 0,
	.run = bench_run,
};
