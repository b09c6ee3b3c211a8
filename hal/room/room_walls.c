/*
 * hal/room/room_walls.c: walls, and the generators that turn a line into many: grids of tiles with bezels, a closed ring of
 * four tiled walls, tiles dealt to nodes in blocks of columns. Lengths in the file are metres and millimetres, in the
 * structs metres.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/room/room_build.h"

#define LEAST_EDGE_M 1e-3
#define FIT_M 5e-3 /* a frame given twice may differ by this */

#define W(member) offsetof(struct room_wall_draft, member)
#define TEXT_SIZE(member) sizeof(((struct room_wall_draft *)0)->member)

const struct bb_option room_wall_options[] = {
	{ "id", BB_OPT_TYPE_TEXT, W(id), TEXT_SIZE(id), 0, 1, 0, 1, "", false, "id of the wall" },
	{ "node", BB_OPT_TYPE_TEXT, W(node), TEXT_SIZE(node), 0, 1, 0, 1, "", false, "node that draws all of it" },
	{ "columns_per_node", BB_OPT_TYPE_I64, W(columns_per_node), 0, 0, 1, 256, 1, NULL, false,
	  "tile columns each node gets in turn; left out: even blocks" },
	{ "floor_m", BB_OPT_TYPE_F64, W(floor_m), 0, 0, -100, 100, 1, NULL, false, "height of a ring's lower edge" },
	BB_OPT_END
};

const struct bb_option room_grid_options[] = {
	{ "columns", BB_OPT_TYPE_I64, W(columns), 0, 1, 1, 256, 1, NULL, false, "tiles side by side" },
	{ "rows", BB_OPT_TYPE_I64, W(rows), 0, 1, 1, 256, 1, NULL, false, "tiles one above the other" },
	{ "bezel_edge_mm", BB_OPT_TYPE_F64, W(bezel_edge_m), 0, 0, 0, 500, 1e-3, NULL, false,
	  "frame of one tile per edge: two of them lie between two pictures" },
	BB_OPT_END
};

const struct bb_option room_display_options[] = {
	{ "kind", BB_OPT_TYPE_ENUM, W(display.kind), 0, BB_DISPLAY_LCD, 0, 0, 1, "lcd|dlp|strobed", false, "how it lights up" },
	{ "stereo", BB_OPT_TYPE_ENUM, W(display.stereo), 0, BB_STEREO_MONO, 0, 0, 1,
	  "mono|dual-projector-external-shutter|frame-sequential", false, "how the eyes are told apart" },
	{ "refresh_hz", BB_OPT_TYPE_F64, W(refresh_hz), 0, 60, 10, 1000, 1, NULL, false, "refreshes a second" },
	{ "vblank_us", BB_OPT_TYPE_F64, W(display.vblank_us), 0, 0, 0, 50000, 1, NULL, false,
	  "vertical blanking; 0: 4 % of the period" },
	{ "genlock", BB_OPT_TYPE_BOOL, W(display.genlock), 0, 0, 0, 1, 1, NULL, false, "locked to the room's reference" },
	{ "rate_error_ppm", BB_OPT_TYPE_F64, W(display.rate_error_ppm), 0, (double)NAN, -1000, 1000, 1, NULL, false,
	  "simulated clock error; left out: drawn from the seed within +-20" },
	{ "scan", BB_OPT_TYPE_ENUM, W(scan), 0, 0, 0, 0, 1, "auto|down|up|global", false,
	  "which row changes first; auto: all of a dlp at once, else from the top down" },
	{ "pixel_rise_us", BB_OPT_TYPE_F64, W(display.pixel_rise_us), 0, (double)NAN, 0, 50000, 1, NULL, false,
	  "10-90 % of dark to bright; left out: 20 of a dlp, else 2000" },
	{ "pixel_fall_us", BB_OPT_TYPE_F64, W(display.pixel_fall_us), 0, (double)NAN, 0, 50000, 1, NULL, false,
	  "10-90 % of bright to dark; left out: 20 of a dlp, else 1500" },
	{ "dark_us", BB_OPT_TYPE_F64, W(display.dark_us), 0, (double)NAN, 0, 50000, 1, NULL, false,
	  "no light at the end of a frame; left out: the vblank of a dlp, else 0" },
	{ "strobe_at_us", BB_OPT_TYPE_F64, W(display.strobe_at_us), 0, 0, 0, 50000, 1, NULL, false,
	  "strobed: the light goes on so long after the start of vblank" },
	{ "strobe_us", BB_OPT_TYPE_F64, W(display.strobe_us), 0, (double)NAN, 1, 50000, 1, NULL, false,
	  "strobed: for so long; left out: the vblank" },
	{ "device", BB_OPT_TYPE_TEXT, W(display.device), BB_DEVICE_BYTES, 0, 1, 0, 1, "", false, "back end" },
	BB_OPT_END
};

