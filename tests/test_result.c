/* tests/test_result.c: the files of a run: well-formed, escaped, atomic, the same bytes every time. */
#include "tests/fixture_result.h"

#include "bench/file.h"
#include "bench/report/html.h"

#include <dirent.h>
#include <fcntl.h>
#include <jansson.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

struct place {
	char dir[64], path[200];
	struct fixture *x;
	char *text;
	size_t n;
};

static int set_up(void **state)
{
	const struct fixture_options o = { .faults = true, .n_frames = 600, .picture_dir = NULL };
	struct place *p = calloc(1, sizeof(*p));

	snprintf(p->dir, sizeof(p->dir), "build/test_result.XXXXXX");
	if (!mkdtemp(p->dir))
		return -1;
	p->x = fixture_create(&o);
	fixture_pictures(p->x, p->dir);
	snprintf(p->x->room.name, sizeof(p->x->room.name), "cabin \"<&>' ]]> \x01");
	snprintf(p->x->nodes[3].id, BB_ID_MAX, "=1+1\"");
	snprintf(p->x->result->incidents[0].what, sizeof(p->x->result->incidents[0].what), "%s", FIXTURE_HOSTILE);
	*state = p;
	return bb_result_judge(p->x->result) == BB_OK ? 0 : -1;
}

static void remove_folder(const char *dir)
{
	char path[512];
	struct dirent *e;
	DIR *d = opendir(dir);

	while (d && (e = readdir(d))) {
		snprintf(path, sizeof(path), "%s/%s", dir, e->d_name);
		if (e->d_name[0] != '.')
			unlink(path);
	}
	if (d)
		closedir(d);
	rmdir(dir);
}

static int tear_down(void **state)
{
	struct place *p = *state;

	remove_folder(p->dir);
	fixture_free(p->x);
	free(p->text);
	free(p);
	return 0;
}

static const char *path_in(struct place *p, const char *name)
{
	snprintf(p->path, sizeof(p->path), "%s/%s", p->dir, name);
	return p->path;
}

static const char *read_back(struct place *p)
{
	free(p->text);
	p->text = NULL;
	assert_int_equal(bb_file_read(p->path, (size_t)256 << 20, &p->text, &p->n, NULL), BB_OK);
	return p->text;
}

static size_t occurrences(const char *text, const char *what)
{
	size_t n = 0;

	for (; (text = strstr(text, what)); text++)
		n++;
	return n;
}

/* Enough of XML to notice a broken escape: tags balance, nothing forbidden outside them. Self-closing tags and void
 * HTML elements have no partner. */
static void check_balanced(const char *text, const char *element)
{
	char open_space[40], open_end[40], close[40];

	snprintf(open_space, sizeof(open_space), "<%s ", element);
	snprintf(open_end, sizeof(open_end), "<%s>", element);
	snprintf(close, sizeof(close), "</%s>", element);
	assert_int_equal(occurrences(text, open_space) + occurrences(text, open_end), occurrences(text, close));
}

static void check_clean(const char *text)
{
	for (; *text; text++)
		if ((unsigned char)*text < 0x20 && *text != '\n' && *text != '\t')
			fail_msg("control byte %#x in a document", (unsigned)*text);
}

static void test_json(void **state)
{
	struct place *p = *state;
	json_t *root;

	p->x->result->pictures[0].psnr_db = (double)INFINITY;
	p->x->result->pictures[0].identical = true;
	p->x->result->pictures[1].psnr_db = (double)NAN;
	assert_int_equal(bb_result_write_json(p->x->result, path_in(p, "result.json"), NULL), BB_OK);
	root = json_loads(read_back(p), JSON_REJECT_DUPLICATES, NULL);
	assert_non_null(root);
	assert_int_equal(json_integer_value(json_object_get(root, "schema")), BB_RESULT_SCHEMA);
	assert_string_equal(json_string_value(json_object_get(root, "verdict")), "FAIL");
	json_t *pictures = json_object_get(root, "pictures");
	assert_true(json_real_value(json_object_get(json_array_get(pictures, 0), "psnr_db")) == 200.0);
	assert_true(json_is_null(json_object_get(json_array_get(pictures, 1), "psnr_db")));
	assert_true(json_array_size(json_object_get(root, "budgets")) == p->x->result->n_budgets);
	assert_true(json_is_integer(
		json_object_get(json_object_get(json_object_get(root, "gate"), "values"), "stage.draw.p99_ns")));
	assert_null(strstr(p->text, "nan"));
	json_decref(root);
}

