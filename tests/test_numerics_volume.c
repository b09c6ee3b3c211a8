/*
 * tests/test_numerics_volume.c: where the naive form of a formula fails on volumes, and that ours does not: variance at
 * large means (nV1, nV2), unevenness around zero (nV3), opacity for other steps (nC1), a million and more samples along
 * a ray (nC2), and hostile transfer functions (nC3). Each prints what it measured beside its limit, and where two ways
 * were measured, what an operation of each costs.
 */
#include "bench/volume/rank.h"
#include "hal/clock.h"
#include "render/bricks/metric.h"
#include "tests/brick_rig.h"
#include "tests/drawing.h"

#define N (1u << 20)

static struct bb_clock *watch;

static double noise(uint64_t *seed) /* of deviation 1, nearly normal */
{
	double g = -6;

	for (int k = 0; k < 12; k++)
		g += (rig_random(seed) % 65536 + 0.5) / 65536;
	return g;
}

static long double variance_of(const float *v, size_t n)
{
	long double sum = 0, square = 0;

	for (size_t i = 0; i < n; i++)
		sum += (long double)v[i];
	for (size_t i = 0; i < n; i++)
		square += ((long double)v[i] - sum / (long double)n) * ((long double)v[i] - sum / (long double)n);
	return square / (long double)n;
}

/* As the builder has them of a brick's rows. */
static void moments_of(const float *v, size_t n, struct bb_moments *out)
{
	struct bb_moment_lanes lanes;

	bb_moment_lanes_begin(&lanes, v[0]);
	for (size_t i = 0; i < n; i += BB_MOMENT_LANES)
		bb_moment_lanes_add(&lanes, v + i, BB_MOMENT_LANES);
	bb_moment_lanes_close(&lanes, out);
}

/* ---- nV1 ---- */

#define LEAF 512 /* values of a brick of 8^3 */

/* Moments of all values. Bricks are merged as the octree does (order 0), or whichever come to hand. */
static struct bb_moments merged(const float *v, int order, uint64_t *seed)
{
	static struct bb_moments part[N / LEAF];
	size_t n = N / LEAF;

	for (size_t i = 0; i < n; i++)
		moments_of(v + i * LEAF, LEAF, &part[i]);
	for (; order == 0 && n > 1; n /= 2)
		for (size_t i = 0; i < n / 2; i++) {
			struct bb_moments both = part[2 * i];
			bb_moments_merge(&both, &part[2 * i + 1]);
			part[i] = both;
		}
	while (n > 1) {
		const size_t a = order == 1 ? 0 : rig_random(seed) % n;
		const size_t b = order == 1 ? n - 1 : (a + 1 + rig_random(seed) % (n - 1)) % n;
		bb_moments_merge(&part[a], &part[b]);
		part[b] = part[--n];
		if (a == n)
			part[b] = part[a]; /* it was the last one, and moves */
	}
	return part[0];
}

static void variance_at_large_means(void **state)
{
	static const double means[] = { 0, 100, 1e4, 1e6, 1e7, 1e8 };
	static float v[N];
	uint64_t seed = 3;
	(void)state;

	for (size_t m = 0; m < BB_ARRAY_LEN(means); m++) {
		const double deviation = means[m] > 5e7 ? 8 : 1; /* floats of 1e8 are multiples of 8 */
		const double apart = means[m] > 1e6 ? 2e-10 : 1e-12;
		for (size_t i = 0; i < N; i++)
			v[i] = (float)(means[m] + deviation * noise(&seed));
		const double want = (double)variance_of(v, N);
		float sum = 0, squares = 0;
		double wide_sum = 0, wide_squares = 0, worst = 0, least = 0, most = 0;
		for (size_t i = 0; i < N; i++) {
			sum += v[i] / (float)N;
			squares += v[i] * v[i] / (float)N;
			wide_sum += (double)v[i] / N;
			wide_squares += (double)v[i] * (double)v[i] / N;
		}
		for (int order = 0; order < 5; order++) {
			const struct bb_moments all = merged(v, order, &seed);
			const double variance = all.m2 / all.n;
			worst = fmax(worst, fabs(variance / want - 1));
			least = order ? fmin(least, variance) : variance;
			most = order ? fmax(most, variance) : variance;
			assert_true(all.n == N && all.m2 >= 0);
		}
		print_message(
			"nV1 mean %9.0f: variance %.9f; merged in any order %.1e off (limit 2e-10), orders %.1e apart "
			"(limit %.0e); E[x^2] - E[x]^2 says %.4g in f32, %.6g in f64\n",
			means[m], want, worst, most / least - 1, apart, (double)(squares - sum * sum),
			wide_squares - wide_sum * wide_sum);
		assert_true(worst <= 2e-10 && most / least - 1 <= apart);
		if (means[m] >= 100)
			assert_true(fabs((double)(squares - sum * sum) / want - 1) >
				    0.01); /* the form that is not used */
	}
}

