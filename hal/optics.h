/*
 * hal/optics.h: what an optical recording of a room is made of: the four test patterns, where a sensor looks, and what
 * the recording says about itself. Shared by what records (a simulated sensor, a person with a photodiode) and what
 * reads. Names are the words of the file (docs/phase-measure.md). Stateless.
 */
#ifndef BB_HAL_OPTICS_H
#define BB_HAL_OPTICS_H

#include "hal/rate.h"
#include "hal/shutter.h"

enum bb_pattern { /* the left eye's picture, then the right eye's */
	BB_PATTERN_WHITE_BLACK, BB_PATTERN_BLACK_WHITE, BB_PATTERN_BLACK_BLACK, BB_PATTERN_WHITE_WHITE, BB_PATTERN_COUNT
};
enum bb_spot { /* where on its wall a sensor looks; LAMP: at a steady lamp, TAG: at the patch that tells the eye */
	BB_SPOT_TOP, BB_SPOT_MIDDLE, BB_SPOT_BOTTOM, BB_SPOT_TAG, BB_SPOT_LAMP, BB_SPOT_COUNT
};
enum bb_glass { BB_LENS_BARE, BB_LENS_LEFT, BB_LENS_RIGHT, BB_LENS_COUNT }; /* of the glasses, before the sensor */
#define BB_BANDS 3 /* TOP, MIDDLE and BOTTOM: regions with a crosstalk of their own */

#define BB_CHANNELS_MAX 128
#define BB_SHOWS_MAX 32

struct bb_channel { /* "front.top.left", "front.tag.bare", "lamp.right" */
	char wall[BB_ID_MAX]; /* "" for a lamp */
	uint8_t spot, lens;
};
struct bb_showing { /* a stretch of time with one pattern on every wall */
	enum bb_pattern pattern;
	int64_t from_ns, to_ns;
};
struct bb_recording { /* all that is known before the first sample */
	struct bb_rate rate;     /* nominal eye changes per second: two make a cycle */
	double bandwidth_hz;     /* of the sensor, first order; 0: as good as endless */
	double aperture_us;      /* exposure of a camera around its stamp; 0: none */
	double fps_hz, first_s;  /* of pictures: how many a second, and the middle of the first one's exposure */
	size_t n_shows, n_channels;
	struct bb_showing show[BB_SHOWS_MAX]; /* ascending, apart */
	struct bb_channel channel[BB_CHANNELS_MAX];
};

/* The light a test pattern or the tag has for an eye, 0..1. A tag's left frames are white; its right frames carry one bit
 * of a sequence of 31 frames in which every five in a row are different: half white for 1, black for 0. */
double bb_pattern_light(enum bb_pattern pattern, enum bb_eye eye);
double bb_tag_light(uint64_t cycle, enum bb_eye eye);
#define BB_TAG_CYCLES 31
#define BB_TAG_BITS 5
/* Where five bits (the oldest highest) stand in the sequence: 0..30; -1 for five zeros, which do not occur. */
int bb_tag_place(unsigned bits);

const char *bb_pattern_text(enum bb_pattern pattern);
bool bb_pattern_find(const char *text, enum bb_pattern *out);
void bb_channel_text(const struct bb_channel *channel, char *out, size_t cap);
bool bb_channel_find(const char *text, struct bb_channel *out);

#endif
