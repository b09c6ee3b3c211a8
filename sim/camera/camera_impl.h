/* sim/camera/camera_impl.h: the inside of a simulated camera, for sim/sim_camera.c and sim/camera/ only. */
#ifndef BB_SIM_CAMERA_IMPL_H
#define BB_SIM_CAMERA_IMPL_H

#include "hal/camera_driver.h"
#include "hal/dev_time.h"
#include "sim/camera/lights.h"
#include "sim/sim_camera.h"

struct sim_camera_queued {
	uint32_t seq;
	int64_t mid_dev_ns, arrived_ns;
	bool overflow, stalled;
	size_t n;
	struct bb_blob blob[SIM_CAMERA_BLOBS];
	struct sim_rng noise; /* fidelity 2: what the picture is drawn from when somebody wants it */
	size_t n_lights;
	double sun;
	struct sim_light light[SIM_CAMERA_BLOBS];
};

struct sim_camera {
	struct bb_camera base;
	struct sim_world *world;
	struct bb_timer timer;
	struct sim_rng rng;
	struct sim_sensor sensor;
	struct sim_lamp lamp;
	struct sim_picture *picture; /* fidelity 2 */
	bool ideal, running;
	int64_t exposure_ns, offset_ns, readout_ns, transfer_ns, jitter_ns;
	int64_t start_ns;        /* of the exposure under way */
	uint32_t seq;
	int64_t own_phase_ns, own_ppb; /* of exposures without sync */
	int64_t dev_zero_ns, dev_ppb;  /* device counter: ticks at host time t */
	uint32_t dev_start;
	struct bb_unwrap32 unwrap;
	int64_t last_arrived_ns;
	struct bb_vec3 bump_axis;
	/* Sums over faults. */
	int64_t lost, covered, freerun, frozen, stalled, drop_ppm, noise_npx, bump_ndeg, flood, sun_mgrey, mirror_ppm;
	unsigned stalls;         /* in a row */
	struct sim_camera_queued still; /* the picture that stands still */
	struct sim_camera_queued *queue;
	uint32_t head, n_queued;
	uint64_t dropped;
};

/* What is seen at a moment: blobs, drawn from r, and at fidelity 2 the lights of the picture. q is empty but for seq. */
void sim_camera_look(struct sim_camera *c, int64_t mid_ns, struct sim_rng *r, struct sim_camera_queued *q);

#endif
