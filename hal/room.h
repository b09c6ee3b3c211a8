/*
 * hal/room.h: a room as the file describes it, checked, with every default filled in and every generator expanded.
 *
 * Metres, Y up, right-handed. A wall is three corners as seen from inside the room: lower left, lower right, upper
 * left. A screen is what one scan-out shows: a whole wall, or one tile of its grid. Owned by the caller of
 * bb_room_load; immutable afterwards.
 */
#ifndef BB_HAL_ROOM_H
#define BB_HAL_ROOM_H

#include "hal/camera.h"
#include "hal/display.h"
#include "hal/gamepad.h"
#include "hal/link.h"
#include "hal/metric.h"
#include "hal/monitor.h"
#include "hal/power.h"
#include "hal/safety.h"
#include "hal/shutter.h"

struct bb_corners {
	struct bb_vec3 lower_left, lower_right, upper_left;
};

struct bb_node {
	char id[BB_ID_MAX];
	char profile[BB_ID_MAX]; /* cost model: rooms/profiles/<profile>.yaml */
	bool head;               /* owns devices, sends state; draws nothing unless it has a wall. Exactly one. */
};

struct bb_wall {
	char id[BB_ID_MAX];
	char node[BB_ID_MAX];    /* of an untiled wall */
	struct bb_corners corners;
	int64_t width_px, height_px; /* of the whole wall without bezels */
	int64_t columns, rows;   /* 1 x 1 when untiled */
	double bezel_edge_m;
	int64_t door_column, door_row, door_columns, door_rows; /* tiles of a part that swings open; 0 columns: none */
	int line;
};

struct bb_screen {
	char id[BB_ID_MAX];      /* wall id, or "<wall>-<column>-<row>" counting from the lower left, 0 based */
	uint16_t wall, node;     /* indices */
	struct bb_corners corners;   /* of the picture area, bezel excluded */
	struct bb_display_config display;
};

struct bb_body { /* a set of retro-reflecting markers */
	char id[BB_ID_MAX];
	size_t n_markers;        /* 3..6 */
	struct bb_vec3 marker[6];/* metres, body space: as measured by hand, any origin */
	struct bb_vec3 eye_centre; /* midpoint between the eyes in body space (glasses) */
};

#define BB_BODIES_MAX 8

struct bb_room {
	char path[BB_PATH_MAX_BYTES];
	char name[64];
	uint8_t sha256[32];      /* of the file's bytes */
	double eye_separation_m;
	struct bb_vec3 size_m;   /* inner width (x), height (y), depth (z); zero: taken from the walls */
	struct bb_vec3 min, max; /* box around walls */
	struct bb_vec3 neutral;  /* where a viewer stands when nothing is known: the eyes' midpoint */
	double degraded_max_s;   /* devices_ok */

	size_t n_nodes;
	struct bb_node *nodes;
	size_t n_walls;
	struct bb_wall *walls;
	size_t n_screens;
	struct bb_screen *screens;
	bool has_chain;
	struct bb_shutter_config chain;
	size_t n_cameras;
	struct bb_camera_config *cameras; /* calibrated, when the file names a calibration */
	char calibration[BB_PATH_MAX_BYTES], calibrated[32]; /* its file and date; empty: cameras are as planned */
	size_t n_monitors;
	struct bb_monitor_config *monitors;
	size_t n_pdus;
	struct bb_power_config *pdus;
	size_t n_gamepads;
	struct bb_gamepad_config *gamepads;
	size_t n_bodies;
	struct bb_body bodies[BB_BODIES_MAX]; /* bodies[0] is the glasses */
	struct bb_link_config link;
	int barrier;             /* enum bb_lock_method */
	struct bb_safety safety;
	size_t n_budgets;
	struct bb_budget budgets[BB_BUDGETS_MAX];
};

BB_MUST_CHECK enum bb_status bb_room_load(const char *path, struct bb_room **out, struct bb_error *err);
/* The same with its cameras as planned, whether or not it names a calibration: what a calibration starts from. */
BB_MUST_CHECK enum bb_status bb_room_load_planned(const char *path, struct bb_room **out, struct bb_error *err);
void bb_room_free(struct bb_room *room);

/* Geometry lint: findings that a loaded room may have. severity 1 = error (exit 1), 0 = warning. */
struct bb_finding {
	int number;     /* as in hal/errors.def, 115x */
	int severity;
	char text[256];
};
/* Fills up to cap findings and returns how many there are in all. Never allocates. */
size_t bb_room_lint(const struct bb_room *room, struct bb_finding *findings, size_t cap);

/* Every row of the tables a room file is read through, for --help and the manual: section by section, NULL past the
 * end. */
struct bb_option;
struct bb_room_section {
	const char *name;
	const struct bb_option *options;
};
const struct bb_room_section *bb_room_section(size_t i);

/* Is a point inside the room: behind no wall, and between walls that face each other? slack_m widens the room. */
bool bb_room_contains(const struct bb_room *room, struct bb_vec3 p, double slack_m);
/* Does a camera have this point in its picture, margin_px within its edge (behind nothing, lens distortion included)? */
bool bb_camera_sees(const struct bb_camera_config *camera, struct bb_vec3 p, double margin_px);

/* Index by id; -1 when there is none. */
int bb_room_node(const struct bb_room *room, const char *id);
int bb_room_wall(const struct bb_room *room, const char *id);

/* The inner point of a screen (u, v in 0..1 from the lower left), and its upper right corner. */
struct bb_vec3 bb_corners_at(const struct bb_corners *c, double u, double v);
struct bb_vec3 bb_corners_normal(const struct bb_corners *c); /* into the room: right x up */

#endif
