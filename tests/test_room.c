/*
 * tests/test_room.c: the committed rooms, generators, derived fields, budgets, geometry lint, and the small parts a
 * room is read with: options, URIs, safety ceilings, hashes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>
#include <time.h>

#include "hal/file.h"
#include "hal/hash.h"
#include "hal/options.h"
#include "hal/profile.h"
#include "hal/uri.h"
#include "tests/room_text.h"

static struct bb_room *load(const char *path)
{
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;

	if (bb_room_load(path, &room, &err))
		print_error("%s\n", err.text);
	assert_non_null(room);
	return room;
}

static struct bb_room *good(const char *text)
{
	struct bb_error err = { 0 };
	struct bb_room *room = room_from(text, &err);

	if (!room)
		print_error("%s\n", err.text);
	assert_non_null(room);
	return room;
}

static void near_to(double got, double want, double tolerance)
{
	if (!(fabs(got - want) <= tolerance))
		fail_msg("got %.12g, want %.12g +- %g", got, want, tolerance);
}

static const struct bb_budget *budget(const struct bb_room *room, enum bb_metric metric)
{
	for (size_t i = 0; i < room->n_budgets; i++)
		if (room->budgets[i].metric == metric)
			return &room->budgets[i];
	return NULL;
}

/* --- the committed rooms ------------------------------------------------------------------------------------------ */

static void all_rooms_load_without_findings(void **state)
{
	static const char *const paths[] = { "rooms/cabin.yaml", "rooms/cabin120.yaml", "rooms/deck.yaml", "rooms/desk.yaml" };
	struct bb_finding findings[8];

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(paths); i++) {
		struct bb_room *room = load(paths[i]);
		const size_t n = bb_room_lint(room, findings, BB_ARRAY_LEN(findings));
		for (size_t k = 0; k < n && k < BB_ARRAY_LEN(findings); k++)
			print_error("%s: %d %s\n", paths[i], findings[k].number, findings[k].text);
		assert_int_equal(n, 0);
		for (size_t k = 0; k < room->n_nodes; k++) {
			struct bb_profile profile;
			struct bb_error err = { 0 };
			assert_int_equal(bb_profile_load_for(paths[i], room->nodes[k].profile, &profile, &err), BB_OK);
		}
		bb_room_free(room);
	}
}

static void the_cabin_is_as_built(void **state)
{
	struct bb_room *room = load("rooms/cabin.yaml");
	const struct bb_budget *b = budget(room, BB_METRIC_HEAD_TO_PHOTON);
	int64_t pixels = 0;

	(void)state;
	assert_int_equal(room->n_walls, 5);
	assert_int_equal(room->n_screens, 5);
	assert_int_equal(room->n_nodes, 6);
	assert_int_equal(room->n_cameras, 8);
	assert_int_equal(room->n_monitors, 6);
	assert_int_equal(room->n_pdus, 2);
	assert_int_equal(room->n_gamepads, 2);
	assert_int_equal(room->link.n_nodes, 6);
	for (size_t i = 0; i < room->n_screens; i++) {
		pixels += room->screens[i].display.width_px * room->screens[i].display.height_px;
		assert_int_equal(room->screens[i].display.stereo, BB_STEREO_DUAL_PROJECTOR);
		assert_false(room->screens[i].display.genlock);
		assert_true(room->screens[i].display.rate.num == 60 && room->screens[i].display.rate.den == 1);
		assert_true(isnan(room->screens[i].display.rate_error_ppm));
		assert_string_equal(room->screens[i].display.device, "sim:");
		assert_string_equal(room->screens[i].display.node, room->walls[i].node);
	}
	assert_int_equal(pixels, 7350000); /* "approximately 7 megapixels" */
	assert_true(room->has_chain && room->chain.n_stages == 5 && room->chain.rate.num == 120);
	assert_string_equal(room->chain.stage[4], "floor");
	assert_int_equal(room->bodies[0].n_markers, 5);
	assert_string_equal(room->bodies[0].id, "glasses");
	near_to(room->bodies[0].eye_centre.x, 0.075, 1e-15);
	near_to(room->bodies[0].marker[1].x, 0.151, 1e-15);
	near_to(room->eye_separation_m, 0.063, 1e-15);
	assert_non_null(b);
	assert_true(b->stat == BB_STAT_P99 && b->limit == 50 && b->marginal == 45);
	assert_string_equal(b->where.file, "rooms/cabin.yaml");
	assert_true(b->where.line > 100);
	assert_string_equal(room->monitors[1].outlet, "pdu1/1");
	assert_int_equal(room->monitors[1].width_px, 1400);
	assert_int_equal(room->monitors[0].width_px, 1920);
	bb_room_free(room);
}

