/*
 * tests/test_bricks_shapes.c: what goes into a brick file comes out again, whatever its shape: every voxel and every
 * padding voxel of 200 random ones against a slow double-precision pyramid, and the seam of an angle brick by brick.
 */
#include "tests/brick_rig.h"

#define TURN 6.283185307179586

/* ---- the slow way ---- */

struct pyramid { /* every level's voxels of every time node */
	const struct bb_tree *t;
	double **level; /* [level * n_times + tau] */
};

static size_t level_voxels(const struct bb_tree *t, uint32_t level)
{
	return (size_t)t->voxels[level][0] * t->voxels[level][1] * t->voxels[level][2];
}

static double mean_of_children(const struct bb_tree *t, const double *fine, uint32_t level, uint32_t x, uint32_t y,
			       uint32_t z)
{
	const uint32_t *v = t->voxels[level + 1];
	double sum = 0;
	int n = 0;

	for (uint32_t i = 0; i < 8; i++) {
		const uint32_t cx = 2 * x + (i & 1), cy = 2 * y + (i >> 1 & 1), cz = 2 * z + (i >> 2);
		if (cx >= v[0] || cy >= v[1] || cz >= v[2])
			continue;
		sum += fine[((size_t)cz * v[1] + cy) * v[0] + cx];
		n++;
	}
	return sum / n;
}

static struct pyramid pyramid_of(const struct brick_rig *r, const struct bb_tree *t)
{
	struct pyramid p = { .t = t, .level = calloc((size_t)t->n_levels * t->n_times, sizeof(*p.level)) };

	assert_non_null(p.level);
	for (uint32_t tau = 0; tau < t->n_times; tau++) {
		const struct bb_tree_span s = bb_tree_span(t, tau);
		for (uint32_t l = t->n_levels; l-- > 0;) {
			const uint32_t *v = t->voxels[l];
			double *out = malloc(level_voxels(t, l) * sizeof(double));
			assert_non_null(out);
			p.level[(size_t)l * t->n_times + tau] = out;
			for (size_t i = 0; i < level_voxels(t, l); i++) {
				const uint32_t x = (uint32_t)(i % v[0]), y = (uint32_t)(i / v[0] % v[1]),
					       z = (uint32_t)(i / v[0] / v[1]);
				if (l + 1 < t->n_levels) {
					out[i] = mean_of_children(t, p.level[(size_t)(l + 1) * t->n_times + tau], l, x,
								  y, z);
					continue;
				}
				out[i] = 0;
				for (uint32_t step = s.from; step < s.to; step++)
					out[i] += (double)r->voxels[step * rig_voxels(r) + i];
				out[i] /= s.to - s.from;
			}
		}
	}
	return p;
}

static void pyramid_free(struct pyramid *p)
{
	for (size_t i = 0; i < (size_t)p->t->n_levels * p->t->n_times; i++)
		free(p->level[i]);
	free(p->level);
}

/* format.h: across the seam as far as the padding goes, what is beyond repeats it. */
static uint32_t around(int64_t i, uint32_t n, uint32_t pad)
{
	const int64_t most = (int64_t)n + pad - 1, held = i < -(int64_t)pad ? -(int64_t)pad : i > most ? most : i;

	return (uint32_t)((held % n + n) % n);
}

static double expected(const struct pyramid *p, const struct bb_bricks_header *h, const struct bb_tree_place *at,
		       uint32_t tau, const uint32_t ijk[3])
{
	const uint32_t *v = p->t->voxels[at->level];
	uint32_t c[3];

	for (int a = 0; a < 3; a++) {
		const int64_t i = (int64_t)at->at[a] * p->t->edge + ijk[a] - h->pad;
		c[a] = a == 2 && h->pad && bb_bricks_wraps(h) ? around(i, v[a], h->pad) : rig_clamp(i, v[a]);
	}
	return p->level[(size_t)at->level * p->t->n_times + tau][((size_t)c[2] * v[1] + c[1]) * v[0] + c[0]];
}

/* ---- what a type may lose ---- */

/* Half a quantum, and what a float of that size cannot say. */
static double allowed(const struct bb_bricks_header *h, double want, bool leaf)
{
	const double span = h->most - h->least, largest = fmax(fabs(h->least), fabs(h->most));
	const double averaged = leaf ? 0 : 2e-6; /* coarse voxels are means made in f32, level by level */

	if (h->type == BB_BRICK_F32)
		return averaged;
	const double rounded = 1.01 * largest * 0x1p-24;
	if (h->type == BB_BRICK_F16) {
		const double part = span > 0 ? (want - h->least) / span : 0;
		const int exponent = part > 0 ? ilogb(part) : -15;
		return span * (ldexp(0.5, (exponent < -14 ? -14 : exponent) - 10) + 0x1p-24) + rounded + averaged;
	}
	return 0.5 * span / (h->type == BB_BRICK_U8 ? 255 : 65535) + rounded + averaged;
}

