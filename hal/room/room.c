/*
 * hal/room/room.c: loading a room: the file's top level, nodes, budgets, safety, and what is asked of a loaded room. Walls
 * are read in room_walls.c, devices in room_devices.c, the geometry is judged in room_lint.c.
 */
#include "hal/room.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/room/budget_read.h"
#include "hal/file.h"
#include "hal/room/calibration.h"
#include "hal/room/room_build.h"

/* --- ids ---------------------------------------------------------------------------------------------------------- */

#define ID_LETTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.-"

enum bb_status room_check_id(struct bb_reader *r, const struct bb_yaml_node *at, const char *id)
{
	const size_t n = strlen(id);

	if (n == 0 || n >= BB_ID_MAX || id[strspn(id, ID_LETTERS)] || strstr(id, "..") || id[0] == '.' || id[0] == '-')
		return bb_yaml_fail(r, 1103, at, "'%.40s'", id);
	return BB_OK;
}

/* "n01": prefix and number; false without a number of 1 to 4 digits. */
static bool split_number(const char *id, size_t n, size_t *n_prefix, unsigned *number)
{
	size_t digits = 0;

	while (digits < n && id[n - 1 - digits] >= '0' && id[n - 1 - digits] <= '9')
		digits++;
	*n_prefix = n - digits;
	*number = 0;
	for (size_t i = n - digits; digits <= 4 && i < n; i++)
		*number = *number * 10 + (unsigned)(id[i] - '0');
	return digits >= 1 && digits <= 4;
}

enum bb_status room_ids_parse(struct bb_reader *r, const struct bb_yaml_node *at, const char *text, struct room_ids *out)
{
	const char *dots = strstr(text, "..");
	char first[2 * BB_ID_MAX], last[2 * BB_ID_MAX];
	size_t n_first, n_last;
	unsigned to;

	memset(out, 0, sizeof(*out));
	out->n = 1;
	if (!dots) {
		const enum bb_status status = room_check_id(r, at, text);
		if (!status)
			snprintf(out->prefix, sizeof(out->prefix), "%s", text);
		return status;
	}
	snprintf(first, sizeof(first), "%.*s", (int)(dots - text), text);
	snprintf(last, sizeof(last), "%s", dots + 2);
	if (room_check_id(r, at, first) || room_check_id(r, at, last))
		return BB_ERR_CONFIG;
	if (!split_number(first, strlen(first), &n_first, &out->from) || !split_number(last, strlen(last), &n_last, &to) ||
	    n_first != n_last || strncmp(first, last, n_first) || strlen(first) != strlen(last) || to < out->from)
		return bb_yaml_fail(r, 1103, at, "'%.60s' is no row of ids such as n01..n18", text);
	snprintf(out->prefix, sizeof(out->prefix), "%.*s", (int)n_first, first);
	out->width = (int)(strlen(first) - n_first);
	out->n = to - out->from + 1;
	return BB_OK;
}

void room_ids_at(const struct room_ids *ids, unsigned i, char out[BB_ID_MAX])
{
	if (ids->width)
		snprintf(out, BB_ID_MAX, "%.26s%0*u", ids->prefix, ids->width, (ids->from + i) % 10000);
	else
		snprintf(out, BB_ID_MAX, "%s", ids->prefix);
}

/* --- helpers of the builders -------------------------------------------------------------------------------------- */

enum bb_status room_grow(struct room_build *b, const struct bb_yaml_node *at, void *array_ptr, size_t size, size_t n,
                         size_t add, size_t most, const char *what)
{
	void **array = array_ptr, *more;

	if (add > most || n > most - add)
		return bb_yaml_fail(&b->r, 1101, at, "%zu %s, at most %zu", n + add, what, most);
	more = reallocarray(*array, n + add ? n + add : 1, size);
	if (!more)
		return bb_fail(b->r.err, BB_ERR_NOMEM, 1702, NULL, "%s", what);
	memset((char *)more + n * size, 0, add * size);
	*array = more;
	return BB_OK;
}

