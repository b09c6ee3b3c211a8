/* sync/calibrate/align.c: puts calibrated cameras where a floor square says the room is. */
#include <math.h>
#include <stdlib.h>

#include "sync/calibrate/calibrate_private.h"
#include "sync/calibrate/label.h"
#include "sync/track/rigid.h"
#include "sync/track/triangulate.h"

#define LEAST_PICTURES 3
#define WORST_MM 2.0
#define PICTURES_MOST 4096 /* of a camera: the square lies still */

/* Mean of the middle four fifths: a few wrong ones do no harm, and hardly any noise is given away. */
static double settled(double *values, size_t n)
{
	double sum = 0;
	size_t used = 0;

	(void)bb_median(values, n); /* sorts */
	for (size_t i = n / 10; i < n - n / 10; i++, used++)
		sum += values[i];
	return sum / (double)used;
}

/* Where a camera saw the square's markers, over all its pictures of it; false: hardly ever. */
static bool look(const struct bb_calibrate_config *config, const struct bb_lens *lens, size_t camera,
                 double *scratch, double out[4][2])
{
	const struct bb_sequence *s = config->sequence;
	size_t n = 0, asked = 0;

	for (size_t i = 0; i < s->n_sights && n < PICTURES_MOST; i++) {
		const struct bb_sequence_sight *sight = &s->sights[i];
		const float (*px)[2] = (const float(*)[2])(s->px + sight->first);
		int order[4];
		if (!sight->square || sight->camera != camera)
			continue;
		asked++;
		if (!bb_label_square(lens, s, px, sight->n, order))
			continue;
		for (size_t k = 0; k < 8; k++)
			scratch[k * PICTURES_MOST + n] = (double)px[order[k / 2]][k % 2];
		n++;
	}
	/* a marker on the picture's edge is in it when noise moves it inwards, and its mean is not where it is */
	const bool enough = n >= LEAST_PICTURES && n >= asked - asked / 10;
	for (size_t k = 0; k < 8 && enough; k++)
		out[k / 2][k % 2] = settled(scratch + k * PICTURES_MOST, n);
	return enough;
}

static bool find_markers(const struct bb_calibrate_config *config, struct bb_calibration *c, double *scratch,
                         struct bb_vec3 out[4])
{
	struct bb_sight sights[4][BB_SEQUENCE_CAMERAS_MAX];
	size_t n = 0;

	c->square_cameras = 0;
	for (size_t i = 0; i < c->n_cameras; i++) {
		struct bb_lens lens;
		double px[4][2];
		/* a camera that was knocked saw the square from where it is no longer */
		if (c->report[i].knocked || !bb_lens_init(&lens, &c->cameras[i]) || !look(config, &lens, i, scratch, px))
			continue;
		bool rays = true;
		for (int m = 0; m < 4; m++) {
			struct bb_ray ray;
			rays &= bb_lens_ray(&lens, px[m][0], px[m][1], &ray);
			sights[m][n] = (struct bb_sight){ lens.o, ray.d, ray.sigma_rad };
		}
		n += rays;
	}
	c->square_cameras = n;
	for (int m = 0; m < 4; m++) {
		struct bb_triangulated point;
		if (n < 2 || !bb_triangulate(sights[m], n, 0.05, &point))
			return false;
		out[m] = point.p;
	}
	return true;
}

enum bb_status bb_calibrate_align(const struct bb_calibrate_config *config, struct bb_calibration *c, struct bb_error *err)
{
	double *scratch = malloc(8 * PICTURES_MOST * sizeof(*scratch));
	struct bb_vec3 seen[4];
	struct bb_rigid fit;

	if (!scratch)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "aligning");
	const bool found = find_markers(config, c, scratch, seen);
	free(scratch);
	if (!found)
		return bb_fail(err, BB_ERR_CONFIG, 1735, NULL, "%zu cameras saw all four markers of the square, two or more must",
		               c->square_cameras);
	/* from where the cameras think the square is to where it is */
	if (!bb_rigid_fit(seen, config->sequence->square, 4, 1e-4, BB_QUAT_IDENTITY, &fit) || fit.collinear)
		return bb_fail(err, BB_ERR_CONFIG, 1735, NULL, "its markers lie on a line, as they were seen");
	c->square_rms_mm = fit.rms_m * 1e3;
	if (!(c->square_rms_mm < WORST_MM)) /* a wand of another length than it says shows here, too */
		return bb_fail(err, BB_ERR_CONFIG, 1735, NULL, "its markers, as seen, are %.1f mm rms from its measures",
		               c->square_rms_mm);
	for (size_t i = 0; i < c->n_cameras; i++)
		c->cameras[i].pose = bb_pose_mul(&fit.pose, &c->cameras[i].pose);
	for (size_t i = 0; i < c->bundle.n_rods; i++) {
		struct bb_rod *rod = &c->bundle.rods[i];
		rod->p = bb_pose_apply(&fit.pose, rod->p);
		rod->u = bb_quat_rotate(fit.pose.q, rod->u);
	}
	return BB_OK;
}
