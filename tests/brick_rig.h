/*
 * tests/brick_rig.h: small data sets as files, and what a brick file of them must hold, computed the slow way in double
 * precision: every level's voxels of every time node.
 */
#ifndef BB_TESTS_BRICK_RIG_H
#define BB_TESTS_BRICK_RIG_H

#include "render/bricks/bricks.h"
#include "render/bricks/build.h"
#include "render/bricks/values.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

struct brick_rig {
	char dir[64], header[128], result[128];
	uint32_t dim[3], n_steps;
	float *voxels; /* [step][z][y][x] */
	struct bb_steps *steps;
	struct bb_build_config config;
	struct bb_build_report report;
};

static inline uint32_t rig_random(uint64_t *state)
{
	*state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (uint32_t)(*state >> 33);
}

static inline size_t rig_voxels(const struct brick_rig *r)
{
	return (size_t)r->dim[0] * r->dim[1] * r->dim[2];
}

/* Smooth in space and time with noise on it, so that no average is trivial. */
static inline float rig_value(uint64_t *state, uint32_t x, uint32_t y, uint32_t z, uint32_t step)
{
	return sinf(0.3f * (float)x + 0.2f * (float)y) * cosf(0.25f * (float)z + 0.4f * (float)step) +
	       0.1f * (float)(rig_random(state) % 1000) / 1000;
}

static inline void rig_write(const struct brick_rig *r)
{
	char path[160];
	FILE *f;

	snprintf(path, sizeof(path), "%s/data.raw", r->dir);
	f = fopen(path, "w");
	assert_non_null(f);
	assert_int_equal(fwrite(r->voxels, sizeof(float), rig_voxels(r) * r->n_steps, f), rig_voxels(r) * r->n_steps);
	fclose(f);
	f = fopen(r->header, "w");
	assert_non_null(f);
	fprintf(f, "file: data.raw\ndims: %u %u %u\ntype: f32\nsteps: %u\nspacing_mm: 1 2 3\n", r->dim[0], r->dim[1],
		r->dim[2], r->n_steps);
	fclose(f);
}

static inline void rig_begin(struct brick_rig *r, uint32_t nx, uint32_t ny, uint32_t nz, uint32_t n_steps,
			     uint32_t edge)
{
	uint64_t state = nx + 31 * ny + 977 * nz + 7919 * n_steps + edge;
	size_t i = 0;

	*r = (struct brick_rig){ .dim = { nx, ny, nz }, .n_steps = n_steps };
	snprintf(r->dir, sizeof(r->dir), "/tmp/bb-bricks-XXXXXX");
	assert_non_null(mkdtemp(r->dir));
	snprintf(r->header, sizeof(r->header), "%s/data.hdr.txt", r->dir);
	snprintf(r->result, sizeof(r->result), "%s/out.bricks", r->dir);
	r->voxels = malloc(rig_voxels(r) * n_steps * sizeof(float));
	assert_non_null(r->voxels);
	for (uint32_t s = 0; s < n_steps; s++)
		for (uint32_t z = 0; z < nz; z++)
			for (uint32_t y = 0; y < ny; y++)
				for (uint32_t x = 0; x < nx; x++)
					r->voxels[i++] = rig_value(&state, x, y, z, s);
	rig_write(r);
	const char *const paths[] = { r->header };
	struct bb_error err = { 0 };
	if (bb_steps_open(paths, 1, r->dir, &r->steps, &err) != BB_OK)
		fail_msg("%s", err.text);
	r->config = (struct bb_build_config){ .steps = r->steps,
					      .path = r->result,
					      .edge = edge,
					      .pad = 1,
					      .type = BB_BRICK_F32,
					      .memory_bytes = 64u << 20,
					      .threads = 2 };
}

static inline struct bb_bricks *rig_build(struct brick_rig *r)
{
	struct bb_bricks *b = NULL;
	struct bb_error err = { 0 };

	if (bb_bricks_build(&r->config, &r->report, &err) != BB_OK || bb_bricks_open(r->result, &b, &err) != BB_OK)
		fail_msg("%u x %u x %u, %u steps, edge %u: %s", r->dim[0], r->dim[1], r->dim[2], r->n_steps,
			 r->config.edge, err.text);
	return b;
}

static inline void rig_end(struct brick_rig *r)
{
	char command[100];

	bb_steps_close(r->steps);
	free(r->voxels);
	snprintf(command, sizeof(command), "rm -rf %s", r->dir);
	assert_int_equal(system(command), 0);
}

/* Voxel of a level and time node: the mean of all voxels of the data that it stands for, as the halvings weigh them. */
static inline double rig_truth(const struct brick_rig *r, const struct bb_tree *t, uint32_t level,
			       const struct bb_tree_span *s, uint32_t x, uint32_t y, uint32_t z)
{
	double sum = 0;
	int n = 0;

	if (level + 1 == t->n_levels) {
		for (uint32_t step = s->from; step < s->to; step++)
			sum += (double)r->voxels[((size_t)step * r->dim[2] + z) * r->dim[1] * r->dim[0] +
						 (size_t)y * r->dim[0] + x];
		return sum / (s->to - s->from);
	}
	const uint32_t *fine = t->voxels[level + 1];
	for (uint32_t i = 0; i < 8; i++) {
		const uint32_t cx = 2 * x + (i & 1), cy = 2 * y + (i >> 1 & 1), cz = 2 * z + (i >> 2);
		if (cx >= fine[0] || cy >= fine[1] || cz >= fine[2])
			continue;
		sum += rig_truth(r, t, level + 1, s, cx, cy, cz);
		n++;
	}
	return sum / n;
}

static inline uint32_t rig_clamp(int64_t i, uint32_t n)
{
	return i < 0 ? 0 : i >= n ? n - 1 : (uint32_t)i;
}

/* One voxel of a brick as it should be, its padding and what lies outside the volume included. */
static inline double rig_expected(const struct brick_rig *r, const struct bb_tree *t, const struct bb_tree_place *p,
				  const struct bb_tree_span *s, uint32_t pad, uint32_t i, uint32_t j, uint32_t k)
{
	const uint32_t *v = t->voxels[p->level];
	const int64_t at[3] = { (int64_t)p->at[0] * t->edge + i - pad, (int64_t)p->at[1] * t->edge + j - pad,
				(int64_t)p->at[2] * t->edge + k - pad };

	return rig_truth(r, t, p->level, s, rig_clamp(at[0], v[0]), rig_clamp(at[1], v[1]), rig_clamp(at[2], v[2]));
}

#endif
