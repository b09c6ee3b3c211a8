/*
 * hal/room/room_devices.c: the devices of a room: shutters, cameras, monitors, power, gamepads, marker bodies.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/file.h"
#include "hal/room/room_build.h"

#define RAD_PER_DEG (3.14159265358979323846 / 180.0)
#define SIZE_OF(type, member) sizeof(((type *)0)->member)
#define TEXT(key, type, member, must, help) \
	{ key, BB_OPT_TYPE_TEXT, offsetof(type, member), SIZE_OF(type, member), 0, 1, 0, 1, "", must, help }
#define F64(key, type, member, def, lo, hi, help) \
	{ key, BB_OPT_TYPE_F64, offsetof(type, member), 0, def, lo, hi, 1, NULL, false, help }

static struct room_build *build_of(struct bb_reader *r)
{
	return bb_container_of(r, struct room_build, r);
}

static enum bb_status each(struct bb_reader *r, const struct bb_yaml_node *list,
                           enum bb_status (*read)(struct room_build *, const struct bb_yaml_node *))
{
	enum bb_status status = bb_yaml_want(r, list, BB_YAML_LIST);

	for (const struct bb_yaml_node *c = list->first; c && !status; c = c->next)
		status = read(build_of(r), c);
	return status;
}

/* --- shutters ----------------------------------------------------------------------------------------------------- */

struct chain_draft {
	struct bb_shutter_config chain;
	double rate_hz;
};

/* Nematic cells, as active glasses have them: no maker publishes all four, so these are the middle of what is seen
 * (open 0.5-3 ms, close 0.05-0.5 ms, 300-1500:1, 25-38 %). A ferroelectric FE-1 is said to be 100 us, 1000:1, 25 %. */
#define CELL(which) \
	F64("open_us", struct chain_draft, chain.which.open_us, 1200, 0, 8000, "10-90 % of opening"), \
	F64("close_us", struct chain_draft, chain.which.close_us, 200, 0, 8000, "10-90 % of closing"), \
	F64("contrast", struct chain_draft, chain.which.contrast, 500, 2, 1e6, "light let through open : closed"), \
	F64("transmission_percent", struct chain_draft, chain.which.transmission_percent, 30, 1, 100, "when open")

const struct bb_option room_chain_options[] = {
	TEXT("device", struct chain_draft, chain.device, false, "back end"),
	F64("rate_hz", struct chain_draft, rate_hz, 120, 50, 1000, "edges a second: two for a stereo pair"),
	F64("stage_delay_us", struct chain_draft, chain.stage_delay_us, 35, 0, 5000, "from one controller to the next"),
	F64("rate_error_ppm", struct chain_draft, chain.rate_error_ppm, 0, -1000, 1000, "simulated clock error"),
	F64("jitter_us", struct chain_draft, chain.jitter_us, 1, 0, 1000, "simulated jitter of the edges, sd"),
	F64("shutter_delay_us", struct chain_draft, chain.shutter_delay_us, (double)NAN, 0, 20000,
	    "opens this long after its edge; left out: with the glasses"),
	F64("shutter_duty_percent", struct chain_draft, chain.shutter_duty_percent, 100, 1, 100,
	    "share of an edge period it stays open"),
	CELL(cell),
	BB_OPT_END
};

const struct bb_option room_glasses_options[] = { CELL(glasses), BB_OPT_END };

const struct bb_option room_emitter_options[] = {
	{ "protocol", BB_OPT_TYPE_TEXT, offsetof(struct chain_draft, chain.emitter_protocol),
	  SIZE_OF(struct chain_draft, chain.emitter_protocol), 0, 1, 0, 1, "3d-vision", false, "of the glasses" },
	F64("offset_us", struct chain_draft, chain.emitter_offset_us, 0, 0, 20000, "glasses switch this long after the edge"),
	F64("token_gap_us", struct chain_draft, chain.token_gap_us, 1000, 0, 20000, "from one lens closing to the other opening"),
	BB_OPT_END
};

