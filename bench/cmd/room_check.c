#include "bench/cmd/room_check.h"

#include <jansson.h>
#include <string.h>

#include "hal/hash.h"

#define FINDINGS_MAX 256

static double megapixels(const struct bb_room *room)
{
	double sum = 0;

	for (size_t i = 0; i < room->n_screens; i++)
		sum += (double)(room->screens[i].display.width_px * room->screens[i].display.height_px) * 1e-6;
	return sum;
}

static double width_m(const struct bb_corners *c)
{
	return bb_vec3_norm(bb_vec3_sub(c->lower_right, c->lower_left));
}

static double height_m(const struct bb_corners *c)
{
	return bb_vec3_norm(bb_vec3_sub(c->upper_left, c->lower_left));
}

static const struct bb_screen *first_screen(const struct bb_room *room, size_t wall)
{
	for (size_t i = 0; i < room->n_screens; i++)
		if (room->screens[i].wall == wall)
			return &room->screens[i];
	return NULL;
}

static const char *stereo_text(enum bb_stereo s)
{
	return s == BB_STEREO_MONO ? "mono" : s == BB_STEREO_DUAL_PROJECTOR ? "two projectors, shutters" : "frame-sequential";
}

static size_t outlets(const struct bb_room *room)
{
	size_t n = 0;

	for (size_t i = 0; i < room->n_pdus; i++)
		n += room->pdus[i].n_outlets;
	return n;
}

static const char *head_of(const struct bb_room *room)
{
	for (size_t i = 0; i < room->n_nodes; i++)
		if (room->nodes[i].head)
			return room->nodes[i].id;
	return "";
}

/* Displays of the busiest node. */
static size_t most_displays(const struct bb_room *room)
{
	size_t n[BB_LINK_NODES_MAX] = { 0 }, most = 0;

	for (size_t i = 0; i < room->n_screens; i++)
		if (room->screens[i].node < BB_LINK_NODES_MAX && ++n[room->screens[i].node] > most)
			most = n[room->screens[i].node];
	return most;
}

static void print_walls(const struct bb_room *room, FILE *out)
{
	for (size_t i = 0; i < room->n_walls; i++) {
		const struct bb_wall *w = &room->walls[i];
		const struct bb_screen *s = first_screen(room, i);

		fprintf(out, "    %-10s %7.3f x %6.3f m  ", w->id, width_m(&w->corners), height_m(&w->corners));
		if (w->columns * w->rows > 1)
			fprintf(out, "%2d x %d tiles of ", (int)w->columns, (int)w->rows);
		if (!s)
			continue;
		fprintf(out, "%d x %d px, %.2f x %.2f mm a pixel, %g Hz %s", (int)s->display.width_px, (int)s->display.height_px,
		        1e3 * width_m(&s->corners) / (double)s->display.width_px,
		        1e3 * height_m(&s->corners) / (double)s->display.height_px, bb_rate_hz(s->display.rate),
		        stereo_text(s->display.stereo));
		if (*w->node)
			fprintf(out, ", node %s", w->node);
		fputc('\n', out);
	}
}

static const char *many(size_t n)
{
	return n == 1 ? "" : "s";
}