static void cabin120_is_frame_sequential(void **state)
{
	struct bb_room *room = load("rooms/cabin120.yaml");

	(void)state;
	for (size_t i = 0; i < room->n_screens; i++) {
		assert_int_equal(room->screens[i].display.stereo, BB_STEREO_FRAME_SEQUENTIAL);
		assert_true(room->screens[i].display.genlock && room->screens[i].display.rate.num == 120);
		near_to(room->screens[i].display.vblank_us, 461, 0);
	}
	bb_room_free(room);
}

/* Head positions are seen by all cameras, the whole inside by three. */
static void the_cabin_is_covered(void **state)
{
	struct bb_room *room = load("rooms/cabin.yaml");
	size_t least = 99, three = 0, n = 0;

	(void)state;
	for (int i = 0; i < 11; i++)
		for (int j = 0; j < 10; j++)
			for (int k = 0; k < 11; k++) {
				const struct bb_vec3 p = { -1.4 + 0.28 * i, 0.4 + 0.2 * j, -1.4 + 0.28 * k };
				size_t seen = 0;
				for (size_t c = 0; c < room->n_cameras; c++)
					seen += bb_camera_sees(&room->cameras[c], p, 0);
				three += seen >= 3;
				n++;
				if (fabs(p.x) < 0.7 && fabs(p.z) < 0.7 && p.y > 0.9 && p.y < 1.95 && seen < least)
					least = seen;
			}
	print_message("three cameras see %.1f %% of the inside, %zu see every head position\n", 100.0 * (double)three / (double)n,
	              least);
	assert_true(least >= 6 && (double)three >= 0.97 * (double)n);
	bb_room_free(room);
}

static void the_deck_adds_up(void **state)
{
	struct timespec a, b;
	struct bb_room *room;
	size_t per_node[64] = { 0 }, most = 0;

	(void)state;
	clock_gettime(CLOCK_MONOTONIC, &a);
	room = load("rooms/deck.yaml");
	bb_room_lint(room, NULL, 0);
	clock_gettime(CLOCK_MONOTONIC, &b);
	const double s = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
	print_message("416 monitors loaded and linted in %.1f ms\n", s * 1e3);
	assert_true(s < 2.5); /* 5 x the limit: a guard, not a measurement */
	assert_int_equal(room->n_screens, 416);
	assert_int_equal(room->n_monitors, 416);
	assert_int_equal(room->n_cameras, 24);
	for (size_t i = 0; i < room->n_screens; i++) {
		const size_t n = ++per_node[room->screens[i].node];
		most = n > most ? n : most;
		near_to(bb_vec3_norm(bb_vec3_sub(room->screens[i].corners.lower_right, room->screens[i].corners.lower_left)),
		        0.5967, 1e-9);
		assert_string_equal(room->monitors[i].id, room->screens[i].id);
	}
	assert_int_equal(most, 24);
	assert_int_equal(per_node[0], 0); /* the head draws nothing */
	near_to(room->max.x - room->min.x, 9.9952, 1e-9);
	near_to(room->max.z - room->min.z, 6.2470, 1e-9);
	/* two bezels between two pictures */
	near_to(room->screens[8].corners.lower_left.x - room->screens[0].corners.lower_right.x, 0.028, 1e-9);
	assert_string_equal(room->screens[8].id, "front-1-0");
	assert_int_equal(room->walls[2].door_columns * room->walls[2].door_rows, 15);
	bb_room_free(room);
}

