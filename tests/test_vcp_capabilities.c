/* tests/test_vcp_capabilities.c: the capabilities reader against strings as standards, logs and damage make them. */
#include "drivers/vcp_capabilities.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static const char plain[] = "(prot(monitor)type(LCD)model(RTK)cmds(01 02 03 07 0C E3 F3)vcp(02 04 05 08 10 12 "
			    "14(01 05 06 08 0B) 16 18 1A 52 60(01 03 04 0F 10 11 12) AC AE B2 B6 C6 C8 CA CC(01 02 03) "
			    "D6(01 04 05) DF FD FF)mswhql(1)asset_eep(40)mccs_ver(2.2))";

static struct vcp_capabilities read(const char *text)
{
	struct vcp_capabilities c;

	assert_int_equal(vcp_capabilities_parse(text, strlen(text), &c), BB_OK);
	return c;
}

static void test_plain(void **state)
{
	(void)state;
	const struct vcp_capabilities c = read(plain);

	assert_string_equal(c.prot, "monitor");
	assert_string_equal(c.type, "LCD");
	assert_string_equal(c.model, "RTK");
	assert_true(c.mccs_major == 2 && c.mccs_minor == 2);
	assert_true(c.command[0x01] && c.command[0xF3] && !c.command[0x02 + 2]);
	assert_int_equal(c.n_codes, 24);
	assert_true(c.code[0x10].known && !c.code[0x11].known);
	assert_int_equal(c.code[0x60].n, 7);
	assert_true(vcp_capabilities_allow(&c, 0x60, 0x12) && !vcp_capabilities_allow(&c, 0x60, 0x13));
	assert_true(vcp_capabilities_allow(&c, 0x10, 77) && !vcp_capabilities_allow(&c, 0x11, 1));
	assert_false(c.unbalanced || c.noise);
}

static void test_tolerance(void **state)
{
	(void)state;
	/* No blank after a list, blanks at odd places, small letters, no outer bracket. */
	struct vcp_capabilities c = read("vcp(10 12 60( 0F 11 12 )62 8D d6(01 04))");
	assert_true(c.code[0x62].known && c.code[0x8D].known && c.code[0xD6].known);
	assert_int_equal(c.code[0x60].n, 3);
	assert_false(c.unbalanced);
	c = read("(vcp(10(00 64 60(11 12) D6)type(lcd)"); /* a list that never ends does not swallow the rest */
	assert_true(c.unbalanced && c.code[0x10].known);
	assert_string_equal(c.type, "lcd");
	c = read("(prot(monitor)vcp(10 12 16 mswhql(1)mccs_ver(2.1))");
	assert_true(c.unbalanced && c.code[0x16].known && c.mccs_minor == 1);
	c = read("(vcp(101214))"); /* no blanks at all */
	assert_true(c.code[0x10].known && c.code[0x12].known && c.code[0x14].known && c.n_codes == 3);
	c = read("(vcp(10 zz 12 \xFF 14 , 16))");
	assert_true(c.noise && c.code[0x16].known && c.n_codes == 4);
	c = read("(type(lcd)model(");
	assert_true(c.unbalanced && !c.model[0]);
	c = read(")type(lcd)model(`");
	assert_true(c.unbalanced);
	assert_string_equal(c.model, "`");
	c = read("(model(a model whose name is much longer than any field has room for))");
	assert_int_equal(strlen(c.model), 31);
	c = read("(window1(type(PIP)area(25 25 1895 1175)max(640 480))vcp(10))"); /* lists in lists */
	assert_true(c.code[0x10].known && !c.unbalanced);
	assert_string_equal(c.type, "");
}

/* Cut anywhere, it never finds more than the whole had. */
static void test_cut(void **state)
{
	(void)state;
	const struct vcp_capabilities whole = read(plain);

	for (size_t n = 0; n < sizeof(plain) - 1; n++) {
		char *exact = malloc(n ? n : 1);
		struct vcp_capabilities c;
		assert_non_null(exact);
		memcpy(exact, plain, n);
		const enum bb_status status = vcp_capabilities_parse(exact, n, &c);
		assert_int_equal(status, n > 5 ? BB_OK : BB_ERR_FORMAT);
		if (n > 5)
			assert_true(c.unbalanced);
		size_t extra = 0;
		for (int i = 0; i < 256; i++)
			extra += c.code[i].known && !whole.code[i].known;
		assert_true(extra <= 1); /* "AC" cut to "A" */
		free(exact);
	}
}

static void test_nothing(void **state)
{
	(void)state;
	struct vcp_capabilities c;
	static const char *const none[] = { "", "(((((((", "))))", "\xFF\xFE\xFD", "hello", "10 12 14" };

	for (size_t i = 0; i < BB_ARRAY_LEN(none); i++)
		assert_int_equal(vcp_capabilities_parse(none[i], strlen(none[i]), &c), BB_ERR_FORMAT);
}

static void test_too_much(void **state)
{
	(void)state;
	static char text[20000];
	size_t n = 0;
	struct vcp_capabilities c;

	n += (size_t)strlen(strcpy(text, "(vcp("));
	for (unsigned int code = 0; code < 200; code++) {
		memcpy(text + n, "10(", 3);
		n += 3;
		for (int i = 0; i < 20; i++) {
			memcpy(text + n, "AB ", 3);
			n += 3;
		}
		text[n++] = ')';
	}
	assert_int_equal(vcp_capabilities_parse(text, n, &c), BB_OK);
	assert_int_equal(c.n_values, VCP_CAPABILITIES_VALUES);
	assert_int_equal(c.n_codes, 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_plain),   cmocka_unit_test(test_tolerance), cmocka_unit_test(test_cut),
		cmocka_unit_test(test_nothing), cmocka_unit_test(test_too_much),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
