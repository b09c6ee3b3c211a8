/*
 * bench/report/trace.c: trace.json for Perfetto and chrome://tracing: a process a node, a thread a stage, spans in us of
 * clock time; the room's own process carries vsync, shutter, strobe and barrier tracks, incidents and faults.
 *
 * Spans of one thread must nest, and pipelined frames overlap: each stage has as many lanes as it needs, and a span
 * goes into the first lane that is free. One thread.
 */
#include "bench/blame.h"
#include "bench/file.h"
#include "bench/result.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* About 100 MB of text: what a viewer still opens. A wall of 416 screens must not crowd its nodes' spans out. */
#define SPANS_MOST ((size_t)400000)
#define EVENTS_MOST ((size_t)600000)
#define LANES 64
#define ROOM_PID 1

enum { TID_INCIDENTS = 5000, TID_FAULTS = 5001, TID_TRACKS = 10000, TID_TRACK_STEP = 10000 };

struct lanes {
	int64_t busy_until_ns[LANES];
	int n;
};

struct trace {
	FILE *f;
	const struct bb_run_result *r;
	struct lanes *lanes; /* [node or room][stage] */
	size_t n_events, left_out;
};

static int pid_of(const struct trace *t, size_t node)
{
	return node < t->r->room->n_nodes ? (int)node + ROOM_PID + 1 : ROOM_PID;
}

static void put_us(FILE *f, int64_t ns)
{
	const uint64_t abs_ns = ns < 0 ? 0 - (uint64_t)ns : (uint64_t)ns;

	fprintf(f, "%s%llu.%03u", ns < 0 ? "-" : "", (unsigned long long)(abs_ns / 1000), (unsigned)(abs_ns % 1000));
}

/* "kind" is process_name or thread_name; sort keeps the order of the house instead of the alphabet. */
static void put_name(struct trace *t, const char *kind, int pid, int tid, const char *name, int sort)
{
	const bool process = !strcmp(kind, "process");

	fprintf(t->f, ",\n{\"ph\":\"M\",\"name\":\"%s_name\",\"pid\":%d,\"tid\":%d,\"args\":{\"name\":", kind, pid, tid);
	bb_put_json(t->f, name);
	fprintf(t->f,
	        "}},\n{\"ph\":\"M\",\"name\":\"%s_sort_index\",\"pid\":%d,\"tid\":%d,\"args\":{\"sort_index\":%d}}",
	        kind, pid, process ? 0 : tid, sort);
}

static bool room_for_one(struct trace *t, size_t most)
{
	if (t->n_events < most) {
		t->n_events++;
		return true;
	}
	t->left_out++;
	return false;
}

/* ---- spans ---- */

static int by_start(const void *a, const void *b)
{
	const struct bb_span *x = *(const struct bb_span *const *)a, *y = *(const struct bb_span *const *)b;

	if (x->start_ns != y->start_ns)
		return x->start_ns < y->start_ns ? -1 : 1;
	if (x->end_ns != y->end_ns)
		return x->end_ns > y->end_ns ? -1 : 1;
	return x < y ? -1 : x > y; /* one array: the order of recording */
}

static int lane_for(struct lanes *l, const struct bb_span *s)
{
	for (int i = 0; i < l->n; i++)
		if (l->busy_until_ns[i] <= s->start_ns) {
			l->busy_until_ns[i] = s->end_ns;
			return i;
		}
	if (l->n == LANES)
		return -1;
	l->busy_until_ns[l->n] = s->end_ns;
	return l->n++;
}

