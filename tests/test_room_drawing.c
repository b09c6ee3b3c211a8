/* tests/test_room_drawing.c: the drawing of a room and what `room check` prints. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <jansson.h>
#include <math.h>
#include <png.h>
#include <string.h>
#include <sys/stat.h>

#include "bench/cmd/room_check.h"
#include "bench/report/room_drawing.h"
#include "tests/room_text.h"

static struct bb_room *load(const char *path)
{
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;

	assert_int_equal(bb_room_load(path, &room, &err), BB_OK);
	return room;
}

static size_t count(const char *text, const char *word)
{
	size_t n = 0;

	for (const char *at = strstr(text, word); at; at = strstr(at + 1, word))
		n++;
	return n;
}

static void svg_fits_into_a_page(void **state)
{
	static const char *const paths[] = { "rooms/cabin.yaml", "rooms/cabin120.yaml", "rooms/deck.yaml", "rooms/desk.yaml" };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(paths); i++) {
		struct bb_room *room = load(paths[i]);
		char *svg = bb_room_drawing_svg(room, NULL, 0), *again = bb_room_drawing_svg(room, NULL, 0);

		assert_non_null(svg);
		assert_true(!strcmp(svg, again));
		assert_int_equal(count(svg, "id=\"room-surface\""), 1);
		assert_int_equal(strncmp(svg, "<svg", 4), 0);
		assert_int_equal(count(svg, "<svg"), 1);
		assert_int_equal(count(svg, "</svg>"), 1);
		assert_int_equal(count(svg, "id=\""), count(svg, "id=\"room-"));
		assert_int_equal(count(svg, "href=\"#"), count(svg, "href=\"#room-"));
		assert_int_equal(count(svg, "http"), count(svg, "http://www.w3.org/")); /* name spaces only: no request */
		assert_true(strlen(svg) < 1500000);
		free(svg);
		free(again);
		bb_room_free(room);
	}
}

static void a_path_is_drawn_and_holes_are_left(void **state)
{
	struct bb_room *room = load("rooms/cabin.yaml");
	struct bb_path_point path[50];
	char *bare = bb_room_drawing_svg(room, NULL, 0), *with;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(path); i++) {
		const double a = 0.1 * (double)i;
		path[i] = (struct bb_path_point){ a, { 0.4 * cos(a), 1.6, 0.4 * sin(a) }, { 0.4 * cos(a), 1.61, 0.4 * sin(a) } };
	}
	path[20].tracked.x = (double)NAN;
	path[30].truth = (struct bb_vec3){ (double)NAN, (double)INFINITY, 0 };
	with = bb_room_drawing_svg(room, path, BB_ARRAY_LEN(path));
	assert_non_null(with);
	assert_true(strlen(with) > strlen(bare) + 1000);
	assert_int_equal(count(with, "nan"), 0);
	assert_int_equal(count(with, "inf"), 0);
	free(with);
	free(bare);
	bb_room_free(room);
}

static void names_cannot_become_markup(void **state)
{
	struct bb_error err = { 0 };
	struct bb_room *room = room_from("room: '\"><script>alert(1)</script> caf\xC3\xA9'\nnodes: [{id: a}]\nwalls:\n  - id: w\n"
	                                 "    pixels: [4, 3]\n    corners_m: {lower_left: [0, 0, 0], lower_right: [1, 0, 0], "
	                                 "upper_left: [0, 1, 0]}\n",
	                                 &err);
	char *svg;

	(void)state;
	assert_non_null(room);
	svg = bb_room_drawing_svg(room, NULL, 0);
	assert_non_null(svg);
	assert_null(strstr(svg, "script"));
	free(svg);
	memcpy(room->name, "\xFF\xC3(\xED\xA0\x80", 7); /* not UTF-8: must not spoil the drawing */
	svg = bb_room_drawing_svg(room, NULL, 0);
	assert_non_null(svg);
	assert_non_null(strstr(svg, "</svg>"));
	free(svg);
	bb_room_free(room);
}

static void files_are_written_whole(void **state)
{
	char folder[] = "/tmp/bb-draw-XXXXXX", file[64];
	struct bb_room *room = load("rooms/cabin.yaml");
	struct bb_error err = { 0 };
	struct stat st;
	png_image image = { .version = PNG_IMAGE_VERSION };

	(void)state;
	assert_non_null(mkdtemp(folder));
	snprintf(file, sizeof(file), "%s/a.png", folder);
	assert_int_equal(bb_room_drawing_write(room, file, &err), BB_OK);
	assert_true(png_image_begin_read_from_file(&image, file));
	assert_true(image.width > 1000 && image.height > 800);
	png_image_free(&image);
	unlink(file);
	snprintf(file, sizeof(file), "%s/a.svg", folder);
	assert_int_equal(bb_room_drawing_write(room, file, &err), BB_OK);
	assert_int_equal(stat(file, &st), 0);
	assert_true(st.st_size > 10000);
	unlink(file);
	snprintf(file, sizeof(file), "%s/no/a.svg", folder);
	assert_int_equal(bb_room_drawing_write(room, file, &err), BB_ERR_IO);
	assert_int_equal(err.number, 1901);
	err.number = 0;
	assert_int_equal(bb_room_drawing_write(room, "a.jpg", &err), BB_ERR_USAGE);
	assert_int_equal(err.number, 1850);
	assert_int_equal(rmdir(folder), 0); /* nothing half-written is left */
	bb_room_free(room);
}

static char *printed(const struct bb_room *room, bool json, int *errors)
{
	char *text = NULL;
	size_t n = 0;
	FILE *f = open_memstream(&text, &n);

	assert_non_null(f);
	*errors = bb_room_check_print(room, f, json);
	fclose(f);
	return text;
}

static void check_speaks_to_people_and_programs(void **state)
{
	struct bb_room *room = load("rooms/deck.yaml");
	json_error_t je;
	int errors;
	char *text = printed(room, false, &errors);

	(void)state;
	assert_int_equal(errors, 0);
	assert_non_null(strstr(text, "416 screens"));
	assert_non_null(strstr(text, "findings   none"));
	free(text);
	text = printed(room, true, &errors);
	json_t *doc = json_loads(text, JSON_REJECT_DUPLICATES, &je);
	assert_non_null(doc);
	assert_int_equal(json_integer_value(json_object_get(doc, "screens")), 416);
	assert_true(json_is_true(json_object_get(doc, "ok")));
	json_decref(doc);
	free(text);
	room->eye_separation_m = 0.63;
	text = printed(room, true, &errors);
	assert_int_equal(errors, 1);
	assert_non_null(strstr(text, "1155"));
	free(text);
	bb_room_free(room);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(svg_fits_into_a_page),       cmocka_unit_test(a_path_is_drawn_and_holes_are_left),
		cmocka_unit_test(names_cannot_become_markup), cmocka_unit_test(files_are_written_whole),
		cmocka_unit_test(check_speaks_to_people_and_programs),
	};
	const int failed = cmocka_run_group_tests(tests, NULL, NULL);

	bb_drawing_forget_fonts();
	return failed;
}
