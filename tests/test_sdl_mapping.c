/* tests/test_sdl_mapping.c: lines of SDL_GameControllerDB, good and hostile, and a pad that is read through one. */
#include "tests/fixture_pads.h"

#include <fcntl.h>
#include <math.h>
#include <unistd.h>

static const char good[] =
	"030000006d04000019c2000010010000,Logitech RumblePad 2,a:b1,b:b2,x:b0,y:b3,back:b8,start:b9,"
	"leftshoulder:b4,rightshoulder:b5,lefttrigger:b6,righttrigger:b7,leftstick:b10,rightstick:b11,"
	"leftx:a0,lefty:a1,rightx:a2,righty:a3~,dpup:h0.1,dpright:h0.2,dpdown:h0.4,dpleft:h0.8,"
	"misc1:b12,platform:Linux,";

static enum bb_status parse(const char *line, struct bb_sdl_mapping *m, struct bb_error *err)
{
	const struct bb_where where = { "pads.txt", 3, 0 };
	const size_t n = strlen(line);
	char *copy = malloc(n ? n : 1); /* without its NUL */

	assert_non_null(copy);
	memcpy(copy, line, n);
	const enum bb_status status = bb_sdl_mapping_parse(copy, n, &where, m, err);
	free(copy);
	return status;
}

static void test_guid(void **state)
{
	(void)state;
	const struct bb_input_identity id = { .bus = 3, .vendor = 0x046D, .product = 0xC219 };
	static const uint8_t want[16] = { 0x03, 0, 0, 0, 0x6D, 0x04, 0, 0, 0x19, 0xC2, 0, 0, 0, 0, 0, 0 };
	uint8_t guid[16];

	bb_sdl_guid(&id, guid);
	assert_memory_equal(guid, want, 16);
}

static void test_good_line(void **state)
{
	(void)state;
	struct bb_sdl_mapping m;
	struct bb_error err = { 0 };

	if (parse(good, &m, &err) != BB_OK)
		fail_msg("%s", err.text);
	assert_string_equal(m.name, "Logitech RumblePad 2");
	assert_int_equal(m.n, 20);
	assert_true(m.binding[0].target == BB_SDL_A && m.binding[0].source == BB_SDL_FROM_BUTTON &&
		    m.binding[0].index == 1);
	assert_true(m.binding[15].target == BB_SDL_RIGHT_Y && m.binding[15].turned && m.binding[15].index == 3);
	assert_true(m.binding[16].source == BB_SDL_FROM_HAT && m.binding[16].hat_bit == 1);
	assert_int_equal(
		parse("030000006d04000019c2000010010000,x,-leftx:-a4,+leftx:+a4~,lefttrigger:+a2,platform:Linux,\r\n",
		      &m, NULL),
		BB_OK);
	assert_true(m.binding[0].target_half == -1 && m.binding[0].half == -1 && m.binding[1].turned);
	assert_true(m.binding[2].half == 1 && !m.binding[2].target_half);
}

static void test_skipped_lines(void **state)
{
	(void)state;
	static const char *const skipped[] = { "", "\n", "# Linux",
					       "030000006d04000019c2000010010000,x,a:b0,platform:Windows," };
	struct bb_sdl_mapping m;

	for (size_t i = 0; i < BB_ARRAY_LEN(skipped); i++)
		assert_int_equal(parse(skipped[i], &m, NULL), BB_SKIPPED);
}

static void test_bad_lines(void **state)
{
	(void)state;
	static const char *const bad[] = {
		"xyz",
		"030000006d04000019c200001001000,short,a:b0,",
		"030000006d04000019c20000100100zz,x,a:b0,",
		"030000006d04000019c2000010010000,x,a",
		"030000006d04000019c2000010010000,x,a:",
		"030000006d04000019c2000010010000,x,a:b",
		"030000006d04000019c2000010010000,x,a:b128",
		"030000006d04000019c2000010010000,x,a:b99999999999",
		"030000006d04000019c2000010010000,x,a:c1",
		"030000006d04000019c2000010010000,x,a:b1~",
		"030000006d04000019c2000010010000,x,a:h0",
		"030000006d04000019c2000010010000,x,a:h0.3",
		"030000006d04000019c2000010010000,x,a:h0.16",
		"030000006d04000019c2000010010000,x,a:+b1",
		"030000006d04000019c2000010010000,x,a:a1x",
		"030000006d04000019c2000010010000,x,a:+",
		"030000006d04000019c2000010010000,x,a:h.1",
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_sdl_mapping m;
		struct bb_error err = { 0 };
		if (parse(bad[i], &m, &err) != BB_ERR_CONFIG)
			fail_msg("row %zu is taken", i);
		assert_int_equal(err.number, 1564);
		assert_non_null(strstr(err.text, "pads.txt:3"));
	}
	/* Too many, too long. */
	char line[6000] = "030000006d04000019c2000010010000,x,";
	for (int i = 0; i < 33; i++)
		strcat(line, "a:b1,");
	struct bb_sdl_mapping m;
	assert_int_equal(parse(line, &m, NULL), BB_ERR_CONFIG);
	memset(line, 'a', 5000);
	line[5000] = '\0';
	assert_int_equal(parse(line, &m, NULL), BB_ERR_CONFIG);
}

