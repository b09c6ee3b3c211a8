#include "hal/room/budget_read.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static const struct unit {
	const char *text, *dimension;
	double factor; /* to the dimension's base unit */
} units[] = {
	{ "ns", "time", 1e-9 },     { "us", "time", 1e-6 },      { "ms", "time", 1e-3 },        { "s", "time", 1 },
	{ "um", "length", 1e-6 },   { "mm", "length", 1e-3 },    { "cm", "length", 1e-2 },      { "m", "length", 1 },
	{ "bytes", "size", 1 },     { "kib", "size", 1024 },     { "mib", "size", 1048576 },    { "db", "level", 1 },
	{ "percent", "share", 1 },  { "count", "count", 1 }, { "deg", "angle", 1 },
};

static const struct unit *unit_of(const char *text)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(units); i++)
		if (!strcmp(units[i].text, text))
			return &units[i];
	return NULL;
}

/* Factor from a key's unit to the metric's; NAN when they do not measure the same. A count needs no unit. */
static double factor_of(const char *key_unit, const char *metric_unit)
{
	const struct unit *to = unit_of(metric_unit);
	const struct unit *from = *key_unit ? unit_of(key_unit) : !strcmp(metric_unit, "count") ? to : NULL;

	if (!from || !to || strcmp(from->dimension, to->dimension))
		return (double)NAN;
	/* 50 ms is 50, not 50.00000000000001 */
	return from == to ? 1 : from->factor / to->factor;
}

/* "p99_ms" begins with a statistic: its unit ("ms", or "" for the bare word), NULL otherwise. */
static const char *unit_after(const char *key, const char *word)
{
	const size_t n = strlen(word);

	if (strncmp(key, word, n))
		return NULL;
	return key[n] == '_' ? key + n + 1 : key[n] ? NULL : key + n;
}

static const char *stat_of(const char *key, enum bb_stat *stat)
{
	const char *best = NULL;

	for (int s = 0; s < BB_STAT_COUNT_; s++) { /* "max_abs_us" begins with max as well: the longer word wins */
		const char *unit = unit_after(key, bb_stat_text((enum bb_stat)s));
		if (unit && (!best || unit > best)) {
			best = unit;
			*stat = (enum bb_stat)s;
		}
	}
	return best;
}

static enum bb_status read_value(struct bb_reader *r, const struct bb_yaml_node *node, const char *unit,
                                 const struct bb_metric_info *info, double *out)
{
	const double factor = factor_of(unit, info->unit);
	const enum bb_status status = isfinite(factor) ? bb_yaml_number(r, node, 0, 1e15, out) : BB_OK;

	if (!isfinite(factor))
		return bb_yaml_fail(r, 1116, node, "'%s': %s is measured in %s", node->key, info->name, info->unit);
	*out *= factor;
	return status;
}

static enum bb_status find_metric(struct bb_reader *r, const struct bb_yaml_node *entry, enum bb_metric *metric)
{
	size_t distance = strlen(entry->key) / 2 + 1;
	const char *best = NULL;

	if (bb_metric_find(entry->key, metric))
		return BB_OK;
	for (int i = 0; i < BB_METRIC_COUNT; i++)
		best = bb_nearer(entry->key, bb_metric_info((enum bb_metric)i)->name, best, &distance);
	return best ? bb_yaml_fail(r, 1115, entry, "'%s', did you mean '%s'?", entry->key, best)
	            : bb_yaml_fail(r, 1115, entry, "'%s'", entry->key);
}

static enum bb_status read_limit(struct bb_reader *r, const struct bb_yaml_node *c, const struct bb_budget *shared,
                                 struct bb_budget budgets[BB_BUDGETS_MAX], size_t *n)
{
	const struct bb_metric_info *info = bb_metric_info(shared->metric);
	struct bb_budget budget = *shared;
	const char *unit = stat_of(c->key, &budget.stat);
	enum bb_status status;

	if (!unit)
		return bb_yaml_fail(r, 1116, c, "'%s' begins with no statistic", c->key);
	if (*n == BB_BUDGETS_MAX)
		return bb_yaml_fail(r, 1101, c, "more than %d budgets", BB_BUDGETS_MAX);
	status = read_value(r, c, unit, info, &budget.limit);
	if (status)
		return status;
	budget.where = bb_yaml_where(r, c);
	if (info->lower_limit ? budget.marginal < budget.limit : budget.marginal > budget.limit)
		return bb_yaml_fail(r, 1117, c, "%g %s is beyond the limit %g %s", budget.marginal, info->unit,
		                    budget.limit, info->unit);
	budgets[(*n)++] = budget;
	return BB_OK;
}

enum bb_status bb_budget_read(struct bb_reader *r, const struct bb_yaml_node *entry,
                              struct bb_budget budgets[BB_BUDGETS_MAX], size_t *n)
{
	struct bb_budget shared = { .marginal = (double)NAN };
	enum bb_status status = find_metric(r, entry, &shared.metric);
	size_t n_limits = 0;

	if (!status)
		status = bb_yaml_want(r, entry, BB_YAML_MAP);
	for (const struct bb_yaml_node *c = entry->first; c && !status; c = c->next) {
		const char *unit = unit_after(c->key, "marginal");
		if (unit)
			status = read_value(r, c, unit, bb_metric_info(shared.metric), &shared.marginal);
		else if (!strcmp(c->key, "owner"))
			status = bb_yaml_text(r, c, shared.owner, sizeof(shared.owner));
	}
	for (const struct bb_yaml_node *c = entry->first; c && !status; c = c->next) {
		if (unit_after(c->key, "marginal") || !strcmp(c->key, "owner"))
			continue;
		status = read_limit(r, c, &shared, budgets, n);
		n_limits++;
	}
	if (!status && !n_limits)
		return bb_yaml_fail(r, 1116, entry, "%s has no limit", entry->key);
	return status;
}
