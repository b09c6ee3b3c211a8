#include "bench/outcome.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>

#include "bench/report/html.h"
#include "bench/report/room_drawing.h"
#include "hal/hash.h"

#ifndef BB_REVISION
#define BB_REVISION "unknown"
#endif

struct device_visit {
	const struct bb_outcome_sources *s;
	struct bb_run_result *r;
};

/* A device may be watched in more than one slot (a chain's phase and its parity): the worst of them counts. */
static void watched(const struct bb_watch *w, const char *name, struct bb_device_result *d)
{
	enum bb_health worst = BB_HEALTH_OK;

	for (size_t i = 0; i < bb_watch_slots(w); i++) {
		if (strcmp(bb_watch_name(w, i), name))
			continue;
		worst = bb_watch_health(w, i) > worst ? bb_watch_health(w, i) : worst;
		d->longest_bad_s = fmax(d->longest_bad_s, bb_watch_longest_bad_s(w, i));
		d->bad_s = fmax(d->bad_s, bb_watch_bad_s(w, i));
	}
	snprintf(d->health, sizeof(d->health), "%s", bb_health_text(worst));
}

static void note_of(const struct bb_outcome_sources *s, enum bb_class class, size_t index, const struct bb_device *dev,
                    char *note, size_t cap)
{
	if (class == BB_CLASS_MONITORS)
		bb_facility_monitor_note(s->facility, index, note, cap);
	else if (class == BB_CLASS_POWER)
		bb_facility_power_note(s->facility, index, note, cap);
	else if (class == BB_CLASS_GAMEPADS && s->loop->pads[index].seen &&
	         isfinite(s->loop->pads[index].report.battery))
		snprintf(note, cap, "battery %.0f %%", 100.0 * (double)s->loop->pads[index].report.battery);
	else if (class == BB_CLASS_CAMERAS && s->loop->tracker) {
		const struct bb_track_camera_stats c = bb_tracker_camera(s->loop->tracker, index);
		snprintf(note, cap, "%llu frames, %llu markers used, %llu missing, residual %.3f px",
		         (unsigned long long)c.frames, (unsigned long long)c.used, (unsigned long long)c.missing,
		         c.residual_px);
	} else if (dev->last_error.status)
		snprintf(note, cap, "%s: %s", dev->last_error.op, dev->last_error.detail);
}

static void visit_device(void *ctx, enum bb_class class, size_t index, const char *class_name, const char *id,
                         const char *uri, struct bb_device *dev)
{
	struct device_visit *v = ctx;
	struct bb_device_result *d = &v->r->devices[v->r->n_devices++];
	char name[64];
	int n_scheme = (int)strcspn(uri, ":");

	snprintf(d->class_name, sizeof(d->class_name), "%s", class_name);
	snprintf(d->id, sizeof(d->id), "%s", id);
	snprintf(d->backend, sizeof(d->backend), "%.*s", n_scheme ? n_scheme : 3, n_scheme ? uri : "sim");
	snprintf(d->health, sizeof(d->health), "%s", "not needed");
	d->fidelity = BB_NOT_NEEDED;
	if (!dev)
		return;
	d->fidelity = v->s->rig->needs[class];
	d->events = v->s->events->per_source[dev->event_source];
	d->ops = dev->ops;
	note_of(v->s, class, index, dev, d->note, sizeof(d->note));
	snprintf(name, sizeof(name), "%s/%s", class_name, id);
	watched(v->s->watch, name, d);
}

static void gather_devices(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	const struct bb_room *room = s->rig->room;
	struct device_visit v = { s, r };

	r->devices = calloc(room->n_cameras + room->n_screens + room->n_monitors + room->n_pdus + room->n_gamepads + 1,
	                    sizeof(*r->devices));
	if (!r->devices)
		return;
	bb_rig_each(s->rig, visit_device, &v);
	for (size_t i = 0; i < r->n_devices; i++) {
		char counter[48];
		snprintf(counter, sizeof(counter), "events_%s", r->devices[i].class_name);
		bb_result_count(r, counter, r->devices[i].events);
	}
}

/* devices_ok: one sample per watched device (nodes have metrics of their own); one that ends LOST counts as bad for the
 * whole scene. */
static void sample_devices(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	for (size_t i = 0; i < bb_watch_slots(s->watch); i++) {
		const bool lost = bb_watch_health(s->watch, i) == BB_HEALTH_LOST;
		if (!strncmp(bb_watch_name(s->watch, i), "node/", 5))
			continue;
		struct bb_sample sample = { .value = bb_watch_longest_bad_s(s->watch, i), .at_ns = s->loop->scene_start_ns,
			                    .node = BB_NOBODY, .stage = BB_STAGE_COUNT };
		const struct bb_incident *in;
		const size_t n = bb_watch_incidents(s->watch, &in);
		if (lost)
			sample.value = fmax(sample.value, r->duration_s);
		for (size_t k = 0; k < n; k++) /* point at the worst stretch, so that its culprit is found */
			if (!strcmp(in[k].culprit, bb_watch_name(s->watch, i)) && strcmp(in[k].state, "WARNING"))
				sample.at_ns = in[k].from_ns;
		bb_ledger_sample(r->ledger, BB_METRIC_DEVICES, &sample);
	}
}

