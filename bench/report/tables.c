/*
 * bench/report/tables.c: the report's tables. A room of 416 monitors must stay readable: devices are
 * grouped by class, those that misbehaved stand alone, the full list is folded away.
 */
#include "bench/report/html.h"

#include "bench/file.h"
#include "bench/stats.h"

#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

/* ---- verdicts ---- */

static void put_cause(FILE *f, const struct bb_budget_result *b)
{
	const size_t n = strlen(b->culprit);

	fputs("<td>", f);
	if (n && !strncmp(b->cause, b->culprit, n)) {
		fputs("<b class=\"who\">", f);
		bb_put_markup(f, b->culprit);
		fputs("</b>", f);
		bb_put_markup(f, b->cause + n);
	} else {
		bb_put_markup(f, b->cause);
	}
	fputs("</td>", f);
}

static void put_budget(FILE *f, const struct bb_budget_result *b)
{
	const struct bb_metric_info *info = bb_metric_info(b->budget.metric);
	const char *verdict = bb_verdict_text(b->verdict);
	char number[32], text[64];

	fprintf(f, "<tr class=\"%s\"><td class=\"w\" title=\"", verdict);
	bb_put_markup(f, info->help);
	if (b->budget.where.file)
		bb_put_markupf(f, " (%s:%d)", b->budget.where.file, b->budget.where.line);
	fprintf(f, "\">%s <span class=\"stat\">%s</span></td>", info->name, bb_stat_text(b->budget.stat));
	bb_cell_number(f, b->value);
	bb_text_number(number, sizeof(number), b->uncertainty);
	bb_text_format(text, sizeof(text), "%s%s %s", b->uncertainty > 0 ? "\xC2\xB1\xE2\x80\xAF" : "",
	               b->uncertainty > 0 ? number : "", isnan(b->value) ? "" : bb_report_unit(info->unit));
	bb_cell(f, "u", text);
	bb_text_format(text, sizeof(text), "%s %s", info->lower_limit ? "\xE2\x89\xA5" : "\xE2\x89\xA4",
	               bb_text_number(number, sizeof(number), b->budget.limit));
	bb_cell(f, "n", text);
	bb_cell(f, "u", bb_report_unit(info->unit));
	fprintf(f, "<td class=\"w\"><span class=\"tag %s\">%s</span></td>", verdict, verdict);
	put_cause(f, b);
	fputs("</tr>\n", f);
}

void bb_report_verdicts(FILE *f, const struct bb_run_result *r)
{
	fputs("<table><thead><tr><th>Budget</th><th class=\"n\">Value</th><th class=\"u\">&plusmn; 1&sigma;</th>"
	      "<th class=\"n\">Limit</th><th></th><th>Verdict</th><th>Cause</th></tr></thead><tbody>\n",
	      f);
	for (size_t i = 0; i < r->n_budgets; i++)
		put_budget(f, &r->budgets[i]);
	fputs("</tbody></table>\n", f);
}

/* ---- incidents and faults ---- */

static void cell_seconds(FILE *f, int64_t ns, const char *never)
{
	char text[32];

	bb_text_format(text, sizeof(text), "%.3f s", (double)ns * 1e-9);
	bb_cell(f, "n", ns == BB_NEVER ? never : text);
}

static void put_incidents(FILE *f, const struct bb_run_result *r)
{
	fputs("<table><thead><tr><th>Who</th><th>State</th><th class=\"n\">From</th><th class=\"n\">To</th><th>What was "
	      "seen</th></tr></thead><tbody>\n",
	      f);
	for (size_t i = 0; i < r->n_incidents; i++) {
		const struct bb_incident *in = &r->incidents[i];
		fputs("<tr><td class=\"w\"><b class=\"who\">", f);
		bb_put_markup(f, in->culprit);
		fputs("</b></td>", f);
		bb_cell(f, "w", in->state);
		cell_seconds(f, in->from_ns, "?");
		cell_seconds(f, in->to_ns, "the end");
		bb_cell(f, NULL, in->what);
		fputs("</tr>\n", f);
	}
	fputs("</tbody></table>\n", f);
}