/* ---- nV2 ---- */

struct narrow { /* Welford's state in f32 */
	float n, mean, m2;
};

static void narrow_merge(struct narrow *a, const struct narrow *b)
{
	const float n = a->n + b->n, apart = b->mean - a->mean;

	a->m2 += b->m2 + apart * apart * (a->n * b->n / n);
	a->mean += apart * (b->n / n);
	a->n = n;
}

static struct narrow narrow_sequence(const float *v, size_t n)
{
	struct narrow s = { 0 };

	for (size_t i = 0; i < n; i++) {
		s.n += 1;
		const float d = v[i] - s.mean;
		s.mean += d / s.n;
		s.m2 += d * (v[i] - s.mean);
	}
	return s;
}

static struct narrow narrow_tree(const float *v, size_t n)
{
	if (n == 1)
		return (struct narrow){ 1, v[0], 0 };
	struct narrow a = narrow_tree(v, n / 2), b = narrow_tree(v + n / 2, n - n / 2);
	narrow_merge(&a, &b);
	return a;
}

static double tree_variance(const float *v)
{
	uint64_t seed = 0;
	const struct bb_moments all = merged(v, 0, &seed);

	return all.m2 / all.n;
}

static void a_tree_beats_a_sequence(void **state)
{
	static float v[N];
	uint64_t seed = 5;
	(void)state;

	for (double mean = 0; mean <= 1e4; mean += 1e4) {
		for (size_t i = 0; i < N; i++)
			v[i] = (float)(mean + noise(&seed));
		const double want = (double)variance_of(v, N);
		const int64_t t0 = bb_clock_now_ns(watch);
		const struct narrow sequence = narrow_sequence(v, N);
		const int64_t t1 = bb_clock_now_ns(watch);
		const struct narrow tree = narrow_tree(v, N);
		const int64_t t2 = bb_clock_now_ns(watch);
		const double ours = tree_variance(v);
		const int64_t t3 = bb_clock_now_ns(watch);
		const double e_sequence = fabs((double)(sequence.m2 / sequence.n) / want - 1),
			     e_tree = fabs((double)(tree.m2 / tree.n) / want - 1), e_ours = fabs(ours / want - 1);
		print_message(
			"nV2 mean %5.0f: one after the other in f32 %.1e off (%.1f ns a value), pairwise in f32 %.1e "
			"(%.1f ns), ours, bricks of 512 and pairwise in f64, %.1e (%.1f ns; limit 1e-6)\n",
			mean, e_sequence, (double)(t1 - t0) / N, e_tree, (double)(t2 - t1) / N, e_ours,
			(double)(t3 - t2) / N);
		assert_true(e_ours <= 1e-6 && e_ours < e_tree && e_tree < e_sequence);
	}
}

/* ---- nV3 ---- */

static const double extremes[] = { 0, 1e-45, 1e-38, 1e-30, 1e-10, 1, 1e10, 1e30, 3.3e38 };

