/*
 * bench/cmd/devices.c: `blackburst devices [ROOM]`: what is attached to this machine that the drivers here can open;
 * and for each device of a room whether it is there, and if not, why and what to do. Opens none of them.
 */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/backends.h"
#include "bench/cli.h"
#include "bench/rig.h"
#include "drivers/attached.h"

static const struct bb_cli_option options[] = {
	{ "all", NULL, "also what no driver here understands" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

struct listing {
	json_t *rows; /* NULL: print */
	const struct bb_attached *attached;
	size_t n_attached;
	size_t n, n_sim, n_here, n_missing;
};

static const char *const state_words[] = {
	[BB_ATTACHED_HERE] = "here",
	[BB_ATTACHED_MISSING] = "missing",
	[BB_ATTACHED_REFUSED] = "not usable",
	[BB_ATTACHED_UNSEEN] = "not seen from here",
};

static void row(struct listing *l, const char *class_name, const char *id, const char *device, const char *state,
		const struct bb_attached_answer *a)
{
	const char *what = a->found < l->n_attached ? l->attached[a->found].what : "";

	if (l->rows) {
		json_array_append_new(l->rows, json_pack("{s:s, s:s, s:s, s:s, s:s, s:s, s:s}", "class", class_name,
							 "id", id, "device", device, "state", state, "what", what,
							 "why", a->why, "remedy", a->remedy));
		return;
	}
	printf("%-9s %-14s %-40s %s%s%s\n", class_name, id, device, state, what[0] ? ": " : "", what);
	if (a->why[0])
		printf("%25s%s\n%25s-> %s\n", "", a->why, "", a->remedy);
}

static void visit(void *ctx, enum bb_class class, size_t index, const char *class_name, const char *id, const char *uri,
		  struct bb_device *dev)
{
	struct listing *l = ctx;
	struct bb_uri parsed;
	struct bb_error err = { 0 };
	struct bb_attached_answer a = { .found = l->n_attached };
	(void)class;
	(void)index;
	(void)dev;

	l->n++;
	if (!uri[0] || !strncmp(uri, "sim:", 4)) {
		l->n_sim++;
		row(l, class_name, id, uri[0] ? uri : "sim:", "simulated", &a);
		return;
	}
	if (bb_uri_parse(uri, &parsed, NULL, &err) != BB_OK || !bb_backend_find(&parsed, id, &err)) {
		snprintf(a.why, sizeof(a.why), "%.190s", err.text);
		snprintf(a.remedy, sizeof(a.remedy), "correct the URI in the room file");
		a.state = BB_ATTACHED_MISSING;
	} else {
		bb_attached_match("", l->attached, l->n_attached, &parsed, &a);
	}
	l->n_here += a.state == BB_ATTACHED_HERE;
	l->n_missing += a.state == BB_ATTACHED_MISSING || a.state == BB_ATTACHED_REFUSED;
	row(l, class_name, id, uri, state_words[a.state], &a);
}

static void list_backends(json_t *out)
{
	const struct bb_backend *b;

	for (size_t i = 0; (b = bb_backend(i)); i++) {
		char classes[120] = "";
		const void *const have[] = { b->shutter, b->camera,  b->display, b->monitor,
					     b->power,   b->gamepad, b->link };
		static const char *const names[] = { "shutter", "camera",  "display", "monitor",
						     "power",   "gamepad", "link" };
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

static void list_attached(const struct listing *l, bool all, json_t *out)
{
	size_t shown = 0;

	for (size_t i = 0; i < l->n_attached; i++) {
		const struct bb_attached *a = &l->attached[i];
		if (!all && !a->known)
			continue;
		shown++;
		if (out)
			json_array_append_new(out, json_pack("{s:s, s:s, s:s, s:b, s:b}", "device", a->device, "node",
							     a->node, "what", a->what, "known", a->known, "usable",
							     a->usable));
		else
			printf("%-40s %-18s %s%s\n", a->device, a->node, a->what,
			       a->usable ? "" : " (not usable by this user)");
	}
	if (!out && !shown)
		printf("nothing%s is attached to this machine\n", all ? "" : " that a driver here understands");
	if (!out && shown < l->n_attached)
		printf("(%zu more with --all)\n", l->n_attached - shown);
}

static int show(const struct bb_cli *cli, const struct bb_room *room, struct listing *l)
{
	const bool all = bb_cli_has(cli, "all");
	const struct bb_rig closed = { .room = room };

	if (bb_cli_has(cli, "json")) {
		json_t *root = json_object(), *backends = json_array(), *attached = json_array();
		list_backends(backends);
		list_attached(l, all, attached);
		json_object_set_new(root, "backends", backends);
		json_object_set_new(root, "attached", attached);
		l->rows = json_array();
		if (room)
			bb_rig_each(&closed, visit, l);
		json_object_set_new(root, "devices", l->rows);
		return bb_cli_print_json(root);
	}
	if (!room) {
		printf("back ends of this build:\n");
		list_backends(NULL);
		printf("\nattached to this machine:\n");
		list_attached(l, all, NULL);
		return BB_EXIT_OK;
	}
	bb_rig_each(&closed, visit, l);
	printf("\n%zu devices: %zu simulated, %zu here, %zu missing or not usable\n", l->n, l->n_sim, l->n_here,
	       l->n_missing);
	return BB_EXIT_OK;
}

static int command(const struct bb_cli *cli)
{
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	struct bb_attached *attached = calloc(BB_ATTACHED_MAX, sizeof(*attached));
	struct listing l = { .attached = attached };

	if (!attached)
		return BB_EXIT_INTERNAL;
	if (cli->n_args == 1) {
		const enum bb_status status = bb_room_load(cli->arg[0], &room, &err);
		if (status != BB_OK) {
			free(attached);
			return bb_cli_fail(status, &err);
		}
	}
	l.n_attached = bb_attached_list("", attached, BB_ATTACHED_MAX);
	const int code = show(cli, room, &l);
	bb_room_free(room);
	free(attached);
	return code == BB_EXIT_OK && l.n_missing ? BB_EXIT_DEVICE_LOST : code;
}

const struct bb_command bb_cmd_devices = {
	"devices",
	"what is attached, matched with a room: what is missing, why, and what to do",
	"[ROOM] [--all] [--json]",
	options,
	0,
	1,
	command,
};