static enum bb_status read_stages(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct chain_draft *d = target;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_LIST);
	uint16_t wall;

	if (!status && (v->n == 0 || v->n > BB_STAGES_MAX))
		status = bb_yaml_fail(r, 1101, v, "%zu stages, wanted 1 to %d", v->n, BB_STAGES_MAX);
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		char *stage = d->chain.stage[d->chain.n_stages];

		status = bb_yaml_text(r, c, stage, BB_ID_MAX);
		if (!status)
			status = room_find_wall(build_of(r), c, stage, &wall);
		for (int64_t i = 0; i < d->chain.n_stages && !status; i++)
			if (!strcmp(d->chain.stage[i], stage))
				status = bb_yaml_fail(r, 1105, c, "stage '%s'", stage);
		d->chain.n_stages++;
	}
	return status;
}

static enum bb_status read_chain(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "stages", read_stages, true }, { NULL, NULL, false } };
	struct chain_draft *d = target;
	const enum bb_status status = bb_yaml_walk(r, v, room_chain_options, branches, d, 0);
	const double least_hz = build_of(r)->room->safety.shutter_least_hz;

	if (status)
		return status;
	if (d->rate_hz / 2 < least_hz)
		return bb_yaml_fail(r, 1120, v, "%g edges a second give each eye %g Hz, at least %g", d->rate_hz,
		                    d->rate_hz / 2, least_hz);
	return room_check_device(build_of(r), v, d->chain.device);
}

static enum bb_status read_emitter(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_walk(r, v, room_emitter_options, NULL, target, 0);
}

static enum bb_status read_glasses(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_walk(r, v, room_glasses_options, NULL, target, 0);
}

enum bb_status room_read_shutters(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "chain", read_chain, true },
		                                          { "emitter", read_emitter, false },
		                                          { "glasses", read_glasses, false },
		                                          { NULL, NULL, false } };
	struct bb_room *room = build_of(r)->room;
	struct chain_draft d = { 0 };
	enum bb_status status;

	(void)target;
	bb_options_defaults(room_chain_options, &d);
	bb_options_defaults(room_emitter_options, &d);
	bb_options_defaults(room_glasses_options, &d);
	status = bb_yaml_walk(r, value, NULL, branches, &d, 0);
	if (!status && d.chain.emitter_offset_us >= 1e6 / d.rate_hz)
		status = bb_yaml_fail(r, 1114, value, "the emitter's offset of %g us is longer than a period of %g us",
		                      d.chain.emitter_offset_us, 1e6 / d.rate_hz);
	if (isnan(d.chain.shutter_delay_us))
		d.chain.shutter_delay_us = d.chain.emitter_offset_us;
	if (!status && fmax(d.chain.shutter_delay_us, d.chain.token_gap_us) >= 1e6 / d.rate_hz)
		status = bb_yaml_fail(r, 1114, value, "shutter_delay_us and token_gap_us are shorter than a period of %g us",
		                      1e6 / d.rate_hz);
	if (status)
		return status;
	d.chain.rate = room_rate(d.rate_hz);
	snprintf(d.chain.id, sizeof(d.chain.id), "chain");
	room->chain = d.chain;
	room->has_chain = true;
	return BB_OK;
}

/* --- monitors ----------------------------------------------------------------------------------------------------- */

#define M struct room_monitor_draft

const struct bb_option room_monitor_options[] = {
	TEXT("id", M, monitor.id, false, "id; a grid's monitors are named after their screens"),
	TEXT("node", M, monitor.node, false, "whose bus it hangs on; a grid's after their tiles"),
	TEXT("device", M, monitor.device, false, "back end"),
	TEXT("edid", M, monitor.edid, false, "model name it must report"),
	TEXT("outlet", M, monitor.outlet, false, "pdu/outlet that feeds it: pdu1/2"),
	F64("refresh_hz", M, refresh_hz, 0, 10, 1000, "it must run at; left out: its screen's"),
	{ "input", BB_OPT_TYPE_I64, offsetof(M, monitor.input), 0, 0x0F, 1, 255, 1, NULL, false,
	  "VCP 60: the input it must show (0x0F DisplayPort-1, 0x11 HDMI-1)" },
	BB_OPT_END
};

void room_monitor_defaults(struct room_monitor_draft *d)
{
	memset(d, 0, sizeof(*d));
	bb_options_defaults(room_monitor_options, d);
}

static enum bb_status read_monitor_pixels(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_monitor_draft *d = target;
	return bb_yaml_pixels(r, v, &d->monitor.width_px, &d->monitor.height_px);
}

