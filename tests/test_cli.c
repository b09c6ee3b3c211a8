/* tests/test_cli.c: command lines taken apart, suggestions, numbers, exit codes. */
#include "bench/cli.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

static int answer(const struct bb_cli *cli)
{
	return cli->n_args + 40;
}

static const struct bb_cli_option options[] = { { "seed", "N", "" }, { "fault", "TEXT", "" }, { "json", NULL, "" },
	                                        { NULL, NULL, NULL } };
static const struct bb_command run = { "run", "runs", "ROOM SCENE", options, 2, 2, answer };
static const struct bb_command check = { "room check", "checks", "ROOM", options, 1, 1, answer };
static const struct bb_command draw = { "room draw", "draws", "ROOM", NULL, 1, 1, answer };
static const struct bb_command doctor = { "doctor", "looks", "", NULL, 0, 0, answer };
static const struct bb_command *const commands[] = { &run, &check, &draw, &doctor, NULL };

#define PARSE(cli, err, ...)                                                                                          \
	bb_cli_parse(commands, (int)(sizeof((const char *[]){ "blackburst", __VA_ARGS__ }) / sizeof(char *)),          \
	             (const char *const[]){ "blackburst", __VA_ARGS__ }, cli, err)

static void test_good(void **state)
{
	struct bb_error err = { 0 };
	struct bb_cli cli;

	(void)state;
	assert_int_equal(PARSE(&cli, &err, "run", "a", "--seed", "7", "b", "--json", "--seed=9"), BB_OK);
	assert_ptr_equal(cli.command, &run);
	assert_int_equal(cli.n_args, 2);
	assert_string_equal(cli.arg[1], "b");
	assert_string_equal(bb_cli_get(&cli, "seed", "0"), "9");
	assert_string_equal(bb_cli_nth(&cli, "seed", 0), "7");
	assert_null(bb_cli_nth(&cli, "seed", 2));
	assert_true(bb_cli_has(&cli, "json"));
	assert_false(bb_cli_has(&cli, "fault"));
	assert_string_equal(bb_cli_get(&cli, "fault", "none"), "none");

	assert_int_equal(PARSE(&cli, &err, "room", "check", "r.yaml"), BB_OK);
	assert_ptr_equal(cli.command, &check);
	assert_string_equal(cli.arg[0], "r.yaml");
	assert_int_equal(PARSE(&cli, &err, "run", "--", "--seed", "-x"), BB_OK);
	assert_string_equal(cli.arg[0], "--seed");
	assert_int_equal(PARSE(&cli, &err, "run", "a", "-"), BB_OK); /* a dash alone is a name */
	assert_int_equal(PARSE(&cli, &err, "run", "a", "b", "--fault", ""), BB_OK);
	assert_string_equal(bb_cli_get(&cli, "fault", "none"), "");
	assert_int_equal(PARSE(&cli, &err, "run", "a", "b", "--seed", "-5"), BB_OK);
}

static void check_error(enum bb_status st, const struct bb_error *err, int number, const char *part)
{
	assert_int_equal(st, BB_ERR_USAGE);
	assert_int_equal(err->number, number);
	if (!strstr(err->text, part))
		fail_msg("'%s' is not in: %s", part, err->text);
}

#define BAD(number, part, ...)                                                                                        \
	do {                                                                                                          \
		struct bb_error e = { 0 };                                                                            \
		struct bb_cli c;                                                                                      \
		const enum bb_status st = PARSE(&c, &e, __VA_ARGS__);                                                 \
		check_error(st, &e, number, part);                                                                    \
	} while (0)

static void test_bad(void **state)
{
	struct bb_error err = { 0 };
	struct bb_cli cli;

	(void)state;
	BAD(1703, "did you mean 'run'", "rnu");
	BAD(1703, "did you mean 'room check'", "room", "chek", "x");
	BAD(1703, "'room' wants one of check, draw", "room");
	BAD(1703, "did you mean 'doctor'", "docter");
	BAD(1703, "'xyzzy'", "xyzzy");
	BAD(1703, "''", "");
	BAD(1703, "did you mean 'run'", "help", "urn");
	BAD(1701, "did you mean --seed", "run", "a", "b", "--sede", "3");
	BAD(1701, "did you mean --seed", "run", "a", "b", "--esde", "3"); /* two swaps */
	BAD(1701, "did you mean --fault", "run", "a", "b", "--faults=x");
	BAD(1701, "no option --zzzzzz;", "run", "a", "b", "--zzzzzz");
	BAD(1701, "no option --json", "room", "draw", "x", "--json");
	BAD(1701, "needs a value", "run", "a", "b", "--seed");
	BAD(1701, "needs a value", "run", "a", "b", "--seed", "--json");
	BAD(1701, "takes no value", "run", "a", "b", "--json=1");
	BAD(1701, "two dashes", "run", "a", "b", "-seed");
	BAD(1701, "1 of 2", "run", "a");
	BAD(1701, "'c' is one", "run", "a", "b", "c");
	assert_int_equal(bb_cli_parse(commands, 1, (const char *const[]){ "blackburst" }, &cli, &err), BB_ERR_USAGE);
}

