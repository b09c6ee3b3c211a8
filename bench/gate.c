/*
 * bench/gate.c: makes, stores, loads and compares the numbers of bench/gate.h. One thread.
 */
#include "bench/gate.h"

#include "bench/cli.h"
#include "bench/file.h"
#include "bench/stats.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define GATE_FILE_MOST ((size_t)64 << 20)

const char *bb_gate_text(enum bb_gate_outcome o)
{
	static const char *const text[] = { "same", "improved", "regressed", "changed", "not comparable" };

	return (size_t)o < BB_ARRAY_LEN(text) ? text[o] : "?";
}

/* ---- making ---- */

static bool ends_with(const char *text, const char *end)
{
	const size_t n = strlen(text), m = strlen(end);

	return n >= m && !strcmp(text + n - m, end);
}

static void set_hex(json_t *o, const char *key, const uint8_t sha256[32])
{
	char hex[65];

	for (size_t i = 0; i < 32; i++)
		snprintf(hex + 2 * i, 3, "%02x", sha256[i]);
	json_object_set_new(o, key, json_string(hex));
}

static json_t *inputs_of(const struct bb_run_result *r)
{
	json_t *o = json_object();
	char text[32];

	set_hex(o, "room_sha256", r->room->sha256);
	set_hex(o, "scene_sha256", r->scene->sha256);
	bb_text_format(text, sizeof(text), "%llu", (unsigned long long)r->seed);
	json_object_set_new(o, "seed", json_string(text));
	json_object_set_new(o, "clock", json_string(r->clock));
	bb_text_format(text, sizeof(text), "%.9f", r->duration_s);
	json_object_set_new(o, "duration_s", json_string(text));
	for (size_t i = 0; i < r->n_facts; i++)
		if (ends_with(r->facts[i].key, "_sha256"))
			json_object_set_new(o, r->facts[i].key, json_string(r->facts[i].value));
	for (int c = 0; c < BB_CLASS_COUNT; c++) {
		bb_text_format(text, sizeof(text), "needs.%s", bb_class_text((enum bb_class)c));
		json_object_set_new(o, text, json_integer(r->scene->needs[c]));
	}
	return o;
}

static void set_ns(json_t *o, const char *stage, const char *stat, double ms)
{
	char key[64];

	bb_text_format(key, sizeof(key), "stage.%s.%s_ns", stage, stat);
	json_object_set_new(o, key, json_integer(isfinite(ms) ? llround(ms * 1e6) : 0));
}

static void set_stages(json_t *values, const struct bb_run_result *r)
{
	for (size_t i = 0; i < r->n_stages; i++) {
		const struct bb_stage_result *s = &r->stages[i];
		const char *name = bb_stage_text(s->stage);
		if (s->node != UINT16_MAX)
			continue;
		set_ns(values, name, "p50", s->summary.p50);
		set_ns(values, name, "p99", s->summary.p99);
		set_ns(values, name, "max", s->summary.max);
		/* The sum tells of a change in frames that are neither the median nor the worst. */
		set_ns(values, name, "sum", s->summary.mean * (double)s->summary.n);
	}
}

static void set_pictures(json_t *values, const struct bb_run_result *r)
{
	for (size_t i = 0; i < r->n_pictures; i++) {
		const struct bb_picture_result *p = &r->pictures[i];
		char raw[128], key[128];
		if (isnan(p->psnr_db))
			continue;
		bb_text_format(raw, sizeof(raw), "psnr.%s.%s.%.3fs_udb", p->wall, p->eye, p->at_s);
		bb_text_clean(key, sizeof(key), raw);
		json_object_set_new(values, key, json_integer(llround(fmin(p->psnr_db, 200) * 1e6)));
	}
}

json_t *bb_gate_section(const struct bb_run_result *r)
{
	json_t *o = json_object(), *values = json_object();

	for (size_t i = 0; i < r->n_counters; i++) {
		char key[64];
		bb_text_format(key, sizeof(key), "counter.%s", r->counters[i].name);
		json_object_set_new(values, key, json_integer((json_int_t)(r->counters[i].value & INT64_MAX)));
	}
	json_object_set_new(values, "events", json_integer((json_int_t)(r->n_events & INT64_MAX)));
	set_stages(values, r);
	set_pictures(values, r);
	json_object_set_new(o, "inputs", inputs_of(r));
	json_object_set_new(o, "event_log_sha256", json_string(r->event_log_sha256));
	json_object_set_new(o, "values", values);
	return o;
}

