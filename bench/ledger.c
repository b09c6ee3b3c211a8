/*
 * bench/ledger.c: rings of spans, marks, samples and rows, all taken at creation. The run's own thread writes; after
 * the run anybody reads. What no longer fits is counted, and its value still enters the tallies, so minimum, maximum
 * and mean stay exact while percentiles speak for what was stored.
 */
#include "bench/ledger.h"

#include "bench/stats.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ALL_NODES UINT16_MAX
/* Above these a run is a soak: its head is kept, its tail is tallied. Pages that are never touched cost nothing. */
#define SPANS_MOST ((size_t)4 << 20)
#define MARKS_MOST ((size_t)4 << 20)
#define SAMPLES_MOST ((size_t)1 << 19)
#define ROWS_MOST ((size_t)1 << 20)

struct series {
	struct bb_sample *sample;
	size_t n;
	struct bb_tally tally;
	struct bb_sample worst;
};

struct stage_tally {
	struct bb_tally tally; /* ms */
	struct bb_sample worst;
};

struct bb_ledger {
	size_t n_nodes;
	size_t n_spans, cap_spans, n_marks, cap_marks, n_rows, cap_rows, cap_samples;
	struct bb_span *span;
	struct bb_mark *mark;
	struct bb_frame_row *row;
	struct series metric[BB_METRIC_COUNT];
	struct stage_tally *stage; /* [stage][node], the last column is the whole room */
	double *scratch;           /* for sorting: as long as the longest series */
	uint64_t dropped;
};

const char *bb_stage_text(enum bb_stage stage)
{
	static const char *const text[] = {
#define X(id, name, help) [id] = name,
		BB_STAGE_LIST(X)
#undef X
	};

	return (size_t)stage < BB_ARRAY_LEN(text) ? text[stage] : "none";
}

/* frames * each + more, at most `most`; saturates instead of wrapping. */
static size_t capacity(size_t frames, size_t each, size_t more, size_t most)
{
	size_t n;

	if (__builtin_mul_overflow(frames, each, &n) || __builtin_add_overflow(n, more, &n))
		return most;
	return n < most ? n : most;
}

static bool take_memory(struct bb_ledger *l)
{
	const size_t longest = l->cap_spans > l->cap_samples ? l->cap_spans : l->cap_samples;

	l->span = calloc(l->cap_spans, sizeof(*l->span));
	l->mark = calloc(l->cap_marks, sizeof(*l->mark));
	l->row = calloc(l->cap_rows, sizeof(*l->row));
	l->stage = calloc((l->n_nodes + 1) * BB_STAGE_COUNT, sizeof(*l->stage));
	l->scratch = calloc(longest, sizeof(*l->scratch));
	for (size_t i = 0; i < BB_METRIC_COUNT; i++) {
		l->metric[i].sample = calloc(l->cap_samples, sizeof(*l->metric[i].sample));
		if (!l->metric[i].sample)
			return false;
	}
	return l->span && l->mark && l->row && l->stage && l->scratch;
}

enum bb_status bb_ledger_create(size_t n_frames, size_t n_nodes, struct bb_ledger **out)
{
	struct bb_ledger *l;

	*out = NULL;
	if (n_nodes >= ALL_NODES)
		return BB_ERR_RANGE;
	l = calloc(1, sizeof(*l));
	if (!l)
		return BB_ERR_NOMEM;
	l->n_nodes = n_nodes;
	/* A frame of a node has seven stages of its own and may split some per screen or camera. */
	l->cap_spans = capacity(n_frames, 12 * (n_nodes + 2), 1024, SPANS_MOST);
	l->cap_marks = capacity(n_frames, 8 * (n_nodes + 2), 1024, MARKS_MOST);
	l->cap_samples = capacity(n_frames, n_nodes + 2, 1024, SAMPLES_MOST);
	l->cap_rows = capacity(n_frames, 1, 64, ROWS_MOST);
	if (!take_memory(l)) {
		bb_ledger_destroy(l);
		return BB_ERR_NOMEM;
	}
	*out = l;
	return BB_OK;
}

void bb_ledger_destroy(struct bb_ledger *l)
{
	if (!l)
		return;
	for (size_t i = 0; i < BB_METRIC_COUNT; i++)
		free(l->metric[i].sample);
	free(l->scratch);
	free(l->stage);
	free(l->row);
	free(l->mark);
	free(l->span);
	free(l);
}

static struct stage_tally *tally_of(const struct bb_ledger *l, enum bb_stage stage, size_t node)
{
	return &l->stage[(size_t)stage * (l->n_nodes + 1) + node];
}

static void tally_span(struct stage_tally *t, const struct bb_span *s, double ms)
{
	if (!t->tally.n || ms > t->worst.value)
		t->worst = (struct bb_sample){ ms, 0, s->frame, s->start_ns, s->node, s->stage };
	bb_tally_add(&t->tally, ms);
}