static void test_too_much(void **state)
{
	const char *argv[700] = { "blackburst", "run", "a", "b" };
	char *huge = malloc(100001);
	struct bb_error err = { 0 };
	struct bb_cli cli;

	(void)state;
	for (int i = 4; i < 700; i++)
		argv[i] = "--json";
	assert_int_equal(bb_cli_parse(commands, 4 + BB_CLI_MAX, argv, &cli, &err), BB_OK);
	assert_int_equal(bb_cli_parse(commands, 5 + BB_CLI_MAX, argv, &cli, &err), BB_ERR_USAGE);
	for (int i = 2; i < 700; i++)
		argv[i] = "a";
	err.number = 0;
	assert_int_equal(bb_cli_parse(commands, 700, argv, &cli, &err), BB_ERR_USAGE);
	memset(huge, 'r', 100000);
	huge[100000] = '\0';
	BAD(1703, "", huge);
	huge[0] = huge[1] = '-';
	BAD(1701, "", "run", "a", "b", huge);
	free(huge);
}

static enum bb_status number(const char *text, double *out, struct bb_error *err)
{
	struct bb_cli cli = { .n_options = 1 };

	cli.option[0].name = "seed";
	cli.option[0].value = text;
	return bb_cli_number(&cli, "seed", 5, -10, 1e9, out, err);
}

static void test_numbers(void **state)
{
	static const char *const bad[] = { "",   "x",    "1x",  "nan", "inf", "-inf", "0x10", "1e999", "1e10",
		                           "-11", " 1", "1 ", "--1", "1,5", "1e", ".",   "+",    "1.2.3" };
	struct bb_cli none = { 0 };
	double v;

	(void)state;
	assert_int_equal(number("7", &v, NULL), BB_OK);
	assert_true(fabs(v - 7) < 1e-12);
	assert_int_equal(number("-2.5e0", &v, NULL), BB_OK);
	assert_true(fabs(v + 2.5) < 1e-12);
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_error err = { 0 };
		if (number(bad[i], &v, &err) != BB_ERR_USAGE)
			fail_msg("'%s' was taken for %g", bad[i], v);
		assert_int_equal(err.number, 1704);
		assert_true(fabs(v - 5) < 1e-12);
	}
	struct bb_cli whole = { .n_options = 1, .option = { { .name = "seed", .value = "2.5" } } };
	assert_int_equal(bb_cli_whole(&whole, "seed", 5, 0, 10, &v, NULL), BB_ERR_USAGE);
	assert_true(fabs(v - 5) < 1e-12);
	whole.option[0].value = "2e1";
	assert_int_equal(bb_cli_whole(&whole, "seed", 5, 0, 100, &v, NULL), BB_OK);
	assert_true(fabs(v - 20) < 1e-12);
	assert_int_equal(bb_cli_number(&none, "seed", 5, 0, 10, &v, NULL), BB_OK);
	assert_true(fabs(v - 5) < 1e-12);
}

static int quietly(int argc, const char *const *argv)
{
	const int out = dup(1), err = dup(2);
	int code;

	fflush(NULL);
	assert_non_null(freopen("/dev/null", "w", stdout));
	assert_non_null(freopen("/dev/null", "w", stderr));
	code = bb_cli_main(commands, argc, argv);
	fflush(NULL);
	dup2(out, 1);
	dup2(err, 2);
	close(out);
	close(err);
	return code;
}

#define MAIN(...)                                                                                                     \
	quietly((int)(sizeof((const char *[]){ "blackburst", __VA_ARGS__ }) / sizeof(char *)),                         \
	        (const char *const[]){ "blackburst", __VA_ARGS__ })

static void test_main_codes(void **state)
{
	(void)state;
	assert_int_equal(MAIN("run", "a", "b"), 42);
	assert_int_equal(MAIN("doctor"), 40);
	assert_int_equal(MAIN("help"), 0);
	assert_int_equal(MAIN("--help"), 0);
	assert_int_equal(MAIN("help", "room", "check"), 0);
	assert_int_equal(MAIN("run", "--help"), 0);
	assert_int_equal(MAIN("--version"), 0);
	assert_int_equal(MAIN("rum", "a", "b"), 2);
	assert_int_equal(MAIN("run"), 2);
	assert_int_equal(quietly(1, (const char *const[]){ "blackburst" }), 2);
}

static int fail_code(enum bb_status st, int error_number)
{
	const struct bb_error err = { error_number, "" };
	const int keep = dup(2);
	int code;

	assert_non_null(freopen("/dev/null", "w", stderr));
	code = bb_cli_fail(st, &err);
	fflush(NULL);
	dup2(keep, 2);
	close(keep);
	return code;
}

static void test_fail_codes(void **state)
{
	(void)state;
	assert_int_equal(fail_code(BB_ERR_CONFIG, 1101), BB_EXIT_USAGE);
	assert_int_equal(fail_code(BB_ERR_FORMAT, 1401), BB_EXIT_USAGE);
	assert_int_equal(fail_code(BB_ERR_IO, 1001), BB_EXIT_USAGE);
	assert_int_equal(fail_code(BB_ERR_IO, 1901), BB_EXIT_INTERNAL);
	assert_int_equal(fail_code(BB_ERR_IO, 1902), BB_EXIT_NO_BASELINE);
	assert_int_equal(fail_code(BB_ERR_CONFIG, 1904), BB_EXIT_INCONCLUSIVE);
	assert_int_equal(fail_code(BB_ERR_LOST, 1501), BB_EXIT_DEVICE_LOST);
	assert_int_equal(fail_code(BB_ERR_NOMEM, 0), BB_EXIT_INTERNAL);
	assert_int_equal(fail_code(BB_SKIPPED, 0), BB_EXIT_SKIPPED);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_good),    cmocka_unit_test(test_bad),        cmocka_unit_test(test_too_much),
		cmocka_unit_test(test_numbers), cmocka_unit_test(test_main_codes), cmocka_unit_test(test_fail_codes),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