static void test_find(void **state)
{
	(void)state;
	static const char text[] = "# a comment\nnot a line at all\n\n"
				   "03000000aabb00001122000000000000,broken,a:zzz,platform:Linux,\n"
				   "030000006d04000019c2000000000000,other version,a:b5,platform:Linux,\n"
				   "03001234 6d04,\n"
				   "0300abcd6d04000019c2000010010000,with checksum,a:b6,platform:Linux,\n"
				   "030000006d04000019c2000010010000,later,a:b7,platform:Linux,";
	struct bb_input_identity id = { .bus = 3, .vendor = 0x046D, .product = 0xC219, .version = 0x0110 };
	struct bb_sdl_mapping m;
	struct bb_error err = { 0 };

	assert_int_equal(bb_sdl_mapping_find(text, sizeof(text) - 1, "t", &id, &m, NULL), BB_OK);
	assert_string_equal(m.name, "with checksum");
	id.version = 0x0999;
	assert_int_equal(bb_sdl_mapping_find(text, sizeof(text) - 1, "t", &id, &m, NULL), BB_OK);
	assert_string_equal(m.name, "other version");
	id.product = 0xC218;
	assert_int_equal(bb_sdl_mapping_find(text, sizeof(text) - 1, "t", &id, &m, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1565);
	assert_non_null(strstr(err.text, "030000006d04000018c2000099090000"));
	id.vendor = 0xBBAA;
	id.product = 0x2211;
	err.number = 0;
	assert_int_equal(bb_sdl_mapping_find(text, sizeof(text) - 1, "t", &id, &m, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1564); /* its own line is broken: that is said, with the line */
	assert_non_null(strstr(err.text, "t:4"));
}

/* RumblePad 2 through the kernel's events and a line: A is B2 of the pad, the right stick is turned round. */
static void test_a_pad_through_a_line(void **state)
{
	(void)state;
	char map[32] = "/tmp/bb-map-XXXXXX", script[32] = "/tmp/bb-pad-XXXXXX", uri[64];
	static const char events[] =
		"0.1 button 2 down\n0.1 axis 1 -0.5 0\n0.1 axis 4 0.5 0\n0.1 axis 6 -1 0\n0.1 button 7 down\n";
	int fd = mkstemp(map);
	struct bb_pad_report r, last = { 0 };
	struct bb_gamepad *g;
	size_t n;

	assert_true(fd >= 0 && write(fd, good, strlen(good)) == (ssize_t)strlen(good));
	close(fd);
	fd = mkstemp(script);
	assert_true(fd >= 0 && write(fd, events, strlen(events)) == (ssize_t)strlen(events));
	close(fd);
	snprintf(uri, sizeof(uri), "evdev:046d:c219?mapping=%s", map);
	struct rig *rig = rig_create(7, 1);
	struct pad_far *far = pad_far_create_uri(rig, SIM_PEER_RUMBLEPAD2_WIRELESS, script, uri);
	const struct bb_gamepad_config c = { .id = "pad" };
	assert_int_equal(pad_far_open(far, rig, &c, &g), BB_OK);
	rig_pass(rig, 300 * RIG_MS);
	while (bb_gamepad_read(g, &r, 1, &n) == BB_OK)
		last = r;
	assert_int_equal(last.buttons, 1u << BB_SDL_A | 1u << 11); /* and the left trigger */
	assert_true(fabsf(last.axis[0] + 0.5f) < 0.02f && fabsf(last.axis[3] + 0.5f) < 0.02f);
	assert_true(fabsf(last.axis[5] + 1) < 1e-6f && fabsf(last.axis[4]) < 1e-6f);
	bb_gamepad_close(g);
	pad_far_destroy(far);
	/* A file without a line for it is a configuration error. */
	fd = open(map, O_WRONLY | O_TRUNC);
	assert_true(fd >= 0 && write(fd, "# nothing\n", 10) == 10);
	close(fd);
	far = pad_far_create_uri(rig, SIM_PEER_RUMBLEPAD2_WIRELESS, script, uri);
	assert_int_equal(pad_far_open(far, rig, &c, &g), BB_ERR_CONFIG);
	pad_far_destroy(far);
	rig_destroy(rig);
	unlink(map);
	unlink(script);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_guid),          cmocka_unit_test(test_good_line),
		cmocka_unit_test(test_skipped_lines), cmocka_unit_test(test_bad_lines),
		cmocka_unit_test(test_find),          cmocka_unit_test(test_a_pad_through_a_line),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
