/*
 * tests/test_calibrate.c: calibration of cameras: derivatives, labels, the adjustment against truth, what it must find and
 * what it must refuse, the sequence file, the room's side file, touched corners.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>

#include "bench/calibrate/tell.h"
#include "sync/calibrate/label.h"
#include "sync/calibrate/touch.h"
#include "tests/room_text.h"
#include "tests/track_scene.h"

static struct bb_room *room_of(const char *path)
{
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;

	if (bb_room_load(path, &room, &err))
		print_error("%s\n", err.text);
	assert_non_null(room);
	return room;
}

/* --- the adjustment ----------------------------------------------------------------------------------------------- */

static void derivatives_are_differences(void **state)
{
	struct scene_rng r = { .s = 21 };
	double worst = 0;

	(void)state;
	for (int round = 0; round < 400; round++) {
		struct bb_camera_config c = scene_camera((struct bb_vec3){ 2, 2, 1 }, (struct bb_vec3){ 0, 1, 0 }, 832, 640,
		                                         scene_uniform(&r, 40, 90), -0.1, 0.02);
		struct bb_bundle b = { .cameras = &c, .n_cameras = 1, .along_m = { -0.18, -0.03, 0.21 } };
		struct bb_rod rod = { .p = { scene_uniform(&r, -0.5, 0.5), scene_uniform(&r, 0.6, 1.5), scene_uniform(&r, -0.5, 0.5) } };
		const unsigned marker = (unsigned)round % 3;
		double px[2], jc[2][BB_BUNDLE_CAMERA], jr[2][BB_BUNDLE_ROD];

		c.lens = round & 1 ? BB_LENS_FISHEYE : BB_LENS_BROWN;
		c.p1 = round & 1 ? 0 : 0.001;
		rod.u = bb_quat_rotate(scene_any_turn(&r), (struct bb_vec3){ 1, 0, 0 });
		assert_true(bb_bundle_derive(&b, 0, &rod, marker, px, jc, jr));
		for (int k = 0; k < BB_BUNDLE_CAMERA + BB_BUNDLE_ROD; k++) {
			const struct bb_camera_config keep = c;
			const double h = k == 0 ? 1e-3 : 1e-6;
			double ahead[2], behind[2], unused_c[2][BB_BUNDLE_CAMERA], unused_r[2][BB_BUNDLE_ROD];
			for (int side = 0; side < 2; side++) {
				double dc[BB_BUNDLE_CAMERA] = { 0 }, dr[BB_BUNDLE_ROD] = { 0 };
				struct bb_rod moved = rod;
				*(k < BB_BUNDLE_CAMERA ? &dc[k] : &dr[k - BB_BUNDLE_CAMERA]) = side ? -h : h;
				bb_bundle_move_camera(&c, dc);
				bb_bundle_move_rod(&moved, dr);
				assert_true(bb_bundle_derive(&b, 0, &moved, marker, side ? behind : ahead, unused_c, unused_r));
				c = keep;
			}
			for (int i = 0; i < 2; i++) {
				const double want = k < BB_BUNDLE_CAMERA ? jc[i][k] : jr[i][k - BB_BUNDLE_CAMERA];
				worst = fmax(worst, fabs((ahead[i] - behind[i]) / (2 * h) - want) / (1 + fabs(want)));
			}
		}
	}
	print_message("[ note ] worst relative difference %.1e\n", worst);
	assert_true(worst < 1e-6);
}

struct outcome {
	struct bb_room *room;
	struct bb_dance dance;
	struct bb_calibration c;
	struct bb_calibrate_outcome o;
};

static enum bb_status calibrate(struct outcome *out, const struct bb_dance_config *dance, struct bb_error *err)
{
	out->room = (struct bb_room *)(uintptr_t)dance->room;
	assert_int_equal(bb_dance_make(dance, &out->dance), BB_OK);
	const struct bb_calibrate_config config = { .cameras = out->room->cameras, .n_cameras = out->dance.n_cameras,
		                                    .sequence = &out->dance.sequence };
	const enum bb_status status = bb_calibrate(&config, &out->c, err);
	out->o = (struct bb_calibrate_outcome){ .room = out->room, .planned = out->room->cameras, .calibration = &out->c,
		                                .sequence = &out->dance.sequence, .dance = &out->dance,
		                                .noise_px = dance->noise_px };
	if (!status)
		bb_calibrate_judge(&out->o);
	return status;
}