/* --- generators and derived fields -------------------------------------------------------------------------------- */

#define HEAD "room: t\nnodes:\n  - {id: a, head: true}\n  - {id: n1..n3}\nwalls:\n"
#define FRONT "{lower_left: [-1, 0, -1], lower_right: [1, 0, -1], upper_left: [-1, 2, -1]}"
#define SIDE(x, z0, z1) \
	"{lower_left: [" x ", 0, " z0 "], lower_right: [" x ", 0, " z1 "], upper_left: [" x ", 2, " z0 "]}"
#define WALL(id, corners) "  - {id: " id ", node: a, pixels: [100, 100], corners_m: " corners "}\n"
#define BOX HEAD "  - {id: front, node: a, pixels: [100, 100], corners_m: " FRONT "}\n" WALL("right", SIDE("1", "-1", "1")) \
	WALL("left", SIDE("-1", "1", "-1"))

static void tiles_are_dealt_evenly(void **state)
{
	struct bb_room *room = good(HEAD "  - id: w\n    nodes: n1..n3\n    pixels: [100, 50]\n    grid: {columns: 8, rows: 2, "
	                                 "bezel_edge_mm: 10}\n    corners_m: " FRONT "\n");
	static const uint16_t want[8] = { 1, 1, 1, 2, 2, 2, 3, 3 };

	(void)state;
	assert_int_equal(room->n_screens, 16);
	for (size_t i = 0; i < 16; i++)
		assert_int_equal(room->screens[i].node, want[i / 2]);
	/* frame 2 x 2 m, 8 x 2 tiles of 0.25 x 1 m, 10 mm bezel all round */
	near_to(room->screens[3].corners.lower_left.x, -1 + 0.25 + 0.01, 1e-12);
	near_to(room->screens[3].corners.lower_left.y, 1.01, 1e-12);
	near_to(room->screens[3].corners.upper_left.y, 1.99, 1e-12);
	assert_string_equal(room->screens[3].id, "w-1-1");
	assert_int_equal(room->walls[0].width_px, 800);
	bb_room_free(room);
}

static void a_wall_from_its_tiles(void **state)
{
	struct bb_room *room = good(HEAD "  - id: w\n    node: a\n    pixels: [100, 50]\n    grid: {columns: 4, rows: 3, "
	                                 "bezel_edge_mm: 5, picture_mm: [490, 290]}\n"
	                                 "    corners_m: {lower_left: [1, 0.5, -1], right: [0, 0, 2]}\n");
	const struct bb_vec3 normal = bb_corners_normal(&room->walls[0].corners);

	(void)state;
	near_to(room->walls[0].corners.lower_right.z, -1 + 4 * 0.5, 1e-12);
	near_to(room->walls[0].corners.upper_left.y, 0.5 + 3 * 0.3, 1e-12);
	near_to(normal.x, -1, 1e-12); /* into the room */
	bb_room_free(room);
}

static void cameras_look_where_they_are_told(void **state)
{
	struct bb_room *room = good(BOX "cameras:\n  - {id: c1..c3, position_m: {from: [-0.9, 1.9, -0.9], to: [0.9, 1.9, -0.9]}, "
	                                "look_at_m: [0, 1, 0], pixels: [640, 480], fov_deg: 90}\n");
	const struct bb_camera_config *c = &room->cameras[0];
	const struct bb_vec3 target = bb_pose_inverse_apply(&c->pose, (struct bb_vec3){ 0, 1, 0 });
	const struct bb_vec3 above = bb_pose_inverse_apply(&c->pose, (struct bb_vec3){ 0, 1.2, 0 });

	(void)state;
	assert_int_equal(room->n_cameras, 3);
	near_to(room->cameras[1].pose.p.x, 0, 1e-15);
	near_to(c->fx_px, 320, 1e-9);
	near_to(c->cx_px, 319.5, 0);
	near_to(target.x, 0, 1e-12);
	near_to(target.y, 0, 1e-12);
	assert_true(target.z > 1);   /* z forward */
	assert_true(above.y < 0);    /* y down: what is higher has the smaller row */
	near_to(above.x, 0, 1e-12);
	assert_true(bb_camera_sees(c, (struct bb_vec3){ 0, 1, 0 }, 0));
	assert_false(bb_camera_sees(c, (struct bb_vec3){ -0.9, 1.9, -2 }, 0)); /* behind */
	bb_room_free(room);
}

