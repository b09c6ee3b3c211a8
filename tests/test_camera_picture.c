/*
 * tests/test_camera_picture.c: what a rendered picture shows, against light summed point by point, against the noise it
 * states, and what faults and options do to a camera's pictures.
 */
#include "tests/fixture_room.h"
#include "sim/camera/lights.h"
#include "sim/sim_camera.h"
#include "sync/blobs/blobs.h"

#define W 64
#define H 48
#define PI 3.14159265358979323846

static const struct sim_sensor clean = { .psf_px = 0.8, .read_noise = 0, .full_well_e = 1e9, .black = 0, .sun_px = 30 };

static void draw(const struct sim_sensor *s, const struct sim_light *l, size_t n, double sun, uint64_t seed,
                 uint8_t grey[W * H])
{
	struct sim_picture *p;
	struct sim_rng rng;

	assert_int_equal(sim_picture_create(s, W, H, &p), BB_OK);
	sim_rng_seed(&rng, seed, "test", "picture");
	sim_picture_draw(p, l, n, sun, &rng, grey);
	sim_picture_destroy(p);
}

/* Levels by adding blurred points: 300 over the disc at each of 24 places on the way, 5 x 5 over each pixel. */
static void by_points(const struct sim_light *l, double psf, double level[H][W])
{
	for (int k = 0; k < 300 * 24; k++) {
		const double r = l->radius_px * sqrt((k % 300 + 0.5) / 300), a = 2.399963229728653 * (k % 300);
		const int step = k / 300;
		const double t = (step + 0.5) / 24;
		const double x = l->x0_px + t * (l->x1_px - l->x0_px) + r * cos(a), y = l->y0_px + t * (l->y1_px - l->y0_px) + r * sin(a);
		for (int p = 0; p < 11 * 11 * 25; p++) {
			const int px = (int)x - 5 + p / 25 % 11, py = (int)y - 5 + p / 275;
			const double dx = px - 0.4 + 0.2 * (p % 5) - x, dy = py - 0.4 + 0.2 * (p / 5 % 5) - y;
			if (px >= 0 && py >= 0 && px < W && py < H)
				level[py][px] += l->grey * exp(-(dx * dx + dy * dy) / (2 * psf * psf)) / 25 * l->radius_px * l->radius_px /
				                 (2 * psf * psf) / (300 * 24);
		}
	}
}

static void light_falls_where_it_should(void **state)
{
	static const struct sim_light lights[] = { { 30.3, 20.7, 30.3, 20.7, 1.7, 200, 0, false },
		                                   { 20.1, 25.2, 23.4, 24.1, 3.2, 180, 0, false },
		                                   { 1.2, 40.6, 1.2, 40.6, 2.5, 150, 0, false } };
	static uint8_t grey[W * H];

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(lights); i++) {
		double worst = 0, light = 0, level[H][W] = { { 0 } };
		by_points(&lights[i], clean.psf_px, level);
		draw(&clean, &lights[i], 1, 0, 1, grey);
		for (int y = 0; y < H; y++)
			for (int x = 0; x < W; x++) {
				worst = fmax(worst, fabs(grey[y * W + x] - level[y][x]));
				light += grey[y * W + x];
			}
		printf("[ note ] light %zu: worst level off by %.2f of %g, all of it %.3f times the disc's\n", i, worst,
		       lights[i].grey, light / (lights[i].grey * PI * lights[i].radius_px * lights[i].radius_px));
		assert_true(worst < 2.5); /* half a level is rounding, the rest that points are few */
	}
}

