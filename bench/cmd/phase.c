/*
 * bench/cmd/phase.c: `phase ROOM`: when shutters, lenses, tokens and strobes act, or why no timing will do.
 */
#include <stdlib.h>

#include <jansson.h>

#include "bench/cli.h"
#include "bench/phase/drawing.h"

static enum bb_status draw(const struct bb_cli *cli, const struct bb_room *room, const struct bb_plan *plan,
                           const struct bb_phase_edges *edges, const struct bb_phase_trade *trade, struct bb_error *err)
{
	static const char *const kinds[] = { "svg", "png" };
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds) && !status; i++) {
		const char *file = bb_cli_get(cli, kinds[i], NULL);

		if (file)
			status = trade ? bb_phase_draw_trade(room, trade, file, err)
				       : bb_phase_draw(room, plan, edges, file, err);
	}
	return status;
}

static int run_trade(const struct bb_cli *cli, const struct bb_room *room)
{
	struct bb_error err = { 0 };
	struct bb_phase_trade trade;
	enum bb_status status = bb_phase_trade(room, &trade, &err);

	if (!status)
		status = draw(cli, room, NULL, NULL, &trade, &err);
	if (status)
		return bb_cli_fail(status, &err);
	if (bb_cli_has(cli, "json"))
		return bb_cli_print_json(bb_phase_trade_json(&trade));
	bb_phase_trade_print(&trade, stdout);
	return BB_EXIT_OK;
}

static int tell(const struct bb_cli *cli, const struct bb_room *room, const struct bb_plan plans[2],
                const struct bb_phase_edges *edges)
{
	const bool good = plans[0].possible && bb_phase_clear(&plans[0]);
	int code = BB_EXIT_OK;

	if (bb_cli_has(cli, "json")) {
		json_t *o = bb_phase_json(room, &plans[0], &plans[1]);

		if (o && edges)
			json_object_set_new(o, "measured", bb_phase_edges_json(edges));
		code = bb_cli_print_json(o);
	} else {
		bb_phase_print(room, &plans[0], &plans[1], stdout);
		if (edges)
			bb_phase_edges_print(edges, stdout);
	}
	return code != BB_EXIT_OK || good ? code : BB_EXIT_FAILED;
}

static int run_plan(const struct bb_cli *cli, const struct bb_room *room, double limit_percent)
{
	const char *measured = bb_cli_get(cli, "measured", NULL);
	const struct bb_plan_timing now = bb_plan_configured(&room->chain);
	struct bb_plan *plans = calloc(2, sizeof(*plans)); /* planned, as the file has it */
	struct bb_phase_edges *edges = calloc(1, sizeof(*edges));
	struct bb_error err = { 0 };
	enum bb_status status = BB_ERR_NOMEM;
	int code = BB_EXIT_OK;

	if (plans && edges)
		status = bb_plan_room(room, limit_percent, &plans[0], &err);
	else
		status = bb_fail(&err, status, 1702, NULL, "a plan");
	if (!status)
		status = bb_plan_judge(room, limit_percent, &now, &plans[1], &err);
	if (!status && measured)
		status = bb_phase_edges_read(measured, room, &plans[0], edges, &err);
	if (!status)
		status = draw(cli, room, &plans[0], measured ? edges : NULL, NULL, &err);
	code = status ? bb_cli_fail(status, &err) : tell(cli, room, plans, measured ? edges : NULL);
	free(plans);
	free(edges);
	return code;
}

static int run_phase(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_room *room;
	double limit_percent = 0;
	enum bb_status status = bb_room_load(cli->arg[0], &room, &err);

	if (status)
		return bb_cli_fail(status, &err);
	status = bb_cli_number(cli, "limit-percent", bb_plan_limit(room), 0.001, 100, &limit_percent, &err);
	if (!status && bb_cli_has(cli, "trade") && (bb_cli_has(cli, "measured") || bb_cli_has(cli, "limit-percent")))
		status = bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "--trade goes through all limits and takes neither a limit nor edges");
	const int code = status                       ? bb_cli_fail(status, &err)
			 : bb_cli_has(cli, "trade") ? run_trade(cli, room)
						      : run_plan(cli, room, limit_percent);
	bb_room_free(room);
	return code;
}

static const struct bb_cli_option options[] = {
	{ "limit-percent", "X", "crosstalk at most; left out: the room's budget, else 2" },
	{ "svg", "FILE", "draw the cycle, or with --trade the curve" },
	{ "png", "FILE", "the same as a picture of pixels" },
	{ "measured", "FILE", "edges to compare with the plan: edges.csv of a run" },
	{ "trade", NULL, "the brightest timing for one limit of crosstalk after the other" },
	{ "json", NULL, "everything as JSON" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_phase = { "phase",
	                                 "plan when shutters, glasses, tokens and strobes act, or say what stops it",
	                                 "ROOM [--limit-percent X] [--measured FILE] [--trade] [--svg FILE] [--png FILE] [--json]",
	                                 options, 1, 1, run_phase };