json_t *bb_gate_file(void)
{
	json_t *o = json_object();

	json_object_set_new(o, "schema", json_integer(BB_RESULT_SCHEMA));
	json_object_set_new(o, "kind", json_string("blackburst-bench"));
	json_object_set_new(o, "facts", json_object());
	json_object_set_new(o, "scenarios", json_object());
	return o;
}

void bb_gate_file_add(json_t *file, const char *scenario, const struct bb_run_result *r)
{
	for (size_t i = 0; i < r->n_facts; i++)
		if (!ends_with(r->facts[i].key, "_sha256"))
			json_object_set_new(json_object_get(file, "facts"), r->facts[i].key,
			                    json_string(r->facts[i].value));
	json_object_set_new(json_object_get(file, "scenarios"), scenario, bb_gate_section(r));
}

enum bb_status bb_gate_store(const json_t *file, const char *path, struct bb_error *err)
{
	struct bb_file f;
	enum bb_status st = bb_file_begin(&f, path, err);

	if (st != BB_OK)
		return st;
	if (json_dumpf(file, f.out, JSON_INDENT(1) | JSON_SORT_KEYS)) {
		bb_file_abort(&f);
		return bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ path, 0, 0 }, "cannot write JSON");
	}
	fputc('\n', f.out);
	return bb_file_commit(&f, err);
}

/* ---- loading ---- */

static enum bb_status not_ours(const char *path, int line, struct bb_error *err, const char *what)
{
	const struct bb_where where = { path, line, 0 };

	return bb_fail(err, BB_ERR_FORMAT, 1903, &where, "%s", what);
}

static bool section_is_sound(const json_t *section)
{
	const json_t *values = json_object_get(section, "values"), *inputs = json_object_get(section, "inputs");
	const char *key;
	json_t *v;

	if (!json_is_object(values) || !json_is_object(inputs) ||
	    !json_is_string(json_object_get(section, "event_log_sha256")))
		return false;
	json_object_foreach((json_t *)(uintptr_t)values, key, v)
		if (!json_is_integer(v))
			return false;
	return true;
}

/* A result.json is a bench file with one scenario, named after its room and scene. */
static json_t *from_result(const json_t *root)
{
	const char *room = json_string_value(json_object_get(json_object_get(root, "room"), "name"));
	const char *scene = json_string_value(json_object_get(json_object_get(root, "scene"), "name"));
	json_t *file = bb_gate_file();
	char name[140];

	bb_text_format(name, sizeof(name), "%s x %s", room ? room : "?", scene ? scene : "?");
	json_object_set(file, "facts", json_object_get(root, "facts"));
	json_object_set(json_object_get(file, "scenarios"), name, json_object_get(root, "gate"));
	return file;
}

static enum bb_status check_file(const char *path, const json_t *file, struct bb_error *err)
{
	json_t *scenarios = json_object_get(file, "scenarios"), *section;
	const char *name;

	if (!json_object_size(scenarios) || !json_is_object(json_object_get(file, "facts")))
		return not_ours(path, 0, err, "its sections are missing");
	json_object_foreach(scenarios, name, section)
		if (!section_is_sound(section))
			return not_ours(path, 0, err, "a scenario's values are missing or not whole numbers");
	return BB_OK;
}

static enum bb_status accept(const char *path, json_t *root, json_t **out, struct bb_error *err)
{
	const char *kind = json_string_value(json_object_get(root, "kind"));
	const json_t *schema = json_object_get(root, "schema");
	enum bb_status st;

	if (!kind || !json_is_integer(schema))
		return not_ours(path, 0, err, "no kind and schema in it");
	if (json_integer_value(schema) != BB_RESULT_SCHEMA)
		return not_ours(path, 0, err, "another schema version");
	if (!strcmp(kind, "blackburst-result"))
		*out = from_result(root);
	else if (!strcmp(kind, "blackburst-bench"))
		*out = json_incref(root);
	else
		return not_ours(path, 0, err, "another kind of file");
	st = check_file(path, *out, err);
	if (st != BB_OK) {
		json_decref(*out);
		*out = NULL;
	}
	return st;
}