/* `vcp: {0x10: 60}`: wanted values by code. */
static enum bb_status read_vcp(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_monitor_config *m = &((struct room_monitor_draft *)target)->monitor;
	static const struct bb_option row[] = {
		{ "VCP code", BB_OPT_TYPE_I64, 0, 0, 0, 0, 255, 1, NULL, false, NULL }, BB_OPT_END
	};
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_MAP);

	m->n_settings = 0;
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		const struct bb_where where = bb_yaml_where(r, c);
		struct bb_monitor_setting s;

		if (m->n_settings == BB_MONITOR_SETTINGS_MAX)
			return bb_yaml_fail(r, 1101, c, "more than %d settings", BB_MONITOR_SETTINGS_MAX);
		status = bb_options_set(row, &s.code, "VCP code", c->key, &where, r->err);
		if (!status)
			status = bb_yaml_integer(r, c, 0, 65535, &s.value);
		if (!status && (s.code == BB_VCP_POWER_MODE || s.code == BB_VCP_RESTORE_DEFAULTS))
			status = bb_yaml_fail(r, 1120, c, "VCP %02X is not a setting to keep", (unsigned)s.code & 255);
		m->setting[m->n_settings++] = s;
	}
	return status;
}

static enum bb_status add_grid_wall(struct bb_reader *r, const struct bb_yaml_node *at, struct room_monitor_draft *d)
{
	char id[BB_ID_MAX];
	enum bb_status status = bb_yaml_text(r, at, id, sizeof(id));

	if (!status && d->n_walls == BB_ROOM_WALLS_MAX)
		status = bb_yaml_fail(r, 1101, at, "more than %d walls", BB_ROOM_WALLS_MAX);
	if (!status)
		status = room_find_wall(build_of(r), at, id, &d->walls[d->n_walls]);
	d->n_walls += !status;
	return status;
}

static enum bb_status read_grid_wall(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return add_grid_wall(r, v, target);
}

static enum bb_status read_grid_walls(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_LIST);

	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next)
		status = add_grid_wall(r, c, target);
	return status;
}

static enum bb_status read_monitor_grid(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "wall", read_grid_wall, false },
		                                          { "walls", read_grid_walls, false },
		                                          { NULL, NULL, false } };
	struct room_monitor_draft *d = target;
	const enum bb_status status = bb_yaml_walk(r, v, NULL, branches, d, 0);

	return status || d->n_walls ? status : bb_yaml_fail(r, 1017, v, "'wall' or 'walls'");
}

enum bb_status room_read_monitor_default(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "pixels", read_monitor_pixels, false },
		                                          { "vcp", read_vcp, false },
		                                          { NULL, NULL, false } };
	struct room_build *b = target;

	return bb_yaml_walk(r, value, room_monitor_options, branches, &b->monitor, BB_YAML_PARTIAL);
}

/* What the screen tells about its monitor, where the file does not. */
static void like_screen(struct bb_monitor_config *m, const struct room_monitor_draft *d, const struct bb_screen *s)
{
	const struct bb_rate usual = { 60, 1 };

	if (!m->width_px) {
		m->width_px = s ? s->display.width_px : 1920;
		m->height_px = s ? s->display.height_px : 1080;
	}
	m->rate = d->refresh_hz > 0 ? room_rate(d->refresh_hz) : s ? s->display.rate : usual;
}

static enum bb_status add_grid(struct room_build *b, const struct room_monitor_draft *d)
{
	struct bb_room *room = b->room;
	enum bb_status status = BB_OK;

	if (*d->monitor.id || *d->monitor.node || *d->monitor.outlet)
		return bb_yaml_fail(&b->r, 1011, d->at, "a grid's monitors take id and node from their screens");
	for (size_t i = 0; i < room->n_screens && !status; i++) {
		const struct bb_screen *s = &room->screens[i];
		bool wanted = false;

		for (size_t w = 0; w < d->n_walls; w++)
			wanted = wanted || d->walls[w] == s->wall;
		if (!wanted)
			continue;
		status = room_grow(b, d->at, &room->monitors, sizeof(*room->monitors), room->n_monitors, 1,
		                   BB_ROOM_MONITORS_MAX, "monitors");
		if (status)
			break;
		struct bb_monitor_config *m = &room->monitors[room->n_monitors++];
		*m = d->monitor;
		memcpy(m->id, s->id, sizeof(m->id));
		memcpy(m->node, room->nodes[s->node].id, sizeof(m->node));
		like_screen(m, d, s);
	}
	return status;
}