static void done(struct outcome *out)
{
	bb_calibration_free(&out->c);
	bb_dance_free(&out->dance);
}

/* Half a minute in the cabin, cameras up to 0.5 m and 6 degrees from their plan, a tenth of all markers wrong. */
static void cameras_are_found(void **state)
{
	struct bb_room *room = room_of("rooms/cabin.yaml");

	(void)state;
	for (int knocked = -1; knocked < 8; knocked += 3) {
		const struct bb_dance_config dance = { .room = room, .seconds = 36, .rate_hz = 50, .noise_px = 0.1,
			                               .outlier_share = 0.1, .knocked = knocked, .seed = (uint64_t)(40 + knocked) };
		struct bb_error err = { 0 };
		struct outcome out;

		assert_int_equal(calibrate(&out, &dance, &err), BB_OK);
		print_message("[ note ] knocked %d: %.3f mm, %.4f deg, %.4f px; %zu of %zu outliers\n", knocked, 1e3 * out.o.worst_m,
		              out.o.worst_deg, out.c.rms_px, out.o.n_found, out.o.n_wrong);
		assert_true(out.o.holds);
		assert_true((double)out.o.n_found >= 0.98 * (double)out.o.n_wrong && out.o.n_wrong > 500);
		assert_true((double)out.o.n_falsely < 0.05 * (double)out.c.n_used);
		assert_int_equal(out.c.n_knocked, knocked >= 0);
		for (int i = 0; i < 8; i++)
			assert_int_equal(out.c.report[i].knocked, i == knocked);
		if (knocked >= 0)
			assert_true(llabs(out.c.report[knocked].knocked_ns - out.dance.knock_ns) < 1000000000);
		done(&out);
	}
	bb_room_free(room);
}

/* What it saw in the three seconds since would leave it 4.7 mm off: its lens is known from before. */

static void a_knocked_camera_keeps_its_lens(void **state)
{
	struct bb_room *room = room_of("rooms/cabin.yaml");
	const struct bb_dance_config dance = { .room = room, .seconds = 36, .rate_hz = 50, .noise_px = 0.1, .outlier_share = 0.1,
		                               .knocked = 2, .seed = 4 };
	struct bb_error err = { 0 };
	struct outcome out = { .room = room };
	size_t n = 0;

	(void)state;
	assert_int_equal(bb_dance_make(&dance, &out.dance), BB_OK);
	struct bb_sequence *s = &out.dance.sequence;
	for (size_t i = 0; i < s->n_sights; i++) {
		const struct bb_sequence_sight sight = s->sights[i];
		const bool since = !sight.square && sight.camera == 2 && sight.t_ns > out.dance.knock_ns;
		if (!since || sight.t_ns < out.dance.knock_ns + 3000000000)
			s->sights[n++] = sight;
	}
	s->n_sights = n;
	const struct bb_calibrate_config config = { .cameras = room->cameras, .n_cameras = 8, .sequence = s };
	assert_int_equal(bb_calibrate(&config, &out.c, &err), BB_OK);
	const double off_mm = 1e3 * bb_vec3_norm(bb_vec3_sub(out.c.cameras[2].pose.p, out.dance.truth[2].pose.p));
	print_message("[ note ] %zu markers in %.0f %% since: %.3f mm off\n", out.c.report[2].n_used, 100 * out.c.report[2].covered, off_mm);
	assert_true(out.c.report[2].knocked && off_mm < 1);
	assert_int_equal(out.c.bundle.n_cameras, 8);
	for (size_t i = 0; i < out.c.bundle.n_obs; i++)
		assert_true(out.c.bundle.obs[i].camera < 8);
	done(&out);
	bb_room_free(room);
}