static const struct bb_option door_options[] = {
	{ "wall", BB_OPT_TYPE_TEXT, W(door_wall), TEXT_SIZE(door_wall), 0, 1, 0, 1, "", false, "wall of a ring it is in" },
	{ "column", BB_OPT_TYPE_I64, W(door_column), 0, 0, 0, 255, 1, NULL, true, "first column, from 0 at the left" },
	{ "row", BB_OPT_TYPE_I64, W(door_row), 0, 0, 0, 255, 1, NULL, false, "first row, from 0 at the bottom" },
	{ "columns", BB_OPT_TYPE_I64, W(door_columns), 0, 0, 1, 256, 1, NULL, true, "tiles it is wide" },
	{ "rows", BB_OPT_TYPE_I64, W(door_rows), 0, 0, 1, 256, 1, NULL, true, "tiles it is high" },
	BB_OPT_END
};

static struct room_build *build_of(struct bb_reader *r)
{
	return bb_container_of(r, struct room_build, r);
}

void room_wall_defaults(struct room_wall_draft *d)
{
	memset(d, 0, sizeof(*d));
	bb_options_defaults(room_wall_options, d);
	bb_options_defaults(room_grid_options, d);
	bb_options_defaults(room_display_options, d);
}

/* --- reading ------------------------------------------------------------------------------------------------------ */

static enum bb_status read_corner(struct bb_reader *r, const struct bb_yaml_node *v, struct room_wall_draft *d,
                                  struct bb_vec3 *corner, unsigned bit)
{
	d->given |= bit;
	return bb_yaml_vec3(r, v, BB_ROOM_SPAN_M, 1, corner);
}

static enum bb_status read_ll(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	return read_corner(r, v, d, &d->lower_left, ROOM_LL);
}

static enum bb_status read_lr(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	return read_corner(r, v, d, &d->lower_right, ROOM_LR);
}

static enum bb_status read_ul(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	return read_corner(r, v, d, &d->upper_left, ROOM_UL);
}

static enum bb_status read_right(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	return read_corner(r, v, d, &d->right, ROOM_RIGHT);
}

static enum bb_status read_up(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	return read_corner(r, v, d, &d->up, ROOM_UP);
}

static enum bb_status read_corners(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const struct bb_yaml_branch branches[] = {
		{ "lower_left", read_ll, true }, { "lower_right", read_lr, false }, { "upper_left", read_ul, false },
		{ "right", read_right, false },  { "up", read_up, false },          { NULL, NULL, false },
	};

	return bb_yaml_walk(r, v, NULL, branches, target, 0);
}

static enum bb_status read_pixels(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;

	return bb_yaml_pixels(r, v, &d->width_px, &d->height_px);
}

static enum bb_status read_display(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	const enum bb_status status = bb_yaml_walk(r, v, room_display_options, NULL, d, 0);

	return status || !bb_yaml_get(v, "device") ? status : room_check_device(build_of(r), v, d->display.device);
}

static enum bb_status read_picture(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	double mm[2];
	const enum bb_status status = bb_yaml_numbers(r, v, 2, 1, 100e3, 1e-3, mm);

	if (!status) {
		d->picture_width_m = mm[0];
		d->picture_height_m = mm[1];
	}
	return status;
}

static enum bb_status read_grid(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "picture_mm", read_picture, false }, { NULL, NULL, false } };

	return bb_yaml_walk(r, v, room_grid_options, branches, target, 0);
}

static enum bb_status read_door(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_walk(r, v, door_options, NULL, target, 0);
}

