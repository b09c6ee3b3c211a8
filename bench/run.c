/* bench/run.c: one run from files to verdict; owns everything the steps in between share. */
#include "bench/run.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <sys/stat.h>

#include "bench/data.h"
#include "bench/facility.h"
#include "bench/loop/outlets.h"
#include "bench/loop/remote.h"
#include "bench/outcome.h"
#include "hal/hash.h"
#include "render/image_metrics.h"
#include "render/parallel.h"

#define BRING_UP_MOST_NS (120 * BB_NS_PER_S)
#define WATCH_SETTLE_NS (BB_NS_PER_S / 2)

struct bb_run_options bb_run_options_default(void)
{
	struct bb_run_options o = { .seed = 1, .gl = "auto", .pictures = true, .measure_psnr = true, .memory_mib = -1,
		                    .stream_bricks = -1, .dim = 1 };

	for (int i = 0; i < BB_CLASS_COUNT; i++)
		o.fidelity[i] = -2;
	return o;
}

struct work { /* everything between the files and the result */
	struct bb_run_options own;   /* what the caller asked for, and what came of it */
	const struct bb_run_options *o;
	struct bb_run *run;
	int needs[BB_CLASS_COUNT];
	struct bb_path *head, *wand;
	struct bb_bricks *bricks;
	struct bb_transfer transfer;
	struct bb_stream *full; /* every brick on show is there */
	struct bb_clock *clk;
	struct bb_eventlog events;
	struct bb_hash hash;
	struct bb_nodes *nodes; /* NULL: one process */
	struct sim_world *world;
	struct bb_rig rig;
	struct bb_watch *watch;
	struct bb_facility *facility;
	struct bb_blackbox *blackbox;
	struct bb_renderer *renderer;
	struct bb_pictures *pictures;
	struct bb_frame_loop loop;
	int64_t bring_up_ns;
};

static void hash_events(void *ctx, const struct bb_event *events, size_t n)
{
	struct work *w = ctx;

	bb_hash_update(&w->hash, events, n * sizeof(*events));
	bb_blackbox_events(w->blackbox, events, n);
	if (w->o->events)
		w->o->events(w->o->events_ctx, events, n);
}

static void tell(const struct work *w, const char *what)
{
	if (w->o->progress)
		w->o->progress(w->o->progress_ctx, 0, what);
}

/* ---- files ---- */

static enum bb_status load_files(struct work *w, struct bb_error *err)
{
	struct bb_run *run = w->run;
	enum bb_status status = bb_room_load(w->o->room_path, &run->room, err);

	if (status == BB_OK)
		status = bb_scene_load(w->o->scene_path, &run->scene, err);
	if (status != BB_OK)
		return status;
	for (int i = 0; i < BB_CLASS_COUNT; i++) {
		w->needs[i] = w->o->fidelity[i] == -2 ? run->scene->needs[i] : w->o->fidelity[i];
		if (w->o->processes.process && i != BB_CLASS_DISPLAYS)
			w->needs[i] = -1; /* the head owns every other device */
		run->scene->needs[i] = w->needs[i]; /* budgets are judged by what was really asked for */
	}
	if (w->o->duration_s > 0)
		run->scene->duration_s = w->o->duration_s;
	if (run->scene->head_path[0])
		status = bb_path_load(run->scene->head_path, &w->head, err);
	if (status == BB_OK && run->scene->wand_path[0])
		status = bb_path_load(run->scene->wand_path, &w->wand, err);
	return status;
}

/* Every brick of two steps is what a picture is judged by: not of data that is made to be larger than memory. */
static bool can_judge(const struct bb_bricks *b)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	const uint64_t n_cells = t->n_nodes - t->first[t->n_levels - 1];

	return n_cells <= BB_VOLUME_CAP_BYTES / (2 * bb_bricks_brick_bytes(h));
}

static enum bb_status load_data(struct work *w, struct bb_error *err)
{
	const struct bb_scene *s = w->run->scene;
	enum bb_status status;

	if (s->technique != BB_TECHNIQUE_VOLUME)
		return BB_OK;
	tell(w, "loading the volume");
	status = bb_data_open(s, &w->bricks, err);
	if (status == BB_OK)
		status = bb_transfer_load(s->transfer_function, &w->transfer, err);
	if (status != BB_OK || !w->o->pictures || !w->o->measure_psnr || !can_judge(w->bricks))
		return status;
	const struct bb_stream_config full = { .bricks = w->bricks, .transfer = &w->transfer, .no_prediction = true,
		                               .placement = bb_loop_placement(s, w->bricks) };
	return bb_stream_create(&full, &w->full, err);
}

/* ---- flashes ---- */