static void put_faults(FILE *f, const struct bb_run_result *r)
{
	fputs("<h3>Planted faults</h3><table><thead><tr><th>Fault</th><th class=\"n\">Set</th><th "
	      "class=\"n\">Noticed</th>"
	      "<th class=\"n\">After</th><th>By</th></tr></thead><tbody>\n",
	      f);
	for (size_t i = 0; i < r->n_faults; i++) {
		const struct bb_fault_result *x = &r->faults[i];
		char after[32] = "\xE2\x80\x93";
		if (x->detected_ns != BB_NEVER)
			bb_text_format(after, sizeof(after), "%.0f ms", (double)(x->detected_ns - x->set_ns) * 1e-6);
		fputs("<tr>", f);
		bb_cell(f, "mono", x->text);
		cell_seconds(f, x->set_ns, "?");
		cell_seconds(f, x->detected_ns, "never");
		bb_cell(f, "n", after);
		bb_cell(f, "w", x->detected_by);
		fputs("</tr>\n", f);
	}
	fputs("</tbody></table>\n", f);
}

void bb_report_trouble(FILE *f, const struct bb_run_result *r)
{
	for (size_t k = 0; k < r->n_black; k++) {
		fputs("<p class=\"note\">Black box: ", f);
		bb_put_markup(f, r->black[k].what);
		fputs(r->black[k].n_causes ? "; most likely " : "; nobody was seen to be unwell", f);
		bb_put_markup(f, r->black[k].n_causes ? r->black[k].cause[0].text : "");
		fputs(" (blackbox.txt)</p>\n", f);
	}
	if (r->n_incidents)
		put_incidents(f, r);
	else
		fputs("<p class=\"soft\">No device or node left the state OK.</p>\n", f);
	if (r->n_faults)
		put_faults(f, r);
}

/* ---- stages ---- */

static const char *node_text(const struct bb_run_result *r, uint16_t node)
{
	return node < r->room->n_nodes ? r->room->nodes[node].id : "\xE2\x80\x93";
}

static const char *stage_help(enum bb_stage stage)
{
	static const char *const help[] = {
#define X(id, name, what) [id] = what,
		BB_STAGE_LIST(X)
#undef X
	};

	return help[stage];
}

void bb_report_stages(FILE *f, const struct bb_run_result *r)
{
	fputs("<table><thead><tr><th>Stage</th><th>Covers</th><th class=\"n\">Spans</th><th class=\"n\">Median, ms</th>"
	      "<th class=\"n\">p99, ms</th><th class=\"n\">Longest, ms</th><th class=\"n\">At, s</th><th>Node</th></tr>"
	      "</thead><tbody>\n",
	      f);
	for (size_t i = 0; i < r->n_stages; i++) {
		const struct bb_stage_result *s = &r->stages[i];
		if (s->node != UINT16_MAX || (size_t)s->stage >= BB_STAGE_COUNT)
			continue;
		fprintf(f, "<tr><td class=\"w\"><span class=\"swatch\" style=\"background:%s\"></span>%s</td>",
		        bb_stage_colour(s->stage), bb_stage_text(s->stage));
		bb_cell(f, "soft", stage_help(s->stage));
		bb_cell_count(f, s->summary.n);
		bb_cell_ms(f, s->summary.p50);
		bb_cell_ms(f, s->summary.p99);
		bb_cell_ms(f, s->summary.max);
		bb_cell_ms(f, (double)s->summary.worst.at_ns * 1e-9 - r->scene_start_s);
		bb_cell(f, "w", node_text(r, s->summary.worst.node));
		fputs("</tr>\n", f);
	}
	fputs("</tbody></table>\n", f);
}

static const struct bb_stage_result *stage_of(const struct bb_run_result *r, enum bb_stage stage, size_t node)
{
	for (size_t i = 0; i < r->n_stages; i++)
		if (r->stages[i].stage == stage && r->stages[i].node == node)
			return &r->stages[i];
	return NULL;
}

void bb_report_nodes(FILE *f, const struct bb_run_result *r)
{
	static const enum bb_stage shown[] = { BB_STAGE_STATE, BB_STAGE_SELECT, BB_STAGE_DRAW, BB_STAGE_BARRIER,
		                               BB_STAGE_PRESENT };

	fputs("<h3>By node: median and p99, ms</h3><table><thead><tr><th>Node</th><th>Cost profile</th>", f);
	for (size_t k = 0; k < BB_ARRAY_LEN(shown); k++)
		fprintf(f, "<th class=\"n\">%s</th><th class=\"n\">p99</th>", bb_stage_text(shown[k]));
	fputs("</tr></thead><tbody>\n", f);
	for (size_t i = 0; i < r->room->n_nodes; i++) {
		fputs("<tr>", f);
		bb_cell(f, "w", r->room->nodes[i].id);
		bb_cell(f, "soft", r->room->nodes[i].profile);
		for (size_t k = 0; k < BB_ARRAY_LEN(shown); k++) {
			const struct bb_stage_result *s = stage_of(r, shown[k], i);
			bb_cell_ms(f, s ? s->summary.p50 : BB_UNKNOWN);
			bb_cell_ms(f, s ? s->summary.p99 : BB_UNKNOWN);
		}
		fputs("</tr>\n", f);
	}
	fputs("</tbody></table>\n", f);
}

