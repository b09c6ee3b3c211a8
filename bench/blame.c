/*
 * bench/blame.c: from a missed budget to whoever caused it. The planted faults are not looked at: a culprit is found
 * from what the watches and the ledger saw, as it would have to be in a real room. One thread, after the run.
 */
#include "bench/blame.h"

#include "bench/file.h"
#include "bench/stats.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A device's state changes some time after the trouble begins: watches need up to this long to be sure. */
#define DETECT_NS (BB_NS_PER_S / 2)

enum { AT_CAMERA = 1, AT_NODE = 2, AT_LINK = 4, AT_DISPLAY = 8, AT_SHUTTER = 16, AT_OTHER = 32, AT_ANY = 63 };

/* Which devices can be behind time lost in a stage; in the order of enum bb_stage. */
static const unsigned stage_blame[BB_STAGE_COUNT] = {
	[BB_STAGE_EXPOSE] = AT_CAMERA,
	[BB_STAGE_TRANSFER] = AT_CAMERA,
	[BB_STAGE_WAIT] = AT_CAMERA,
	[BB_STAGE_TRACK] = AT_CAMERA | AT_NODE,
	[BB_STAGE_STATE] = AT_LINK | AT_NODE,
	[BB_STAGE_SELECT] = AT_NODE,
	[BB_STAGE_DRAW] = AT_NODE,
	[BB_STAGE_BARRIER] = AT_NODE | AT_LINK,
	[BB_STAGE_PRESENT] = AT_DISPLAY | AT_NODE,
	[BB_STAGE_SCANOUT] = AT_DISPLAY,
	[BB_STAGE_SHUTTER] = AT_SHUTTER | AT_DISPLAY,
};

static unsigned metric_blame(enum bb_metric metric)
{
	switch (metric) {
	case BB_METRIC_FRAME:
	case BB_METRIC_LATE_FRAMES:
	case BB_METRIC_STREAM:
	case BB_METRIC_WAKE_LATE:
	case BB_METRIC_PSNR:
		return AT_NODE;
	case BB_METRIC_HEAD_TO_PHOTON:
		return AT_CAMERA | AT_NODE | AT_LINK | AT_DISPLAY | AT_SHUTTER;
	case BB_METRIC_SWAP_SKEW:
	case BB_METRIC_SCANOUT_SKEW:
	case BB_METRIC_TORN_FRAMES:
		return AT_NODE | AT_LINK | AT_DISPLAY;
	case BB_METRIC_PHASE:
	case BB_METRIC_EYE_SWAPS:
	case BB_METRIC_CROSSTALK:
	case BB_METRIC_FLASHES:
		return AT_SHUTTER | AT_DISPLAY | AT_NODE;
	case BB_METRIC_POSE_ERROR:
	case BB_METRIC_POSE_ANGLE:
	case BB_METRIC_PHOTON_ERROR:
	case BB_METRIC_TRACKED:
		return AT_CAMERA | AT_NODE | AT_LINK;
	case BB_METRIC_PAD_BATTERY:
	case BB_METRIC_PAD_STUCK:
		return AT_OTHER;
	case BB_METRIC_DEVICES:
	case BB_METRIC_COUNT:
		break;
	}
	return AT_ANY;
}

static unsigned culprit_kind(const char *culprit)
{
	static const struct {
		const char *prefix;
		unsigned kind;
	} kinds[] = { { "camera/", AT_CAMERA },   { "node/", AT_NODE },       { "link/", AT_LINK },
		      { "display/", AT_DISPLAY }, { "shutter/", AT_SHUTTER } };

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++)
		if (!strncmp(culprit, kinds[i].prefix, strlen(kinds[i].prefix)))
			return kinds[i].kind;
	return AT_OTHER;
}

bool bb_budget_is_count(enum bb_metric metric)
{
	return !strcmp(bb_metric_info(metric)->unit, "count");
}

bool bb_budget_beyond(enum bb_metric metric, double value, double limit)
{
	return bb_metric_info(metric)->lower_limit ? value < limit : value > limit;
}

bool bb_device_in_use(const struct bb_device_result *d)
{
	return d->fidelity != BB_NOT_NEEDED;
}

bool bb_device_lost_at_end(const struct bb_run_result *r)
{
	for (size_t i = 0; i < r->n_devices; i++)
		if (bb_device_in_use(&r->devices[i]) && !strcmp(r->devices[i].health, bb_health_text(BB_HEALTH_LOST)))
			return true;
	return false;
}