/* Mean colours of the steps as the transfer function shows the whole volume's values, a slab of 8 voxels deep. */
static float (*step_means(const struct work *w))[3]
{
	const struct bb_tree *t = &bb_bricks_header(w->bricks)->tree;
	float (*mean)[3] = calloc(t->n_steps, sizeof(*mean));

	for (uint32_t step = 0; mean && step < t->n_steps; step++) {
		uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
		const uint64_t brick = (uint64_t)bb_tree_leaf_time(t, step) * t->n_nodes;
		if (bb_bricks_histograms(w->bricks, brick, h, NULL) != BB_OK)
			continue;
		for (int i = 0; i < BB_STATS_BINS; i++) {
			double c[4];
			bb_transfer_at(&w->transfer, (i + 0.5) / BB_STATS_BINS, c);
			const double part = h[BB_HIST_VALUE][i] / 65535.0 * bb_transfer_opacity_for_step(c[3], 8);
			for (int k = 0; k < 3; k++)
				mean[step][k] += (float)(part * bb_srgb_to_linear(c[k]));
		}
	}
	return mean;
}

/* A scene that would flash does not begin, unless it is dimmed or somebody says so. */
static enum bb_status foresee(struct work *w, struct bb_error *err)
{
	const struct bb_run *run = w->run;
	const struct bb_where where = { run->scene->path, 0, 0 };
	const double most = run->room->safety.flashes_per_s;
	float (*means)[3] = w->bricks ? step_means(w) : NULL;
	const uint32_t n_steps = w->bricks ? bb_bricks_header(w->bricks)->tree.n_steps : 0;
	struct bb_flash_worst worst;
	enum bb_status status = BB_OK;

	if (w->needs[BB_CLASS_DISPLAYS] < 0 || w->o->allow_flash)
		goto out;
	status = bb_light_foresee(run->room, run->scene, means, n_steps, w->own.dim, &worst);
	while (status == BB_OK && worst.flashes > most && w->o->dim_flash && w->own.dim > 1e-3) {
		w->own.dim *= 0.9;
		status = bb_light_foresee(run->room, run->scene, means, n_steps, w->own.dim, &worst);
	}
	if (status == BB_OK && worst.flashes > most)
		status = bb_fail(err, BB_ERR_REFUSED, 1690, &where, "%g flashes within a second (%s), at most %g, first at %.2f s",
		                 worst.flashes, bb_flash_rule_text(worst.rule), most, (double)worst.at_ns * 1e-9);
out:
	free(means);
	return status;
}

/* ---- the room ---- */

static bool any_sim(const struct bb_room *room)
{
	/* Truth comes from the simulated viewer, who is only there when the cameras that see him are simulated. */
	return room->n_cameras == 0 || strncmp(room->cameras[0].device, "sim", 3) == 0;
}

static enum bb_status open_room(struct work *w, struct bb_error *err)
{
	const struct bb_room *room = w->run->room;
	enum bb_status status = w->o->posix_clock ? bb_clock_posix_create(&w->clk) : bb_clock_virtual_create(&w->clk);

	if (status == BB_OK && !bb_hash_init(&w->hash))
		status = BB_ERR_NOMEM;
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "the clock");
	if (w->o->processes.n > 1) {
		status = bb_nodes_open(w->o, room, w->run->scene, w->clk, w->o->log, &w->nodes, err);
		if (status != BB_OK)
			return status;
	}
	bb_eventlog_init(&w->events, hash_events, w);
	if (bb_blackbox_create(&w->events, &w->blackbox) != BB_OK)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the black box");
	if (any_sim(room))
		status = sim_world_create(room, w->head, w->wand, w->clk, &w->events, w->o->seed, &w->world);
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "the simulated world");
	if (w->nodes)
		w->run->room->link.group = bb_nodes_group(w->nodes);
	const struct bb_open open = { .clk = w->clk, .events = &w->events, .log = w->o->log, .seed = w->o->seed,
		                      .world = w->world };
	status = bb_rig_open(&w->rig, room, w->needs, &open, err);
	if (status == BB_OK && w->nodes) { /* between processes a real network stands where the modelled one would */
		bb_link_close(w->rig.link);
		w->rig.link = bb_nodes_link(w->nodes);
	}
	if (status == BB_OK)
		status = bb_watch_create(BB_CAMERA_TROUBLES * room->n_cameras + room->n_screens + room->n_monitors + room->n_pdus +
		                                 room->n_gamepads + 3 * room->n_nodes + 10,
		                         &w->events, WATCH_SETTLE_NS, &w->watch);
	if (status == BB_OK)
		status = bb_facility_create(&w->rig, w->clk, w->watch, &w->facility);
	return status;
}

static enum bb_status bring_up(struct work *w, struct bb_error *err)
{
	const int64_t start_ns = bb_clock_now_ns(w->clk);
	enum bb_status status = bb_facility_start(w->facility);

