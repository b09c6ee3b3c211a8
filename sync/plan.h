/*
 * sync/plan.h: the phase plan of a room: when lenses, shutters, tokens and strobes act within a frame, what each row
 * band of each wall gets of it, and, if the room cannot do it, which part stops it. Closed form: every display, cell and
 * strobe is a periodic wave of exponentials (sync/plan/wave.h), light is the integral of their product. Algorithm only,
 * no clock; the caller's memory; any thread.
 *
 * Times are us after the edge of an eye = the start of vblank of the frame that brings its picture; T is the period of
 * edges, an eye's cycle is 2 T. Left and right are alike but for half a cycle, so all numbers are those of one eye.
 *  - Row y (0: first scanned) changes at vblank + y (T - vblank), all rows at vblank when the scan is global; its light
 *    then follows 1 - exp(-t / rise) or exp(-t / fall), in the steady state of a picture white for one eye and black
 *    for the other. A dlp is dark for dark_us before that instant; a strobed display shines in its strobe only.
 *  - A lens opens at glasses_at and closes at glasses_at + glasses_open; a cell lets through
 *    transmission (1/contrast + (1 - 1/contrast) x), x following the same laws, in its steady state.
 *  - Dual projectors shine all the time (dark time and strobe are averaged: nothing ties them to the edges); one projector's
 *    shutter opens at shutter_at for shutter_open in the cycle of its eye.
 * Light: 100 % is a white picture seen all the time by a bare eye. Crosstalk: leakage over signal with the black level
 * removed (A. Woods, J. Electron. Imaging 21(4) 040902, 2012), means over the band; of this model never negative, of
 * measurements it may be.
 */
#ifndef BB_SYNC_PLAN_H
#define BB_SYNC_PLAN_H

#include "hal/room.h"

#define BB_PLAN_BANDS 3       /* top, middle and bottom tenth of the picture */
#define BB_PLAN_WALLS_MAX 64
#define BB_PLAN_CAMERAS_MAX 16
#define BB_PLAN_DRIFTS_MAX 16
#define BB_PLAN_LIMIT_PERCENT 2.0 /* crosstalk, where neither room nor user says one */

struct bb_plan_timing {
	double glasses_at_us, glasses_open_us;
	double shutter_at_us, shutter_open_us; /* external shutters only */
};

struct bb_plan_light {
	double light_percent, crosstalk_percent;
};

struct bb_plan_band {
	double top, bottom;           /* share of the picture's height, from its upper edge */
	/* After the wall's vblank: between these the whole band shows this eye and no other, within the crosstalk limit;
	 * to <= from: there is no such moment, by so much. */
	int64_t window_from_ns, window_to_ns;
	struct bb_plan_light light;
	/* From the other eye's last light to the lens's opening; from the lens closed (within the limit) to the other eye's
	 * next light. Below 0 the neighbour is seen for so long: some of it the limit may allow. */
	double margin_before_us, margin_after_us;
};

struct bb_plan_wall {
	char id[BB_ID_MAX];
	const struct bb_display_config *display; /* the room's */
	struct bb_plan_band band[BB_PLAN_BANDS];
};

/* What could stop a room, and what it would take: the value at which the limit is just held, all else as it is. */
enum bb_plan_part { BB_PLAN_PIXEL, BB_PLAN_VBLANK, BB_PLAN_OPENING, BB_PLAN_CLOSING, BB_PLAN_CONTRAST, BB_PLAN_REFRESH,
                    BB_PLAN_PARTS };
struct bb_plan_need {
	double now, needed;           /* us; contrast: ratio; refresh: edges a second. needed NAN: not even the ideal helps */
	double ideal_percent;         /* crosstalk at best with this part ideal */
};

/* Cameras of one rate, sync and exposure. Exposures begin every step_us; collisions are with the emitter's tokens. */
struct bb_plan_camera {
	char first[BB_ID_MAX];        /* id of the first of n */
	size_t n;
	bool locked;
	double rate_hz, exposure_us;  /* as planned: refresh x multiplier / divider when locked */
	unsigned multiplier, divider;
	double offset_us;             /* locked: exposure after its edge, as planned */
	double margin_us;             /* locked: to the nearest token; below 0: they collide, whatever the offset */
	uint64_t phases;              /* free: how many phases against the tokens it meets before they repeat */
	double phases_hit_percent;    /* free: start phases of which at least one collides */
	double mean_percent;          /* free: exposures that collide once drift has swept all phases */
	double most_percent;          /* free: exposures that collide at the worst start phase */
};

struct bb_plan_drift {            /* two walls whose refresh differs and that nothing locks */
	char a[BB_ID_MAX], b[BB_ID_MAX];
	double a_hz, b_hz;            /* what their modes really run at */
	double frame_s;               /* one slips a whole frame behind the other in this time */
};

struct bb_plan {
	double period_us, limit_percent;
	bool possible;                /* timing holds the limit; else timing is what comes nearest */
	struct bb_plan_timing timing;
	struct bb_plan_light worst;   /* the darkest band's light, the worst band's crosstalk */
	size_t n_walls;
	struct bb_plan_wall wall[BB_PLAN_WALLS_MAX];
	struct bb_plan_need need[BB_PLAN_PARTS]; /* only when not possible */
	enum bb_plan_part stops;      /* only when not possible: the part that is nearest to what it would take */
	const struct bb_ir_protocol *tokens; /* sync/plan/tokens.h; NULL: none known for the room's glasses */
	size_t n_cameras;
	struct bb_plan_camera camera[BB_PLAN_CAMERAS_MAX];
	size_t n_drifts;              /* all of them; the first BB_PLAN_DRIFTS_MAX are kept */
	struct bb_plan_drift drift[BB_PLAN_DRIFTS_MAX];
};

/* The crosstalk budget of the room, else BB_PLAN_LIMIT_PERCENT. */
double bb_plan_limit(const struct bb_room *room);
/* Chooses the timing that holds the limit at the highest light of the darkest band. BB_ERR_CONFIG: 1610 no stereo wall,
 * 1611 more walls, 1612 more kinds of cameras than a plan holds. */
BB_MUST_CHECK enum bb_status bb_plan_room(const struct bb_room *room, double limit_percent, struct bb_plan *out,
                                          struct bb_error *err);
/* The same numbers for a timing as it is, e.g. the one in the room file (bb_plan_configured). */
BB_MUST_CHECK enum bb_status bb_plan_judge(const struct bb_room *room, double limit_percent,
                                           const struct bb_plan_timing *timing, struct bb_plan *out,
                                           struct bb_error *err);
struct bb_plan_timing bb_plan_configured(const struct bb_shutter_config *chain);
/* Any strip of a display, top and bottom as shares of the height, at any timing. */
struct bb_plan_light bb_plan_strip(const struct bb_display_config *display, const struct bb_shutter_config *chain,
                                   const struct bb_plan_timing *timing, double top, double bottom);

#endif