static void half_hidden_is_half_as_bright_and_aside(void **state)
{
	struct sim_light l = { 30, 20, 30, 20, 3, 200, 0, false };
	static uint8_t grey[W * H];
	double all[2] = { 0 }, x[2] = { 0 };

	(void)state;
	for (unsigned i = 0; i < SIM_DISC_POINTS; i++) {
		double px, py;
		sim_disc_point(i, &px, &py);
		l.hidden |= (uint32_t)(px < 0) << i;
	}
	for (int k = 0; k < 2; k++) {
		draw(&clean, &l, 1, 0, 1, grey);
		for (int i = 0; i < W * H; i++) {
			all[k] += grey[i];
			x[k] += grey[i] * (i % W);
		}
		l.hidden = 0;
	}
	assert_true(fabs(all[0] / all[1] - 0.5) < 0.05);
	assert_true(fabs(x[0] / all[0] - 30 - 4 * 3 / (3 * PI)) < 0.15); /* centre of a half disc */
	assert_true(fabs(x[1] / all[1] - 30) < 0.01);
}

static void moments(const uint8_t *grey, size_t n, double *mean, double *variance)
{
	double sum = 0, square = 0;

	for (size_t i = 0; i < n; i++) {
		sum += grey[i];
		square += (double)grey[i] * grey[i];
	}
	*mean = sum / (double)n;
	*variance = square / (double)n - *mean * *mean;
}

static void noise_is_what_is_stated(void **state)
{
	struct sim_sensor s = { .psf_px = 0.8, .read_noise = 1.5, .full_well_e = 10000, .black = 20.3, .sun_x = 0.5, .sun_y = 0.5,
		                .sun_px = 1e6 }; /* a sun as wide as this is an even sky */
	static uint8_t grey[40][W * H];
	double mean, variance;

	(void)state;
	for (int i = 0; i < 40; i++)
		draw(&s, NULL, 0, 0, (uint64_t)i, grey[i]);
	moments(grey[0], sizeof(grey), &mean, &variance);
	printf("[ note ] dark: %.3f, variance %.3f\n", mean, variance);
	assert_true(fabs(mean - 20.3) < 0.03 && fabs(variance - (1.5 * 1.5 + 1.0 / 12)) < 0.05);
	for (int i = 0; i < 40; i++)
		draw(&s, NULL, 0, 100, (uint64_t)i, grey[i]);
	moments(grey[0], sizeof(grey), &mean, &variance);
	printf("[ note ] at 100 levels: %.3f, variance %.3f\n", mean, variance);
	assert_true(fabs(mean - 120.3) < 0.05);
	assert_true(fabs(variance - (1.5 * 1.5 + 1.0 / 12 + 100 * (255 - 20.3) / 10000)) < 0.1);
	for (int i = 0; i < 40; i++)
		draw(&s, NULL, 0, 1000, (uint64_t)i, grey[i]);
	moments(grey[0], sizeof(grey), &mean, &variance);
	assert_true(mean >= 255 && variance <= 0); /* clipped, not wrapped */
	s.black = 1;
	draw(&s, NULL, 0, 0, 7, grey[0]);
	moments(grey[0], sizeof(grey[0]), &mean, &variance);
	assert_true(mean > 1 && mean < 1.5); /* clipped at 0 */
}

static void same_seed_same_bytes(void **state)
{
	static const struct sim_sensor s = { .psf_px = 0.8, .read_noise = 1, .full_well_e = 10000, .black = 4, .sun_px = 5 };
	static const struct sim_light l = { 30, 20, 31, 20, 2, 200, 0, false };
	static uint8_t a[W * H], b[W * H];

	(void)state;
	draw(&s, &l, 1, 50, 3, a);
	draw(&s, &l, 1, 50, 3, b);
	assert_memory_equal(a, b, sizeof(a));
	draw(&s, &l, 1, 50, 4, b);
	assert_true(memcmp(a, b, sizeof(a)));
	struct sim_picture *p;
	struct sim_sensor bad = s;
	bad.psf_px = (double)NAN;
	assert_int_equal(sim_picture_create(&bad, W, H, &p), BB_ERR_RANGE);
	assert_int_equal(sim_picture_create(&s, 0, H, &p), BB_ERR_RANGE);
	sim_picture_destroy(NULL);
}

/* A camera of the fixture room, and its pictures. */

struct eye {
	struct rig rig;
	struct bb_camera *cam;
	struct bb_camera_frame frame;
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	uint8_t grey[640 * 480];
	struct bb_spot spot[256];
	struct bb_blobs_found found;
};