enum bb_status room_check_device(struct room_build *b, const struct bb_yaml_node *map, char device[BB_DEVICE_BYTES])
{
	const struct bb_yaml_node *key = bb_yaml_get(map, "device");
	const struct bb_where where = bb_yaml_where(&b->r, key ? key : map);
	struct bb_uri uri;

	if (!*device)
		snprintf(device, BB_DEVICE_BYTES, "%s", b->device);
	return bb_uri_parse(device, &uri, &where, b->r.err);
}

enum bb_status room_find_node(struct room_build *b, const struct bb_yaml_node *at, const char *id, uint16_t *out)
{
	const int index = bb_room_node(b->room, id);

	if (index < 0)
		return bb_yaml_fail(&b->r, 1102, at, "no node '%s'", id);
	*out = (uint16_t)index;
	return BB_OK;
}

enum bb_status room_find_wall(struct room_build *b, const struct bb_yaml_node *at, const char *id, uint16_t *out)
{
	const int index = bb_room_wall(b->room, id);

	if (index < 0)
		return bb_yaml_fail(&b->r, 1102, at, "no wall '%s'", id);
	*out = (uint16_t)index;
	return BB_OK;
}

struct bb_rate room_rate(double hz)
{
	return bb_rate_from_hz(hz);
}

/* --- the top level ------------------------------------------------------------------------------------------------ */

#define ROW_TEXT(key, type, member, text_default, must, help)                                                        \
	{ key, BB_OPT_TYPE_TEXT, offsetof(type, member), sizeof(((type *)0)->member), 0, 1, 0, 1, text_default, must, help }

static const struct bb_option top_options[] = {
	ROW_TEXT("room", struct bb_room, name, "", true, "name of the room"),
	{ "eye_separation_mm", BB_OPT_TYPE_F64, offsetof(struct bb_room, eye_separation_m), 0, 63, 0, 1000, 1e-3, NULL, false,
	  "between the viewer's pupils" },
	{ "degraded_max_s", BB_OPT_TYPE_F64, offsetof(struct bb_room, degraded_max_s), 0, 1, 0, 3600, 1, NULL, false,
	  "a needed device may be degraded this long" },
	ROW_TEXT("calibration", struct bb_room, calibration, "", false, "file of calibrated cameras: track calibrate"),
	BB_OPT_END
};

static struct room_build *build_of(struct bb_reader *r)
{
	return bb_container_of(r, struct room_build, r);
}

static enum bb_status read_size(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct bb_room *room = target;
	double v[3];
	const enum bb_status status = bb_yaml_numbers(r, value, 3, 1e-3, BB_ROOM_SPAN_M, 1, v);

	if (!status)
		room->size_m = (struct bb_vec3){ v[0], v[1], v[2] };
	return status;
}

static enum bb_status read_neutral(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct bb_room *room = target;

	return bb_yaml_vec3(r, value, BB_ROOM_SPAN_M, 1, &room->neutral);
}

static enum bb_status read_defaults(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	static const struct bb_option options[] = {
		ROW_TEXT("device", struct room_build, device, "sim:", false, "back end of every device that names none"),
		BB_OPT_END
	};
	static const struct bb_yaml_branch branches[] = {
		{ "wall", room_read_wall_default, false },
		{ "camera", room_read_camera_default, false },
		{ "monitor", room_read_monitor_default, false },
		{ NULL, NULL, false },
	};
	struct room_build *b = build_of(r);
	const enum bb_status status = bb_yaml_walk(r, value, options, branches, b, 0);

	(void)target;
	return status ? status : room_check_device(b, value, b->device);
}

