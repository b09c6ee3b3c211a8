#include "sim/optics/sensor.h"

#include <math.h>
#include <string.h>

#define STEP_NS 2000
#define TURN 6.283185307179586

static double through(const struct sim_optics *o, uint8_t lens)
{
	return lens == BB_LENS_BARE ? 1 : sim_optics_lens(o, lens == BB_LENS_LEFT ? BB_EYE_LEFT : BB_EYE_RIGHT);
}

/* ---- photodiodes ---- */

static double light_on(const struct sim_optics *o, const struct sim_diode *d)
{
	const uint8_t spot = d->channel.spot;
	const double light = spot == BB_SPOT_LAMP  ? 1
	                     : spot == BB_SPOT_TAG ? sim_optics_tag(o, d->screen)
	                                           : sim_optics_bare(o, d->screen, spot, 0);

	return through(o, d->channel.lens) * light;
}

struct sim_diode_config sim_diode_default(void)
{
	return (struct sim_diode_config){ .rate_hz = 50000, .bandwidth_hz = 20000, .read_v = 0.004, .shot_v = 0.006,
		                          .offset_v = 0.05, .hum_v = 0.001, .mains_hz = 50, .full_v = 2, .range_v = 2.5,
		                          .bits = 14 };
}

void sim_diodes_init(struct sim_diodes *d, const struct sim_diode_config *config, struct sim_optics *optics, uint64_t seed,
                     int64_t begin_ns)
{
	memset(d, 0, sizeof(*d));
	d->config = *config;
	d->optics = optics;
	d->begin_ns = begin_ns;
	sim_rng_seed(&d->rng, seed, "diode", "optics");
	sim_optics_step(optics, begin_ns);
}

int64_t sim_diodes_next_ns(const struct sim_diodes *d)
{
	return d->begin_ns + llround((double)(d->n + 1) * 1e9 / d->config.rate_hz);
}

double sim_diode_volts(const struct sim_diode_config *c, struct sim_rng *rng, double level, double t_s)
{
	const double step = c->range_v / (double)((1u << c->bits) - 1);
	double v = c->offset_v + c->full_v * level + c->hum_v * sin(TURN * 2 * c->mains_hz * t_s);

	v += c->read_v * sim_rng_normal(rng) + c->shot_v * sqrt(fmax(level, 0)) * sim_rng_normal(rng);
	return fmin(fmax(round(v / step) * step, 0), c->range_v);
}

int64_t sim_diodes_sample(struct sim_diodes *d, double *volts)
{
	const int64_t at_ns = sim_diodes_next_ns(d);
	const int64_t from_ns = d->n ? d->begin_ns + llround((double)d->n * 1e9 / d->config.rate_hz) : d->begin_ns;
	const int64_t n_steps = (at_ns - from_ns + STEP_NS - 1) / STEP_NS;
	const double keep = exp(-(double)(at_ns - from_ns) / (double)n_steps * 1e-9 * TURN * d->config.bandwidth_hz);

	for (int64_t i = 1; i <= n_steps; i++) {
		const int64_t to_ns = from_ns + (at_ns - from_ns) * i / n_steps;
		sim_optics_step(d->optics, to_ns);
		for (size_t k = 0; k < d->n_diodes; k++) {
			struct sim_diode *di = &d->diode[k];
			const double light = light_on(d->optics, di);
			di->level = light + (di->level - light) * keep;
		}
	}
	for (size_t k = 0; k < d->n_diodes; k++)
		volts[k] = sim_diode_volts(&d->config, &d->rng, d->diode[k].level, (double)(at_ns - d->begin_ns) * 1e-9);
	d->n++;
	return at_ns;
}

/* ---- camera ---- */

struct sim_eye_camera_config sim_eye_camera_default(enum bb_glass lens)
{
	return (struct sim_eye_camera_config){ .rate_hz = 1000, .exposure_us = 500, .white = 220,
		                               .gain = lens == BB_LENS_BARE ? 1 : 3, .read_grey = 1, .shot_grey = 2 };
}

void sim_eye_camera_init(struct sim_eye_camera *c, const struct sim_eye_camera_config *config, struct sim_optics *optics,
                         size_t screen, enum bb_glass lens, uint64_t seed, int64_t begin_ns)
{
	*c = (struct sim_eye_camera){ .config = *config, .optics = optics, .screen = screen, .lens = lens,
		                      .begin_ns = begin_ns };
	sim_rng_seed(&c->rng, seed, "eye-camera", "optics");
	sim_optics_step(optics, begin_ns);
}

int64_t sim_eye_camera_next_ns(const struct sim_eye_camera *c)
{
	return c->begin_ns + llround((double)(c->n + 1) * 1e9 / c->config.rate_hz);
}

struct sim_look sim_look_camera(void)
{
	struct sim_look look = { .n_heights = SIM_CAMERA_HEIGHT, .spread = 1.0 / SIM_CAMERA_HEIGHT, .lanes = 1 };

	for (size_t y = 0; y < SIM_CAMERA_HEIGHT; y++)
		look.height[y] = ((double)y + 0.5) / SIM_CAMERA_HEIGHT;
	return look;
}

static uint8_t grey_of(struct sim_eye_camera *c, double level)
{
	const double grey = level * c->config.white * c->config.gain;
	const double noise = c->config.read_grey * sim_rng_normal(&c->rng) +
	                     c->config.shot_grey * sqrt(fmax(grey, 0) / 255) * sim_rng_normal(&c->rng);

	return (uint8_t)fmin(fmax(round(8 + grey + noise), 0), 255); /* a pedestal of 8, or black would be cut in half */
}

int64_t sim_eye_camera_expose(struct sim_eye_camera *c, uint8_t grey[SIM_CAMERA_HEIGHT * SIM_CAMERA_WIDTH])
{
	const int64_t end_ns = sim_eye_camera_next_ns(c), open_ns = end_ns - llround(c->config.exposure_us * 1e3);
	double sum[SIM_CAMERA_HEIGHT] = { 0 };
	int64_t at_ns = open_ns, to_ns;

	sim_optics_step(c->optics, open_ns); /* the light between two exposures is not seen */
	for (; at_ns < end_ns; at_ns = to_ns) {
		to_ns = at_ns + STEP_NS < end_ns ? at_ns + STEP_NS : end_ns;
		sim_optics_step(c->optics, to_ns);
		const double seen = through(c->optics, (uint8_t)c->lens) * (double)(to_ns - at_ns);
		for (size_t y = 0; y < SIM_CAMERA_HEIGHT; y++)
			sum[y] += sim_optics_bare(c->optics, c->screen, y, 0) * seen;
	}
	for (size_t y = 0; y < SIM_CAMERA_HEIGHT; y++)
		for (size_t x = 0; x < SIM_CAMERA_WIDTH; x++)
			grey[y * SIM_CAMERA_WIDTH + x] = grey_of(c, sum[y] / (double)(end_ns - open_ns));
	c->n++;
	return open_ns + (end_ns - open_ns) / 2;
}