/* ---- devices ---- */

static bool is_ill(const struct bb_device_result *d)
{
	return d->fidelity != BB_NOT_NEEDED && (d->bad_s > 0 || strcmp(d->health, bb_health_text(BB_HEALTH_OK)));
}

static void device_head(FILE *f)
{
	fputs("<table><thead><tr><th>Device</th><th>Back end</th><th class=\"n\">Fidelity</th><th>At the end</th>"
	      "<th class=\"n\">Not OK, s</th><th class=\"n\">Events</th><th "
	      "class=\"n\">Calls</th><th>Note</th></tr></thead>"
	      "<tbody>\n",
	      f);
}

static void put_device(FILE *f, const struct bb_device_result *d)
{
	const bool used = d->fidelity != BB_NOT_NEEDED;
	char text[64];

	bb_text_format(text, sizeof(text), "%s/%s", d->class_name, d->id);
	fprintf(f, "<tr%s>", used ? "" : " class=\"SKIP\"");
	bb_cell(f, "w", text);
	bb_cell(f, "w", d->backend);
	bb_text_format(text, sizeof(text), "%d", d->fidelity);
	bb_cell(f, "n", used ? text : "not needed");
	bb_cell(f, "w", used ? d->health : "\xE2\x80\x93");
	bb_cell_number(f, used ? d->bad_s : BB_UNKNOWN);
	bb_cell_count(f, d->events);
	bb_cell_count(f, d->ops);
	bb_cell(f, "small", d->note);
	fputs("</tr>\n", f);
}

static void put_class(FILE *f, const struct bb_run_result *r, size_t first)
{
	const char *class_name = r->devices[first].class_name;
	size_t n = 0, used = 0, ill = 0;
	uint64_t events = 0, ops = 0;

	for (size_t i = first; i < r->n_devices; i++) {
		const struct bb_device_result *d = &r->devices[i];
		if (strcmp(d->class_name, class_name))
			continue;
		n++;
		used += d->fidelity != BB_NOT_NEEDED;
		ill += is_ill(d);
		events += d->events;
		ops += d->ops;
	}
	fprintf(f, "<tr%s>", used ? "" : " class=\"SKIP\"");
	bb_cell(f, "w", class_name);
	bb_cell_count(f, n);
	bb_cell_count(f, used);
	bb_cell_count(f, ill);
	bb_cell_count(f, events);
	bb_cell_count(f, ops);
	fputs("</tr>\n", f);
}

static bool seen_before(const struct bb_run_result *r, size_t i)
{
	for (size_t k = 0; k < i; k++)
		if (!strcmp(r->devices[k].class_name, r->devices[i].class_name))
			return true;
	return false;
}

static void put_classes(FILE *f, const struct bb_run_result *r)
{
	fputs("<table><thead><tr><th>Class</th><th class=\"n\">Devices</th><th class=\"n\">In use</th><th "
	      "class=\"n\">Not OK "
	      "at some time</th><th class=\"n\">Events</th><th class=\"n\">Calls</th></tr></thead><tbody>\n",
	      f);
	for (size_t i = 0; i < r->n_devices; i++)
		if (!seen_before(r, i))
			put_class(f, r, i);
	fputs("</tbody></table>\n", f);
}

#define DEVICES_UNFOLDED 40

void bb_report_devices(FILE *f, const struct bb_run_result *r)
{
	const bool fold = r->n_devices > DEVICES_UNFOLDED;
	size_t ill = 0;

	for (size_t i = 0; i < r->n_devices; i++)
		ill += is_ill(&r->devices[i]);
	put_classes(f, r);
	if (fold && ill) {
		fputs("<h3>Not OK at some time</h3>", f);
		device_head(f);
		for (size_t i = 0; i < r->n_devices; i++)
			if (is_ill(&r->devices[i]))
				put_device(f, &r->devices[i]);
		fputs("</tbody></table>\n", f);
	}
	if (fold)
		fprintf(f, "<details><summary>All %zu devices</summary>\n", r->n_devices);
	else
		fputs("<h3>Every device</h3>", f);
	device_head(f);
	for (size_t i = 0; i < r->n_devices; i++)
		put_device(f, &r->devices[i]);
	fprintf(f, "</tbody></table>%s\n", fold ? "</details>" : "");
}

/* ---- counters, configuration, facts ---- */