enum bb_status bb_gate_load(const char *path, json_t **out, struct bb_error *err)
{
	json_error_t je;
	json_t *root;
	enum bb_status st;
	char *text;
	size_t n;

	*out = NULL;
	if (access(path, F_OK) && (errno == ENOENT || errno == ENOTDIR))
		return bb_fail(err, BB_ERR_IO, 1902, &(struct bb_where){ path, 0, 0 }, "no such file");
	st = bb_file_read(path, GATE_FILE_MOST, &text, &n, err);
	if (st != BB_OK)
		return st;
	root = json_loadb(text, n, JSON_REJECT_DUPLICATES, &je);
	free(text);
	if (!root)
		return not_ours(path, je.line > 0 ? je.line : 0, err, je.text);
	st = accept(path, root, out, err);
	json_decref(root);
	return st;
}

/* ---- comparing ---- */

enum direction { NEUTRAL, COST, QUALITY };

/* By the words of a name. What is not known to be a cost or a gain must not change without a reason. */
static enum direction direction_of(const char *name)
{
	static const char *const costs[] = { "bytes",    "bricks",  "rays",      "samples",  "uploads", "events",
		                             "ops",      "steps",   "wanted",    "missing",  "dropped", "late",
		                             "torn",     "swaps",   "swapped",   "old",      "clamped", "lost",
		                             "retries",  "evicted", "evictions", "timeouts", "loaded",  "streamed",
		                             "messages", "misses",  "ns" };
	static const char *const gains[] = { "hits", "udb", "resident" };
	char copy[128], *save = NULL;

	bb_text_format(copy, sizeof(copy), "%s", name);
	for (char *word = strtok_r(copy, "._", &save); word; word = strtok_r(NULL, "._", &save)) {
		for (size_t i = 0; i < BB_ARRAY_LEN(gains); i++)
			if (!strcmp(word, gains[i]))
				return QUALITY;
		for (size_t i = 0; i < BB_ARRAY_LEN(costs); i++)
			if (!strcmp(word, costs[i]))
				return COST;
	}
	return NEUTRAL;
}

static struct bb_gate_line *add_line(struct bb_gate_report *out, const char *scenario, const char *name,
                                     enum bb_gate_outcome outcome, const char *reason)
{
	static const int rank[] = { [BB_GATE_SAME] = 0, [BB_GATE_IMPROVED] = 1, [BB_GATE_INCOMPARABLE] = 2,
		                    [BB_GATE_CHANGED] = 3, [BB_GATE_REGRESSED] = 4 };
	struct bb_gate_line *l;

	if (rank[outcome] > rank[out->outcome])
		out->outcome = outcome;
	if (out->n_lines == BB_GATE_LINES_MAX) {
		out->n_unlisted++;
		return NULL;
	}
	l = &out->line[out->n_lines++];
	*l = (struct bb_gate_line){ .percent = BB_UNKNOWN, .outcome = outcome };
	bb_text_clean(l->scenario, sizeof(l->scenario), scenario);
	bb_text_clean(l->name, sizeof(l->name), name);
	bb_text_clean(l->reason, sizeof(l->reason), reason);
	return l;
}

static void compare_value(struct bb_gate_report *out, const char *scenario, const char *name, const json_t *base,
                          const json_t *now)
{
	const long long b = json_integer_value(base), n = json_integer_value(now);
	const enum direction dir = direction_of(name);
	enum bb_gate_outcome outcome = BB_GATE_CHANGED;
	struct bb_gate_line *l;

	out->n_compared++;
	if (base && now && b == n)
		return;
	if (base && now && dir != NEUTRAL)
		outcome = (n > b) == (dir == COST) ? BB_GATE_REGRESSED : BB_GATE_IMPROVED;
	l = add_line(out, scenario, name, outcome,
	             !base            ? "not in the baseline"
	             : !now           ? "no longer counted"
	             : dir == NEUTRAL ? "must not change"
	                              : "");
	if (!l)
		return;
	bb_text_format(l->base, sizeof(l->base), base ? "%lld" : "-", b);
	bb_text_format(l->now, sizeof(l->now), now ? "%lld" : "-", n);
	if (base && now && b)
		l->percent = 100.0 * ((double)n - (double)b) / fabs((double)b);
}

