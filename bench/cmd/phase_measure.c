/*
 * bench/cmd/phase_measure.c: `phase measure FILE|DIR` and `phase sense ROOM`: what light sensors saw, and what they would
 * see in a simulated room. docs/phase-measure.md.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/cli.h"
#include "bench/optics/measure.h"
#include "bench/optics/sense.h"

static int exit_of(enum bb_verdict v)
{
	return v == BB_FAIL ? BB_EXIT_FAILED : v == BB_INCONCLUSIVE ? BB_EXIT_INCONCLUSIVE : BB_EXIT_OK;
}

static int tell(const struct bb_cli *cli, const struct bb_measure *m, const struct bb_room *room)
{
	const char *edges = bb_cli_get(cli, "edges", NULL), *plots[] = { bb_cli_get(cli, "svg", NULL), bb_cli_get(cli, "png", NULL) };
	struct bb_error err = { 0 };
	enum bb_status status = BB_OK;

	if (edges && !room)
		status = bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "--edges needs --room: whose edges are they?");
	for (size_t i = 0; i < BB_ARRAY_LEN(plots); i++)
		if (status == BB_OK && plots[i])
			status = bb_measure_plot(m, plots[i], &err);
	if (status == BB_OK && edges)
		status = bb_measure_edges(m, room, edges, &err);

	if (status != BB_OK)
		return bb_cli_fail(status, &err);
	if (bb_cli_has(cli, "json")) {
		const int code = bb_cli_print_json(bb_measure_json(m));
		return code ? code : exit_of(m->verdict);
	}
	bb_measure_print(m, stdout);
	return exit_of(m->verdict);
}

static int run_measure(const struct bb_cli *cli)
{
	const char *room_file = bb_cli_get(cli, "room", NULL);
	struct bb_measure *m = calloc(1, sizeof(*m));
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	double fps = 0;
	enum bb_status status = m ? BB_OK : bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "a recording");

	if (status == BB_OK)
		status = bb_cli_number(cli, "fps", 0, 1, 1e6, &fps, &err);
	if (status == BB_OK && room_file)
		status = bb_room_load(room_file, &room, &err);
	if (status == BB_OK)
		status = bb_measure_read(cli->arg[0], fps, m, &err);
	int code;
	if (status == BB_OK) {
		bb_measure_judge(m, room, !bb_cli_has(cli, "configured"));
		code = tell(cli, m, room);
		bb_measure_free(m);
	} else {
		code = bb_cli_fail(status, &err);
	}
	bb_room_free(room);
	free(m);
	return code;
}

static enum bb_status sense_options(const struct bb_cli *cli, struct bb_sense_options *o, struct bb_error *err)
{
	double seed = 1, cycles = 12, noise = 1;
	enum bb_status status = bb_cli_whole(cli, "seed", 1, 0, 9007199254740992.0, &seed, err);

	if (status == BB_OK)
		status = bb_cli_whole(cli, "cycles", 12, 9, 600, &cycles, err);
	if (status == BB_OK)
		status = bb_cli_number(cli, "noise", 1, 0, 100, &noise, err);
	*o = (struct bb_sense_options){ .seed = (uint64_t)seed, .configured = bb_cli_has(cli, "configured"),
		                        .swapped = bb_cli_has(cli, "swapped"), .cycles = (int64_t)cycles, .noise = noise,
		                        .wall = bb_cli_get(cli, "wall", NULL), .lens = bb_cli_get(cli, "lens", "left") };
	return status;
}

static int run_sense(const struct bb_cli *cli)
{
	const char *file = bb_cli_get(cli, "out", NULL), *dir = bb_cli_get(cli, "png-frames", NULL);
	struct bb_sense_options o;
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	enum bb_status status = sense_options(cli, &o, &err);

	if (status == BB_OK && !file && !dir)
		status = bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "neither --out nor --png-frames says where to");
	if (status == BB_OK)
		status = bb_room_load(cli->arg[0], &room, &err);
	if (status == BB_OK && file)
		status = bb_sense_diodes(room, &o, file, &err);
	if (status == BB_OK && dir)
		status = bb_sense_pictures(room, &o, dir, &err);
	bb_room_free(room);
	if (status != BB_OK)
		return bb_cli_fail(status, &err);
	if (file)
		printf("%s\n", file);
	if (dir)
		printf("%s\n", dir);
	return BB_EXIT_OK;
}

static const struct bb_cli_option measure_options[] = {
	{ "room", "FILE", "judge it by this room's budgets and plan" },
	{ "configured", NULL, "judge phases by the times in the room file instead of the plan" },
	{ "fps", "N", "pictures a second, over what recording.txt says" },
	{ "svg", "FILE", "draw the signals with the edges found" },
	{ "png", "FILE", "the same as a picture of pixels" },
	{ "edges", "FILE", "the edges found, for phase ROOM --measured" },
	{ "json", NULL, "everything measured as JSON" },
	{ NULL, NULL, NULL },
};
static const struct bb_cli_option sense_table[] = {
	{ "out", "FILE", "a CSV file of what photodiodes record" },
	{ "png-frames", "DIR", "a folder of what a 1000 fps camera records of one wall" },
	{ "wall", "ID", "of the camera; left out: the first stereo wall" },
	{ "lens", "WORD", "before the camera: left (when left out), right, bare" },
	{ "configured", NULL, "shutters as the room file says, not as planned" },
	{ "swapped", NULL, "the glasses open for the other eye" },
	{ "cycles", "N", "of both eyes, of each pattern: 12 when left out" },
	{ "noise", "N", "times the sensors' own: 1 when left out" },
	{ "seed", "N", "of every random number: 1 when left out" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_phase_measure = { "phase measure",
	                                         "phase, skew, eye order and crosstalk from what light sensors recorded",
	                                         "FILE.csv|DIR [--room ROOM] [--png FILE] [--json]", measure_options,
	                                         1, 1, run_measure };
const struct bb_command bb_cmd_phase_sense = { "phase sense", "what light sensors would record in a simulated room",
	                                       "ROOM --out FILE.csv [--png-frames DIR]", sense_table, 1, 1, run_sense };