static void unevenness_is_finite_for_all(void **state)
{
	double largest = 0;
	size_t n = 0;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(extremes); i++)
		for (size_t j = 0; j < BB_ARRAY_LEN(extremes); j++)
			for (int signs = 0; signs < 4; signs++, n++) {
				const float a = (float)(signs & 1 ? -extremes[i] : extremes[i]),
					    b = (float)(signs & 2 ? -1.00001 * extremes[j]
								  : extremes[j]); /* means of nearly 0, too */
				const float v[8] = { a, b, a, b, b, a, a, b };
				struct bb_moments m;
				moments_of(v, 8, &m);
				const double range = fabs((double)a - (double)b), cov = bb_moments_cov(&m, range);
				assert_true(isfinite(cov) && cov >= 0 && isfinite(bb_moments_deviation(&m)));
				assert_true(cov == 0 || range > 0);
				assert_true(bb_moments_cov(&m, 0) >= 0 && isfinite(bb_moments_cov(&m, 0)));
				largest = fmax(largest, cov);
			}
	print_message("nV3: %zu bricks of extreme pairs, all finite; the most uneven has %.4g\n", n, largest);
	assert_true(largest <=
		    1000.01); /* a deviation of half the range over a thousandth of it is 500, of the whole 1000 */
}

static void unevenness_knows_no_unit(void **state)
{
	static float v[LEAF], scaled[LEAF];
	double worst = 0;
	uint64_t seed = 11;
	(void)state;

	for (int centre = 0; centre < 3; centre++) {
		struct bb_moments m, s;
		for (size_t i = 0; i < LEAF; i++)
			v[i] = (float)(noise(&seed) + (centre == 1 ? 5 : centre == 2 ? -5 : 0));
		moments_of(v, LEAF, &m);
		const double range = (double)m.most - (double)m.least, want = bb_moments_cov(&m, range);
		for (int exponent = -100; exponent <= 100; exponent += 25) { /* 2^-100 is 8e-31 */
			for (size_t i = 0; i < LEAF; i++)
				scaled[i] = ldexpf(v[i], exponent);
			moments_of(scaled, LEAF, &s);
			worst = fmax(worst, fabs(bb_moments_cov(&s, ldexp(range, exponent)) / want - 1));
		}
	}
	print_message("nV3: values times 8e-31 to 1e30 change it by %.1e (limit 1e-12)\n", worst);
	assert_true(worst <= 1e-12);
}

static double rank_correlation(const float *a, const float *b, size_t n)
{
	double out;

	assert_int_equal(bb_rank_correlation(a, b, n, &out, NULL), BB_OK);
	return out;
}

struct ratings {
	uint32_t n;
	float *colour, *time, *cov;
};

static struct ratings rate(double shift, const struct bb_metric_table *table)
{
	struct brick_rig r;
	struct ratings out;

	rig_begin(&r, 40, 36, 32, 3, 8);
	for (size_t i = 0; i < rig_voxels(&r) * r.n_steps; i++)
		r.voxels[i] = (float)(round((double)r.voxels[i] * 1024) / 1024 + shift); /* exact with the shift, too */
	rig_write(&r);
	struct bb_bricks *b = rig_build(&r);
	const struct bb_bricks_header *h = bb_bricks_header(b);
	out = (struct ratings){ .n = (uint32_t)h->tree.n_bricks };
	out.colour = malloc(out.n * sizeof(float));
	out.time = malloc(out.n * sizeof(float));
	out.cov = malloc(out.n * sizeof(float));
	assert_true(out.colour && out.time && out.cov);
	bb_metric_rate(b, table, out.colour, out.time);
	for (uint32_t i = 0; i < out.n; i++) {
		const struct bb_bricks_moments *m = &bb_bricks_moments(b)[i];
		const double deviation = (double)m->deviation;
		const struct bb_moments whole = { .n = 1, .mean = (double)m->mean, .m2 = deviation * deviation };
		out.cov[i] = (float)bb_moments_cov(&whole, h->most - h->least);
	}
	bb_bricks_close(b);
	rig_end(&r);
	return out;
}