static void print_text(const struct bb_room *room, const struct bb_finding *f, size_t n, size_t shown, FILE *out)
{
	fprintf(out, "%s: %s\n", room->path, room->name);
	fprintf(out, "  room       %.3f x %.3f x %.3f m (width, height, depth of the walls)\n", room->max.x - room->min.x,
	        room->max.y - room->min.y, room->max.z - room->min.z);
	fprintf(out, "  nodes      %zu, head %s, at most %zu display%s on one\n", room->n_nodes, head_of(room),
	        most_displays(room), many(most_displays(room)));
	fprintf(out, "  walls      %zu with %zu screen%s, %.2f megapixels\n", room->n_walls, room->n_screens,
	        many(room->n_screens), megapixels(room));
	print_walls(room, out);
	fprintf(out, "  devices    %zu camera%s, %zu monitor%s, %zu outlet%s on %zu strip%s, %zu gamepad%s, ", room->n_cameras,
	        many(room->n_cameras), room->n_monitors, many(room->n_monitors), outlets(room), many(outlets(room)), room->n_pdus,
	        many(room->n_pdus), room->n_gamepads, many(room->n_gamepads));
	if (room->has_chain)
		fprintf(out, "shutter chain of %d\n", (int)room->chain.n_stages);
	else
		fprintf(out, "no shutters\n");
	fprintf(out, "  budgets    %zu\n", room->n_budgets);
	fprintf(out, "  findings   %s\n", n ? "" : "none");
	for (size_t i = 0; i < shown; i++)
		fprintf(out, "    %s BB%04d: %s\n", f[i].severity ? "error  " : "warning", f[i].number, f[i].text);
	if (n > shown)
		fprintf(out, "    and %zu more\n", n - shown);
}

static json_t *json_walls(const struct bb_room *room)
{
	json_t *list = json_array();

	for (size_t i = 0; i < room->n_walls; i++) {
		const struct bb_wall *w = &room->walls[i];
		json_array_append_new(list, json_pack("{s:s, s:f, s:f, s:I, s:I, s:I, s:I}", "id", w->id, "width_m",
		                                      width_m(&w->corners), "height_m", height_m(&w->corners), "columns",
		                                      (json_int_t)w->columns, "rows", (json_int_t)w->rows, "width_px",
		                                      (json_int_t)w->width_px, "height_px", (json_int_t)w->height_px));
	}
	return list;
}

static json_t *json_findings(const struct bb_finding *f, size_t n)
{
	json_t *list = json_array();

	for (size_t i = 0; i < n; i++)
		json_array_append_new(list, json_pack("{s:i, s:s, s:s}", "number", f[i].number, "severity",
		                                      f[i].severity ? "error" : "warning", "text", f[i].text));
	return list;
}

static void print_json(const struct bb_room *room, const struct bb_finding *f, size_t shown, int errors, FILE *out)
{
	char hash[BB_HASH_HEX];
	json_t *doc;

	bb_hash_hex(room->sha256, hash);
	doc = json_pack("{s:s, s:s, s:s, s:b, s:[f,f,f], s:I, s:o, s:I, s:f, s:I, s:I, s:I, s:I, s:I, s:o}", "file", room->path,
	                "room", room->name, "sha256", hash, "ok", errors == 0, "size_m", room->max.x - room->min.x,
	                room->max.y - room->min.y, room->max.z - room->min.z, "nodes", (json_int_t)room->n_nodes, "walls",
	                json_walls(room), "screens", (json_int_t)room->n_screens, "megapixels", megapixels(room), "cameras",
	                (json_int_t)room->n_cameras, "monitors", (json_int_t)room->n_monitors, "outlets",
	                (json_int_t)outlets(room), "gamepads", (json_int_t)room->n_gamepads, "budgets",
	                (json_int_t)room->n_budgets, "findings", json_findings(f, shown));
	if (!doc || json_dumpf(doc, out, JSON_INDENT(2) | JSON_REAL_PRECISION(10)))
		fputs("{\"ok\": false}", out);
	fputc('\n', out);
	json_decref(doc);
}

int bb_room_check_print(const struct bb_room *room, FILE *out, bool json)
{
	struct bb_finding f[FINDINGS_MAX];
	const size_t n = bb_room_lint(room, f, FINDINGS_MAX), shown = n < FINDINGS_MAX ? n : FINDINGS_MAX;
	int errors = 0;

	for (size_t i = 0; i < shown; i++)
		errors += f[i].severity;
	if (json)
		print_json(room, f, shown, errors, out);
	else
		print_text(room, f, n, shown, out);
	return errors;
}
