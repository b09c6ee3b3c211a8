/*
 * bench/cmd/compare.c: `compare BASE NEW`: two result.json or bench files, value by value.
 */
#include "bench/cli.h"
#include "bench/gate.h"

#include <stdlib.h>
#include <unistd.h>

static const struct bb_cli_option options[] = {
	{ "json", NULL, "print the differences as JSON" },
	{ NULL, NULL, NULL },
};

static int print_json(const struct bb_gate_report *report)
{
	json_t *o = bb_gate_report_json(report);

	if (!o || json_dumpf(o, stdout, JSON_INDENT(2) | JSON_REAL_PRECISION(6)) || fputc('\n', stdout) == EOF) {
		json_decref(o);
		return BB_EXIT_INTERNAL;
	}
	json_decref(o);
	return bb_gate_exit_code(report);
}

static int compare_run(const struct bb_cli *cli)
{
	struct bb_gate_report *report = malloc(sizeof(*report));
	struct bb_error err = { 0 };
	json_t *base = NULL, *now = NULL;
	enum bb_status st = report ? bb_gate_load(cli->arg[0], &base, &err) : BB_ERR_NOMEM;
	int code;

	if (st == BB_OK)
		st = bb_gate_load(cli->arg[1], &now, &err);
	if (st == BB_OK) {
		bb_gate_compare(base, now, report);
		code = bb_gate_exit_code(report);
		if (bb_cli_has(cli, "json"))
			code = print_json(report);
		else
			bb_gate_print(report, stdout, isatty(STDOUT_FILENO));
	} else {
		code = bb_cli_fail(st, &err);
	}
	json_decref(base);
	json_decref(now);
	free(report);
	return code;
}

const struct bb_command bb_cmd_compare = {
	.name = "compare",
	.line = "compare two results: counters, stage times, event log, picture quality",
	.usage = "BASE NEW [--json]",
	.options = options,
	.least_args = 2,
	.most_args = 2,
	.run = compare_run,
};
