/*
 * bench/cmd/track_replay.c: `track replay FILE [--room ROOM]` and `track import FILE`: recordings of a tracker.
 * docs/streaming.md.
 */
#include <inttypes.h>
#include <jansson.h>
#include <stdio.h>

#include "bench/cli.h"
#include "bench/track_record/import.h"
#include "bench/track_record/replay.h"

/* ---- replay ---- */

static bool differs(const struct bb_replay *r, bool tracked)
{
	return tracked && (r->same != r->poses_recorded || (!r->truncated && r->poses_replayed != r->poses_recorded));
}

static double lasts_s(const struct bb_replay *r)
{
	return (double)(r->last_ns - r->first_ns) * 1e-9;
}

static int print_replay_json(const struct bb_replay *r, bool tracked)
{
	json_t *all = json_pack("{s:s, s:f, s:I, s:I, s:I, s:I, s:I, s:b}", "room", r->room, "duration_s", lasts_s(r),
	                        "camera_frames", (json_int_t)r->frames, "blobs", (json_int_t)r->blobs, "solves",
	                        (json_int_t)r->solves, "gamepad_reports", (json_int_t)r->pad_reports, "poses_recorded",
	                        (json_int_t)r->poses_recorded, "truncated", r->truncated);

	if (tracked) {
		json_object_set_new(all, "poses_replayed", json_integer((json_int_t)r->poses_replayed));
		json_object_set_new(all, "poses_same", json_integer((json_int_t)r->same));
		json_object_set_new(all, "same", json_boolean(!differs(r, true)));
	}
	return bb_cli_print_json(all);
}

static void print_replay(const struct bb_replay *r, bool tracked)
{
	printf("%s: %.3f s, %" PRIu64 " camera frames with %" PRIu64 " blobs, %" PRIu64 " gamepad reports, %" PRIu64 " poses\n",
	       r->room, lasts_s(r), r->frames, r->blobs, r->pad_reports, r->poses_recorded);
	if (tracked)
		printf("tracked again: %" PRIu64 " poses, %" PRIu64 " the same bit for bit\n", r->poses_replayed, r->same);
}

static int tell_replay(const struct bb_cli *cli, const struct bb_replay *r, bool tracked, struct bb_error *cut)
{
	struct bb_error err = { 0 };
	int code = BB_EXIT_OK;

	if (bb_cli_has(cli, "json"))
		code = print_replay_json(r, tracked);
	else
		print_replay(r, tracked);
	if (r->truncated)
		fprintf(stderr, "%s\n", cut->text);
	if (code == BB_EXIT_OK && differs(r, tracked)) {
		(void)bb_cli_fail(bb_fail(&err, BB_ERR_VERIFY, 1765, NULL, "%" PRIu64 " of %" PRIu64 " poses are the same", r->same,
		                          r->poses_recorded),
		                  &err);
		return BB_EXIT_FAILED;
	}
	return code != BB_EXIT_OK ? code : r->truncated ? BB_EXIT_FAILED : BB_EXIT_OK;
}

static int run_replay(const struct bb_cli *cli)
{
	const char *room_file = bb_cli_get(cli, "room", NULL);
	struct bb_replay_config c = { .path = cli->arg[0], .any_room = bb_cli_has(cli, "any-room"),
		                      .csv = bb_cli_get(cli, "csv", NULL) };
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	struct bb_replay result;
	enum bb_status status = bb_cli_number(cli, "speed", 0, 0, 1000, &c.speed, &err);

	if (status == BB_OK && room_file)
		status = bb_room_load(room_file, &room, &err);
	c.room = room;
	if (status == BB_OK)
		status = bb_replay_run(&c, &result, &err);
	const int code = status == BB_OK ? tell_replay(cli, &result, room != NULL, &err) : bb_cli_fail(status, &err);
	bb_room_free(room);
	return code;
}

static const struct bb_cli_option replay_options[] = {
	{ "room", "ROOM", "track again in that room, and compare the poses bit for bit" },
	{ "any-room", NULL, "the room file may have changed since" },
	{ "speed", "N", "1: as it was; 2: twice as fast; 0: as fast as it goes (default)" },
	{ "csv", "FILE", "the poses as a table" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_replay = {
	"track replay",
	"what a recorded tracker saw, through the tracker again",
	"FILE [--room ROOM [--any-room]] [--speed N] [--csv FILE] [--json]",
	replay_options,
	1,
	1,
	run_replay,
};

/* ---- import ---- */

static int tell_import(const struct bb_cli *cli, const struct bb_import *i, const char *out, const struct bb_error *cut)
{
	json_t *bodies = json_array();
	int code = BB_EXIT_OK;

	for (size_t b = 0; b < i->n_bodies; b++)
		json_array_append_new(bodies, json_string(i->body[b]));
	if (bb_cli_has(cli, "json")) {
		code = bb_cli_print_json(json_pack("{s:I, s:I, s:I, s:I, s:I, s:b, s:o}", "datagrams", (json_int_t)i->datagrams,
		                                   "frames", (json_int_t)i->frames, "poses", (json_int_t)i->poses, "untracked",
		                                   (json_int_t)i->untracked, "left_out", (json_int_t)i->left_out, "truncated",
		                                   i->truncated, "bodies", bodies));
	} else {
		json_decref(bodies);
		printf("%s: %" PRIu64 " poses of %zu bodies in %" PRIu64 " frames; %" PRIu64 " untracked, %" PRIu64 " left out\n", out,
		       i->poses, i->n_bodies, i->frames, i->untracked, i->left_out);
	}
	if (i->truncated)
		fprintf(stderr, "%s\n", cut->text);
	return code != BB_EXIT_OK ? code : i->truncated ? BB_EXIT_FAILED : BB_EXIT_OK;
}

static int run_import(const struct bb_cli *cli)
{
	const char *out = bb_cli_get(cli, "out", NULL);
	struct bb_error err = { 0 };
	struct bb_import result;

	if (!out)
		return bb_cli_fail(bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "track import wants --out FILE"), &err);
	const enum bb_status status = bb_import_natnet(cli->arg[0], out, &result, &err);
	return status == BB_OK ? tell_import(cli, &result, out, &err) : bb_cli_fail(status, &err);
}

static const struct bb_cli_option import_options[] = {
	{ "out", "FILE", "a recording (.zst: compressed), or a table when it ends in .csv" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_import = {
	"track import",
	"recorded NatNet frames into a recording of tracking, or a table",
	"FILE --out FILE [--json]",
	import_options,
	1,
	1,
	run_import,
};
