/* bench/cmd/devices.c: `blackburst devices [ROOM]`: the back ends of this build; the devices of a room and who drives them. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/backends.h"
#include "bench/cli.h"
#include "bench/rig.h"

static const struct bb_cli_option options[] = {
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

struct listing {
	json_t *rows;          /* NULL: print */
	size_t n, unknown;
};

static void visit(void *ctx, enum bb_class class, size_t index, const char *class_name, const char *id, const char *uri,
                  struct bb_device *dev)
{
	struct listing *l = ctx;
	struct bb_uri parsed;
	struct bb_error err = { 0 };
	const char *device = uri[0] ? uri : "sim:";
	const bool known = bb_uri_parse(device, &parsed, NULL, &err) == BB_OK && bb_backend_find(&parsed, id, &err);
	(void)class;
	(void)index;
	(void)dev;

	l->n++;
	l->unknown += !known;
	if (l->rows)
		json_array_append_new(l->rows, json_pack("{s:s, s:s, s:s, s:b}", "class", class_name, "id", id, "device",
		                                         device, "driven", known));
	else
		printf("%-9s %-24s %-40s %s\n", class_name, id, device, known ? "" : "no back end in this build");
}

static void list_backends(json_t *out)
{
	const struct bb_backend *b;

	for (size_t i = 0; (b = bb_backend(i)); i++) {
		char classes[120] = "";
		const void *const have[] = { b->shutter, b->camera, b->display, b->monitor, b->power, b->gamepad, b->link };
		static const char *const names[] = { "shutter", "camera", "display", "monitor", "power", "gamepad", "link" };
		for (size_t c = 0; c < BB_ARRAY_LEN(have); c++)
			if (have[c])
				snprintf(classes + strlen(classes), sizeof(classes) - strlen(classes), " %s", names[c]);
		if (out)
			json_array_append_new(out, json_pack("{s:s, s:s, s:s}", "scheme", b->scheme, "help", b->help,
			                                     "classes", classes + 1));
		else
			printf("%s:%*s %s;%s\n", b->scheme, (int)(10 - strlen(b->scheme)), "", b->help, classes);
	}
}

static int print_json(json_t *all)
{
	char *text = json_dumps(all, JSON_INDENT(2));

	json_decref(all);
	if (!text)
		return BB_EXIT_INTERNAL;
	puts(text);
	free(text);
	return BB_EXIT_OK;
}

static int command(const struct bb_cli *cli)
{
	json_t *all = bb_cli_has(cli, "json") ? json_object() : NULL;
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	struct listing l = { 0 };

	if (cli->n_args == 1) {
		const enum bb_status status = bb_room_load(cli->arg[0], &room, &err);
		if (status != BB_OK) {
			json_decref(all);
			return bb_cli_fail(status, &err);
		}
	}
	if (all) {
		json_object_set_new(all, "backends", json_array());
		list_backends(json_object_get(all, "backends"));
		l.rows = json_array();
		json_object_set_new(all, "devices", l.rows);
	} else {
		list_backends(NULL);
	}
	if (room) {
		const struct bb_rig closed = { .room = room };
		if (!all)
			printf("\n");
		bb_rig_each(&closed, visit, &l);
	}
	if (!all && room)
		printf("\n%zu devices, %zu without a back end\n", l.n, l.unknown);
	bb_room_free(room);
	const int code = all ? print_json(all) : BB_EXIT_OK;
	return l.unknown ? BB_EXIT_FAILED : code;
}

const struct bb_command bb_cmd_devices = {
	"devices", "the back ends of this build, and the devices of a room", "[ROOM] [--json]", options, 0, 1, command,
};