static void the_same_twice(void **state)
{
	struct bb_room *room = room_of("rooms/cabin.yaml");
	const struct bb_dance_config dance = { .room = room, .seconds = 12, .rate_hz = 50, .noise_px = 0.2, .knocked = -1, .seed = 3 };
	struct bb_error err = { 0 };
	struct outcome a, b;

	(void)state;
	assert_int_equal(calibrate(&a, &dance, &err), BB_OK);
	assert_int_equal(calibrate(&b, &dance, &err), BB_OK);
	assert_memory_equal(a.c.cameras, b.c.cameras, a.c.n_cameras * sizeof(*a.c.cameras));
	assert_true(fabs(a.c.rms_px / 0.2 - 1) < 0.05);
	done(&a);
	done(&b);
	bb_room_free(room);
}

static int refusal(struct bb_room *room, struct bb_dance *d)
{
	const struct bb_calibrate_config config = { .cameras = room->cameras, .n_cameras = room->n_cameras, .sequence = &d->sequence };
	struct bb_calibration c;
	struct bb_error err = { 0 };

	if (!bb_calibrate(&config, &c, &err))
		bb_calibration_free(&c);
	return err.number;
}

static void what_cannot_be_calibrated_is_refused(void **state)
{
	struct bb_room *room = room_of("rooms/cabin.yaml");
	const struct bb_dance_config dance = { .room = room, .seconds = 16, .rate_hz = 50, .noise_px = 0.1, .knocked = -1, .seed = 5 };
	struct bb_dance d;

	(void)state;
	assert_int_equal(bb_dance_make(&dance, &d), BB_OK);
	for (size_t i = 0; i < d.sequence.n_sights; i++) /* covered */
		if (d.sequence.sights[i].camera == 6 && !d.sequence.sights[i].square)
			d.sequence.sights[i].n = 0;
	assert_int_equal(refusal(room, &d), 1734);
	bb_dance_free(&d);

	assert_int_equal(bb_dance_make(&dance, &d), BB_OK);
	for (size_t i = 0; i < d.sequence.n_sights; i++) /* nobody laid a square */
		if (d.sequence.sights[i].square)
			d.sequence.sights[i].n = 0;
	assert_int_equal(refusal(room, &d), 1735);
	bb_dance_free(&d);

	assert_int_equal(bb_dance_make(&dance, &d), BB_OK);
	for (int i = 0; i < 3; i++) /* a wand shorter by a twentieth than it says */
		d.sequence.along_m[i] *= 1.05;
	assert_int_equal(refusal(room, &d), 1735);
	bb_dance_free(&d);

	assert_int_equal(bb_dance_make(&dance, &d), BB_OK);
	struct scene_rng r = { .s = 9 }; /* three blobs anywhere are no wand */
	for (size_t i = 0; i < d.sequence.n_px; i++)
		d.sequence.px[i][0] = (float)scene_uniform(&r, 0, 640);
	assert_true(refusal(room, &d) == 1734 || refusal(room, &d) == 1736);
	d.sequence.n_cameras = 1;
	assert_int_equal(refusal(room, &d), 1733);
	bb_dance_free(&d);
	bb_room_free(room);
}

/* --- labels ------------------------------------------------------------------------------------------------------- */

