/*
 * bench/report/json.c: result.json, the master. Numbers are finite or null, lists keep the order of the run, counters
 * and facts are sorted by name. The "gate" section holds the integers that bench/gate.c compares. One thread.
 */
#include "bench/file.h"
#include "bench/gate.h"
#include "bench/latency.h"
#include "bench/stats.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static json_t *number(double v)
{
	return isfinite(v) ? json_real(v) : json_null();
}

/* json_int_t is signed: a seed of the upper half is written as text rather than as a negative number. */
static json_t *whole(uint64_t v)
{
	char text[24];

	if (v <= INT64_MAX)
		return json_integer((json_int_t)v);
	bb_text_format(text, sizeof(text), "%llu", (unsigned long long)v);
	return json_string(text);
}

static json_t *seconds(int64_t ns)
{
	return ns == BB_NEVER ? json_null() : json_real((double)ns * 1e-9);
}

static json_t *text(const char *s)
{
	char clean[BB_PATH_MAX_BYTES];

	bb_text_clean(clean, sizeof(clean), s);
	return json_string(clean);
}

static json_t *sha256_text(const uint8_t sha256[32])
{
	char hex[65];

	for (size_t i = 0; i < 32; i++)
		snprintf(hex + 2 * i, 3, "%02x", sha256[i]);
	return json_string(hex);
}

static const char *node_text(const struct bb_run_result *r, uint16_t node)
{
	return node < r->room->n_nodes ? r->room->nodes[node].id : "";
}

static json_t *summary_json(const struct bb_run_result *r, const struct bb_summary *s)
{
	json_t *o = json_object();

	json_object_set_new(o, "n", whole(s->n));
	json_object_set_new(o, "min", number(s->min));
	json_object_set_new(o, "p50", number(s->p50));
	json_object_set_new(o, "p99", number(s->p99));
	json_object_set_new(o, "max", number(s->max));
	json_object_set_new(o, "mean", number(s->mean));
	json_object_set_new(o, "rms", number(s->rms));
	json_object_set_new(o, "max_abs", number(s->max_abs));
	if (s->n && isfinite(s->worst.value)) {
		json_object_set_new(o, "worst_frame", whole(s->worst.frame));
		json_object_set_new(o, "worst_at_s", number((double)s->worst.at_ns * 1e-9 - r->scene_start_s));
		json_object_set_new(o, "worst_node", text(node_text(r, s->worst.node)));
	}
	return o;
}

static json_t *budget_json(const struct bb_run_result *r, const struct bb_budget_result *b)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	json_t *o = json_object();

	json_object_set_new(o, "metric", json_string(info->name));
	json_object_set_new(o, "statistic", json_string(bb_stat_text(b->budget.stat)));
	json_object_set_new(o, "unit", json_string(info->unit));
	json_object_set_new(o, "limit", number(b->budget.limit));
	json_object_set_new(o, "marginal", number(b->budget.marginal));
	json_object_set_new(o, "lower_limit", json_boolean(info->lower_limit));
	json_object_set_new(o, "owner", text(b->budget.owner));
	json_object_set_new(o, "file", b->budget.where.file ? text(b->budget.where.file) : json_null());
	json_object_set_new(o, "line", json_integer(b->budget.where.line));
	json_object_set_new(o, "verdict", json_string(bb_verdict_text(b->verdict)));
	json_object_set_new(o, "value", number(b->value));
	json_object_set_new(o, "uncertainty", number(b->uncertainty));
	json_object_set_new(o, "culprit", text(b->culprit));
	json_object_set_new(o, "cause", text(b->cause));
	json_object_set_new(o, "cause_s", b->culprit[0] ? seconds(b->cause_ns) : json_null());
	json_object_set_new(o, "summary", summary_json(r, &b->summary));
	return o;
}

static json_t *budgets_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_budgets; i++)
		json_array_append_new(a, budget_json(r, &r->budgets[i]));
	return a;
}

