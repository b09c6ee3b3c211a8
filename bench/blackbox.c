#include "bench/blackbox.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/file.h"

#define APART_NS BB_NS_PER_S
#define BEFORE_NS (BB_NS_PER_S / 2) /* a cause was told at most so long before, */
#define LONGER_MS 0.5               /* than usual: less explains nothing */
#define AFTER_NS (BB_NS_PER_S / 10) /* or, by a slower watch, so long after */

struct dump {
	struct bb_black_trigger trigger;
	size_t n;
	struct bb_event event[BB_BLACKBOX_EVENTS];
};

struct bb_blackbox {
	struct bb_eventlog *log;
	uint64_t total;
	struct bb_event ring[BB_BLACKBOX_EVENTS];
	size_t n_dumps;
	uint64_t triggers;
	struct dump dump[BB_BLACK_MOST];
};

enum bb_status bb_blackbox_create(struct bb_eventlog *events, struct bb_blackbox **out)
{
	struct bb_blackbox *b = calloc(1, sizeof(*b));

	*out = b;
	if (!b)
		return BB_ERR_NOMEM;
	b->log = events;
	return BB_OK;
}

void bb_blackbox_destroy(struct bb_blackbox *b)
{
	free(b);
}

void bb_blackbox_events(struct bb_blackbox *b, const struct bb_event *events, size_t n)
{
	for (size_t i = 0; b && i < n; i++)
		b->ring[b->total++ % BB_BLACKBOX_EVENTS] = events[i];
}

void bb_blackbox_trigger(struct bb_blackbox *b, const struct bb_black_trigger *t)
{
	if (!b)
		return;
	b->triggers++;
	if (b->n_dumps == BB_BLACK_MOST ||
	    (b->n_dumps && t->at_ns - b->dump[b->n_dumps - 1].trigger.at_ns < APART_NS))
		return;
	bb_eventlog_flush(b->log); /* what has not come to the ring yet */
	struct dump *d = &b->dump[b->n_dumps++];
	d->trigger = *t;
	d->n = b->total < BB_BLACKBOX_EVENTS ? (size_t)b->total : BB_BLACKBOX_EVENTS;
	for (size_t i = 0; i < d->n; i++)
		d->event[i] = b->ring[(b->total - d->n + i) % BB_BLACKBOX_EVENTS];
}

/* ---- causes ---- */

static void add(struct bb_black_result *out, double score, const char *culprit, const char *fmt, ...)
	__attribute__((format(printf, 4, 5)));
static void add(struct bb_black_result *out, double score, const char *culprit, const char *fmt, ...)
{
	struct bb_black_cause c = { .score = score };
	size_t at = out->n_causes;
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(c.text, sizeof(c.text), fmt, ap);
	va_end(ap);
	bb_text_format(c.culprit, sizeof(c.culprit), "%s", culprit);
	while (at > 0 && out->cause[at - 1].score < score)
		at--;
	if (at == BB_BLACK_CAUSES)
		return;
	out->n_causes += out->n_causes < BB_BLACK_CAUSES;
	memmove(&out->cause[at + 1], &out->cause[at], (out->n_causes - 1 - at) * sizeof(c));
	out->cause[at] = c;
}

static double usual_ms(const struct bb_run_result *r, enum bb_stage stage, uint16_t node)
{
	const double ms = bb_ledger_stage(r->ledger, stage, node).p50;

	return isnan(ms) ? 0 : ms;
}