static void labels_are_right_or_none(void **state)
{
	struct scene_rng r = { .s = 31 };
	struct bb_sequence s;
	int wands = 0, squares = 0, of_wands = 0, of_squares = 0;

	(void)state;
	bb_sequence_defaults(&s);
	for (int round = 0; round < 6000; round++) {
		const bool square = round & 1;
		const int n = square ? 4 : 3;
		const struct bb_camera_config c = scene_camera((struct bb_vec3){ scene_uniform(&r, -2, 2), scene_uniform(&r, 1.8, 3), 2 },
		                                               (struct bb_vec3){ 0, 0.5, 0 }, 832, 640, 70, -0.1, 0.01);
		const struct bb_vec3 p = { scene_uniform(&r, -0.7, 0.7), scene_uniform(&r, 0.2, 1.4), scene_uniform(&r, -0.7, 0.7) };
		const struct bb_vec3 u = bb_quat_rotate(scene_any_turn(&r), (struct bb_vec3){ 1, 0, 0 });
		float px[8][2];
		int at[4], label[4], used = 0;
		struct bb_lens lens;

		for (int i = 0; i < n; i++)
			at[i] = i;
		for (int i = n; i > 1; i--) { /* in any order */
			const int k = (int)(scene_u64(&r) % (uint64_t)i), keep = at[i - 1];
			at[i - 1] = at[k];
			at[k] = keep;
		}
		for (int i = 0; i < n; i++) {
			double q[2];
			if (!scene_pixel(&c, square ? s.square[i] : bb_vec3_add(p, bb_vec3_scale(u, s.along_m[i])), q))
				break;
			px[at[i]][0] = (float)(q[0] + 0.1 * scene_normal(&r));
			px[at[i]][1] = (float)(q[1] + 0.1 * scene_normal(&r));
			used++;
		}
		if (used < n || !bb_lens_init(&lens, &c))
			continue;
		const bool found = square ? bb_label_square(&lens, &s, (const float(*)[2])px, 4, label) :
		                            bb_label_wand(&lens, &s, (const float(*)[2])px, 3, label);
		*(square ? &of_squares : &of_wands) += 1;
		for (int i = 0; found && i < n; i++)
			assert_int_equal(label[i], at[i]);
		*(square ? &squares : &wands) += found;
	}
	print_message("[ note ] %d of %d wands, %d of %d squares labelled, none wrong\n", wands, of_wands, squares, of_squares);
	assert_true(wands > 0.9 * of_wands && squares > 0.9 * of_squares && of_squares > 500);
}

/* --- the sequence file -------------------------------------------------------------------------------------------- */

#define HEAD "# blackburst wand 1\nwand_mm 0 150 400\nsquare_mm 0 0 0 300 0 0 0 0 -160 0 0 -400\ncamera a\ncamera b\n"

static void sequences_are_read_and_refused(void **state)
{
	static const struct {
		int number;
		const char *text;
	} cases[] = {
		{ 0, HEAD "part square\n0 a 1 2\n0 b\n# x\n\npart wand\n0.5 a 1 2 3.25 4e2\r\n" },
		{ 1730, "" },
		{ 1730, "# blackburst optics 1\n" },
		{ 1731, "# blackburst wand 1\n" },
		{ 1731, HEAD },
		{ 1731, HEAD "0 a 1 2\n" },
		{ 1731, HEAD "part wand\n0 c 1 2\n" },
		{ 1731, HEAD "part wand\n0 a 1\n" },
		{ 1731, HEAD "part wand\n0 a 1 nan\n" },
		{ 1731, HEAD "part wand\n0 a 1 inf\n" },
		{ 1731, HEAD "part wand\n0 a 1 0x10\n" },
		{ 1731, HEAD "part wand\n0 a 1 70000\n" },
		{ 1731, HEAD "part wand\n0 a 1 1e999\n" },
		{ 1731, HEAD "part wand\n-1 a 1 2\n" },
		{ 1731, HEAD "part wand\n1e7 a 1 2\n" },
		{ 1731, HEAD "part wand\n0.5 a 1 2\n0.4 b 1 2\n" },
		{ 1731, HEAD "part wand\n0.5 a 1 2\npart square\n0 a\npart wand\n0.4 b 1 2\n" },
		{ 1731, HEAD "part wand\n0 a 1 2" },
		{ 1731, HEAD "part dance\n0 a 1 2\n" },
		{ 1731, HEAD "camera a\npart wand\n0 a 1 2\n" },
		{ 1731, HEAD "wand_mm 0 150 400\npart wand\n0 a 1 2\n" },
		{ 1731, HEAD "part wand\n0 aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa 1 2\n" },
		{ 1731, HEAD "part wand\n0 a 1 2 3 4 5 6 7 8 9 1 1 2 3 4 5 6 7 8 9 1 1 2 3 4 5 6 7 8 9 1 1 2 3 4 5 6 7 8 9 1 1 2 3 4 5 6 7 8 9 1 "
		        "1 2 3 4 5 6 7 8 9 1 1 2 3 4 5 6 7 8 9 1\n" },
		{ 1731, "# blackburst wand 1\nwand_mm 0 200 400\n" },
		{ 1731, "# blackburst wand 1\nwand_mm 0 150\n" },
		{ 1731, "# blackburst wand 1\nsquare_mm 0 0 0 300 0 0 0 0 -160 0 0 160\n" },
		{ 1731, "# blackburst wand 1\nsquare_mm 0 0 0 0 0 -300 0 0 -160 0 0 -400\n" },
	};
	struct bb_sequence s;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		struct bb_error err = { 0 };
		const enum bb_status status = bb_sequence_parse(cases[i].text, strlen(cases[i].text), "x", &s, &err);
		if (err.number != cases[i].number)
			print_error("case %zu: want %d, got %s\n", i, cases[i].number, err.text);
		assert_int_equal(err.number, cases[i].number);
		assert_int_equal(status == BB_OK, cases[i].number == 0);
		if (!status) {
			assert_int_equal(s.n_sights, 3);
			assert_true(s.sights[2].t_ns == 500000000 && s.sights[2].n == 2 && s.px[2][0] == 3.25f && s.px[2][1] == 400);
			assert_true(s.sights[0].square && !s.sights[2].square);
		}
		bb_sequence_free(&s);
	}
}

