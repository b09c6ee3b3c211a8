/*
 * tests/test_blobs.c: bright spots: against a flood fill that knows no runs, against the Cramer-Rao bound, and against
 * pictures made to cost much.
 *
 * Noise: a pixel collects (level - black) * e_per_level electrons and their shot noise (normal: 200 and more electrons
 * where it matters), then read noise, then rounds to whole levels. The bound is the inverse of the Fisher information of
 * centre, amplitude, width and background together, all unknown, of normal noise of that variance and 1/12 for rounding;
 * what the variance itself tells is counted, too.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "sync/blobs/blobs_private.h"
#include "tests/track_scene.h"

#define BLACK 4.0
#define SIDE 26
#define MIDDLE 13.0

static const char *const kernels[] = { "portable", "avx2", "avx512" };

static struct bb_blob_finder *make(struct bb_blobs_config c, int64_t width, int64_t height)
{
	struct bb_blob_finder *f = NULL;
	const enum bb_status status = bb_blob_finder_create(&c, width, height, &f);

	if (status == BB_ERR_UNSUPPORTED)
		return NULL; /* not on this processor */
	assert_int_equal(status, BB_OK);
	return f;
}

static struct bb_blobs_config ungated(void)
{
	struct bb_blobs_config c = bb_blobs_usual();

	c.least_area_px = 0;
	c.most_area_px = 1e6;
	c.least_roundness = 0;
	c.most_spots = 65536;
	c.most_runs = 1 << 20;
	return c;
}

/* A light spot integrated over pixels: separable for a Gaussian. */

static double share(double at, double centre, double sigma) /* of a line of light that falls on pixel `at` */
{
	const double s = sigma * sqrt(2);

	return (erf((at + 0.5 - centre) / s) - erf((at - 0.5 - centre) / s)) / 2;
}

struct spot {
	double x, y, peak, sigma, background; /* peak: of the light before pixels integrate it */
};

static void draw_mean(const struct spot *s, double m[SIDE][SIDE])
{
	const double all = s->peak * 2 * PI * s->sigma * s->sigma;
	double across[SIDE], down[SIDE];

	for (int i = 0; i < SIDE; i++) {
		across[i] = share(i, s->x, s->sigma);
		down[i] = share(i, s->y, s->sigma);
	}
	for (int j = 0; j < SIDE; j++)
		for (int i = 0; i < SIDE; i++)
			m[j][i] = s->background + all * across[i] * down[j];
}

struct noise {
	double read, e_per_level;
};

static double variance(const struct noise *n, double level)
{
	return n->read * n->read + fmax(level - BLACK, 0) / n->e_per_level;
}

static void invert(double a[5][10])
{
	for (int i = 0; i < 5; i++)
		for (int k = 0; k < 5; k++)
			a[i][5 + k] = i == k;
	for (int i = 0; i < 5; i++) {
		const double pivot = a[i][i];
		for (int k = 0; k < 10; k++)
			a[i][k] /= pivot;
		for (int r = 0; r < 5; r++) {
			const double f = a[r][i];
			for (int k = 0; k < 10 && r != i; k++)
				a[r][k] -= f * a[i][k];
		}
	}
}

/* Least variance of a centre's coordinate, mean of the two, px^2. */
static double bound(const struct spot *s, const struct noise *n)
{
	static const double h = 1e-4;
	double m[SIDE][SIDE], up[5][SIDE][SIDE], down[5][SIDE][SIDE], f[5][10] = { { 0 } };

	draw_mean(s, m);
	for (int p = 0; p < 5; p++) {
		struct spot a = *s, b = *s;
		double *const pa[5] = { &a.x, &a.y, &a.peak, &a.sigma, &a.background };
		double *const pb[5] = { &b.x, &b.y, &b.peak, &b.sigma, &b.background };
		*pa[p] += h;
		*pb[p] -= h;
		draw_mean(&a, up[p]);
		draw_mean(&b, down[p]);
	}
	for (int j = 0; j < SIDE; j++)
		for (int i = 0; i < SIDE; i++) {
			const double v = variance(n, m[j][i]) + 1.0 / 12, g = 1 / n->e_per_level;
			for (int p = 0; p < 5; p++)
				for (int q = 0; q < 5; q++) {
					const double dp = (up[p][j][i] - down[p][j][i]) / (2 * h);
					const double dq = (up[q][j][i] - down[q][j][i]) / (2 * h);
					f[p][q] += dp * dq / v * (1 + g * g / (2 * v));
				}
		}
	invert(f);
	return (f[0][5] + f[1][6]) / 2;
}