static void put_span(struct trace *t, const struct bb_span *s)
{
	const size_t n_nodes = t->r->room->n_nodes, node = s->node < n_nodes ? s->node : n_nodes;
	struct lanes *l = &t->lanes[node * BB_STAGE_COUNT + s->stage];
	const int had = l->n;
	const int lane = s->end_ns >= s->start_ns ? lane_for(l, s) : -1;
	const int tid = (s->stage + 1) * LANES + lane, pid = pid_of(t, node);
	char name[48];

	if (lane < 0 || !room_for_one(t, SPANS_MOST)) {
		t->left_out += lane < 0;
		return;
	}
	if (l->n > had) {
		bb_text_format(name, sizeof(name), lane ? "%s %d" : "%s", bb_stage_text((enum bb_stage)s->stage),
		               lane + 1);
		put_name(t, "thread", pid, tid, name, tid);
	}
	fprintf(t->f, ",\n{\"ph\":\"X\",\"name\":\"%s\",\"pid\":%d,\"tid\":%d,\"ts\":",
	        bb_stage_text((enum bb_stage)s->stage), pid, tid);
	put_us(t->f, s->start_ns);
	fputs(",\"dur\":", t->f);
	put_us(t->f, s->end_ns - s->start_ns);
	fprintf(t->f, ",\"args\":{\"frame\":%llu,\"tag\":%u}}", (unsigned long long)s->frame, s->tag);
}

static enum bb_status put_spans(struct trace *t)
{
	const struct bb_span *span;
	const size_t n = bb_ledger_spans(t->r->ledger, &span);
	const struct bb_span **order = calloc(n + 1, sizeof(*order));

	t->lanes = calloc((t->r->room->n_nodes + 1) * BB_STAGE_COUNT, sizeof(*t->lanes));
	if (!order || !t->lanes) {
		free(order);
		return BB_ERR_NOMEM;
	}
	for (size_t i = 0; i < n; i++)
		order[i] = &span[i];
	qsort(order, n, sizeof(*order), by_start);
	for (size_t i = 0; i < n; i++)
		put_span(t, order[i]);
	free(order);
	return BB_OK;
}

/* ---- marks ---- */

static const char *const track_text[BB_TRACK_KIND_COUNT] = { [BB_TRACK_VSYNC] = "vsync",
	                                                     [BB_TRACK_SHUTTER] = "shutter",
	                                                     [BB_TRACK_STROBE] = "strobe",
	                                                     [BB_TRACK_BARRIER] = "barrier" };

const char *bb_result_track_member(const struct bb_room *room, const struct bb_mark *m)
{
	switch (m->track) {
	case BB_TRACK_VSYNC:
		return m->index < room->n_screens ? room->screens[m->index].id : NULL;
	case BB_TRACK_SHUTTER:
		if (m->index == BB_STAGE_EMITTER)
			return "glasses";
		return room->has_chain && m->index < room->chain.n_stages ? room->chain.stage[m->index] : NULL;
	case BB_TRACK_STROBE:
		return m->index < room->n_cameras ? room->cameras[m->index].id : NULL;
	case BB_TRACK_BARRIER:
		return m->index < room->n_nodes ? room->nodes[m->index].id : NULL;
	}
	return NULL;
}

static void name_track(struct trace *t, const struct bb_mark *m, int tid)
{
	const char *member = bb_result_track_member(t->r->room, m);
	char name[80];

	bb_text_format(name, sizeof(name), member ? "%s %s" : "%s %.0s%u", track_text[m->track], member ? member : "",
	               m->index);
	put_name(t, "thread", ROOM_PID, tid, name, tid);
}

static enum bb_status put_marks(struct trace *t)
{
	const struct bb_mark *mark;
	const size_t n = bb_ledger_marks(t->r->ledger, &mark);
	uint8_t *named = calloc((size_t)BB_TRACK_KIND_COUNT * TID_TRACK_STEP, 1);

	if (!named)
		return BB_ERR_NOMEM;
	for (size_t i = 0; i < n; i++) {
		const struct bb_mark *m = &mark[i];
		if (m->track >= BB_TRACK_KIND_COUNT || m->index >= TID_TRACK_STEP || !room_for_one(t, EVENTS_MOST))
			continue;
		const int slot = m->track * TID_TRACK_STEP + m->index, tid = TID_TRACKS + slot;
		if (!named[slot])
			name_track(t, m, tid);
		named[slot] = 1;
		fprintf(t->f, ",\n{\"ph\":\"i\",\"s\":\"t\",\"name\":\"%s %d\",\"pid\":%d,\"tid\":%d,\"ts\":",
		        track_text[m->track], m->value, ROOM_PID, tid);
		put_us(t->f, m->at_ns);
		fputc('}', t->f);
	}
	free(named);
	return BB_OK;
}

