/*
 * bench/cmd/bench_barrier.c: `blackburst bench barrier`: ways to flip together, on a simulated network of many endpoints
 * (bench/barrier/table.h) and by real processes of this machine (bench/barrier/real.h).
 */
#include "bench/barrier/real.h"
#include "bench/barrier/table.h"
#include "bench/cli.h"
#include "bench/cmd/trade.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const struct bb_cli_option options[] = {
	{ "endpoints", "LIST", "simulated: numbers of nodes, 2 to 512 (2,4,6,8,16,32,64,128,256,416)" },
	{ "loss", "LIST", "simulated: percent of the messages that are lost, 0 to 50 (0,0.1,1,10,33)" },
	{ "frames", "N", "simulated: frames counted for each row, 10 to 1000000 (500)" },
	{ "delay-us", "N", "simulated: least delay one way (100)" },
	{ "jitter-us", "N", "simulated: mean of what is added, exponential (21.7: p99 100)" },
	{ "send-us", "N", "simulated: a sender is busy with each message (3)" },
	{ "drift-ppm", "N", "simulated: clocks are off by at most that (100)" },
	{ "window", "N", "simulated: exchanges a clock is known from, 8 to 512 (64)" },
	{ "seed", "N", "of all that is random (7)" },
	{ "simulated", NULL, "the simulated part only" },
	{ "real", NULL, "the real part only" },
	{ "processes", "LIST", "real: numbers of processes, 2 to 8 (2,4,6,8)" },
	{ "seconds", "S", "real: for each row, 0.02 to 60 (0.25)" },
	{ "mpi", "PROGRAM", "real: tests/bench/mpi_barrier as built, for MPI_Barrier beside them" },
	{ "png", "FILE", "a chart of the simulated part, .png or .svg" },
	{ "json", NULL, "print everything as JSON" },
	{ NULL, NULL, NULL },
};

/* "2,4,6": n numbers within bounds, least first whatever their order was; 1660 otherwise. */
static enum bb_status read_list(const struct bb_cli *cli, const char *name, const char *usual, double least, double most,
                                double *out, size_t cap, size_t *n_out, struct bb_error *err)
{
	const char *at = bb_cli_get(cli, name, usual);

	for (*n_out = 0; *n_out < cap; at++) {
		char *end;
		const double v = strtod(at, &end);
		if (end == at || !(v >= least && v <= most) || (*end && *end != ','))
			break;
		out[(*n_out)++] = v;
		at = end;
		if (*at)
			continue;
		bb_stats_sort(out, *n_out);
		return BB_OK;
	}
	return bb_fail(err, BB_ERR_USAGE, 1660, NULL, "--%s: at '%.20s', want up to %zu numbers from %g to %g with commas", name, at,
	               cap, least, most);
}

/* The same of whole numbers. */
static enum bb_status read_counts(const struct bb_cli *cli, const char *name, const char *usual, double most, unsigned *out,
                                  size_t cap, size_t *n_out, struct bb_error *err)
{
	double v[BB_BARRIER_SIZES_MAX];
	const enum bb_status st = read_list(cli, name, usual, 2, most, v, cap, n_out, err);

	for (size_t i = 0; st == BB_OK && i < *n_out; i++) {
		out[i] = (unsigned)v[i];
		if (out[i] != v[i])
			return bb_fail(err, BB_ERR_USAGE, 1660, NULL, "--%s: %g is not a whole number", name, v[i]);
	}
	return st;
}

static enum bb_status read_network(const struct bb_cli *cli, struct bb_barrier_table *t, struct bb_error *err)
{
	struct bb_troupe_config *c = &t->usual;
	double window, frames, seed;
	enum bb_status st = bb_cli_number(cli, "delay-us", c->link.delay_us, 0, 1e5, &c->link.delay_us, err);

	if (st == BB_OK)
		st = bb_cli_number(cli, "jitter-us", c->link.jitter_us, 0, 1e4, &c->link.jitter_us, err);
	if (st == BB_OK)
		st = bb_cli_number(cli, "send-us", c->link.send_us, 0, 1000, &c->link.send_us, err);
	if (st == BB_OK)
		st = bb_cli_number(cli, "drift-ppm", c->drift_ppm, 0, 500, &c->drift_ppm, err);
	if (st == BB_OK)
		st = bb_cli_whole(cli, "window", 64, 8, 512, &window, err);
	if (st == BB_OK)
		st = bb_cli_whole(cli, "frames", 500, 10, 1e6, &frames, err);
	if (st == BB_OK)
		st = bb_cli_whole(cli, "seed", 7, 0, 9007199254740992.0, &seed, err);
	if (st != BB_OK)
		return st;
	c->window = (unsigned)window;
	c->settle_frames = 32 + c->window; /* clocks are asked for eight times a frame until they are known */
	c->frames = (unsigned)frames;
	c->seed = (uint64_t)seed;
	t->net = (struct bb_barrier_network){ c->link.delay_us, c->link.jitter_us, c->link.send_us, c->window };
	return BB_OK;
}