static void expose(struct scene_rng *r, const struct noise *n, double m[SIDE][SIDE], uint8_t *grey)
{
	for (int j = 0; j < SIDE; j++)
		for (int i = 0; i < SIDE; i++) {
			const double level = m[j][i] + sqrt(variance(n, m[j][i])) * scene_normal(r);
			grey[j * SIDE + i] = (uint8_t)fmin(255, fmax(0, rint(level)));
		}
}

struct error {
	double square, bias; /* px^2, a coordinate: of all, and of the means at each phase */
};

/* Errors over a grid of 8 x 8 phases, draws at each, of two ways on the same pictures. */
#define DRAWS 16
static void measure_spots(struct bb_blob_finder *const f[2], const struct noise *n, double sigma, double peak,
                          struct error e[2], double *bound_px2, struct scene_rng *r)
{
	double m[SIDE][SIDE];
	uint8_t grey[SIDE * SIDE];
	struct bb_spot found[4];

	e[0] = e[1] = (struct error){ 0 };
	*bound_px2 = 0;
	for (int phase = 0; phase < 64; phase++) {
		const int across = phase % 8, down = phase / 8;
		const struct spot s = { MIDDLE + across / 8.0 - 0.4375, MIDDLE + down / 8.0 - 0.4375, peak, sigma, BLACK };
		double x[2] = { 0, 0 }, y[2] = { 0, 0 };
		draw_mean(&s, m);
		*bound_px2 += bound(&s, n) / 64;
		for (int t = 0; t < 2 * DRAWS; t++) {
			if (t % 2 == 0)
				expose(r, n, m, grey);
			assert_int_equal(bb_blobs_find(f[t % 2], grey, SIDE, found, 4).n, 1);
			const double dx = found[0].x_px - s.x, dy = found[0].y_px - s.y;
			e[t % 2].square += (dx * dx + dy * dy) / (64 * 2 * DRAWS);
			x[t % 2] += dx / DRAWS;
			y[t % 2] += dy / DRAWS;
		}
		for (int k = 0; k < 2; k++)
			e[k].bias += (x[k] * x[k] + y[k] * y[k]) / 128;
	}
}

static void centres_come_near_the_bound(void **state)
{
	static const double sigmas[] = { 0.8, 1.0, 1.3, 1.6, 2.0 }, peaks[] = { 60, 100, 150, 200 };
	static const struct noise noises[] = { { 1, 39 }, { 2, 20 } };
	struct scene_rng r = { .s = 9 };
	struct bb_blobs_config c = bb_blobs_usual();

	(void)state;
	c.refine = false;
	struct bb_blob_finder *const plain = make(c, SIDE, SIDE);
	c.refine = true;
	struct bb_blob_finder *const both[2] = { make(c, SIDE, SIDE), plain };
	for (size_t k = 0; k < 2; k++) {
		printf("[ note ] read noise %g levels, %g electrons a level: sigma px, peak, bound px, rms over bound of the "
		       "refined (its bias) and of the centroid (its bias)\n", noises[k].read, noises[k].e_per_level);
		for (size_t i = 0; i < 20; i++) {
			const double sigma = sigmas[i / 4], peak = peaks[i % 4];
			struct error e[2];
			double least;
			measure_spots(both, &noises[k], sigma, peak, e, &least, &r);
			const double over = sqrt(e[0].square / least), plain_over = sqrt(e[1].square / least);
			printf("[ note ]   %.1f %3.0f  %.4f  %.2f (%.2f)  %.2f (%.2f)\n", sigma, peak, sqrt(least), over,
			       sqrt(e[0].bias / least), plain_over, sqrt(e[1].bias / least));
			assert_true(over < 1.2); /* the figure is 1.5 */
			assert_true(over > 0.9); /* or the bound is none */
			assert_true(plain_over < 2);
		}
	}
	bb_blob_finder_destroy(both[0]);
	bb_blob_finder_destroy(plain);
}

