/*
 * bench/cmd/trade_device.c: `trade ROOM SCENE --device cameras`: the same scene at two fidelities of one device class, one
 * above the other. Where they give the same verdict, the ratio of their costs is what the scene pays for nothing.
 */
#include "bench/cmd/trade.h"
#include "bench/file.h"
#include "bench/run.h"
#include "bench/stats.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#define FIDELITIES 2 /* of 0 ideal, 1 timing, geometry and noise, 2 pictures and optics: --from and the next */

struct point { /* one fidelity */
	int fidelity;
	struct bb_run run;
	uint64_t class_events, class_ops, events, ops, steps;
	double cpu_ms;
};

/* CPU time of this process: a figure for people, nothing decides by it. */
static double cpu_ms(void)
{
	struct rusage u;

	if (getrusage(RUSAGE_SELF, &u))
		return BB_UNKNOWN;
	return (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) * 1e3 +
	       (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec) * 1e-3;
}

static bool find_class(const char *name, enum bb_class *out)
{
	for (int c = 0; name && c < BB_CLASS_COUNT; c++)
		if (!strcmp(name, bb_class_text((enum bb_class)c))) {
			*out = (enum bb_class)c;
			return true;
		}
	return false;
}

/* "cameras" counts every "camera". */
static bool in_class(const struct bb_device_result *d, enum bb_class c)
{
	const size_t n = strlen(d->class_name);

	return n >= 5 && !strncmp(d->class_name, bb_class_text(c), n);
}

static uint64_t counter(const struct bb_run_result *r, const char *name)
{
	for (size_t i = 0; i < r->n_counters; i++)
		if (!strcmp(r->counters[i].name, name))
			return r->counters[i].value;
	return 0;
}

static void count_cost(struct point *p, enum bb_class c)
{
	const struct bb_run_result *r = p->run.result;

	p->events = r->n_events;
	p->steps = counter(r, "clock_steps");
	for (size_t i = 0; i < r->n_devices; i++) {
		p->ops += r->devices[i].ops;
		if (!in_class(&r->devices[i], c))
			continue;
		p->class_events += r->devices[i].events;
		p->class_ops += r->devices[i].ops;
	}
}

static enum bb_status run_point(const struct bb_cli *cli, enum bb_class c, int fidelity, struct point *p,
                                struct bb_error *err)
{
	struct bb_run_options o = bb_run_options_default();
	double seed, duration, before;
	enum bb_status st = bb_cli_whole(cli, "seed", 7, 0, 9007199254740992.0, &seed, err);

	if (st == BB_OK)
		st = bb_cli_number(cli, "duration", 0, 0, 1e6, &duration, err);
	if (st != BB_OK)
		return st;
	o.room_path = cli->arg[0];
	o.scene_path = cli->arg[1];
	o.seed = (uint64_t)seed;
	o.duration_s = duration;
	o.fidelity[c] = p->fidelity = fidelity;
	o.pictures = false;
	o.measure_psnr = false;
	o.out_dir = NULL;
	before = cpu_ms();
	st = bb_run(&o, &p->run, err);
	p->cpu_ms = cpu_ms() - before;
	if (st == BB_OK)
		count_cost(p, c);
	return st;
}

static double ratio(double high, double low)
{
	return low > 0 ? high / low : BB_UNKNOWN;
}

static double total_events_ratio(const struct point *p)
{
	return ratio((double)p[1].events, (double)p[0].events);
}

static bool agree(const struct point *p)
{
	return p[0].run.result->verdict == p[1].run.result->verdict;
}

/* Budgets that only the higher fidelity can judge: an equal verdict says nothing about those. */
static size_t judged_only_high(const struct point *p)
{
	const struct bb_run_result *a = p[0].run.result, *b = p[1].run.result;
	size_t n = 0;

	for (size_t i = 0; i < a->n_budgets && i < b->n_budgets; i++)
		n += a->budgets[i].verdict == BB_SKIP && b->budgets[i].verdict != BB_SKIP;
	return n;
}

/* ---- output ---- */

static void print_row(const char *name, uint64_t a, uint64_t b)
{
	char times[32], text[32];

	bb_text_number(text, sizeof(text), ratio((double)b, (double)a));
	bb_text_format(times, sizeof(times), "%s%s", text, a ? "x" : "");
	printf("  %-28s %15llu %15llu %10s\n", name, (unsigned long long)a, (unsigned long long)b, times);
}

static void print_budgets(const struct point *p)
{
	const struct bb_run_result *a = p[0].run.result, *b = p[1].run.result;

	for (size_t i = 0; i < a->n_budgets && i < b->n_budgets; i++) {
		const struct bb_budget_result *x = &a->budgets[i], *y = &b->budgets[i];
		const struct bb_metric_info *info = bb_metric_info(x->budget.metric);
		char name[64], left[64], right[64], number[32];
		bb_text_format(name, sizeof(name), "%s %s (%s)", info->name, bb_stat_text(x->budget.stat), info->unit);
		bb_text_format(left, sizeof(left), "%s %s", bb_text_number(number, sizeof(number), x->value),
		               bb_verdict_text(x->verdict));
		bb_text_format(right, sizeof(right), "%s %s", bb_text_number(number, sizeof(number), y->value),
		               bb_verdict_text(y->verdict));
		printf("  %-28s %15s %15s\n", name, left, right);
	}
}