/* Of the frame that came late: the stage that took longest beyond what it usually takes. */
static void blame_stages(const struct bb_run_result *r, const struct bb_black_trigger *t, struct bb_black_result *out)
{
	const double select_ms = usual_ms(r, BB_STAGE_SELECT, t->node);
	const struct {
		const char *what;
		double ms, usual;
	} stage[] = { { "its bricks", (double)t->load_ns * 1e-6, select_ms },
		      { "the choice of bricks", (double)t->select_ns * 1e-6, select_ms },
		      { "drawing", (double)t->draw_ns * 1e-6, usual_ms(r, BB_STAGE_DRAW, t->node) },
		      { "the scene state on its way there", (double)t->state_ns * 1e-6, usual_ms(r, BB_STAGE_STATE, t->node) } };
	char name[64];

	bb_text_format(name, sizeof(name), "node/%s", r->room->nodes[t->node].id);
	for (size_t i = 0; i < BB_ARRAY_LEN(stage); i++)
		if (stage[i].ms - stage[i].usual > LONGER_MS)
			add(out, 10 + stage[i].ms - stage[i].usual, name, "%s late at frame %llu: %s took %.3g ms (usually %.3g)",
			    name, (unsigned long long)t->frame, stage[i].what, stage[i].ms, stage[i].usual);
}

static void blame_node(const struct bb_run_result *r, const struct bb_black_trigger *t, struct bb_black_result *out)
{
	char name[64];

	if (t->node >= r->room->n_nodes)
		return;
	bb_text_format(name, sizeof(name), "node/%s", r->room->nodes[t->node].id);
	if (t->all_missing)
		add(out, 1000, "link/net", "no node answered at frame %llu: the network is down", (unsigned long long)t->frame);
	else if (t->missing && t->unheard)
		add(out, 900, name, "%s did not come at frame %llu: it never took the scene state (crashed, or cut off)", name,
		    (unsigned long long)t->frame);
	else if (t->missing)
		add(out, 900, name, "%s did not come at frame %llu: it had begun to draw, or its answer was lost", name,
		    (unsigned long long)t->frame);
	else
		blame_stages(r, t, out);
}

/* Who was not well then. What the trigger is about counts most, what began first next. */
static void blame_incidents(const struct bb_run_result *r, const struct bb_black_trigger *t, int64_t scene_start_ns,
                            struct bb_black_result *out)
{
	static const struct {
		const char *state;
		double score;
	} worth[] = { { "LOST", 8 }, { "HOLDOVER", 6 }, { "DEGRADED", 4 }, { "WARNING", 2 } };
	const int64_t at_ns = t->at_ns - scene_start_ns;

	for (size_t i = 0; i < r->n_incidents; i++) {
		const struct bb_incident *in = &r->incidents[i];
		double score = 0;
		if (in->from_ns > at_ns + AFTER_NS || in->to_ns < at_ns - BEFORE_NS)
			continue;
		for (size_t k = 0; k < BB_ARRAY_LEN(worth); k++)
			score = strcmp(in->state, worth[k].state) ? score : worth[k].score;
		score += t->culprit[0] && !strcmp(in->culprit, t->culprit) ? 100 : 0;
		score += in->from_ns <= at_ns ? 1 : 0;
		add(out, score, in->culprit, "%s %s since %.3f s: %.120s", in->culprit, in->state, (double)in->from_ns * 1e-9, in->what);
	}
}

static void tell_trigger(const struct bb_run_result *r, const struct bb_black_trigger *t, char *out, size_t cap)
{
	const char *node = t->node < r->room->n_nodes ? r->room->nodes[t->node].id : "?";
	const double at_s = (double)t->at_ns * 1e-9 - r->scene_start_s;

	if (t->kind == BB_BLACK_LOCK)
		bb_text_format(out, cap, "lock lost at %.3f s, frame %llu", at_s, (unsigned long long)t->frame);
	else if (t->kind == BB_BLACK_LATE)
		bb_text_format(out, cap, "frame %llu late at %.3f s, last was node/%s", (unsigned long long)t->frame, at_s, node);
	else
		bb_text_format(out, cap, "frame %llu never shown by %s, %.3f s", (unsigned long long)t->frame, t->culprit, at_s);
}

void bb_blackbox_rank(const struct bb_blackbox *b, struct bb_run_result *r)
{
	const int64_t scene_start_ns = llround(r->scene_start_s * 1e9);

	for (size_t i = 0; b && i < b->n_dumps; i++) {
		const struct bb_black_trigger *t = &b->dump[i].trigger;
		struct bb_black_result *out = &r->black[r->n_black++];
		*out = (struct bb_black_result){ .at_ns = t->at_ns - scene_start_ns };
		tell_trigger(r, t, out->what, sizeof(out->what));
		if (t->kind == BB_BLACK_LATE)
			blame_node(r, t, out);
		blame_incidents(r, t, scene_start_ns, out);
	}
}

