#include "bench/optics/sense.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "bench/file.h"
#include "bench/rig.h"
#include "render/image.h"
#include "sim/optics/sensor.h"
#include "sim/sim_display.h"
#include "sync/plan.h"

#define WALLS_MOST 8          /* more than these fit no recording */
#define SETTLE_CYCLES 6       /* before the first pattern: cells, pixels, the chain's first edges */
#define TURN_NS INT64_C(2000000)

struct stage { /* a room that runs */
	const struct bb_room *room;
	const struct bb_sense_options *options;
	struct bb_clock *clk;
	struct bb_eventlog events;
	struct sim_world *world;
	struct bb_rig rig;
	struct sim_optics *optics;
	size_t n_screens, screens[WALLS_MOST];
	int64_t next_vblank[WALLS_MOST];
	struct bb_recording recording;
	int64_t begin_ns;
	bool lens_swapped, shutter_swapped;
};

static void no_events(void *ctx, const struct bb_event *events, size_t n)
{
	(void)ctx;
	(void)events;
	(void)n;
}

/* ---- setting up ---- */

static bool is_sim(const char *device)
{
	return !*device || !strncmp(device, "sim:", 4);
}

static enum bb_status choose_screens(struct stage *s, struct bb_error *err)
{
	for (size_t i = 0; i < s->room->n_screens && s->n_screens < WALLS_MOST; i++) {
		const struct bb_display_config *d = &s->room->screens[i].display;
		if (d->stereo != BB_STEREO_MONO && is_sim(d->device))
			s->screens[s->n_screens++] = i;
	}
	if (!s->room->has_chain || !is_sim(s->room->chain.device) || !s->n_screens)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1640, NULL, "%s", s->room->name);
	return BB_OK;
}

static enum bb_status open_stage(struct stage *s, const struct sim_look *look, struct bb_error *err)
{
	int needs[BB_CLASS_COUNT];
	enum bb_status status = bb_clock_virtual_create(&s->clk);

	for (int i = 0; i < BB_CLASS_COUNT; i++)
		needs[i] = BB_NOT_NEEDED;
	needs[BB_CLASS_SHUTTERS] = needs[BB_CLASS_DISPLAYS] = 2;
	bb_eventlog_init(&s->events, no_events, NULL);
	if (status == BB_OK)
		status = sim_world_create(s->room, NULL, NULL, s->clk, &s->events, s->options->seed, &s->world);
	if (status == BB_OK)
		status = sim_optics_create(s->room, s->screens, s->n_screens, look, &s->optics);
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "a simulated room");
	const struct bb_open open = { .clk = s->clk, .events = &s->events, .seed = s->options->seed, .world = s->world };
	return bb_rig_open(&s->rig, s->room, needs, &open, err);
}

static void close_stage(struct stage *s)
{
	sim_optics_destroy(s->optics);
	if (s->clk)
		bb_rig_close(&s->rig);
	sim_world_destroy(s->world);
	bb_clock_destroy(s->clk);
}

static int64_t delay_ns(double at_us, double period_us)
{
	return (int64_t)((at_us - floor(at_us / period_us) * period_us) * 1e3);
}

/* The plan where there is one; else what the room file says. */
static enum bb_status set_phases(struct stage *s)
{
	struct bb_plan_timing t = bb_plan_configured(&s->room->chain);
	struct bb_plan *plan = s->options->configured ? NULL : calloc(1, sizeof(*plan));
	const double period_us = 1e6 / bb_rate_hz(s->room->chain.rate);
	enum bb_status status = BB_OK;

	if (plan && bb_plan_room(s->room, bb_plan_limit(s->room), plan, NULL) == BB_OK)
		t = plan->timing;
	free(plan);
	/* A chain's delays end at one edge period: what opens later opens on the other eye's edge. */
	s->lens_swapped = (llround(floor(t.glasses_at_us / period_us)) % 2 != 0) != s->options->swapped;
	s->shutter_swapped = llround(floor(t.shutter_at_us / period_us)) % 2 != 0;
	sim_optics_set_open(s->optics, t.glasses_open_us, t.shutter_open_us);
	for (uint8_t i = 0; i < s->room->chain.n_stages && status == BB_OK; i++)
		status = bb_shutter_set_phase(s->rig.shutter, i, delay_ns(t.shutter_at_us, period_us),
		                              1000000);
	if (status == BB_OK)
		status = bb_shutter_set_phase(s->rig.shutter, BB_STAGE_EMITTER,
		                              delay_ns(t.glasses_at_us, period_us), 1000000);
	return status == BB_OK ? bb_shutter_set_mode(s->rig.shutter, BB_SHUTTER_STEREO) : status;
}