static void budgets_convert_units(void **state)
{
	struct bb_room *room = good(BOX "budgets:\n  head_to_photon: {p99_us: 50000, max_s: 0.1, owner: sync}\n"
	                                "  pose_error: {rms_um: 250}\n  swap_skew: {p99_ms: 0.5, marginal_us: 400}\n"
	                                "  phase: {max_abs_us: 300}\n  torn_frames: {max: 0}\n  tracked: {mean_percent: 99, "
	                                "marginal_percent: 99.5}\n");

	(void)state;
	assert_int_equal(room->n_budgets, 7);
	near_to(room->budgets[0].limit, 50, 1e-12);
	near_to(room->budgets[1].limit, 100, 1e-12);
	assert_string_equal(room->budgets[1].owner, "sync");
	near_to(room->budgets[2].limit, 0.25, 1e-12);
	near_to(room->budgets[3].limit, 500, 1e-9);
	near_to(room->budgets[3].marginal, 400, 0);
	assert_int_equal(room->budgets[4].stat, BB_STAT_MAX_ABS);
	assert_int_equal(room->budgets[5].stat, BB_STAT_MAX);
	assert_true(isnan(room->budgets[5].marginal));
	bb_room_free(room);
}

static void the_order_of_sections_does_not_matter(void **state)
{
	struct bb_room *room = good("monitors: [{id: m, node: a}]\nwalls:\n" WALL("front", FRONT) "nodes: [{id: a}]\nroom: t\n");

	(void)state;
	assert_true(room->nodes[0].head);
	assert_int_equal(room->monitors[0].width_px, 100);
	bb_room_free(room);
}

/* --- lint --------------------------------------------------------------------------------------------------------- */

static int count(const struct bb_finding *f, size_t n, int number)
{
	int found = 0;

	for (size_t i = 0; i < n; i++)
		found += f[i].number == number;
	return found;
}

/* Exactly this finding (0: none) in this room. */
static void expect(const char *text, int number)
{
	struct bb_finding f[32];
	struct bb_room *room = good(text);
	const size_t n = bb_room_lint(room, f, BB_ARRAY_LEN(f));

	for (size_t i = 0; i < n; i++)
		if (f[i].number != number)
			fail_msg("unexpected %d: %s", f[i].number, f[i].text);
	if (number)
		assert_true(count(f, n, number) >= 1);
	bb_room_free(room);
}

static void lint_finds_bad_walls(void **state)
{
	(void)state;
	expect(BOX "size_m: [2, 2, 2]\n", 0);
	/* overlap: the same place again, and a wall through another */
	expect(BOX WALL("again", "{lower_left: [-0.4, 0, -1], lower_right: [0.4, 0, -1], upper_left: [-0.4, 2, -1]}"), 1150);
	expect(BOX WALL("across", "{lower_left: [0.5, 0, -1.5], lower_right: [0.5, 0, -0.2], upper_left: [0.5, 2, -1.5]}")
	           "neutral_m: [-0.5, 1.6, 0]\n",
	       1150);
	/* a wall 20 mm short of the corner; 4 mm is within tolerance */
	expect(HEAD WALL("front", FRONT) WALL("right", SIDE("1.02", "-1", "1")), 1151);
	expect(HEAD WALL("front", FRONT) WALL("right", SIDE("1.004", "-1", "1")), 0);
	/* left and right swapped */
	expect(HEAD WALL("front", "{lower_left: [1, 0, -1], lower_right: [-1, 0, -1], upper_left: [1, 2, -1]}")
	           "neutral_m: [0, 1.6, 0]\n",
	       0 + 1152 /* and the viewer is behind it */);
	expect(HEAD WALL("front", "{lower_left: [-1, 0, -1], lower_right: [1, 0, -1], upper_left: [-0.98, 2, -1]}"), 1153);
	expect(BOX "size_m: [2.006, 2, 2]\n", 1154);
	expect(BOX "size_m: [2.004, 2, 2]\n", 0);
	expect(HEAD WALL("front", "{lower_left: [-1, 0, -1], lower_right: [0.5, 0, -1], upper_left: [-1, 2, -1]}")
	           WALL("right", SIDE("1", "-1", "1")) WALL("left", SIDE("-1", "1", "-1")) "size_m: [2, 2, 2]\n",
	       1154);
}

