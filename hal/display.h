/*
 * hal/display.h: one scan-out: vblank stamps with a sequence, present an image for a target vblank, flip results, the
 * swap group's frame counter. One display is one projector (or projector pair driven as one) or one monitor.
 */
#ifndef BB_HAL_DISPLAY_H
#define BB_HAL_DISPLAY_H

#include "hal/device.h"
#include "hal/shutter.h"

enum bb_display_kind { BB_DISPLAY_LCD, BB_DISPLAY_DLP, BB_DISPLAY_STROBED };
/* Which row changes first. GLOBAL: all at once at the end of vblank. */
enum bb_scan { BB_SCAN_DOWN, BB_SCAN_UP, BB_SCAN_GLOBAL };
enum bb_stereo { BB_STEREO_MONO, BB_STEREO_DUAL_PROJECTOR, BB_STEREO_FRAME_SEQUENTIAL };

struct bb_display_config {
	char id[BB_ID_MAX];           /* the screen's id */
	char node[BB_ID_MAX];
	char device[160];
	enum bb_display_kind kind;
	enum bb_stereo stereo;
	struct bb_rate rate;          /* refresh */
	double vblank_us;             /* 0: 4 % of the period */
	bool genlock;                 /* scan-out locked to the room's reference */
	double rate_error_ppm;        /* sim: of a display that is not genlocked; NAN: drawn from the seed within +-20 */
	int64_t width_px, height_px;
	/* Optics, seen from the start of vblank of the frame that brings a picture. A room file's reader fills in what
	 * the kind says where a key is missing; see docs/rooms.md. */
	enum bb_scan scan;            /* row y changes at vblank + y * (period - vblank), y = 0 the first row scanned */
	double pixel_rise_us, pixel_fall_us; /* 10-90 %, exponential */
	double dark_us;               /* dlp: no light for the last so many us before the next picture */
	double strobe_at_us, strobe_us; /* strobed: light from strobe_at for strobe_us of every frame, modulo a period */
};

/* Vertical blanking as configured, or its default. */
static inline double bb_display_vblank_us(const struct bb_display_config *c)
{
	return c->vblank_us > 0 ? c->vblank_us : 1e6 / bb_rate_hz(c->rate) / 25;
}

struct bb_display_limits {
	int64_t period_ns, vblank_ns;
	int64_t stamp_error_ns;       /* of a vblank stamp */
	uint32_t most_queued;         /* presents waiting for their flip */
};

struct bb_vblank {
	int64_t at_ns;                /* start of vblank, host */
	uint32_t seq;
};
struct bb_flip {
	uint64_t frame;               /* as presented */
	int64_t at_ns;                /* the vblank it became visible at */
	uint32_t seq, target_seq;     /* seq > target_seq: late */
	uint8_t eye;                  /* enum bb_eye of the image shown from here on; NONE: both or mono */
};

struct bb_display;
struct bb_display_driver;

BB_MUST_CHECK enum bb_status bb_display_open(const struct bb_display_driver *driver,
                                             const struct bb_display_config *config, const struct bb_open *open,
                                             struct bb_display **out);
void bb_display_close(struct bb_display *d);
const struct bb_display_limits *bb_display_limits(const struct bb_display *d);
/* The newest vblank at or before now; BB_TIMEOUT before the first. */
BB_MUST_CHECK enum bb_status bb_display_vblank(struct bb_display *d, struct bb_vblank *out);
/* Queue an image for a target vblank sequence; a target that has passed means the next vblank. BB_ERR_BUSY when
 * most_queued wait already. Pixels do not pass through here: the image of `frame` is the node's affair. */
BB_MUST_CHECK enum bb_status bb_display_present(struct bb_display *d, uint64_t frame, enum bb_eye eye,
                                                uint32_t target_seq);
/* Results not read yet, oldest first; *n_out = 0 and BB_TIMEOUT when there is none. */
BB_MUST_CHECK enum bb_status bb_display_flips(struct bb_display *d, struct bb_flip *flips, size_t cap, size_t *n_out);
/* Frame counter of the swap group; BB_ERR_UNSUPPORTED without hardware framelock (genlock false). */
BB_MUST_CHECK enum bb_status bb_display_swap_counter(struct bb_display *d, uint64_t *counter_out);
struct bb_device *bb_display_device(struct bb_display *d);

#endif