struct worst {
	double share[BB_BRICK_TYPES]; /* of what is allowed, at the leaves */
	uint64_t n_voxels, n_padding;
};

static void check_brick(const struct pyramid *p, const struct bb_bricks_header *h, uint64_t id, const float *v,
			struct worst *worst)
{
	const struct bb_tree_place at = bb_tree_place(p->t, (uint32_t)(id % p->t->n_nodes));
	const uint32_t tau = (uint32_t)(id / p->t->n_nodes), side = h->tree.edge + 2 * h->pad;
	const struct bb_tree_span s = bb_tree_span(p->t, tau);
	const bool leaf = at.level + 1 == p->t->n_levels && s.to - s.from == 1;
	uint32_t c[3];

	for (c[2] = 0; c[2] < side; c[2]++)
		for (c[1] = 0; c[1] < side; c[1]++)
			for (c[0] = 0; c[0] < side; c[0]++, v++) {
				const double want = expected(p, h, &at, tau, c), most = allowed(h, want, leaf);
				const double off = fabs((double)*v - want);
				bool own = true;
				for (int a = 0; a < 3; a++)
					own &= c[a] >= h->pad && c[a] < side - h->pad;
				worst->n_voxels += own;
				worst->n_padding += !own;
				if (leaf && most > 0)
					worst->share[h->type] = fmax(worst->share[h->type], off / most);
				if (!(off <= most))
					fail_msg("brick %llu (level %u, steps %u..%u) voxel %u %u %u: %.9g, want %.9g, "
						 "allowed %.3g",
						 (unsigned long long)id, at.level, s.from, s.to, c[0], c[1], c[2],
						 (double)*v, want, most);
			}
}

static void check_file(const struct brick_rig *r, const struct bb_bricks *b, uint64_t *seed, struct worst *worst)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const size_t side = h->tree.edge + 2 * h->pad, n = side * side * side;
	const uint64_t wanted = 300000 / n + 3; /* bricks; the first and the last one always */
	const uint64_t stride = h->tree.n_bricks > wanted ? h->tree.n_bricks / wanted : 1;
	struct pyramid p = pyramid_of(r, &h->tree);
	uint8_t *stored = malloc(bb_bricks_brick_bytes(h));
	float *v = malloc(n * sizeof(float));
	struct bb_error err = { 0 };

	assert_true(stored && v);
	for (uint64_t from = 0; from < h->tree.n_bricks; from += stride) {
		const uint64_t left = h->tree.n_bricks - from, few = left < stride ? left : stride;
		const uint64_t id = !from ? 0 : left <= stride ? h->tree.n_bricks - 1 : from + rig_random(seed) % few;
		if (bb_bricks_read(b, id, stored, &err) != BB_OK)
			fail_msg("%s", err.text);
		bb_values_load(h, stored, n, v);
		check_brick(&p, h, id, v, worst);
	}
	free(stored);
	free(v);
	pyramid_free(&p);
}

/* ---- 200 shapes ---- */

static const double extents[][6] = { /* all the way round; half of it; all the way round from elsewhere */
				     { 0.1, 1.7, 0.5, 2.6, 0, TURN },
				     { 0.1, 1.7, 0.5, 2.6, 0.5, 3.5 },
				     { 1, 2, 0, TURN / 2, -TURN / 2, TURN / 2 }
};