static void a_saved_dance_is_the_dance(void **state)
{
	struct bb_room *room = room_of("rooms/cabin.yaml");
	const struct bb_dance_config dance = { .room = room, .seconds = 5, .rate_hz = 50, .noise_px = 0.1, .knocked = -1, .seed = 8 };
	struct bb_dance d;
	struct bb_sequence s;
	struct bb_error err = { 0 };
	char name[] = "/tmp/bb-wand-XXXXXX";
	const int fd = mkstemp(name);

	(void)state;
	assert_true(fd >= 0);
	close(fd);
	assert_int_equal(bb_dance_make(&dance, &d), BB_OK);
	assert_int_equal(bb_calibrate_save_sequence(name, &d.sequence, &err), BB_OK);
	assert_int_equal(bb_sequence_read(name, &s, &err), BB_OK);
	unlink(name);
	assert_true(s.n_sights == d.sequence.n_sights && s.n_px == d.sequence.n_px && s.n_cameras == 8);
	for (size_t i = 0; i < s.n_sights; i++)
		assert_true(s.sights[i].t_ns == d.sequence.sights[i].t_ns && s.sights[i].n == d.sequence.sights[i].n &&
		            s.sights[i].camera == d.sequence.sights[i].camera);
	for (size_t i = 0; i < s.n_px; i++)
		assert_true(fabsf(s.px[i][0] - d.sequence.px[i][0]) < 1e-4f && fabsf(s.px[i][1] - d.sequence.px[i][1]) < 1e-4f);
	bb_sequence_free(&s);
	bb_dance_free(&d);
	bb_room_free(room);
}

/* --- the side file ------------------------------------------------------------------------------------------------ */

#define ROOM(position, more) \
	"room: t\n" more "nodes: [{id: a}]\nwalls:\n  - {id: w, node: a, pixels: [100, 100], corners_m: {lower_left: [-1, 0, -1], " \
	"lower_right: [1, 0, -1], upper_left: [-1, 2, -1]}}\ncameras:\n" \
	"  - {id: c1, position_m: " position ", look_at_m: [0, 1, 0], pixels: [640, 480]}\n" \
	"  - {id: c2, position_m: [0.5, 1, 1], look_at_m: [0, 1, 0], pixels: [640, 480], lens: fisheye}\n"
#define PLAIN ROOM("[0, 1, 1]", "")

static char *read_all(const char *name)
{
	char *text = calloc(1, 65536);
	FILE *f = fopen(name, "r");

	assert_true(text && f);
	assert_true(fread(text, 1, 65535, f) > 0);
	fclose(f);
	return text;
}

