/*
 * sim/sim_camera.h: tracking cameras as the world sees them. For bench/ and tests/ only.
 *
 * Model. Exposure k begins at instant k of the camera's rate on the room's sync reference plus sync_offset_us, or on
 * its own clock (seeded phase, +-50 ppm). Markers stand where they are at mid-exposure (of their row), go through the lens
 * (hal/camera.h), get normal noise, and are reported sorted by y, then x; spots that overlap are one blob. A frame
 * arrives exposure/2 + read-out + transfer + jitter (uniform, never early, never overtaking) after mid-exposure. The
 * stamp is the camera's own 32-bit microsecond counter (seeded start, +-30 ppm), unwrapped. Fidelity 0: no noise, no
 * jitter, no occlusion, no merging, and the device clock is the host's in ns. Fidelity 2: a picture of the same moment
 * (sim/camera/picture.h) for whoever has room for one; who has not gets the blobs, with the noise such pictures leave.
 */
#ifndef BB_SIM_CAMERA_H
#define BB_SIM_CAMERA_H

#include "hal/camera.h"

#define SIM_CAMERA_BLOBS 64       /* most_blobs */
#define SIM_MARKER_DIAMETER_M 0.012
#define SIM_CAMERA_NEAR_M 0.1
#define SIM_CAMERA_FAR_M 6.0

/* Where the lens puts a point of camera space, on the sensor or beside it; false when it is behind, or so far off the axis
 * that the lens model folds back. Pure. */
bool sim_camera_pixel(const struct bb_camera_config *config, struct bb_vec3 in_camera, double px[2]);
/* Projects a point given in camera space; false when it is behind, too near or far, outside the image, or so far off
 * the axis that the lens model folds back. Pure. */
bool sim_camera_project(const struct bb_camera_config *config, struct bb_vec3 in_camera, struct bb_blob *out);
/* Frames that nobody read in time. */
uint64_t sim_camera_dropped(const struct bb_camera *cam);
/* Where the device's counter stands for a host time: truth for tests of time maps. */
struct bb_dev_ns sim_camera_stamp(const struct bb_camera *cam, int64_t host_ns);

#endif
