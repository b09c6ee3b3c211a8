/*
 * tests/monitor_contract.h: what every monitor back end must do, as checks on an open monitor. Which back end it is, and
 * whether time passes or is waited for, is the business of whoever opens the bench: tests/contract_monitor.c for sims,
 * peers and the kernel's buses, tests/hw_monitor.h for a room. The monitor is on. Only the checks that say so write, and
 * those leave behind what they found; nothing is ever saved.
 */
#ifndef BB_TESTS_MONITOR_CONTRACT_H
#define BB_TESTS_MONITOR_CONTRACT_H

#include "hal/monitor.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define MONITOR_MS INT64_C(1000000)

struct monitor_bench {
	struct bb_monitor *m;
	struct bb_clock *clk;
	int64_t look_ns; /* between two looks whether the answer is there; 0: 1 ms */
	int rounds;      /* of what is repeated; 0: 50 */
	void *impl;
};

static inline void monitor_pass(struct monitor_bench *t, int64_t for_ns)
{
	bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + for_ns);
}

static inline struct bb_monitor_reply monitor_take(struct monitor_bench *t)
{
	const struct bb_monitor_limits *l = bb_monitor_limits(t->m);
	const int64_t parts = BB_MONITOR_TEXT_MAX / 32, end_ns = bb_clock_now_ns(t->clk) + parts * l->most_request_ns;
	struct bb_monitor_reply reply = { 0 };
	enum bb_status status;

	while ((status = bb_monitor_poll(t->m, &reply)) == BB_TIMEOUT && bb_clock_now_ns(t->clk) < end_ns)
		monitor_pass(t, t->look_ns ? t->look_ns : MONITOR_MS);
	assert_int_equal(status, BB_OK);
	assert_in_range(reply.tries, 1, l->most_tries);
	assert_true(reply.done_ns <= bb_clock_now_ns(t->clk));
	return reply;
}

static inline struct bb_monitor_reply monitor_ask(struct monitor_bench *t, enum bb_monitor_request_kind kind,
						  uint8_t code, uint16_t value)
{
	const struct bb_monitor_request request = { kind, code, value };
	const int64_t start_ns = bb_clock_now_ns(t->clk);

	assert_int_equal(bb_monitor_submit(t->m, &request), BB_OK);
	const struct bb_monitor_reply reply = monitor_take(t);
	assert_int_equal(reply.request.code, code);
	assert_true(kind == BB_MONITOR_CAPABILITIES ||
		    reply.done_ns - start_ns <= bb_monitor_limits(t->m)->most_request_ns);
	return reply;
}

static inline struct bb_monitor_reply monitor_get(struct monitor_bench *t, uint8_t code)
{
	return monitor_ask(t, BB_MONITOR_GET, code, 0);
}

static inline enum bb_status monitor_set(struct monitor_bench *t, uint8_t code, uint16_t value)
{
	return monitor_ask(t, BB_MONITOR_SET, code, value).status;
}

static inline void monitor_edid_is_whole(struct monitor_bench *t)
{
	const struct bb_monitor_reply r = monitor_ask(t, BB_MONITOR_EDID, 0, 0);
	static const uint8_t header[8] = { 0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0 };

	assert_int_equal(r.status, BB_OK);
	assert_memory_equal(r.edid, header, sizeof(header));
	assert_int_equal(r.edid_bytes, 128 * (1 + r.edid[126]));
	for (size_t block = 0; block < r.edid_bytes; block += 128) {
		unsigned int sum = 0;
		for (size_t i = 0; i < 128; i++)
			sum += r.edid[block + i];
		assert_int_equal(sum % 256, 0);
	}
}

/* Writes. */
static inline void monitor_writes_are_read_back(struct monitor_bench *t)
{
	const struct bb_monitor_reply before = monitor_get(t, BB_VCP_LUMINANCE);
	const uint16_t other = before.current > before.most / 2 ? before.current / 2 : before.current + before.most / 4;

	assert_int_equal(before.status, BB_OK);
	assert_int_equal(monitor_set(t, BB_VCP_LUMINANCE, other), BB_OK);
	const struct bb_monitor_reply r = monitor_get(t, BB_VCP_LUMINANCE);
	assert_int_equal(r.status, BB_OK);
	assert_int_equal(r.current, other);
	assert_int_equal(r.most, before.most);
	const enum bb_status status = monitor_set(t, BB_VCP_LUMINANCE, before.most + 1);
	assert_true(status == BB_ERR_RANGE || status == BB_OK); /* hardware may just ignore it */
	assert_in_range(monitor_get(t, BB_VCP_LUMINANCE).current, 0, before.most);
	assert_int_equal(monitor_set(t, BB_VCP_LUMINANCE, before.current), BB_OK);
	assert_int_equal(monitor_get(t, BB_VCP_LUMINANCE).current, before.current);
}

