/*
 * tests/guest/gpio_edges.c: gpio_edges URI SECONDS [HZ]: the edges of a GPIO line through the shipped driver for a
 * time, as one line of JSON: what came, what was lost, and how long an edge's stamp took to the reader. It waits on the
 * line's descriptor, as an event loop would; the latency is from the kernel's stamp to the return of the read.
 * Exit 0: every edge came, with its eye; 1: not; 77: there is no such line here.
 */
#include "tests/guest/measure.h"

#include <poll.h>

#include "drivers/shutter_gpio.h"

#define EDGES_MOST 2000000

struct tally {
	uint64_t edges, missing, untold, repeated_eyes, wrong_steps;
	struct bb_shutter_edge first, last;
	int64_t *latency_ns;
};

static void say(void *ctx, enum bb_log_level level, const char *line)
{
	(void)ctx;
	(void)level;
	fprintf(stderr, "gpio_edges: %s\n", line);
}

static void take(struct tally *t, const struct bb_shutter_edge *e, int64_t now_ns)
{
	if (t->edges == EDGES_MOST)
		return;
	if (t->edges) {
		t->missing += e->seq - t->last.seq - 1;
		t->repeated_eyes += e->eye != BB_EYE_NONE && e->seq == t->last.seq + 1 && e->eye == t->last.eye;
	} else {
		t->first = *e;
	}
	t->untold += t->edges && e->eye == BB_EYE_NONE; /* nothing confirms the first */
	t->latency_ns[t->edges++] = now_ns - e->at_ns;
	t->last = *e;
}

static enum bb_status listen(struct bb_shutter *sh, struct bb_clock *clk, double seconds, struct tally *t)
{
	const int64_t end_ns = bb_clock_now_ns(clk) + (int64_t)(seconds * 1e9);
	struct pollfd p = { .events = POLLIN };
	struct bb_shutter_edge e[64];
	enum bb_status status = BB_OK;
	size_t n;

	while (bb_clock_now_ns(clk) < end_ns) {
		p.fd = bb_shutter_gpio_fd(sh);
		poll(&p, 1, 20);
		while ((status = bb_shutter_read(sh, e, BB_ARRAY_LEN(e), &n)) == BB_OK) {
			const int64_t now_ns = bb_clock_now_ns(clk);
			for (size_t i = 0; i < n; i++)
				take(t, &e[i], now_ns);
		}
		if (status < 0)
			return status;
	}
	return BB_OK;
}

static bool print(const struct bb_shutter *sh, struct tally *t, const char *uri, enum bb_status status)
{
	const struct bb_edge_lock *l = bb_shutter_gpio_lock(sh);
	const double span_ns = (double)(t->last.at_ns - t->first.at_ns);
	const uint32_t steps = t->last.seq - t->first.seq;
	const uint64_t parity = t->repeated_eyes + l->unmatched + l->fault[BB_SYNC_SWAP].n;
	const bool pass = status == BB_OK && t->edges > 1 && !t->missing && !parity && !t->untold;

	printf("{\"program\": \"gpio_edges\", \"uri\": \"%s\", \"status\": \"%s\", \"health\": \"%s\", \"edges\": %llu, "
	       "\"lost\": %llu, \"parity_errors\": %llu, \"untold_eyes\": %llu, \"overruns\": %llu, \"glitches\": %llu, "
	       "\"period_us\": %.4f",
	       uri, bb_status_text(status), bb_health_text(bb_shutter_gpio_health(sh)), (unsigned long long)t->edges,
	       (unsigned long long)t->missing, (unsigned long long)parity, (unsigned long long)t->untold,
	       (unsigned long long)l->fault[BB_SYNC_OVERRUN].n, (unsigned long long)l->fault[BB_SYNC_GLITCH].n,
	       steps ? span_ns / steps * 1e-3 : 0);
	if (t->edges)
		print_latency("stamp_to_user", t->latency_ns, t->edges);
	printf(", \"pass\": %s}\n", pass ? "true" : "false");
	return pass;
}

static int run(const struct bb_uri *uri, const char *text, double seconds, double hz)
{
	const struct bb_shutter_config config = { .id = "line", .rate = bb_rate_from_hz(hz) };
	const struct bb_log log = { say, NULL, BB_LOG_WARN };
	struct tally t = { .latency_ns = calloc(EDGES_MOST, sizeof(int64_t)) };
	struct bb_shutter *sh = NULL;
	struct bb_clock *clk;
	int code = 77;

	if (!t.latency_ns || bb_clock_posix_create(&clk) != BB_OK)
		return 1;
	const struct bb_open open = { .clk = clk, .uri = uri, .log = &log };
	if (bb_shutter_open(&bb_shutter_gpio_driver, &config, &open, &sh) == BB_OK) {
		enum bb_status status = bb_shutter_set_mode(sh, BB_SHUTTER_STEREO);
		if (status == BB_OK)
			status = listen(sh, clk, seconds, &t);
		code = print(sh, &t, text, status) ? 0 : 1;
	} else {
		printf("{\"program\":\"gpio_edges\",\"uri\":\"%s\",\"skipped\":\"%s\"}\n", text, strerror(errno));
	}
	bb_shutter_close(sh);
	bb_clock_destroy(clk);
	free(t.latency_ns);
	return code;
}

int main(int argc, char **argv)
{
	struct bb_error err = { 0 };
	struct bb_uri uri;

	if (argc < 3 || argc > 4 || strpbrk(argv[1], "\"\\")) {
		fprintf(stderr, "usage: gpio_edges gpio:/dev/gpiochipN?line=L SECONDS [HZ]\n");
		return 1;
	}
	if (bb_uri_parse(argv[1], &uri, NULL, &err) != BB_OK) {
		fprintf(stderr, "gpio_edges: %s\n", err.text);
		return 1;
	}
	const double seconds = strtod(argv[2], NULL), hz = argc > 3 ? strtod(argv[3], NULL) : 120;
	if (!(seconds > 0 && seconds <= 3600 && hz >= 40 && hz <= 200)) {
		fprintf(stderr, "gpio_edges: 0..3600 seconds, 40..200 Hz\n");
		return 1;
	}
	return run(&uri, argv[1], seconds, hz);
}