static const struct bb_option node_options[] = {
	{ "id", BB_OPT_TYPE_TEXT, 0, 2 * BB_ID_MAX, 0, 1, 0, 1, "", true, "id, or a row of ids: n01..n18" },
	{ "profile", BB_OPT_TYPE_TEXT, 2 * BB_ID_MAX, BB_ID_MAX, 0, 1, 0, 1, "desktop-gpu", false,
	  "cost model: profiles/<name>.yaml beside the room" },
	{ "head", BB_OPT_TYPE_BOOL, 3 * BB_ID_MAX, 0, 0, 0, 1, 1, NULL, false, "owns the devices and sends the state" },
	BB_OPT_END
};
struct node_draft { /* as node_options counts the offsets */
	char ids[2 * BB_ID_MAX], profile[BB_ID_MAX];
	bool head;
};
_Static_assert(offsetof(struct node_draft, head) == 3 * BB_ID_MAX, "node_options");

static enum bb_status read_node(struct bb_reader *r, const struct bb_yaml_node *entry)
{
	struct room_build *b = build_of(r);
	struct bb_room *room = b->room;
	struct room_ids ids = { .n = 0 };
	struct node_draft draft;
	enum bb_status status;

	bb_options_defaults(node_options, &draft);
	status = bb_yaml_walk(r, entry, node_options, NULL, &draft, 0);
	if (!status)
		status = room_check_id(r, entry, draft.profile);
	if (!status)
		status = room_ids_parse(r, entry, draft.ids, &ids);
	if (!status)
		status = room_grow(b, entry, &room->nodes, sizeof(*room->nodes), room->n_nodes, ids.n, BB_LINK_NODES_MAX,
		                   "nodes");
	for (unsigned i = 0; !status && i < ids.n; i++) {
		struct bb_node node = { .head = draft.head };
		room_ids_at(&ids, i, node.id);
		memcpy(node.profile, draft.profile, sizeof(node.profile));
		if (bb_room_node(room, node.id) >= 0)
			return bb_yaml_fail(r, 1105, entry, "node '%s'", node.id);
		room->nodes[room->n_nodes++] = node;
	}
	return status;
}

static enum bb_status read_nodes(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct bb_room *room = build_of(r)->room;
	enum bb_status status = bb_yaml_want(r, value, BB_YAML_LIST);
	size_t heads = 0;

	(void)target;
	for (const struct bb_yaml_node *c = value->first; c && !status; c = c->next)
		status = read_node(r, c);
	if (status)
		return status;
	if (room->n_nodes == 1)
		room->nodes[0].head = true;
	for (size_t i = 0; i < room->n_nodes; i++)
		heads += room->nodes[i].head;
	return heads == 1 ? BB_OK : bb_yaml_fail(r, 1109, value, "%zu nodes have head: true", heads);
}

static enum bb_status read_budgets(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct bb_room *room = target;
	enum bb_status status = bb_yaml_want(r, value, BB_YAML_MAP);

	for (const struct bb_yaml_node *c = value->first; c && !status; c = c->next)
		status = bb_budget_read(r, c, room->budgets, &room->n_budgets);
	return status;
}

static enum bb_status read_safety(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct bb_room *room = target;
	enum bb_status status = bb_yaml_want(r, value, BB_YAML_MAP);

	for (const struct bb_yaml_node *c = value->first; c && !status; c = c->next) {
		const struct bb_where where = bb_yaml_where(r, c);
		double wish = 0;

		if (c->kind == BB_YAML_SCALAR && !strcmp(c->text, "true"))
			wish = 1;
		else if (c->kind != BB_YAML_SCALAR || strcmp(c->text, "false"))
			status = bb_yaml_number(r, c, -1e9, 1e9, &wish);
		if (!status)
			status = bb_safety_tighten(&room->safety, c->key, wish, &where, r->err);
	}
	return status;
}

static const struct bb_yaml_branch top_branches[] = {
	{ "size_m", read_size, false },
	{ "neutral_m", read_neutral, false },
	{ "safety", read_safety, false },
	{ "defaults", read_defaults, false },
	{ "nodes", read_nodes, true },
	{ "link", room_read_link, false },
	{ "framelock", room_read_framelock, false },
	{ "walls", room_read_walls, true },
	{ "shutters", room_read_shutters, false },
	{ "cameras", room_read_cameras, false },
	{ "power", room_read_power, false },
	{ "monitors", room_read_monitors, false },
	{ "gamepads", room_read_gamepads, false },
	{ "bodies", room_read_bodies, false },
	{ "budgets", read_budgets, false },
	{ NULL, NULL, false },
};