static enum bb_status add_nodes(struct bb_reader *r, const struct bb_yaml_node *at, struct room_wall_draft *d)
{
	struct room_build *b = build_of(r);
	char text[2 * BB_ID_MAX], id[BB_ID_MAX];
	struct room_ids ids = { .n = 0 };
	enum bb_status status = bb_yaml_text(r, at, text, sizeof(text));

	if (!status)
		status = room_ids_parse(r, at, text, &ids);
	for (unsigned i = 0; !status && i < ids.n; i++) {
		if (d->n_nodes == BB_ARRAY_LEN(d->nodes))
			return bb_yaml_fail(r, 1101, at, "more than %zu nodes", BB_ARRAY_LEN(d->nodes));
		room_ids_at(&ids, i, id);
		status = room_find_node(b, at, id, &d->nodes[d->n_nodes++]);
	}
	return status;
}

static enum bb_status read_wall_nodes(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	enum bb_status status = BB_OK;

	d->n_nodes = 0;
	if (v->kind == BB_YAML_SCALAR)
		return add_nodes(r, v, d);
	status = bb_yaml_want(r, v, BB_YAML_LIST);
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next)
		status = add_nodes(r, c, d);
	return status;
}

/* `ring: {front: 16, right: 10, back: 16, left: 10}`: columns of each, clockwise as seen from above. */
static enum bb_status read_ring(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_wall_draft *d = target;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_MAP);

	if (!status && v->n != 4)
		status = bb_yaml_fail(r, 1020, v, "a ring has 4 walls, not %zu", v->n);
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next, d->n_ring++) {
		status = room_check_id(r, c, c->key);
		if (!status)
			status = bb_yaml_integer(r, c, 1, 256, &d->ring[d->n_ring].columns);
		snprintf(d->ring[d->n_ring].id, BB_ID_MAX, "%.31s", c->key);
	}
	if (!status && (d->ring[0].columns != d->ring[2].columns || d->ring[1].columns != d->ring[3].columns))
		status = bb_yaml_fail(r, 1108, v, "opposite walls of a ring have as many columns");
	return status;
}

static const struct bb_yaml_branch wall_branches[] = {
	{ "pixels", read_pixels, false },   { "display", read_display, false },   { "corners_m", read_corners, false },
	{ "grid", read_grid, false },       { "nodes", read_wall_nodes, false },  { "ring", read_ring, false },
	{ "door", read_door, false },       { NULL, NULL, false },
};

enum bb_status room_read_wall_default(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "pixels", read_pixels, false },
		                                          { "display", read_display, false },
		                                          { "grid", read_grid, false },
		                                          { NULL, NULL, false } };
	struct room_build *b = target;

	return bb_yaml_walk(r, value, NULL, branches, &b->wall, BB_YAML_PARTIAL);
}

/* --- placing ------------------------------------------------------------------------------------------------------ */

static double tile_width(const struct room_wall_draft *d)
{
	return d->picture_width_m + 2 * d->bezel_edge_m;
}

static double tile_height(const struct room_wall_draft *d)
{
	return d->picture_height_m + 2 * d->bezel_edge_m;
}

/* The outer frame of a wall: as given, or from its lower left corner, a direction and the size of its tiles. */
static enum bb_status place(struct room_build *b, const struct room_wall_draft *d, struct bb_corners *out)
{
	const struct bb_vec3 x = { 1, 0, 0 }, y = { 0, 1, 0 };
	const unsigned frame = ROOM_LL | ROOM_LR | ROOM_UL;

	out->lower_left = d->lower_left;
	if ((d->given & frame) == frame && !(d->given & (ROOM_RIGHT | ROOM_UP))) {
		out->lower_right = d->lower_right;
		out->upper_left = d->upper_left;
		return BB_OK;
	}
	if ((d->given & frame) != ROOM_LL || !(d->given & ROOM_RIGHT) || !(d->picture_width_m > 0))
		return bb_yaml_fail(&b->r, 1104, d->at, "wall '%s'", d->id);
	if (!(bb_vec3_norm(d->right) > 0) || ((d->given & ROOM_UP) && !(bb_vec3_norm(d->up) > 0)))
		return bb_yaml_fail(&b->r, 1106, d->at, "wall '%s' has a direction of no length", d->id);
	out->lower_right = bb_vec3_add(d->lower_left, bb_vec3_scale(bb_vec3_unit(d->right, x),
	                                                            (double)d->columns * tile_width(d)));
	out->upper_left = bb_vec3_add(d->lower_left, bb_vec3_scale(bb_vec3_unit(d->given & ROOM_UP ? d->up : y, y),
	                                                           (double)d->rows * tile_height(d)));
	return BB_OK;
}