/* The same data with a constant added look the same: the colour metric ranks bricks as before, the scalar one does not.
 */
static void a_constant_does_not_change_the_order(void **state)
{
	static struct bb_transfer tf;
	static struct bb_metric_colours colours;
	static struct bb_metric_table table;
	(void)state;

	assert_int_equal(bb_transfer_load("scenes/delta-filled.tf", &tf, NULL), BB_OK);
	bb_metric_colours(&tf, &colours);
	bb_metric_table(&colours, &table);
	struct ratings plain = rate(0, &table);
	for (double shift = 10; shift <= 1000; shift *= 10) {
		struct ratings moved = rate(shift, &table);
		const double colour = rank_correlation(plain.colour, moved.colour, plain.n),
			     cov = rank_correlation(plain.cov, moved.cov, plain.n);
		print_message(
			"nV3: %u bricks with %g added: rank correlation %.6f by colour (limit 0.999), %.3f by the "
			"coefficient of variation\n",
			plain.n, shift, colour, cov);
		assert_true(colour >= 0.999 && cov < 0.95);
		free(moved.colour);
		free(moved.time);
		free(moved.cov);
	}
	free(plain.colour);
	free(plain.time);
	free(plain.cov);
}

/* ---- nC1 ---- */

static double ulps(double have, long double want)
{
	const double near = (double)want;

	return near == 0 ? (have == 0 ? 0 : HUGE_VAL)
			 : (double)fabsl(((long double)have - want)) / (nextafter(fabs(near), HUGE_VAL) - fabs(near));
}

static void opacity_for_other_steps(void **state)
{
	static const double exact[][3] = { { 0, 1, 0 },   { 1, 1, 1 },    { 1, 1e-3, 1 },  { 1, 0, 0 },
					   { 0.5, 0, 0 }, { 0, 1000, 0 }, { 0.5, 2, 0.75 } };
	double worst = 0, worst_f32 = 0, naive_f32 = 0, naive_small = 0;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(exact); i++)
		assert_true(bb_transfer_opacity_for_step(exact[i][0], exact[i][1]) == exact[i][2]);
	assert_true(bb_transfer_opacity_for_step((double)NAN, 1) == 0 &&
		    bb_transfer_opacity_for_step(0.5, (double)NAN) == 0);
	assert_true(bb_transfer_opacity_for_step(2, 0.5) == 1 && bb_transfer_opacity_for_step(-1, 0.5) == 0);
	for (double opacity = 1e-12; opacity < 1; opacity = opacity < 0.5 ? opacity * 1.7 : 1 - (1 - opacity) / 1.9) {
		if (1 - opacity < 1e-12)
			break;
		for (double ratio = 1e-3; ratio <= 1001; ratio *= 1.21) {
			const long double want = -expm1l((long double)ratio * log1pl(-(long double)opacity));
			worst = fmax(worst, ulps(bb_transfer_opacity_for_step(opacity, ratio), want));
			if (opacity < 1e-6 || opacity > 0.999)
				continue;
			const float a = (float)opacity, r = (float)ratio;
			const double truth = (double)-expm1l((long double)r * log1pl(-(long double)a));
			worst_f32 = fmax(worst_f32, fabs((double)-expm1f(r * log1pf(-a)) / truth - 1));
			const double off = fabs((double)(1 - powf(1 - a, r)) / truth - 1);
			naive_f32 = fmax(naive_f32, off);
			if (opacity < 2e-6 && ratio < 1.2e-3)
				naive_small = fmax(naive_small, off);
		}
	}
	print_message("nC1: ours %.2f ulp off (limit 4); in f32 %.1e by expm1f and log1pf; 1 - powf(1 - a, r) is %.1f "
		      "%% off, "
		      "for 1e-6 and a thousandth of a step %.0f %%\n",
		      worst, worst_f32, 100 * naive_f32, 100 * naive_small);
	assert_true(worst <= 4 && worst_f32 < 1e-6 && naive_small > 0.99);
}

