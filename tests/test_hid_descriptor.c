/* tests/test_hid_descriptor.c: the walk over HID report descriptors: good ones, huge ones, hostile ones. */
#include "drivers/hid_descriptor.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sim/peer_pads_impl.h"
#include "sim/sim_gamepad.h"

static struct bb_hid_layout layout;

static enum bb_status parse(const uint8_t *bytes, size_t n, struct bb_error *err)
{
	/* Exactly as long as it is, so that a sanitizer sees a step past the end. */
	uint8_t *copy = malloc(n ? n : 1);

	assert_non_null(copy);
	memcpy(copy, bytes, n);
	const enum bb_status status = bb_hid_layout_parse(copy, n, "pad", &layout, err);
	free(copy);
	return status;
}

static void test_far_ends(void **state)
{
	(void)state;
	static const struct {
		enum sim_peer_kind kind;
		enum bb_hid_way way;
		uint8_t id;
		size_t bytes;
	} want[] = {
		{ SIM_PEER_RUMBLEPAD2_WIRED, BB_HID_INPUT, 0, 8 },
		{ SIM_PEER_RUMBLEPAD2_WIRED, BB_HID_OUTPUT, 0, 7 },
		{ SIM_PEER_RUMBLEPAD2_WIRELESS, BB_HID_INPUT, 1, 8 },
		{ SIM_PEER_RUMBLEPAD2_WIRELESS, BB_HID_OUTPUT, 1, 8 },
		{ SIM_PEER_SPACENAVIGATOR, BB_HID_INPUT, 1, 7 },
		{ SIM_PEER_SPACENAVIGATOR, BB_HID_INPUT, 2, 7 },
		{ SIM_PEER_SPACENAVIGATOR, BB_HID_INPUT, 3, 3 },
		{ SIM_PEER_SPACENAVIGATOR, BB_HID_OUTPUT, 4, 2 },
		{ SIM_PEER_SPACEMOUSE_WIRELESS, BB_HID_INPUT, 1, 13 },
		{ SIM_PEER_SPACEMOUSE_WIRELESS, BB_HID_INPUT, 0x17, 2 },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(want); i++) {
		size_t n = 0;
		const uint8_t *bytes = sim_peer_hid_descriptor(want[i].kind, &n);
		struct bb_error err = { 0 };
		if (parse(bytes, n, &err) != BB_OK)
			fail_msg("%s", err.text);
		const struct bb_hid_report *r = bb_hid_layout_report(&layout, want[i].way, want[i].id);
		assert_non_null(r);
		assert_int_equal(bb_hid_report_bytes(r), want[i].bytes);
		assert_int_equal(layout.usage_page, 1);
	}
	assert_null(bb_hid_layout_report(&layout, BB_HID_FEATURE, 1));
}

static void test_fields(void **state)
{
	(void)state;
	size_t n = 0;
	const uint8_t *bytes = sim_peer_hid_descriptor(SIM_PEER_RUMBLEPAD2_WIRED, &n);

	assert_int_equal(parse(bytes, n, NULL), BB_OK);
	assert_int_equal(layout.usage, 4);
	assert_int_equal(layout.n_fields, 5);
	const struct bb_hid_field *f = layout.field;
	assert_true(f[0].bits == 8 && f[0].count == 4 && f[0].usage_least == 0x30 && f[0].usage_most == 0x35);
	assert_true(f[0].logical_least == 0 && f[0].logical_most == 255 && f[0].variable && !f[0].constant);
	assert_true(f[1].bits == 4 && f[1].bit_offset == 32 && f[1].logical_most == 7);
	assert_true(f[2].bits == 1 && f[2].count == 12 && f[2].bit_offset == 36 && f[2].usage_page == 9);
	assert_true(f[3].bit_offset == 48 && f[3].usage_page == 0xFF00);
	assert_true(f[4].way == BB_HID_OUTPUT && f[4].bit_offset == 0 && f[4].count == 7);
}

/* Valid and huge: a trackball with 2048 values, a range over all usages there are. */
static void test_huge_is_fine(void **state)
{
	(void)state;
	static const uint8_t huge[] = { 0x05, 0x01, 0x09, 0x02, 0xA1, 0x01, 0x1A, 0x00, 0x00, 0x2A,
					0xFF, 0xFF, 0x96, 0x00, 0x08, 0x75, 0x08, 0x81, 0x02, 0xC0 };
	static const uint8_t extended[] = { 0x0B, 0x30, 0x00, 0x01, 0x00, 0x75, 0x08, 0x95, 0x01, 0x81, 0x02 };

	assert_int_equal(parse(huge, sizeof(huge), NULL), BB_OK);
	assert_int_equal(layout.n_fields, 1);
	assert_int_equal(layout.report[0].bits, 2048 * 8);
	assert_true(layout.field[0].usage_least == 0 && layout.field[0].usage_most == 0xFFFF);
	assert_int_equal(parse(extended, sizeof(extended), NULL), BB_OK);
	assert_true(layout.field[0].usage_page == 1 && layout.field[0].usage_least == 0x30);
}