/* The room with a calibration of this text; its error number, 0 when it loaded into *out. */
static int room_with(const char *text, size_t n, const char *room_text, struct bb_room **out)
{
	char name[] = "tests/bb-cal-XXXXXX", whole[4096];
	struct bb_error err = { 0 };
	const int fd = mkstemp(name);

	assert_true(fd >= 0 && write(fd, text, n) == (ssize_t)n);
	close(fd);
	snprintf(whole, sizeof(whole), "calibration: %s\n%s", name, room_text);
	*out = room_from(whole, &err);
	unlink(name);
	return err.number;
}

static void a_room_uses_its_calibration(void **state)
{
	char name[] = "/tmp/bb-cal-XXXXXX", *text;
	struct bb_error err = { 0 };
	struct bb_room *room = room_from(PLAIN, &err), *back = NULL;
	struct bb_calibration_head head;
	const int fd = mkstemp(name);

	(void)state;
	assert_true(room && fd >= 0);
	close(fd);
	bb_calibrate_head(room, "2026-11-22", &head);
	head.rms_px = 0.1;
	room->cameras[0].pose.p.x = 0.123456789;
	room->cameras[0].pose.q = bb_quat_unit((struct bb_quat){ 1, 2, 3, 4 });
	room->cameras[0].fx_px = 511.5;
	room->cameras[0].cx_px = 300;
	room->cameras[1].k3 = -0.001;
	room->cameras[1].calibrated_px = 0.125;
	assert_int_equal(bb_calibrate_save(name, &head, room->cameras, 2, &err), BB_OK);
	text = read_all(name);
	unlink(name);
	const size_t n = strlen(text);

	assert_int_equal(room_with(text, n, PLAIN, &back), 0);
	assert_string_equal(back->calibrated, "2026-11-22");
	assert_true(fabs(back->cameras[0].pose.p.x - 0.123456789) < 1e-9 && back->cameras[0].fy_px == 511.5 &&
	            back->cameras[0].cx_px == 300 && fabs(back->cameras[1].k3 + 0.001) < 1e-9 &&
	            back->cameras[1].calibrated_px == 0.125 && back->cameras[1].lens == BB_LENS_FISHEYE);
	assert_true(bb_quat_angle(back->cameras[0].pose.q, room->cameras[0].pose.q) < 1e-9);
	assert_true(fabs(back->cameras[0].fov_deg - 2 * atan(320 / 511.5) * 180 / PI) < 1e-9);
	bb_room_free(back);

	/* a camera was moved in the plan since; one was renamed; one is new */
	assert_int_equal(room_with(text, n, ROOM("[0, 1.001, 1]", ""), &back), 1738);
	assert_int_equal(room_with(text, n, PLAIN "  - {id: c3, position_m: [0.1, 1, 1], look_at_m: [0, 1, 0], pixels: [640, 480]}\n",
	                           &back), 1738);
	char *id = strstr(text, "id: \"c2\"");
	id[6] = '1';
	assert_int_equal(room_with(text, n, PLAIN, &back), 1738); /* twice */
	id[6] = '9';
	assert_int_equal(room_with(text, n, PLAIN, &back), 1738); /* unknown */
	id[6] = '2';
	char *turned = strstr(strstr(text, "c1"), "turned: [");
	turned[11] = '9';
	assert_int_equal(room_with(text, n, PLAIN, &back), 1737); /* no orientation */
	for (size_t cut = 0; cut + 2 < n; cut += 7) { /* cut short anywhere: refused, and nothing is lost */
		const int number = room_with(text, cut, PLAIN, &back);
		if (!number)
			print_error("cut at %zu of %zu\n", cut, n);
		assert_true(number > 1000);
	}
	free(text);
	bb_room_free(room);
}

static void a_calibration_must_be_beside_the_room(void **state)
{
	struct bb_error err = { 0 };

	(void)state;
	assert_null(room_from(ROOM("[0, 1, 1]", "calibration: /etc/passwd\n"), &err));
	assert_int_equal(err.number, 1204);
	err.number = 0;
	assert_null(room_from(ROOM("[0, 1, 1]", "calibration: ../secret.yaml\n"), &err));
	assert_int_equal(err.number, 1204);
	err.number = 0;
	assert_null(room_from(ROOM("[0, 1, 1]", "calibration: rooms/nowhere.yaml\n"), &err));
	assert_int_equal(err.number, 1001);
}