static void test_same_bytes(void **state)
{
	const struct fixture_options o = { .faults = true, .n_frames = 600 };
	struct fixture *a = fixture_create(&o), *b = fixture_create(&o);
	char *x, *y;

	(void)state;
	assert_int_equal(bb_result_judge(a->result), BB_OK);
	assert_int_equal(bb_result_judge(b->result), BB_OK);
	x = bb_result_json_text(a->result);
	y = bb_result_json_text(b->result);
	assert_string_equal(x, y);
	free(x);
	free(y);
	fixture_free(a);
	fixture_free(b);
}

static void test_junit(void **state)
{
	struct place *p = *state;
	const char *text;

	assert_int_equal(bb_result_write_junit(p->x->result, path_in(p, "junit.xml"), NULL), BB_OK);
	text = read_back(p);
	check_clean(text);
	check_balanced(text, "testcase");
	check_balanced(text, "system-out");
	assert_int_equal(occurrences(text, "<testcase "), p->x->result->n_budgets);
	assert_int_equal(occurrences(text, "<failure "), 2); /* frame max, devices_ok */
	assert_non_null(strstr(text, "<skipped message=\"needs shutters at fidelity 2"));
	assert_non_null(strstr(text, "cabin &quot;&lt;&amp;&gt;&#39; ]]&gt; \xEF\xBF\xBD"));
}

static void test_csv(void **state)
{
	struct place *p = *state;
	const struct bb_frame_row bare = { .frame = 9999, .late_node = 3, .head_to_photon_ms = (double)NAN,
		.flags = BB_FRAME_TORN | BB_FRAME_MONO, .deficit = 77, .upload_ms = 0.25 };
	size_t commas;
	const char *text;

	bb_ledger_row(p->x->result->ledger, &bare);
	assert_int_equal(bb_result_write_csv(p->x->result, path_in(p, "frames.csv"), NULL), BB_OK);
	text = read_back(p);
	assert_int_equal(occurrences(text, "\n"), 602);
	commas = 0;
	for (const char *c = text; *c != '\n'; c++)
		commas += *c == ',';
	assert_int_equal(occurrences(text, ","), commas * 602);
	assert_non_null(strstr(text, ",NA,"));
	assert_non_null(strstr(text, ",\"'=1+1\"\"\",torn+mono,77,0.25,")); /* no formula for a spreadsheet */
}

static void test_trace(void **state)
{
	struct place *p = *state;
	size_t spans = 0, instants = 0, i;
	const struct bb_span *span;
	json_t *root, *e;

	assert_int_equal(bb_result_write_trace(p->x->result, path_in(p, "trace.json"), NULL), BB_OK);
	root = json_loads(read_back(p), 0, NULL);
	assert_non_null(root);
	json_array_foreach(json_object_get(root, "traceEvents"), i, e) {
		const char *ph = json_string_value(json_object_get(e, "ph"));
		spans += !strcmp(ph, "X");
		instants += !strcmp(ph, "i");
		if (!strcmp(ph, "X"))
			assert_true(json_number_value(json_object_get(e, "dur")) >= 0);
	}
	assert_int_equal(spans, bb_ledger_spans(p->x->result->ledger, &span));
	assert_true(instants > 600 * 11);
	for (const char *const *w = (const char *const[]){ "vsync front", "shutter glasses", "strobe c1", "barrier ",
		     "incidents", "planted faults", "node right", NULL }; *w; w++)
		assert_non_null(strstr(p->text, *w));
	json_decref(root);
}

static void test_edges(void **state)
{
	struct place *p = *state;

	assert_int_equal(bb_result_write_edges(p->x->result, path_in(p, "edges.csv"), NULL), BB_OK);
	read_back(p);
	assert_int_equal(strncmp(p->text, "t_ns,track,eye,event\n", 21), 0);
	for (const char *const *w = (const char *const[]){ ",vblank:front,NA,flip\n", ",glasses,left,open\n",
		     ",glasses,right,open\n", ",strobe:c1,NA,mid\n", NULL }; *w; w++)
		assert_non_null(strstr(p->text, *w));
	assert_null(strstr(p->text, "barrier"));
}