static struct bb_pose gliding(void *ctx, int64_t t_ns) /* 1.5 m/s to the right */
{
	(void)ctx;
	return (struct bb_pose){ { 1.5e-9 * (double)t_ns, 1.6, 0 }, BB_QUAT_IDENTITY };
}

static struct eye *open_eye(const char *key, const char *value, struct bb_pose (*head)(void *, int64_t))
{
	struct eye *e = calloc(1, sizeof(*e));

	assert_non_null(e);
	rig_init(&e->rig, 5, 2);
	e->rig.fix.cameras[0].k1 = e->rig.fix.cameras[0].k2 = 0;
	if (head)
		sim_world_set_head_fn(e->rig.world, head, NULL);
	if (key)
		rig_option(&e->rig, key, value);
	e->cam = rig_camera(&e->rig, 0);
	e->frame = (struct bb_camera_frame){ .blobs = e->blobs, .cap = BB_CAMERA_BLOBS_MAX, .grey = e->grey };
	assert_true(bb_camera_limits(e->cam)->grey);
	assert_int_equal(bb_camera_start(e->cam), BB_OK);
	return e;
}

static void close_eye(struct eye *e)
{
	bb_camera_close(e->cam);
	rig_done(&e->rig);
	free(e);
}

static void next_picture(struct eye *e)
{
	const struct bb_blobs_config usual = bb_blobs_usual();
	struct bb_blob_finder *f;
	enum bb_status status;

	while ((status = bb_camera_read(e->cam, &e->frame)) == BB_TIMEOUT)
		rig_run(&e->rig, 100 * US);
	assert_int_equal(status, BB_OK);
	assert_true(e->frame.has_grey && e->frame.n == 0);
	assert_int_equal(bb_blob_finder_create(&usual, 640, 480, &f), BB_OK);
	e->found = bb_blobs_find(f, e->grey, 640, e->spot, 256);
	bb_blob_finder_destroy(f);
}

static void a_camera_shows_markers_or_its_own_blobs(void **state)
{
	struct eye *e = open_eye(NULL, NULL, NULL);

	(void)state;
	next_picture(e);
	assert_int_equal(e->found.n, 4); /* two of five lie 2 px apart */
	e->frame.grey = NULL; /* nobody wants a picture: it says what it would find */
	while (bb_camera_read(e->cam, &e->frame) == BB_TIMEOUT)
		rig_run(&e->rig, 100 * US);
	assert_true(!e->frame.has_grey && e->frame.n == 4);
	for (size_t i = 0; i < 4; i++) {
		size_t k = 0;
		while (k < 4 && hypot(e->spot[k].x_px - (double)e->blobs[i].x_px, e->spot[k].y_px - (double)e->blobs[i].y_px) > 0.5)
			k++;
		assert_true(k < 4);
	}
	close_eye(e);
}

static void faults_show_in_pictures(void **state)
{
	struct eye *e = open_eye(NULL, NULL, NULL);
	uint8_t *const before = malloc(sizeof(e->grey));

	(void)state;
	assert_non_null(before);
	rig_fault(&e->rig, "camera/c1", "cover", true);
	next_picture(e);
	assert_int_equal(e->found.n, 0);
	rig_fault(&e->rig, "camera/c1", "sun grey=900", true);
	next_picture(e);
	assert_int_equal(e->found.runs, 0); /* the cover is before the sun, too */
	rig_fault(&e->rig, "camera/c1", "cover", false);
	next_picture(e);
	assert_true(e->found.runs > 100 && e->found.refused >= 1); /* too large for a spot */
	assert_true(e->found.n >= 3 && e->found.n <= 8);
	rig_fault(&e->rig, "camera/c1", "sun grey=900", false);
	rig_fault(&e->rig, "camera/c1", "flood n=40", true);
	next_picture(e);
	assert_true(e->found.n > 30);
	rig_fault(&e->rig, "camera/c1", "flood n=40", false);
	rig_fault(&e->rig, "camera/c1", "freeze", true);
	next_picture(e);
	memcpy(before, e->grey, sizeof(e->grey));
	next_picture(e);
	assert_memory_equal(before, e->grey, sizeof(e->grey)); /* noise and all */
	rig_fault(&e->rig, "camera/c1", "freeze", false);
	next_picture(e);
	assert_true(memcmp(before, e->grey, sizeof(e->grey)));
	free(before);
	close_eye(e);
}

