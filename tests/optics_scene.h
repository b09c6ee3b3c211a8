/*
 * tests/optics_scene.h: a stereo room's light recorded by simulated sensors and analysed, with everything that was true
 * about it at hand. Edges and vblanks come from plain lists here, not from simulated devices.
 */
#ifndef BB_TESTS_OPTICS_SCENE_H
#define BB_TESTS_OPTICS_SCENE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sim/optics/sensor.h"
#include "sync/optics/analyse.h"

#define SHOW_CYCLES 12
#define SCENE_SCREENS 2

struct optics_truth { /* what the scene is made with */
	double rate_ppm;                   /* of the generator of edges and vblanks */
	double jitter_ns;                  /* of an edge, sd */
	double lens_ns;                    /* lens of an eye opens after its edge's instant */
	double stage_ns[SCENE_SCREENS];    /* dual projectors: the shutters of a wall open */
	double vblank_ns[SCENE_SCREENS];   /* frame-sequential: vblank before the frame of that edge's eye */
	double vblank_ppm[SCENE_SCREENS];  /* a frame-sequential display on a clock of its own */
	bool swapped;                      /* glasses open for the other eye */
	struct sim_diode_config diode;
	uint64_t seed;
};

struct optics_scene {
	const struct bb_room *room;
	struct optics_truth truth;
	struct bb_recording recording;
	size_t n_rows;
	int64_t *at_ns;
	double *volts;                     /* n_rows x n_channels */
	struct bb_analyser *analyser;
	struct bb_optics result;
	int64_t begin_ns;
};

static inline double scene_edge_ns(const struct optics_scene *s)
{
	return (double)bb_rate_period_ns(s->room->chain.rate) / (1 + s->truth.rate_ppm * 1e-6);
}

/* Patterns in turn, twice, each SHOW_CYCLES nominal cycles long, after a few cycles for pixels and cells to settle. */
static inline void scene_shows(struct optics_scene *s)
{
	const int64_t cycle_ns = 2 * bb_rate_period_ns(s->room->chain.rate);
	struct bb_recording *r = &s->recording;

	for (int i = 0; i < 2 * BB_PATTERN_COUNT; i++)
		r->show[r->n_shows++] = (struct bb_showing){ (enum bb_pattern)(i % BB_PATTERN_COUNT),
			                                  (4 + SHOW_CYCLES * (int64_t)i) * cycle_ns,
			                                  (4 + SHOW_CYCLES * (int64_t)(i + 1)) * cycle_ns };
	r->rate = s->room->chain.rate;
	r->bandwidth_hz = s->truth.diode.bandwidth_hz;
}

static inline void scene_channel(struct optics_scene *s, struct sim_diodes *d, const char *name, size_t screen)
{
	struct bb_channel c;

	assert_true(bb_channel_find(name, &c));
	d->diode[d->n_diodes++] = (struct sim_diode){ .channel = c, .screen = screen };
	s->recording.channel[s->recording.n_channels++] = c;
}

/* Tells all events of edge period n. Frames with an eye follow the pattern of their time. */
static inline void scene_tell(const struct optics_scene *s, struct sim_optics *o, struct sim_rng *rng, int64_t n)
{
	const double edge = scene_edge_ns(s), at = (double)n * edge;
	const enum bb_eye eye = n % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT, other = n % 2 ? BB_EYE_LEFT : BB_EYE_RIGHT;
	const double jitter = s->truth.jitter_ns * sim_rng_normal(rng);
	struct bb_shutter_edge e = { llround(at + jitter + s->truth.lens_ns), (uint32_t)n,
		                     (uint8_t)(s->truth.swapped ? other : eye), BB_STAGE_EMITTER };

	sim_optics_edge(o, &e);
	for (size_t i = 0; i < SCENE_SCREENS; i++) {
		const bool pair = s->room->screens[i].display.stereo == BB_STEREO_DUAL_PROJECTOR;
		e = (struct bb_shutter_edge){ llround(at + jitter + s->truth.stage_ns[i]), (uint32_t)n, (uint8_t)eye,
			                      (uint8_t)i };
		if (pair)
			sim_optics_edge(o, &e);
		if (!pair || n % 2 == 0)
			sim_optics_frame(o, i, llround(at / (1 + s->truth.vblank_ppm[i] * 1e-6) + s->truth.vblank_ns[i]), pair ? BB_EYE_NONE : eye);
	}
}

static inline void scene_feed(struct optics_scene *s, struct sim_optics *o, struct sim_diodes *d)
{
	const int64_t end_ns = s->recording.show[s->recording.n_shows - 1].to_ns;
	struct sim_rng rng;
	int64_t n = 0;
	size_t row = 0;

	sim_rng_seed(&rng, s->truth.seed, "edges", "scene");
	for (int64_t next_ns; (next_ns = sim_diodes_next_ns(d)) < end_ns; row++) {
		/* Two edge periods ahead of the light, with the pattern of the show that begins then. */
		while ((double)n * scene_edge_ns(s) < (double)next_ns + 2 * scene_edge_ns(s)) {
			for (size_t i = 0; i < s->recording.n_shows; i++)
				if ((double)n * scene_edge_ns(s) >= (double)s->recording.show[i].from_ns && n % 2 == 0)
					sim_optics_show(o, 0, s->recording.show[i].pattern);
			scene_tell(s, o, &rng, n++);
		}
		assert_true(row < s->n_rows);
		s->at_ns[row] = sim_diodes_sample(d, s->volts + row * s->recording.n_channels);
	}
	s->n_rows = row;
}