/* ---- running ---- */

static uint8_t other(uint8_t eye)
{
	return eye == BB_EYE_LEFT ? BB_EYE_RIGHT : eye == BB_EYE_RIGHT ? BB_EYE_LEFT : eye;
}

static void tell_edges(struct stage *s)
{
	struct bb_shutter_edge edges[64];
	size_t n;

	while (bb_shutter_read(s->rig.shutter, edges, 64, &n) == BB_OK)
		for (size_t i = 0; i < n; i++) {
			if (edges[i].stage == BB_STAGE_EMITTER ? s->lens_swapped : s->shutter_swapped)
				edges[i].eye = other(edges[i].eye);
			sim_optics_edge(s->optics, &edges[i]);
		}
}

static enum bb_pattern pattern_at(const struct bb_recording *r, int64_t at_ns)
{
	enum bb_pattern p = BB_PATTERN_BLACK_BLACK;

	for (size_t i = 0; i < r->n_shows; i++)
		if (at_ns >= r->show[i].from_ns)
			p = r->show[i].pattern;
	return p;
}

/* A frame-sequential display shows the left eye's frame at even instants of the reference it is locked to. Patterns
 * change with left frames only, so that a cycle is one pattern's. */
static void tell_frames(struct stage *s, int64_t until_ns)
{
	for (size_t i = 0; i < s->n_screens; i++) {
		const bool pair = s->room->screens[s->screens[i]].display.stereo == BB_STEREO_DUAL_PROJECTOR;
		for (;; s->next_vblank[i]++) {
			const int64_t k = s->next_vblank[i], at_ns = sim_display_vblank_ns(s->rig.displays[s->screens[i]], k);
			if (at_ns > until_ns)
				break;
			const enum bb_eye eye = pair ? BB_EYE_NONE : k % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT;
			const int64_t cycle_ns = pair || k % 2 == 0 ? at_ns : sim_display_vblank_ns(s->rig.displays[s->screens[i]], k - 1);
			sim_optics_show(s->optics, 0, pattern_at(&s->recording, cycle_ns - s->begin_ns));
			sim_optics_frame(s->optics, i, at_ns, eye);
		}
	}
}

/* Lets the room run until a time; the light up to it is then known. */
static void run_to(struct stage *s, int64_t at_ns)
{
	while (bb_clock_now_ns(s->clk) < at_ns)
		bb_clock_run_until(s->clk, bb_clock_now_ns(s->clk) + TURN_NS);
	tell_edges(s);
	tell_frames(s, bb_clock_now_ns(s->clk));
}

static void plan_shows(struct stage *s)
{
	const int64_t cycle_ns = 2 * bb_rate_period_ns(s->room->chain.rate);
	struct bb_recording *r = &s->recording;

	s->begin_ns = SETTLE_CYCLES * cycle_ns;
	for (int64_t i = 0; i < 2 * BB_PATTERN_COUNT; i++)
		r->show[r->n_shows++] = (struct bb_showing){ (enum bb_pattern)(i % BB_PATTERN_COUNT), i * s->options->cycles * cycle_ns,
			                                  (i + 1) * s->options->cycles * cycle_ns };
	r->rate = s->room->chain.rate;
}

static int64_t end_ns(const struct stage *s)
{
	return s->begin_ns + s->recording.show[s->recording.n_shows - 1].to_ns;
}

/* ---- files ---- */

static void put_head(FILE *out, const struct stage *s)
{
	const struct bb_recording *r = &s->recording;
	char name[64];

	fprintf(out, "# blackburst optics 1\n# simulated sensors in %s, seed %llu\n# rate_hz: %.6f\n", s->room->name,
	        (unsigned long long)s->options->seed, bb_rate_hz(r->rate));
	if (r->bandwidth_hz > 0)
		fprintf(out, "# bandwidth_hz: %g\n", r->bandwidth_hz);
	if (r->fps_hz > 0)
		fprintf(out, "# aperture_us: %g\n# fps_hz: %g\n# first_s: %.9f\n", r->aperture_us, r->fps_hz, r->first_s);
	for (size_t i = 0; i < r->n_shows; i++)
		fprintf(out, "# show: %s %.9f %.9f\n", bb_pattern_text(r->show[i].pattern), (double)r->show[i].from_ns * 1e-9,
		        (double)r->show[i].to_ns * 1e-9);
	fputs("t_s", out);
	for (size_t i = 0; i < r->n_channels; i++) {
		bb_channel_text(&r->channel[i], name, sizeof(name));
		fprintf(out, ",%s_v", name);
	}
	fputc('\n', out);
}

