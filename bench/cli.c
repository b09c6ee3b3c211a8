/*
 * bench/cli.c: rows in, options out. Two-word commands ("room check") win over one-word ones. Prints on the streams a
 * person reads; keeps no state. One thread.
 */
#include "bench/cli.h"

#include "bench/file.h"

#include <errno.h>
#include <math.h>
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>

#ifndef BB_REVISION
#define BB_REVISION "unknown"
#endif

static const struct bb_cli_option everywhere[] = { { "help", NULL, "explain the command" }, { NULL, NULL, NULL } };

const char *bb_revision(void)
{
	return BB_REVISION;
}

/* ---- the nearest word ---- */

#define WORD_MOST 40

/* Edits (insert, delete, replace, swap neighbours) from a to b; long words are as far as can be. */
static size_t edits(const char *a, const char *b)
{
	size_t row[3][WORD_MOST + 1];
	const size_t n = strlen(a), m = strlen(b);

	if (n > WORD_MOST || m > WORD_MOST)
		return WORD_MOST;
	for (size_t j = 0; j <= m; j++)
		row[0][j] = j;
	for (size_t i = 1; i <= n; i++) {
		size_t *now = row[i % 3];
		const size_t *last = row[(i + 2) % 3], *before = row[(i + 1) % 3];
		now[0] = i;
		for (size_t j = 1; j <= m; j++) {
			size_t best = last[j - 1] + (a[i - 1] != b[j - 1]);
			best = last[j] + 1 < best ? last[j] + 1 : best;
			best = now[j - 1] + 1 < best ? now[j - 1] + 1 : best;
			if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] && before[j - 2] + 1 < best)
				best = before[j - 2] + 1;
			now[j] = best;
		}
	}
	return row[n % 3][m];
}

/* Keeps the nearest word so far; a word further away than a third of its length is no suggestion. */
static void nearer(const char *wanted, const char *word, const char **best, size_t *distance)
{
	const size_t d = edits(wanted, word);

	if (d <= 1 + strlen(word) / 3 && (!*best || d < *distance)) {
		*best = word;
		*distance = d;
	}
}

/* ---- commands and options ---- */

static size_t words_of(const char *name)
{
	return strchr(name, ' ') ? 2 : 1;
}

static bool names(const struct bb_command *c, int argc, const char *const *argv)
{
	char two[96];

	if (words_of(c->name) == 1)
		return argc > 0 && !strcmp(c->name, argv[0]);
	if (argc < 2)
		return false;
	bb_text_format(two, sizeof(two), "%.40s %.40s", argv[0], argv[1]);
	return !strcmp(c->name, two);
}

static const struct bb_command *find(const struct bb_command *const *commands, int argc, const char *const *argv)
{
	const struct bb_command *best = NULL;

	for (; *commands; commands++)
		if (names(*commands, argc, argv) && (!best || words_of((*commands)->name) > words_of(best->name)))
			best = *commands;
	return best;
}

/* "track" of "track serve", "track coverage" ...: their second words, in a row; false where there are none. */
static bool second_words(const struct bb_command *const *commands, const char *first, char *row, size_t cap)
{
	const size_t n = strlen(first);
	size_t at = 0;

	for (; *commands && at < cap; commands++)
		if (!strncmp((*commands)->name, first, n) && (*commands)->name[n] == ' ')
			at += (size_t)snprintf(row + at, cap - at, "%s%s", at ? ", " : "", (*commands)->name + n + 1);
	return at > 0;
}

static enum bb_status no_such_command(const struct bb_command *const *commands, int argc, const char *const *argv,
                                      struct bb_error *err)
{
	const char *best = NULL;
	size_t distance = 0;
	char two[96], words[160];

	if (argc == 1 && second_words(commands, argv[0], words, sizeof(words)))
		return bb_fail(err, BB_ERR_USAGE, 1703, NULL, "'%.40s' wants one of %s", argv[0], words);
	bb_text_format(two, sizeof(two), "%.40s %.40s", argv[0], argc > 1 ? argv[1] : "");
	for (; *commands; commands++)
		nearer(words_of((*commands)->name) == 2 ? two : argv[0], (*commands)->name, &best, &distance);
	if (best)
		return bb_fail(err, BB_ERR_USAGE, 1703, NULL, "'%.40s'; did you mean '%s'?", argv[0], best);
	return bb_fail(err, BB_ERR_USAGE, 1703, NULL, "'%.40s'", argv[0]);
}

