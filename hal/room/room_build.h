/*
 * hal/room_build.h: what the files that build a room share while it is being read (room.c, room_walls.c,
 * room_devices.c). Nobody else includes it.
 */
#ifndef BB_HAL_ROOM_BUILD_H
#define BB_HAL_ROOM_BUILD_H

#include "hal/room.h"
#include "hal/room/yaml.h"

#define BB_ROOM_WALLS_MAX 64
#define BB_ROOM_SCREENS_MAX 4096
#define BB_ROOM_CAMERAS_MAX 256
#define BB_ROOM_MONITORS_MAX 1024
#define BB_ROOM_PDUS_MAX 32
#define BB_ROOM_GAMEPADS_MAX 16
#define BB_ROOM_SPAN_M 1000.0 /* no coordinate is further out */

#define BB_DEVICE_BYTES 160

struct room_wall_draft {
	char id[BB_ID_MAX], node[BB_ID_MAX];
	const struct bb_yaml_node *at;
	struct bb_display_config display;
	double refresh_hz;
	int scan;                     /* 0: as the kind says, else enum bb_scan + 1 */
	int64_t width_px, height_px;  /* of one screen */
	int64_t columns, rows, columns_per_node;
	double bezel_edge_m, picture_width_m, picture_height_m;
	unsigned given;               /* enum room_corner_bits */
	struct bb_vec3 lower_left, lower_right, upper_left, right, up;
	size_t n_nodes;
	uint16_t nodes[BB_LINK_NODES_MAX];
	size_t n_ring;                /* 4: front, right, back, left of a closed ring */
	struct {
		char id[BB_ID_MAX];
		int64_t columns;
	} ring[4];
	double floor_m;
	char door_wall[BB_ID_MAX];
	int64_t door_column, door_row, door_columns, door_rows;
};
enum room_corner_bits { ROOM_LL = 1, ROOM_LR = 2, ROOM_UL = 4, ROOM_RIGHT = 8, ROOM_UP = 16 };

struct room_camera_draft {
	struct bb_camera_config camera;
	const struct bb_yaml_node *at;
	char ids[2 * BB_ID_MAX];
	double rate_hz, focal_px, centre_px[2]; /* focal_px 0: from fov_deg */
	bool has_position, has_target, has_centre;
	struct bb_vec3 position[2], target[2]; /* from, to: a row of cameras */
};

struct room_monitor_draft {
	struct bb_monitor_config monitor;
	const struct bb_yaml_node *at;
	double refresh_hz;
	size_t n_walls;
	uint16_t walls[BB_ROOM_WALLS_MAX];
};

struct room_build {
	struct bb_reader r; /* first: branches are handed a pointer to it */
	struct bb_room *room;
	bool planned;                /* cameras stay as planned, whatever calibration is named */
	char device[BB_DEVICE_BYTES];
	struct room_wall_draft wall; /* defaults */
	struct room_camera_draft camera;
	struct room_monitor_draft monitor;
};

/* "n01..n18": a row of ids; "front" alone is a row of one. */
struct room_ids {
	char prefix[BB_ID_MAX];
	int width;            /* digits; 0: a single id */
	unsigned from, n;
};
BB_MUST_CHECK enum bb_status room_ids_parse(struct bb_reader *r, const struct bb_yaml_node *at, const char *text,
                                            struct room_ids *out);
/* The i-th id; i < n. */
void room_ids_at(const struct room_ids *ids, unsigned i, char out[BB_ID_MAX]);
/* 1103 unless it is a well-formed id. */
BB_MUST_CHECK enum bb_status room_check_id(struct bb_reader *r, const struct bb_yaml_node *at, const char *id);
/* Room for `add` more entries of an array that has n; 1101 past most, 1702. */
BB_MUST_CHECK enum bb_status room_grow(struct room_build *b, const struct bb_yaml_node *at, void *array_ptr, size_t size,
                                       size_t n, size_t add, size_t most, const char *what);
/* The device text parses as a URI; an empty one becomes the room's default. */
BB_MUST_CHECK enum bb_status room_check_device(struct room_build *b, const struct bb_yaml_node *map,
                                               char device[BB_DEVICE_BYTES]);
BB_MUST_CHECK enum bb_status room_find_node(struct room_build *b, const struct bb_yaml_node *at, const char *id,
                                            uint16_t *out);
BB_MUST_CHECK enum bb_status room_find_wall(struct room_build *b, const struct bb_yaml_node *at, const char *id,
                                            uint16_t *out);
/* A rate from a decimal that an option row has checked to be > 0. */
struct bb_rate room_rate(double hz);

/* Branches of the room file, in their order. */
enum bb_status room_read_wall_default(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_walls(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_camera_default(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_cameras(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_monitor_default(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_monitors(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_shutters(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_power(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_gamepads(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_bodies(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_link(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
enum bb_status room_read_framelock(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
void room_wall_defaults(struct room_wall_draft *d);
void room_camera_defaults(struct room_camera_draft *d);
void room_monitor_defaults(struct room_monitor_draft *d);

/* Does a lens not fold the picture's corners back? */
bool room_lens_unfolds(const struct bb_camera_config *c);
/* Checks that need the whole room. */
BB_MUST_CHECK enum bb_status room_check_stereo(struct room_build *b, const struct bb_yaml_node *root);
BB_MUST_CHECK enum bb_status room_check_outlets(struct room_build *b, const struct bb_yaml_node *root);

extern const struct bb_option room_wall_options[], room_grid_options[], room_display_options[], room_camera_options[],
	room_monitor_options[], room_chain_options[], room_emitter_options[], room_pdu_options[], room_outlet_options[], room_gamepad_options[], room_link_options[], room_framelock_options[], room_glasses_options[];

#endif
