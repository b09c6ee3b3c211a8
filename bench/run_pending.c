/*
 * bench/run_pending.c: TEMPORARY: stands in for bench/run.c and the commands of other hands, with a made-up result.
 */
#include "bench/cli.h"
#include "bench/report_html.h"
#include "bench/run.h"
#include "tests/fixture_result.h"

#include <sys/stat.h>
#include <unistd.h>

struct bb_run_options bb_run_options_default(void)
{
	struct bb_run_options o = { .seed = 1, .gl = "auto", .memory_mib = -1, .stream_bricks = -1 };

	for (int c = 0; c < BB_CLASS_COUNT; c++)
		o.fidelity[c] = -2;
	return o;
}

enum bb_status bb_run(const struct bb_run_options *o, struct bb_run *out, struct bb_error *err)
{
	struct fixture_options fo = { .faults = o->n_faults > 0, .n_frames = (size_t)((o->duration_s > 0 ? o->duration_s : 10) * 120),
		.extra_draw_ns = o->plant_draw_ns, .extra_bricks = (uint64_t)o->plant_bricks, .picture_dir = o->out_dir };
	struct fixture *x;
	char path[1200];
	enum bb_status st;

	if (o->out_dir)
		mkdir(o->out_dir, 0777);
	x = fixture_create(&fo);
	snprintf(x->room.path, sizeof(x->room.path), "%s", o->room_path);
	for (int c = 0; c < BB_CLASS_COUNT; c++)
		if (o->fidelity[c] != -2)
			x->scene.needs[c] = o->fidelity[c];
	out->room = &x->room;
	out->scene = &x->scene;
	out->result = x->result;
	st = bb_result_judge(x->result);
	if (st == BB_OK && o->out_dir) {
		snprintf(path, sizeof(path), "%s/result.json", o->out_dir);
		st = bb_result_write_json(x->result, path, err);
		snprintf(path, sizeof(path), "%s/junit.xml", o->out_dir);
		st = st ? st : bb_result_write_junit(x->result, path, err);
		snprintf(path, sizeof(path), "%s/frames.csv", o->out_dir);
		st = st ? st : bb_result_write_csv(x->result, path, err);
		snprintf(path, sizeof(path), "%s/trace.json", o->out_dir);
		st = st ? st : bb_result_write_trace(x->result, path, err);
		snprintf(path, sizeof(path), "%s/report.html", o->out_dir);
		st = st ? st : bb_report_html_write(x->result, o->out_dir, path, NULL, err);
	}
	return st;
}

void bb_run_free(struct bb_run *run)
{
	if (run->result)
		fixture_free(bb_container_of(run->room, struct fixture, room));
	*run = (struct bb_run){ 0 };
}

static const struct bb_cli_option run_opts[] = { { "out", "DIR", "result folder" }, { "fault", "TEXT", "a fault" },
	{ "json", NULL, "json" }, { "seed", "N", "seed" }, { NULL, NULL, NULL } };

static int pending_run(const struct bb_cli *cli)
{
	struct bb_run_options o = bb_run_options_default();
	struct bb_error err = { 0 };
	struct bb_run run = { 0 };
	enum bb_status st;
	int code;

	o.room_path = cli->arg[0];
	o.scene_path = cli->arg[1];
	o.out_dir = bb_cli_get(cli, "out", NULL);
	o.n_faults = bb_cli_has(cli, "fault");
	st = bb_run(&o, &run, &err);
	if (st != BB_OK)
		return bb_cli_fail(st, &err);
	bb_result_print(run.result, stdout, isatty(1));
	code = run.result->exit_code;
	bb_run_free(&run);
	return code;
}

static int pending(const struct bb_cli *cli)
{
	printf("%s: not here yet\n", cli->command->name);
	return 0;
}

const struct bb_command bb_cmd_run = { "run", "run a scene in a room and judge it", "ROOM SCENE", run_opts, 2, 2, pending_run };
const struct bb_command bb_cmd_room_check = { "room check", "check a room", "ROOM", run_opts, 1, 1, pending };
const struct bb_command bb_cmd_room_draw = { "room draw", "draw a room", "ROOM", run_opts, 1, 1, pending };
const struct bb_command bb_cmd_devices = { "devices", "list devices", "ROOM", run_opts, 1, 1, pending };
const struct bb_command bb_cmd_doctor = { "doctor", "look at this machine", "", run_opts, 0, 0, pending };