static void lint_finds_bad_people_and_cameras(void **state)
{
	static const char camera[] = "cameras:\n  - {id: c, pixels: [640, 480], position_m: %s, look_at_m: %s}\n";
	char text[2048], line[256];

	(void)state;
	expect(BOX "eye_separation_mm: 49\n", 1155);
	expect(BOX "eye_separation_mm: 81\n", 1155);
	expect(BOX "eye_separation_mm: 50\n", 0);
	expect(BOX "neutral_m: [0, 16, 0]\n", 1157);
	static const struct {
		const char *at, *to;
		int number;
	} all[] = {
		{ "[0, 1.95, -0.95]", "[0, 1.2, 0.3]", 0 },    { "[0, 1.95, -1.5]", "[0, 1.2, 0.3]", 1156 },
		{ "[1.5, 1.95, 0]", "[0, 1.2, 0]", 1156 },      { "[0, 19.5, -0.95]", "[0, 1.2, 0]", 1156 },
		{ "[0.95, 1.5, 0]", "[0, 1.6, 0]", 0 },         { "[0, 0.2, 0.9]", "[0.3, 0.1, -0.9]", 1159 },
	};
	for (size_t i = 0; i < BB_ARRAY_LEN(all); i++) {
		snprintf(line, sizeof(line), camera, all[i].at, all[i].to);
		snprintf(text, sizeof(text), "%s%s", BOX, line);
		expect(text, all[i].number);
	}
	snprintf(line, sizeof(line), camera, "[0.9, 1.6, 0]", "[2, 1.6, 0]"); /* looks through the wall it hangs on */
	snprintf(text, sizeof(text), "%s%s", BOX, line);
	struct bb_finding f[8];
	struct bb_room *room = good(text);
	assert_int_equal(count(f, bb_room_lint(room, f, 8), 1158), 1);
	bb_room_free(room);
	expect(BOX "bodies:\n  glasses: {markers_mm: [[0, 0, 0], [100, 0, 0], [50, 60, 0]]}\n", 1160);
}

static void lint_counts_past_its_room(void **state)
{
	struct bb_room *room = good(BOX "eye_separation_mm: 630\nneutral_m: [0, 16, 0]\n");
	struct bb_finding one;

	(void)state;
	assert_int_equal(bb_room_lint(room, NULL, 0), 2);
	assert_int_equal(bb_room_lint(room, &one, 1), 2);
	assert_int_equal(one.number, 1155);
	bb_room_free(room);
}

/* --- the small parts ---------------------------------------------------------------------------------------------- */

struct target {
	int64_t count;
	double length_m;
	bool on;
	char word[8];
	int kind;
};
static const struct bb_option table[] = {
	BB_OPT_I64(struct target, count, 3, 0, 100, "how many"),
	{ "length_mm", BB_OPT_TYPE_F64, offsetof(struct target, length_m), 0, 250, 0, 1000, 1e-3, NULL, false, "how long" },
	{ "on", BB_OPT_TYPE_BOOL, offsetof(struct target, on), 0, 1, 0, 1, 1, NULL, false, "or off" },
	{ "word", BB_OPT_TYPE_TEXT, offsetof(struct target, word), 8, 0, 1, 0, 1, "hello", false, "a word" },
	{ "kind", BB_OPT_TYPE_ENUM, offsetof(struct target, kind), 0, 2, 0, 0, 1, "dlp|lcd|led", false, "which" },
	BB_OPT_END
};

static int set(struct target *t, const char *key, const char *value)
{
	struct bb_error err = { 0 };

	return bb_options_set(table, t, key, value, NULL, &err) == BB_OK ? 0 : err.number;
}