/* Where in a pixel a spot lies must not matter, nor how bright its surroundings are: rounding alone, dithered away. */
static void centres_are_not_drawn_to_pixels(void **state)
{
	static const double sigmas[] = { 0.8, 1.2, 2.0 }, backgrounds[] = { 4, 12.5 };
	struct scene_rng r = { .s = 12 };
	struct bb_blob_finder *f = make(bb_blobs_usual(), SIDE, SIDE);
	double worst = 0, case_worst[6] = { 0 };

	(void)state;
	for (int t = 0; t < 6 * 64; t++) {
		const int across = t % 8, down = t / 8 % 8;
		const struct spot s = { MIDDLE + across / 8.0 - 0.4375, MIDDLE + down / 8.0 - 0.4375, 200, sigmas[t / 64 % 3], backgrounds[t / 192] };
		double m[SIDE][SIDE], dx = 0, dy = 0;
		uint8_t grey[SIDE * SIDE];
		struct bb_spot found;
		draw_mean(&s, m);
		for (int k = 0; k < 32; k++) {
			for (int i = 0; i < SIDE * SIDE; i++)
				grey[i] = (uint8_t)(m[i / SIDE][i % SIDE] + scene_uniform(&r, 0, 1));
			assert_int_equal(bb_blobs_find(f, grey, SIDE, &found, 1).n, 1);
			assert_true(found.flags & BB_SPOT_REFINED);
			dx += (found.x_px - s.x) / 32;
			dy += (found.y_px - s.y) / 32;
		}
		case_worst[t / 64] = fmax(case_worst[t / 64], fmax(fabs(dx), fabs(dy)));
		worst = fmax(worst, case_worst[t / 64]);
	}
	for (int k = 0; k < 6; k++) {
		assert_true(sigmas[k % 3] < 1 || case_worst[k] < 0.0015);
		printf("[ note ] bias sigma %.1f, background %.1f: worst %.5f px\n", sigmas[k % 3], backgrounds[k / 3], case_worst[k]);
	}
	printf("[ note ] worst bias of a coordinate %.5f px\n", worst);
	assert_true(worst < 0.006);
	bb_blob_finder_destroy(f);
}

/* Parts by flood fill over 8 neighbours: slow and simple. */

struct heap {
	size_t area;
	double x, y, light;
	int peak;
	bool border;
};

static size_t flood(uint8_t *grey, int w, int h, int low, int x, int y, struct heap *a, int *stack)
{
	int n = 0;

	stack[n++] = y * w + x;
	*a = (struct heap){ 0 };
	double sx = 0, sy = 0;
	int level = grey[y * w + x];
	grey[y * w + x] = 0;
	stack[n - 1] |= level << 20;
	while (n) {
		const int at = stack[--n], px = (at & 0xfffff) % w, py = (at & 0xfffff) / w;
		level = at >> 20;
		const double v = level - low + 1;
		a->area++;
		a->light += v;
		sx += v * px;
		sy += v * py;
		a->peak = level > a->peak ? level : a->peak;
		a->border |= !px || !py || px == w - 1 || py == h - 1;
		for (int k = 0; k < 9; k++) {
			const int qx = px + k % 3 - 1, qy = py + k / 3 - 1;
			if (qx < 0 || qy < 0 || qx >= w || qy >= h || grey[qy * w + qx] < low)
				continue;
			stack[n++] = (qy * w + qx) | grey[qy * w + qx] << 20;
			grey[qy * w + qx] = 0;
		}
	}
	a->x = sx / a->light;
	a->y = sy / a->light;
	return a->area;
}

static void random_picture(struct scene_rng *r, uint8_t *grey, int w, int h, double density)
{
	for (int i = 0; i < w * h; i++)
		grey[i] = (uint8_t)(scene_uniform(r, 0, 1) < density ? scene_uniform(r, 14, 255) : scene_uniform(r, 0, 13));
}

static void parts_are_those_of_a_flood_fill(void **state)
{
	enum { W = 97, H = 61 };
	static uint8_t grey[W * H], copy[W * H];
	static int stack[W * H];
	static struct bb_spot spots[W * H];
	static struct heap heaps[W * H];
	struct scene_rng r = { .s = 4 };
	struct bb_blobs_config c = ungated();
	size_t all = 0;

	(void)state;
	c.refine = false;
	struct bb_blob_finder *f = make(c, W, H);
	for (int t = 0; t < 150; t++) {
		random_picture(&r, grey, W, H, 0.02 + 0.5 * (t % 25) / 25);
		memcpy(copy, grey, sizeof(copy));
		size_t n = 0;
		for (int i = 0; i < W * H; i++)
			if (copy[i] >= c.low) {
				flood(copy, W, H, c.low, i % W, i / W, &heaps[n], stack);
				n += !heaps[n].border && heaps[n].peak >= c.high;
			}
		const struct bb_blobs_found found = bb_blobs_find(f, grey, W, spots, W * H);
		assert_false(found.overflow);
		assert_int_equal(found.n, n);
		for (size_t k = 0; k < n; k++) {
			size_t i = 0;
			while (i < n && !(spots[i].area_px == (double)heaps[k].area && fabs(spots[i].x_px - heaps[k].x) < 1e-9 &&
			                  fabs(spots[i].y_px - heaps[k].y) < 1e-9 && fabs(spots[i].light - heaps[k].light) < 0.5 &&
			                  spots[i].peak == heaps[k].peak))
				i++;
			assert_true(i < n);
		}
		all += n;
	}
	assert_true(all > 5000);
	bb_blob_finder_destroy(f);
}

