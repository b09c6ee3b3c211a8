/*
 * bench/cmd/room.c: `room check ROOM` and `room draw ROOM`.
 */
#include <stdio.h>
#include <string.h>

#include "bench/cli.h"
#include "bench/cmd/room_check.h"
#include "bench/report/room_drawing.h"

static int run_check(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_room *room;
	enum bb_status status = bb_room_load(cli->arg[0], &room, &err);
	int errors;

	if (status)
		return bb_cli_fail(status, &err);
	errors = bb_room_check_print(room, stdout, bb_cli_has(cli, "json"));
	bb_room_free(room);
	return errors ? BB_EXIT_FAILED : BB_EXIT_OK;
}

/* rooms/cabin.yaml is drawn to cabin.svg in the working directory. */
static void default_file(const char *room_path, char *out, size_t cap)
{
	const char *base = strrchr(room_path, '/');
	int n;

	base = base ? base + 1 : room_path;
	n = (int)strcspn(base, ".");
	snprintf(out, cap, "%.*s.svg", n ? n : (int)strlen(base), base);
}

static int run_draw(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_room *room;
	char file[BB_PATH_MAX_BYTES];
	enum bb_status status = bb_room_load(cli->arg[0], &room, &err);

	if (status)
		return bb_cli_fail(status, &err);
	default_file(cli->arg[0], file, sizeof(file));
	const char *out = bb_cli_get(cli, "out", file);
	status = bb_room_drawing_write(room, out, &err);
	bb_room_free(room);
	if (status)
		return bb_cli_fail(status, &err);
	printf("%s\n", out);
	return BB_EXIT_OK;
}

static const struct bb_cli_option check_options[] = {
	{ "json", NULL, "the summary and the findings as JSON" },
	{ NULL, NULL, NULL },
};
static const struct bb_cli_option draw_options[] = {
	{ "out", "FILE", "a .svg or .png file; left out: the room's name with .svg, here" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_room_check = { "room check",  "load a room, summarise it and judge its geometry",
	                                      "ROOM [--json]", check_options, 1, 1, run_check };
const struct bb_command bb_cmd_room_draw = { "room draw", "draw a room to scale from above and from the side",
	                                     "ROOM [--out FILE.svg|FILE.png]", draw_options, 1, 1, run_draw };