	tell(w, "bring-up");
	while (status == BB_OK && !bb_facility_ready(w->facility)) {
		const int64_t now_ns = bb_clock_now_ns(w->clk);
		if (w->o->stop && *w->o->stop)
			return bb_fail(err, BB_ERR_LOST, 1691, NULL, "signal %d", (int)*w->o->stop);
		if (now_ns - start_ns > BRING_UP_MOST_NS)
			return bb_fail(err, BB_ERR_LOST, 1504, NULL, "bring-up did not end within %d s",
			               (int)(BRING_UP_MOST_NS / BB_NS_PER_S));
		bb_clock_run_until(w->clk, now_ns + BB_NS_PER_S / 10);
	}
	w->bring_up_ns = bb_clock_now_ns(w->clk) - start_ns;
	return status;
}

static enum bb_status make_renderer(struct work *w, struct bb_error *err)
{
	const bool pictures = w->o->pictures && w->run->scene->pictures.n_at;
	enum bb_status status = BB_OK;

	if (!pictures && !w->o->posix_clock)
		return BB_OK;
	if (w->bricks && !strcmp(w->o->gl, "cpu"))
		status = bb_renderer_cpu_create("auto", bb_parallel_processors(), &w->renderer, err);
	else if (w->bricks)
		status = bb_renderer_gl_create(w->o->gl, &w->renderer, err);
	if (status != BB_OK || !pictures)
		return status;
	const struct bb_pictures_config c = { .room = w->run->room, .scene = w->run->scene, .dir = w->o->out_dir,
		                              .renderer = w->renderer,
		                              .full = w->full };
	return bb_pictures_create(&c, &w->pictures);
}

/* Faults are planted in the head's process only: not of what another one plays, where nobody would hear of them. */
static enum bb_status check_faults(const struct work *w, struct bb_error *err)
{
	const struct bb_room *room = w->run->room;

	for (size_t i = 0; i < w->o->n_faults; i++) {
		const struct sim_fault *f = &w->o->faults[i];
		bool ours = true;
		for (size_t n = 0; n < room->n_nodes && !strcmp(f->class_name, "node"); n++)
			ours &= strcmp(f->id, room->nodes[n].id) || bb_remote_plays(&w->loop, n);
		for (size_t s = 0; s < room->n_screens && !strcmp(f->class_name, "display"); s++)
			ours &= strcmp(f->id, room->screens[s].id) || bb_remote_plays(&w->loop, room->screens[s].node);
		if (!ours)
			return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "\"%s\": another process plays that node", f->text);
	}
	return BB_OK;
}

static enum bb_status run_scene(struct work *w, struct bb_error *err)
{
	struct bb_frame_loop *l = &w->loop;
	const struct bb_scene *scene = w->run->scene;

	*l = (struct bb_frame_loop){ .options = w->o, .room = w->run->room, .scene = scene, .clk = w->clk, .events = &w->events,
		               .rig = &w->rig, .world = w->world, .ledger = w->run->result->ledger,
		               .result = w->run->result, .watch = w->watch, .blackbox = w->blackbox, .pictures = w->pictures,
		               .renderer = w->renderer, .bricks = w->bricks,
		               .transfer = w->bricks ? &w->transfer : NULL, .draw_everything = w->o->posix_clock,
		               .start = { w->run->room->neutral, BB_QUAT_IDENTITY },
		               .processes = w->o->processes.process ? NULL : w->nodes };
	if (w->head)
		l->start = bb_path_at(w->head, 0);
	enum bb_status status = bb_loop_create(l, err);
	if (status == BB_OK)
		status = bb_outlets_open(l, err);
	if (status == BB_OK)
		status = check_faults(w, err);
	if (status == BB_OK && w->world)
		status = sim_faults_plant(w->world, w->o->faults, w->o->n_faults, l->frame_ns, err);
	if (status == BB_OK)
		status = bring_up(w, err);
	if (status == BB_OK && l->processes)
		status = bb_remote_gather(l, err);
	if (status == BB_OK)
		status = w->o->processes.process ? bb_remote_serve(l, err) : bb_loop_run(l, err);
	return status;
}

static enum bb_status create_result(struct work *w, struct bb_error *err)
{
	const struct bb_room *room = w->run->room;
	struct bb_run_result *r = calloc(1, sizeof(*r));
	double hz = 60;

	w->run->result = r;
	if (!r)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the result");
	r->room = room;
	r->scene = w->run->scene;
	r->seed = w->o->seed;
	r->allow_flash = w->o->allow_flash;
	r->duration_s = w->run->scene->duration_s;
	snprintf(r->clock, sizeof(r->clock), "%s", w->o->posix_clock ? "posix" : "virtual");
	if (room->n_screens)
		hz = bb_rate_hz(room->screens[0].display.rate);
	const enum bb_status status = bb_ledger_create((size_t)(r->duration_s * hz) + 64, room->n_nodes, &r->ledger);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1702, NULL, "the ledger");
}