/* Says the first difference of the inputs; false when there is one. */
static bool same_inputs(struct bb_gate_report *out, const char *scenario, json_t *base, json_t *now)
{
	const char *key, *clock = json_string_value(json_object_get(base, "clock"));
	json_t *v;

	json_object_foreach(base, key, v)
		if (!json_equal(v, json_object_get(now, key))) {
			add_line(out, scenario, key, BB_GATE_INCOMPARABLE, "the inputs differ");
			return false;
		}
	json_object_foreach(now, key, v)
		if (!json_object_get(base, key)) {
			add_line(out, scenario, key, BB_GATE_INCOMPARABLE, "an input the baseline does not have");
			return false;
		}
	if (clock && !strcmp(clock, "virtual"))
		return true;
	add_line(out, scenario, "clock", BB_GATE_INCOMPARABLE, "only runs on the virtual clock repeat exactly");
	return false;
}

static void compare_log(struct bb_gate_report *out, const char *scenario, const json_t *base, const json_t *now,
                        size_t lines_before)
{
	const char *b = json_string_value(json_object_get(base, "event_log_sha256"));
	const char *n = json_string_value(json_object_get(now, "event_log_sha256"));
	struct bb_gate_line *l;

	out->n_compared++;
	/* A counter that moved explains a log that moved: it has its own line and its own verdict. */
	if (!strcmp(b, n) || out->n_lines + out->n_unlisted > lines_before)
		return;
	l = add_line(out, scenario, "event_log_sha256", BB_GATE_CHANGED, "other events although every counter is equal");
	if (!l)
		return;
	bb_text_format(l->base, sizeof(l->base), "%.12s", b);
	bb_text_format(l->now, sizeof(l->now), "%.12s", n);
}

static bool is_picture(const char *key)
{
	return !strncmp(key, "psnr.", 5);
}

static bool has_pictures(json_t *values)
{
	const char *key;
	json_t *v;

	json_object_foreach(values, key, v)
		if (is_picture(key))
			return true;
	return false;
}

static void compare_scenario(struct bb_gate_report *out, const char *scenario, const json_t *base, const json_t *now,
                             bool same_machine)
{
	json_t *vb = json_object_get(base, "values"), *vn = json_object_get(now, "values"), *v;
	const size_t before = out->n_lines + out->n_unlisted;
	/* Other machines round pictures otherwise; and a run that drew none says nothing about them. */
	const bool pictures = same_machine && has_pictures(vb) && has_pictures(vn);
	const char *key;

	if (!same_inputs(out, scenario, json_object_get(base, "inputs"), json_object_get(now, "inputs")))
		return;
	json_object_foreach(vb, key, v)
		if (pictures || !is_picture(key))
			compare_value(out, scenario, key, v, json_object_get(vn, key));
	json_object_foreach(vn, key, v)
		if (!json_object_get(vb, key) && (pictures || !is_picture(key)))
			compare_value(out, scenario, key, NULL, v);
	if (same_machine)
		compare_log(out, scenario, base, now, before);
}

void bb_gate_compare(const json_t *base, const json_t *now, struct bb_gate_report *out)
{
	json_t *sb = json_object_get(base, "scenarios"), *sn = json_object_get(now, "scenarios"), *section;
	const bool same_machine = json_equal(json_object_get(json_object_get(base, "facts"), "machine"),
	                                     json_object_get(json_object_get(now, "facts"), "machine")) ||
	                          (!json_object_get(json_object_get(base, "facts"), "machine") &&
	                           !json_object_get(json_object_get(now, "facts"), "machine"));
	const char *name;

	memset(out, 0, sizeof(*out));
	json_object_foreach(sb, name, section) {
		const json_t *other = json_object_get(sn, name);
		if (other)
			compare_scenario(out, name, section, other, same_machine);
		else
			add_line(out, name, "", BB_GATE_INCOMPARABLE, "this scenario was not run again");
	}
	json_object_foreach(sn, name, section)
		if (!json_object_get(sb, name))
			add_line(out, name, "", BB_GATE_INCOMPARABLE, "this scenario is not in the baseline");
	if (!json_object_size(sb) && !json_object_size(sn))
		add_line(out, "", "", BB_GATE_INCOMPARABLE, "there is no scenario in either file");
}