/* In arithmetic, and in pictures of the judge: of a volume without a step anywhere, 8-bit rounding included. */
static void half_the_step_is_the_same_picture(void **state)
{
	struct bb_volume *v = drawing_volume(60, 50, 40, 1);
	const struct bb_transfer tf = drawing_smooth();
	struct drawing drawing = drawing_of(v, &tf, 16, BB_BRICK_U16, 0, cover_leaves, NULL);
	struct bb_renderer *reference;
	struct bb_image_difference d;
	double worst = 0;
	(void)state;

	for (double opacity = 1e-12; opacity < 1; opacity = opacity < 0.5 ? opacity * 1.3 : 1 - (1 - opacity) / 1.5) {
		if (1 - opacity < 1e-12)
			break;
		for (double ratio = 1.0 / 512; ratio <= 64; ratio *= 2) {
			const double half = bb_transfer_opacity_for_step(opacity, ratio / 2);
			worst = fmax(worst,
				     fabs(half + (1 - half) * half - bb_transfer_opacity_for_step(opacity, ratio)));
		}
	}
	assert_int_equal(bb_renderer_reference_create(2, &reference), BB_OK);
	struct bb_image a = drawing_picture(reference, &drawing.layer, 1, 0, 0.25, NULL),
			b = drawing_picture(reference, &drawing.layer, 1, 0, 0.125, NULL);
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	print_message("nC1: two half steps are %.1e off one (limit 1/512 = 2e-3); pictures at 1/4 and 1/8 of a voxel "
		      "differ by at "
		      "most %u of 255 (limit 1, half a level being rounded up) and %.1f dB\n",
		      worst, d.most, d.psnr_db);
	assert_true(worst <= 1e-12 && d.most <= 1 && d.n_pixels > 1000);
	bb_image_release(&a);
	bb_image_release(&b);
	bb_renderer_destroy(reference);
	drawing_done(&drawing);
	drawing_free(v);
}

static void what_the_two_forms_cost(void **state)
{
	static float out[1 << 16];
	float sum = 0;
	(void)state;

	const int64_t t0 = bb_clock_now_ns(watch);
	for (size_t i = 0; i < BB_ARRAY_LEN(out); i++)
		out[i] = (float)bb_transfer_opacity_for_step((double)i / BB_ARRAY_LEN(out), 0.5);
	const int64_t t1 = bb_clock_now_ns(watch);
	for (size_t i = 0; i < BB_ARRAY_LEN(out); i++)
		sum += out[i] - (1 - powf(1 - (float)i / BB_ARRAY_LEN(out), 0.5f));
	const int64_t t2 = bb_clock_now_ns(watch);
	print_message("nC1: %.1f ns by expm1 and log1p in f64, %.1f ns by powf in f32; a table of 4096 entries is made "
		      "once an "
		      "edit (sum of differences %.1e)\n",
		      (double)(t1 - t0) / BB_ARRAY_LEN(out), (double)(t2 - t1) / BB_ARRAY_LEN(out), (double)sum);
}

/* ---- nC2 ---- */