/* --- loading ------------------------------------------------------------------------------------------------------ */

static void derive_box(struct bb_room *room)
{
	struct bb_vec3 min = bb_corners_at(&room->walls[0].corners, 0, 0), max = min;

	for (size_t i = 0; i < 4 * room->n_walls; i++) {
		const struct bb_vec3 p = bb_corners_at(&room->walls[i / 4].corners, (double)(i & 1), (double)(i >> 1 & 1));
		min = (struct bb_vec3){ fmin(min.x, p.x), fmin(min.y, p.y), fmin(min.z, p.z) };
		max = (struct bb_vec3){ fmax(max.x, p.x), fmax(max.y, p.y), fmax(max.z, p.z) };
	}
	room->min = min;
	room->max = max;
}

/* Where a viewer stands when the file does not say: the middle of an enclosed room, 60 cm before a single wall. */
static void derive_neutral(struct bb_room *room)
{
	const struct bb_vec3 middle = bb_vec3_scale(bb_vec3_add(room->min, room->max), 0.5);

	room->neutral = (struct bb_vec3){ middle.x, room->min.y <= 0.2 ? room->min.y + 1.6 : middle.y, middle.z };
	if (room->n_walls == 1) {
		const struct bb_corners *c = &room->walls[0].corners;
		room->neutral = bb_vec3_add(bb_corners_at(c, 0.5, 0.5), bb_vec3_scale(bb_corners_normal(c), 0.6));
	}
}

static void defaults(struct room_build *b)
{
	bb_options_defaults(top_options, b->room);
	b->room->safety = bb_safety_ceilings();
	b->room->neutral.x = (double)NAN;
	snprintf(b->device, sizeof(b->device), "sim:");
	room_wall_defaults(&b->wall);
	room_camera_defaults(&b->camera);
	room_monitor_defaults(&b->monitor);
	bb_options_defaults(room_link_options, &b->room->link);
	bb_options_defaults(room_framelock_options, b->room);
}

/* `calibration: FILE` in place of what the cameras were planned to be. */
static enum bb_status calibrate(struct room_build *b, const struct bb_yaml_node *root)
{
	struct bb_room *room = b->room;
	struct bb_calibration_head head;

	if (!*room->calibration || b->planned)
		return BB_OK;
	if (!bb_path_is_tame(room->calibration))
		return bb_yaml_fail(&b->r, 1204, bb_yaml_get(root, "calibration"), "'%.80s'", room->calibration);
	bb_path_settle(room->calibration, sizeof(room->calibration), room->path);
	const enum bb_status status = bb_calibration_read(room->calibration, room->cameras, room->n_cameras, &head, b->r.err);
	if (!status)
		snprintf(room->calibrated, sizeof(room->calibrated), "%s", head.made);
	return status;
}

static enum bb_status finish(struct room_build *b, const struct bb_yaml_node *root)
{
	struct bb_room *room = b->room;
	enum bb_status status;

	if (!room->n_walls)
		return bb_yaml_fail(&b->r, 1017, root, "an entry in 'walls'");
	derive_box(room);
	if (!isfinite(room->neutral.x))
		derive_neutral(room);
	room->link.n_nodes = (int64_t)room->n_nodes;
	snprintf(room->link.id, sizeof(room->link.id), "net");
	if (!*room->link.device)
		snprintf(room->link.device, sizeof(room->link.device), "%s", b->device);
	status = calibrate(b, root);
	if (!status)
		status = room_check_stereo(b, root);
	return status ? status : room_check_outlets(b, root);
}

static enum bb_status build(struct room_build *b, const char *path)
{
	enum bb_status status;
	struct bb_yaml *doc;

