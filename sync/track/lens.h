/*
 * sync/track/lens.h: one calibrated camera: room point to pixel with derivatives, pixel to ray.
 *
 * Camera space and distortion as in hal/camera.h. A distortion is trusted only up to the radius where it stops growing
 * in every direction: beyond, two rays share one pixel. Pure after bb_lens_init.
 */
#ifndef BB_SYNC_TRACK_LENS_H
#define BB_SYNC_TRACK_LENS_H

#include "hal/camera.h"

struct bb_lens {
	double r[3][3]; /* rows are the camera's axes: p_camera = r (p_room - o) */
	struct bb_vec3 o;
	double fx_px, fy_px, cx_px, cy_px, width_px, height_px;
	double row_s;         /* row to row of a rolling shutter */
	bool fisheye;
	double k[4], p1, p2;
	double radius_max;    /* of X / Z, Y / Z: trusted up to here */
	double distorted_max; /* what the radial part makes of it */
};

struct bb_ray {
	struct bb_vec3 d; /* unit, room; starts at the lens's o */
	double sigma_rad; /* of its direction for 1 px of blob noise, the worse of radial and tangential */
};

/* false when the configuration is not finite or makes no camera. */
bool bb_lens_init(struct bb_lens *lens, const struct bb_camera_config *config);
/* false when behind the camera or beyond the trusted radius; the pixel may lie outside the sensor. */
bool bb_lens_project(const struct bb_lens *lens, struct bb_vec3 room, double px[2]);
/* The same with d px / d room. */
bool bb_lens_derive(const struct bb_lens *lens, struct bb_vec3 room, double px[2], double jac[2][3]);
bool bb_lens_ray(const struct bb_lens *lens, double x_px, double y_px, struct bb_ray *ray);
/* When a row exposes, after the middle one. */
double bb_lens_row_s(const struct bb_lens *lens, double y_px);
/* Depth along the optical axis. */
double bb_lens_depth(const struct bb_lens *lens, struct bb_vec3 room);

#endif