static void options_are_strict(void **state)
{
	struct target t;
	char text[128];

	(void)state;
	bb_options_defaults(table, &t);
	bb_options_dump(table, &t, text, sizeof(text));
	assert_string_equal(text, "count=3 length_mm=250 on=true word=hello kind=led");
	assert_int_equal(set(&t, "count", "010"), 0);
	assert_int_equal(t.count, 10); /* not octal */
	assert_int_equal(set(&t, "count", "0x0f"), 0);
	assert_int_equal(t.count, 15);
	assert_int_equal(set(&t, "count", "101"), 1013);
	assert_int_equal(set(&t, "count", "99999999999999999999"), 1013);
	static const char *const no_numbers[] = { "", " 1", "1 ", "1x", "nan", "inf", "-", "0x", "1e", "--1", "1,5", "0x1p3" };
	for (size_t i = 0; i < BB_ARRAY_LEN(no_numbers); i++) {
		assert_int_equal(set(&t, "length_mm", no_numbers[i]), 1012);
		assert_int_equal(set(&t, "count", no_numbers[i]), 1012);
	}
	assert_int_equal(set(&t, "length_mm", "1e2"), 0);
	near_to(t.length_m, 0.1, 1e-15);
	assert_int_equal(set(&t, "on", "yes"), 1012);
	assert_int_equal(set(&t, "word", "12345678"), 1013);
	assert_int_equal(set(&t, "word", "a\nb"), 1012);
	assert_int_equal(set(&t, "kind", "lc"), 1012);
	assert_int_equal(set(&t, "kind", "lcd"), 0);
	assert_int_equal(t.kind, 1);
	struct bb_error err = { 0 };
	assert_int_equal(bb_options_set(table, &t, "lenght_mm", "1", NULL, &err), BB_ERR_CONFIG);
	assert_non_null(strstr(err.text, "did you mean 'length_mm'"));
	for (size_t cap = 1; cap < 60; cap++) { /* truncated, terminated, never past the end */
		char *small = malloc(cap);
		bb_options_dump(table, &t, small, cap);
		assert_true(strlen(small) < cap);
		free(small);
	}
}

static void uris_come_apart(void **state)
{
	static const char *const bad[] = { "", "sim", ":", "SIM:", "sim:?a", "sim:?=1", "sim:?a=1&a=2", "sim:?", "sim:?a=1&",
		                           "sim: x", "sim:\x7F", "abcdefghijklmnopq:x", "sim:?A=1" };
	struct bb_error err = { 0 };
	struct bb_uri u;

	(void)state;
	assert_int_equal(bb_uri_parse("modbus:tcp://127.0.0.1:1502?unit=1&outlet=3", &u, NULL, &err), BB_OK);
	assert_string_equal(u.scheme, "modbus");
	assert_string_equal(u.path, "tcp://127.0.0.1:1502");
	assert_int_equal(u.n_options, 2);
	assert_string_equal(u.option[1].key, "outlet");
	assert_string_equal(u.option[1].value, "3");
	assert_int_equal(bb_uri_parse("usb:131d:0157", &u, NULL, &err), BB_OK);
	assert_string_equal(u.path, "131d:0157");
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		memset(&err, 0, sizeof(err));
		if (!bb_uri_parse(bad[i], &u, NULL, &err))
			fail_msg("'%s' was taken", bad[i]);
		assert_int_equal(err.number, 1501);
		assert_true(u.n_options == 0 && !*u.scheme);
	}
}