static enum bb_status check_area(struct room_build *b, const struct room_wall_draft *d, const struct bb_corners *c)
{
	const struct bb_vec3 right = bb_vec3_sub(c->lower_right, c->lower_left);
	const struct bb_vec3 up = bb_vec3_sub(c->upper_left, c->lower_left);
	const double area = bb_vec3_norm(bb_vec3_cross(right, up));

	/* a sine below 0.1: the corners lie on a line, or the wall leans so far that it is a mistake */
	if (!(bb_vec3_norm(right) > LEAST_EDGE_M) || !(bb_vec3_norm(up) > LEAST_EDGE_M) ||
	    !(area > 0.1 * bb_vec3_norm(right) * bb_vec3_norm(up)))
		return bb_yaml_fail(&b->r, 1106, d->at, "wall '%s'", d->id);
	return BB_OK;
}

/* Share of a cell that its picture fills, per axis; 1108 when tiles and frame contradict each other. */
static enum bb_status fit(struct room_build *b, const struct room_wall_draft *d, const struct bb_corners *c,
                          double *share_u, double *share_v)
{
	const double width = bb_vec3_norm(bb_vec3_sub(c->lower_right, c->lower_left));
	const double height = bb_vec3_norm(bb_vec3_sub(c->upper_left, c->lower_left));
	const double cell_w = width / (double)d->columns, cell_h = height / (double)d->rows;
	const bool given = d->picture_width_m > 0;
	const double w = given ? d->picture_width_m : cell_w - 2 * d->bezel_edge_m;
	const double h = given ? d->picture_height_m : cell_h - 2 * d->bezel_edge_m;

	if (given && (fabs((double)d->columns * tile_width(d) - width) > FIT_M ||
	              fabs((double)d->rows * tile_height(d) - height) > FIT_M))
		return bb_yaml_fail(&b->r, 1108, d->at, "wall '%s' is %.3f x %.3f m, its tiles add up to %.3f x %.3f m",
		                    d->id, width, height, (double)d->columns * tile_width(d),
		                    (double)d->rows * tile_height(d));
	if (!(w > LEAST_EDGE_M) || !(h > LEAST_EDGE_M))
		return bb_yaml_fail(&b->r, 1108, d->at, "wall '%s': bezels leave no picture in a tile of %.1f x %.1f mm",
		                    d->id, cell_w * 1e3, cell_h * 1e3);
	*share_u = w / cell_w;
	*share_v = h / cell_h;
	return BB_OK;
}

/* Which of n nodes draws a column, of `total` in a row: blocks of columns_per_node, or as even as they can be. */
static size_t deal(const struct room_wall_draft *d, int64_t total, int64_t column)
{
	const int64_t n = (int64_t)d->n_nodes, base = total / n, extra = total % n;

	if (d->columns_per_node)
		return (size_t)(column / d->columns_per_node);
	if (column < extra * (base + 1))
		return (size_t)(column / (base + 1));
	return (size_t)(extra + (column - extra * (base + 1)) / base);
}

static enum bb_status check_deal(struct room_build *b, const struct room_wall_draft *d, int64_t total)
{
	const int64_t n = (int64_t)d->n_nodes, each = d->columns_per_node;

	if (n < 1 || n > total)
		return bb_yaml_fail(&b->r, 1107, d->at, "%lld columns, %lld nodes", (long long)total, (long long)n);
	if (each && (total + each - 1) / each != n)
		return bb_yaml_fail(&b->r, 1107, d->at, "%lld columns in blocks of %lld need %lld nodes, not %lld",
		                    (long long)total, (long long)each, (long long)((total + each - 1) / each), (long long)n);
	return BB_OK;
}

/* --- building ----------------------------------------------------------------------------------------------------- */