static void print_table(const struct point *p, enum bb_class c)
{
	const char *class_name = bb_class_text(c);
	char name[48], number[32];

	printf("  %-28s      fidelity %d      fidelity %d %10s\n", class_name, p[0].fidelity, p[1].fidelity, "ratio");
	printf("  %-28s %15s %15s\n", "verdict", bb_verdict_text(p[0].run.result->verdict),
	       bb_verdict_text(p[1].run.result->verdict));
	print_budgets(p);
	bb_text_format(name, sizeof(name), "events of %s", class_name);
	print_row(name, p[0].class_events, p[1].class_events);
	bb_text_format(name, sizeof(name), "calls of %s", class_name);
	print_row(name, p[0].class_ops, p[1].class_ops);
	print_row("events of the run", p[0].events, p[1].events);
	print_row("calls of the run", p[0].ops, p[1].ops);
	print_row("clock steps", p[0].steps, p[1].steps);
	printf("  %-28s %15.1f %15.1f %9sx\n", "CPU ms (measured)", p[0].cpu_ms, p[1].cpu_ms,
	       bb_text_number(number, sizeof(number), ratio(p[1].cpu_ms, p[0].cpu_ms)));
	bb_text_number(number, sizeof(number), total_events_ratio(p));
	if (agree(p))
		printf("\nsame verdict at both fidelities: %s at %d cost %s times the events of %d", class_name, p[1].fidelity, number,
		       p[0].fidelity);
	else
		printf("\nthe verdicts differ: this scene needs %s at fidelity %d", class_name, p[1].fidelity);
	printf(", %s times the CPU time\n", bb_text_number(number, sizeof(number), ratio(p[1].cpu_ms, p[0].cpu_ms)));
	if (judged_only_high(p))
		printf("%zu of the budgets can be judged at fidelity %d only\n", judged_only_high(p), p[1].fidelity);
}

static json_t *real(double v)
{
	return isfinite(v) ? json_real(v) : json_null();
}

static json_t *point_json(const struct point *p)
{
	const struct bb_run_result *r = p->run.result;
	json_t *o = json_object(), *budgets = json_array();

	json_object_set_new(o, "fidelity", json_integer(p->fidelity));
	json_object_set_new(o, "verdict", json_string(bb_verdict_text(r->verdict)));
	json_object_set_new(o, "class_events", json_integer((json_int_t)p->class_events));
	json_object_set_new(o, "class_ops", json_integer((json_int_t)p->class_ops));
	json_object_set_new(o, "events", json_integer((json_int_t)p->events));
	json_object_set_new(o, "ops", json_integer((json_int_t)p->ops));
	json_object_set_new(o, "clock_steps", json_integer((json_int_t)p->steps));
	json_object_set_new(o, "cpu_ms", real(p->cpu_ms));
	for (size_t i = 0; i < r->n_budgets; i++) {
		const struct bb_budget_result *b = &r->budgets[i];
		json_t *e = json_object();
		json_object_set_new(e, "metric", json_string(bb_metric_info(b->budget.metric)->name));
		json_object_set_new(e, "statistic", json_string(bb_stat_text(b->budget.stat)));
		json_object_set_new(e, "unit", json_string(bb_metric_info(b->budget.metric)->unit));
		json_object_set_new(e, "value", real(b->value));
		json_object_set_new(e, "verdict", json_string(bb_verdict_text(b->verdict)));
		json_array_append_new(budgets, e);
	}
	json_object_set_new(o, "budgets", budgets);
	return o;
}

static int print_json(const struct point *p, enum bb_class c)
{
	json_t *o = json_object(), *points = json_array();
	bool bad;

	json_object_set_new(o, "schema", json_integer(BB_RESULT_SCHEMA));
	json_object_set_new(o, "kind", json_string("blackburst-trade"));
	json_object_set_new(o, "device", json_string(bb_class_text(c)));
	for (int i = 0; i < FIDELITIES; i++)
		json_array_append_new(points, point_json(&p[i]));
	json_object_set_new(o, "points", points);
	json_object_set_new(o, "same_verdict", json_boolean(agree(p)));
	json_object_set_new(o, "judged_only_higher", json_integer((json_int_t)judged_only_high(p)));
	json_object_set_new(o, "events_ratio", real(total_events_ratio(p)));
	json_object_set_new(o, "cpu_ratio", real(ratio(p[1].cpu_ms, p[0].cpu_ms)));
	bad = json_dumpf(o, stdout, JSON_INDENT(2) | JSON_REAL_PRECISION(9)) || fputc('\n', stdout) == EOF;
	json_decref(o);
	return bad ? BB_EXIT_INTERNAL : BB_EXIT_OK;
}

int bb_trade_device_run(const struct bb_cli *cli)
{
	struct point p[FIDELITIES] = { 0 };
	struct bb_error err = { 0 };
	enum bb_class c = BB_CLASS_NONE;
	enum bb_status st = BB_OK;
	int code = BB_EXIT_OK;

	if (!find_class(bb_cli_get(cli, "device", NULL), &c))
		st = bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "trade: --device names a class: %s",
		             "shutters, cameras, displays, monitors, power or gamepads");
	double from = 0;
	if (st == BB_OK)
		st = bb_cli_number(cli, "from", 0, 0, 1, &from, &err);
	for (int i = 0; i < FIDELITIES && st == BB_OK; i++)
		st = run_point(cli, c, (from > 0.5) + i, &p[i], &err);
	if (st != BB_OK)
		code = bb_cli_fail(st, &err);
	else if (bb_cli_has(cli, "json"))
		code = print_json(p, c);
	else
		print_table(p, c);
	for (int i = 0; i < FIDELITIES; i++)
		bb_run_free(&p[i].run);
	return code;
}