static void any_shape_reads_back(void **state)
{
	unsigned types[BB_BRICK_TYPES] = { 0 }, codecs[BB_BRICK_CODECS] = { 0 }, grids[BB_BRICK_GRIDS] = { 0 };
	struct worst worst = { .n_voxels = 0 };
	unsigned wrapped = 0, large = 0;
	uint64_t seed = 11;
	(void)state;

	for (uint32_t i = 0; i < 200; i++) {
		const uint32_t edge = 4 + 2 * (rig_random(&seed) % (i % 4 ? 7 : 31)), long_axis = rig_random(&seed) % 3;
		struct brick_rig r;
		uint32_t dim[3];
		for (uint32_t a = 0; a < 3; a++)
			dim[a] = 1 + rig_random(&seed) % (a == long_axis && edge > 10 ? edge * 5 / 2 : 26);
		rig_begin(&r, dim[0], dim[1], dim[2], 1 + rig_random(&seed) % 9, edge);
		r.config.pad = rig_random(&seed) % 3;
		r.config.threads = 1 + rig_random(&seed) % 3;
		r.config.codec = (enum bb_brick_codec)(rig_random(&seed) % BB_BRICK_CODECS);
		r.config.type = (enum bb_brick_type)(i % BB_BRICK_TYPES);
		r.config.grid = rig_random(&seed) % 2 ? BB_BRICK_SPHERICAL : BB_BRICK_CARTESIAN;
		r.config.memory_bytes = 256u << 20;
		if (r.config.grid == BB_BRICK_SPHERICAL)
			memcpy(r.config.extent, extents[rig_random(&seed) % BB_ARRAY_LEN(extents)], sizeof(extents[0]));
		struct bb_bricks *b = rig_build(&r);
		types[r.config.type]++;
		codecs[r.config.codec]++;
		grids[r.config.grid]++;
		wrapped += bb_bricks_wraps(bb_bricks_header(b)) && r.config.pad;
		large += edge > 16;
		check_file(&r, b, &seed, &worst);
		bb_bricks_close(b);
		rig_end(&r);
	}
	print_message(
		"200 shapes (u8 %u, u16 %u, f16 %u, f32 %u; plain %u, lz4 %u, zstd %u; spherical %u, padding over the "
		"seam %u; edge over 16 %u): %llu voxels and %llu of padding or outside\n",
		types[0], types[1], types[2], types[3], codecs[0], codecs[1], codecs[2], grids[1], wrapped, large,
		(unsigned long long)worst.n_voxels, (unsigned long long)worst.n_padding);
	print_message("worst leaf voxel, in parts of half a quantum: u8 %.4f, u16 %.4f, f16 %.4f; f32 exact\n",
		      worst.share[0], worst.share[1], worst.share[2]);
	for (int t = 0; t < BB_BRICK_TYPES; t++)
		assert_int_equal(types[t], 50);
	assert_true(codecs[0] > 40 && codecs[1] > 40 && codecs[2] > 40 && grids[1] > 60 && wrapped > 20 && large > 20);
	assert_true(worst.share[BB_BRICK_U8] > 0.9 && worst.share[BB_BRICK_F16] > 0.5); /* the bound is no loose one */
}

/* ---- the seam ---- */

struct open_file {
	struct bb_bricks *b;
	const struct bb_bricks_header *h;
	uint32_t side;
};

static float *brick_of(const struct open_file *f, uint32_t tau, const struct bb_tree_place *p)
{
	const size_t n = (size_t)f->side * f->side * f->side;
	uint8_t *stored = malloc(bb_bricks_brick_bytes(f->h));
	float *v = malloc(n * sizeof(float));
	const uint64_t id = (uint64_t)tau * f->h->tree.n_nodes + bb_tree_node(&f->h->tree, p);

	assert_true(stored && v);
	assert_int_equal(bb_bricks_read(f->b, id, stored, NULL), BB_OK);
	bb_values_load(f->h, stored, n, v);
	free(stored);
	return v;
}

/* The plane of a level that is z voxels from the front, of the bricks at (x, y): from the brick that owns it. */
static void own_plane(const struct open_file *f, uint32_t tau, struct bb_tree_place p, uint32_t z, float *out)
{
	const uint32_t edge = f->h->tree.edge, in = z % edge + f->h->pad;

	p.at[2] = z / edge;
	float *v = brick_of(f, tau, &p);
	memcpy(out, v + (size_t)in * f->side * f->side, (size_t)f->side * f->side * sizeof(float));
	free(v);
}

/* Every pair of bricks on both sides of the seam, all levels and time nodes. */
static size_t meet_across(const struct open_file *f)
{
	const struct bb_tree *t = &f->h->tree;
	const uint32_t pad = f->h->pad, plane = f->side * f->side;
	float *want = malloc(plane * sizeof(float));
	size_t n = 0;

	assert_non_null(want);
	for (uint32_t tau = 0; tau < t->n_times; tau++)
		for (uint32_t l = 0; l < t->n_levels; l++)
			for (uint32_t i = 0; i < t->grid[l][0] * t->grid[l][1]; i++) {
				const uint32_t deep = t->voxels[l][2], last = t->grid[l][2] - 1;
				struct bb_tree_place p = { l, { i % t->grid[l][0], i / t->grid[l][0], 0 } };
				float *v = brick_of(f, tau, &p);
				for (uint32_t k = 0; k < pad;
				     k++, n++) { /* before the first plane come the last ones */
					own_plane(f, tau, p, (deep * pad - pad + k) % deep, want);
					assert_memory_equal(v + (size_t)k * plane, want, plane * sizeof(float));
				}
				free(v);
				p.at[2] = last;
				v = brick_of(f, tau, &p);
				for (uint32_t k = 0; k < pad; k++, n++) { /* after the last plane come the first ones */
					const uint32_t at = pad + (deep - last * t->edge) + k;
					own_plane(f, tau, p, k % deep, want);
					assert_memory_equal(v + (size_t)at * plane, want, plane * sizeof(float));
				}
				free(v);
			}
	free(want);
	return n;
}

