/*
 * tests/monitor_numbers.h: how long a VCP get takes and how many tries it needs, on a clean display and on each with a
 * quirk: the same rows on the virtual clock (tests/test_faults_monitor.c) and on a kernel's bus (tests/guest/monitors.c).
 */
#ifndef BB_TESTS_MONITOR_NUMBERS_H
#define BB_TESTS_MONITOR_NUMBERS_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/monitor_ddc.h"
#include "sim/peer_ddcci.h"

#define NUMBERS_MOST 1000
#define NUMBERS_THINK_NS INT64_C(30000000)
#define NUMBERS_REST_NS INT64_C(110000000) /* the longest wait between two messages: not counted */

static const struct numbers_display {
	const char *name, *key;
	struct peer_quirks quirks;
	double most_mean; /* tries a request */
} numbers_displays[] = {
	{ "clean", "clean", { .think_ns = NUMBERS_THINK_NS }, 1 },
	{ "2 % busy", "busy2", { .think_ns = NUMBERS_THINK_NS, .busy_percent = 2 }, 1.4 },
	{ "20 % busy", "busy20", { .think_ns = NUMBERS_THINK_NS, .busy_percent = 20 }, 1.4 },
	{ "doubled source byte", "doubled", { .think_ns = NUMBERS_THINK_NS, .doubled_source = true }, 1.4 },
	{ "Null for unsupported", "null", { .think_ns = NUMBERS_THINK_NS, .null_for_unsupported = true }, 1.4 },
	{ "zeros for unsupported", "zeros", { .think_ns = NUMBERS_THINK_NS, .zero_for_unsupported = true }, 1.4 },
	{ "malformed capabilities", "malformed", { .think_ns = NUMBERS_THINK_NS, .malformed_capabilities = true }, 1 },
	{ "slow: after 60 ms", "slow", { .think_ns = 2 * NUMBERS_THINK_NS }, 1.4 },
	{ "all of them, 5 % busy", "all", { true, true, false, true, false, 2 * NUMBERS_THINK_NS, 5 }, 1.4 },
};

struct numbers {
	size_t n;
	int64_t ns[NUMBERS_MOST]; /* sorted */
	unsigned int tries[MONITOR_DDC_MOST_TRIES + 1], wrong;
	double mean_tries;
	unsigned int text_tries; /* of the capabilities, 0: not read */
	int64_t text_ns;
};

static inline struct bb_monitor_reply numbers_ask(struct bb_monitor *m, struct bb_clock *clk, int64_t look_ns,
						  enum bb_monitor_request_kind kind, uint8_t code, int64_t *took_ns)
{
	const struct bb_monitor_request q = { kind, code, 0 };
	const int64_t start_ns = bb_clock_now_ns(clk);
	struct bb_monitor_reply r = { .status = BB_ERR_INTERNAL };

	if (bb_monitor_submit(m, &q) == BB_OK)
		while (bb_monitor_poll(m, &r) == BB_TIMEOUT)
			bb_clock_run_until(clk, bb_clock_now_ns(clk) + look_ns);
	*took_ns = r.done_ns - start_ns;
	bb_clock_run_until(clk, bb_clock_now_ns(clk) + NUMBERS_REST_NS);
	return r;
}

static inline int numbers_by_ns(const void *a, const void *b)
{
	const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;

	return (x > y) - (x < y);
}

/* One in eight is a code the display does not have. */
static inline void numbers_measure(struct numbers *out, struct bb_monitor *m, struct bb_clock *clk, int64_t look_ns, size_t n)
{
	static const uint8_t codes[] = { 0x10, 0x12, 0x60, 0x16, 0xD6, 0x59, 0xDF, 0xC0 };
	uint64_t all = 0;

	memset(out, 0, sizeof(*out));
	out->n = n;
	for (size_t i = 0; i < n; i++) {
		const uint8_t code = codes[i % sizeof(codes)];
		const struct bb_monitor_reply r = numbers_ask(m, clk, look_ns, BB_MONITOR_GET, code, &out->ns[i]);
		out->wrong += r.status != (code == 0x59 ? BB_ERR_UNSUPPORTED : BB_OK);
		out->tries[r.tries <= MONITOR_DDC_MOST_TRIES ? r.tries : 0]++;
		all += r.tries;
	}
	const struct bb_monitor_reply text = numbers_ask(m, clk, look_ns, BB_MONITOR_CAPABILITIES, 0, &out->text_ns);
	out->wrong += text.status != BB_OK || text.text_bytes < 100;
	out->text_tries = text.tries;
	out->mean_tries = (double)all / (double)n;
	qsort(out->ns, n, sizeof(out->ns[0]), numbers_by_ns);
}

static inline void numbers_head(void)
{
	printf("%-24s %5s %6s %8s %8s %8s %10s  %s\n", "VCP get, ms", "gets", "mean", "p50", "p99", "max", "cap. text",
	       "tries 1..10");
}

static inline void numbers_print(const struct numbers_display *d, const struct numbers *v)
{
	printf("%-24s %5zu %6.2f %8.2f %8.2f %8.2f %10.2f ", d->name, v->n, v->mean_tries, (double)v->ns[v->n / 2] / 1e6,
	       (double)v->ns[v->n * 99 / 100] / 1e6, (double)v->ns[v->n - 1] / 1e6, (double)v->text_ns / 1e6);
	for (int i = 1; i <= MONITOR_DDC_MOST_TRIES; i++)
		printf(" %u", v->tries[i]);
	printf("\n");
}

#endif