static void a_hundred_million_samples(void **state)
{
	const double thin = 1e-7;
	(void)state;

	for (uint32_t n = 1000000; n <= 100000000; n *= 10) {
		const double want = -expm1(-thin * n), per_sample = -expm1(-thin);
		float transmitted = 1, sum = 0, depth = 0, rest = 0;
		double ours = 0; /* as the reference caster composites */
		const float a = (float)per_sample;
		for (uint32_t i = 0; i < n; i++) {
			transmitted *= 1 - a;
			sum += (1 - sum) * a;
		}
		const int64_t t0 = bb_clock_now_ns(watch);
		for (uint32_t i = 0; i < n; i++)
			ours += (1 - ours) * per_sample;
		const int64_t t1 = bb_clock_now_ns(watch);
		for (uint32_t i = 0; i < n; i++) { /* Kahan's sum of depths, one exponential at the end */
			const float add = (float)thin - rest, more = depth + add;
			rest = (more - depth) - add;
			depth = more;
		}
		const int64_t t2 = bb_clock_now_ns(watch);
		print_message(
			"nC2 %9u samples of 1e-7: %.8f; front to back in f64 %.1e off (limit 1e-6; %.2f ns a sample), "
			"depths summed in f32 %.1e (%.2f ns); products in f32 %.4f, sums in f32 %.4f\n",
			n, want, fabs(ours - want), (double)(t1 - t0) / n, fabs(-(double)expm1f(-depth) - want),
			(double)(t2 - t1) / n, 1 - (double)transmitted, (double)sum);
		assert_true(fabs(ours - want) <= 1e-6 && fabs(-(double)expm1f(-depth) - want) <= 1e-6);
		assert_true(n < 100000000 || fabs((double)sum - want) > 0.1); /* the form that is not used */
	}
}

/* The longest ray a renderer takes: the diagonal of 1024^3 at a sixty-fourth of a voxel, composited in f32. */
static void f32_does_for_the_longest_ray(void **state)
{
	const uint32_t n = 64 * 1774;
	double worst = 0, worst_at = 0;
	(void)state;

	for (double depth = 1e-3; depth < 20; depth *= 1.1) {
		const float a = (float)-expm1(-depth / n);
		float sum = 0;
		for (uint32_t i = 0; i < n; i++)
			sum += (1 - sum) * a;
		const double off = fabs((double)sum + expm1((double)n * log1p(-(double)a)));
		if (off > worst) {
			worst = off;
			worst_at = depth;
		}
	}
	print_message("nC2: %u samples composited in f32 are at most %.1e off, at a depth of %.2f (limit 1/512)\n", n,
		      worst, worst_at);
	assert_true(worst <= 1.0 / 512);
}