static struct bb_corners tile_corners(const struct bb_corners *wall, const struct room_wall_draft *d, int64_t column,
                                      int64_t row, double share_u, double share_v)
{
	const double n_u = (double)d->columns, n_v = (double)d->rows;
	const double u0 = ((double)column + 0.5 * (1 - share_u)) / n_u, u1 = ((double)column + 0.5 * (1 + share_u)) / n_u;
	const double v0 = ((double)row + 0.5 * (1 - share_v)) / n_v, v1 = ((double)row + 0.5 * (1 + share_v)) / n_v;

	return (struct bb_corners){ bb_corners_at(wall, u0, v0), bb_corners_at(wall, u1, v0), bb_corners_at(wall, u0, v1) };
}

static double or_else(double given, double fallback)
{
	return isnan(given) ? fallback : given;
}

/* What the kind says where the file says nothing. Pixel responses: micromirrors settle in some 10 us; of liquid crystal
 * no maker's figure is to be trusted, so these are plain parameters, to be replaced by a measurement. */
static enum bb_status fill_optics(const struct room_build *b, const struct room_wall_draft *d,
                                  struct bb_display_config *c)
{
	const bool dlp = c->kind == BB_DISPLAY_DLP;
	const double period_us = 1e6 / d->refresh_hz, vblank_us = bb_display_vblank_us(c);

	c->scan = d->scan ? (enum bb_scan)(d->scan - 1) : dlp ? BB_SCAN_GLOBAL : BB_SCAN_DOWN;
	c->pixel_rise_us = or_else(c->pixel_rise_us, dlp ? 20 : 2000);
	c->pixel_fall_us = or_else(c->pixel_fall_us, dlp ? 20 : 1500);
	c->dark_us = or_else(c->dark_us, dlp ? vblank_us : 0);
	c->strobe_us = or_else(c->strobe_us, vblank_us);
	if (vblank_us < period_us && c->dark_us < period_us && c->strobe_at_us < period_us && c->strobe_us <= period_us)
		return BB_OK;
	return bb_yaml_fail(&b->r, 1121, d->at, "vblank %g, dark %g, strobe %g at %g us in a period of %g us", vblank_us,
	                    c->dark_us, c->strobe_us, c->strobe_at_us, period_us);
}

static enum bb_status fill_display(const struct room_build *b, const struct room_wall_draft *d, struct bb_screen *s)
{
	s->display = d->display;
	memcpy(s->display.id, s->id, sizeof(s->display.id));
	memcpy(s->display.node, b->room->nodes[s->node].id, sizeof(s->display.node));
	s->display.rate = room_rate(d->refresh_hz);
	s->display.width_px = d->width_px;
	s->display.height_px = d->height_px;
	if (!*s->display.device)
		snprintf(s->display.device, sizeof(s->display.device), "%s", b->device);
	return fill_optics(b, d, &s->display);
}

/* All screens of one wall; first_column and total_columns say where it stands in the row the nodes are dealt over. */
static enum bb_status add_screens(struct room_build *b, const struct room_wall_draft *d, int64_t first_column,
                                  int64_t total_columns)
{
	struct bb_room *room = b->room;
	const struct bb_wall *wall = &room->walls[room->n_walls - 1];
	const bool tiled = d->columns * d->rows > 1;
	double share_u = 1, share_v = 1;
	enum bb_status status = fit(b, d, &wall->corners, &share_u, &share_v);

	if (!status)
		status = room_grow(b, d->at, &room->screens, sizeof(*room->screens), room->n_screens,
		                   (size_t)(d->columns * d->rows), BB_ROOM_SCREENS_MAX, "screens");
	if (!status && tiled && strlen(wall->id) > BB_ID_MAX - 9)
		status = bb_yaml_fail(&b->r, 1103, d->at, "'%s' is too long for a tiled wall", wall->id);
	for (int64_t i = 0; !status && i < d->columns * d->rows; i++) {
		const int64_t column = i / d->rows, row = i % d->rows;
		struct bb_screen *s = &room->screens[room->n_screens++];

		s->wall = (uint16_t)(room->n_walls - 1);
		s->node = d->nodes[deal(d, total_columns, first_column + column)];
		s->corners = tile_corners(&wall->corners, d, column, row, share_u, share_v);
		if (tiled)
			snprintf(s->id, sizeof(s->id), "%.23s-%d-%d", wall->id, (int)(column & 255), (int)(row & 255));
		else
			memcpy(s->id, wall->id, sizeof(s->id));
		status = fill_display(b, d, s);
	}
	return status;
}