static void test_push_and_pop(void **state)
{
	(void)state;
	static const uint8_t d[] = { 0x05, 0x09, 0x75, 0x01, 0x95, 0x08, 0xA4, 0x05, 0x01, 0x75, 0x10, 0x95, 0x02,
				     0x81, 0x02, 0xB4, 0x81, 0x02, 0xFE, 0x02, 0x10, 0xAA, 0xBB, 0xB1, 0x02 };

	assert_int_equal(parse(d, sizeof(d), NULL), BB_OK);
	assert_int_equal(layout.n_fields, 3);
	assert_true(layout.field[0].bits == 16 && layout.field[1].bits == 1 && layout.field[1].usage_page == 9);
	assert_true(layout.field[1].bit_offset == 32 && layout.field[2].way == BB_HID_FEATURE);
}

static void test_hostile(void **state)
{
	(void)state;
	static const struct {
		const char *why;
		size_t n;
		uint8_t bytes[24];
	} bad[] = {
		{ "no field", 0, { 0 } },
		{ "no field", 6, { 0x05, 0x01, 0x09, 0x04, 0x75, 0x08 } },
		{ "past the end", 2, { 0x26, 0xFF } }, /* four bytes into a two-byte field, TinyUSB's */
		{ "past the end", 4, { 0x27, 0xFF, 0xFF, 0xFF } },
		{ "past the end", 1, { 0xFE } },
		{ "past the end", 3, { 0xFE, 0x05, 0x10 } },
		{ "never began", 1, { 0xC0 } },
		{ "does not end", 8, { 0xA1, 0x01, 0x75, 0x08, 0x95, 0x01, 0x81, 0x02 } },
		{ "pop without", 1, { 0xB4 } },
		{ "32 bits", 6, { 0x75, 0x40, 0x95, 0x01, 0x81, 0x02 } },
		{ "16384 bytes", 12, { 0x75, 0x20, 0x97, 0xFF, 0xFF, 0xFF, 0xFF, 0x81, 0x02 } },
		{ "16384 bytes", 11, { 0x77, 0x00, 0x00, 0x00, 0x80, 0x95, 0x04, 0x81, 0x03, 0x81, 0x03 } },
		{ "report id", 2, { 0x85, 0x00 } },
		{ "report id", 3, { 0x86, 0x00, 0x01 } },
		{ "report id", 8, { 0x75, 0x08, 0x95, 0x01, 0x81, 0x02, 0x85, 0x01 } },
		{ "main item", 1, { 0x70 | 0x80 | 0x40 } },
		{ "global item", 1, { 0xC4 } },
		{ "usage page", 5, { 0x07, 0x00, 0x00, 0x01, 0x00 } },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_error err = { 0 };
		assert_int_equal(parse(bad[i].bytes, bad[i].n, &err), BB_ERR_FORMAT);
		assert_int_equal(err.number, 1560);
		assert_non_null(strstr(err.text, "DESC_REJECT at byte "));
		if (!strstr(err.text, bad[i].why))
			fail_msg("row %zu: %s", i, err.text);
	}
}

static void test_caps(void **state)
{
	(void)state;
	static const struct {
		uint8_t unit[6];
		size_t n_unit, most;
		const char *why;
	} caps[] = {
		{ { 0xA1, 0x00 }, 2, 16, "deeper than 16" },
		{ { 0xA4 }, 1, 16, "more than 16 pushes" },
		{ { 0x81, 0x03 }, 2, 1024, "more than 1024 fields" },
		{ { 0x05, 0x01 }, 2, 2048, "longer than 4096" },
	};
	uint8_t bytes[4200];
	struct bb_error err;

	for (size_t i = 0; i < BB_ARRAY_LEN(caps); i++) {
		size_t n = 0;
		for (size_t k = 0; k <= caps[i].most; k++, n += caps[i].n_unit)
			memcpy(bytes + n, caps[i].unit, caps[i].n_unit);
		err = (struct bb_error){ 0 };
		assert_int_equal(parse(bytes, n, &err), BB_ERR_FORMAT);
		if (!strstr(err.text, caps[i].why))
			fail_msg("row %zu: %s", i, err.text);
	}
	/* More ids than there is room for. */
	size_t n = 0;
	for (uint8_t id = 1; id <= 65; id++) {
		const uint8_t one[] = { 0x85, id, 0x75, 0x08, 0x95, 0x01, 0x81, 0x02 };
		memcpy(bytes + n, one, sizeof(one));
		n += sizeof(one);
	}
	err = (struct bb_error){ 0 };
	assert_int_equal(parse(bytes, n, &err), BB_ERR_FORMAT);
	assert_non_null(strstr(err.text, "more than 64 reports"));
	assert_int_equal(parse(bytes, n - 8, NULL), BB_OK);
}

/* Every good descriptor cut short anywhere is refused or read, never a crash. */
static void test_cut_short(void **state)
{
	(void)state;
	for (int kind = 0; kind < SIM_PEER_XBOX_PAD; kind++) {
		size_t n = 0;
		const uint8_t *bytes = sim_peer_hid_descriptor((enum sim_peer_kind)kind, &n);
		for (size_t k = 0; k < n; k++)
			assert_int_equal(parse(bytes, k, NULL), BB_ERR_FORMAT);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_far_ends),     cmocka_unit_test(test_fields),
		cmocka_unit_test(test_huge_is_fine), cmocka_unit_test(test_push_and_pop),
		cmocka_unit_test(test_hostile),      cmocka_unit_test(test_caps),
		cmocka_unit_test(test_cut_short),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
