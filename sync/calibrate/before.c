/*
 * sync/calibrate/before.c: what a camera saw before it was knocked. It hung elsewhere, but through the same lens: until the
 * last adjustment is done it is one more camera, tied to the lens of the first. What it saw since may be little, and with it
 * alone focal length and distance are told apart badly.
 */
#include <stdlib.h>
#include <string.h>

#include "sync/calibrate/calibrate_private.h"

#define LEAST_SHARE 0.5 /* of what it saw before, near where one place puts it; else it was moved more than once */

static int by_rod_and_camera(const void *a, const void *b)
{
	const struct bb_bundle_obs *x = a, *y = b;

	if (x->rod != y->rod)
		return x->rod < y->rod ? -1 : 1;
	if (x->camera != y->camera)
		return x->camera < y->camera ? -1 : 1;
	return (x->marker > y->marker) - (x->marker < y->marker);
}

static void sort(struct bb_bundle *b)
{
	qsort(b->obs, b->n_obs, sizeof(*b->obs), by_rod_and_camera);
}

bool bb_calibrate_split(struct bb_calibration *c, uint16_t *lens_of)
{
	struct bb_bundle *b = &c->bundle;

	for (size_t i = 0; i < c->n_cameras; i++)
		lens_of[i] = (uint16_t)i;
	for (size_t i = 0; i < c->n_cameras; i++) {
		if (!c->report[i].knocked || b->n_cameras == c->n_cameras + BB_CALIBRATE_KNOCKS)
			continue;
		const size_t twin = b->n_cameras++;
		c->cameras[twin] = c->cameras[i];
		lens_of[twin] = (uint16_t)i;
		for (size_t k = 0; k < b->n_obs; k++)
			if (b->obs[k].camera == i && c->rod_ns[b->obs[k].rod] < c->report[i].knocked_ns) {
				b->obs[k].camera = (uint16_t)twin;
				b->obs[k].out = false;
			}
	}
	b->lens_of = lens_of;
	sort(b);
	return b->n_cameras > c->n_cameras;
}

void bb_calibrate_doubt(struct bb_calibration *c)
{
	struct bb_bundle *b = &c->bundle;

	for (size_t i = c->n_cameras; i < b->n_cameras; i++) {
		size_t n = 0, used = 0;
		for (size_t k = 0; k < b->n_obs; k++) {
			n += b->obs[k].camera == i;
			used += b->obs[k].camera == i && !b->obs[k].out;
		}
		for (size_t k = 0; k < b->n_obs; k++)
			b->obs[k].out |= b->obs[k].camera == i && (double)used < LEAST_SHARE * (double)n;
	}
}

void bb_calibrate_join(struct bb_calibration *c)
{
	struct bb_bundle *b = &c->bundle;

	for (size_t k = 0; k < b->n_obs; k++)
		if (b->obs[k].camera >= c->n_cameras) {
			b->obs[k].camera = b->lens_of[b->obs[k].camera];
			b->obs[k].out = true;
		}
	b->n_cameras = c->n_cameras;
	b->lens_of = NULL;
	sort(b);
}