static json_t *stages_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_stages; i++) {
		json_t *o = json_object();
		json_object_set_new(o, "stage", json_string(bb_stage_text(r->stages[i].stage)));
		json_object_set_new(o, "node", text(node_text(r, r->stages[i].node)));
		json_object_set_new(o, "unit", json_string("ms"));
		json_object_set_new(o, "summary", summary_json(r, &r->stages[i].summary));
		json_array_append_new(a, o);
	}
	return a;
}

static json_t *link_json(const struct bb_run_result *r, const struct bb_latency_link *k)
{
	json_t *o = json_object();

	json_object_set_new(o, "link", json_string(k->name));
	json_object_set_new(o, "owner", json_string(k->owner));
	json_object_set_new(o, "by", json_string(k->modelled ? "modelled" : "measured"));
	json_object_set_new(o, "unit", json_string("ms"));
	json_object_set_new(o, "uncertainty", number(k->uncertainty_ms));
	json_object_set_new(o, "summary", summary_json(r, &k->summary));
	return o;
}

static json_t *prediction_json(const struct bb_prediction *p)
{
	json_t *o = json_object();

	json_object_set_new(o, "frames", whole(p->n));
	json_object_set_new(o, "horizon_ms", number(p->horizon_ms));
	json_object_set_new(o, "with_rms_mm", number(p->with_mm));
	json_object_set_new(o, "without_rms_mm", number(p->without_mm));
	json_object_set_new(o, "with_rms_deg", number(p->with_deg));
	json_object_set_new(o, "without_rms_deg", number(p->without_deg));
	return o;
}

static json_t *self_test_json(const struct bb_latency_test *t)
{
	json_t *o = json_object();

	if (!t->n) {
		json_decref(o);
		return json_null();
	}
	json_object_set_new(o, "edges", whole(t->n));
	json_object_set_new(o, "lamp_to_light_mean_ms", number(t->end_ms));
	json_object_set_new(o, "lamp_to_light_most_ms", number(t->most_ms));
	json_object_set_new(o, "links_mean_ms", number(t->links_ms));
	json_object_set_new(o, "off_mean_ms", number(t->off_ms));
	json_object_set_new(o, "off_scatter_ms", number(t->scatter_ms));
	return o;
}

static json_t *latency_json(const struct bb_run_result *r)
{
	struct bb_latency l;
	json_t *o, *a;

	if (!bb_latency_of(r, &l) || !l.n)
		return json_null();
	o = json_object();
	a = json_array();
	for (int i = 0; i < BB_LINK_COUNT; i++)
		json_array_append_new(a, link_json(r, &l.link[i]));
	json_object_set_new(o, "frames", whole(l.n));
	json_object_set_new(o, "links", a);
	json_object_set_new(o, "total", summary_json(r, &l.total));
	json_object_set_new(o, "uncertainty", number(l.uncertainty_ms));
	json_object_set_new(o, "within_50_ms", number(l.within_50));
	json_object_set_new(o, "within_20_ms", number(l.within_20));
	json_object_set_new(o, "floor_ms", number(l.floor_ms));
	json_object_set_new(o, "attack", text(l.attack));
	json_object_set_new(o, "prediction", prediction_json(&l.prediction));
	json_object_set_new(o, "self_test", self_test_json(&r->latency_test));
	return o;
}

static json_t *devices_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_devices; i++) {
		const struct bb_device_result *d = &r->devices[i];
		json_t *o = json_object();
		json_object_set_new(o, "class", text(d->class_name));
		json_object_set_new(o, "id", text(d->id));
		json_object_set_new(o, "backend", text(d->backend));
		json_object_set_new(o, "fidelity",
		                    d->fidelity == BB_NOT_NEEDED ? json_null() : json_integer(d->fidelity));
		json_object_set_new(o, "health", text(d->health));
		json_object_set_new(o, "longest_bad_s", number(d->longest_bad_s));
		json_object_set_new(o, "bad_s", number(d->bad_s));
		json_object_set_new(o, "events", whole(d->events));
		json_object_set_new(o, "ops", whole(d->ops));
		json_object_set_new(o, "note", text(d->note));
		json_array_append_new(a, o);
	}
	return a;
}

