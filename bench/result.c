/*
 * bench/result.c: the result's memory, counters and facts, and the verdict table for a terminal. One thread.
 */
#include "bench/result.h"

#include "bench/file.h"
#include "bench/latency.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const char *bb_verdict_text(enum bb_verdict v)
{
	static const char *const text[] = {
#define X(id, name) [id] = name,
		BB_VERDICT_LIST(X)
#undef X
	};

	return (size_t)v < BB_ARRAY_LEN(text) ? text[v] : "?";
}

void bb_run_result_free(struct bb_run_result *r)
{
	if (!r)
		return;
	bb_ledger_destroy(r->ledger);
	free(r->budgets);
	free(r->stages);
	free(r->devices);
	free(r->incidents);
	free(r->faults);
	free(r->pictures);
	free(r->streaming.nodes);
	free(r->path);
	free(r);
}

void bb_result_count(struct bb_run_result *r, const char *name, uint64_t add)
{
	size_t i = 0;

	while (i < r->n_counters && strcmp(r->counters[i].name, name))
		i++;
	if (i == r->n_counters) {
		if (i == BB_COUNTERS_MAX)
			return;
		snprintf(r->counters[i].name, sizeof(r->counters[i].name), "%s", name);
		r->counters[i].value = 0;
		r->n_counters++;
	}
	r->counters[i].value += add;
}

void bb_result_fact(struct bb_run_result *r, const char *key, const char *fmt, ...)
{
	struct bb_text_pair *fact;
	char text[sizeof(fact->value)];
	va_list ap;

	if (r->n_facts == BB_ARRAY_LEN(r->facts))
		return;
	fact = &r->facts[r->n_facts++];
	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	snprintf(fact->key, sizeof(fact->key), "%s", key);
	bb_text_clean(fact->value, sizeof(fact->value), text);
}

/* ---- brick loads ---- */

/* The node whose frames spent most on bricks: on those that were late for it, else on any. */
static size_t spender(const struct bb_stream_result *s, uint64_t *late)
{
	size_t best = s->n_nodes;

	*late = 0;
	for (size_t i = 0; i < s->n_nodes; i++)
		*late += s->nodes[i].late;
	for (size_t i = 0; i < s->n_nodes; i++) {
		const struct bb_stream_node *n = &s->nodes[i], *b = best < s->n_nodes ? &s->nodes[best] : NULL;
		if (!n->frames || (*late && !n->late))
			continue;
		if (!b || (*late ? n->worst.frame_ms > b->worst.frame_ms : n->most.ms > b->most.ms))
			best = i;
	}
	return best;
}

void bb_result_loads(const struct bb_run_result *r, char *out, size_t cap)
{
	const struct bb_stream_result *s = &r->streaming;
	uint64_t late;
	const size_t i = spender(s, &late);

	out[0] = '\0';
	if (i == s->n_nodes)
		return;
	const struct bb_stream_load *l = late ? &s->nodes[i].worst : &s->nodes[i].most;
	const char *node = r->room->nodes[i].id;
	if (late)
		bb_text_format(out, cap, "brick loads made %llu frame%s late; the worst at %.3f s: node/%s read %u brick%s "
		               "(%.1f KiB), %.3f ms of a frame of %.3f ms (limit %.2f ms)",
		               (unsigned long long)late, late == 1 ? "" : "s", (double)l->at_ns * 1e-9, node, l->bricks,
		               l->bricks == 1 ? "" : "s", (double)l->bytes / 1024, l->ms, l->frame_ms, s->limit_ms);
	else
		bb_text_format(out, cap, "no brick load spent a frame; the most was %.3f ms of %.2f ms, on node/%s at %.3f s "
		               "(%u brick%s, %.1f KiB)", l->ms, s->limit_ms, node, (double)l->at_ns * 1e-9, l->bricks,
		               l->bricks == 1 ? "" : "s", (double)l->bytes / 1024);
}

