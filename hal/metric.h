/*
 * hal/metric.h: the closed list of what a budget may limit: name, unit, the statistic asked for by default, the device
 * class it depends on with the fidelity it needs, and what it means. A key in a room or scene file is
 * <statistic>_<unit>: `head_to_photon: {p99_ms: 50, marginal_ms: 45}`.
 */
#ifndef BB_HAL_METRIC_H
#define BB_HAL_METRIC_H

#include "hal/status.h"

enum bb_class { /* device classes as a scene's `needs` lists them */
	BB_CLASS_SHUTTERS, BB_CLASS_CAMERAS, BB_CLASS_DISPLAYS, BB_CLASS_MONITORS, BB_CLASS_POWER, BB_CLASS_GAMEPADS,
	BB_CLASS_COUNT, BB_CLASS_NONE = BB_CLASS_COUNT
};
const char *bb_class_text(enum bb_class c); /* "shutters" ... */

/* Metrics of unit "count" are sums: every sample counts what happened since the one before.
 * name, unit the samples are kept in, class needed, fidelity needed, meaning */
#define BB_METRIC_LIST(X)                                                                                            \
	X(BB_METRIC_HEAD_TO_PHOTON, "head_to_photon", "ms", BB_CLASS_CAMERAS, 0,                                      \
	  "mid-exposure of the newest camera frame used, to the photon of the middle row through an open shutter")     \
	X(BB_METRIC_FRAME, "frame", "ms", BB_CLASS_NONE, 0, "begin of a node's frame to its image ready")             \
	X(BB_METRIC_SWAP_SKEW, "swap_skew", "us", BB_CLASS_DISPLAYS, 0,                                               \
	  "spread over the nodes of the instant they were released to swap")                                           \
	X(BB_METRIC_SCANOUT_SKEW, "scanout_skew", "us", BB_CLASS_DISPLAYS, 1,                                         \
	  "spread over the displays of the vblank one frame became visible at")                                        \
	X(BB_METRIC_TORN_FRAMES, "torn_frames", "count", BB_CLASS_DISPLAYS, 0,                                        \
	  "frames that some display showed a whole refresh after another, or never")                                   \
	X(BB_METRIC_LATE_FRAMES, "late_frames", "count", BB_CLASS_NONE, 0,                                            \
	  "frames released after the vblank they were meant for")                                              \
	X(BB_METRIC_PHASE, "phase", "us", BB_CLASS_SHUTTERS, 0,                                                       \
	  "switching instant of a wall's shutter less that of the glasses, worst stage")                               \
	X(BB_METRIC_EYE_SWAPS, "eye_swaps", "count", BB_CLASS_SHUTTERS, 0,                                            \
	  "frames in which an eye saw the other eye's image")                                                          \
	X(BB_METRIC_CROSSTALK, "crosstalk", "percent", BB_CLASS_SHUTTERS, 2, "leakage over signal, black removed")    \
	X(BB_METRIC_POSE_ERROR, "pose_error", "mm", BB_CLASS_CAMERAS, 1,                                              \
	  "unpredicted marker centroid against the world's truth at mid-exposure (sims only)")                         \
	X(BB_METRIC_POSE_ANGLE, "pose_angle", "deg", BB_CLASS_CAMERAS, 1,                                             \
	  "unpredicted orientation against the world's truth at mid-exposure (sims only)")                             \
	X(BB_METRIC_PHOTON_ERROR, "photon_error", "mm", BB_CLASS_CAMERAS, 1,                                          \
	  "predicted eye position against the world's truth at photon time (sims only)")                               \
	X(BB_METRIC_TRACKED, "tracked", "percent", BB_CLASS_CAMERAS, 0, "frames drawn with a fresh pose; a lower limit") \
	X(BB_METRIC_STREAM, "stream", "bytes", BB_CLASS_NONE, 0, "bytes streamed by a node in a frame")               \
	X(BB_METRIC_PSNR, "psnr", "db", BB_CLASS_NONE, 0, "pictures against full resolution; a lower limit")          \
	X(BB_METRIC_WAKE_LATE, "wake_late", "us", BB_CLASS_NONE, 0,                                                   \
	  "how late a process woke, once a frame, when it had nothing else to do (several processes)")                             \
	X(BB_METRIC_PAD_BATTERY, "pad_battery", "percent", BB_CLASS_GAMEPADS, 0,                                      \
	  "charge of the emptiest gamepad that tells it; a lower limit")                                               \
	X(BB_METRIC_PAD_STUCK, "pad_stuck", "s", BB_CLASS_GAMEPADS, 0,                                                \
	  "how long some axis of a gamepad has stood still off neutral")                                               \
	X(BB_METRIC_FLASHES, "flashes", "per_s", BB_CLASS_DISPLAYS, 0,                                                \
	  "flashes in the worst second, of any wall and eye, by WCAG 2.3.1 and BT.1702")                               \
	X(BB_METRIC_DEVICES, "devices_ok", "s", BB_CLASS_NONE, 0,                                                     \
	  "longest time any needed device was not OK; LOST at the end fails at once")

enum bb_metric {
#define X(id, name, unit, class, fidelity, help) id,
	BB_METRIC_LIST(X)
#undef X
	BB_METRIC_COUNT
};

enum bb_stat { BB_STAT_P50, BB_STAT_P99, BB_STAT_MAX, BB_STAT_MAX_ABS, BB_STAT_MEAN, BB_STAT_MIN, BB_STAT_RMS, BB_STAT_COUNT_ };

struct bb_metric_info {
	const char *name, *unit;
	enum bb_class needs;
	int fidelity;
	const char *help;
	bool lower_limit; /* tracked, psnr, pad_battery: smaller is worse */
};
const struct bb_metric_info *bb_metric_info(enum bb_metric metric);
bool bb_metric_find(const char *name, enum bb_metric *out);
const char *bb_stat_text(enum bb_stat stat); /* "p99", "max_abs" ... */

struct bb_budget {
	enum bb_metric metric;
	enum bb_stat stat;
	double limit;        /* in the metric's unit */
	double marginal;     /* beyond it the verdict is MARGINAL; NAN: no band */
	char owner[BB_ID_MAX];
	struct bb_where where; /* file is a pointer into the room's or scene's own path */
};
#define BB_BUDGETS_MAX 32

#endif
