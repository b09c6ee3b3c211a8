/* tests/test_recorded.c: optical recordings as text: what is taken, and every way to be refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sync/optics/recorded.h"

#define MAGIC "# blackburst optics 1\n"
#define KEYS "# rate_hz: 119.982\n# bandwidth_hz: 2e4\n# show: white-black 0 0.2\n# show: black-black 0.2 0.4\n"
#define COLUMNS "t_s,front.top.left_v,lamp.right_v\n"

struct seen {
	uint64_t n;
	int64_t sum_ns;
	double sum;
};

static void take(void *ctx, const struct bb_recording *r, int64_t at_ns, const double *volts)
{
	struct seen *s = ctx;

	s->n++;
	s->sum_ns += at_ns;
	for (size_t i = 0; i < r->n_channels; i++)
		s->sum += volts[i] * (double)(i + 1);
}

/* piece: bytes pushed at once. Returns the error's number, 0 for none. */
static int read_text(const char *text, size_t n, size_t piece, struct bb_recorded *r, struct seen *seen)
{
	struct bb_error err = { 0 };
	enum bb_status status = BB_OK;

	*seen = (struct seen){ 0 };
	bb_recorded_begin(r, "x.csv", take, seen);
	for (size_t at = 0; at < n && status == BB_OK; at += piece)
		status = bb_recorded_push(r, text + at, n - at < piece ? n - at : piece, &err);
	if (status == BB_OK)
		status = bb_recorded_end(r, &err);
	assert_true((status == BB_OK) == (err.number == 0));
	if (err.number)
		assert_non_null(strstr(err.text, "x.csv"));
	return err.number;
}

static void reads_in_any_pieces(void **state)
{
	static const char text[] = MAGIC "# made by hand: a note for people\n" KEYS COLUMNS
					 "0.000000000,0.5,-1e-3\r\n0.00002,.25,1\n# in between\n\n4.0e-5,+2,3\n";
	struct bb_recorded *r = malloc(sizeof(*r));
	(void)state;

	for (size_t piece = 1; piece < sizeof(text); piece++) {
		struct seen s;
		assert_int_equal(read_text(text, sizeof(text) - 1, piece, r, &s), 0);
		assert_int_equal(s.n, 3);
		assert_int_equal(s.sum_ns, 60000);
		assert_true(fabs(s.sum - (2.75 + 2 * 3.999)) < 1e-12);
		assert_int_equal(r->recording.n_shows, 2);
		assert_int_equal(r->recording.show[1].from_ns, 200000000);
		assert_true(fabs(bb_rate_hz(r->recording.rate) - 119.982) < 1e-6);
		assert_int_equal(r->recording.channel[1].spot, BB_SPOT_LAMP);
		assert_string_equal(r->recording.channel[0].wall, "front");
	}
	free(r);
}