/* ---- the verdict table ---- */

static const char *tint(enum bb_verdict v, bool colour)
{
	static const char *const ansi[] = { [BB_PASS] = "\033[32m", [BB_MARGINAL] = "\033[33m",
		                            [BB_INCONCLUSIVE] = "\033[35m", [BB_FAIL] = "\033[31m",
		                            [BB_SKIP] = "\033[2m" };

	return colour && (size_t)v < BB_ARRAY_LEN(ansi) ? ansi[v] : "";
}

static void print_budget(FILE *f, const struct bb_budget_result *b, bool colour)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	char name[48], value[40] = "-", limit[40], number[32], sigma[32] = "", cause[200];

	snprintf(name, sizeof(name), "%s %s", info->name, bb_stat_text(b->budget.stat));
	if (!isnan(b->value))
		snprintf(value, sizeof(value), "%s %s", bb_text_number(number, sizeof(number), b->value), info->unit);
	if (!isnan(b->value) && b->uncertainty > 0) {
		bb_text_number(number, sizeof(number), b->uncertainty);
		snprintf(sigma, sizeof(sigma), "+-%.20s", number);
	}
	snprintf(limit, sizeof(limit), "%s %s", info->lower_limit ? ">=" : "<=",
	         bb_text_number(number, sizeof(number), b->budget.limit));
	bb_text_clean(cause, sizeof(cause), b->cause);
	fprintf(f, "  %-22s %15s %-8s %-10s %s%-12s%s %s\n", name, value, sigma, limit, tint(b->verdict, colour),
	        bb_verdict_text(b->verdict), colour ? "\033[0m" : "", cause);
}

/* What the report shows as a picture, in two lines: where the time goes, and what prediction makes of it. */
static void print_latency(FILE *f, const struct bb_run_result *r)
{
	struct bb_latency l;

	if (!bb_latency_of(r, &l) || !l.n)
		return;
	fprintf(f, "\n  head to photon: %s\n", l.attack);
	if (l.prediction.n)
		fprintf(f, "  prediction: eyes at the photon %.2f mm and %.2f deg rms off; unpredicted %.1f mm, %.2f deg\n",
		        l.prediction.with_mm, l.prediction.with_deg, l.prediction.without_mm, l.prediction.without_deg);
}

void bb_result_print(const struct bb_run_result *r, void *stream_FILE, bool colour)
{
	FILE *f = stream_FILE;
	char room[64], scene[64], summary[256];

	bb_text_clean(room, sizeof(room), r->room->name);
	bb_text_clean(scene, sizeof(scene), r->scene->name);
	bb_text_clean(summary, sizeof(summary), r->summary);
	fprintf(f, "%s x %s, seed %llu, %s clock, %.3g s%s\n\n", room, scene, (unsigned long long)r->seed, r->clock,
	        r->duration_s, r->truncated ? " (interrupted)" : "");
	fprintf(f, "  %-22s %15s %-8s %-10s %-12s %s\n", "budget", "value", "", "limit", "verdict", "cause");
	for (size_t i = 0; i < r->n_budgets; i++)
		print_budget(f, &r->budgets[i], colour);
	print_latency(f, r);
	for (size_t i = 0; i < r->n_faults; i++) {
		char text[160];
		bb_text_clean(text, sizeof(text), r->faults[i].text);
		fprintf(f, "%s  planted: %s\n", i ? "" : "\n", text);
	}
	for (size_t i = 0; i < r->n_black; i++) {
		char cause[240];
		bb_text_clean(cause, sizeof(cause), r->black[i].n_causes ? r->black[i].cause[0].text : "nobody was seen to be unwell");
		fprintf(f, "%s  black box: %s: %s\n", i ? "" : "\n", r->black[i].what, cause);
	}
	fprintf(f, "\n%s%s%s\n", tint(r->verdict, colour), summary, colour ? "\033[0m" : "");
}