static int64_t scene_ns(const struct bb_outcome_sources *s, int64_t at_ns)
{
	return at_ns == BB_NEVER ? BB_NEVER : at_ns - s->loop->scene_start_ns;
}

static void gather_incidents(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	const struct bb_incident *in;
	const size_t n = bb_watch_incidents(s->watch, &in);

	r->incidents = calloc(n + 1, sizeof(*r->incidents));
	for (size_t i = 0; r->incidents && i < n; i++) {
		struct bb_incident *to = &r->incidents[r->n_incidents++];
		*to = in[i];
		to->from_ns = scene_ns(s, to->from_ns);
		to->to_ns = scene_ns(s, to->to_ns);
	}
}

/* Did an incident of this very device start after the fault was set? Else any later incident counts as its trace. */
static void find_detection(struct bb_fault_result *f, const char *target, const struct bb_run_result *r)
{
	for (int exact = 1; exact >= 0 && f->detected_ns == BB_NEVER; exact--)
		for (size_t i = 0; i < r->n_incidents; i++) {
			const struct bb_incident *in = &r->incidents[i];
			if (in->from_ns < f->set_ns || in->from_ns >= f->detected_ns || (exact && strcmp(in->culprit, target)))
				continue;
			f->detected_ns = in->from_ns;
			snprintf(f->detected_by, sizeof(f->detected_by), "%s", in->culprit);
		}
}

static void gather_faults(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	r->faults = calloc(s->options->n_faults + 1, sizeof(*r->faults));
	for (size_t i = 0; r->faults && i < s->options->n_faults; i++) {
		const struct sim_fault *fault = &s->options->faults[i];
		struct bb_fault_result *f = &r->faults[r->n_faults++];
		struct sim_fault_state state;
		char target[64];

		snprintf(f->text, sizeof(f->text), "%s", fault->text);
		f->detected_ns = f->set_ns = BB_NEVER;
		if (!s->world || !sim_fault_state(s->world, i, &state) || state.set_ns == BB_NEVER)
			continue;
		f->set_ns = scene_ns(s, state.set_ns);
		snprintf(target, sizeof(target), "%s/%s", fault->class_name, fault->id);
		find_detection(f, target, r);
	}
}

/* Time by time, walls in the room's order, left eye first: nodes finish in any order. */
static int by_time_and_wall(const void *a, const void *b)
{
	const struct bb_picture_result *x = a, *y = b;

	if (x->at_s < y->at_s || x->at_s > y->at_s)
		return x->at_s < y->at_s ? -1 : 1;
	if (x->screen != y->screen)
		return x->screen < y->screen ? -1 : 1;
	return strcmp(x->eye, y->eye);
}

static void gather_pictures(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	const struct bb_picture_result *taken;
	const size_t n = s->pictures ? bb_pictures_count(s->pictures, &taken) : 0;
	uint64_t hundredths = 0;

	r->pictures = calloc(n + 1, sizeof(*r->pictures));
	for (size_t i = 0; r->pictures && i < n; i++) {
		const struct bb_sample sample = { .value = taken[i].psnr_db, .at_ns = s->loop->scene_start_ns +
			                                                              (int64_t)(taken[i].at_s * 1e9),
			                          .node = BB_NOBODY, .stage = BB_STAGE_DRAW };
		r->pictures[r->n_pictures++] = taken[i];
		if (!isfinite(taken[i].psnr_db))
			continue;
		hundredths += (uint64_t)llround(taken[i].psnr_db * 100);
		bb_ledger_sample(r->ledger, BB_METRIC_PSNR, &sample);
	}
	if (r->pictures)
		qsort(r->pictures, r->n_pictures, sizeof(*r->pictures), by_time_and_wall);
	if (hundredths)
		bb_result_count(r, "psnr_centibel_sum", hundredths / 10);
}

static void gather_stages(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	const size_t n_nodes = s->rig->room->n_nodes;

	r->stages = calloc(BB_STAGE_COUNT * (n_nodes + 1), sizeof(*r->stages));
	for (int stage = 0; r->stages && stage < BB_STAGE_COUNT; stage++)
		for (size_t i = 0; i <= n_nodes; i++) {
			const uint16_t node = i == n_nodes ? BB_NOBODY : (uint16_t)i;
			const struct bb_summary sum = bb_ledger_stage(r->ledger, (enum bb_stage)stage, node);
			if (sum.n)
				r->stages[r->n_stages++] = (struct bb_stage_result){ (enum bb_stage)stage, node, sum };
		}
}

