/*
 * bench/budget.c: from samples to verdicts. Who is behind a miss is bench/blame.c's affair.
 *
 * Two metrics are wholes and not distributions: a "count" is the sum of its samples and `tracked` is their mean, so a
 * run may hand over one value at the end or one a frame. One thread, after the run.
 */
#include "bench/blame.h"
#include "bench/cli.h"
#include "bench/file.h"
#include "bench/stats.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIGMAS 2.0

/* ---- the value of a budget and how sure it is ---- */

static double sigma_rms(const struct bb_sample *s, size_t n)
{
	double sum = 0;

	for (size_t i = 0; i < n; i++)
		sum += s[i].uncertainty * s[i].uncertainty;
	/* Not divided by sqrt(n): the samples of a run share their clocks, so their errors do not average out. */
	return n ? sqrt(sum / (double)n) : 0;
}

/* The sigma of the sample a rank statistic picked: the largest of those that have its value. */
static double sigma_at(const struct bb_sample *s, size_t n, double value, bool absolute)
{
	double sigma = 0;

	for (size_t i = 0; i < n; i++) {
		const double v = absolute ? fabs(s[i].value) : s[i].value;
		if (v >= value && v <= value)
			sigma = fmax(sigma, s[i].uncertainty);
	}
	return sigma;
}

static void measure(const struct bb_run_result *r, struct bb_budget_result *b)
{
	const struct bb_sample *s;
	const size_t n = bb_ledger_samples(r->ledger, b->budget.metric, &s);
	const enum bb_stat stat = b->budget.stat;

	b->summary = bb_ledger_metric(r->ledger, b->budget.metric);
	b->value = bb_summary_stat(&b->summary, stat);
	if (!b->summary.n)
		return;
	if (bb_budget_is_count(b->budget.metric))
		b->value = b->summary.mean * (double)b->summary.n;
	else if (b->budget.metric == BB_METRIC_TRACKED)
		b->value = b->summary.mean;
	else if (stat != BB_STAT_MEAN && stat != BB_STAT_RMS)
		b->uncertainty = sigma_at(s, n, b->value, stat == BB_STAT_MAX_ABS);
	else
		b->uncertainty = sigma_rms(s, n);
}

static void measure_devices(const struct bb_run_result *r, struct bb_budget_result *b)
{
	measure(r, b);
	for (size_t i = 0; i < r->n_devices; i++) {
		const struct bb_device_result *d = &r->devices[i];
		if (bb_device_in_use(d) && !(d->longest_bad_s <= b->value))
			b->value = d->longest_bad_s;
	}
	if (!b->summary.n && !isnan(b->value))
		b->summary.max = b->summary.max_abs = b->value;
}

/* ---- one verdict ---- */

static bool skip(const struct bb_run_result *r, struct bb_budget_result *b)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	const int has = info->needs < BB_CLASS_COUNT ? r->scene->needs[info->needs] : 0;

	if (info->needs < BB_CLASS_COUNT && has == BB_NOT_NEEDED)
		bb_text_format(b->cause, sizeof(b->cause), "the scene does not use %s", bb_class_text(info->needs));
	else if (info->needs < BB_CLASS_COUNT && has < info->fidelity)
		bb_text_format(b->cause, sizeof(b->cause), "needs %s at fidelity %d, the scene asks for %d",
		         bb_class_text(info->needs), info->fidelity, has);
	else if (isnan(b->value) && b->budget.metric == BB_METRIC_DEVICES)
		bb_text_format(b->cause, sizeof(b->cause), "the scene needs no device");
	else if (isnan(b->value))
		bb_text_format(b->cause, sizeof(b->cause), "no samples");
	else
		return false;
	b->verdict = BB_SKIP;
	b->value = BB_UNKNOWN;
	b->uncertainty = 0;
	return true;
}

static void judge_value(const struct bb_run_result *r, struct bb_budget_result *b)
{
	const enum bb_metric metric = b->budget.metric;
	const double distance = fabs(b->value - b->budget.limit);
	char number[2][32];

	if (metric == BB_METRIC_DEVICES && bb_device_lost_at_end(r)) {
		b->verdict = BB_FAIL;
		bb_blame_device(r, b);
	} else if (distance < SIGMAS * b->uncertainty) {
		b->verdict = BB_INCONCLUSIVE;
		bb_text_format(b->cause, sizeof(b->cause),
		               "the uncertainty (2 sigma: %s %s) is larger than the distance to the limit (%s)",
		               bb_text_number(number[0], sizeof(number[0]), SIGMAS * b->uncertainty),
		               bb_metric_info(metric)->unit, bb_text_number(number[1], sizeof(number[1]), distance));
	} else if (bb_budget_beyond(metric, b->value, b->budget.limit)) {
		b->verdict = BB_FAIL;
		if (metric == BB_METRIC_DEVICES)
			bb_blame_device(r, b);
		else
			bb_blame(r, b, b->budget.limit);
	} else if (!isnan(b->budget.marginal) && bb_budget_beyond(metric, b->value, b->budget.marginal)) {
		b->verdict = BB_MARGINAL;
		if (metric == BB_METRIC_DEVICES)
			bb_blame_device(r, b);
		else
			bb_blame(r, b, b->budget.marginal);
		b->culprit[0] = '\0'; /* it holds: nobody is guilty, but the cause says where the margin went */
	} else {
		b->verdict = BB_PASS;
	}
}

static void judge_one(const struct bb_run_result *r, struct bb_budget_result *b)
{
	if (b->budget.metric == BB_METRIC_DEVICES)
		measure_devices(r, b);
	else
		measure(r, b);
	if (!skip(r, b))
		judge_value(r, b);
}