struct blame {
	const struct bb_run_result *r;
	const struct bb_budget *budget;
	double limit;               /* of a single sample */
	const struct bb_sample *sample;
	size_t n;
	int64_t scene_start_ns;
	const struct bb_sample *worst;
	size_t n_frames;            /* distinct frames beyond the limit */
	const char *mark;           /* "limit", or "marginal" when that is what was passed */
};

static double size_of(const struct blame *m, double value)
{
	const bool absolute = m->budget->stat == BB_STAT_MAX_ABS || m->budget->stat == BB_STAT_RMS;

	return absolute ? fabs(value) : value;
}

static bool is_over(const struct blame *m, const struct bb_sample *s)
{
	return bb_budget_beyond(m->budget->metric, size_of(m, s->value), m->limit);
}

static double excess(const struct blame *m, const struct bb_sample *s)
{
	return fabs(size_of(m, s->value) - m->limit);
}

static void blame_init(struct blame *m, const struct bb_run_result *r, const struct bb_budget *budget, double limit)
{
	uint64_t last = UINT64_MAX;

	*m = (struct blame){ .r = r, .budget = budget, .limit = bb_budget_is_count(budget->metric) ? 0 : limit };
	m->mark = limit < budget->limit || limit > budget->limit ? "marginal" : "limit";
	m->n = bb_ledger_samples(r->ledger, budget->metric, &m->sample);
	m->scene_start_ns = llround(r->scene_start_s * 1e9);
	for (size_t i = 0; i < m->n; i++) {
		const struct bb_sample *s = &m->sample[i];
		if (!is_over(m, s))
			continue;
		if (!m->worst || excess(m, s) > excess(m, m->worst))
			m->worst = s;
		m->n_frames += s->frame != last;
		last = s->frame;
	}
}

static bool overlaps(const struct bb_incident *in, int64_t scene_ns)
{
	return scene_ns >= in->from_ns - DETECT_NS && scene_ns <= in->to_ns;
}

/* How much of the excess falls into an incident that could have caused it. */
static double weigh_incident(const struct blame *m, const struct bb_incident *in, bool *has_worst)
{
	const unsigned kind = culprit_kind(in->culprit);
	double weight = 0;

	*has_worst = false;
	if (m->budget->metric == BB_METRIC_FRAME && kind == AT_NODE)
		return 0; /* that a node was late is this very figure: the stage that took the time says more */
	for (size_t i = 0; i < m->n; i++) {
		const struct bb_sample *s = &m->sample[i];
		const unsigned can = s->stage < BB_STAGE_COUNT ? stage_blame[s->stage] : metric_blame(m->budget->metric);
		if (!is_over(m, s) || !(can & kind) || !overlaps(in, s->at_ns - m->scene_start_ns))
			continue;
		weight += excess(m, s);
		*has_worst |= s == m->worst;
	}
	return weight;
}

static const struct bb_incident *blame_incident(const struct blame *m, size_t *others)
{
	const struct bb_incident *best = NULL;
	double most = 0, total = 0;

	*others = 0;
	for (size_t i = 0; i < m->n; i++)
		total += is_over(m, &m->sample[i]) ? excess(m, &m->sample[i]) : 0;
	for (size_t i = 0; i < m->r->n_incidents; i++) {
		bool has_worst;
		const double weight = weigh_incident(m, &m->r->incidents[i], &has_worst);
		if (!has_worst && !(weight > total / 2))
			continue;
		*others += best != NULL;
		if (!best || weight > most) {
			best = &m->r->incidents[i];
			most = weight;
		}
	}
	return best;
}

/* A sample that names nobody may still have a frame row that names the late node. */
static uint16_t node_of(const struct blame *m, const struct bb_sample *s)
{
	const struct bb_frame_row *row;
	size_t low = 0, high = bb_ledger_rows(m->r->ledger, &row);
	const size_t n = high;

	if (s->node != BB_NOBODY)
		return s->node;
	while (low < high) { /* rows are recorded in the order of frames */
		const size_t mid = low + (high - low) / 2;
		if (row[mid].frame < s->frame)
			low = mid + 1;
		else
			high = mid;
	}
	if (low == n || row[low].frame != s->frame || row[low].late_node >= m->r->room->n_nodes)
		return BB_NOBODY;
	return (uint16_t)row[low].late_node;
}

