#include "bench/rig.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/backends.h"

struct opening { /* what opening one device takes */
	struct bb_open open;
	struct bb_uri uri;
	const struct bb_backend *backend;
	char name[64];
};

static enum bb_status prepare(struct opening *o, const struct bb_open *base, const char *device, int fidelity,
                              const char *class_name, const char *id, struct bb_error *err)
{
	const struct bb_where where = { 0 };

	snprintf(o->name, sizeof(o->name), "%s/%s", class_name, id);
	const enum bb_status status = bb_uri_parse(device[0] ? device : "sim:", &o->uri, &where, err);
	if (status != BB_OK)
		return status;
	o->backend = bb_backend_find(&o->uri, o->name, err);
	if (!o->backend)
		return BB_ERR_CONFIG;
	o->open = *base;
	o->open.uri = &o->uri;
	o->open.fidelity = fidelity;
	return BB_OK;
}

static enum bb_status refuse(const struct opening *o, enum bb_status status, struct bb_error *err)
{
	return bb_fail(err, status, 1503, NULL, "%s (%s:%s): %s", o->name, o->uri.scheme, o->uri.path,
	               bb_status_text(status));
}

/* Opens entry i of one class; `kind` is the class's word in types and calls. */
#define OPEN_ONE(kind, config, slot, fidelity)                                                                        \
	do {                                                                                                          \
		struct opening o;                                                                                     \
		enum bb_status status = prepare(&o, base, (config)->device, fidelity, #kind, (config)->id, err);      \
		if (status != BB_OK)                                                                                  \
			return status;                                                                                \
		if (!o.backend->kind)                                                                                 \
			return refuse(&o, BB_ERR_UNSUPPORTED, err);                                                   \
		status = bb_##kind##_open(o.backend->kind, config, &o.open, slot);                                    \
		if (status != BB_OK)                                                                                  \
			return refuse(&o, status, err);                                                               \
	} while (0)

static enum bb_status open_controls(struct bb_rig *rig, const struct bb_open *base, struct bb_error *err)
{
	const struct bb_room *room = rig->room;

	for (size_t i = 0; i < room->n_pdus && rig->needs[BB_CLASS_POWER] >= 0; i++)
		OPEN_ONE(power, &room->pdus[i], &rig->pdus[i], rig->needs[BB_CLASS_POWER]);
	for (size_t i = 0; i < room->n_monitors && rig->needs[BB_CLASS_MONITORS] >= 0; i++)
		OPEN_ONE(monitor, &room->monitors[i], &rig->monitors[i], rig->needs[BB_CLASS_MONITORS]);
	for (size_t i = 0; i < room->n_gamepads && rig->needs[BB_CLASS_GAMEPADS] >= 0; i++)
		OPEN_ONE(gamepad, &room->gamepads[i], &rig->gamepads[i], rig->needs[BB_CLASS_GAMEPADS]);
	return BB_OK;
}

/* The head's process has every display for its timing; the others have those of the nodes they play. */
static bool is_elsewhere(const struct bb_room *room, uint16_t node)
{
	const struct bb_link_group *g = room->link.group;

	return g && g->process && g->home[node] != g->process;
}

static enum bb_status open_timing(struct bb_rig *rig, const struct bb_open *base, struct bb_error *err)
{
	const struct bb_room *room = rig->room;
	const int displays = rig->needs[BB_CLASS_DISPLAYS];

	if (room->has_chain && rig->needs[BB_CLASS_SHUTTERS] >= 0)
		OPEN_ONE(shutter, &room->chain, &rig->shutter, rig->needs[BB_CLASS_SHUTTERS]);
	for (size_t i = 0; i < room->n_screens && displays >= 0; i++)
		if (!is_elsewhere(room, room->screens[i].node))
			OPEN_ONE(display, &room->screens[i].display, &rig->displays[i], displays);
	for (size_t i = 0; i < room->n_cameras && rig->needs[BB_CLASS_CAMERAS] >= 0; i++)
		OPEN_ONE(camera, &room->cameras[i], &rig->cameras[i], rig->needs[BB_CLASS_CAMERAS]);
	/* The nodes' network is what the loop itself runs on: always there, as exact as the displays it serves. */
	OPEN_ONE(link, &room->link, &rig->link, displays > 0 ? displays : 0);
	return BB_OK;
}

static void *slots(size_t n)
{
	return calloc(n ? n : 1, sizeof(void *));
}

enum bb_status bb_rig_open(struct bb_rig *rig, const struct bb_room *room, const int needs[BB_CLASS_COUNT],
                           const struct bb_open *open, struct bb_error *err)
{
	memset(rig, 0, sizeof(*rig));
	rig->room = room;
	memcpy(rig->needs, needs, sizeof(rig->needs));
	rig->cameras = slots(room->n_cameras);
	rig->displays = slots(room->n_screens);
	rig->monitors = slots(room->n_monitors);
	rig->pdus = slots(room->n_pdus);
	rig->gamepads = slots(room->n_gamepads);
	enum bb_status status = BB_ERR_NOMEM;
	if (rig->cameras && rig->displays && rig->monitors && rig->pdus && rig->gamepads)
		status = open_controls(rig, open, err);
	if (status == BB_OK)
		status = open_timing(rig, open, err);
	if (status != BB_OK)
		bb_rig_close(rig);
	return status;
}

void bb_rig_close(struct bb_rig *rig)
{
	const struct bb_room *room = rig->room;

	if (!room)
		return;
	bb_link_close(rig->link);
	for (size_t i = 0; rig->cameras && i < room->n_cameras; i++)
		bb_camera_close(rig->cameras[i]);
	for (size_t i = 0; rig->displays && i < room->n_screens; i++)
		bb_display_close(rig->displays[i]);
	bb_shutter_close(rig->shutter);
	for (size_t i = 0; rig->gamepads && i < room->n_gamepads; i++)
		bb_gamepad_close(rig->gamepads[i]);
	for (size_t i = 0; rig->monitors && i < room->n_monitors; i++)
		bb_monitor_close(rig->monitors[i]);
	for (size_t i = 0; rig->pdus && i < room->n_pdus; i++)
		bb_power_close(rig->pdus[i]);
	free(rig->cameras);
	free(rig->displays);
	free(rig->monitors);
	free(rig->pdus);
	free(rig->gamepads);
	memset(rig, 0, sizeof(*rig));
}

void bb_rig_each(const struct bb_rig *rig, bb_rig_visit visit, void *ctx)
{
	const struct bb_room *room = rig->room;

	if (room->has_chain)
		visit(ctx, BB_CLASS_SHUTTERS, 0, "shutter", room->chain.id, room->chain.device,
		      rig->shutter ? bb_shutter_device(rig->shutter) : NULL);
	for (size_t i = 0; i < room->n_cameras; i++)
		visit(ctx, BB_CLASS_CAMERAS, i, "camera", room->cameras[i].id, room->cameras[i].device,
		      rig->cameras && rig->cameras[i] ? bb_camera_device(rig->cameras[i]) : NULL);
	for (size_t i = 0; i < room->n_screens; i++)
		visit(ctx, BB_CLASS_DISPLAYS, i, "display", room->screens[i].display.id, room->screens[i].display.device,
		      rig->displays && rig->displays[i] ? bb_display_device(rig->displays[i]) : NULL);
	for (size_t i = 0; i < room->n_monitors; i++)
		visit(ctx, BB_CLASS_MONITORS, i, "monitor", room->monitors[i].id, room->monitors[i].device,
		      rig->monitors && rig->monitors[i] ? bb_monitor_device(rig->monitors[i]) : NULL);
	for (size_t i = 0; i < room->n_pdus; i++)
		visit(ctx, BB_CLASS_POWER, i, "power", room->pdus[i].id, room->pdus[i].device,
		      rig->pdus && rig->pdus[i] ? bb_power_device(rig->pdus[i]) : NULL);
	for (size_t i = 0; i < room->n_gamepads; i++)
		visit(ctx, BB_CLASS_GAMEPADS, i, "gamepad", room->gamepads[i].id, room->gamepads[i].device,
		      rig->gamepads && rig->gamepads[i] ? bb_gamepad_device(rig->gamepads[i]) : NULL);
}