static enum bb_status read_table(const struct bb_cli *cli, struct bb_barrier_table *t, struct bb_error *err)
{
	enum bb_status st = read_counts(cli, "endpoints", "2,4,6,8,16,32,64,128,256,416", BB_LOCK_NODES_MAX, t->sizes,
	                                BB_BARRIER_SIZES_MAX, &t->n_sizes, err);

	if (st == BB_OK)
		st = read_list(cli, "loss", "0,0.1,1,10,33", 0, 50, t->losses, BB_BARRIER_LOSSES_MAX, &t->n_losses, err);
	for (size_t i = 0; i < t->n_sizes && st == BB_OK; i++) {
		/* Under loss: the size nearest to a cave and the largest of a tiled wall's nodes that is listed. */
		if (t->sizes[i] <= 6)
			t->loss_sizes[0] = t->sizes[i];
		else if (t->sizes[i] <= 64)
			t->loss_sizes[1] = t->sizes[i];
	}
	if (!t->loss_sizes[0]) {
		t->loss_sizes[0] = t->loss_sizes[1];
		t->loss_sizes[1] = 0;
	}
	for (size_t i = 0; i < t->n_losses; i++)
		t->losses[i] /= 100;
	return st == BB_OK ? read_network(cli, t, err) : st;
}

static enum bb_status run_simulated(const struct bb_cli *cli, struct bb_barrier_table *t, struct bb_error *err)
{
	const char *png = bb_cli_get(cli, "png", NULL);

	t->progress = isatty(STDERR_FILENO) ? bb_trade_say : NULL;
	enum bb_status st = bb_barrier_table_run(t);
	if (t->progress)
		t->progress("");
	if (st != BB_OK)
		return bb_fail(err, st, 1661, NULL, "%s", bb_status_text(st));
	return png ? bb_barrier_table_plot(t, png, err) : BB_OK;
}

static enum bb_status run_real(const struct bb_cli *cli, struct bb_real_table *t, struct bb_error *err)
{
	enum bb_status st = read_counts(cli, "processes", "2,4,6,8", BB_REAL_SIZE_MOST, t->sizes, BB_REAL_SIZES_MOST, &t->n_sizes,
	                                err);

	if (st == BB_OK)
		st = bb_cli_number(cli, "seconds", 0.25, 0.02, 60, &t->seconds, err);
	t->mpi_program = bb_cli_get(cli, "mpi", NULL);
	t->progress = isatty(STDERR_FILENO) ? bb_trade_say : NULL;
	if (st == BB_OK)
		st = bb_barrier_real(t, err);
	if (t->progress)
		t->progress("");
	return st;
}

static enum bb_status read_parts(const struct bb_cli *cli, struct bb_error *err)
{
	if (bb_cli_has(cli, "real") && bb_cli_has(cli, "simulated"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--simulated only and --real only: neither is left");
	if (bb_cli_has(cli, "real") && bb_cli_has(cli, "png"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--png draws the simulated part, which --real leaves out");
	return BB_OK;
}

static int bench_barrier_run(const struct bb_cli *cli)
{
	struct bb_barrier_table t = { .usual = bb_troupe_usual() };
	struct bb_real_table real = { 0 };
	struct bb_error err = { 0 };
	json_t *root = json_object();
	const bool simulated = !bb_cli_has(cli, "real"), json = bb_cli_has(cli, "json");
	enum bb_status st = read_parts(cli, &err);
	int code = BB_EXIT_OK;

	if (st == BB_OK)
		st = read_table(cli, &t, &err);

	if (st == BB_OK && simulated)
		st = run_simulated(cli, &t, &err);
	if (st == BB_OK && simulated && json)
		json_object_set_new(root, "simulated", bb_barrier_table_json(&t));
	else if (st == BB_OK && simulated)
		bb_barrier_table_print(&t, stdout);
	bb_barrier_table_release(&t);
	if (st == BB_OK && !bb_cli_has(cli, "simulated")) {
		st = run_real(cli, &real, &err);
		if (st == BB_OK && json)
			json_object_set_new(root, "real", bb_barrier_real_json(&real));
		else if (st == BB_OK)
			bb_barrier_real_print(&real, stdout);
		bb_barrier_real_release(&real);
	}
	if (st != BB_OK)
		code = bb_cli_fail(st, &err);
	else if (json)
		return bb_cli_print_json(root);
	json_decref(root);
	return code;
}

const struct bb_command bb_cmd_bench_barrier = {
	.name = "bench barrier",
	.line = "ways to flip together: skew, cost, messages, behaviour under loss, from 2 to 416 endpoints",
	.usage = "[--endpoints LIST] [--loss LIST] [--frames N] [--simulated | --real] [--processes LIST] [--seconds S] [--mpi PROGRAM] [--png FILE] [--json]",
	.options = options,
	.least_args = 0,
	.most_args = 0,
	.run = bench_barrier_run,
};
