/*
 * sync/calibrate/sequence.h: what the cameras saw of a floor square and of a wand: a text file, one line a frame and camera.
 *
 *	# blackburst wand 1
 *	wand_mm 0 150 400                              three markers on a rod, where along it
 *	square_mm 0 0 0  300 0 0  0 0 -160  0 0 -400   corner, end of the short arm, middle and end of the long arm: in the room
 *	camera c1                                      one line each
 *	part square                                    what follows shows the square lying still
 *	0.000000 c1 312.441 208.170 340.002 ...        seconds, camera, x and y of every blob (px); of all cameras together
 *	part wand
 *	2.000000 c1 ...
 *
 * Lines of cameras that exposed together carry times within 0.5 ms. Times never go back, the square's and the wand's each. "#" begins a comment
 * line. Every byte is hostile until checked: 1730, 1731.
 */
#ifndef BB_SYNC_CALIBRATE_SEQUENCE_H
#define BB_SYNC_CALIBRATE_SEQUENCE_H

#include "hal/base.h"
#include "hal/geometry.h"
#include "hal/status.h"

#define BB_SEQUENCE_BLOBS_MAX 32    /* of a line; more is no wand but a flood */
#define BB_SEQUENCE_CAMERAS_MAX 256
#define BB_SEQUENCE_LINES_MAX 4000000
#define BB_SEQUENCE_BYTES_MAX (256u << 20)
#define BB_SEQUENCE_TOGETHER_NS 500000

enum bb_sequence_kind { BB_SEQUENCE_NOTHING, BB_SEQUENCE_WAND, BB_SEQUENCE_SQUARE, BB_SEQUENCE_CAMERA,
	                BB_SEQUENCE_PART_SQUARE, BB_SEQUENCE_PART_WAND, BB_SEQUENCE_SIGHT };

struct bb_sequence_line { /* one line taken apart */
	enum bb_sequence_kind kind;
	double number[12]; /* WAND: 3, m; SQUARE: 12, m */
	char id[BB_ID_MAX];
	int64_t t_ns;
	size_t n;
	float px[BB_SEQUENCE_BLOBS_MAX][2];
};
/* Takes n bytes without a line end apart; NULL when good, else what is wrong with it. Pure, no allocation. */
const char *bb_sequence_line(const char *text, size_t n, struct bb_sequence_line *out);

struct bb_sequence_sight {
	int64_t t_ns;
	uint32_t first;  /* into px */
	uint16_t n, camera;
	bool square;
};

struct bb_sequence {
	double along_m[3];        /* ascending from 0; the middle one is nearer to the first */
	struct bb_vec3 square[4]; /* corner, short end, long middle, long end */
	size_t n_cameras;
	char (*ids)[BB_ID_MAX];
	size_t n_sights;
	struct bb_sequence_sight *sights;
	size_t n_px;
	float (*px)[2];
	size_t cap_sights, cap_px; /* of its memory */
	uint8_t sha256[32];        /* of the file's bytes; zero when it was simulated */
};

/* The trade's wand and square, of which the defaults of a simulation are. */
void bb_sequence_defaults(struct bb_sequence *s);
BB_MUST_CHECK enum bb_status bb_sequence_add_camera(struct bb_sequence *s, const char *id);
BB_MUST_CHECK enum bb_status bb_sequence_add(struct bb_sequence *s, int64_t t_ns, uint16_t camera, bool square,
                                             const float (*px)[2], size_t n);
BB_MUST_CHECK enum bb_status bb_sequence_read(const char *path, struct bb_sequence *out, struct bb_error *err);
/* The same from bytes; path is for messages. */
BB_MUST_CHECK enum bb_status bb_sequence_parse(const char *text, size_t n, const char *path, struct bb_sequence *out,
                                               struct bb_error *err);
void bb_sequence_free(struct bb_sequence *s);

#endif
