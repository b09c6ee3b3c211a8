/*
 * sim/camera/picture.h: what an infrared camera's sensor makes of spots of light: an 8-bit picture.
 *
 * A spot is an evenly bright disc, blurred by a Gaussian lens, moved along its way during the exposure and integrated
 * over square pixels. A patch of sun is a Gaussian of light. A pixel of level L above black has collected
 * L full_well_e / (255 - black) electrons and their shot noise, gets normal read noise, is rounded and clipped to
 * 0..255. A function of its arguments: the same bytes for the same generator on one build. Pixel (0,0) is the centre of
 * the upper left one. For sim/, bench/ and tests/.
 */
#ifndef BB_SIM_CAMERA_PICTURE_H
#define BB_SIM_CAMERA_PICTURE_H

#include "sim/world.h"

struct sim_sensor {
	double psf_px;        /* sd of the lens's blur, > 0 */
	double read_noise;    /* sd, grey levels */
	double full_well_e;   /* electrons at level 255 */
	double black;         /* level of a dark pixel */
	double sun_grey;      /* level above black in the middle of the patch, when nothing covers the lens */
	double sun_x, sun_y;  /* its middle, share of width and height */
	double sun_px;        /* its sd */
};

struct sim_light {
	double x0_px, y0_px, x1_px, y1_px; /* the centre's way from begin to end of the exposure */
	double radius_px;     /* of the disc */
	double grey;          /* level above black of a disc that is wider than the blur */
	uint32_t hidden;      /* bit per point of sim_disc_point: something is before it */
	bool ghost;           /* a mirror image: not looked at here */
};
/* Points spread evenly over the unit disc, 0 <= i < SIM_DISC_POINTS. */
#define SIM_DISC_POINTS 24
void sim_disc_point(unsigned i, double *x, double *y);

struct sim_picture; /* scratch for one size */
BB_MUST_CHECK enum bb_status sim_picture_create(const struct sim_sensor *sensor, int64_t width_px, int64_t height_px,
                                                struct sim_picture **out);
void sim_picture_destroy(struct sim_picture *p);
/* A whole picture of width_px * height_px bytes without gaps. sun: level of the patch at this moment. */
void sim_picture_draw(struct sim_picture *p, const struct sim_light *lights, size_t n, double sun, struct sim_rng *rng,
                      uint8_t *grey);

#endif
