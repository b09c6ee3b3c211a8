/*
 * drivers/edid.h: reads EDIDs: the base block (E-EDID 1.3/1.4) and a bounded walk over its extensions (CTA-861,
 * DisplayID, block maps). Pure; every byte is hostile; nothing is allocated. mm, px, kHz.
 */
#ifndef BB_DRIVERS_EDID_H
#define BB_DRIVERS_EDID_H

#include "hal/status.h"

#define EDID_MOST_BLOCKS 8
#define EDID_MOST_TIMINGS 24

enum edid_stereo { /* of a detailed timing: bits 6, 5, 0 of its flags */
		   EDID_STEREO_NONE,
		   EDID_STEREO_SEQUENTIAL_RIGHT, /* field sequential, right image while stereo sync is 1 */
		   EDID_STEREO_SEQUENTIAL_LEFT,
		   EDID_STEREO_ROWS_RIGHT_EVEN,
		   EDID_STEREO_ROWS_LEFT_EVEN,
		   EDID_STEREO_FOUR_WAY,
		   EDID_STEREO_SIDE_BY_SIDE,
};

struct edid_timing { /* one detailed timing descriptor */
	int32_t clock_khz;
	uint16_t width, height, h_blank, v_blank, h_front, h_sync, v_front, v_sync;
	uint16_t width_mm, height_mm;
	bool interlaced;
	enum edid_stereo stereo;
};
double edid_timing_hz(const struct edid_timing *t); /* 0 for a timing without pixels or lines */

struct edid_extension {
	uint8_t tag; /* 02 CTA-861, 70 DisplayID, F0 block map, .. */
	uint8_t revision;
	bool good;        /* checksum */
	uint8_t n_blocks; /* data blocks walked inside it */
};

struct edid_info {
	char maker[4]; /* "SAM"; letters outside A-Z become '?' */
	uint16_t product;
	uint32_t serial;
	uint8_t week;
	uint16_t year;
	uint8_t version, revision;
	bool digital;
	uint8_t bits_per_color; /* 0: not told */
	uint8_t interface;      /* 1 DVI, 2 HDMI-a, 3 HDMI-b, 4 MDDI, 5 DisplayPort */
	uint8_t width_cm, height_cm;
	uint16_t gamma_x100; /* 0: told elsewhere */
	uint16_t chroma[8];  /* red, green, blue, white: x, y in 1/1024 */
	char name[14], serial_text[14], text[14];
	bool has_range;
	uint16_t least_hz, most_hz, least_khz, most_khz, most_mhz;
	size_t n_timings; /* the first is the preferred one */
	struct edid_timing timing[EDID_MOST_TIMINGS];
	uint8_t n_declared;  /* extensions the base block claims */
	size_t n_extensions; /* extensions that are there */
	struct edid_extension extension[EDID_MOST_BLOCKS - 1];
};

/* The first block whose checksum or (block 0) header is wrong; -1: none. A part of a block counts as wrong. */
int edid_bad_block(const uint8_t *bytes, size_t n);
/* BB_ERR_FORMAT when the base block is short, has no header or a wrong checksum. Damaged extensions are named in
 * out->extension and not looked into. */
BB_MUST_CHECK enum bb_status edid_parse(const uint8_t *bytes, size_t n, struct edid_info *out);

#endif
