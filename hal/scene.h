/*
 * hal/scene.h: a scene as the file describes it: what is shown and for how long, which devices at which fidelity.
 * Relative paths are taken from the directory the program was started in and must not climb out of it ("..", absolute
 * paths are error 1204) unless the caller allows it.
 */
#ifndef BB_HAL_SCENE_H
#define BB_HAL_SCENE_H

#include "hal/metric.h"
#include "hal/geometry.h"

#define BB_PICTURES_MAX 32
#define BB_NOT_NEEDED (-1)

enum bb_technique { BB_TECHNIQUE_VOLUME, BB_TECHNIQUE_CALIBRATION };
enum bb_follows { BB_FOLLOWS_CLOCK, BB_FOLLOWS_CAMERAS };
enum bb_steer { BB_STEER_PAD, BB_STEER_HEAD };
enum bb_loop { BB_LOOP_REPEAT, BB_LOOP_PING_PONG, BB_LOOP_HOLD };

struct bb_scene {
	char path[BB_PATH_MAX_BYTES];
	char name[64];
	uint8_t sha256[32];
	enum bb_technique technique;
	struct { /* technique volume */
		char file[BB_PATH_MAX_BYTES]; /* "" with generate set */
		char generate[BB_ID_MAX];     /* "cme", "enlil", "delta", "wing", "shock" */
		int64_t edge_voxels, steps;   /* of a generated one */
		uint32_t dim[3];              /* of a generated one that is no cube; else 0 */
		double seconds_per_step;
		enum bb_loop loop;
		double width_m;               /* longest edge of the volume in the room */
		struct bb_vec3 centre_m;      /* of the volume in the room */
		double yaw_deg, pitch_deg, roll_deg;
		double step_voxels;           /* sampling distance along a ray */
		int64_t brick_voxels;         /* what is no brick file yet becomes one of such bricks */
		int values;                   /* enum bb_brick_type of them */
		int gain;                     /* enum bb_gain_method: what a finer brick is worth */
		bool occlusion;               /* what is hidden is worth less */
		bool predict;                 /* bricks are read for the steps ahead */
	} data;
	char transfer_function[BB_PATH_MAX_BYTES];
	char head_path[BB_PATH_MAX_BYTES];
	char wand_path[BB_PATH_MAX_BYTES];
	int steer_by;                         /* enum bb_steer: where a pad's "ahead" is */
	double duration_s;
	int needs[BB_CLASS_COUNT];            /* fidelity, or BB_NOT_NEEDED */
	double memory_mib;                    /* of brick memory per node; 0: no limit */
	int64_t stream_bricks_per_frame;      /* per node; 0: no limit */
	size_t n_budgets;
	struct bb_budget budgets[BB_BUDGETS_MAX];
	struct {
		size_t n_at;
		double at_s[BB_PICTURES_MAX];
		bool all_walls;
		char wall[BB_ID_MAX];             /* when not all */
		int eyes;                         /* bit 0 left, bit 1 right */
		double scale;                     /* of the screen's pixels */
		bool levels;                      /* one more a wall, in the colours of its bricks' levels */
	} pictures;
	struct { /* technique calibration: a square in the middle of every wall that takes turns between two greys */
		double hz;                        /* both of them so often a second; 0: no patch */
		double size_m;                    /* its edge; 0: the whole wall */
		double low_percent, high_percent; /* of white, in linear light */
		int follows;                      /* enum bb_follows: whose time it goes by */
	} patch;
};

BB_MUST_CHECK enum bb_status bb_scene_load(const char *path, struct bb_scene **out, struct bb_error *err);
void bb_scene_free(struct bb_scene *scene);

/*
 * A head or wand path: key poses "t_s x_m y_m z_m yaw_deg pitch_deg roll_deg" a line, sway lines
 * "sway axis amplitude hz" (axis x y z in mm; yaw pitch roll in degrees), "#" comments. Positions and the three angles
 * run on monotone cubics (Fritsch and Carlson): no overshoot, and speed and turning rate are continuous, which slerp
 * between keys would not give. Yaw takes the short way between neighbours. Pure.
 */
struct bb_path;
BB_MUST_CHECK enum bb_status bb_path_load(const char *file, struct bb_path **out, struct bb_error *err);
void bb_path_free(struct bb_path *path);
/* Every row of the tables a scene file is read through; NULL past the end. */
struct bb_option;
struct bb_scene_section {
	const char *name;
	const struct bb_option *options;
};
const struct bb_scene_section *bb_scene_section(size_t i);
/* Pose of the eyes' midpoint at t (ns from scene start); before the first and after the last key: held. */
struct bb_pose bb_path_at(const struct bb_path *path, int64_t t_ns);
int64_t bb_path_duration_ns(const struct bb_path *path);

#endif