static const struct bb_cli_option *option_in(const struct bb_cli_option *table, const char *name, size_t n)
{
	for (; table && table->name; table++)
		if (strlen(table->name) == n && !strncmp(table->name, name, n))
			return table;
	return NULL;
}

static enum bb_status no_such_option(const struct bb_command *c, const char *name, struct bb_error *err)
{
	const char *best = NULL;
	size_t distance = 0;
	char bare[WORD_MOST + 1];

	bb_text_format(bare, sizeof(bare), "%.*s", (int)strcspn(name, "="), name);
	for (const struct bb_cli_option *o = c->options; o && o->name; o++)
		nearer(bare, o->name, &best, &distance);
	if (best)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "%s: no option --%s; did you mean --%s?", c->name, bare,
		               best);
	return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "%s: no option --%s", c->name, bare);
}

static enum bb_status take_option(struct bb_cli *cli, int argc, const char *const *argv, int *i, struct bb_error *err)
{
	const char *name = argv[*i] + 2, *equals = strchr(name, '=');
	const size_t n = equals ? (size_t)(equals - name) : strlen(name);
	const struct bb_cli_option *o = option_in(cli->command->options, name, n);
	const char *value = equals ? equals + 1 : NULL;

	o = o ? o : option_in(everywhere, name, n);
	if (!o)
		return no_such_option(cli->command, name, err);
	if (!o->value && value)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--%s takes no value", o->name);
	if (o->value && !value) {
		if (*i + 1 >= argc || !strncmp(argv[*i + 1], "--", 2))
			return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--%s needs a value: %s", o->name, o->value);
		value = argv[++*i];
	}
	if (cli->n_options == BB_CLI_MAX)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "more than %d options", BB_CLI_MAX);
	cli->option[cli->n_options].name = o->name;
	cli->option[cli->n_options++].value = value;
	return BB_OK;
}

static enum bb_status take_all(struct bb_cli *cli, int argc, const char *const *argv, struct bb_error *err)
{
	bool only_arguments = false;

	for (int i = 0; i < argc; i++) {
		enum bb_status st = BB_OK;
		if (!only_arguments && !strcmp(argv[i], "--"))
			only_arguments = true;
		else if (!only_arguments && !strncmp(argv[i], "--", 2))
			st = take_option(cli, argc, argv, &i, err);
		else if (!only_arguments && argv[i][0] == '-' && argv[i][1])
			st = bb_fail(err, BB_ERR_USAGE, 1701, NULL, "'%.40s': options have two dashes", argv[i]);
		else if (cli->n_args == (int)BB_ARRAY_LEN(cli->arg))
			st = bb_fail(err, BB_ERR_USAGE, 1701, NULL, "too many arguments");
		else
			cli->arg[cli->n_args++] = argv[i];
		if (st != BB_OK)
			return st;
	}
	return BB_OK;
}

static enum bb_status check_count(const struct bb_cli *cli, struct bb_error *err)
{
	const struct bb_command *c = cli->command;

	if (cli->n_args < c->least_args)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "%s: %d of %d arguments are there; usage: %s %s", c->name,
		               cli->n_args, c->least_args, c->name, c->usage);
	if (cli->n_args > c->most_args)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "%s: '%.60s' is one argument too many; usage: %s %s",
		               c->name, cli->arg[c->most_args], c->name, c->usage);
	return BB_OK;
}

static bool asks_for_help(const char *word)
{
	return !strcmp(word, "help") || !strcmp(word, "--help") || !strcmp(word, "-h");
}

/* "help", "help run", "--help", "--version": what comes before any command. */
static enum bb_status parse_general(const struct bb_command *const *commands, int argc, const char *const *argv,
                                    struct bb_cli *cli, struct bb_error *err)
{
	if (argc && (!strcmp(argv[0], "--version") || !strcmp(argv[0], "version"))) {
		cli->option[cli->n_options++].name = "version";
		return BB_SKIPPED;
	}
	if (argc > 1) {
		cli->command = find(commands, argc - 1, argv + 1);
		if (!cli->command)
			return no_such_command(commands, argc - 1, argv + 1, err);
	}
	return BB_SKIPPED;
}

