/* tests/test_gate.c: what the gate catches, what it lets pass, and what it refuses to compare. */
#include "tests/fixture_result.h"

#include "bench/cli.h"
#include "bench/gate.h"

#include <setjmp.h>
#include <stdarg.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

static const struct bb_command *const commands[] = { &bb_cmd_compare, NULL };
static struct bb_gate_report report;

static json_t *file_of(const struct fixture_options *o, void (*change)(struct fixture *))
{
	struct fixture *x = fixture_create(o);
	json_t *file = bb_gate_file();

	x->result->pictures = calloc(1, sizeof(*x->result->pictures));
	x->result->n_pictures = 1;
	snprintf(x->result->pictures[0].wall, BB_ID_MAX, "front");
	snprintf(x->result->pictures[0].eye, 8, "left");
	x->result->pictures[0].psnr_db = 41.5;
	if (change)
		change(x);
	assert_int_equal(bb_result_judge(x->result), BB_OK);
	bb_gate_file_add(file, "cabin", x->result);
	fixture_free(x);
	return file;
}

static const struct fixture_options plain = { .n_frames = 240 };

static int compare(const struct fixture_options *o, void (*change)(struct fixture *))
{
	json_t *base = file_of(&plain, NULL), *now = file_of(o, change);

	bb_gate_compare(base, now, &report);
	json_decref(base);
	json_decref(now);
	return bb_gate_exit_code(&report);
}

static const struct bb_gate_line *line_of(const char *name)
{
	for (size_t i = 0; i < report.n_lines; i++)
		if (!strcmp(report.line[i].name, name))
			return &report.line[i];
	fail_msg("no line for %s", name);
	return NULL;
}

static void test_same_twenty_times(void **state)
{
	(void)state;
	for (int i = 0; i < 20; i++) {
		assert_int_equal(compare(&plain, NULL), BB_EXIT_OK);
		assert_int_equal(report.outcome, BB_GATE_SAME);
		assert_int_equal(report.n_lines, 0);
	}
	assert_true(report.n_compared > 40);
}

static void test_one_microsecond(void **state)
{
	struct fixture_options o = plain;

	(void)state;
	o.extra_draw_ns = 1000;
	assert_int_equal(compare(&o, NULL), BB_EXIT_FAILED);
	assert_int_equal(line_of("stage.draw.p50_ns")->outcome, BB_GATE_REGRESSED);
	o.extra_draw_ns = -1000;
	compare(&o, NULL);
	assert_int_equal(line_of("stage.draw.p50_ns")->outcome, BB_GATE_IMPROVED);
}

static void test_one_brick(void **state)
{
	struct fixture_options o = plain;

	(void)state;
	o.extra_bricks = 1;
	assert_int_equal(compare(&o, NULL), BB_EXIT_FAILED);
	assert_int_equal(line_of("counter.bricks_wanted")->outcome, BB_GATE_REGRESSED);
	assert_int_equal(report.n_lines, 1);
	assert_true(fabs(line_of("counter.bricks_wanted")->percent - 2.5) < 1e-9);
}

static void fewer_bytes(struct fixture *x)
{
	for (size_t i = 0; i < x->result->n_counters; i++)
		if (!strcmp(x->result->counters[i].name, "bytes_streamed"))
			x->result->counters[i].value--;
	x->result->event_log_sha256[0] = 'b'; /* explained by the counter */
}

static void other_events(struct fixture *x)
{
	x->result->event_log_sha256[0] = 'b';
}

static void fewer_frames(struct fixture *x)
{
	x->result->counters[0].value--;
}

static void new_counter(struct fixture *x)
{
	bb_result_count(x->result, "surprises", 1);
}

static void worse_picture(struct fixture *x)
{
	x->result->pictures[0].psnr_db -= 1e-5;
}

static void no_picture(struct fixture *x)
{
	x->result->n_pictures = 0;
}

static void test_directions(void **state)
{
	(void)state;
	assert_int_equal(compare(&plain, fewer_bytes), BB_EXIT_OK);
	assert_int_equal(report.outcome, BB_GATE_IMPROVED);
	assert_int_equal(compare(&plain, other_events), BB_EXIT_FAILED);
	assert_int_equal(line_of("event_log_sha256")->outcome, BB_GATE_CHANGED);
	assert_int_equal(compare(&plain, fewer_frames), BB_EXIT_FAILED); /* no cost: fewer is not better */
	assert_int_equal(report.outcome, BB_GATE_CHANGED);
	assert_int_equal(compare(&plain, new_counter), BB_EXIT_FAILED);
	assert_string_equal(line_of("counter.surprises")->reason, "not in the baseline");
	assert_int_equal(compare(&plain, worse_picture), BB_EXIT_FAILED);
	assert_int_equal(compare(&plain, no_picture), BB_EXIT_OK);
}