/* Spans of one thread of a trace must nest or be apart: a viewer drops what overlaps. */
static void test_trace_lanes(void **state)
{
	struct place *p = *state;
	json_t *root, *e;
	size_t i;
	double *end = calloc(1 << 16, sizeof(*end));

	assert_int_equal(bb_result_write_trace(p->x->result, path_in(p, "trace.json"), NULL), BB_OK);
	root = json_loads(read_back(p), 0, NULL);
	json_array_foreach(json_object_get(root, "traceEvents"), i, e) {
		if (strcmp(json_string_value(json_object_get(e, "ph")), "X"))
			continue;
		const size_t thread = (size_t)(json_integer_value(json_object_get(e, "pid")) * 1024 +
		                               json_integer_value(json_object_get(e, "tid")));
		const double ts = json_number_value(json_object_get(e, "ts"));
		assert_true(thread < (1 << 16));
		assert_true(ts >= end[thread] - 0.0005);
		end[thread] = ts + json_number_value(json_object_get(e, "dur"));
	}
	free(end);
	json_decref(root);
}

static void test_html(void **state)
{
	struct place *p = *state;
	const char *text;

	assert_int_equal(bb_report_html_write(p->x->result, p->dir, path_in(p, "report.html"), "<svg id=\"plan\"></svg>",
	                                      NULL), BB_OK);
	text = read_back(p);
	check_clean(text);
	for (const char *const *tag = (const char *const[]){ "table", "tr", "td", "div", "section", "svg", "figure",
	                                                     "text", "title", "span", NULL };
	     *tag; tag++)
		check_balanced(text, *tag);
	assert_null(strstr(text, "<script"));
	assert_null(strstr(text, "http://"));
	assert_null(strstr(text, "https://"));
	assert_null(strstr(text, "=nan"));
	assert_null(strstr(text, "\"nan"));
	assert_non_null(strstr(text, "&lt;script&gt;alert"));
	assert_non_null(strstr(text, "<svg id=\"plan\">"));
	assert_int_equal(occurrences(text, "<img "), 30);
	for (const char *const *id = (const char *const[]){ "verdicts", "trouble", "latency", "time", "room", "pictures",
		     "devices", "counters", "configuration", "versions", NULL }; *id; id++) {
		char want[40];
		snprintf(want, sizeof(want), "<section id=\"%s\">", *id);
		assert_non_null(strstr(text, want));
	}
}

/* Nodes of which one draws nothing and one has no limits and could not read; first in time, then late by bricks. */
static void fill_streaming(struct bb_run_result *r)
{
	struct bb_stream_result *s = &r->streaming;
	const struct bb_stream_load load = { .frame = 9, .at_ns = 3 * BB_NS_PER_S, .bricks = 1, .bytes = 2048, .ms = 0.5,
		                             .frame_ms = 4 };

	s->nodes = calloc(r->room->n_nodes, sizeof(*s->nodes));
	assert_non_null(s->nodes);
	s->n_nodes = r->room->n_nodes;
	s->limit_ms = 8;
	s->data_bytes = 8 << 20;
	s->nodes[1] = (struct bb_stream_node){ .frames = 10, .budget_bytes = 2 << 20, .held_bytes = 1 << 20, .budget_bricks = 24,
		.loaded = { 50, 12 }, .deficit = { 15, 4 }, .most = load, .load_sum_ms = 2 };
	s->nodes[2] = (struct bb_stream_node){ .frames = 10, .failed = 3, .odd = 2, .error = 1441 };
	snprintf(s->nodes[2].error_text, sizeof(s->nodes[2].error_text), "BB1441: <script>alert(1)</script>");
}