/* ---- what went wrong ---- */

static void put_instant(struct trace *t, int tid, const char *what, const char *name, int64_t scene_ns)
{
	if (scene_ns == BB_NEVER)
		return;
	fprintf(t->f, ",\n{\"ph\":\"i\",\"s\":\"g\",\"pid\":%d,\"tid\":%d,\"name\":", ROOM_PID, tid);
	char text[256];
	bb_text_format(text, sizeof(text), "%s: %s", what, name);
	bb_put_json(t->f, text);
	fputs(",\"ts\":", t->f);
	put_us(t->f, scene_ns + llround(t->r->scene_start_s * 1e9));
	fputc('}', t->f);
}

static void put_trouble(struct trace *t)
{
	char text[256];

	if (t->r->n_incidents)
		put_name(t, "thread", ROOM_PID, TID_INCIDENTS, "incidents", 0);
	for (size_t i = 0; i < t->r->n_incidents; i++) {
		const struct bb_incident *in = &t->r->incidents[i];
		bb_text_format(text, sizeof(text), "%s %s (%s)", in->culprit, in->state, in->what);
		put_instant(t, TID_INCIDENTS, "begin", text, in->from_ns);
		put_instant(t, TID_INCIDENTS, "end", text, in->to_ns);
	}
	if (t->r->n_faults)
		put_name(t, "thread", ROOM_PID, TID_FAULTS, "planted faults", 1);
	for (size_t i = 0; i < t->r->n_faults; i++) {
		put_instant(t, TID_FAULTS, "planted", t->r->faults[i].text, t->r->faults[i].set_ns);
		bb_text_format(text, sizeof(text), "%s by %s", t->r->faults[i].text, t->r->faults[i].detected_by);
		put_instant(t, TID_FAULTS, "detected", text, t->r->faults[i].detected_ns);
	}
}

static enum bb_status put_trace(struct trace *t)
{
	enum bb_status st;

	fputs("{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n"
	      "{\"ph\":\"M\",\"name\":\"process_name\",\"pid\":1,\"tid\":0,\"args\":{\"name\":\"room\"}}",
	      t->f);
	for (size_t i = 0; i < t->r->room->n_nodes; i++) {
		char name[BB_ID_MAX + 8];
		bb_text_format(name, sizeof(name), "node %s", t->r->room->nodes[i].id);
		put_name(t, "process", pid_of(t, i), 0, name, (int)i + ROOM_PID + 1);
	}
	put_trouble(t);
	st = put_spans(t);
	if (st == BB_OK)
		st = put_marks(t);
	fputs("\n],\"otherData\":{\"room\":", t->f);
	bb_put_json(t->f, t->r->room->name);
	fputs(",\"scene\":", t->f);
	bb_put_json(t->f, t->r->scene->name);
	fprintf(t->f, ",\"seed\":\"%llu\",\"left_out\":\"%llu\"}}\n", (unsigned long long)t->r->seed,
	        (unsigned long long)t->left_out);
	return st;
}

enum bb_status bb_result_write_trace(const struct bb_run_result *r, const char *path, struct bb_error *err)
{
	struct trace t = { .r = r };
	struct bb_file f;
	enum bb_status st = bb_file_begin(&f, path, err);

	if (st != BB_OK)
		return st;
	t.f = f.out;
	st = put_trace(&t);
	free(t.lanes);
	if (st != BB_OK) {
		bb_file_abort(&f);
		return bb_fail(err, st, 1702, NULL, "trace.json");
	}
	return bb_file_commit(&f, err);
}