/* A camera's stamp on host time, a vblank's, an edge's: the most they may be off stands for one sigma. */
static void gather_stamps(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	const struct bb_frame_loop *l = s->loop;

	if (l->tracker)
		r->stamp_error_ms[0] = 1e-6 * hypot((double)l->camera_map[0].uncertainty_ns,
		                                    (double)bb_camera_limits(s->rig->cameras[0])->stamp_error_ns);
	if (l->master_screen >= 0)
		r->stamp_error_ms[1] = 1e-6 * (double)bb_display_limits(s->rig->displays[l->master_screen])->stamp_error_ns;
	if (s->rig->shutter)
		r->stamp_error_ms[2] = 1e-6 * (double)bb_shutter_limits(s->rig->shutter)->stamp_error_ns;
}

static void gather_facts(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	char hex[BB_HASH_HEX];
	struct utsname machine;

	bb_result_fact(r, "blackburst", "%s", BB_REVISION);
	bb_result_fact(r, "compiler", "%s", __VERSION__);
	if (!uname(&machine))
		bb_result_fact(r, "machine", "%s %s %s", machine.sysname, machine.release, machine.machine);
	bb_result_fact(r, "room_file", "%s", r->room->path);
	bb_hash_hex(r->room->sha256, hex);
	bb_result_fact(r, "room_sha256", "%s", hex);
	bb_result_fact(r, "scene_file", "%s", r->scene->path);
	bb_hash_hex(r->scene->sha256, hex);
	bb_result_fact(r, "scene_sha256", "%s", hex);
	for (size_t i = 0; i < r->room->n_nodes; i++)
		if (s->loop->nodes[i].n_screens) {
			bb_hash_hex(s->loop->nodes[i].profile.sha256, hex);
			bb_result_fact(r, "cost_profile", "%s %s", r->room->nodes[i].profile, hex);
			break;
		}
	if (s->bricks) {
		const struct bb_bricks_header *h = bb_bricks_header(s->bricks);
		bb_result_fact(r, "volume", "%s, %u x %u x %u voxels, %u steps", h->name, h->tree.dim[0], h->tree.dim[1],
		               h->tree.dim[2], h->tree.n_steps);
		bb_result_fact(r, "bricks", "%u^3 voxels, %s, %s", h->tree.edge, bb_brick_type_text(h->type),
		               bb_brick_codec_text(h->codec));
	}
	if (s->renderer)
		bb_result_fact(r, "gl", "%s", bb_renderer_description(s->renderer));
	bb_result_fact(r, "bring_up_s", "%.3f", (double)s->bring_up_ns * 1e-9);
	if (s->judged)
		bb_result_fact(r, "psnr_against", "the same view with every brick resident, same back end");
	else if (s->bricks && s->pictures)
		bb_result_fact(r, "psnr_against", "nothing: not asked for, or two steps of the data are over 2 GiB");
}

void bb_outcome_gather(const struct bb_outcome_sources *s, struct bb_run_result *r)
{
	bb_watch_finish(s->watch, bb_clock_now_ns(s->clk));
	r->n_events = s->events->total;
	r->scene_start_s = (double)s->loop->scene_start_ns * 1e-9;
	gather_stamps(s, r);
	bb_diode_tell(s->loop->diode, &r->latency_test);
	gather_devices(s, r);
	gather_incidents(s, r);
	gather_faults(s, r);
	gather_pictures(s, r);
	bb_streaming_gather(s->loop);
	sample_devices(s, r);
	gather_stages(s, r);
	gather_facts(s, r);
	bb_result_count(r, "clock_steps", bb_clock_steps(s->clk));
	bb_result_count(r, "events", s->events->total);
}

/* ---- files ---- */

typedef enum bb_status (*writer)(const struct bb_run_result *, const char *, struct bb_error *);

enum bb_status bb_outcome_write(const struct bb_run_result *r, const char *dir, struct bb_error *err)
{
	static const struct {
		const char *name;
		writer write;
	} files[] = {
		{ "result.json", bb_result_write_json },
		{ "junit.xml", bb_result_write_junit },
		{ "frames.csv", bb_result_write_csv },
		{ "trace.json", bb_result_write_trace },
		{ "edges.csv", bb_result_write_edges },
	};
	char path[BB_PATH_MAX_BYTES + 32];
	enum bb_status status = BB_OK;

	for (size_t i = 0; dir && i < BB_ARRAY_LEN(files) && status == BB_OK; i++) {
		snprintf(path, sizeof(path), "%s/%s", dir, files[i].name);
		status = files[i].write(r, path, err);
	}
	if (!dir || status != BB_OK)
		return status;
	snprintf(path, sizeof(path), "%s/report.html", dir);
	char *drawing = bb_room_drawing_svg(r->room, r->path, r->n_path);
	status = bb_report_html_write(r, dir, path, drawing, err);
	free(drawing);
	return status;
}