static enum bb_status add_monitor(struct room_build *b, const struct room_monitor_draft *d)
{
	struct bb_room *room = b->room;
	const struct bb_screen *screen = NULL;
	uint16_t node = 0;
	enum bb_status status = room_check_id(&b->r, d->at, d->monitor.id);

	if (!status && !*d->monitor.node && room->n_nodes > 1)
		status = bb_yaml_fail(&b->r, 1017, d->at, "'node' of a monitor");
	if (!status && *d->monitor.node)
		status = room_find_node(b, d->at, d->monitor.node, &node);
	if (!status)
		status = room_grow(b, d->at, &room->monitors, sizeof(*room->monitors), room->n_monitors, 1,
		                   BB_ROOM_MONITORS_MAX, "monitors");
	for (size_t i = 0; i < room->n_screens && !screen && !status; i++)
		screen = room->screens[i].node == node ? &room->screens[i] : NULL;
	if (status)
		return status;
	struct bb_monitor_config *m = &room->monitors[room->n_monitors++];
	*m = d->monitor;
	memcpy(m->node, room->nodes[node].id, sizeof(m->node));
	like_screen(m, d, screen);
	return BB_OK;
}

static enum bb_status check_monitor_ids(struct room_build *b, const struct bb_yaml_node *at, size_t from)
{
	const struct bb_room *room = b->room;

	for (size_t i = from; i < room->n_monitors; i++)
		for (size_t j = 0; j < i; j++)
			if (!strcmp(room->monitors[i].id, room->monitors[j].id))
				return bb_yaml_fail(&b->r, 1105, at, "monitor '%s'", room->monitors[i].id);
	return BB_OK;
}

static enum bb_status read_monitor(struct room_build *b, const struct bb_yaml_node *entry)
{
	static const struct bb_yaml_branch branches[] = { { "pixels", read_monitor_pixels, false },
		                                          { "vcp", read_vcp, false },
		                                          { "grid", read_monitor_grid, false },
		                                          { NULL, NULL, false } };
	struct room_monitor_draft d = b->monitor;
	const size_t from = b->room->n_monitors;
	enum bb_status status;

	d.at = entry;
	status = bb_yaml_walk(&b->r, entry, room_monitor_options, branches, &d, 0);
	if (!status)
		status = room_check_device(b, entry, d.monitor.device);
	if (!status)
		status = d.n_walls ? add_grid(b, &d) : add_monitor(b, &d);
	return status ? status : check_monitor_ids(b, entry, from);
}

enum bb_status room_read_monitors(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	(void)target;
	return each(r, value, read_monitor);
}

/* --- power -------------------------------------------------------------------------------------------------------- */

const struct bb_option room_pdu_options[] = {
	TEXT("id", struct bb_power_config, id, true, "id of the strip"),
	TEXT("device", struct bb_power_config, device, false, "back end"),
	BB_OPT_END
};

const struct bb_option room_outlet_options[] = {
	{ "outlet", BB_OPT_TYPE_I64, offsetof(struct bb_outlet_config, outlet), 0, 0, 1, BB_OUTLETS_MAX, 1, NULL, true,
	  "the strip's own number" },
	TEXT("name", struct bb_outlet_config, name, true, "what it feeds"),
	F64("load_a", struct bb_outlet_config, load_a, 1.0, 0, 63, "current when all is well"),
	F64("inrush_a", struct bb_outlet_config, inrush_a, 10, 0, 500, "peak at switching on"),
	F64("inrush_ms", struct bb_outlet_config, inrush_ms, 20, 0, 10000, "how long the peak lasts"),
	BB_OPT_END
};

static enum bb_status read_outlet(struct bb_reader *r, const struct bb_yaml_node *c, struct bb_power_config *pdu)
{
	struct bb_outlet_config o;
	enum bb_status status;

	if (pdu->n_outlets == BB_OUTLETS_MAX)
		return bb_yaml_fail(r, 1101, c, "more than %d outlets", BB_OUTLETS_MAX);
	bb_options_defaults(room_outlet_options, &o);
	status = bb_yaml_walk(r, c, room_outlet_options, NULL, &o, 0);
	for (size_t i = 0; i < pdu->n_outlets && !status; i++)
		if (pdu->outlet[i].outlet == o.outlet || !strcmp(pdu->outlet[i].name, o.name))
			status = bb_yaml_fail(r, 1119, c, "outlet %lld '%s' is there already", (long long)o.outlet, o.name);
	if (!status)
		pdu->outlet[pdu->n_outlets++] = o;
	return status;
}