static void safety_only_tightens(void **state)
{
	static const struct {
		const char *key;
		double strict, loose;
	} all[] = {
		{ "flashes_per_s", 2, 3.01 },      { "fade_ms", 600, 499 },           { "transition_gap_s", 3, 1.9 },
		{ "shutter_least_hz", 55, 49 },    { "outlet_least_off_s", 200, 179 }, { "outlet_least_on_s", 61, 59 },
		{ "outlet_cycles_per_hour", 3, 5 }, { "outlet_stagger_ms", 501, 499 },
	};
	struct bb_error err = { 0 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(all); i++) {
		struct bb_safety s = bb_safety_ceilings(), before = s;
		static const double never[] = { (double)NAN, (double)INFINITY, (double)-INFINITY, 1e300, -1e300 };
		for (size_t k = 0; k < BB_ARRAY_LEN(never); k++)
			assert_true(bb_safety_tighten(&s, all[i].key, never[k], NULL, &err) == BB_ERR_REFUSED);
		assert_int_equal(bb_safety_tighten(&s, all[i].key, all[i].loose, NULL, &err), BB_ERR_REFUSED);
		assert_memory_equal(&s, &before, sizeof(s));
		assert_int_equal(bb_safety_tighten(&s, all[i].key, all[i].strict, NULL, NULL), BB_OK);
		assert_memory_not_equal(&s, &before, sizeof(s));
	}
	struct bb_safety s = bb_safety_ceilings();
	assert_int_equal(bb_safety_tighten(&s, "allow_ddc_power_off", 1, NULL, NULL), BB_ERR_REFUSED);
	assert_int_equal(bb_safety_tighten(&s, "allow_ddc_save", 0, NULL, NULL), BB_OK);
	assert_false(s.allow_ddc_power_off);
	assert_int_equal(bb_safety_tighten(&s, "no_such", 0, NULL, NULL), BB_ERR_CONFIG);
}

static void safety_reaches_the_outlets(void **state)
{
	struct bb_room *room = good(BOX "power: [{id: p, outlets: [{outlet: 4, name: x}]}]\nsafety: {outlet_least_off_s: 300}\n");

	(void)state;
	near_to(room->pdus[0].safety.outlet_least_off_s, 300, 0);
	near_to(room->pdus[0].safety.outlet_least_on_s, 60, 0);
	bb_room_free(room);
}

static void hashes_are_sha256(void **state)
{
	static const char want[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
	struct bb_hash h;
	char hex[BB_HASH_HEX];

	(void)state;
	assert_true(bb_hash_init(&h));
	bb_hash_update(&h, "a", 1);
	bb_hash_update(&h, "bc", 2);
	bb_hash_final_hex(&h, hex);
	assert_string_equal(hex, want); /* FIPS 180-2, "abc" */
}

static void paths_stay_inside(void **state)
{
	(void)state;
	assert_true(bb_path_is_tame("a/b..c/..d"));
	static const char *const wild[] = { "", "/", "/a", "..", "../a", "a/..", "a//../b", "./../a" };
	for (size_t i = 0; i < BB_ARRAY_LEN(wild); i++)
		assert_false(bb_path_is_tame(wild[i]));
}

static void the_catalogue_is_sorted(void **state)
{
	(void)state;
	for (size_t i = 1; bb_error_catalogue(i); i++)
		assert_true(bb_error_catalogue(i)->number > bb_error_catalogue(i - 1)->number);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(all_rooms_load_without_findings),
		cmocka_unit_test(the_cabin_is_as_built),
		cmocka_unit_test(cabin120_is_frame_sequential),
		cmocka_unit_test(the_cabin_is_covered),
		cmocka_unit_test(the_deck_adds_up),
		cmocka_unit_test(tiles_are_dealt_evenly),
		cmocka_unit_test(a_wall_from_its_tiles),
		cmocka_unit_test(cameras_look_where_they_are_told),
		cmocka_unit_test(budgets_convert_units),
		cmocka_unit_test(the_order_of_sections_does_not_matter),
		cmocka_unit_test(lint_finds_bad_walls),
		cmocka_unit_test(lint_finds_bad_people_and_cameras),
		cmocka_unit_test(lint_counts_past_its_room),
		cmocka_unit_test(options_are_strict),
		cmocka_unit_test(uris_come_apart),
		cmocka_unit_test(safety_only_tightens),
		cmocka_unit_test(safety_reaches_the_outlets),
		cmocka_unit_test(hashes_are_sha256),
		cmocka_unit_test(paths_stay_inside),
		cmocka_unit_test(the_catalogue_is_sorted),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