static void padding_is_the_true_neighbour_over_the_seam(void **state)
{
	static const struct {
		uint32_t dim[3], steps, edge, pad;
		enum bb_brick_type type;
		uint64_t memory_bytes;
	} shape[] = {
		{ { 20, 18, 40 }, 3, 8, 1, BB_BRICK_F32, 64u << 20 },
		{ { 20, 18, 40 }, 3, 8, 2, BB_BRICK_U16, 64u << 20 },
		{ { 11, 30, 37 }, 5, 6, 2, BB_BRICK_F16, 64u << 20 }, /* the last brick is not full */
		{ { 11, 30, 33 }, 2, 16, 2, BB_BRICK_U8, 64u << 20 }, /* one plane in the last brick */
		{ { 9, 8, 2 }, 2, 4, 2, BB_BRICK_F32, 64u << 20 },
		{ { 9, 8, 1 }, 2, 4, 2, BB_BRICK_F32, 64u << 20 },
		{ { 30, 60, 34 }, 3, 4, 1, BB_BRICK_F32, 3300u << 10 }, /* several tiles */
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(shape); i++) {
		struct brick_rig r;
		rig_begin(&r, shape[i].dim[0], shape[i].dim[1], shape[i].dim[2], shape[i].steps, shape[i].edge);
		r.config.grid = BB_BRICK_SPHERICAL;
		memcpy(r.config.extent, extents[0], sizeof(extents[0]));
		r.config.pad = shape[i].pad;
		r.config.type = shape[i].type;
		r.config.memory_bytes = shape[i].memory_bytes;
		struct open_file f = { .b = rig_build(&r) };
		f.h = bb_bricks_header(f.b);
		f.side = f.h->tree.edge + 2 * f.h->pad;
		assert_true(bb_bricks_wraps(f.h));
		print_message("%u x %u x %u, edge %u: %zu planes of padding are those of the brick over the seam\n",
			      shape[i].dim[0], shape[i].dim[1], shape[i].dim[2], shape[i].edge, meet_across(&f));
		bb_bricks_close(f.b);
		rig_end(&r);
	}
}

static void only_a_whole_turn_wraps(void **state)
{
	static const struct {
		enum bb_brick_grid grid;
		double from, to;
		bool wraps;
	} cases[] = {
		{ BB_BRICK_SPHERICAL, 0, TURN, true },         { BB_BRICK_SPHERICAL, -TURN / 2, TURN / 2, true },
		{ BB_BRICK_SPHERICAL, 0, 6.283, true },        { BB_BRICK_SPHERICAL, 0, 6.2832, true },
		{ BB_BRICK_SPHERICAL, 0, 6.28, false },        { BB_BRICK_SPHERICAL, 0, TURN / 2, false },
		{ BB_BRICK_SPHERICAL, 0, 2 * TURN, false },    { BB_BRICK_CARTESIAN, 0, TURN, false },
		{ BB_BRICK_SPHERICAL, 0, (double)NAN, false },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		const struct bb_bricks_header h = { .grid = cases[i].grid,
						    .extent = { 1, 2, 0, 3, cases[i].from, cases[i].to } };
		assert_int_equal(bb_bricks_wraps(&h), cases[i].wraps);
	}
}

/* A generated spherical sequence says so itself, and the file's header after it. */
static void a_made_grid_is_known_to_the_file(void **state)
{
	struct bb_steps *steps;
	struct bb_build_report report;
	struct bb_bricks *b = NULL;
	struct bb_error err = { 0 };
	char path[] = "/tmp/bb-shapes-XXXXXX.bricks";
	(void)state;

	const int fd = mkstemps(path, 7);
	assert_true(fd >= 0);
	close(fd);
	assert_int_equal(bb_steps_generate("enlil", (const uint32_t[]){ 24, 20, 30 }, 2, &steps, &err), BB_OK);
	const struct bb_build_config c = { .steps = steps,
					   .path = path,
					   .edge = 8,
					   .pad = 1,
					   .type = BB_BRICK_F32,
					   .memory_bytes = 64u << 20,
					   .threads = 1 };
	if (bb_bricks_build(&c, &report, &err) != BB_OK || bb_bricks_open(path, &b, &err) != BB_OK)
		fail_msg("%s", err.text);
	struct open_file f = { .b = b, .h = bb_bricks_header(b), .side = 10 };
	assert_int_equal(f.h->grid, BB_BRICK_SPHERICAL);
	assert_memory_equal(f.h->extent, steps->extent, sizeof(steps->extent));
	assert_true(bb_bricks_wraps(f.h) && meet_across(&f) > 0);
	bb_bricks_close(b);
	bb_steps_close(steps);
	unlink(path);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(any_shape_reads_back),
		cmocka_unit_test(padding_is_the_true_neighbour_over_the_seam),
		cmocka_unit_test(only_a_whole_turn_wraps),
		cmocka_unit_test(a_made_grid_is_known_to_the_file),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