static json_t *incidents_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_incidents; i++) {
		json_t *o = json_object();
		json_object_set_new(o, "culprit", text(r->incidents[i].culprit));
		json_object_set_new(o, "what", text(r->incidents[i].what));
		json_object_set_new(o, "state", text(r->incidents[i].state));
		json_object_set_new(o, "from_s", seconds(r->incidents[i].from_ns));
		json_object_set_new(o, "to_s", seconds(r->incidents[i].to_ns));
		json_array_append_new(a, o);
	}
	return a;
}

static json_t *faults_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_faults; i++) {
		json_t *o = json_object();
		json_object_set_new(o, "text", text(r->faults[i].text));
		json_object_set_new(o, "set_s", seconds(r->faults[i].set_ns));
		json_object_set_new(o, "detected_s", seconds(r->faults[i].detected_ns));
		json_object_set_new(o, "detected_by", text(r->faults[i].detected_by));
		json_array_append_new(a, o);
	}
	return a;
}

static json_t *pictures_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_pictures; i++) {
		const struct bb_picture_result *p = &r->pictures[i];
		json_t *o = json_object();
		json_object_set_new(o, "file", text(p->file));
		json_object_set_new(o, "wall", text(p->wall));
		json_object_set_new(o, "eye", text(p->eye));
		json_object_set_new(o, "at_s", number(p->at_s));
		json_object_set_new(o, "width_px", whole(p->width));
		json_object_set_new(o, "height_px", whole(p->height));
		/* Equal pictures have no finite ratio: 200 dB, and `identical` says it. */
		json_object_set_new(o, "psnr_db", number(p->psnr_db > 200 ? 200 : p->psnr_db));
		json_object_set_new(o, "identical", json_boolean(p->identical));
		json_object_set_new(o, "rays", whole(p->rays));
		json_object_set_new(o, "samples", whole(p->samples));
		json_array_append_new(a, o);
	}
	return a;
}

static json_t *load_json(const struct bb_run_result *r, const struct bb_stream_load *l, size_t node)
{
	json_t *o = json_object();

	json_object_set_new(o, "frame", whole(l->frame));
	json_object_set_new(o, "at_s", seconds(l->at_ns));
	json_object_set_new(o, "node", text(node_text(r, (uint16_t)node)));
	json_object_set_new(o, "bricks", whole(l->bricks));
	json_object_set_new(o, "bytes", whole(l->bytes));
	json_object_set_new(o, "ms", number(l->ms));
	json_object_set_new(o, "frame_ms", number(l->frame_ms));
	json_object_set_new(o, "share_of_limit", number(l->ms / r->streaming.limit_ms));
	return o;
}

static json_t *total_json(const struct bb_stream_total *t, uint64_t frames)
{
	json_t *o = json_object();

	json_object_set_new(o, "mean", number((double)t->sum / (double)frames));
	json_object_set_new(o, "most", whole(t->most));
	return o;
}