int bb_gate_exit_code(const struct bb_gate_report *report)
{
	switch (report->outcome) {
	case BB_GATE_SAME:
	case BB_GATE_IMPROVED:
		return BB_EXIT_OK;
	case BB_GATE_REGRESSED:
	case BB_GATE_CHANGED:
		return BB_EXIT_FAILED;
	case BB_GATE_INCOMPARABLE:
		return BB_EXIT_INCONCLUSIVE;
	}
	return BB_EXIT_INTERNAL;
}

static const char *tint(enum bb_gate_outcome o, bool colour)
{
	static const char *const ansi[] = { [BB_GATE_SAME] = "", [BB_GATE_IMPROVED] = "\033[32m",
		                            [BB_GATE_REGRESSED] = "\033[31m", [BB_GATE_CHANGED] = "\033[31m",
		                            [BB_GATE_INCOMPARABLE] = "\033[35m" };

	return colour ? ansi[o] : "";
}

void bb_gate_print(const struct bb_gate_report *report, FILE *out, bool colour)
{
	const char *scenario = NULL;

	for (size_t i = 0; i < report->n_lines; i++) {
		const struct bb_gate_line *l = &report->line[i];
		char percent[24] = "";
		if (l->outcome == BB_GATE_INCOMPARABLE) {
			fprintf(out, "%s%s: %s%s%s: %s%s%s\n", i ? "\n" : "", l->scenario, tint(l->outcome, colour),
			        bb_gate_text(l->outcome), colour ? "\033[0m" : "", l->name, l->name[0] ? ": " : "",
			        l->reason);
			continue;
		}
		if (!scenario || strcmp(scenario, l->scenario))
			fprintf(out, "%s%s\n  %-34s %16s %16s %9s  %s\n", i ? "\n" : "", l->scenario, "value",
			        "baseline", "now", "change", "verdict");
		scenario = l->scenario;
		if (!isnan(l->percent))
			bb_text_format(percent, sizeof(percent), "%+.3g %%", l->percent);
		fprintf(out, "  %-34s %16s %16s %9s  %s%s%s%s%s\n", l->name, l->base, l->now, percent,
		        tint(l->outcome, colour), bb_gate_text(l->outcome), colour ? "\033[0m" : "",
		        l->reason[0] ? ": " : "", l->reason);
	}
	if (report->n_unlisted)
		fprintf(out, "  ... and %zu more\n", report->n_unlisted);
	fprintf(out, "%s%s%s%s: %zu values compared, %zu differ\n", report->n_lines ? "\n" : "",
	        tint(report->outcome, colour), bb_gate_text(report->outcome), colour ? "\033[0m" : "",
	        report->n_compared, report->n_lines + report->n_unlisted);
}

json_t *bb_gate_report_json(const struct bb_gate_report *report)
{
	json_t *o = json_object(), *lines = json_array();

	json_object_set_new(o, "schema", json_integer(BB_RESULT_SCHEMA));
	json_object_set_new(o, "kind", json_string("blackburst-compare"));
	json_object_set_new(o, "outcome", json_string(bb_gate_text(report->outcome)));
	json_object_set_new(o, "exit_code", json_integer(bb_gate_exit_code(report)));
	json_object_set_new(o, "compared", json_integer((json_int_t)report->n_compared));
	json_object_set_new(o, "unlisted", json_integer((json_int_t)report->n_unlisted));
	for (size_t i = 0; i < report->n_lines; i++) {
		const struct bb_gate_line *l = &report->line[i];
		json_t *e = json_object();
		json_object_set_new(e, "scenario", json_string(l->scenario));
		json_object_set_new(e, "name", json_string(l->name));
		json_object_set_new(e, "baseline", json_string(l->base));
		json_object_set_new(e, "now", json_string(l->now));
		json_object_set_new(e, "percent", isfinite(l->percent) ? json_real(l->percent) : json_null());
		json_object_set_new(e, "outcome", json_string(bb_gate_text(l->outcome)));
		json_object_set_new(e, "reason", json_string(l->reason));
		json_array_append_new(lines, e);
	}
	json_object_set_new(o, "differences", lines);
	return o;
}