static void every_kernel_finds_the_same_bytes(void **state)
{
	enum { W = 700, H = 40 };
	static uint8_t grey[W * H];
	static struct bb_spot spots[3][4096];
	struct scene_rng r = { .s = 5 };
	int compared = 0;

	(void)state;
	for (int t = 0; t < 120; t++) {
		const int64_t width = 1 + (int64_t)scene_uniform(&r, 0, 640), stride = width + (t % 3 ? t % 60 : 0);
		struct bb_blobs_found found[3] = { { 0 } };
		memset(spots, 0, sizeof(spots));
		random_picture(&r, grey, W, H, t % 2 ? 0.004 : 0.1);
		for (int k = 0; k < 3; k++) {
			struct bb_blobs_config c = ungated();
			c.low = 14 + (t * 7) % 200;
			c.high = c.low + 5;
			c.kernel = kernels[k];
			struct bb_blob_finder *f = make(c, width, H);
			if (!f)
				continue;
			assert_string_equal(bb_blob_finder_kernel(f), kernels[k]);
			found[k] = bb_blobs_find(f, grey, (size_t)stride, spots[k], 4096);
			bb_blob_finder_destroy(f);
			assert_memory_equal(&found[k], &found[0], sizeof(found[0]));
			assert_memory_equal(spots[k], spots[0], sizeof(spots[0]));
			compared += k > 0;
		}
	}
	printf("[ note ] %d comparisons\n", compared);
}

static bool scan_holds(bb_blobs_scan_fn *scan, const uint8_t *p, size_t n, int low)
{
	for (size_t from = 0; from <= n; from += 1 + from / 7) {
		size_t i = from;
		while (i < n && p[i] < low)
			i++;
		if (scan(p, from, n, low) != i)
			return false;
	}
	return true;
}

/* Every level against every threshold, in rows that end where memory ends. */
static void scans_find_the_first_bright_pixel(void **state)
{
	static bb_blobs_scan_fn *const scans[] = { bb_blobs_scan_portable, bb_blobs_scan_avx2, bb_blobs_scan_avx512 };
	struct scene_rng r = { .s = 6 };

	(void)state;
	for (int k = 0; k < 3; k++) {
		struct bb_blobs_config c = bb_blobs_usual();
		c.kernel = kernels[k];
		struct bb_blob_finder *f = make(c, 8, 8);
		if (!f)
			continue;
		bb_blob_finder_destroy(f);
		for (int low = 1; low < 256; low++)
			for (int level = low - 1; level <= low; level++) {
				const size_t n = 1 + (size_t)(low * 5 + level) % 700;
				uint8_t *row = malloc(n);
				assert_non_null(row);
				memset(row, low - 1, n);
				row[(size_t)scene_uniform(&r, 0, (double)n - 1e-9)] = (uint8_t)level;
				assert_true(scan_holds(scans[k], row, n, low));
				row[n - 1] = 255;
				assert_true(scan_holds(scans[k], row, n, low));
				free(row);
			}
	}
}

/* Gates and flags */

static void disc(uint8_t *grey, int w, int h, double cx, double cy, double rx, double ry, int level)
{
	for (int j = 0; j < h; j++)
		for (int i = 0; i < w; i++)
			if (pow((i - cx) / rx, 2) + pow((j - cy) / ry, 2) < 1)
				grey[j * w + i] = (uint8_t)level;
}

static struct bb_blobs_found look(const struct bb_blobs_config *c, const uint8_t *grey, int w, int h,
                                  struct bb_spot out[256])
{
	struct bb_blob_finder *f = make(*c, w, h);
	const struct bb_blobs_found found = bb_blobs_find(f, grey, (size_t)w, out, 256);

	bb_blob_finder_destroy(f);
	return found;
}

