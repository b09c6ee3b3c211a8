/*
 * hal/shutter.h: the stereo shutter chain: sync edges in, emitter and shutter phases out.
 *
 * A chain has n stages (one controller per wall, daisy-chained) and one emitter for the glasses. Every stage reports
 * the instant its own shutters switched; eye is the eye that begins to see. Stage BB_STAGE_EMITTER is the glasses.
 */
#ifndef BB_HAL_SHUTTER_H
#define BB_HAL_SHUTTER_H

#include "hal/device.h"

enum bb_eye { BB_EYE_NONE, BB_EYE_LEFT, BB_EYE_RIGHT };

#define BB_STAGES_MAX 32
#define BB_STAGE_EMITTER 255

/* A liquid-crystal cell. Light follows 1 - exp(-t / tau) when it opens and exp(-t / tau) when it closes, tau = the
 * 10-90 % time / ln 9. */
struct bb_cell {
	double open_us, close_us;    /* 10-90 %; opening is slower */
	double contrast;             /* light let through open : closed */
	double transmission_percent; /* open */
};

/* Times a cell can have at all: what every back end asks before it opens. */
static inline bool bb_cell_moves(const struct bb_cell *c)
{
	return c->open_us >= 0 && c->close_us >= 0 && c->open_us + c->close_us < 1e6;
}

struct bb_shutter_config {
	char id[BB_ID_MAX];          /* "chain" */
	char device[160];
	struct bb_rate rate;         /* edges per second: 120 Hz = 60 per eye */
	int64_t n_stages;
	char stage[BB_STAGES_MAX][BB_ID_MAX]; /* wall ids in chain order */
	double stage_delay_us;       /* per stage of the chain, nominal, compensated by set_phase */
	double rate_error_ppm, jitter_us; /* of the sync generator (sim) */
	struct bb_cell cell;         /* external shutters before dual projectors */
	struct bb_cell glasses;
	double shutter_delay_us;     /* a stage opens this long after its sync edge, chain delay compensated ... */
	double shutter_duty_percent; /* ... and stays open for this share of an edge period */
	char emitter_protocol[BB_ID_MAX];
	double emitter_offset_us;    /* glasses switch this long after the sync edge: one lens opens */
	double token_gap_us;         /* the other lens has closed this long before */
	double coast_s;              /* the controllers go on by their own clocks for so long without sync edges (sim) */
	double untagged;             /* 1: its edges do not tell their eye (sim) */
};

struct bb_shutter_limits {
	int64_t least_period_ns, most_period_ns;
	int64_t stamp_error_ns;      /* of an edge's stamp, at most */
	int64_t phase_step_ns;       /* resolution of set_phase; 0: phases are fixed by the hardware */
	int64_t open_ns, close_ns;
	int64_t n_stages;            /* the first so many stages report edges; the emitter always does */
	int64_t coast_ns;            /* without hearing the sync it goes on switching, and says nothing, for so long; 0: it stands */
};

struct bb_shutter_edge {
	int64_t at_ns;    /* host */
	uint32_t seq;     /* counts the generator's edges: a gap is a loss */
	uint8_t eye;      /* enum bb_eye; BB_EYE_NONE when the device cannot tell */
	uint8_t stage;    /* index into config.stage, or BB_STAGE_EMITTER */
};

enum bb_shutter_mode { BB_SHUTTER_OPEN, BB_SHUTTER_STEREO }; /* OPEN: both eyes see; the safe state */

struct bb_shutter;
struct bb_shutter_driver;

BB_MUST_CHECK enum bb_status bb_shutter_open(const struct bb_shutter_driver *driver,
                                             const struct bb_shutter_config *config, const struct bb_open *open,
                                             struct bb_shutter **out);
/* Leaves every stage open (fail-safe), whatever state the chain is in. */
void bb_shutter_close(struct bb_shutter *sh);
const struct bb_shutter_limits *bb_shutter_limits(const struct bb_shutter *sh);
/* Up to cap edges not read yet, oldest first, of all stages; *n_out = 0 and BB_TIMEOUT when there is none. */
BB_MUST_CHECK enum bb_status bb_shutter_read(struct bb_shutter *sh, struct bb_shutter_edge *edges, size_t cap,
                                             size_t *n_out);
/* Delay of one stage (or the emitter) after the sync edge as seen by the audience, 0 .. one period, and duty in ppm.
 * BB_ERR_UNSUPPORTED: that stage's phase is what it is. */
BB_MUST_CHECK enum bb_status bb_shutter_set_phase(struct bb_shutter *sh, uint8_t stage, int64_t delay_ns,
                                                  uint32_t duty_ppm);
BB_MUST_CHECK enum bb_status bb_shutter_set_mode(struct bb_shutter *sh, enum bb_shutter_mode mode);
struct bb_device *bb_shutter_device(struct bb_shutter *sh);

#endif
