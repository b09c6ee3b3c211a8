/*
 * hal/profile.h: what drawing costs on a kind of node, for runs on the virtual clock: coefficients over counters that
 * need no pixels. A YAML file whose hash is an input of the run. Costs in ns, on an idle machine of that kind.
 */
#ifndef BB_HAL_PROFILE_H
#define BB_HAL_PROFILE_H

#include "hal/status.h"

struct bb_profile {
	char name[BB_ID_MAX];
	uint8_t sha256[32];          /* of the file's bytes */
	double frame_base_ns;        /* once a frame */
	double per_view_ns;          /* per screen and eye */
	double per_ray_ns;           /* per ray that meets the volume's box */
	double per_sample_ns;        /* per sample along a ray */
	double per_brick_ns;         /* per brick uploaded */
	double per_byte_ns;          /* per byte uploaded */
	double track_ns;             /* blobs of one frame to a pose */
	double disk_read_ns;         /* per brick read from the disk */
	double disk_byte_ns;         /* per byte of it */
	double select_per_brick_ns;  /* per brick looked at by the selection */
};

BB_MUST_CHECK enum bb_status bb_profile_load(const char *path, struct bb_profile *out, struct bb_error *err);
/* profiles/<name>.yaml in the folder of the room file. */
BB_MUST_CHECK enum bb_status bb_profile_load_for(const char *room_path, const char *name, struct bb_profile *out,
                                                 struct bb_error *err);
/* Cost of one node's frame, ns, rounded to the nearest; never negative, saturates. */
int64_t bb_profile_draw_ns(const struct bb_profile *p, uint64_t n_views, uint64_t rays, uint64_t samples,
                           uint64_t bricks_loaded, uint64_t bytes_loaded);

#endif