/* ---- files ---- */

static json_t *dump_json(const struct bb_blackbox *b, const struct dump *d, const struct bb_black_result *r, double start_s)
{
	json_t *o = json_object(), *causes = json_array(), *events = json_array();

	json_object_set_new(o, "what", json_string(r->what));
	json_object_set_new(o, "at_s", json_real((double)r->at_ns * 1e-9));
	for (size_t i = 0; i < r->n_causes; i++)
		json_array_append_new(causes, json_pack("{s:s, s:s}", "culprit", r->cause[i].culprit, "cause", r->cause[i].text));
	json_object_set_new(o, "causes", causes);
	for (size_t i = 0; i < d->n; i++) {
		const struct bb_event *e = &d->event[i];
		json_array_append_new(events, json_pack("{s:f, s:s, s:s, s:I, s:I}", "at_s", (double)e->at_ns * 1e-9 - start_s,
		                                        "who", b->log->names[e->source], "what",
		                                        bb_event_kind_text((enum bb_event_kind)e->kind), "a", (json_int_t)e->a, "b",
		                                        (json_int_t)e->b));
	}
	json_object_set_new(o, "events", events);
	return o;
}

static void print_text(const struct bb_blackbox *b, const struct bb_run_result *r, FILE *out)
{
	for (size_t i = 0; i < r->n_black; i++) {
		const struct bb_black_result *k = &r->black[i];
		fprintf(out, "%s\n", k->what);
		for (size_t c = 0; c < k->n_causes; c++)
			fprintf(out, "  %zu. %s\n", c + 1, k->cause[c].text);
		if (!k->n_causes)
			fprintf(out, "  nobody was seen to be unwell\n");
		fprintf(out, "  the last %zu events before it:\n", b->dump[i].n);
		for (size_t e = 0; e < b->dump[i].n; e++) {
			const struct bb_event *v = &b->dump[i].event[e];
			fprintf(out, "  %12.6f s  %-24s %-8s %lld %lld\n", (double)v->at_ns * 1e-9 - r->scene_start_s,
			        b->log->names[v->source], bb_event_kind_text((enum bb_event_kind)v->kind), (long long)v->a,
			        (long long)v->b);
		}
		fprintf(out, "\n");
	}
	fprintf(out, "%llu times in all that something went wrong; the first %zu, a second apart, are kept\n",
	        (unsigned long long)b->triggers, r->n_black);
}

static void print_json(const struct bb_blackbox *b, const struct bb_run_result *r, FILE *out)
{
	json_t *root = json_array();

	for (size_t i = 0; i < r->n_black; i++)
		json_array_append_new(root, dump_json(b, &b->dump[i], &r->black[i], r->scene_start_s));
	json_dumpf(root, out, JSON_INDENT(1) | JSON_REAL_PRECISION(12));
	fputc('\n', out);
	json_decref(root);
}

enum bb_status bb_blackbox_write(const struct bb_blackbox *b, const struct bb_run_result *r, const char *dir,
                                 struct bb_error *err)
{
	static const struct {
		const char *name;
		void (*print)(const struct bb_blackbox *, const struct bb_run_result *, FILE *);
	} files[] = { { "blackbox.txt", print_text }, { "blackbox.json", print_json } };
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < BB_ARRAY_LEN(files) && b && dir && r->n_black && status == BB_OK; i++) {
		char path[BB_PATH_MAX_BYTES + 32];
		struct bb_file f;
		snprintf(path, sizeof(path), "%s/%s", dir, files[i].name);
		status = bb_file_begin(&f, path, err);
		if (status != BB_OK)
			break;
		files[i].print(b, r, f.out);
		status = bb_file_commit(&f, err);
	}
	return status;
}