static enum bb_status read_outlets(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_LIST);

	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next)
		status = read_outlet(r, c, target);
	return status;
}

static enum bb_status read_pdu(struct room_build *b, const struct bb_yaml_node *entry)
{
	static const struct bb_yaml_branch branches[] = { { "outlets", read_outlets, true }, { NULL, NULL, false } };
	struct bb_room *room = b->room;
	struct bb_power_config *pdu;
	enum bb_status status = room_grow(b, entry, &room->pdus, sizeof(*room->pdus), room->n_pdus, 1, BB_ROOM_PDUS_MAX,
	                                  "power strips");

	if (status)
		return status;
	pdu = &room->pdus[room->n_pdus];
	bb_options_defaults(room_pdu_options, pdu);
	pdu->safety = room->safety;
	status = bb_yaml_walk(&b->r, entry, room_pdu_options, branches, pdu, 0);
	if (!status)
		status = room_check_id(&b->r, entry, pdu->id);
	if (!status)
		status = room_check_device(b, entry, pdu->device);
	for (size_t i = 0; i < room->n_pdus && !status; i++)
		if (!strcmp(room->pdus[i].id, pdu->id))
			status = bb_yaml_fail(&b->r, 1105, entry, "power strip '%s'", pdu->id);
	room->n_pdus += !status;
	return status;
}

enum bb_status room_read_power(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	(void)target;
	return each(r, value, read_pdu);
}

static bool has_outlet(const struct bb_room *room, const char *name)
{
	char text[2 * BB_ID_MAX];

	for (size_t i = 0; i < room->n_pdus; i++)
		for (size_t o = 0; o < room->pdus[i].n_outlets; o++) {
			snprintf(text, sizeof(text), "%s/%d", room->pdus[i].id, (int)room->pdus[i].outlet[o].outlet);
			if (!strcmp(text, name))
				return true;
		}
	return false;
}

enum bb_status room_check_outlets(struct room_build *b, const struct bb_yaml_node *root)
{
	const struct bb_room *room = b->room;

	for (size_t i = 0; i < room->n_monitors; i++)
		if (*room->monitors[i].outlet && !has_outlet(room, room->monitors[i].outlet))
			return bb_yaml_fail(&b->r, 1102, bb_yaml_get(root, "monitors"), "monitor '%s' hangs on no outlet '%s'",
			                    room->monitors[i].id, room->monitors[i].outlet);
	return BB_OK;
}

/* --- gamepads ----------------------------------------------------------------------------------------------------- */

const struct bb_option room_gamepad_options[] = {
	TEXT("id", struct bb_gamepad_config, id, true, "id of the pad"),
	TEXT("device", struct bb_gamepad_config, device, false, "back end"),
	{ "model", BB_OPT_TYPE_ENUM, offsetof(struct bb_gamepad_config, model), 0, 0, 0, 0, 1,
	  "rumblepad2|spacemouse|xbox360", true, "what it is" },
	TEXT("script", struct bb_gamepad_config, script, false, "simulated: event text to play"),
	BB_OPT_END
};

static enum bb_status read_gamepad(struct room_build *b, const struct bb_yaml_node *entry)
{
	struct bb_room *room = b->room;
	struct bb_gamepad_config *g;
	enum bb_status status = room_grow(b, entry, &room->gamepads, sizeof(*room->gamepads), room->n_gamepads, 1,
	                                  BB_ROOM_GAMEPADS_MAX, "gamepads");

	if (status)
		return status;
	g = &room->gamepads[room->n_gamepads];
	bb_options_defaults(room_gamepad_options, g);
	status = bb_yaml_walk(&b->r, entry, room_gamepad_options, NULL, g, 0);
	if (!status)
		status = room_check_id(&b->r, entry, g->id);
	if (!status)
		status = room_check_device(b, entry, g->device);
	if (!status && *g->script && !bb_path_is_tame(g->script))
		status = bb_yaml_fail(&b->r, 1204, bb_yaml_get(entry, "script"), "'%.80s'", g->script);
	if (!status)
		bb_path_settle(g->script, sizeof(g->script), room->path);
	for (size_t i = 0; i < room->n_gamepads && !status; i++)
		if (!strcmp(room->gamepads[i].id, g->id))
			status = bb_yaml_fail(&b->r, 1105, entry, "gamepad '%s'", g->id);
	room->n_gamepads += !status;
	return status;
}

