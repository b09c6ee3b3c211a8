/* bench/cmd/run.c: `blackburst run ROOM SCENE`: one run, one verdict. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/cli.h"
#include "bench/guardian.h"
#include "bench/run.h"
#include "bench/track_record/streaming.h"
#include "drivers/link/peers.h"

static const struct bb_cli_option options[] = {
	{ "seed", "N", "seed of every simulated device (default 1)" },
	{ "out", "DIR", "result folder (default build/results/ROOM-SCENE)" },
	{ "json", NULL, "print result.json on standard output" },
	{ "clock", "virtual|posix", "virtual time (default), or real time with everything drawn" },
	{ "gl", "auto|osmesa|egl|cpu", "offscreen GL context, or none: native code" },
	{ "fault", "TEXT", "plant a fault, e.g. \"at 2.0s camera/c3 cover for 3s\" (repeatable)" },
	{ "fault-file", "FILE", "plant the faults of a file, one a line" },
	{ "nodes", "N", "play the room's nodes in N processes, the head's included (--clock posix)" },
	{ "link", "shm|zmq[:ADDRESS]", "what they talk over: shared memory (default) or ZeroMQ, e.g. zmq:tcp://127.0.0.1:5570" },
	{ "wait", NULL, "start none of them: wait for `blackburst node`, from mpirun, srun, systemd or a person" },
	{ "token-file", "FILE", "the secret of those that join, mode 0600; \"-\" is standard input" },
	{ "open", NULL, "let ZeroMQ listen on an address that is not loopback (with --token-file)" },
	{ "restart", NULL, "start a process again that died" },
	{ "record", "FILE", "what the tracker sees and says, for `track replay`; .zst: compressed" },
	{ "stream", "LIST", "poses to other programs: natnet[:COMMAND[:DATA]],vrpn[:PORT] (--clock posix)" },
	{ "bind", "ADDRESS", "stream from there instead of 127.0.0.1; not loopback: only with --allow" },
	{ "allow", "ADDRESS", "who may connect from outside (repeatable)" },
	{ "multicast", "ADDRESS", "NatNet frames to 239.255.42.99, out of the interface with this address" },
	{ "list-faults", NULL, "print every fault verb and what it means" },
	{ "duration", "S", "scene seconds instead of the scene's own" },
	{ "fidelity", "CLASS=N", "model a device class at fidelity N, or -1 for not at all (repeatable)" },
	{ "memory-mib", "N", "brick memory per node instead of the scene's" },
	{ "stream-bricks", "N", "bricks a frame instead of the scene's" },
	{ "plant-draw-us", "N", "add to every draw, to see the gate catch it" },
	{ "plant-bricks", "N", "stream extra bricks a frame, to see the gate catch it" },
	{ "dim-flash", NULL, "darken the pictures of a scene that would flash until it does not" },
	{ "allow-flash", NULL, "run a scene that flashes, and do not judge it: nobody may be in the room" },
	{ "guard", NULL, "watch over the run by a second process, as is always done with real shutters" },
	{ "no-pictures", NULL, "draw no pictures" },
	{ "quiet", NULL, "no progress, no table" },
	{ NULL, NULL, NULL },
};

static int list_faults(void)
{
	const struct sim_verb *verb;
	const char *class_name;

	for (size_t i = 0; (verb = sim_fault_verb(i, &class_name)); i++)
		printf("%-9s %-14s %-26s %s\n", class_name, verb->name, verb->args, verb->meaning);
	printf("\nWritten as: at 2.0s CLASS/ID VERB [key=value ...] [for 3s | for 20 frames]; `at boot` is before bring-up.\n");
	return BB_EXIT_OK;
}

struct faults {
	struct sim_fault *fault;
	size_t n;
};

static enum bb_status add_fault(struct faults *f, const struct sim_fault *one)
{
	struct sim_fault *grown = realloc(f->fault, (f->n + 1) * sizeof(*grown));

	if (!grown)
		return BB_ERR_NOMEM;
	grown[f->n++] = *one;
	f->fault = grown;
	return BB_OK;
}

static enum bb_status read_faults(const struct bb_cli *cli, struct faults *f, struct bb_error *err)
{
	const struct bb_where where = { "--fault", 0, 0 };
	enum bb_status status = BB_OK;
	const char *text;

	for (int i = 0; status == BB_OK && (text = bb_cli_nth(cli, "fault-file", i)); i++) {
		struct sim_fault *many = NULL;
		size_t n = 0;
		status = sim_fault_file(text, &many, &n, err);
		for (size_t k = 0; k < n && status == BB_OK; k++)
			status = add_fault(f, &many[k]);
		free(many);
	}
	for (int i = 0; status == BB_OK && (text = bb_cli_nth(cli, "fault", i)); i++) {
		struct sim_fault one;
		status = sim_fault_parse(text, &one, &where, err);
		if (status == BB_OK)
			status = add_fault(f, &one);
	}
	return status;
}

static enum bb_status read_fidelity(const struct bb_cli *cli, struct bb_run_options *o, struct bb_error *err)
{
	const char *text;

	for (int i = 0; (text = bb_cli_nth(cli, "fidelity", i)); i++) {
		const char *equals = strchr(text, '=');
		char *end = NULL;
		int class = 0;
		const long level = equals ? strtol(equals + 1, &end, 10) : -9;
		while (class < BB_CLASS_COUNT && (!equals || strncmp(text, bb_class_text((enum bb_class)class),
		                                                     (size_t)(equals - text)) ||
		                                  strlen(bb_class_text((enum bb_class)class)) != (size_t)(equals - text)))
			class++;
		if (class == BB_CLASS_COUNT || !end || *end || end == equals + 1 || level < -1 || level > 2)
			return bb_fail(err, BB_ERR_USAGE, 1701, NULL,
			               "--fidelity %s: want CLASS=N, CLASS one of shutters, cameras, displays, monitors, "
			               "power, gamepads and N from -1 to 2", text);
		o->fidelity[class] = (int)level;
	}
	return BB_OK;
}

static enum bb_status read_numbers(const struct bb_cli *cli, struct bb_run_options *o, struct bb_error *err)
{
	double seed, bricks, plant_us, plant_bricks;
	enum bb_status status = bb_cli_whole(cli, "seed", 1, 0, 9e15, &seed, err);

	if (status == BB_OK)
		status = bb_cli_number(cli, "duration", 0, 0.1, 86400, &o->duration_s, err);
	if (status == BB_OK)
		status = bb_cli_number(cli, "memory-mib", -1, 0, 65536, &o->memory_mib, err);
	if (status == BB_OK)
		status = bb_cli_whole(cli, "stream-bricks", -1, 0, 1e6, &bricks, err);
	if (status == BB_OK)
		status = bb_cli_number(cli, "plant-draw-us", 0, 0, 1e6, &plant_us, err);
	if (status == BB_OK)
		status = bb_cli_whole(cli, "plant-bricks", 0, 0, 1e6, &plant_bricks, err);
	if (status != BB_OK)
		return status;
	o->seed = (uint64_t)seed;
	o->stream_bricks = (int64_t)bricks;
	o->plant_draw_ns = (int64_t)(plant_us * 1e3);
	o->plant_bricks = (int64_t)plant_bricks;
	return read_fidelity(cli, o, err);
}

static enum bb_status read_processes(const struct bb_cli *cli, struct bb_run_options *o, struct bb_error *err)
{
	struct bb_run_processes *p = &o->processes;
	const char *link = bb_cli_get(cli, "link", "shm");
	static char uri[160];
	double n;
	const enum bb_status status = bb_cli_whole(cli, "nodes", 1, 1, LINK_PROCESSES_MAX, &n, err);

	if (status != BB_OK)
		return status;
	snprintf(uri, sizeof(uri), "%s%s", link, strchr(link, ':') ? "" : ":");
	*p = (struct bb_run_processes){ .n = (uint16_t)n, .link = uri, .token_file = bb_cli_get(cli, "token-file", NULL),
		                        .wait = bb_cli_has(cli, "wait"), .open = bb_cli_has(cli, "open"),
		                        .restart = bb_cli_has(cli, "restart"), .tell = !bb_cli_has(cli, "quiet") };
	if (p->n > 1 && !o->posix_clock)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--nodes %u wants --clock posix: virtual time has one process", p->n);
	if (p->n > 1 && (o->plant_draw_ns || o->plant_bricks || o->fidelity[BB_CLASS_DISPLAYS] != -2))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--plant-* and --fidelity displays=N want one process: the others "
		               "would not know");
	if ((p->wait || p->open) && (p->n < 2 || !p->token_file))
		return bb_fail(err, BB_ERR_USAGE, 1671, NULL, "--wait and --open want --nodes and --token-file");
	if (p->n > 1)
		o->pictures = false; /* the others draw the walls */
	return BB_OK;
}