struct spender {
	size_t node; /* n_nodes: the whole room */
	enum bb_stage stage;
	const struct bb_sample *worst;
	size_t n_frames;
};

/* The node and stage with the most excess over all samples beyond the limit. */
static bool blame_spender(const struct blame *m, struct spender *out)
{
	const size_t n_nodes = m->r->room->n_nodes, columns = BB_STAGE_COUNT + 1;
	double *weight = calloc((n_nodes + 1) * columns, sizeof(*weight));
	size_t best = 0;
	uint64_t last = UINT64_MAX;

	if (!weight)
		return false;
	for (size_t pass = 0; pass < 2; pass++)
		for (size_t i = 0; i < m->n; i++) {
			const struct bb_sample *s = &m->sample[i];
			if (!is_over(m, s))
				continue;
			const uint16_t node = node_of(m, s);
			const size_t at = (node < n_nodes ? node : n_nodes) * columns +
			                  (s->stage < BB_STAGE_COUNT ? s->stage : BB_STAGE_COUNT);
			if (!pass) {
				weight[at] += excess(m, s);
				best = weight[at] > weight[best] ? at : best;
			} else if (at == best) {
				if (!out->worst || excess(m, s) > excess(m, out->worst))
					out->worst = s;
				out->n_frames += s->frame != last;
				last = s->frame;
			}
		}
	free(weight);
	out->node = best / columns;
	out->stage = (enum bb_stage)(best % columns);
	return out->worst != NULL;
}

static double span_ms(const struct bb_ledger *l, uint64_t frame, enum bb_stage stage, size_t node, size_t n_nodes)
{
	const struct bb_span *span;
	const size_t n = bb_ledger_spans(l, &span);
	double ms = BB_UNKNOWN;

	for (size_t i = 0; i < n; i++)
		if (span[i].frame == frame && span[i].stage == stage &&
		    (span[i].node == node || (node == n_nodes && span[i].node == BB_NOBODY)))
			ms = fmax(ms, (double)(span[i].end_ns - span[i].start_ns) * 1e-6);
	return ms;
}

/* A name for time spent where no device was seen to be ill. */
static void name_spender(const struct bb_room *room, const struct spender *s, char *out, size_t cap)
{
	const unsigned kind = s->stage < BB_STAGE_COUNT ? stage_blame[s->stage] : 0;

	if (s->node < room->n_nodes)
		bb_text_format(out, cap, "node/%s", room->nodes[s->node].id);
	else if (kind & AT_CAMERA)
		bb_text_format(out, cap, "cameras");
	else if (kind & AT_LINK)
		bb_text_format(out, cap, "link");
	else if (kind & AT_SHUTTER && room->has_chain)
		bb_text_format(out, cap, "shutter/%s", room->chain.id);
	else if (kind & AT_DISPLAY)
		bb_text_format(out, cap, "displays");
	else
		bb_text_format(out, cap, "room");
}

static double scene_s(const struct blame *m, int64_t clock_ns)
{
	return (double)(clock_ns - m->scene_start_ns) * 1e-9;
}

static void tell_incident(const struct blame *m, const struct bb_incident *in, size_t others, struct bb_budget_result *b)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	char value[32], limit[32], more[40] = "";

	if (others)
		snprintf(more, sizeof(more), " (and %zu more)", others);
	bb_text_number(value, sizeof(value), m->worst->value);
	bb_text_number(limit, sizeof(limit), m->limit);
	bb_text_format(b->culprit, sizeof(b->culprit), "%s", in->culprit);
	bb_text_format(b->cause, sizeof(b->cause),
	               "%.40s%s %s since %.3f s (%.60s): %s %s at %.3f s (%s %s), %zu frame%s", in->culprit, more,
	               in->state, (double)in->from_ns * 1e-9, in->what, value, info->unit, scene_s(m, m->worst->at_ns),
	               m->mark, limit, m->n_frames, m->n_frames == 1 ? "" : "s");
	b->cause_ns = m->worst->at_ns - m->scene_start_ns;
}

/* The bricks a late frame would have been in time without. */
static void tell_bricks(const struct blame *m, const struct spender *s, const char *took, char *out, size_t cap)
{
	const struct bb_stream_result *r = &m->r->streaming;
	const struct bb_stream_load *l = s->node < r->n_nodes ? &r->nodes[s->node].worst : NULL;

	if (l && l->frame == s->worst->frame)
		bb_text_format(out, cap, "loading %u brick%s (%llu bytes) took %.4g of %.4g ms", l->bricks,
		               l->bricks == 1 ? "" : "s", (unsigned long long)l->bytes, l->ms, l->frame_ms);
	else
		bb_text_format(out, cap, "loading bricks took %s ms", took);
}