static void a_polished_floor_shows_ghosts(void **state)
{
	struct eye *e = open_eye("marker_grey", "3000", NULL); /* the way is long */
	size_t blobs = 0;

	(void)state;
	bb_camera_close(e->cam);
	e->rig.fix.cameras[0] = fixture_camera("c1", (struct bb_vec3){ -1.2, 2.4, -1.2 }, (struct bb_vec3){ 0, 0, 0 });
	e->cam = rig_camera(&e->rig, 0);
	assert_int_equal(bb_camera_start(e->cam), BB_OK);
	next_picture(e);
	assert_int_equal(e->found.n, 0); /* it looks at the floor */
	rig_fault(&e->rig, "camera/c1", "mirror percent=50", true);
	next_picture(e);
	assert_true(e->found.n >= 3 && e->found.n <= 5);
	e->frame.grey = NULL; /* without pictures a ghost is there in as many frames as it is bright */
	for (int i = 0; i < 100; i++) {
		while (bb_camera_read(e->cam, &e->frame) == BB_TIMEOUT)
			rig_run(&e->rig, 100 * US);
		blobs += e->frame.n;
	}
	assert_true(blobs > 105 && blobs < 325); /* of 300 to 500, half */
	close_eye(e);
}

/* Where the lens puts marker m at a time. */
static struct bb_vec3 marker_px(const struct eye *e, size_t m, int64_t at_ns)
{
	const struct bb_camera_config *c = &e->rig.fix.cameras[0];
	struct bb_vec3 marker[8];
	double px[2];

	assert_true(sim_world_markers(e->rig.world, at_ns, marker, 8) > m);
	assert_true(sim_camera_pixel(c, bb_pose_inverse_apply(&c->pose, marker[m]), px));
	return (struct bb_vec3){ px[0], px[1], 0 };
}

/* The first exposure: begins 500 us after an edge and takes 800. */
static int64_t first_mid_ns(const struct eye *e)
{
	const struct bb_rate rate = e->rig.fix.cameras[0].rate;
	const int64_t k = sim_world_reference_after(e->rig.world, rate, 1 - 500 * US);

	return sim_world_reference_ns(e->rig.world, rate, k) + 500 * US + 400 * US;
}

static double nearest_px(const struct eye *e, struct bb_vec3 at)
{
	double best = 1e9;

	for (size_t i = 0; i < e->found.n; i++)
		best = fmin(best, hypot(e->spot[i].x_px - at.x, e->spot[i].y_px - at.y));
	return best;
}

static struct bb_pose turning(void *ctx, int64_t t_ns) /* a turn in 10 s */
{
	(void)ctx;
	return (struct bb_pose){ { 0, 1.6, 0 }, bb_quat_euler_deg(36e-9 * (double)t_ns, 0, 0) };
}

static void markers_at_the_limb_are_sickles(void **state)
{
	const struct sim_lamp lamp = { .marker_mm = 12, .marker_grey = 200, .lamp_m = 2, .lamp_ns = 1000000 };
	size_t whole = 0, partly = 0, gone = 0;
	struct rig r;

	(void)state;
	rig_init(&r, 5, 2);
	sim_world_set_head_fn(r.world, turning, NULL);
	for (int64_t t = 0; t < 1000; t++) {
		const struct sim_eye eye = { .world = r.world, .config = &r.fix.cameras[0], .lamp = &lamp,
			                     .pose = r.fix.cameras[0].pose, .mid_ns = t * 10 * MS, .exposure_ns = 1000000 };
		struct sim_light light[8];
		size_t n;
		assert_true(sim_lights_see(&eye, light, 8, &n));
		assert_true(n <= 5);
		gone += 5 - n;
		for (size_t i = 0; i < n; i++) {
			assert_true(light[i].hidden != (1u << SIM_DISC_POINTS) - 1);
			*(light[i].hidden ? &partly : &whole) += 1;
		}
	}
	printf("[ note ] markers of a turning head: %zu whole, %zu partly hidden, %zu not to be seen\n", whole, partly, gone);
	assert_true(whole > 2000 && partly > 50 && gone > 300);
	rig_done(&r);
}