static enum bb_status read_words(const struct bb_cli *cli, struct bb_run_options *o, struct bb_error *err)
{
	const char *clock = bb_cli_get(cli, "clock", "virtual");

	o->gl = bb_cli_get(cli, "gl", "auto");
	o->posix_clock = !strcmp(clock, "posix");
	o->pictures = !bb_cli_has(cli, "no-pictures");
	o->allow_flash = bb_cli_has(cli, "allow-flash");
	o->dim_flash = bb_cli_has(cli, "dim-flash");
	if (!o->posix_clock && strcmp(clock, "virtual"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--clock %s: want virtual or posix", clock);
	if (strcmp(o->gl, "auto") && strcmp(o->gl, "osmesa") && strcmp(o->gl, "egl") && strcmp(o->gl, "cpu"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--gl %s: want auto, osmesa, egl or cpu", o->gl);
	return BB_OK;
}

/* "build/results/cabin-epi" from the names of the two files. */
static void default_folder(char *buf, size_t cap, const char *room, const char *scene)
{
	const char *r = strrchr(room, '/') ? strrchr(room, '/') + 1 : room;
	const char *s = strrchr(scene, '/') ? strrchr(scene, '/') + 1 : scene;

	snprintf(buf, cap, "build/results/%.*s-%.*s", (int)strcspn(r, "."), r, (int)strcspn(s, "."), s);
}

static void progress(void *ctx, double done, const char *what)
{
	int *shown = ctx;
	const int percent = (int)(done * 100);

	if (percent == *shown && percent)
		return;
	*shown = percent;
	fprintf(stderr, "\r%-20s %3d %%", what, percent);
	fflush(stderr);
}

static int report(const struct bb_cli *cli, const struct bb_run *run, const char *folder)
{
	const struct bb_run_result *r = run->result;

	if (bb_cli_has(cli, "json")) {
		char *text = bb_result_json_text(r);
		if (!text)
			return BB_EXIT_INTERNAL;
		puts(text);
		free(text);
	} else if (!bb_cli_has(cli, "quiet")) {
		bb_result_print(r, stdout, isatty(STDOUT_FILENO));
		if (folder)
			printf("\nreport: %s/report.html\n", folder);
	}
	return r->exit_code;
}

/* The parent's exit code in *code, or true: go on. */
static bool guarded(const struct bb_cli *cli, const struct bb_run_options *o, int *code)
{
	struct bb_error err = { 0 };
	struct bb_room *room;
	bool go = true;

	if (bb_room_load(o->room_path, &room, &err) != BB_OK)
		return true; /* the run itself will say so */
	if (bb_cli_has(cli, "guard") || bb_guardian_wanted(room))
		go = bb_guardian_fork(room, code, &err);
	if (!go && err.number)
		(void)bb_cli_fail(BB_ERR_LOST, &err);
	bb_room_free(room);
	return go;
}

static enum bb_status read_outlets(const struct bb_cli *cli, struct bb_run_options *o, struct bb_error *err)
{
	static struct bb_mocap_config config;
	const char *text = bb_cli_get(cli, "stream", NULL);

	o->record_path = bb_cli_get(cli, "record", NULL);
	if (!text)
		return BB_OK;
	o->stream = &config;
	return bb_streaming_read(cli, text, &config, err);
}

static void warn_of_flashes(const struct bb_cli *cli)
{
	if (bb_cli_has(cli, "allow-flash"))
		fprintf(stderr, "WARNING: this run may flash as no scene should. Nobody may be in the room.\n");
}

static int command(const struct bb_cli *cli)
{
	struct bb_run_options o = bb_run_options_default();
	struct faults faults = { 0 };
	struct bb_error err = { 0 };
	struct bb_run run = { 0 };
	char usual[BB_PATH_MAX_BYTES];
	int shown = -1;

	if (bb_cli_has(cli, "list-faults"))
		return list_faults();
	if (cli->n_args != 2)
		return bb_cli_fail(bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "run wants a ROOM and a SCENE file"), &err);
	o.room_path = cli->arg[0];
	o.scene_path = cli->arg[1];
	default_folder(usual, sizeof(usual), o.room_path, o.scene_path);
	o.out_dir = bb_cli_get(cli, "out", usual);
	if (isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet")) {
		o.progress = progress;
		o.progress_ctx = &shown;
	}
	enum bb_status status = read_numbers(cli, &o, &err);
	if (status == BB_OK)
		status = read_words(cli, &o, &err);
	if (status == BB_OK)
		status = read_processes(cli, &o, &err);
	if (status == BB_OK)
		status = read_outlets(cli, &o, &err);
	if (status == BB_OK)
		status = read_faults(cli, &faults, &err);
	o.faults = faults.fault;
	o.n_faults = faults.n;
	int died = BB_EXIT_OK;
	if (status == BB_OK && !guarded(cli, &o, &died)) {
		free(faults.fault);
		return died;
	}
	warn_of_flashes(cli);
	o.stop = bb_guardian_signals();
	if (status == BB_OK)
		status = bb_run(&o, &run, &err);
	free(faults.fault);
	if (o.progress && shown >= 0)
		fprintf(stderr, "\r%40s\r", "");
	const int code = status == BB_OK ? report(cli, &run, o.out_dir) : bb_cli_fail(status, &err);
	bb_run_free(&run);
	return code;
}

const struct bb_command bb_cmd_run = {
	"run", "bring a room up, run a scene in it, end with a verdict", "ROOM SCENE [options]", options, 0, 2, command,
};
