/* bench/cmd/node.c: `blackburst node ROOM SCENE --join ADDRESS`: one process of a run that another one leads. */
#include <signal.h>
#include <string.h>

#include "bench/cli.h"
#include "bench/run.h"
#include "drivers/link/peers.h"

static const struct bb_cli_option options[] = {
	{ "join", "ADDRESS", "where the head is: shm:/proc/PID/fd/N or zmq:tcp://ADDRESS:PORT, as it says" },
	{ "index", "K", "which of its processes to be, from 1; without it, whichever is free" },
	{ "nodes", "N", "how many processes the head counts, itself included" },
	{ "token-file", "FILE", "the head's secret, mode 0600; \"-\" is standard input" },
	{ "open", NULL, "the head's address is not loopback" },
	{ "gl", "auto|osmesa|egl|cpu", "as the head's" },
	{ "seed", "N", "as the head's" },
	{ "duration", "S", "as the head's" },
	{ "memory-mib", "N", "as the head's" },
	{ "stream-bricks", "N", "as the head's" },
	{ "plant-crystal-ppm", "N", "its clock runs that much too fast, to see it follow the head's (0)" },
	{ NULL, NULL, NULL },
};

static volatile sig_atomic_t interrupted;

static void interrupt(int number)
{
	interrupted = number;
}

static enum bb_status read_options(const struct bb_cli *cli, struct bb_run_options *o, struct bb_error *err)
{
	double n = 0, index = 0, seed = 1, bricks = -1;
	enum bb_status status = bb_cli_whole(cli, "nodes", 2, 2, LINK_PROCESSES_MAX, &n, err);

	if (status == BB_OK)
		status = bb_cli_whole(cli, "index", BB_LINK_ANY, 1, BB_LINK_ANY, &index, err);
	if (status == BB_OK)
		status = bb_cli_whole(cli, "seed", 1, 0, 9e15, &seed, err);
	if (status == BB_OK)
		status = bb_cli_number(cli, "duration", 0, 0.1, 86400, &o->duration_s, err);
	if (status == BB_OK)
		status = bb_cli_number(cli, "memory-mib", -1, 0, 65536, &o->memory_mib, err);
	if (status == BB_OK)
		status = bb_cli_whole(cli, "stream-bricks", -1, 0, 1e6, &bricks, err);
	if (status == BB_OK)
		status = bb_cli_number(cli, "plant-crystal-ppm", 0, -500, 500, &o->plant_crystal_ppm, err);
	o->seed = (uint64_t)seed;
	o->stream_bricks = (int64_t)bricks;
	o->gl = bb_cli_get(cli, "gl", "auto");
	o->processes = (struct bb_run_processes){ .n = (uint16_t)n, .process = (uint16_t)index,
		                                  .link = bb_cli_get(cli, "join", NULL),
		                                  .token_file = bb_cli_get(cli, "token-file", NULL),
		                                  .open = bb_cli_has(cli, "open") };
	if (status == BB_OK && (!o->processes.link || !o->processes.token_file))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "node wants --join and --token-file");
	if (status == BB_OK && o->processes.process != BB_LINK_ANY && o->processes.process >= o->processes.n)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--index %u of --nodes %u", o->processes.process, o->processes.n);
	return status;
}

static int command(const struct bb_cli *cli)
{
	const struct sigaction act = { .sa_handler = interrupt };
	struct bb_run_options o = bb_run_options_default();
	struct bb_error err = { 0 };
	struct bb_run run = { 0 };
	enum bb_status status;

	o.room_path = cli->arg[0];
	o.scene_path = cli->arg[1];
	o.posix_clock = true;
	o.pictures = false;
	o.stop = &interrupted;
	status = read_options(cli, &o, &err);
	sigaction(SIGTERM, &act, NULL);
	signal(SIGPIPE, SIG_IGN);
	if (status == BB_OK)
		status = bb_run(&o, &run, &err);
	bb_run_free(&run);
	return status == BB_OK ? BB_EXIT_OK : bb_cli_fail(status, &err);
}

const struct bb_command bb_cmd_node = {
	"node", "play nodes of a run that another process leads", "ROOM SCENE --join ADDRESS --token-file FILE [options]",
	options, 2, 2, command,
};