static enum bb_status add_wall(struct room_build *b, const struct room_wall_draft *d, const struct bb_corners *corners)
{
	struct bb_room *room = b->room;
	enum bb_status status = room_check_id(&b->r, d->at, d->id);

	if (!status && bb_room_wall(room, d->id) >= 0)
		status = bb_yaml_fail(&b->r, 1105, d->at, "wall '%s'", d->id);
	if (!status)
		status = check_area(b, d, corners);
	if (!status)
		status = room_grow(b, d->at, &room->walls, sizeof(*room->walls), room->n_walls, 1, BB_ROOM_WALLS_MAX, "walls");
	if (status)
		return status;
	struct bb_wall *w = &room->walls[room->n_walls++];
	memcpy(w->id, d->id, sizeof(w->id));
	w->corners = *corners;
	w->width_px = d->columns * d->width_px;
	w->height_px = d->rows * d->height_px;
	w->columns = d->columns;
	w->rows = d->rows;
	w->bezel_edge_m = d->bezel_edge_m;
	w->line = d->at->line;
	if (d->n_nodes == 1)
		memcpy(w->node, room->nodes[d->nodes[0]].id, sizeof(w->node));
	return BB_OK;
}

static enum bb_status set_door(struct room_build *b, const struct room_wall_draft *d)
{
	const char *id = *d->door_wall ? d->door_wall : d->id;
	uint16_t index;
	enum bb_status status;

	if (!d->door_columns)
		return BB_OK;
	status = room_find_wall(b, d->at, id, &index);
	if (status)
		return status;
	struct bb_wall *w = &b->room->walls[index];
	if (d->door_column + d->door_columns > w->columns || d->door_row + d->door_rows > w->rows)
		return bb_yaml_fail(&b->r, 1108, d->at, "the door reaches past wall '%s'", w->id);
	w->door_column = d->door_column;
	w->door_row = d->door_row;
	w->door_columns = d->door_columns;
	w->door_rows = d->door_rows;
	return BB_OK;
}

/* Four walls around the origin, the first one in front (-z), clockwise as seen from above. */
static enum bb_status build_ring(struct room_build *b, struct room_wall_draft *d)
{
	const int64_t total = 2 * (d->ring[0].columns + d->ring[1].columns);
	const double w = (double)d->ring[0].columns * tile_width(d) / 2, z = (double)d->ring[1].columns * tile_width(d) / 2;
	const double y = d->floor_m, top = y + (double)d->rows * tile_height(d);
	const struct bb_vec3 low[5] = { { -w, y, -z }, { w, y, -z }, { w, y, z }, { -w, y, z }, { -w, y, -z } };
	enum bb_status status = check_deal(b, d, total);
	int64_t column = 0;

	if (!status && !(d->picture_width_m > 0))
		status = bb_yaml_fail(&b->r, 1104, d->at, "a ring needs grid.picture_mm");
	if (!status && (d->given || *d->id))
		status = bb_yaml_fail(&b->r, 1104, d->at, "a ring has neither id nor corners_m of its own");
	for (size_t i = 0; i < 4 && !status; i++) {
		const struct bb_corners c = { low[i], low[i + 1], { low[i].x, top, low[i].z } };

		memcpy(d->id, d->ring[i].id, sizeof(d->id));
		d->columns = d->ring[i].columns;
		status = add_wall(b, d, &c);
		if (!status)
			status = add_screens(b, d, column, total);
		column += d->columns;
	}
	return status;
}

static enum bb_status build_single(struct room_build *b, struct room_wall_draft *d)
{
	struct bb_corners corners;
	enum bb_status status = check_deal(b, d, d->columns);

	if (!status && !*d->id)
		status = bb_yaml_fail(&b->r, 1017, d->at, "'id' of a wall");
	if (!status)
		status = place(b, d, &corners);
	if (!status)
		status = add_wall(b, d, &corners);
	return status ? status : add_screens(b, d, 0, d->columns);
}