static void other_seed(struct fixture *x)
{
	x->result->seed = 8;
}

static void other_room(struct fixture *x)
{
	x->room.sha256[5] ^= 1;
}

static void other_profile(struct fixture *x)
{
	x->result->facts[4].value[0] = 'f';
}

static void other_fidelity(struct fixture *x)
{
	x->scene.needs[BB_CLASS_CAMERAS] = 0;
}

static void on_posix(struct fixture *x)
{
	snprintf(x->result->clock, sizeof(x->result->clock), "posix");
}

static void test_not_comparable(void **state)
{
	static void (*const changes[])(struct fixture *) = { other_seed, other_room, other_profile, other_fidelity,
		                                             on_posix };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(changes); i++) {
		assert_int_equal(compare(&plain, changes[i]), BB_EXIT_INCONCLUSIVE);
		assert_int_equal(report.n_lines, 1);
	}
	json_t *base = file_of(&plain, on_posix), *now = file_of(&plain, on_posix);
	bb_gate_compare(base, now, &report);
	assert_int_equal(bb_gate_exit_code(&report), BB_EXIT_INCONCLUSIVE);
	json_decref(base);
	json_decref(now);
}

static void other_machine(struct fixture *x)
{
	snprintf(x->result->facts[1].value, sizeof(x->result->facts[1].value), "another");
	other_events(x);
	worse_picture(x);
}

static void test_other_machine(void **state)
{
	(void)state;
	assert_int_equal(compare(&plain, other_machine), BB_EXIT_OK); /* counters only */
	assert_int_equal(report.outcome, BB_GATE_SAME);
}

static void test_scenarios_must_match(void **state)
{
	json_t *base = file_of(&plain, NULL), *now = bb_gate_file();

	(void)state;
	bb_gate_compare(base, now, &report);
	assert_int_equal(bb_gate_exit_code(&report), BB_EXIT_INCONCLUSIVE);
	bb_gate_compare(now, base, &report);
	assert_int_equal(bb_gate_exit_code(&report), BB_EXIT_INCONCLUSIVE);
	json_decref(base);
	json_decref(now);
}

static void put_file(const char *path, const char *text)
{
	FILE *f = fopen(path, "w");

	assert_non_null(f);
	fputs(text, f);
	fclose(f);
}

static int quiet_compare(const char *a, const char *b)
{
	const char *const argv[] = { "blackburst", "compare", a, b };
	const int out = dup(1), err = dup(2);
	int code;

	fflush(NULL);
	assert_non_null(freopen("/dev/null", "w", stdout));
	assert_non_null(freopen("/dev/null", "w", stderr));
	code = bb_cli_main(commands, 4, argv);
	fflush(NULL);
	dup2(out, 1);
	dup2(err, 2);
	close(out);
	close(err);
	return code;
}

static void test_command(void **state)
{
	struct fixture_options o = plain;
	struct fixture *x = fixture_create(&plain);
	json_t *base = file_of(&plain, NULL), *now;

	(void)state;
	o.extra_bricks = 1;
	now = file_of(&o, NULL);
	assert_int_equal(bb_gate_store(base, "build/gate_a.json", NULL), BB_OK);
	assert_int_equal(bb_gate_store(now, "build/gate_b.json", NULL), BB_OK);
	assert_int_equal(quiet_compare("build/gate_a.json", "build/gate_a.json"), 0);
	assert_int_equal(quiet_compare("build/gate_a.json", "build/gate_b.json"), 1);
	assert_int_equal(quiet_compare("build/gate_none.json", "build/gate_b.json"), 5);
	assert_int_equal(quiet_compare("build/gate_a.json/x", "build/gate_b.json"), 5);

	assert_int_equal(bb_result_judge(x->result), BB_OK);
	assert_int_equal(bb_result_write_json(x->result, "build/gate_r.json", NULL), BB_OK);
	assert_int_equal(quiet_compare("build/gate_r.json", "build/gate_r.json"), 0);
	assert_int_equal(quiet_compare("build/gate_a.json", "build/gate_r.json"), 6); /* other scenarios */
	json_decref(base);
	json_decref(now);
	fixture_free(x);
}