static void add_diode(struct stage *s, struct sim_diodes *d, const char *wall, size_t screen, int spot, int lens)
{
	struct bb_recording *r = &s->recording;
	struct bb_channel c = { .spot = (uint8_t)spot, .lens = (uint8_t)lens };

	snprintf(c.wall, sizeof(c.wall), "%s", wall);
	r->channel[r->n_channels++] = c;
	d->diode[d->n_diodes++] = (struct sim_diode){ .channel = c, .screen = screen };
}

static void place_diodes(struct stage *s, struct sim_diodes *d)
{
	for (size_t i = 0; i < s->n_screens; i++) {
		const char *id = s->room->screens[s->screens[i]].id;
		for (int spot = 0; spot < BB_BANDS; spot++)
			for (int lens = 0; lens < BB_LENS_COUNT; lens++)
				add_diode(s, d, id, i, spot, lens);
		add_diode(s, d, id, i, BB_SPOT_TAG, BB_LENS_BARE);
	}
	add_diode(s, d, "", 0, BB_SPOT_LAMP, BB_LENS_LEFT);
	add_diode(s, d, "", 0, BB_SPOT_LAMP, BB_LENS_RIGHT);
}

static void write_samples(struct stage *s, struct sim_diodes *d, FILE *out)
{
	double volts[BB_CHANNELS_MAX];

	for (int64_t next_ns; (next_ns = sim_diodes_next_ns(d)) < end_ns(s);) {
		run_to(s, next_ns);
		fprintf(out, "%.9f", (double)(sim_diodes_sample(d, volts) - s->begin_ns) * 1e-9);
		for (size_t i = 0; i < d->n_diodes; i++)
			fprintf(out, ",%.4f", volts[i]);
		fputc('\n', out);
	}
}

static enum bb_status record_diodes(struct stage *s, const char *file, struct bb_error *err)
{
	struct sim_diode_config config = sim_diode_default();
	struct sim_diodes *d = calloc(1, sizeof(*d));
	struct bb_file f;
	enum bb_status status = d ? bb_file_begin(&f, file, err) : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "photodiodes");

	if (status == BB_OK) {
		config.read_v *= s->options->noise;
		config.shot_v *= s->options->noise;
		config.hum_v *= s->options->noise;
		s->recording.bandwidth_hz = config.bandwidth_hz;
		run_to(s, s->begin_ns);
		sim_diodes_init(d, &config, s->optics, s->options->seed, s->begin_ns);
		place_diodes(s, d);
		put_head(f.out, s);
		write_samples(s, d, f.out);
		status = bb_file_commit(&f, err);
	}
	free(d);
	return status;
}

static enum bb_status begin_stage(struct stage *s, const struct sim_look *look, struct bb_error *err)
{
	enum bb_status status = choose_screens(s, err);

	if (status != BB_OK)
		return status;
	plan_shows(s);
	status = open_stage(s, look, err);
	if (status == BB_OK && (status = set_phases(s)) != BB_OK)
		status = bb_fail(err, status, 1640, NULL, "the chain: %s", bb_status_text(status));
	return status;
}

enum bb_status bb_sense_diodes(const struct bb_room *room, const struct bb_sense_options *options, const char *file,
                               struct bb_error *err)
{
	struct stage *s = calloc(1, sizeof(*s));
	struct sim_look look = sim_look_bands();

	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a simulated room");
	s->room = room;
	s->options = options;
	look.tag = true;
	enum bb_status status = begin_stage(s, &look, err);
	if (status == BB_OK)
		status = record_diodes(s, file, err);
	close_stage(s);
	free(s);
	return status;
}

/* ---- pictures ---- */

static enum bb_status write_picture(const uint8_t *grey, const char *dir, int64_t n, struct bb_error *err)
{
	char path[BB_PATH_MAX_BYTES];
	struct bb_image img;

