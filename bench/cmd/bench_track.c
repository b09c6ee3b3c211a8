/*
 * bench/cmd/bench_track.c: `blackburst bench track`: what the tracker's solver costs, by cameras and by stray blobs
 * (bench/solver/cost.h); with --walk how right it is, over as many frames as wanted (bench/solver/walk.h).
 */
#include "bench/cli.h"
#include "bench/cmd/trade.h"
#include "bench/solver/cost.h"
#include "bench/solver/walk.h"

#include <unistd.h>

static const struct bb_cli_option options[] = {
	{ "cameras", "N", "1 to 72 (24)" },
	{ "bodies", "N", "1 to 8, of 3 to 6 markers (6)" },
	{ "blobs", "N", "stray blobs in every frame, to 100000 (0)" },
	{ "sets", "N", "timed, of each row, 10 to 100000 (400)" },
	{ "scaling", NULL, "by 2 to 72 cameras and by 0 to 10000 stray blobs as well" },
	{ "plot", "FILE", "draw the scaling into a .svg or .png file" },
	{ "walk", NULL, "accuracy, labels and sigmas of a viewer who walks; exit 1 when they do not hold" },
	{ "path", "FILE", "of --walk (scenes/walk.path)" },
	{ "frames", "N", "of --walk, 100 to 10000000 (10000)" },
	{ "fidelity", "0|1|2", "of --walk's cameras (1)" },
	{ "dark", "S", "of --walk: every ten seconds all lenses are covered for so long (0.3)" },
	{ "seed", "N", "of all that is random (7)" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

static enum bb_status whole(const struct bb_cli *cli, const char *name, double usual, double least, double most,
			    size_t *out, struct bb_error *err)
{
	double v;
	const enum bb_status status = bb_cli_whole(cli, name, usual, least, most, &v, err);

	if (!status)
		*out = (size_t)v;
	return status;
}

/* ---- accuracy ---- */

static bool holds(const struct bb_walk *w)
{
	return !w->n_wrong_labels && !w->n_wrong_poses && w->most_frames_back <= 3 && w->position.share > 0.93 &&
	       w->position.share < 0.97;
}

static int walk(const struct bb_cli *cli)
{
	struct bb_walk_config c = { cli->n_args ? cli->arg[0] : "rooms/cabin.yaml",
				    bb_cli_get(cli, "path", "scenes/walk.path"), 1, 0, 0, 0 };
	struct bb_error err = { 0 };
	struct bb_walk w;
	size_t fidelity, seed;
	enum bb_status st = whole(cli, "frames", 10000, 100, 1e7, &c.n_frames, &err);

	if (!st)
		st = whole(cli, "fidelity", 1, 0, 2, &fidelity, &err);
	if (!st)
		st = whole(cli, "seed", 7, 0, 9e15, &seed, &err);
	if (!st)
		st = bb_cli_number(cli, "dark", 0.3, 0, 5, &c.dark_s, &err);
	if (!st) {
		c.fidelity = (int)fidelity;
		c.seed = seed;
		st = bb_walk_measure(&c, &w, &err);
	}
	if (st)
		return bb_cli_fail(st, &err);
	if (bb_cli_has(cli, "json")) {
		const int code = bb_cli_print_json(bb_walk_json(&w));
		return code ? code : holds(&w) ? BB_EXIT_OK : BB_EXIT_FAILED;
	}
	bb_walk_print(&w, stdout);
	return holds(&w) ? BB_EXIT_OK : BB_EXIT_FAILED;
}

/* ---- cost ---- */

static const size_t camera_steps[] = { 2, 3, 4, 6, 8, 12, 16, 24, 36, 48, 60, 72 };
static const size_t clutter_steps[] = { 0, 3, 10, 30, 100, 300, 1000, 3000, 10000 };

static void say(bool shown, const char *what, size_t n)
{
	char text[80];

	snprintf(text, sizeof(text), "%zu %s", n, what);
	if (shown)
		bb_trade_say(text);
}

static enum bb_status scale(const struct bb_cost_config *usual, struct bb_cost_table *t, bool shown,
			    struct bb_error *err)
{
	enum bb_status st = BB_OK;

	for (size_t i = 0; !st && i < BB_ARRAY_LEN(camera_steps); i++) {
		struct bb_cost_config c = *usual;
		c.n_cameras = camera_steps[i];
		say(shown, "cameras", c.n_cameras);
		st = bb_cost_measure(&c, &t->by_cameras[t->n_by_cameras++], err);
	}
	for (size_t i = 0; !st && i < BB_ARRAY_LEN(clutter_steps); i++) {
		struct bb_cost_config c = *usual;
		c.n_clutter = clutter_steps[i];
		c.n_sets = c.n_clutter > 1000 && c.n_sets > 100 ? 100 : c.n_sets; /* to make them takes longer than to solve */
		say(shown, "stray blobs", c.n_clutter);
		st = bb_cost_measure(&c, &t->by_clutter[t->n_by_clutter++], err);
	}
	if (shown)
		bb_trade_say("");
	return st;
}

static enum bb_status read_cost(const struct bb_cli *cli, struct bb_cost_config *c, struct bb_error *err)
{
	size_t seed = 7;
	enum bb_status st = whole(cli, "cameras", 24, 1, 72, &c->n_cameras, err);

	if (!st)
		st = whole(cli, "bodies", 6, 1, BB_BODIES_MAX, &c->n_bodies, err);
	if (!st)
		st = whole(cli, "blobs", 0, 0, 1e5, &c->n_clutter, err);
	if (!st)
		st = whole(cli, "sets", 400, 10, 1e5, &c->n_sets, err);
	if (!st)
		st = whole(cli, "seed", 7, 0, 9e15, &seed, err);
	c->seed = seed;
	return st;
}

static int bench_track_run(const struct bb_cli *cli)
{
	struct bb_cost_config c = { .room = cli->n_args ? cli->arg[0] : "rooms/deck.yaml", .n_cold = 40 };
	struct bb_cost_table t = { .room = c.room };
	const char *plot = bb_cli_get(cli, "plot", NULL);
	struct bb_error err = { 0 };

	if (bb_cli_has(cli, "walk"))
		return walk(cli);
	enum bb_status st = read_cost(cli, &c, &err);
	t.seed = c.seed;
	if (!st)
		st = bb_cost_measure(&c, &t.usual, &err);
	if (!st && (plot || bb_cli_has(cli, "scaling")))
		st = scale(&c, &t, isatty(STDERR_FILENO), &err);
	if (!st && plot)
		st = bb_cost_plot(&t, plot, &err);
	if (st)
		return bb_cli_fail(st, &err);
	if (bb_cli_has(cli, "json"))
		return bb_cli_print_json(bb_cost_json(&t));
	bb_cost_print(&t, stdout);
	return BB_EXIT_OK;
}

const struct bb_command bb_cmd_bench_track = {
	.name = "bench track",
	.line = "what the tracker's solver costs, by cameras and stray blobs; with --walk how right it is",
	.usage = "[ROOM] [--cameras N] [--bodies N] [--blobs N] [--sets N] [--scaling] [--plot FILE] [--json]; or [ROOM] --walk [--path FILE] [--frames N] [--fidelity 0|1|2] [--dark S] [--seed N] [--json]",
	.options = options,
	.least_args = 0,
	.most_args = 1,
	.run = bench_track_run,
};