#define SOUND "{\"values\":{},\"inputs\":{\"clock\":\"virtual\"},\"event_log_sha256\":\"\"}"

static void test_hostile_files(void **state)
{
	static const char *const texts[] = {
		"",
		"{",
		"[]",
		"null",
		"{}",
		"\x80\x81",
		"{\"kind\": 7, \"schema\": 1}",
		"{\"kind\":\"blackburst-bench\",\"schema\":2,\"facts\":{},\"scenarios\":{}}",
		"{\"kind\":\"blackburst-bench\",\"schema\":2,\"facts\":{},\"scenarios\":{\"a\":" SOUND "}}",
		"{\"kind\":\"blackburst-bench\",\"schema\":1,\"facts\":{},\"scenarios\":[]}",
		"{\"kind\":\"blackburst-bench\",\"schema\":1,\"facts\":{},\"scenarios\":{}}",
		"{\"kind\":\"blackburst-bench\",\"schema\":1,\"facts\":{},\"scenarios\":{\"a\":null}}",
		("{\"kind\":\"blackburst-bench\",\"schema\":1,\"facts\":{},\"scenarios\":{\"a\":{\"values\":{\"x\":"
		 "\"y\"},"
		 "\"inputs\":{},\"event_log_sha256\":\"\"}}}"),
		"{\"kind\":\"blackburst-bench\",\"schema\":1,\"facts\":{},\"scenarios\":{\"a\":{\"values\":{},"
		"\"inputs\":{}}}}",
		"{\"kind\":\"blackburst-result\",\"schema\":1}",
		"{\"kind\":\"blackburst-result\",\"schema\":1,\"facts\":7,\"gate\":{}}",
		"{\"kind\":\"blackburst-trade\",\"schema\":1}",
		"{\"kind\":\"a\",\"kind\":\"b\",\"schema\":1}",
	};
	char *deep = calloc(100001, 1);

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(texts); i++) {
		put_file("build/gate_h.json", texts[i]);
		assert_int_equal(quiet_compare("build/gate_h.json", "build/gate_h.json"), 2);
	}
	put_file("build/gate_h.json",
	         "{\"kind\":\"blackburst-bench\",\"schema\":1,\"facts\":{},\"scenarios\":{\"a\":" SOUND "}}");
	assert_int_equal(quiet_compare("build/gate_h.json", "build/gate_h.json"), 0); /* the sound one is taken */
	memset(deep, '[', 100000);
	put_file("build/gate_h.json", deep);
	assert_int_equal(quiet_compare("build/gate_h.json", "build/gate_h.json"), 2);
	free(deep);
	assert_int_equal(quiet_compare("build", "build"), 2);
}

static void test_many_lines(void **state)
{
	json_t *base = bb_gate_file(), *now;
	char key[32];

	(void)state;
	json_t *section =
		json_pack("{s:{s:s}, s:s, s:{}}", "inputs", "clock", "virtual", "event_log_sha256", "", "values");
	json_object_set(json_object_get(base, "scenarios"), "s", section);
	now = json_deep_copy(base);
	for (int i = 0; i < 1000; i++) {
		snprintf(key, sizeof(key), "counter.bytes_%d", i);
		json_object_set_new(json_object_get(section, "values"), key, json_integer(i));
	}
	bb_gate_compare(base, now, &report);
	assert_int_equal(report.n_lines, BB_GATE_LINES_MAX);
	assert_int_equal(report.n_unlisted, 1000 - BB_GATE_LINES_MAX);
	assert_int_equal(report.outcome, BB_GATE_CHANGED);
	json_decref(section);
	json_decref(base);
	json_decref(now);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_same_twenty_times), cmocka_unit_test(test_one_microsecond),
		cmocka_unit_test(test_one_brick),         cmocka_unit_test(test_directions),
		cmocka_unit_test(test_not_comparable),    cmocka_unit_test(test_other_machine),
		cmocka_unit_test(test_scenarios_must_match), cmocka_unit_test(test_command),
		cmocka_unit_test(test_hostile_files),     cmocka_unit_test(test_many_lines),
	};

	mkdir("build", 0777);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