static json_t *stream_node_json(const struct bb_run_result *r, size_t i)
{
	const struct bb_stream_node *n = &r->streaming.nodes[i];
	const double budget = n->budget_bytes ? (double)n->budget_bytes : BB_UNKNOWN;
	json_t *o = json_object();

	json_object_set_new(o, "node", text(r->room->nodes[i].id));
	json_object_set_new(o, "memory_budget_bytes", n->budget_bytes ? whole(n->budget_bytes) : json_null());
	json_object_set_new(o, "memory_held_bytes", whole(n->held_bytes));
	json_object_set_new(o, "data_over_memory", number((double)r->streaming.data_bytes / budget));
	json_object_set_new(o, "bricks_a_frame_budget", n->budget_bricks ? whole(n->budget_bricks) : json_null());
	json_object_set_new(o, "bricks_read", total_json(&n->loaded, n->frames));
	json_object_set_new(o, "bytes_read", total_json(&n->bytes, n->frames));
	json_object_set_new(o, "bricks_drawn", total_json(&n->drawn, n->frames));
	json_object_set_new(o, "bricks_missing", total_json(&n->missing, n->frames));
	json_object_set_new(o, "deficit_cells", total_json(&n->deficit, n->frames));
	json_object_set_new(o, "evicted", whole(n->evicted));
	json_object_set_new(o, "prefetched", whole(n->prefetched));
	json_object_set_new(o, "values_out_of_range", whole(n->odd));
	json_object_set_new(o, "failed", whole(n->failed));
	json_object_set_new(o, "error", n->error ? json_integer(n->error) : json_null());
	json_object_set_new(o, "error_text", n->error ? text(n->error_text) : json_null());
	json_object_set_new(o, "mean_load_share_of_limit",
	                    number(n->load_sum_ms / (double)n->frames / r->streaming.limit_ms));
	json_object_set_new(o, "most_spent", load_json(r, &n->most, i));
	json_object_set_new(o, "frames_late_by_bricks", whole(n->late));
	json_object_set_new(o, "worst_late", n->late ? load_json(r, &n->worst, i) : json_null());
	return o;
}

static json_t *streaming_json(const struct bb_run_result *r)
{
	const struct bb_stream_result *s = &r->streaming;
	json_t *o, *nodes;
	char sentence[256];

	if (!s->n_nodes)
		return json_null();
	o = json_object();
	nodes = json_array();
	for (size_t i = 0; i < s->n_nodes; i++)
		if (s->nodes[i].frames)
			json_array_append_new(nodes, stream_node_json(r, i));
	bb_result_loads(r, sentence, sizeof(sentence));
	json_object_set_new(o, "data_bytes", whole(s->data_bytes));
	json_object_set_new(o, "leaf_brick_bytes", whole(s->leaf_bytes));
	json_object_set_new(o, "leaf_cells", whole(s->leaf_cells));
	json_object_set_new(o, "brick_bytes", whole(s->brick_bytes));
	json_object_set_new(o, "frame_limit_ms", number(s->limit_ms));
	json_object_set_new(o, "brick_loads", text(sentence));
	json_object_set_new(o, "nodes", nodes);
	return o;
}

static int by_counter(const void *a, const void *b)
{
	return strcmp(((const struct bb_counter *)a)->name, ((const struct bb_counter *)b)->name);
}

static json_t *counters_json(const struct bb_run_result *r)
{
	struct bb_counter sorted[BB_COUNTERS_MAX];
	json_t *o = json_object();

	memcpy(sorted, r->counters, sizeof(sorted));
	qsort(sorted, r->n_counters, sizeof(sorted[0]), by_counter);
	for (size_t i = 0; i < r->n_counters; i++)
		json_object_set_new(o, sorted[i].name, whole(sorted[i].value));
	return o;
}

static int by_fact(const void *a, const void *b)
{
	return strcmp(((const struct bb_text_pair *)a)->key, ((const struct bb_text_pair *)b)->key);
}

static json_t *facts_json(const struct bb_run_result *r)
{
	struct bb_text_pair sorted[BB_ARRAY_LEN(r->facts)];
	json_t *o = json_object();

	memcpy(sorted, r->facts, sizeof(sorted));
	qsort(sorted, r->n_facts, sizeof(sorted[0]), by_fact);
	for (size_t i = 0; i < r->n_facts; i++)
		json_object_set_new(o, sorted[i].key, text(sorted[i].value));
	return o;
}

static json_t *source_json(const char *name, const char *path, const uint8_t sha256[32])
{
	json_t *o = json_object();

	json_object_set_new(o, "name", text(name));
	json_object_set_new(o, "file", text(path));
	json_object_set_new(o, "sha256", sha256_text(sha256));
	return o;
}

