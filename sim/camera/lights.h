/*
 * sim/camera/lights.h: the spots of light a camera of the simulated world gets during one exposure: markers, what hides
 * them, how bright its strobe makes them, what a polished floor mirrors. A function of the world and the arguments.
 */
#ifndef BB_SIM_CAMERA_LIGHTS_H
#define BB_SIM_CAMERA_LIGHTS_H

#include "hal/camera.h"
#include "sim/camera/picture.h"

struct sim_lamp { /* of one camera, and the markers in its light */
	double marker_mm;   /* diameter of a marker */
	double marker_grey; /* level above black of a marker, were it wider than the blur, lamp_m away after lamp_ns of exposure */
	double lamp_m;      /* the lamp is set for the middle of the room, light falls with the distance squared */
	int64_t lamp_ns;    /* and for the camera's usual exposure */
	double mirror;      /* share of the light that the floor returns */
};

struct sim_eye {
	const struct sim_world *world;
	const struct bb_camera_config *config;
	const struct sim_lamp *lamp;
	struct bb_pose pose;      /* where the camera really looks */
	int64_t mid_ns, exposure_ns; /* of its middle row */
	double mirror;            /* more than the lamp's */
};
/* Where world marker i is, and when, in the middle of the exposure of the row that shows it, hidden or not. mirrored: its
 * image below the floor. False: it is behind, too near or far, or where the lens folds. */
bool sim_lights_place(const struct sim_eye *eye, size_t i, bool mirrored, struct bb_vec3 *p, double px[2], int64_t *at_ns);
/* Up to cap lights, ghosts after the markers; *n_out <= cap. False: there were more. */
bool sim_lights_see(const struct sim_eye *eye, struct sim_light *out, size_t cap, size_t *n_out);

#endif