static void tell_spender(const struct blame *m, const struct spender *s, struct bb_budget_result *b)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	const size_t n_nodes = m->r->room->n_nodes;
	/* What follows the flip takes the time it takes: its span says nothing about the miss. */
	const double ms = s->stage <= BB_STAGE_PRESENT
	                          ? span_ms(m->r->ledger, s->worst->frame, s->stage, s->node, n_nodes)
	                          : BB_UNKNOWN;
	char value[32], limit[32], took[32], what[120];

	name_spender(m->r->room, s, b->culprit, sizeof(b->culprit));
	bb_text_number(value, sizeof(value), s->worst->value);
	bb_text_number(limit, sizeof(limit), m->limit);
	bb_text_number(took, sizeof(took), ms);
	if (b->budget.metric == BB_METRIC_FRAME && s->stage == BB_STAGE_SELECT)
		tell_bricks(m, s, took, what, sizeof(what));
	else if (!isnan(ms) && b->budget.metric == BB_METRIC_FRAME)
		bb_text_format(what, sizeof(what), "%s took %s ms", bb_stage_text(s->stage), took);
	else if (!isnan(ms))
		bb_text_format(what, sizeof(what), "%s took %s ms, %s %s %s", bb_stage_text(s->stage), took, info->name,
		               value, info->unit);
	else
		bb_text_format(what, sizeof(what), "%s %s %s", info->name, value, info->unit);
	bb_text_format(b->cause, sizeof(b->cause), "%s %s at %.3f s (%s %s %s), %zu frame%s", b->culprit, what,
	         scene_s(m, s->worst->at_ns), m->mark, limit, info->unit, s->n_frames, s->n_frames == 1 ? "" : "s");
	b->cause_ns = s->worst->at_ns - m->scene_start_ns;
}

void bb_blame(const struct bb_run_result *r, struct bb_budget_result *b, double limit)
{
	struct spender spender = { 0 };
	const struct bb_incident *in;
	struct blame m;
	size_t others;

	blame_init(&m, r, &b->budget, limit);
	if (!m.worst) { /* only beyond the capacity of the ledger */
		bb_text_format(b->culprit, sizeof(b->culprit), "room");
		bb_text_format(b->cause, sizeof(b->cause), "the samples beyond the limit are not among those kept");
		return;
	}
	in = blame_incident(&m, &others);
	if (in)
		tell_incident(&m, in, others, b);
	else if (blame_spender(&m, &spender))
		tell_spender(&m, &spender, b);
}

/* The device that was not OK for longest; one that is LOST at the end comes before all others. */
void bb_blame_device(const struct bb_run_result *r, struct bb_budget_result *b)
{
	const struct bb_device_result *worst = NULL;
	const struct bb_incident *in = NULL;
	const bool lost = bb_device_lost_at_end(r);

	for (size_t i = 0; i < r->n_devices; i++) {
		const struct bb_device_result *d = &r->devices[i];
		if (!bb_device_in_use(d) || (lost && strcmp(d->health, bb_health_text(BB_HEALTH_LOST))))
			continue;
		if (!worst || d->longest_bad_s > worst->longest_bad_s)
			worst = d;
	}
	if (!worst) {
		bb_blame(r, b, b->budget.limit);
		return;
	}
	bb_text_format(b->culprit, sizeof(b->culprit), "%s/%s", worst->class_name, worst->id);
	for (size_t i = 0; i < r->n_incidents; i++) {
		const struct bb_incident *c = &r->incidents[i];
		if (!strcmp(c->culprit, b->culprit) && (!in || c->to_ns - c->from_ns > in->to_ns - in->from_ns))
			in = c;
	}
	b->cause_ns = in ? in->from_ns : 0;
	bb_text_format(b->cause, sizeof(b->cause), "%s %s for %.3g s%s%.100s%s", b->culprit,
	         lost ? "LOST at the end, not OK" : "not OK", worst->longest_bad_s, in ? " (" : "", in ? in->what : "",
	         in ? ")" : "");
	if (in) {
		const size_t n = strlen(b->cause);
		bb_text_format(b->cause + n, sizeof(b->cause) - n, " from %.3f s", (double)in->from_ns * 1e-9);
	}
}