static void refuses_what_is_wrong(void **state)
{
	static const struct {
		int number;
		const char *text;
	} bad[] = {
		{ 1630, "" },
		{ 1630, "t_s,a\n" },
		{ 1630, "# blackburst optics 2\n" },
		{ 1631, MAGIC "# bandwith_hz: 1\n" },
		{ 1631, MAGIC "# rate_hz: nan\n" },
		{ 1631, MAGIC "# rate_hz: 0x78\n" },
		{ 1631, MAGIC "# rate_hz: 1e9\n" },
		{ 1631, MAGIC "# rate_hz: 120 Hz\n" },
		{ 1631, MAGIC "# show: grey-black 0 1\n" },
		{ 1631, MAGIC "# show: white-black 0\n" },
		{ 1631, MAGIC "# show: white-black 0 1 2\n" },
		{ 1631, MAGIC "# show: white-black 1 0\n" },
		{ 1631, MAGIC "# show: white-black 0 inf\n" },
		{ 1631, MAGIC "# show: white-black 0 1\n# show: black-black 0.5 2\n" },
		{ 1632, MAGIC KEYS "time,front.top.left_v\n" },
		{ 1632, MAGIC KEYS "t_s\n" },
		{ 1632, MAGIC KEYS "t_s,front.top.left\n" },
		{ 1632, MAGIC KEYS "t_s,front.side.left_v\n" },
		{ 1632, MAGIC KEYS "t_s,front.top.both_v\n" },
		{ 1632, MAGIC KEYS "t_s,top.left_v\n" },
		{ 1632, MAGIC KEYS "t_s,front.lamp.left_v\n" },
		{ 1632, MAGIC KEYS "t_s,front.top.left_v,front.top.left_v\n" },
		{ 1632, MAGIC KEYS "t_s,a-wall-with-a-name-of-more-than-31-bytes.top.left_v\n" },
		{ 1633, MAGIC "# rate_hz: 120\n" COLUMNS },
		{ 1633, MAGIC "# show: white-black 0 1\n" COLUMNS },
		{ 1634, MAGIC KEYS COLUMNS "0,nan,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "0,inf,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "0,1e400,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "0,1e7,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "0,,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "x,1,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "2e6,1,1\n" },
		{ 1634, MAGIC KEYS COLUMNS "-inf,1,1\n" },
		{ 1635, MAGIC KEYS COLUMNS "1,1,1\n1,1,1\n" },
		{ 1635, MAGIC KEYS COLUMNS "1,1,1\n0.5,1,1\n" },
		{ 1636, MAGIC KEYS COLUMNS "1,1\n" },
		{ 1636, MAGIC KEYS COLUMNS "1,1,1,1\n" },
		{ 1636, MAGIC KEYS COLUMNS "1;1;1\n" },
		{ 1636, MAGIC KEYS COLUMNS "1,0,5,0,5\n" },
		{ 1637, MAGIC KEYS },
		{ 1637, MAGIC KEYS COLUMNS "1,1,1" },
	};
	struct bb_recorded *r = malloc(sizeof(*r));
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		for (size_t piece = 1; piece < 200; piece += 61) {
			struct seen s;
			const int got = read_text(bad[i].text, strlen(bad[i].text), piece, r, &s);
			if (got != bad[i].number)
				fail_msg("case %zu: BB%d, want BB%d: %s", i, got, bad[i].number, bad[i].text);
		}
	free(r);
}

static void is_bounded(void **state)
{
	struct bb_recorded *r = malloc(sizeof(*r));
	char *text = malloc(BB_RECORDED_LINE * 4);
	struct seen s;
	size_t n;
	(void)state;

	n = (size_t)sprintf(text, MAGIC);
	memset(text + n, 'x', BB_RECORDED_LINE);
	text[n] = '#';
	assert_int_equal(read_text(text, n + BB_RECORDED_LINE, 100, r, &s), 1630);
	n = (size_t)sprintf(text, MAGIC);
	for (int i = 0; i <= BB_SHOWS_MAX; i++)
		n += (size_t)sprintf(text + n, "# show: white-black %d %d.5\n", i, i);
	assert_int_equal(read_text(text, n, 100, r, &s), 1631);
	n = (size_t)sprintf(text, MAGIC KEYS "t_s");
	for (int i = 0; i <= BB_CHANNELS_MAX; i++)
		n += (size_t)sprintf(text + n, ",w%d.top.left_v", i);
	n += (size_t)sprintf(text + n, "\n");
	assert_int_equal(read_text(text, n, 100, r, &s), 1632);
	n = (size_t)sprintf(text, MAGIC KEYS COLUMNS "1,1,");
	text[n++] = '\0';
	text[n++] = '\n';
	assert_int_equal(read_text(text, n, 100, r, &s), 1630);
	free(text);
	free(r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(reads_in_any_pieces),
		cmocka_unit_test(refuses_what_is_wrong),
		cmocka_unit_test(is_bounded),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