/* ---- the whole ---- */

static int severity(enum bb_verdict v)
{
	static const int rank[] = {
		[BB_SKIP] = 0, [BB_PASS] = 1, [BB_MARGINAL] = 2, [BB_INCONCLUSIVE] = 3, [BB_FAIL] = 4
	};

	return rank[v];
}

static const struct bb_budget_result *first_of(const struct bb_run_result *r, enum bb_verdict v)
{
	for (size_t i = 0; i < r->n_budgets; i++)
		if (r->budgets[i].verdict == v)
			return &r->budgets[i];
	return NULL;
}

static size_t count_of(const struct bb_run_result *r, enum bb_verdict v)
{
	size_t n = 0;

	for (size_t i = 0; i < r->n_budgets; i++)
		n += r->budgets[i].verdict == v;
	return n;
}

static void sum_up(struct bb_run_result *r)
{
	const struct bb_budget_result *b = first_of(r, r->verdict);
	const size_t n = count_of(r, r->verdict), skipped = count_of(r, BB_SKIP);
	char *out = r->summary;
	const size_t cap = sizeof(r->summary);

	if (r->verdict == BB_PASS)
		bb_text_format(out, cap, "PASS: all %zu budgets hold over %.3g s%s", r->n_budgets - skipped,
		               r->duration_s, skipped ? "; the skipped ones say why" : "");
	else if (r->verdict == BB_SKIP)
		bb_text_format(out, cap, "SKIP: nothing could be judged");
	else if (b)
		bb_text_format(out, cap, "%s: %zu of %zu budgets %s; %s %s: %.160s", bb_verdict_text(r->verdict), n,
		               r->n_budgets - skipped,
		               r->verdict == BB_FAIL       ? "missed"
		               : r->verdict == BB_MARGINAL ? "beyond the marginal mark"
		                                           : "undecided",
		               bb_metric_info(b->budget.metric)->name, bb_stat_text(b->budget.stat), b->cause);
	else
		bb_text_format(out, cap, "%s: interrupted after %.3g s", bb_verdict_text(r->verdict), r->duration_s);
}

static int exit_code_of(enum bb_verdict v)
{
	switch (v) {
	case BB_PASS:
	case BB_MARGINAL:
		return BB_EXIT_OK;
	case BB_INCONCLUSIVE:
		return BB_EXIT_INCONCLUSIVE;
	case BB_FAIL:
		return BB_EXIT_FAILED;
	case BB_SKIP:
		return BB_EXIT_SKIPPED;
	}
	return BB_EXIT_INTERNAL;
}

/* Where nobody has filled the stages: each for the whole room, then for every node that spent time there. */
static enum bb_status fill_stages(struct bb_run_result *r)
{
	const size_t n_nodes = r->room->n_nodes;

	if (r->stages)
		return BB_OK;
	r->stages = calloc((n_nodes + 1) * BB_STAGE_COUNT, sizeof(*r->stages));
	if (!r->stages)
		return BB_ERR_NOMEM;
	for (size_t stage = 0; stage < BB_STAGE_COUNT; stage++)
		for (size_t i = 0; i <= n_nodes; i++) {
			const uint16_t node = i ? (uint16_t)(i - 1) : BB_NOBODY;
			const struct bb_summary s = bb_ledger_stage(r->ledger, (enum bb_stage)stage, node);
			if (s.n)
				r->stages[r->n_stages++] = (struct bb_stage_result){ (enum bb_stage)stage, node, s };
		}
	return BB_OK;
}

static void add_budgets(struct bb_run_result *r, const struct bb_budget *budgets, size_t n, bool *has_devices)
{
	for (size_t i = 0; i < n; i++) {
		r->budgets[r->n_budgets++].budget = budgets[i];
		*has_devices |= budgets[i].metric == BB_METRIC_DEVICES;
	}
}

enum bb_status bb_result_judge(struct bb_run_result *r)
{
	bool has_devices = false;
	enum bb_status st = fill_stages(r);

	free(r->budgets);
	r->n_budgets = 0;
	r->budgets = calloc(r->room->n_budgets + r->scene->n_budgets + 2, sizeof(*r->budgets));
	if (!r->budgets || st != BB_OK)
		return BB_ERR_NOMEM;
	add_budgets(r, r->room->budgets, r->room->n_budgets, &has_devices);
	add_budgets(r, r->scene->budgets, r->scene->n_budgets, &has_devices);
	if (!has_devices)
		r->budgets[r->n_budgets++].budget = (struct bb_budget){ .metric = BB_METRIC_DEVICES, .stat = BB_STAT_MAX,
			.limit = r->room->degraded_max_s, .marginal = BB_UNKNOWN, .owner = "built-in" };
	if (!r->allow_flash && bb_ledger_metric(r->ledger, BB_METRIC_FLASHES).n)
		r->budgets[r->n_budgets++].budget = (struct bb_budget){ .metric = BB_METRIC_FLASHES, .stat = BB_STAT_MAX,
			.limit = r->room->safety.flashes_per_s, .marginal = BB_UNKNOWN, .owner = "built-in" };
	r->verdict = BB_SKIP;
	for (size_t i = 0; i < r->n_budgets; i++) {
		judge_one(r, &r->budgets[i]);
		if (severity(r->budgets[i].verdict) > severity(r->verdict))
			r->verdict = r->budgets[i].verdict;
	}
	/* What held until somebody pressed ^C proves nothing about the rest. */
	if (r->truncated && severity(r->verdict) < severity(BB_INCONCLUSIVE))
		r->verdict = BB_INCONCLUSIVE;
	r->exit_code = exit_code_of(r->verdict);
	sum_up(r);
	return BB_OK;
}
