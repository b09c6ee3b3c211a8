/*
 * sim/optics/sensor.h: what looks at the light of sim/optics/optics.h: a photodiode with an amplifier and a converter,
 * and a high-speed camera. Both integrate what falls on them in steps of at most 2 us. Seeded. One thread.
 */
#ifndef BB_SIM_SENSOR_H
#define BB_SIM_SENSOR_H

#include "sim/optics/optics.h"
#include "sim/world.h"

struct sim_diode_config {
	double rate_hz;          /* samples a second */
	double bandwidth_hz;     /* first order */
	double read_v, shot_v;   /* sd: always; of full light, by the root of the light */
	double offset_v, hum_v, mains_hz; /* dark voltage; lamps and cables hum at twice the mains */
	double full_v;           /* a white wall without glasses */
	double range_v;          /* of the converter, from 0 */
	unsigned bits;
};
/* A 20 kHz amplifier before 14 bits at 50 kHz, half a percent of noise. */
struct sim_diode_config sim_diode_default(void);

/* One channel a diode. screen: by place in the optics' list. */
struct sim_diode {
	struct bb_channel channel;
	size_t screen;
	double level;            /* behind the amplifier's filter, in units of white */
};
struct sim_diodes {
	struct sim_diode_config config;
	struct sim_optics *optics;
	struct sim_rng rng;
	int64_t begin_ns;
	uint64_t n;              /* samples taken */
	size_t n_diodes;
	struct sim_diode diode[BB_CHANNELS_MAX];
};
void sim_diodes_init(struct sim_diodes *d, const struct sim_diode_config *config, struct sim_optics *optics, uint64_t seed,
                     int64_t begin_ns);
/* What the converter makes of a level at a time: offset, hum, noise, steps. */
double sim_diode_volts(const struct sim_diode_config *c, struct sim_rng *rng, double level, double t_s);
/* When the next sample will be taken; takes it (one voltage a diode, in order) and returns its stamp. */
int64_t sim_diodes_next_ns(const struct sim_diodes *d);
int64_t sim_diodes_sample(struct sim_diodes *d, double *volts);

struct sim_eye_camera_config { /* a camera that looks at one screen through one lens of the glasses, or none */
	double rate_hz, exposure_us;
	double white;            /* grey value of a white wall without glasses, before the lens' own gain */
	double gain;             /* 1 without glasses, more behind a lens */
	double read_grey, shot_grey; /* sd: always; at 255 */
};
struct sim_eye_camera_config sim_eye_camera_default(enum bb_glass lens);
struct sim_eye_camera {
	struct sim_eye_camera_config config;
	struct sim_optics *optics;
	struct sim_rng rng;
	size_t screen;
	enum bb_glass lens;
	int64_t begin_ns;
	uint64_t n;
};
#define SIM_CAMERA_WIDTH 16
#define SIM_CAMERA_HEIGHT 20 /* rows, each of which sees its own share of the screen's rows */
struct sim_look sim_look_camera(void);
void sim_eye_camera_init(struct sim_eye_camera *c, const struct sim_eye_camera_config *config, struct sim_optics *optics,
                         size_t screen, enum bb_glass lens, uint64_t seed, int64_t begin_ns);
int64_t sim_eye_camera_next_ns(const struct sim_eye_camera *c); /* end of the next exposure */
/* Exposes; 8-bit grey from the top row. Returns the middle of the exposure. */
int64_t sim_eye_camera_expose(struct sim_eye_camera *c, uint8_t grey[SIM_CAMERA_HEIGHT * SIM_CAMERA_WIDTH]);

#endif