enum bb_status room_read_gamepads(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	(void)target;
	return each(r, value, read_gamepad);
}

/* --- marker bodies ------------------------------------------------------------------------------------------------ */

#define MARKERS_LEAST 3
#define MARKERS_APART_M 5e-3

struct body_draft {
	struct bb_body body;
	bool has_eyes;
};

static enum bb_status read_markers(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_body *body = &((struct body_draft *)target)->body;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_LIST);

	if (!status && (v->n < MARKERS_LEAST || v->n > BB_ARRAY_LEN(body->marker)))
		status = bb_yaml_fail(r, 1111, v, "%zu markers", v->n);
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		struct bb_vec3 *m = &body->marker[body->n_markers];

		status = bb_yaml_vec3(r, c, 2000, 1e-3, m);
		for (size_t i = 0; i < body->n_markers && !status; i++)
			if (bb_vec3_norm(bb_vec3_sub(body->marker[i], *m)) < MARKERS_APART_M)
				status = bb_yaml_fail(r, 1111, c, "markers %zu and %zu are less than 5 mm apart", i + 1,
				                      body->n_markers + 1);
		body->n_markers++;
	}
	return status;
}

static enum bb_status read_eyes(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct body_draft *d = target;

	d->has_eyes = true;
	return bb_yaml_vec3(r, v, 2000, 1e-3, &d->body.eye_centre);
}

/* The largest height of a triangle of markers over its longest side: 0 for a line. */
static double spread_m(const struct bb_body *body)
{
	double best = 0;

	for (size_t i = 0; i < body->n_markers; i++)
		for (size_t j = 0; j < i; j++)
			for (size_t k = 0; k < j; k++) {
				const struct bb_vec3 a = bb_vec3_sub(body->marker[j], body->marker[i]);
				const struct bb_vec3 b = bb_vec3_sub(body->marker[k], body->marker[i]);
				const double longest = fmax(fmax(bb_vec3_norm(a), bb_vec3_norm(b)), bb_vec3_norm(bb_vec3_sub(a, b)));
				best = fmax(best, bb_vec3_norm(bb_vec3_cross(a, b)) / longest);
			}
	return best;
}

static enum bb_status read_body(struct bb_reader *r, const struct bb_yaml_node *entry, struct body_draft *d)
{
	static const struct bb_yaml_branch branches[] = { { "markers_mm", read_markers, true },
		                                          { "eyes_mm", read_eyes, false },
		                                          { NULL, NULL, false } };
	enum bb_status status = room_check_id(r, entry, entry->key);

	if (!status)
		status = bb_yaml_walk(r, entry, NULL, branches, d, 0);
	if (!status && spread_m(&d->body) < MARKERS_APART_M)
		status = bb_yaml_fail(r, 1111, entry, "the markers of '%s' lie on a line", entry->key);
	snprintf(d->body.id, sizeof(d->body.id), "%.31s", entry->key);
	for (size_t i = 0; i < d->body.n_markers && !d->has_eyes; i++)
		d->body.eye_centre = bb_vec3_add(d->body.eye_centre, bb_vec3_scale(d->body.marker[i], 1.0 / (double)d->body.n_markers));
	return status;
}

/* `glasses` becomes body 0, whatever the order in the file. */
enum bb_status room_read_bodies(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct bb_room *room = build_of(r)->room;
	enum bb_status status = bb_yaml_want(r, value, BB_YAML_MAP);

	(void)target;
	if (!status && value->n > BB_BODIES_MAX)
		status = bb_yaml_fail(r, 1101, value, "%zu bodies, at most %d", value->n, BB_BODIES_MAX);
	if (!status && !bb_yaml_get(value, "glasses"))
		status = bb_yaml_fail(r, 1017, value, "'glasses'");
	room->n_bodies = 1;
	for (const struct bb_yaml_node *c = value->first; c && !status; c = c->next) {
		struct body_draft d = { 0 };
		const bool glasses = !strcmp(c->key, "glasses");

		status = read_body(r, c, &d);
		room->bodies[glasses ? 0 : room->n_bodies] = d.body;
		room->n_bodies += !glasses;
	}
	return status;
}