static void rows_of_a_rolling_shutter_see_later(void **state)
{
	struct eye *global = open_eye(NULL, NULL, gliding), *rolling = open_eye("row_us", "100", gliding);
	struct eye *blobs = open_eye("row_us", "100", gliding);

	(void)state;
	blobs->frame.grey = NULL; /* it looks for them itself */
	while (bb_camera_read(blobs->cam, &blobs->frame) == BB_TIMEOUT)
		rig_run(&blobs->rig, 100 * US);
	next_picture(global);
	next_picture(rolling);
	const int64_t mid_ns = first_mid_ns(global);
	for (size_t m = 0; m < 4; m += m ? 1 : 2) { /* 1 and 4 are one spot */
		const struct bb_vec3 at = marker_px(global, m, mid_ns);
		const int64_t late_ns = llround((at.y - 239.5) * 100e3);
		const struct bb_vec3 then = marker_px(rolling, m, mid_ns + late_ns);
		assert_true(hypot(then.x - at.x, then.y - at.y) > 0.2); /* there is something to see */
		assert_true(nearest_px(global, at) < 0.06);
		assert_true(nearest_px(rolling, then) < 0.06);
		double best = 1e9;
		for (size_t i = 0; i < blobs->frame.n; i++)
			best = fmin(best, hypot((double)blobs->blobs[i].x_px - then.x, (double)blobs->blobs[i].y_px - then.y));
		assert_true(best < 0.06);
	}
	close_eye(global);
	close_eye(rolling);
	close_eye(blobs);
}

static void long_exposures_smear_and_keep_the_middle(void **state)
{
	struct eye *e = open_eye("psf_px", "0.6", gliding);

	(void)state;
	assert_int_equal(bb_camera_set_exposure(e->cam, 8 * MS, 500 * US), BB_OK);
	next_picture(e);
	const struct bb_rate rate = e->rig.fix.cameras[0].rate;
	const int64_t k = sim_world_reference_after(e->rig.world, rate, 1 - 500 * US);
	const int64_t mid_ns = sim_world_reference_ns(e->rig.world, rate, k) + 500 * US + 4 * MS;
	const struct bb_vec3 at = marker_px(e, 2, mid_ns);
	size_t best = 0;
	for (size_t i = 1; i < e->found.n; i++)
		if (hypot(e->spot[i].x_px - at.x, e->spot[i].y_px - at.y) < hypot(e->spot[best].x_px - at.x, e->spot[best].y_px - at.y))
			best = i;
	assert_true(hypot(e->spot[best].x_px - at.x, e->spot[best].y_px - at.y) < 0.06);
	assert_true(e->spot[best].roundness < 0.95);
	close_eye(e);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(light_falls_where_it_should),
		cmocka_unit_test(half_hidden_is_half_as_bright_and_aside),
		cmocka_unit_test(noise_is_what_is_stated),
		cmocka_unit_test(same_seed_same_bytes),
		cmocka_unit_test(a_camera_shows_markers_or_its_own_blobs),
		cmocka_unit_test(faults_show_in_pictures),
		cmocka_unit_test(a_polished_floor_shows_ghosts),
		cmocka_unit_test(markers_at_the_limb_are_sickles),
		cmocka_unit_test(rows_of_a_rolling_shutter_see_later),
		cmocka_unit_test(long_exposures_smear_and_keep_the_middle),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