/* --- touched corners ---------------------------------------------------------------------------------------------- */

static void touched_corners_move_the_tracker(void **state)
{
	static const struct bb_vec3 corner[5] = { { -1.5, 0, -1.5 }, { 1.5, 0, -1.5 }, { -1.5, 2.3, -1.5 }, { 1.5, 0, 1.5 }, { 1.5, 2.3, 1.5 } };
	struct scene_rng r = { .s = 51 };
	double square_m2 = 0, square_deg2 = 0, sigma_m = 0, sigma_deg = 0;
	const int rounds = 2000;

	(void)state;
	for (int round = 0; round < rounds; round++) {
		const struct bb_pose to_room = { { scene_uniform(&r, -1, 1), scene_uniform(&r, -1, 1), scene_uniform(&r, -1, 1) },
			                         scene_any_turn(&r) };
		struct bb_vec3 touched[5];
		struct bb_touch_fit fit;
		for (int i = 0; i < 5; i++)
			touched[i] = bb_pose_inverse_apply(&to_room, bb_vec3_add(corner[i], (struct bb_vec3){ 0.004 * scene_normal(&r),
				                                   0.004 * scene_normal(&r), 0.004 * scene_normal(&r) }));
		assert_true(bb_touch_fit(touched, corner, 5, &fit));
		/* at the points' middle */
		const struct bb_vec3 middle = { 0.3, 0.92, -0.3 };
		const struct bb_vec3 in_tracker = bb_pose_inverse_apply(&to_room, middle);
		const struct bb_vec3 off = bb_vec3_sub(bb_pose_apply(&fit.pose, in_tracker), middle);
		square_m2 += bb_vec3_dot(off, off) / 3;
		square_deg2 += pow(bb_quat_angle(fit.pose.q, to_room.q) * 180 / PI, 2) / 3;
		sigma_m += fit.sigma_m / rounds;
		sigma_deg += fit.sigma_deg / rounds;
	}
	const double rms_m = sqrt(square_m2 / rounds), rms_deg = sqrt(square_deg2 / rounds);
	print_message("[ note ] place %.2f mm rms, %.2f stated; turn %.4f deg per axis, %.4f stated for the worst\n", 1e3 * rms_m,
	              1e3 * sigma_m, rms_deg, sigma_deg);
	assert_true(fabs(sigma_m / rms_m - 1) < 0.1);
	assert_true(sigma_deg > rms_deg && sigma_deg < 1.5 * rms_deg);
}

static void corners_on_an_edge_do_not_do(void **state)
{
	static const struct bb_vec3 edge[4] = { { 0, 0, 0 }, { 1, 0, 0 }, { 2, 0, 0 }, { 2.5, 0.004, 0 } };
	struct bb_touch_fit fit;

	(void)state;
	assert_false(bb_touch_fit(edge, edge, 2, &fit));
	assert_false(bb_touch_fit(edge, edge, 3, &fit));
	assert_false(bb_touch_fit(edge, edge, 4, &fit));
	const struct bb_vec3 same[3] = { { 1, 1, 1 }, { 1, 1, 1 }, { 1, 1, 1 } };
	assert_false(bb_touch_fit(same, same, 3, &fit));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(derivatives_are_differences),
		cmocka_unit_test(labels_are_right_or_none),
		cmocka_unit_test(cameras_are_found),
		cmocka_unit_test(a_knocked_camera_keeps_its_lens),
		cmocka_unit_test(the_same_twice),
		cmocka_unit_test(what_cannot_be_calibrated_is_refused),
		cmocka_unit_test(sequences_are_read_and_refused),
		cmocka_unit_test(a_saved_dance_is_the_dance),
		cmocka_unit_test(a_room_uses_its_calibration),
		cmocka_unit_test(a_calibration_must_be_beside_the_room),
		cmocka_unit_test(touched_corners_move_the_tracker),
		cmocka_unit_test(corners_on_an_edge_do_not_do),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