static void gates_and_flags_do_what_they_say(void **state)
{
	enum { W = 160, H = 120 };
	static uint8_t grey[W * H];
	static struct bb_spot out[256];
	struct bb_blobs_config c = bb_blobs_usual();

	(void)state;
	memset(grey, 4, sizeof(grey));
	disc(grey, W, H, 20, 20, 3, 3, 120);    /* good */
	disc(grey, W, H, 60, 20, 3, 3, 255);    /* saturated */
	disc(grey, W, H, 100, 20, 9, 2, 120);   /* a streak */
	disc(grey, W, H, 20, 60, 3, 3, 27);     /* never reaches high */
	disc(grey, W, H, 60, 60, 30, 29, 90);   /* larger than a spot */
	disc(grey, W, H, 120, 60, 1.1, 0.9, 99); /* smaller than one */
	disc(grey, W, H, 0, 100, 4, 4, 120);    /* cut by the border */
	disc(grey, W, H, 150, 119, 4, 4, 120);
	const struct bb_blobs_found found = look(&c, grey, W, H, out);
	assert_int_equal(found.n, 2);
	assert_int_equal(found.refused, 6);
	assert_int_equal(out[0].flags, BB_SPOT_REFINED);
	assert_int_equal(out[1].flags, BB_SPOT_SATURATED);
	assert_true(fabs(out[0].x_px - 20) < 1e-6 && fabs(out[0].y_px - 20) < 1e-6 && out[0].peak == 120);
	assert_true(fabs(out[1].x_px - 60) < 1e-9 && out[0].roundness > 0.99);
	c.least_roundness = 0;
	c.high = c.low;
	c.least_area_px = 1;
	c.most_area_px = 4000;
	assert_int_equal(look(&c, grey, W, H, out).n, 6); /* those at the border never */
	/* One that leaves a finger in the other's surroundings is not refined. */
	memset(grey, 4, sizeof(grey));
	disc(grey, W, H, 20, 20, 3, 3, 120);
	disc(grey, W, H, 26, 20, 3, 3, 60);
	assert_int_equal(look(&c, grey, W, H, out).n, 2);
	assert_int_equal(out[0].flags | out[1].flags, 0);
}

/* Round discs under a Gaussian, as markers are: the step is made for Gaussians and must not spoil these. */
static void discs_keep_their_centres(void **state)
{
	struct bb_blobs_config c = bb_blobs_usual();
	static uint8_t grey[SIDE * SIDE];
	struct bb_spot out[4];
	double worst = 0;

	(void)state;
	struct bb_blob_finder *f = make(c, SIDE, SIDE);
	for (int t = 0; t < 400; t += 3) {
		const int across = t % 20, down = t / 20;
		const double radius = 1 + (t % 5), cx = MIDDLE + across / 20.0 - 0.5, cy = MIDDLE + down / 20.0 - 0.5;
		double m[SIDE][SIDE] = { { 0 } };
		for (int k = 0; k < 400; k++) { /* points spread evenly over the disc */
			const double rr = radius * sqrt((k + 0.5) / 400), a = 2.399963229728653 * k;
			for (int j = 0; j < SIDE; j++)
				for (int i = 0; i < SIDE; i++)
					if (fabs(i - cx) < 9 && fabs(j - cy) < 9)
						m[j][i] += share(i, cx + rr * cos(a), 0.8) * share(j, cy + rr * sin(a), 0.8);
		}
		double peak = 0;
		for (int i = 0; i < SIDE * SIDE; i++)
			peak = fmax(peak, m[i / SIDE][i % SIDE]);
		for (int i = 0; i < SIDE * SIDE; i++)
			grey[i] = (uint8_t)rint(BLACK + 150 * m[i / SIDE][i % SIDE] / peak);
		assert_int_equal(bb_blobs_find(f, grey, SIDE, out, 4).n, 1);
		worst = fmax(worst, hypot(out[0].x_px - cx, out[0].y_px - cy));
	}
	printf("[ note ] discs of 2 to 10 px across, no noise: worst %.4f px\n", worst);
	assert_true(worst < 0.02);
	bb_blob_finder_destroy(f);
}

