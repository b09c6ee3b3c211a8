/*
 * sync/flash_meter.h: would what is shown hurt somebody with photosensitive epilepsy? Fed with a grid of 16 x 9 colours of
 * every wall and eye, frame by frame, it counts opposing changes (two are a flash) of every cell by three rules:
 *
 *   general   WCAG 2.3.1: luminance moves by 10 % of the most there is, the darker end below 0.80
 *   red       the same clause: one end saturated red (R / (R + G + B) >= 0.8), the ends 0.2 apart in CIE 1976 u'v'
 *   bt1702    ITU-R BT.1702: luminance moves by 20 cd/m2, the darker end below 160
 *
 * A second in which cells flash counts when together they are more than 0.006 sr within some 10 degree field (a quarter of
 * one; bt1702: more than a quarter of their wall). Solid angles are exact, from the room's geometry and where the viewer
 * stands; cells that flash in the same second count together whether in step or not, a fine pattern is not exempt, and a
 * slow fade counts like a fast one: all on the safe side. More than limit = 3 flashes in any one second are a violation.
 *
 * Colours are linear light, 1 being the display's white seen through open shutters; `light` scales a whole wall.
 * Memory is taken at creation. One thread.
 */
#ifndef BB_SYNC_FLASH_METER_H
#define BB_SYNC_FLASH_METER_H

#include "hal/room.h"

#define BB_FLASH_COLUMNS 16
#define BB_FLASH_ROWS 9
#define BB_FLASH_CELLS (BB_FLASH_COLUMNS * BB_FLASH_ROWS)
#define BB_FLASH_MOST 15 /* opposing changes a second that are told apart */

struct bb_flash_grid {
	uint64_t generation;          /* another one: the colours have changed */
	float rgb[BB_FLASH_CELLS][3]; /* rows from the top, columns from the left, as seen from inside */
};

enum bb_flash_rule { BB_FLASH_GENERAL, BB_FLASH_RED, BB_FLASH_BT1702, BB_FLASH_RULES };
const char *bb_flash_rule_text(enum bb_flash_rule rule);

struct bb_flash_worst { /* the worst second so far */
	double flashes;         /* half the opposing changes */
	int64_t at_ns;          /* of the last of them */
	unsigned wall, eye;
	enum bb_flash_rule rule;
	double area;            /* that flashed: sr in the worst field; bt1702: share of the wall */
};

struct bb_flash_meter;
/* Corners of the walls' pictures; 1702 without memory. */
BB_MUST_CHECK enum bb_status bb_flash_create(const struct bb_corners *walls, size_t n_walls, struct bb_vec3 viewer,
                                             const struct bb_safety *limits, struct bb_flash_meter **out);
void bb_flash_destroy(struct bb_flash_meter *m); /* NULL allowed */
/* One frame of one wall for one eye (0 left, 1 right); times of a wall and eye ascend. */
void bb_flash_frame(struct bb_flash_meter *m, unsigned wall, unsigned eye, int64_t at_ns, const struct bb_flash_grid *g,
                    double light);
struct bb_flash_worst bb_flash_worst(const struct bb_flash_meter *m);
/* For tests: opposing changes so far, all cells and rules; the solid angle of a cell. */
uint64_t bb_flash_changes(const struct bb_flash_meter *m);
double bb_flash_cell_sr(const struct bb_flash_meter *m, unsigned wall, unsigned cell);
/* Relative luminance of linear sRGB. */
double bb_flash_luminance(const float rgb[3]);

/* Solid angle of a triangle seen from the origin, sr (Van Oosterom and Strackee 1983). */
double bb_solid_angle(struct bb_vec3 a, struct bb_vec3 b, struct bb_vec3 c);

#endif
