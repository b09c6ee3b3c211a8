/*
 * hal/device.h: what every device handle begins with, what every open() is given, and the health a device is in.
 *
 * A handle is opaque above hal/: users hold `struct bb_camera *` and call bb_camera_*(). A back end embeds the class's
 * struct first and finds its own with bb_container_of. A handle belongs to the thread that opened it. close() accepts
 * NULL everywhere.
 */
#ifndef BB_HAL_DEVICE_H
#define BB_HAL_DEVICE_H

#include "hal/clock.h"
#include "hal/eventlog.h"
#include "hal/log.h"
#include "hal/uri.h"

/* States of the fault matrix: INIT -> OK -> DEGRADED -> HOLDOVER -> LOST -> RECOVERING -> OK. */
#define BB_HEALTH_LIST(X)                                                                                            \
	X(BB_HEALTH_INIT, "INIT")                                                                                    \
	X(BB_HEALTH_OK, "OK")                                                                                        \
	X(BB_HEALTH_DEGRADED, "DEGRADED")                                                                            \
	X(BB_HEALTH_HOLDOVER, "HOLDOVER")                                                                            \
	X(BB_HEALTH_LOST, "LOST")                                                                                    \
	X(BB_HEALTH_RECOVERING, "RECOVERING")                                                                        \
	X(BB_HEALTH_QUARANTINED, "QUARANTINED")

enum bb_health {
#define X(name, text) name,
	BB_HEALTH_LIST(X)
#undef X
};
const char *bb_health_text(enum bb_health health);

struct bb_last_error {
	enum bb_status status;
	int os_errno;
	char op[24];
	char detail[96];
};

struct bb_device {
	const char *class_name; /* "camera": static */
	char id[BB_ID_MAX];
	struct bb_clock *clk;
	struct bb_eventlog *events; /* may be NULL */
	const struct bb_log *log;   /* may be NULL */
	uint16_t event_source;
	struct bb_last_error last_error;
	uint64_t failures;          /* so many were recorded there */
	uint64_t ops;               /* calls through the class's wrapper: part of a device's counted cost */
};

/* Everything an open() needs besides the device's own configuration. Pointers stay valid until close(). */
struct bb_open {
	struct bb_clock *clk;
	struct bb_eventlog *events;
	const struct bb_log *log;
	const struct bb_uri *uri;
	uint64_t seed;   /* of the run; a sim derives its own from it with class and id */
	int fidelity;    /* 0, 1 or 2; real back ends ignore it */
	void *world;     /* struct sim_world for sims, NULL for real back ends */
};

/* Fills *dev from *open; called by each class's bb_<class>_open before the back end sees it. */
void bb_device_init(struct bb_device *dev, const char *class_name, const char *id, const struct bb_open *open);
/* Records why an operation failed and returns status. */
BB_PRINTF(4, 5)
enum bb_status bb_device_fail(struct bb_device *dev, enum bb_status status, const char *op, const char *fmt, ...);
/* An event of this device. */
void bb_device_event(struct bb_device *dev, enum bb_event_kind kind, int64_t at_ns, int64_t a, int64_t b);

/*
 * The pattern of every class, here for camera:
 *   hal/camera.h         configuration, limits, data, calls for users
 *   hal/camera_driver.h  struct bb_camera (first member struct bb_device dev), const struct bb_camera_ops with every
 *                        op mandatory, struct bb_camera_driver { scheme, handle size, ops }
 *   hal/camera.c         bb_camera_open(driver, config, open, &out): allocates handle_bytes zeroed, fills dev, config
 *                        and ops, calls ops->open; frees on failure. Every wrapper checks arguments once, sets outputs
 *                        to nothing first, counts dev.ops.
 * Reading never blocks: BB_TIMEOUT is "nothing yet", and the caller lets the clock run.
 */

#endif