/* names: channels, NULL at the end, each of the wall room->walls[0] or [1] or the lamp. */
static inline struct optics_scene *scene_record(const struct bb_room *room, const struct optics_truth *truth,
                                                const char *const *names)
{
	const size_t screens[SCENE_SCREENS] = { 0, 1 };
	struct optics_scene *s = calloc(1, sizeof(*s));
	struct sim_diodes *d = calloc(1, sizeof(*d));
	struct sim_optics *o;
	struct sim_look look = sim_look_bands();

	assert_non_null(s);
	assert_non_null(d);
	s->room = room;
	s->truth = *truth;
	scene_shows(s);
	for (size_t i = 0; names[i]; i++)
		look.tag |= strstr(names[i], ".tag.") != NULL;
	assert_int_equal(sim_optics_create(room, screens, SCENE_SCREENS, &look, &o), BB_OK);
	sim_diodes_init(d, &truth->diode, o, truth->seed, 0);
	for (size_t i = 0; names[i]; i++)
		scene_channel(s, d, names[i], strncmp(names[i], room->walls[1].id, strlen(room->walls[1].id)) == 0);
	s->n_rows = (size_t)((double)s->recording.show[s->recording.n_shows - 1].to_ns * 1e-9 * truth->diode.rate_hz) + 4;
	s->at_ns = calloc(s->n_rows, sizeof(*s->at_ns));
	s->volts = calloc(s->n_rows * s->recording.n_channels, sizeof(*s->volts));
	assert_non_null(s->at_ns);
	assert_non_null(s->volts);
	scene_feed(s, o, d);
	sim_optics_destroy(o);
	free(d);
	return s;
}

/* The same room before a high-speed camera, three times: without glasses and through either lens. */
static inline struct optics_scene *scene_film(const struct bb_room *room, const struct optics_truth *truth)
{
	const size_t screens[SCENE_SCREENS] = { 0, 1 };
	const struct sim_look look = sim_look_camera();
	struct optics_scene *s = calloc(1, sizeof(*s));

	assert_non_null(s);
	s->room = room;
	s->truth = *truth;
	scene_shows(s);
	s->recording.bandwidth_hz = 0;
	s->recording.n_channels = (size_t)BB_LENS_COUNT * BB_BANDS;
	const int64_t end_ns = s->recording.show[s->recording.n_shows - 1].to_ns;
	s->n_rows = (size_t)(end_ns / 1000000) + 4;
	s->at_ns = calloc(s->n_rows, sizeof(*s->at_ns));
	s->volts = calloc(s->n_rows * s->recording.n_channels, sizeof(*s->volts));
	assert_true(s->at_ns && s->volts);
	size_t rows = 0;
	for (uint8_t lens = 0; lens < BB_LENS_COUNT; lens++) {
		const struct sim_eye_camera_config config = sim_eye_camera_default((enum bb_glass)lens);
		struct sim_eye_camera camera;
		struct sim_optics *o;
		struct sim_rng rng;
		int64_t n = 0;
		s->recording.aperture_us = config.exposure_us;
		sim_rng_seed(&rng, truth->seed, "edges", "scene");
		assert_int_equal(sim_optics_create(room, screens, SCENE_SCREENS, &look, &o), BB_OK);
		sim_eye_camera_init(&camera, &config, o, 0, (enum bb_glass)lens, truth->seed + lens, 0);
		for (rows = 0; sim_eye_camera_next_ns(&camera) < end_ns; rows++) {
			uint8_t grey[SIM_CAMERA_HEIGHT * SIM_CAMERA_WIDTH];
			while ((double)n * scene_edge_ns(s) < (double)sim_eye_camera_next_ns(&camera) + 2 * scene_edge_ns(s)) {
				for (size_t i = 0; i < s->recording.n_shows; i++)
					if ((double)n * scene_edge_ns(s) >= (double)s->recording.show[i].from_ns && n % 2 == 0)
						sim_optics_show(o, 0, s->recording.show[i].pattern);
				scene_tell(s, o, &rng, n++);
			}
			s->at_ns[rows] = sim_eye_camera_expose(&camera, grey);
			for (size_t band = 0; band < BB_BANDS; band++) {
				double sum = 0;
				for (size_t i = 0; i < 2 * SIM_CAMERA_WIDTH; i++)
					sum += grey[band * 9 * SIM_CAMERA_WIDTH + i];
				s->volts[rows * s->recording.n_channels + lens * BB_BANDS + band] = sum / (2 * SIM_CAMERA_WIDTH);
			}
		}
		for (uint8_t band = 0; band < BB_BANDS; band++) {
			struct bb_channel *c = &s->recording.channel[lens * BB_BANDS + band];
			strcpy(c->wall, room->walls[0].id);
			c->spot = band;
			c->lens = lens;
		}
		sim_optics_destroy(o);
	}
	s->n_rows = rows;
	return s;
}

static inline void scene_analyse(struct optics_scene *s)
{
	assert_int_equal(bb_analyser_create(&s->recording, &s->analyser), BB_OK);
	for (size_t i = 0; i < s->n_rows; i++)
		bb_analyser_scan(s->analyser, s->at_ns[i], s->volts + i * s->recording.n_channels);
	assert_true(bb_analyser_turn(s->analyser));
	for (size_t i = 0; i < s->n_rows; i++)
		bb_analyser_fold(s->analyser, s->at_ns[i], s->volts + i * s->recording.n_channels);
	bb_analyser_finish(s->analyser, &s->result);
}

static inline void scene_free(struct optics_scene *s)
{
	bb_analyser_destroy(s->analyser);
	free(s->at_ns);
	free(s->volts);
	free(s);
}

/* An instant of the scene, as a phase of a cycle of this length at the recording's middle. */
static inline double scene_phase_ns(const struct optics_scene *s, double at_ns, double cycle_ns)
{
	const double phase = fmod(at_ns - (double)s->result.middle_ns, cycle_ns);

	return phase < 0 ? phase + cycle_ns : phase;
}

#endif