static void release(struct work *w)
{
	bb_loop_destroy(&w->loop);
	bb_pictures_destroy(w->pictures);
	bb_renderer_destroy(w->renderer);
	bb_facility_destroy(w->facility);
	if (w->nodes)
		w->rig.link = NULL; /* theirs */
	if (w->clk)
		bb_rig_close(&w->rig);
	bb_nodes_close(w->nodes);
	bb_watch_destroy(w->watch);
	bb_blackbox_destroy(w->blackbox);
	sim_world_destroy(w->world);
	bb_clock_destroy(w->clk);
	bb_stream_destroy(w->full);
	bb_bricks_close(w->bricks);
	bb_path_free(w->head);
	bb_path_free(w->wand);
}

/* The result folder with its parents. */
static enum bb_status make_dir(const char *dir, struct bb_error *err)
{
	const struct bb_where where = { dir, 0, 0 };
	char path[BB_PATH_MAX_BYTES];

	if (!dir)
		return BB_OK;
	snprintf(path, sizeof(path), "%s", dir);
	for (char *p = path + 1; *p; p++)
		if (*p == '/') {
			*p = '\0';
			if (mkdir(path, 0777) && errno != EEXIST)
				return bb_fail(err, BB_ERR_IO, 1905, &where, "cannot make %s: %s", path, strerror(errno));
			*p = '/';
		}
	if (!mkdir(path, 0777) || errno == EEXIST)
		return BB_OK;
	return bb_fail(err, BB_ERR_IO, 1905, &where, "cannot make the folder: %s", strerror(errno));
}

static void gather(struct work *w)
{
	const struct bb_outcome_sources s = { .options = w->o, .rig = &w->rig, .events = &w->events, .world = w->world,
		                              .watch = w->watch, .facility = w->facility, .loop = &w->loop,
		                              .pictures = w->pictures, .renderer = w->renderer, .bricks = w->bricks, .judged = w->full != NULL,
		                              .clk = w->clk, .bring_up_ns = w->bring_up_ns };

	bb_eventlog_flush(&w->events);
	bb_hash_final_hex(&w->hash, w->run->result->event_log_sha256);
	bb_outcome_gather(&s, w->run->result);
	bb_blackbox_rank(w->blackbox, w->run->result);
}

/* A recording that is not whole is taken away: if that is because the disk is full, there is room for the report then. */
static enum bb_status write_down(struct work *w, struct bb_error *err)
{
	const enum bb_status recorded = bb_outlets_commit(&w->loop, err);

	tell(w, "writing the report");
	enum bb_status status = bb_outcome_write(w->run->result, w->o->out_dir, err);
	if (status == BB_OK)
		status = bb_blackbox_write(w->blackbox, w->run->result, w->o->out_dir, err);
	return status == BB_OK ? recorded : status;
}

enum bb_status bb_run(const struct bb_run_options *options, struct bb_run *out, struct bb_error *err)
{
	const int64_t started_ns = bb_clock_stopwatch_ns();
	struct work *w = calloc(1, sizeof(*w));

	*out = (struct bb_run){ 0 };
	if (!w)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the run");
	w->own = *options;
	w->o = options = &w->own;
	w->run = out;
	enum bb_status status = load_files(w, err);
	if (status == BB_OK)
		status = load_data(w, err);
	if (status == BB_OK)
		status = foresee(w, err);
	if (status == BB_OK)
		status = create_result(w, err);
	if (status == BB_OK)
		status = make_dir(options->out_dir, err);
	if (status == BB_OK)
		status = open_room(w, err);
	if (status == BB_OK)
		status = make_renderer(w, err);
	if (status == BB_OK)
		status = run_scene(w, err);
	if (status == BB_OK && !options->processes.process) {
		gather(w);
		status = bb_result_judge(out->result);
	} else if (w->hash.ctx) {
		uint8_t unused[BB_HASH_BYTES];
		bb_hash_final(&w->hash, unused);
	}
	if (status == BB_OK && !options->processes.process) {
		out->result->wall_time_s = (double)(bb_clock_stopwatch_ns() - started_ns) * 1e-9;
		status = write_down(w, err);
	}
	release(w);
	free(w);
	if (status != BB_OK)
		bb_run_free(out);
	return status;
}

void bb_run_free(struct bb_run *run)
{
	bb_run_result_free(run->result);
	bb_scene_free(run->scene);
	bb_room_free(run->room);
	*run = (struct bb_run){ 0 };
}