/* One ray through a homogeneous slab, by every renderer that needs no display. */
static uint8_t slab_alpha(struct bb_renderer *r, const struct bb_layer *layer, double step_voxels, uint64_t *samples)
{
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = { .view = &view, .layers = layer, .n_layers = 1, .step_voxels = step_voxels };
	struct bb_draw_stats stats = { 0 };
	struct bb_image image;

	assert_int_equal(bb_image_create(1, 1, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(r, &draw, &image, &stats), BB_OK);
	const uint8_t alpha = image.rgba[3];
	*samples = stats.samples;
	bb_image_release(&image);
	return alpha;
}

static void a_slab_is_as_opaque_as_it_is_thick(void **state)
{
	static const double opacities[] = { 1e-9, 1e-5, 1e-3, 0.01, 0.05 };
	struct bb_volume *v = drawing_volume(60, 50, 40, 1);
	struct bb_renderer *reference, *cpu;
	double worst[2] = { 0 };
	uint64_t most_samples = 0;
	(void)state;

	for (size_t i = 0; i < (size_t)60 * 50 * 40; i++)
		v->voxels[i] = 40000;
	assert_int_equal(bb_renderer_reference_create(1, &reference), BB_OK);
	assert_int_equal(bb_renderer_cpu_create("auto", 1, &cpu, NULL), BB_OK);
	for (size_t k = 0; k < BB_ARRAY_LEN(opacities); k++) {
		const struct bb_transfer_point points[] = { { 0, 1, 1, 1, opacities[k] },
							    { 1, 1, 1, 1, opacities[k] } };
		const struct bb_transfer tf = drawing_transfer(2, points);
		struct drawing drawing = drawing_of(v, &tf, 16, BB_BRICK_U16, 0, cover_leaves, NULL);
		for (double step = 1.0 / 64; step <= 2; step *= 2) {
			uint64_t n, unused;
			const uint8_t judged = slab_alpha(reference, &drawing.layer, step, &n),
				      drawn = slab_alpha(cpu, &drawing.layer, step, &unused);
			const double want = -255 * expm1((double)n * step * log1p(-opacities[k]));
			most_samples = n > most_samples ? n : most_samples;
			assert_true(n > 10);
			worst[0] = fmax(worst[0], fabs(judged - want));
			worst[1] = fmax(worst[1], fabs(drawn - want));
		}
		bb_renderer_forget(cpu);
		drawing_done(&drawing);
	}
	print_message("nC2: a homogeneous slab, steps of 1/64 to 2 voxels, up to %llu samples: reference %.3f levels "
		      "of 255 off, "
		      "cpu %.3f (a level is rounded to half: limits 0.501 and 1)\n",
		      (unsigned long long)most_samples, worst[0], worst[1]);
	assert_true(worst[0] <= 0.501 && worst[1] <= 1);
	bb_renderer_destroy(cpu);
	bb_renderer_destroy(reference);
	drawing_free(v);
}

/* ---- nC3 ---- */

static const char *const words[] = { "nan",    "-nan(7)", "inf", "-inf",   "1e999",  "-1e999", "-0.1", "1.0001",
				     "1e308",  "2",       "-0",  "1e-400", "0x1p-1", "",       "0",    "1",
				     "0.5",    "1e-12",   "x",   "0,5",    "0.25",   "1e-45",  "#",    "1e0",
				     "0.9999", "+0.3",    ".",   "1e",     "0.75",   "\x01" };

/* A text like a transfer function's with some words wrong, lines missing, too many or in no order. */
static size_t hostile_text(uint64_t *seed, char *out, size_t cap)
{
	const uint32_t kind = rig_random(seed) % 8, lines = kind == 0   ? rig_random(seed) % 2
							    : kind == 1 ? 1020 + rig_random(seed) % 10
									: 2 + rig_random(seed) % 12;
	size_t n = 0;

	for (uint32_t i = 0; i < lines; i++) {
		const uint32_t fields = kind == 2 ? rig_random(seed) % 8 : 5;
		for (uint32_t f = 0; f < fields && n + 64 < cap; f++) {
			const bool wrong = kind > 3 && rig_random(seed) % (4 * lines) == 0;
			if (wrong)
				n += (size_t)snprintf(out + n, cap - n, "%s ",
						      words[rig_random(seed) % BB_ARRAY_LEN(words)]);
			else if (f)
				n += (size_t)snprintf(out + n, cap - n, "%.3g ", rig_random(seed) % 1001 / 1000.0);
			else
				n += (size_t)snprintf(out + n, cap - n, "%.17g ",
						      kind == 3 ? rig_random(seed) % 4 / 3.0 : (i + 0.5) / lines);
		}
		n += (size_t)snprintf(out + n, cap - n, "\n");
	}
	return kind == 7 && n ? rig_random(seed) % n : n;
}

/* A ray over all values in floats: bounded, finite, never darker than nothing. */
static void ray_is_finite(const struct bb_transfer *tf, double step)
{
	double sum[4] = { 0 }, rgba[4];

	for (int i = -20; i < 1020; i++) {
		const double v = i == -20 ? (double)NAN : i == -19 ? HUGE_VAL : i == -18 ? -HUGE_VAL : i / 1000.0;
		bb_transfer_at(tf, v, rgba);
		const double opacity = bb_transfer_opacity_for_step(rgba[3], step), weight = (1 - sum[3]) * opacity;
		assert_true(opacity >= 0 && opacity <= 1);
		for (int c = 0; c < 4; c++)
			assert_true(rgba[c] >= 0 && rgba[c] <= 1);
		for (int c = 0; c < 3; c++)
			sum[c] += weight * rgba[c];
		sum[3] += weight;
	}
	for (int c = 0; c < 4; c++)
		assert_true(isfinite(sum[c]) && sum[c] >= 0 && sum[c] <= 1 + 1e-12);
}

static void picture_is_sane(struct bb_renderer *r, const struct bb_layer *layer)
{
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = { .view = &view, .layers = layer, .n_layers = 1, .step_voxels = 1 };
	struct bb_image image;

	assert_int_equal(bb_image_create(24, 16, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(r, &draw, &image, NULL), BB_OK);
	for (size_t i = 0; i < 24 * 16; i++)
		for (int c = 0; c < 3;
		     c++) /* premultiplied: a channel that came from no number would not keep to that */
			assert_true(image.rgba[i * 4 + (size_t)c] <= image.rgba[i * 4 + 3] + 1);
	bb_image_release(&image);
}

static void hostile_transfer_functions(void **state)
{
	struct bb_volume *v = drawing_volume(20, 18, 16, 2);
	struct bb_renderer *reference, *cpu;
	char path[] = "/tmp/bb-hostile-XXXXXX";
	static char text[1 << 17];
	unsigned refused = 0, drawn = 0, by_number[8] = { 0 };
	uint64_t seed = 17;
	(void)state;

	assert_int_equal(bb_renderer_reference_create(1, &reference), BB_OK);
	assert_int_equal(bb_renderer_cpu_create("auto", 1, &cpu, NULL), BB_OK);
	const int fd = mkstemp(path);
	assert_true(fd >= 0);
	while (refused + drawn < 1000 && (refused < 500 || drawn < 100)) {
		static struct bb_transfer tf;
		struct bb_error err = { 0 };
		const size_t n = hostile_text(&seed, text, sizeof(text));
		assert_true(ftruncate(fd, 0) == 0 && pwrite(fd, text, n, 0) == (ssize_t)n);
		if (bb_transfer_load(path, &tf, &err) != BB_OK) {
			assert_true(err.number >= 1301 && err.number <= 1307);
			by_number[err.number - 1300]++;
			refused++;
			continue;
		}
		drawn++;
		for (double step = 1.0 / 64; step <= 64; step *= 16)
			ray_is_finite(&tf, step);
		struct drawing drawing = drawing_of(v, &tf, 16, BB_BRICK_U16, 0.5, cover_leaves, NULL);
		picture_is_sane(reference, &drawing.layer);
		picture_is_sane(cpu, &drawing.layer);
		bb_renderer_forget(cpu);
		drawing_done(&drawing);
	}
	close(fd);
	unlink(path);
	print_message("nC3: %u hostile transfer functions refused (1301: %u, 1302: %u, 1303: %u, 1304: %u, 1305: %u, "
		      "1306: %u, "
		      "1307: %u), %u drawn twice without a pixel that is no number\n",
		      refused, by_number[1], by_number[2], by_number[3], by_number[4], by_number[5], by_number[6],
		      by_number[7], drawn);
	assert_true(refused >= 500 && drawn >= 100);
	for (int k = 1; k < 8; k++)
		assert_true(by_number[k] > 0);
	bb_renderer_destroy(cpu);
	bb_renderer_destroy(reference);
	drawing_free(v);
}

static int begin(void **state)
{
	(void)state;
	return bb_clock_posix_create(&watch) == BB_OK ? 0 : -1;
}

static int end(void **state)
{
	(void)state;
	bb_clock_destroy(watch);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(variance_at_large_means),
		cmocka_unit_test(a_tree_beats_a_sequence),
		cmocka_unit_test(unevenness_is_finite_for_all),
		cmocka_unit_test(unevenness_knows_no_unit),
		cmocka_unit_test(a_constant_does_not_change_the_order),
		cmocka_unit_test(opacity_for_other_steps),
		cmocka_unit_test(half_the_step_is_the_same_picture),
		cmocka_unit_test(what_the_two_forms_cost),
		cmocka_unit_test(a_hundred_million_samples),
		cmocka_unit_test(f32_does_for_the_longest_ray),
		cmocka_unit_test(a_slab_is_as_opaque_as_it_is_thick),
		cmocka_unit_test(hostile_transfer_functions),
	};

	return cmocka_run_group_tests(tests, begin, end);
}