void bb_report_counters(FILE *f, const struct bb_run_result *r)
{
	fputs("<div class=\"columns\"><table><tbody>\n", f);
	for (size_t i = 0; i < r->n_counters; i++) {
		fputs("<tr>", f);
		bb_cell(f, "w", r->counters[i].name);
		bb_cell_count(f, r->counters[i].value);
		fputs("</tr>\n", f);
	}
	fputs("</tbody></table></div>\n", f);
}

BB_PRINTF(3, 4)
static void pair(FILE *f, const char *key, const char *fmt, ...)
{
	char text[BB_PATH_MAX_BYTES];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	fputs("<tr>", f);
	bb_cell(f, "w soft", key);
	bb_cell(f, NULL, text);
	fputs("</tr>\n", f);
}

static const char *hex_of(const uint8_t sha256[32], char out[65])
{
	for (size_t i = 0; i < 32; i++)
		snprintf(out + 2 * i, 3, "%02x", sha256[i]);
	return out;
}

static void put_room_configuration(FILE *f, const struct bb_run_result *r)
{
	const struct bb_room *m = r->room;
	char hex[65];

	fputs("<table><tbody>\n", f);
	pair(f, "Room", "%s", m->path);
	pair(f, "SHA-256", "%.16s\xE2\x80\xA6", hex_of(m->sha256, hex));
	pair(f, "Inner size", "%.2f \xC3\x97 %.2f \xC3\x97 %.2f m", m->size_m.x, m->size_m.y, m->size_m.z);
	pair(f, "Eye separation", "%.1f mm", m->eye_separation_m * 1e3);
	pair(f, "Nodes", "%zu", m->n_nodes);
	pair(f, "Walls, screens", "%zu, %zu", m->n_walls, m->n_screens);
	pair(f, "Cameras", "%zu", m->n_cameras);
	pair(f, "Monitors", "%zu", m->n_monitors);
	if (m->has_chain)
		pair(f, "Shutter chain", "%lld stages at %.4g Hz", (long long)m->chain.n_stages,
		     bb_rate_hz(m->chain.rate));
	pair(f, "devices_ok", "at most %.3g s not OK", m->degraded_max_s);
	fputs("</tbody></table>\n", f);
}

static void put_needs(FILE *f, const struct bb_scene *s)
{
	char text[160];
	size_t n = 0;

	text[0] = '\0';
	for (int c = 0; c < BB_CLASS_COUNT; c++)
		if (s->needs[c] != BB_NOT_NEEDED) {
			bb_text_format(text + n, sizeof(text) - n, "%s%s %d", n ? ", " : "",
			               bb_class_text((enum bb_class)c), s->needs[c]);
			n = strlen(text);
		}
	pair(f, "Needs, at fidelity", "%s", n ? text : "nothing");
}

static void put_scene_configuration(FILE *f, const struct bb_run_result *r)
{
	const struct bb_scene *s = r->scene;
	char hex[65];

	fputs("<table><tbody>\n", f);
	pair(f, "Scene", "%s", s->path);
	pair(f, "SHA-256", "%.16s\xE2\x80\xA6", hex_of(s->sha256, hex));
	pair(f, "Technique", "%s", s->technique == BB_TECHNIQUE_VOLUME ? "volume" : "calibration");
	if (s->technique == BB_TECHNIQUE_VOLUME) {
		pair(f, "Data", "%s%s", s->data.file, s->data.file[0] ? "" : s->data.generate);
		pair(f, "Transfer function", "%s", s->transfer_function);
		pair(f, "Time step", "%.3g s", s->data.seconds_per_step);
	}
	pair(f, "Head path", "%s", s->head_path[0] ? s->head_path : "still");
	put_needs(f, s);
	if (s->memory_mib > 0)
		pair(f, "Brick memory", "%.4g MiB a node", s->memory_mib);
	if (s->stream_bricks_per_frame)
		pair(f, "Streaming", "%lld bricks a frame and node", (long long)s->stream_bricks_per_frame);
	fputs("</tbody></table>\n", f);
}

void bb_report_configuration(FILE *f, const struct bb_run_result *r)
{
	fputs("<div class=\"two\">\n", f);
	put_room_configuration(f, r);
	put_scene_configuration(f, r);
	fputs("</div>\n", f);
}

void bb_report_facts(FILE *f, const struct bb_run_result *r)
{
	fputs("<table><tbody>\n", f);
	for (size_t i = 0; i < r->n_facts; i++)
		pair(f, r->facts[i].key, "%s", r->facts[i].value);
	pair(f, "event_log_sha256", "%s", r->event_log_sha256);
	pair(f, "wall_time", "%.2f s (measured, not part of any verdict)", r->wall_time_s);
	fputs("</tbody></table>\n", f);
}