static json_t *needs_json(const struct bb_scene *scene)
{
	json_t *o = json_object();

	for (int c = 0; c < BB_CLASS_COUNT; c++)
		json_object_set_new(o, bb_class_text((enum bb_class)c),
		                    scene->needs[c] == BB_NOT_NEEDED ? json_null() : json_integer(scene->needs[c]));
	return o;
}

static json_t *black_json(const struct bb_run_result *r)
{
	json_t *a = json_array();

	for (size_t i = 0; i < r->n_black; i++) {
		json_t *o = json_object(), *causes = json_array();
		json_object_set_new(o, "what", text(r->black[i].what));
		json_object_set_new(o, "at_s", number((double)r->black[i].at_ns * 1e-9));
		for (size_t k = 0; k < r->black[i].n_causes; k++)
			json_array_append_new(causes, text(r->black[i].cause[k].text));
		json_object_set_new(o, "causes", causes);
		json_array_append_new(a, o);
	}
	return a;
}

static void set_run(json_t *root, const struct bb_run_result *r)
{
	json_object_set_new(root, "schema", json_integer(BB_RESULT_SCHEMA));
	json_object_set_new(root, "kind", json_string("blackburst-result"));
	json_object_set_new(root, "verdict", json_string(bb_verdict_text(r->verdict)));
	json_object_set_new(root, "exit_code", json_integer(r->exit_code));
	json_object_set_new(root, "summary", text(r->summary));
	json_object_set_new(root, "room", source_json(r->room->name, r->room->path, r->room->sha256));
	json_object_set_new(root, "scene", source_json(r->scene->name, r->scene->path, r->scene->sha256));
	json_object_set_new(root, "needs", needs_json(r->scene));
	json_object_set_new(root, "seed", whole(r->seed));
	json_object_set_new(root, "clock", text(r->clock));
	json_object_set_new(root, "duration_s", number(r->duration_s));
	json_object_set_new(root, "scene_start_s", number(r->scene_start_s));
	json_object_set_new(root, "truncated", json_boolean(r->truncated));
	json_object_set_new(root, "event_log_sha256", text(r->event_log_sha256));
	json_object_set_new(root, "events", whole(r->n_events));
	json_object_set_new(root, "ledger_dropped", whole(bb_ledger_dropped(r->ledger)));
}

char *bb_result_json_text(const struct bb_run_result *r)
{
	json_t *root = json_object(), *measured = json_object();
	char *out;

	set_run(root, r);
	json_object_set_new(root, "budgets", budgets_json(r));
	json_object_set_new(root, "incidents", incidents_json(r));
	json_object_set_new(root, "faults", faults_json(r));
	json_object_set_new(root, "black_box", black_json(r));
	json_object_set_new(root, "stages", stages_json(r));
	json_object_set_new(root, "latency", latency_json(r));
	json_object_set_new(root, "devices", devices_json(r));
	json_object_set_new(root, "pictures", pictures_json(r));
	json_object_set_new(root, "streaming", streaming_json(r));
	json_object_set_new(root, "counters", counters_json(r));
	json_object_set_new(root, "gate", bb_gate_section(r));
	json_object_set_new(root, "facts", facts_json(r));
	json_object_set_new(measured, "wall_time_s", number(r->wall_time_s));
	json_object_set_new(root, "measured", measured);
	out = json_dumps(root, JSON_INDENT(2) | JSON_REAL_PRECISION(12));
	json_decref(root);
	return out;
}

enum bb_status bb_result_write_json(const struct bb_run_result *r, const char *path, struct bb_error *err)
{
	char *out = bb_result_json_text(r);
	struct bb_file f;
	enum bb_status st;

	if (!out)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "result.json");
	st = bb_file_begin(&f, path, err);
	if (st == BB_OK) {
		fprintf(f.out, "%s\n", out);
		st = bb_file_commit(&f, err);
	}
	free(out);
	return st;
}