	status = bb_yaml_load(path, &doc, b->r.err);
	if (status)
		return status;
	bb_yaml_sha256(doc, b->room->sha256);
	defaults(b);
	status = bb_yaml_walk(&b->r, bb_yaml_root(doc), top_options, top_branches, b->room, 0);
	if (!status)
		status = finish(b, bb_yaml_root(doc));
	bb_yaml_free(doc);
	return status;
}

static enum bb_status load(const char *path, bool planned, struct bb_room **out, struct bb_error *err)
{
	struct bb_error local = { 0 }; /* the builders rely on the first error winning */
	struct room_build *b;
	enum bb_status status = BB_ERR_NOMEM;

	*out = NULL;
	if (strlen(path) >= BB_PATH_MAX_BYTES)
		return bb_fail(err, BB_ERR_CONFIG, 1001, NULL, "the path has more than %d bytes", BB_PATH_MAX_BYTES - 1);
	b = calloc(1, sizeof(*b));
	if (b)
		b->room = calloc(1, sizeof(*b->room));
	if (b && b->room) {
		snprintf(b->room->path, sizeof(b->room->path), "%s", path);
		b->r = (struct bb_reader){ b->room->path, err ? err : &local };
		b->planned = planned;
		status = build(b, path);
	} else {
		bb_fail(err, status, 1702, NULL, "a room");
	}
	if (b && status)
		bb_room_free(b->room);
	else if (b)
		*out = b->room;
	free(b);
	return status;
}

enum bb_status bb_room_load(const char *path, struct bb_room **out, struct bb_error *err)
{
	return load(path, false, out, err);
}

enum bb_status bb_room_load_planned(const char *path, struct bb_room **out, struct bb_error *err)
{
	return load(path, true, out, err);
}

void bb_room_free(struct bb_room *room)
{
	if (!room)
		return;
	free(room->nodes);
	free(room->walls);
	free(room->screens);
	free(room->cameras);
	free(room->monitors);
	free(room->pdus);
	free(room->gamepads);
	free(room);
}

/* --- what is asked of a room -------------------------------------------------------------------------------------- */

int bb_room_node(const struct bb_room *room, const char *id)
{
	for (size_t i = 0; i < room->n_nodes; i++)
		if (!strcmp(room->nodes[i].id, id))
			return (int)i;
	return -1;
}

int bb_room_wall(const struct bb_room *room, const char *id)
{
	for (size_t i = 0; i < room->n_walls; i++)
		if (!strcmp(room->walls[i].id, id))
			return (int)i;
	return -1;
}

struct bb_vec3 bb_corners_at(const struct bb_corners *c, double u, double v)
{
	const struct bb_vec3 right = bb_vec3_sub(c->lower_right, c->lower_left);
	const struct bb_vec3 up = bb_vec3_sub(c->upper_left, c->lower_left);

	return bb_vec3_add(c->lower_left, bb_vec3_add(bb_vec3_scale(right, u), bb_vec3_scale(up, v)));
}

struct bb_vec3 bb_corners_normal(const struct bb_corners *c)
{
	const struct bb_vec3 right = bb_vec3_sub(c->lower_right, c->lower_left);
	const struct bb_vec3 up = bb_vec3_sub(c->upper_left, c->lower_left);

	return bb_vec3_unit(bb_vec3_cross(right, up), (struct bb_vec3){ 0, 0, 1 });
}

const struct bb_room_section *bb_room_section(size_t i)
{
	static const struct bb_room_section sections[] = {
		{ "room", top_options },
		{ "nodes", node_options },
		{ "walls", room_wall_options },
		{ "walls.grid", room_grid_options },
		{ "walls.display", room_display_options },
		{ "shutters.chain", room_chain_options },
		{ "shutters.emitter", room_emitter_options },
		{ "shutters.glasses", room_glasses_options },
		{ "cameras", room_camera_options },
		{ "monitors", room_monitor_options },
		{ "power", room_pdu_options },
		{ "power.outlets", room_outlet_options },
		{ "gamepads", room_gamepad_options },
		{ "link", room_link_options },
		{ "framelock", room_framelock_options },
	};

	return i < BB_ARRAY_LEN(sections) ? &sections[i] : NULL;
}