static void test_streaming(void **state)
{
	struct place *p = *state;
	struct bb_run_result *r = p->x->result;
	struct bb_stream_node *late;
	char sentence[256];
	const char *text;

	bb_result_loads(r, sentence, sizeof(sentence));
	assert_string_equal(sentence, "");
	fill_streaming(r);
	bb_result_loads(r, sentence, sizeof(sentence));
	assert_string_equal(sentence, "no brick load spent a frame; the most was 0.500 ms of 8.00 ms, on node/left at 3.000 s (1 "
	                              "brick, 2.0 KiB)");
	char *json = bb_result_json_text(r);
	json_t *root = json_loads(json, 0, NULL), *nodes = json_object_get(json_object_get(root, "streaming"), "nodes");
	const json_t *first = json_array_get(nodes, 0), *second = json_array_get(nodes, 1);
	assert_int_equal(json_array_size(nodes), 2);
	assert_true(json_number_value(json_object_get(first, "data_over_memory")) == 4);
	assert_true(json_number_value(json_object_get(json_object_get(first, "bricks_read"), "mean")) == 5);
	assert_int_equal(json_integer_value(json_object_get(json_object_get(first, "deficit_cells"), "most")), 4);
	assert_true(json_number_value(json_object_get(first, "mean_load_share_of_limit")) == 0.2 / 8);
	assert_true(json_is_null(json_object_get(second, "memory_budget_bytes")));
	assert_true(json_is_null(json_object_get(second, "data_over_memory")));
	assert_int_equal(json_integer_value(json_object_get(second, "error")), 1441);
	json_decref(root);
	free(json);

	late = &r->streaming.nodes[2];
	late->late = 7;
	late->worst = (struct bb_stream_load){ .frame = 4, .at_ns = BB_NS_PER_S, .bricks = 8, .bytes = 8192, .ms = 6, .frame_ms = 11 };
	bb_result_loads(r, sentence, sizeof(sentence));
	assert_string_equal(sentence, "brick loads made 7 frames late; the worst at 1.000 s: node/right read 8 bricks (8.0 KiB), "
	                              "6.000 ms of a frame of 11.000 ms (limit 8.00 ms)");
	assert_int_equal(bb_report_html_write(r, p->dir, path_in(p, "report.html"), NULL, NULL), BB_OK);
	text = read_back(p);
	check_clean(text);
	for (const char *const *tag = (const char *const[]){ "table", "tr", "td", "th", "p", "section", "svg", NULL }; *tag; tag++)
		check_balanced(text, *tag);
	assert_non_null(strstr(text, "id=\"streaming\""));
	assert_non_null(strstr(text, "Brick loads made 7 frames late"));
	assert_non_null(strstr(text, "3 bricks could not be read"));
	assert_non_null(strstr(text, "4 times what a node may hold"));
	assert_null(strstr(text, "<script"));
}

static void test_html_of_nothing(void **state)
{
	struct place *p = *state;
	const struct fixture_options o = { .n_frames = 0 };
	struct fixture *x = fixture_create(&o);

	assert_int_equal(bb_result_judge(x->result), BB_OK);
	assert_int_equal(bb_report_html_write(x->result, NULL, path_in(p, "empty.html"), NULL, NULL), BB_OK);
	assert_null(strstr(read_back(p), "=\"nan"));
	assert_null(strstr(p->text, "=\"inf"));
	fixture_free(x);
}

static void test_pictures_stay_inside(void **state)
{
	struct place *p = *state;

	fixture_png("build/test_result_outside.png", 0, 0);
	snprintf(p->x->result->pictures[0].file, sizeof(p->x->result->pictures[0].file), "../test_result_outside.png");
	snprintf(p->x->result->pictures[1].file, sizeof(p->x->result->pictures[1].file), "absent.png");
	assert_int_equal(bb_report_html_write(p->x->result, p->dir, path_in(p, "report.html"), NULL, NULL), BB_OK);
	assert_int_equal(occurrences(read_back(p), "not embedded"), 2);
	unlink("build/test_result_outside.png");
}

static size_t files_in(const char *dir)
{
	struct dirent *e;
	DIR *d = opendir(dir);
	size_t n = 0;

	while ((e = readdir(d)))
		n += e->d_name[0] != '.';
	closedir(d);
	return n;
}

/* A full disk at any byte: the old file is still whole, no debris. A file size limit stands in for the disk. */
static void test_old_or_new(void **state)
{
	struct place *p = *state;
	struct rlimit old, small;
	struct bb_error err = { 0 };
	size_t before;

	assert_int_equal(bb_result_write_json(p->x->result, path_in(p, "result.json"), NULL), BB_OK);
	read_back(p);
	const size_t n = p->n;
	before = files_in(p->dir);
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
	signal(SIGXFSZ, SIG_IGN);
	for (rlim_t at = 0; at < n; at += 1009) {
		small = (struct rlimit){ at, old.rlim_max };
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
		err.number = 0;
		const enum bb_status st = bb_result_write_json(p->x->result, p->path, &err);
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
		assert_int_equal(st, BB_ERR_IO);
		assert_int_equal(err.number, 1901);
	}
	assert_int_equal(files_in(p->dir), before);
	read_back(p);
	assert_int_equal(p->n, n);
}

