/*
 * bench/report/junit.c: junit.xml for CI: one test case a budget. FAIL is a failure, INCONCLUSIVE an error (nothing was
 * proved), SKIP says why, MARGINAL passes and says so. One thread.
 */
#include "bench/file.h"
#include "bench/result.h"

#include <math.h>

static void put_attribute(FILE *f, const char *name, const char *value)
{
	fprintf(f, " %s=\"", name);
	bb_put_markup(f, value);
	fputc('"', f);
}

static void put_element(FILE *f, const char *element, const char *type, const char *message)
{
	fprintf(f, "      <%s", element);
	put_attribute(f, "message", message);
	if (type)
		put_attribute(f, "type", type);
	fputs("/>\n", f);
}

static void put_case(FILE *f, const struct bb_run_result *r, const struct bb_budget_result *b)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	char name[256], value[32], limit[32], message[512];

	bb_text_format(name, sizeof(name), "%s %s", info->name, bb_stat_text(b->budget.stat));
	fputs("    <testcase", f);
	put_attribute(f, "name", name);
	bb_text_format(name, sizeof(name), "%s.%s", r->room->name, r->scene->name);
	put_attribute(f, "classname", name);
	fputs(" time=\"0\"", f);
	if (b->budget.where.file) {
		put_attribute(f, "file", b->budget.where.file);
		fprintf(f, " line=\"%d\"", b->budget.where.line);
	}
	fputs(">\n", f);
	bb_text_format(message, sizeof(message), "%s %s, limit %s %s%s%s",
	               bb_text_number(value, sizeof(value), b->value), info->unit,
	               bb_text_number(limit, sizeof(limit), b->budget.limit), info->unit, b->cause[0] ? ": " : "",
	               b->cause);
	if (b->verdict == BB_FAIL)
		put_element(f, "failure", b->culprit, message);
	else if (b->verdict == BB_INCONCLUSIVE)
		put_element(f, "error", "INCONCLUSIVE", message);
	else if (b->verdict == BB_SKIP)
		put_element(f, "skipped", NULL, b->cause);
	fputs("      <system-out>", f);
	bb_put_markup(f, bb_verdict_text(b->verdict));
	fputs(" ", f);
	bb_put_markup(f, message);
	fputs("</system-out>\n    </testcase>\n", f);
}

static size_t count_of(const struct bb_run_result *r, enum bb_verdict v)
{
	size_t n = 0;

	for (size_t i = 0; i < r->n_budgets; i++)
		n += r->budgets[i].verdict == v;
	return n;
}

static void put_suite(FILE *f, const struct bb_run_result *r)
{
	char name[256];

	fprintf(f, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n  <testsuite");
	bb_text_format(name, sizeof(name), "%s x %s", r->room->name, r->scene->name);
	put_attribute(f, "name", name);
	fprintf(f, " tests=\"%zu\" failures=\"%zu\" errors=\"%zu\" skipped=\"%zu\" time=\"%.3f\">\n", r->n_budgets,
	        count_of(r, BB_FAIL), count_of(r, BB_INCONCLUSIVE), count_of(r, BB_SKIP),
	        isfinite(r->wall_time_s) ? r->wall_time_s : 0);
	fprintf(f, "    <properties>\n      <property name=\"seed\" value=\"%llu\"/>\n", (unsigned long long)r->seed);
	for (size_t i = 0; i < r->n_facts; i++) {
		fputs("      <property", f);
		put_attribute(f, "name", r->facts[i].key);
		put_attribute(f, "value", r->facts[i].value);
		fputs("/>\n", f);
	}
	fputs("    </properties>\n", f);
	for (size_t i = 0; i < r->n_budgets; i++)
		put_case(f, r, &r->budgets[i]);
	fputs("  </testsuite>\n</testsuites>\n", f);
}

enum bb_status bb_result_write_junit(const struct bb_run_result *r, const char *path, struct bb_error *err)
{
	struct bb_file f;
	enum bb_status st = bb_file_begin(&f, path, err);

	if (st != BB_OK)
		return st;
	put_suite(f.out, r);
	return bb_file_commit(&f, err);
}