enum bb_status bb_cli_parse(const struct bb_command *const *commands, int argc, const char *const *argv,
                            struct bb_cli *cli, struct bb_error *err)
{
	enum bb_status st;
	int words;

	memset(cli, 0, sizeof(*cli));
	argc--;
	argv++;
	if (argc < 1)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "which command?");
	if (asks_for_help(argv[0]) || !strcmp(argv[0], "--version") || !strcmp(argv[0], "version"))
		return parse_general(commands, argc, argv, cli, err);
	cli->command = find(commands, argc, argv);
	if (!cli->command)
		return no_such_command(commands, argc, argv, err);
	words = (int)words_of(cli->command->name);
	st = take_all(cli, argc - words, argv + words, err);
	if (st != BB_OK)
		return st;
	return bb_cli_has(cli, "help") ? BB_SKIPPED : check_count(cli, err);
}

/* ---- what a command asks ---- */

bool bb_cli_has(const struct bb_cli *cli, const char *name)
{
	for (int i = 0; i < cli->n_options; i++)
		if (!strcmp(cli->option[i].name, name))
			return true;
	return false;
}

const char *bb_cli_get(const struct bb_cli *cli, const char *name, const char *fallback)
{
	for (int i = cli->n_options - 1; i >= 0; i--)
		if (!strcmp(cli->option[i].name, name))
			return cli->option[i].value;
	return fallback;
}

const char *bb_cli_nth(const struct bb_cli *cli, const char *name, int i)
{
	for (int k = 0; k < cli->n_options; k++)
		if (!strcmp(cli->option[k].name, name) && !i--)
			return cli->option[k].value;
	return NULL;
}

enum bb_status bb_cli_number(const struct bb_cli *cli, const char *name, double fallback, double least, double most,
                             double *out, struct bb_error *err)
{
	const char *text = bb_cli_get(cli, name, NULL);
	char *end;

	*out = fallback;
	if (!text)
		return BB_OK;
	/* No hexadecimal, no "inf", no leading blanks: what strtod would forgive is mostly a slip of the pen. */
	if (!*text || strspn(text, "0123456789+-.eE") != strlen(text))
		return bb_fail(err, BB_ERR_USAGE, 1704, NULL, "--%s '%.40s'", name, text);
	const double v = strtod(text, &end);
	if (*end || !isfinite(v))
		return bb_fail(err, BB_ERR_USAGE, 1704, NULL, "--%s '%.40s'", name, text);
	if (v < least || v > most)
		return bb_fail(err, BB_ERR_USAGE, 1704, NULL, "--%s %.40s is not within %g .. %g", name, text, least,
		               most);
	*out = v;
	return BB_OK;
}

enum bb_status bb_cli_whole(const struct bb_cli *cli, const char *name, double fallback, double least, double most,
                            double *out, struct bb_error *err)
{
	const enum bb_status status = bb_cli_number(cli, name, fallback, least, most, out, err);

	if (status != BB_OK || !bb_cli_has(cli, name) || !(*out > trunc(*out) || *out < trunc(*out)))
		return status;
	*out = fallback;
	return bb_fail(err, BB_ERR_USAGE, 1704, NULL, "--%s %.40s is no whole number", name, bb_cli_get(cli, name, ""));
}

bool bb_cli_numbers(const char *text, char sign, double *out, int n)
{
	for (int i = 0; i < n; i++) {
		char *end;
		out[i] = strtod(text, &end);
		if (end == text || *end != (i + 1 < n ? sign : '\0'))
			return false;
		text = end + 1;
	}
	return true;
}

bool bb_cli_whole_numbers(const char *text, char sign, uint32_t *out, int n)
{
	for (int i = 0; i < n; i++) {
		char *end;
		if (*text < '0' || *text > '9' || strspn(text, "0123456789") > 9)
			return false;
		out[i] = (uint32_t)strtoul(text, &end, 10);
		if (*end != (i + 1 < n ? sign : '\0'))
			return false;
		text = end + 1;
	}
	return true;
}