static void test_folder_is_missing(void **state)
{
	struct place *p = *state;
	struct bb_error err = { 0 };

	assert_int_equal(bb_result_write_json(p->x->result, path_in(p, "no/result.json"), &err), BB_ERR_IO);
	assert_int_equal(err.number, 1901);
}

static void check_text(void (*put)(FILE *, const char *), const char *in, const char *want)
{
	char *out = NULL;
	size_t n;
	FILE *f = open_memstream(&out, &n);

	put(f, in);
	fclose(f);
	assert_string_equal(out, want);
	free(out);
}

static void test_escapes(void **state)
{
	char out[8];

	(void)state;
	check_text(bb_put_markup, "<a href='x'>&\"", "&lt;a href=&#39;x&#39;&gt;&amp;&quot;");
	check_text(bb_put_markup, "\x1b[31m", "\xEF\xBF\xBD[31m");
	check_text(bb_put_markup, "\xC0\xAF\xED\xA0\x80",
	           "\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD");
	check_text(bb_put_markup, "\xE2\x82", "\xEF\xBF\xBD\xEF\xBF\xBD"); /* cut in the middle */
	check_text(bb_put_markup, "\xEF\xBF\xBE", "\xEF\xBF\xBD\xEF\xBF\xBD\xEF\xBF\xBD");
	check_text(bb_put_markup, "gr\xC3\xBC\xC3\x9F \xF0\x9F\x98\x80", "gr\xC3\xBC\xC3\x9F \xF0\x9F\x98\x80");
	check_text(bb_put_json, "a\"\\\n\x02", "\"a\\\"\\\\\\n\\ufffd\"");
	check_text(bb_put_csv, "=cmd|' /C calc'!A0", "\"'=cmd|' /C calc'!A0\"");
	check_text(bb_put_csv, "a,\"b\"", "\"a,\"\"b\"\"\"");
	bb_text_clean(out, sizeof(out), "abcdef\xC3\xBCg");
	assert_string_equal(out, "abcdef"); /* never half a character */
	assert_string_equal(bb_text_number(out, sizeof(out), 8.333333), "8.333");
	assert_string_equal(bb_text_number(out, sizeof(out), 123456), "123456");
	assert_string_equal(bb_text_number(out, sizeof(out), (double)NAN), "n/a");
}

static void test_base64(void **state)
{
	static const char *const rows[][2] = { { "", "" },
		                               { "f", "Zg==" },
		                               { "fo", "Zm8=" },
		                               { "foo", "Zm9v" },
		                               { "foob", "Zm9vYg==" },
		                               { "fooba", "Zm9vYmE=" },
		                               { "foobar", "Zm9vYmFy" } };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) { /* RFC 4648, section 10 */
		char *out = NULL;
		size_t n;
		FILE *f = open_memstream(&out, &n);
		bb_put_base64(f, (const unsigned char *)rows[i][0], strlen(rows[i][0]));
		fclose(f);
		assert_string_equal(out, rows[i][1]);
		free(out);
	}
}

static void test_counters(void **state)
{
	struct bb_run_result *r = calloc(1, sizeof(*r));
	char name[16];

	(void)state;
	for (int i = 0; i < 200; i++) {
		snprintf(name, sizeof(name), "c%d", i);
		bb_result_count(r, name, 1);
		bb_result_count(r, "c0", 1);
		bb_result_fact(r, name, "%d", i);
	}
	assert_int_equal(r->n_counters, BB_COUNTERS_MAX);
	assert_int_equal(r->counters[0].value, 201);
	assert_int_equal(r->n_facts, BB_ARRAY_LEN(r->facts));
	bb_run_result_free(r);
	bb_run_result_free(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(test_json, set_up, tear_down),
		cmocka_unit_test(test_same_bytes),
		cmocka_unit_test_setup_teardown(test_junit, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_csv, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_trace, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_edges, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_trace_lanes, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_html, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_streaming, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_html_of_nothing, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_pictures_stay_inside, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_old_or_new, set_up, tear_down),
		cmocka_unit_test_setup_teardown(test_folder_is_missing, set_up, tear_down),
		cmocka_unit_test(test_escapes),
		cmocka_unit_test(test_base64),
		cmocka_unit_test(test_counters),
	};

	mkdir("build", 0777);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