/* Pictures made to cost much: at most so many runs are followed, and what was left is said. */
static void floods_are_bounded_and_said(void **state)
{
	enum { W = 640, H = 480 };
	static uint8_t grey[W * H];
	static struct bb_spot out[512];
	struct bb_blobs_config c = bb_blobs_usual();
	struct scene_rng r = { .s = 8 };

	(void)state;
	struct bb_blob_finder *f = make(c, W, H);
	memset(grey, 255, sizeof(grey)); /* white: one part, a run a row */
	struct bb_blobs_found found = bb_blobs_find(f, grey, W, out, 512);
	assert_true(found.n == 0 && found.runs == H && found.refused == 1 && !found.overflow);
	for (int i = 0; i < W * H; i++) /* a chessboard: all corners touch */
		grey[i] = (i % W + i / W) % 2 ? 200 : 0;
	found = bb_blobs_find(f, grey, W, out, 512);
	assert_true(found.overflow && found.n == 0 && found.runs == c.most_runs);
	for (int i = 0; i < W * H; i++) /* a comb: a part each column */
		grey[i] = i % 2 ? 200 : 0;
	found = bb_blobs_find(f, grey, W, out, 512);
	assert_true(found.overflow && found.n == 0);
	for (int i = 0; i < W * H; i++) /* more good spots than are wanted */
		grey[i] = i % W % 10 < 3 && i / W % 10 < 3 && i % W > 9 && i / W > 9 ? 200 : 0;
	found = bb_blobs_find(f, grey, W, out, 512);
	assert_true(found.overflow && found.n == c.most_spots);
	assert_int_equal(bb_blobs_find(f, grey, W, out, 7).n, 7); /* or than there is room for */
	random_picture(&r, grey, W, H, 0.3);
	found = bb_blobs_find(f, grey, W, out, 512);
	assert_true(found.overflow && found.runs <= c.most_runs);
	memset(grey, 0, sizeof(grey)); /* and the next picture is as if nothing had been */
	disc(grey, W, H, 300, 200, 3, 3, 99);
	found = bb_blobs_find(f, grey, W, out, 512);
	assert_true(!found.overflow && found.n == 1 && found.refused == 0);
	bb_blob_finder_destroy(f);
}

static void nonsense_is_refused(void **state)
{
	struct bb_blobs_config bad[9];
	struct bb_blob_finder *f;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		bad[i] = bb_blobs_usual();
	bad[0].low = 0;
	bad[1].high = bad[1].low - 1;
	bad[2].high = 256;
	bad[3].black = (double)NAN;
	bad[4].least_area_px = -1;
	bad[5].most_area_px = (double)INFINITY;
	bad[6].least_roundness = 1.01;
	bad[7].most_spots = 0;
	bad[8].most_runs = 0;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_int_equal(bb_blob_finder_create(&bad[i], 64, 64, &f), BB_ERR_RANGE);
	const struct bb_blobs_config good = bb_blobs_usual();
	assert_int_equal(bb_blob_finder_create(&good, 0, 64, &f), BB_ERR_RANGE);
	assert_int_equal(bb_blob_finder_create(&good, 64, BB_BLOBS_EDGE_MAX + 1, &f), BB_ERR_RANGE);
	/* Thresholds of another camera: the usual one's are the usual ones; past white there are none. */
	const struct bb_blobs_config same = bb_blobs_above(4, 1), grey = bb_blobs_above(40.5, 10);
	assert_true(same.low == good.low && same.high == good.high);
	assert_true(grey.low == 71 && grey.high == 101);
	const struct bb_blobs_config past[] = { bb_blobs_above(232, 1), bb_blobs_above(4, 42), bb_blobs_above((double)NAN, 1),
		                                bb_blobs_above(4, (double)INFINITY), bb_blobs_above(-30, 1) };
	for (size_t i = 0; i < BB_ARRAY_LEN(past); i++)
		assert_int_equal(bb_blob_finder_create(&past[i], 64, 64, &f), BB_ERR_RANGE);
	struct bb_blobs_config other = good;
	other.kernel = "abacus";
	assert_int_equal(bb_blob_finder_create(&other, 64, 64, &f), BB_ERR_UNSUPPORTED);
	assert_null(f);
	bb_blob_finder_destroy(NULL);
	struct bb_spot out[2];
	uint8_t one = 255;
	struct bb_blob_finder *least = make(good, 1, 1);
	assert_int_equal(bb_blobs_find(least, &one, 1, out, 2).n, 0);
	bb_blob_finder_destroy(least);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(centres_come_near_the_bound),
		cmocka_unit_test(centres_are_not_drawn_to_pixels),
		cmocka_unit_test(parts_are_those_of_a_flood_fill),
		cmocka_unit_test(every_kernel_finds_the_same_bytes),
		cmocka_unit_test(scans_find_the_first_bright_pixel),
		cmocka_unit_test(gates_and_flags_do_what_they_say),
		cmocka_unit_test(discs_keep_their_centres),
		cmocka_unit_test(floods_are_bounded_and_said),
		cmocka_unit_test(nonsense_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