/* One node draws it: by name, or the only one there is. */
static enum bb_status default_node(struct room_build *b, struct room_wall_draft *d)
{
	if (*d->node && d->n_nodes)
		return bb_yaml_fail(&b->r, 1107, d->at, "both node and nodes are given");
	if (d->n_nodes)
		return BB_OK;
	if (!*d->node && b->room->n_nodes != 1)
		return bb_yaml_fail(&b->r, 1017, d->at, "'node' of a wall");
	d->n_nodes = 1;
	d->nodes[0] = 0;
	return *d->node ? room_find_node(b, bb_yaml_get(d->at, "node"), d->node, &d->nodes[0]) : BB_OK;
}

static enum bb_status read_wall(struct room_build *b, const struct bb_yaml_node *entry)
{
	struct room_wall_draft *d = malloc(sizeof(*d));
	enum bb_status status;

	if (!d)
		return bb_fail(b->r.err, BB_ERR_NOMEM, 1702, NULL, "a wall");
	*d = b->wall;
	d->at = entry;
	status = bb_yaml_walk(&b->r, entry, room_wall_options, wall_branches, d, 0);
	if (!status && !d->width_px)
		status = bb_yaml_fail(&b->r, 1017, entry, "'pixels' of a wall");
	if (!status)
		status = default_node(b, d);
	if (!status)
		status = d->n_ring ? build_ring(b, d) : build_single(b, d);
	if (!status)
		status = set_door(b, d);
	free(d);
	return status;
}

/* A tile's id may be another wall's: "a-0-0". */
static enum bb_status check_screen_ids(struct room_build *b, const struct bb_yaml_node *at)
{
	const struct bb_room *room = b->room;

	for (size_t i = 0; i < room->n_screens; i++) {
		const int wall = bb_room_wall(room, room->screens[i].id);
		if (wall >= 0 && wall != room->screens[i].wall)
			return bb_yaml_fail(&b->r, 1105, at, "screen '%s'", room->screens[i].id);
	}
	return BB_OK;
}

enum bb_status room_read_walls(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct room_build *b = build_of(r);
	enum bb_status status = bb_yaml_want(r, value, BB_YAML_LIST);

	(void)target;
	for (const struct bb_yaml_node *c = value->first; c && !status; c = c->next)
		status = read_wall(b, c);
	return status ? status : check_screen_ids(b, value);
}

/* --- stereo ------------------------------------------------------------------------------------------------------- */

static bool in_chain(const struct bb_room *room, const char *wall)
{
	for (int64_t i = 0; i < room->chain.n_stages; i++)
		if (!strcmp(room->chain.stage[i], wall))
			return true;
	return false;
}

static enum bb_status check_screen_stereo(struct room_build *b, const struct bb_yaml_node *at, const struct bb_screen *s)
{
	const struct bb_room *room = b->room;
	const double refresh = bb_rate_hz(s->display.rate), edges = bb_rate_hz(room->chain.rate);
	const double per_refresh = s->display.stereo == BB_STEREO_FRAME_SEQUENTIAL ? 1 : 2;

	if (s->display.stereo == BB_STEREO_FRAME_SEQUENTIAL && !s->display.genlock)
		return bb_yaml_fail(&b->r, 1113, at, "screen '%s'", s->id);
	if (!room->has_chain)
		return bb_yaml_fail(&b->r, 1114, at, "screen '%s' is stereo, the room has no shutters", s->id);
	if (!in_chain(room, room->walls[s->wall].id))
		return bb_yaml_fail(&b->r, 1114, at, "wall '%s' is stereo and no stage of the chain", room->walls[s->wall].id);
	if (fabs(refresh * per_refresh - edges) > 1e-6 * edges)
		return bb_yaml_fail(&b->r, 1114, at, "screen '%s' at %g Hz, the chain gives %g edges a second", s->id, refresh,
		                    edges);
	return BB_OK;
}

enum bb_status room_check_stereo(struct room_build *b, const struct bb_yaml_node *root)
{
	const struct bb_yaml_node *at = bb_yaml_get(root, "shutters");
	enum bb_status status = BB_OK;

	at = at ? at : bb_yaml_get(root, "walls");
	for (size_t i = 0; i < b->room->n_screens && !status; i++)
		if (b->room->screens[i].display.stereo != BB_STEREO_MONO)
			status = check_screen_stereo(b, at, &b->room->screens[i]);
	return status;
}