static inline void monitor_unknown_codes_are_unsupported(struct monitor_bench *t)
{
	assert_int_equal(monitor_get(t, 0x41).status, BB_ERR_UNSUPPORTED); /* of tubes only */
	assert_int_equal(monitor_get(t, BB_VCP_RESTORE_DEFAULTS).status, BB_ERR_UNSUPPORTED);
	assert_int_equal(monitor_set(t, BB_VCP_HOURS, 0), BB_ERR_UNSUPPORTED); /* known to be read-only: not written */
}

static inline void monitor_one_request_at_a_time(struct monitor_bench *t)
{
	const struct bb_monitor_request request = { BB_MONITOR_GET, BB_VCP_VERSION, 0 };
	struct bb_monitor_reply reply;

	assert_int_equal(bb_monitor_poll(t->m, &reply), BB_TIMEOUT);
	assert_int_equal(bb_monitor_submit(t->m, &request), BB_OK);
	assert_int_equal(bb_monitor_submit(t->m, &request), BB_ERR_BUSY);
	reply = monitor_take(t);
	assert_int_equal(reply.status, BB_OK);
	assert_in_range(reply.current, 0x0100, 0x0300); /* MCCS 1.0 .. 3.0 */
	assert_int_equal(bb_monitor_poll(t->m, &reply), BB_TIMEOUT);
	assert_int_equal(bb_monitor_submit(t->m, NULL), BB_ERR_USAGE);
	assert_int_equal(bb_monitor_submit(t->m, &(struct bb_monitor_request){ 9, 0, 0 }), BB_ERR_USAGE);
	bb_monitor_close(NULL);
}

static inline void monitor_power_off_is_refused(struct monitor_bench *t)
{
	const struct bb_monitor_request off = { BB_MONITOR_SET, BB_VCP_POWER_MODE, 5 };

	assert_int_equal(bb_monitor_submit(t->m, &off), BB_ERR_REFUSED);
	assert_int_equal(monitor_get(t, BB_VCP_POWER_MODE).current & 0xFF, 1);
}

static inline void monitor_saving_is_refused(struct monitor_bench *t)
{
	const struct bb_monitor_request save = { BB_MONITOR_SAVE, 0, 0 };
	const struct bb_monitor_request store = { BB_MONITOR_SET, BB_VCP_SETTINGS, 1 };

	assert_int_equal(bb_monitor_submit(t->m, &save), BB_ERR_REFUSED);
	assert_int_equal(bb_monitor_submit(t->m, &store), BB_ERR_REFUSED);
}

static inline void monitor_capabilities_are_text(struct monitor_bench *t)
{
	const struct bb_monitor_reply r = monitor_ask(t, BB_MONITOR_CAPABILITIES, 0, 0);

	assert_int_equal(r.status, BB_OK);
	assert_in_range(r.text_bytes, 40, sizeof(r.text));
	size_t at = 0;
	while (at + 4 <= r.text_bytes && memcmp(r.text + at, "vcp(", 4))
		at++;
	assert_true(at + 4 <= r.text_bytes);
}

static inline void monitor_reply_waits_are_kept(struct monitor_bench *t)
{
	for (int i = 0; i < (t->rounds ? t->rounds : 50); i++) {
		const int64_t start_ns = bb_clock_now_ns(t->clk);
		const struct bb_monitor_reply r = monitor_get(t, BB_VCP_LUMINANCE);
		assert_true(r.done_ns - start_ns >= r.tries * bb_monitor_limits(t->m)->reply_wait_ns);
	}
}

/* Writes what is there already. */
static inline void monitor_write_waits_are_kept(struct monitor_bench *t)
{
	const struct bb_monitor_limits *l = bb_monitor_limits(t->m);
	const uint16_t value = monitor_get(t, BB_VCP_LUMINANCE).current;

	for (int i = 0; i < (t->rounds ? t->rounds : 50); i++) {
		const int64_t start_ns = bb_clock_now_ns(t->clk);
		const struct bb_monitor_reply r = monitor_ask(t, BB_MONITOR_SET, BB_VCP_LUMINANCE, value);
		assert_int_equal(r.status, BB_OK);
		assert_true(r.done_ns - start_ns >= l->write_wait_ns + l->reply_wait_ns); /* and read back */
	}
}

#endif