static int exit_code_of(enum bb_status status)
{
	switch (status) {
	case BB_OK:
		return BB_EXIT_OK;
	case BB_SKIPPED:
		return BB_EXIT_SKIPPED;
	case BB_ERR_USAGE:
	case BB_ERR_CONFIG:
	case BB_ERR_FORMAT:
	case BB_ERR_UNSUPPORTED:
	case BB_ERR_RANGE:
	case BB_ERR_REFUSED:
	case BB_ERR_IO:
	case BB_ERR_VERIFY:
		return BB_EXIT_USAGE;
	case BB_ERR_LOST:
	case BB_ERR_BUSY:
		return BB_EXIT_DEVICE_LOST;
	case BB_TIMEOUT:
	case BB_ERR_NOMEM:
	case BB_ERR_INTERNAL:
		break;
	}
	return BB_EXIT_INTERNAL;
}

int bb_cli_print_json(struct json_t *root)
{
	char *text = json_dumps(root, JSON_INDENT(2));

	json_decref(root);
	if (!text)
		return BB_EXIT_INTERNAL;
	puts(text);
	free(text);
	return BB_EXIT_OK;
}

int bb_cli_fail(enum bb_status status, const struct bb_error *err)
{
	if (err && err->number)
		fprintf(stderr, "%s\n", err->text);
	else
		fprintf(stderr, "BB0000: %s\n", bb_status_text(status));
	if (err && err->number == 1902)
		return BB_EXIT_NO_BASELINE;
	if (err && err->number == 1904)
		return BB_EXIT_INCONCLUSIVE;
	if (err && err->number == 1901) /* the results were not kept: that is not the user's mistake alone */
		return BB_EXIT_INTERNAL;
	return exit_code_of(status);
}

/* ---- help ---- */

static void help_all(const struct bb_command *const *commands, FILE *out)
{
	fprintf(out, "blackburst: brings up, proves and regression-tests immersive display rooms\n\n"
	             "usage: blackburst COMMAND [ARGUMENTS] [--OPTION VALUE]...\n\ncommands:\n");
	for (; *commands; commands++)
		fprintf(out, "  %-15s %s\n", (*commands)->name, (*commands)->line);
	fprintf(out, "  %-15s %s\n", "help", "this page, or `help COMMAND`");
	fprintf(out,
	        "\nexit codes: 0 ok, 1 a check or budget failed, 2 usage or configuration, 3 internal, 4 device lost,\n"
	        "            5 no baseline, 6 inconclusive, 77 skipped\n");
}

static void help_options(const struct bb_cli_option *o, FILE *out)
{
	for (; o && o->name; o++) {
		char left[64];
		bb_text_format(left, sizeof(left), "--%s%s%s", o->name, o->value ? " " : "", o->value ? o->value : "");
		fprintf(out, "  %-26s %s\n", left, o->help);
	}
}

static void help_one(const struct bb_command *c, FILE *out)
{
	fprintf(out, "blackburst %s: %s\n\nusage: blackburst %s %s\n\noptions:\n", c->name, c->line, c->name, c->usage);
	help_options(c->options, out);
	help_options(everywhere, out);
}

int bb_cli_main(const struct bb_command *const *commands, int argc, const char *const *argv)
{
	struct bb_error err = { 0 };
	struct bb_cli cli;
	const enum bb_status st = bb_cli_parse(commands, argc, argv, &cli, &err);

	if (st == BB_SKIPPED) {
		if (bb_cli_has(&cli, "version"))
			printf("blackburst %s\n", bb_revision());
		else if (cli.command)
			help_one(cli.command, stdout);
		else
			help_all(commands, stdout);
		return fflush(stdout) ? BB_EXIT_INTERNAL : BB_EXIT_OK;
	}
	if (st != BB_OK) {
		if (argc < 2)
			help_all(commands, stderr);
		return bb_cli_fail(st, &err);
	}
	return cli.command->run(&cli);
}

int bb_cli_signals(void)
{
	sigset_t set;

	sigemptyset(&set);
	sigaddset(&set, SIGINT);
	sigaddset(&set, SIGTERM);
	sigprocmask(SIG_BLOCK, &set, NULL);
	return signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
}