	if (snprintf(path, sizeof(path), "%s/%06lld.png", dir, (long long)n) >= (int)sizeof(path))
		return bb_fail(err, BB_ERR_RANGE, 1905, NULL, "the path is too long");
	enum bb_status status = bb_image_create(SIM_CAMERA_WIDTH, SIM_CAMERA_HEIGHT, &img);
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "a picture");
	for (size_t i = 0; i < SIM_CAMERA_WIDTH * SIM_CAMERA_HEIGHT; i++) {
		memset(&img.rgba[4 * i], grey[i], 3);
		img.rgba[4 * i + 3] = 255;
	}
	status = bb_image_write_png(&img, path, err);
	bb_image_release(&img);
	return status;
}

/* recording.txt comes last: without it a folder is no recording. */
static enum bb_status record_pictures(struct stage *s, size_t screen, enum bb_glass lens, const char *dir,
                                      struct bb_error *err)
{
	struct sim_eye_camera_config config = sim_eye_camera_default(lens);
	struct bb_recording *r = &s->recording;
	struct sim_eye_camera camera;
	uint8_t grey[SIM_CAMERA_WIDTH * SIM_CAMERA_HEIGHT];
	char path[BB_PATH_MAX_BYTES];
	struct bb_file f;
	enum bb_status status = BB_OK;

	config.read_grey *= s->options->noise;
	config.shot_grey *= s->options->noise;
	run_to(s, s->begin_ns);
	sim_eye_camera_init(&camera, &config, s->optics, screen, lens, s->options->seed, s->begin_ns);
	for (int64_t n = 0; status == BB_OK && sim_eye_camera_next_ns(&camera) < end_ns(s); n++) {
		run_to(s, sim_eye_camera_next_ns(&camera));
		const int64_t middle_ns = sim_eye_camera_expose(&camera, grey);
		if (!n)
			r->first_s = (double)(middle_ns - s->begin_ns) * 1e-9;
		status = write_picture(grey, dir, n, err);
	}
	r->fps_hz = config.rate_hz;
	r->aperture_us = config.exposure_us;
	for (int spot = 0; spot < BB_BANDS; spot++) {
		struct bb_channel c = { .spot = (uint8_t)spot, .lens = (uint8_t)lens };
		snprintf(c.wall, sizeof(c.wall), "%s", s->room->screens[s->screens[screen]].id);
		r->channel[r->n_channels++] = c;
	}
	if (snprintf(path, sizeof(path), "%s/recording.txt", dir) >= (int)sizeof(path))
		return bb_fail(err, BB_ERR_RANGE, 1905, NULL, "the path is too long");
	if (status == BB_OK)
		status = bb_file_begin(&f, path, err);
	if (status != BB_OK)
		return status;
	put_head(f.out, s);
	return bb_file_commit(&f, err);
}

static enum bb_status find_view(const struct stage *s, size_t *screen, enum bb_glass *lens, struct bb_error *err)
{
	char text[BB_ID_MAX + 24];
	struct bb_channel c;

	*screen = 0;
	while (s->options->wall && *screen < s->n_screens &&
	       strcmp(s->room->screens[s->screens[*screen]].id, s->options->wall) != 0)
		++*screen;
	snprintf(text, sizeof(text), "lamp.%.20s", s->options->lens);
	if (*screen == s->n_screens || !bb_channel_find(text, &c))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "no stereo wall '%.32s', or no lens '%.20s' (bare, left, right)",
		               s->options->wall ? s->options->wall : "", s->options->lens);
	*lens = (enum bb_glass)c.lens;
	return BB_OK;
}

enum bb_status bb_sense_pictures(const struct bb_room *room, const struct bb_sense_options *options, const char *dir,
                                 struct bb_error *err)
{
	const struct sim_look look = sim_look_camera();
	const struct bb_where where = { dir, 0, 0 };
	struct stage *s = calloc(1, sizeof(*s));
	size_t screen = 0;
	enum bb_glass lens = BB_LENS_BARE;

	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a simulated room");
	s->room = room;
	s->options = options;
	enum bb_status status = begin_stage(s, &look, err);
	if (status == BB_OK)
		status = find_view(s, &screen, &lens, err);
	if (status == BB_OK && mkdir(dir, 0777) && errno != EEXIST)
		status = bb_fail(err, BB_ERR_IO, 1905, &where, "%s", strerror(errno));
	if (status == BB_OK)
		status = record_pictures(s, screen, lens, dir, err);
	close_stage(s);
	free(s);
	return status;
}
