/*
 * tests/bench/cast_scene.h: the work on which ray casters are measured: 256^3 values of three growing shells with a bright
 * side each and some smooth noise, one camera, a transfer function that shows everything a little ("filled") and one that
 * shows a fiftieth of the voxels ("sparse"). cast_vtk.py draws the same.
 */
#ifndef BB_TESTS_BENCH_CAST_SCENE_H
#define BB_TESTS_BENCH_CAST_SCENE_H

#include <sys/mman.h>

#include "tests/cover.h"

#include "render/renderer.h"

#define SCENE_EDGE 256
#define SCENE_IMAGE 512
#define SCENE_STEP 0.5
#define SCENE_METRES (1.0 / SCENE_EDGE) /* a voxel */

static inline float scene_hash(int x, int y, int z)
{
	uint32_t h = (uint32_t)x * 374761393U + (uint32_t)y * 668265263U + (uint32_t)z * 2147483647U;

	h = (h ^ (h >> 13)) * 1274126177U;
	return (float)((h ^ (h >> 16)) & 0xFFFFFF) / 16777216.0F;
}

static inline float scene_noise(float x, float y, float z)
{
	const int i = (int)floorf(x), j = (int)floorf(y), k = (int)floorf(z);
	const float f[3] = { x - (float)i, y - (float)j, z - (float)k };
	float w[3], sum = 0;

	for (int a = 0; a < 3; a++)
		w[a] = f[a] * f[a] * (3 - 2 * f[a]);
	for (int c = 0; c < 8; c++)
		sum += scene_hash(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2)) * (c & 1 ? w[0] : 1 - w[0]) *
		       (c & 2 ? w[1] : 1 - w[1]) * (c & 4 ? w[2] : 1 - w[2]);
	return sum;
}

static inline float scene_value(int x, int y, int z)
{
	const float at[3] = { ((float)x - 127.5F) / 128, ((float)y - 127.5F) / 128, ((float)z - 127.5F) / 128 };
	const float r = sqrtf(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]) + 1e-6F;
	const float side[3] = { at[0] / r, at[1] / r, (at[2] * 0.6F + at[0] * 0.8F) / r };
	float sum = 0;

	for (int k = 0; k < 3; k++) {
		const float away = r - 0.25F - 0.25F * (float)k, width = 0.02F + 0.01F * (float)k;
		sum += expf(-away * away / (width * width) * 0.5F) * (0.3F + 0.7F * fmaxf(0, side[k]));
	}
	return fminf(1, 0.75F * sum + 0.25F * scene_noise((float)x * 0.06F, (float)y * 0.06F, (float)z * 0.06F));
}

static inline struct bb_volume *scene_volume(void)
{
	struct bb_volume *v = calloc(1, sizeof(*v));
	float *to = malloc(sizeof(*to) * SCENE_EDGE * SCENE_EDGE * SCENE_EDGE);

	if (!v || !to)
		abort();
	*v = (struct bb_volume){ .name = "shells", .dim = { SCENE_EDGE, SCENE_EDGE, SCENE_EDGE }, .n_steps = 1,
				 .spacing_mm = { 1, 1, 1 }, .most = 1, .values = to };
	for (int z = 0; z < SCENE_EDGE; z++)
		for (int y = 0; y < SCENE_EDGE; y++)
			for (int x = 0; x < SCENE_EDGE; x++)
				*to++ = scene_value(x, y, z);
	return v;
}

static inline struct bb_transfer scene_transfer(bool sparse)
{
	struct bb_transfer tf = { .n = 257 };

	for (int i = 0; i < 257; i++) {
		const double s = i / 256.0, density = !sparse ? 0.012 * s : s > 0.55 ? (s - 0.55) * 0.2 : 0;
		tf.point[i] = (struct bb_transfer_point){ s, s, 0.4 + 0.4 * s, 1 - s, 1 - exp(-density) };
	}
	tf.least_visible = sparse ? 140 / 256.0 : 0;
	return tf;
}

/* From 700 voxels away along (1, 0.6, 0.4), 30 degrees wide, z upwards. */
static inline struct bb_view scene_view(void)
{
	const struct bb_vec3 none = { 0, 0, 0 };
	const struct bb_vec3 away = bb_vec3_unit((struct bb_vec3){ 1, 0.6, 0.4 }, none);
	const struct bb_vec3 right = bb_vec3_unit(bb_vec3_cross((struct bb_vec3){ 0, 0, 1 }, away), none);
	const struct bb_vec3 up = bb_vec3_cross(away, right), eye = bb_vec3_scale(away, 700 * SCENE_METRES);
	const double half = 700 * SCENE_METRES * tan(15 * 3.14159265358979323846 / 180);
	const struct bb_vec3 left = bb_vec3_scale(right, -half), top = bb_vec3_scale(up, half);
	const struct bb_corners screen = { bb_vec3_sub(left, top), bb_vec3_scale(bb_vec3_add(left, top), -1),
					   bb_vec3_add(left, top) };
	struct bb_corners c = screen;

	c.lower_right = bb_vec3_sub(bb_vec3_scale(left, -1), top);
	return bb_view_make(&c, eye, eye, 0.01, 100);
}

/* Bricks in pages of 2 MiB or of 4 KiB, as a cover's atlas wants them. */
static inline void scene_pages(struct cover *c, bool huge)
{
	const size_t page = 2U << 20, bytes = c->atlas.n_slots * c->atlas.slot_bytes + bb_atlas_slack_bytes(&c->atlas);
	uint8_t *all = mmap(NULL, bytes + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);

	if (all == MAP_FAILED)
		abort();
	all += page - (uintptr_t)all % page;
	(void)madvise(all, bytes, huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
	memcpy(all, c->atlas.bricks, bytes);
	c->atlas.bricks = all; /* until the program ends */
}

#endif
