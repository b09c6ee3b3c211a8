/*
 * bench/cli.h: the command line. A command is a row: name, one line, usage, function. Options are "--name value",
 * "--name=value" or flags; unknown ones are error 1701 with the nearest known one. No environment variables.
 */
#ifndef BB_BENCH_CLI_H
#define BB_BENCH_CLI_H

#include "hal/status.h"

enum bb_exit { BB_EXIT_OK, BB_EXIT_FAILED, BB_EXIT_USAGE, BB_EXIT_INTERNAL, BB_EXIT_DEVICE_LOST, BB_EXIT_NO_BASELINE,
               BB_EXIT_INCONCLUSIVE, BB_EXIT_SKIPPED = 77 };

struct bb_cli_option {
	const char *name;   /* "seed" for --seed */
	const char *value;  /* "N": takes a value of that shape; NULL: a flag */
	const char *help;
};

struct bb_cli;
struct bb_command {
	const char *name, *line; /* "room check", what it does in one line */
	const char *usage;       /* "ROOM [--json]" */
	const struct bb_cli_option *options; /* ends with name NULL */
	int least_args, most_args;
	int (*run)(const struct bb_cli *cli);
};

#define BB_CLI_MAX 256
struct bb_cli { /* what was given */
	const struct bb_command *command;
	int n_args;
	const char *arg[1024]; /* a sequence may be many files */
	int n_options;
	struct {
		const char *name, *value; /* value NULL: a flag */
	} option[BB_CLI_MAX];
};

bool bb_cli_has(const struct bb_cli *cli, const char *name);
const char *bb_cli_get(const struct bb_cli *cli, const char *name, const char *fallback); /* the last one given */
/* The i-th value of a repeatable option, NULL past the end. */
const char *bb_cli_nth(const struct bb_cli *cli, const char *name, int i);
BB_MUST_CHECK enum bb_status bb_cli_number(const struct bb_cli *cli, const char *name, double fallback, double least,
                                           double most, double *out, struct bb_error *err);
/* The same, and a whole number. */
BB_MUST_CHECK enum bb_status bb_cli_whole(const struct bb_cli *cli, const char *name, double fallback, double least,
                                          double most, double *out, struct bb_error *err);
/* n numbers with a sign between them, "0.5:2", and nothing else; false otherwise. */
bool bb_cli_numbers(const char *text, char sign, double *out, int n);
bool bb_cli_whole_numbers(const char *text, char sign, uint32_t *out, int n); /* "64x64x32" */
/* Prints err on standard error and returns the exit code for status. */
int bb_cli_fail(enum bb_status status, const struct bb_error *err);

/* Prints what --json asks for on standard output; takes the reference (jansson's). Returns an exit code. */
struct json_t;
int bb_cli_print_json(struct json_t *root);
/* SIGINT and SIGTERM as an open file (signalfd, does not block), for a loop that ends between two answers; -1: errno. */
int bb_cli_signals(void);

/* Takes a command line apart; commands end with NULL. BB_SKIPPED: help or version was asked for (cli->command is the
 * command to explain, NULL for all; option "version" is set for the version). Errors 1701 and 1703. */
BB_MUST_CHECK enum bb_status bb_cli_parse(const struct bb_command *const *commands, int argc, const char *const *argv,
                                          struct bb_cli *cli, struct bb_error *err);
/* Parses, helps or runs; the whole of main(). Returns the exit code. */
int bb_cli_main(const struct bb_command *const *commands, int argc, const char *const *argv);
/* The git revision this was built from, "unknown" without one. */
const char *bb_revision(void);

/* Every command: one file bench/cmd/<name>.c each, listed in bench/main.c. */
extern const struct bb_command bb_cmd_run, bb_cmd_node, bb_cmd_room_check, bb_cmd_room_draw, bb_cmd_devices,
	bb_cmd_doctor, bb_cmd_bench, bb_cmd_bench_barrier, bb_cmd_bench_blobs, bb_cmd_compare, bb_cmd_trade, bb_cmd_serve,
	bb_cmd_volume_generate, bb_cmd_volume_build, bb_cmd_volume_info, bb_cmd_volume_verify, bb_cmd_volume_speed,
	bb_cmd_volume_tables, bb_cmd_volume_select, bb_cmd_phase, bb_cmd_phase_measure, bb_cmd_phase_sense,
	bb_cmd_bench_track, bb_cmd_track_coverage, bb_cmd_track_place, bb_cmd_track_calibrate, bb_cmd_track_align,
	bb_cmd_track_replay, bb_cmd_track_import, bb_cmd_track_serve;

#endif