void bb_ledger_span(struct bb_ledger *l, uint64_t frame, enum bb_stage stage, uint16_t node, uint32_t tag,
                    int64_t start_ns, int64_t end_ns)
{
	const struct bb_span s = { frame, start_ns, end_ns, (uint16_t)stage, node, tag };

	if ((size_t)stage >= BB_STAGE_COUNT || (node != ALL_NODES && node >= l->n_nodes)) {
		l->dropped++;
		return;
	}
	tally_span(tally_of(l, stage, node == ALL_NODES ? l->n_nodes : node), &s, (double)(end_ns - start_ns) * 1e-6);
	if (l->n_spans < l->cap_spans)
		l->span[l->n_spans++] = s;
	else
		l->dropped++;
}

void bb_ledger_mark(struct bb_ledger *l, enum bb_track_kind track, uint16_t index, int64_t at_ns, int32_t value,
                    uint8_t eye)
{
	if (l->n_marks < l->cap_marks)
		l->mark[l->n_marks++] = (struct bb_mark){ at_ns, (uint8_t)track, eye, index, value };
	else
		l->dropped++;
}

/* Is a further on the wrong side of its budget than b? */
static bool worse(enum bb_metric metric, double a, double b)
{
	return bb_metric_info(metric)->lower_limit ? a < b : fabs(a) > fabs(b);
}

void bb_ledger_sample(struct bb_ledger *l, enum bb_metric metric, const struct bb_sample *sample)
{
	struct series *s;

	/* A value that is no number has no place in a statistic: it shows as dropped, which every report prints. */
	if ((size_t)metric >= BB_METRIC_COUNT || !isfinite(sample->value)) {
		l->dropped++;
		return;
	}
	s = &l->metric[metric];
	if (!s->tally.n || worse(metric, sample->value, s->worst.value))
		s->worst = *sample;
	bb_tally_add(&s->tally, sample->value);
	if (s->n < l->cap_samples)
		s->sample[s->n++] = *sample;
	else
		l->dropped++;
}

void bb_ledger_row(struct bb_ledger *l, const struct bb_frame_row *row)
{
	if (l->n_rows < l->cap_rows)
		l->row[l->n_rows++] = *row;
	else
		l->dropped++;
}

struct bb_summary bb_ledger_metric(const struct bb_ledger *l, enum bb_metric metric)
{
	const struct series *s = &l->metric[metric];
	struct bb_summary out;

	for (size_t i = 0; i < s->n; i++)
		l->scratch[i] = s->sample[i].value;
	out = bb_stats_summary(&s->tally, l->scratch, s->n);
	if (out.n) {
		out.worst = s->worst;
		out.uncertainty = s->worst.uncertainty;
	}
	return out;
}

struct bb_summary bb_ledger_stage(const struct bb_ledger *l, enum bb_stage stage, uint16_t node)
{
	struct stage_tally all = { 0 };
	struct bb_summary out;
	size_t n = 0;

	for (size_t i = 0; i <= l->n_nodes; i++) {
		const struct stage_tally *t = tally_of(l, stage, i);
		if (!t->tally.n || (node != ALL_NODES && node != i))
			continue;
		if (!all.tally.n || t->worst.value > all.worst.value)
			all.worst = t->worst;
		bb_tally_merge(&all.tally, &t->tally);
	}
	for (size_t i = 0; all.tally.n && i < l->n_spans; i++) {
		const struct bb_span *s = &l->span[i];
		if (s->stage == stage && (node == ALL_NODES || node == s->node))
			l->scratch[n++] = (double)(s->end_ns - s->start_ns) * 1e-6;
	}
	out = bb_stats_summary(&all.tally, l->scratch, n);
	if (out.n) {
		out.worst = all.worst;
		out.uncertainty = 0;
	}
	return out;
}

size_t bb_ledger_spans(const struct bb_ledger *l, const struct bb_span **out)
{
	*out = l->span;
	return l->n_spans;
}

size_t bb_ledger_marks(const struct bb_ledger *l, const struct bb_mark **out)
{
	*out = l->mark;
	return l->n_marks;
}

size_t bb_ledger_rows(const struct bb_ledger *l, const struct bb_frame_row **out)
{
	*out = l->row;
	return l->n_rows;
}

size_t bb_ledger_samples(const struct bb_ledger *l, enum bb_metric metric, const struct bb_sample **out)
{
	*out = l->metric[metric].sample;
	return l->metric[metric].n;
}

uint64_t bb_ledger_dropped(const struct bb_ledger *l)
{
	return l->dropped;
}

double bb_summary_stat(const struct bb_summary *s, enum bb_stat stat)
{
	const double value[BB_STAT_COUNT_] = { s->p50, s->p99, s->max, s->max_abs, s->mean, s->min, s->rms };

	return (size_t)stat < BB_STAT_COUNT_ ? value[stat] : BB_UNKNOWN;
}
