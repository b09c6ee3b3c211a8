/*
 * bench/report/room_drawing.c: layout and content of a room's drawing. See bench/report/room_drawing.h; strokes are in drawing_pen.c.
 * Plan: x to the right, z down, the front wall at the top. Side: seen from the left, z to the right, y up.
 */
#define _GNU_SOURCE /* RTLD_DEFAULT */
#include "bench/report/room_drawing.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/report/drawing_page.h"
#include "bench/report/drawing_pen.h"

#define PAGE_WIDTH 1240.0
#define EDGE 36.0           /* of the page */
#define ROOM_AROUND 74.0    /* labels and dimensions about a view */
#define VIEW_MOST 520.0     /* height of a view */
#define TOP 78.0
#define LEGEND 46.0
#define RAD_PER_DEG (3.14159265358979323846 / 180.0)

enum view_kind { PLAN, SIDE };

struct view {
	enum view_kind kind;
	double scale, x0, y0;       /* points per metre; page position of least h and v */
	double least_h, most_h, least_v, most_v; /* metres */
};

struct drawing {
	cairo_t *cr;
	const struct bb_room *room;
	const struct bb_path_point *path;
	size_t n_path;
	struct bb_vec3 min, max;    /* of everything drawn */
	struct view plan, side;
	double unrolled_y, unrolled_scale, height;
};

/* --- geometry of the page ----------------------------------------------------------------------------------------- */

static double h_of(const struct view *v, struct bb_vec3 p)
{
	return v->kind == PLAN ? p.x : p.z;
}

static double v_of(const struct view *v, struct bb_vec3 p) /* grows down the page */
{
	return v->kind == PLAN ? p.z : -p.y;
}

static struct pen_point at(const struct view *v, struct bb_vec3 p)
{
	return (struct pen_point){ v->x0 + v->scale * (h_of(v, p) - v->least_h), v->y0 + v->scale * (v_of(v, p) - v->least_v) };
}

static void include(struct drawing *d, struct bb_vec3 p)
{
	if (!isfinite(p.x + p.y + p.z))
		return;
	d->min = (struct bb_vec3){ fmin(d->min.x, p.x), fmin(d->min.y, p.y), fmin(d->min.z, p.z) };
	d->max = (struct bb_vec3){ fmax(d->max.x, p.x), fmax(d->max.y, p.y), fmax(d->max.z, p.z) };
}

static struct view make_view(enum view_kind kind, const struct drawing *d)
{
	struct view v = { .kind = kind, .scale = 1 };

	v.least_h = h_of(&v, d->min);
	v.most_h = h_of(&v, d->max);
	v.least_v = v_of(&v, kind == PLAN ? d->min : d->max);
	v.most_v = v_of(&v, kind == PLAN ? d->max : d->min);
	return v;
}

static double width_m(const struct bb_corners *c)
{
	return bb_vec3_norm(bb_vec3_sub(c->lower_right, c->lower_left));
}

static double height_m(const struct bb_corners *c)
{
	return bb_vec3_norm(bb_vec3_sub(c->upper_left, c->lower_left));
}

static void lay_out(struct drawing *d)
{
	const double across = d->max.x - d->min.x + d->max.z - d->min.z;
	const double tall = fmax(d->max.z - d->min.z, d->max.y - d->min.y);
	const double scale = fmin((PAGE_WIDTH - 2 * EDGE - 4 * ROOM_AROUND) / across, VIEW_MOST / tall);
	double walls_m = 0, highest_m = 0, gaps = 0;

	d->plan = make_view(PLAN, d);
	d->side = make_view(SIDE, d);
	d->plan.scale = d->side.scale = scale;
	const double plan_w = (d->plan.most_h - d->plan.least_h) * scale, side_w = (d->side.most_h - d->side.least_h) * scale;
	const double spare = (PAGE_WIDTH - 2 * EDGE - 4 * ROOM_AROUND - plan_w - side_w) / 3;
	d->plan.x0 = EDGE + ROOM_AROUND + spare;
	d->plan.y0 = TOP + ROOM_AROUND;
	d->side.x0 = d->plan.x0 + plan_w + spare + 2 * ROOM_AROUND;
	/* the floor of the side view stands where the plan ends */
	d->side.y0 = d->plan.y0 + scale * fmax(0, (d->plan.most_v - d->plan.least_v) - (d->side.most_v - d->side.least_v));
	d->unrolled_y = TOP + 2 * ROOM_AROUND + scale * tall;
	for (size_t i = 0; i < d->room->n_walls; i++) {
		walls_m += width_m(&d->room->walls[i].corners);
		highest_m = fmax(highest_m, height_m(&d->room->walls[i].corners));
		gaps += i ? 18 : 0;
	}
	d->unrolled_scale = fmin(fmax(1, PAGE_WIDTH - 2 * EDGE - gaps) / walls_m, 150 / highest_m);
	d->height = d->unrolled_y + 62 + highest_m * d->unrolled_scale + LEGEND + EDGE;
}

/* --- what is in a view -------------------------------------------------------------------------------------------- */

static bool edge_on(const struct view *v, const struct bb_corners *c)
{
	const struct bb_vec3 n = bb_corners_normal(c);

	return fabs(v->kind == PLAN ? n.y : n.x) < 0.7;
}

static void polygon(cairo_t *cr, const struct view *v, const struct bb_corners *c)
{
	static const double u[4] = { 0, 1, 1, 0 }, w[4] = { 0, 0, 1, 1 };

	for (int i = 0; i < 4; i++) {
		const struct pen_point p = at(v, bb_corners_at(c, u[i], w[i]));
		if (i)
			cairo_line_to(cr, p.x, p.y);
		else
			cairo_move_to(cr, p.x, p.y);
	}
	cairo_close_path(cr);
}

/* Screens that lie in the view's plane: faint pictures of their tiles. */
static void draw_flat(struct drawing *d, const struct view *v)
{
	for (size_t i = 0; i < d->room->n_screens; i++) {
		const struct bb_screen *s = &d->room->screens[i];
		/* from the left one looks through the left wall at the right one: draw what faces the viewer */
		if (edge_on(v, &s->corners) || (v->kind == SIDE && bb_corners_normal(&s->corners).x > 0))
			continue;
		polygon(d->cr, v, &s->corners);
		pen_set(d->cr, pen_alpha(pen_node_colour(s->node), 0.22));
		cairo_fill_preserve(d->cr);
		pen_set(d->cr, pen_alpha(pen_grey, 0.35));
		cairo_set_line_width(d->cr, 0.5);
		cairo_stroke(d->cr);
	}
}

/* A band behind the picture's plane, one piece per tile, in the colour of its node. */
static void draw_band(struct drawing *d, const struct view *v, const struct bb_screen *s)
{
	const struct bb_vec3 back = bb_vec3_scale(bb_corners_normal(&s->corners), -9 / v->scale);
	const struct bb_vec3 a = s->corners.lower_left, b = v->kind == PLAN ? s->corners.lower_right : s->corners.upper_left;
	const struct pen_point p[4] = { at(v, a), at(v, b), at(v, bb_vec3_add(b, back)), at(v, bb_vec3_add(a, back)) };

	cairo_move_to(d->cr, p[0].x, p[0].y);
	for (int i = 1; i < 4; i++)
		cairo_line_to(d->cr, p[i].x, p[i].y);
	cairo_close_path(d->cr);
	pen_set(d->cr, pen_node_colour(s->node));
	cairo_fill(d->cr);
	pen_line(d->cr, p[0], p[1], 1.8, pen_ink);
}

/* Tiles that lie behind each other are drawn once: the lowest row in the plan, the first column in the side view. */
static void draw_edge_on(struct drawing *d, const struct view *v)
{
	size_t first = 0;

	for (size_t i = 0; i < d->room->n_screens; i++) {
		const struct bb_screen *s = &d->room->screens[i];
		const size_t rows = (size_t)d->room->walls[s->wall].rows;

		if (s->wall != d->room->screens[first].wall)
			first = i;
		if (edge_on(v, &s->corners) && (v->kind == PLAN ? (i - first) % rows : (i - first) / rows) == 0)
			draw_band(d, v, s);
	}
}

/* Where a door is, the picture plane is drawn in its colour. */
static void draw_door(struct drawing *d)
{
	for (size_t i = 0; i < d->room->n_walls; i++) {
		const struct bb_wall *w = &d->room->walls[i];
		const double u0 = (double)w->door_column / (double)w->columns;
		const double u1 = (double)(w->door_column + w->door_columns) / (double)w->columns;

		if (w->door_columns && edge_on(&d->plan, &w->corners))
			pen_line(d->cr, at(&d->plan, bb_corners_at(&w->corners, u0, 0)),
			         at(&d->plan, bb_corners_at(&w->corners, u1, 0)), 4, pen_door);
	}
}

/* Names stand outside, beyond the middle of the wall's edge. */
static void label_walls(struct drawing *d, const struct view *v)
{
	for (size_t i = 0; i < d->room->n_walls; i++) {
		const struct bb_wall *w = &d->room->walls[i];
		const struct bb_vec3 n = bb_corners_normal(&w->corners);
		const struct pen_point m = at(v, bb_corners_at(&w->corners, 0.5, 0.5));
		const double nh = h_of(v, n), nv = v_of(v, n), length = hypot(nh, nv);

		if (!edge_on(v, &w->corners)) { /* off the middle: there stands the viewer */
			const struct pen_point low = at(v, bb_corners_at(&w->corners, 0.5, 0.2));
			if (v->kind == PLAN || n.x < 0)
				pen_text(d->cr, low, PEN_CENTRE, 12, true, pen_alpha(pen_grey, 0.8), "%s", w->id);
			continue;
		}
		const struct pen_point p = { m.x - 22 * nh / length, m.y - 22 * nv / length };
		const bool upright = fabs(nh) > fabs(nv);
		cairo_save(d->cr);
		cairo_translate(d->cr, p.x, p.y);
		if (upright)
			cairo_rotate(d->cr, -90 * RAD_PER_DEG);
		pen_text(d->cr, (struct pen_point){ 0, 0 }, PEN_CENTRE, 12, true, pen_ink, "%s%s", w->id,
		         w->door_columns ? ", with a door" : "");
		cairo_restore(d->cr);
	}
}

/* --- cameras, viewer, path ---------------------------------------------------------------------------------------- */

static double cone_length_m(const struct drawing *d)
{
	const struct bb_vec3 e = bb_vec3_sub(d->max, d->min);
	const double least = fmin(e.x, e.z);

	return d->room->n_cameras > 12 ? 0.24 * least : 0.45 * least;
}

static void draw_cone(struct drawing *d, const struct view *v, const struct bb_camera_config *c)
{
	const bool tall = v->kind == SIDE;
	const double image = (double)(tall ? c->height_px : c->width_px) / 2 / (tall ? c->fy_px : c->fx_px);
	const double half = c->lens == BB_LENS_FISHEYE ? tan(fmin(image, 1.5)) : image;
	const double length = cone_length_m(d) * v->scale;
	const struct pen_point tip = at(v, c->pose.p);
	struct pen_point end[2];

	for (int i = 0; i < 2; i++) { /* the middle of the picture's two edges, drawn at one length */
		const double k = i ? half : -half;
		const struct bb_vec3 ray = bb_quat_rotate(c->pose.q, (struct bb_vec3){ tall ? 0 : k, tall ? k : 0, 1 });
		const double h = h_of(v, ray), w = v_of(v, ray), n = fmax(hypot(h, w), 1e-9);
		end[i] = (struct pen_point){ tip.x + length * h / n, tip.y + length * w / n };
	}
	cairo_move_to(d->cr, tip.x, tip.y);
	cairo_line_to(d->cr, end[0].x, end[0].y);
	cairo_line_to(d->cr, end[1].x, end[1].y);
	cairo_close_path(d->cr);
	const double thin = fmin(1, 14.0 / (double)d->room->n_cameras); /* many cones lie upon each other */
	pen_set(d->cr, pen_alpha(pen_camera, 0.07 * thin));
	cairo_fill_preserve(d->cr);
	pen_set(d->cr, pen_alpha(pen_camera, 0.4 * thin));
	cairo_set_line_width(d->cr, 0.6);
	cairo_stroke(d->cr);
}

static void draw_camera(struct drawing *d, const struct view *v, const struct bb_camera_config *c)
{
	const struct bb_vec3 axis = bb_quat_rotate(c->pose.q, (struct bb_vec3){ 0, 0, 1 });
	const struct pen_point p = at(v, c->pose.p);
	const double angle = atan2(v_of(v, axis), h_of(v, axis));

	cairo_save(d->cr);
	cairo_translate(d->cr, p.x, p.y);
	cairo_rotate(d->cr, angle);
	cairo_rectangle(d->cr, -7, -4, 9, 8); /* body and lens */
	cairo_move_to(d->cr, 2, 0);
	cairo_line_to(d->cr, 6, -3.5);
	cairo_line_to(d->cr, 6, 3.5);
	cairo_close_path(d->cr);
	pen_set(d->cr, pen_camera);
	cairo_fill(d->cr);
	cairo_restore(d->cr);
}

/* In the plan ids stand inside the room beside their cameras: outside are the walls' names. */
static void label_camera(struct drawing *d, const struct bb_camera_config *c)
{
	const struct pen_point p = at(&d->plan, c->pose.p);
	const struct pen_point m = { d->plan.x0 + d->plan.scale * ((d->plan.most_h - d->plan.least_h) / 2),
		                     d->plan.y0 + d->plan.scale * ((d->plan.most_v - d->plan.least_v) / 2) };
	const double dx = m.x - p.x, dy = m.y - p.y, n = fmax(hypot(dx, dy), 1e-9);

	pen_text(d->cr, (struct pen_point){ p.x + 22 * dx / n, p.y + 17 * dy / n }, PEN_CENTRE, 10, false, pen_camera, "%s",
	         c->id);
}

static void draw_cameras(struct drawing *d, const struct view *v)
{
	for (size_t i = 0; i < d->room->n_cameras; i++)
		draw_cone(d, v, &d->room->cameras[i]);
	for (size_t i = 0; i < d->room->n_cameras; i++) {
		draw_camera(d, v, &d->room->cameras[i]);
		if (v->kind == PLAN)
			label_camera(d, &d->room->cameras[i]);
	}
}

/* A head with its nose towards the front. */
static void head_symbol(cairo_t *cr, struct pen_point p, double r, bool up)
{
	cairo_save(cr);
	cairo_translate(cr, p.x, p.y);
	cairo_rotate(cr, up ? -90 * RAD_PER_DEG : 180 * RAD_PER_DEG);
	cairo_new_path(cr);
	cairo_arc(cr, 0, 0, r, 14 * RAD_PER_DEG, 346 * RAD_PER_DEG);
	cairo_line_to(cr, 1.35 * r, 0);
	cairo_close_path(cr);
	pen_set(cr, (struct pen_colour){ 0.86, 0.87, 0.89, 1 });
	cairo_fill_preserve(cr);
	pen_set(cr, pen_ink);
	cairo_set_line_width(cr, 1);
	cairo_stroke(cr);
	cairo_restore(cr);
}

static void draw_viewer(struct drawing *d, const struct view *v)
{
	const struct pen_point p = at(v, d->room->neutral);
	const double r = fmin(fmax(0.09 * v->scale, 5), 16);

	head_symbol(d->cr, p, r, v->kind == PLAN);
	if (v->kind == SIDE)
		pen_text(d->cr, (struct pen_point){ p.x + r + 6, p.y }, PEN_LEFT, 10, false, pen_ink, "eyes %.2f m", d->room->neutral.y);
}

static void draw_path(struct drawing *d, const struct view *v, bool tracked)
{
	bool open = false;

	for (size_t i = 0; i < d->n_path; i++) {
		const struct bb_vec3 p = tracked ? d->path[i].tracked : d->path[i].truth;
		if (!isfinite(p.x + p.y + p.z)) { /* a hole in what is known stays a hole */
			open = false;
			continue;
		}
		const struct pen_point q = at(v, p);
		if (open)
			cairo_line_to(d->cr, q.x, q.y);
		else
			cairo_move_to(d->cr, q.x, q.y);
		open = true;
	}
	pen_set(d->cr, pen_alpha(tracked ? pen_tracked : pen_truth, 0.8));
	cairo_set_line_width(d->cr, tracked ? 0.7 : 1.4);
	cairo_stroke(d->cr);
}

/* --- dimensions, unrolled walls, frame ---------------------------------------------------------------------------- */

static void draw_dimensions(struct drawing *d)
{
	const struct bb_vec3 lo = d->room->min, hi = d->room->max;
	const struct pen_point pl = at(&d->plan, lo), ph = at(&d->plan, hi), sl = at(&d->side, lo), sh = at(&d->side, hi);
	const double below = d->plan.y0 + d->plan.scale * (d->plan.most_v - d->plan.least_v) + 48;
	const double plan_left = fmin(pl.x, d->plan.x0) - 48, side_left = fmin(sl.x, d->side.x0) - 48;

	if (hi.x - lo.x > 1e-3)
		pen_dimension(d->cr, (struct pen_point){ pl.x, below }, (struct pen_point){ ph.x, below }, "%.3f m", hi.x - lo.x);
	if (hi.z - lo.z > 1e-3) {
		pen_dimension(d->cr, (struct pen_point){ plan_left, ph.y }, (struct pen_point){ plan_left, pl.y }, "%.3f m",
		              hi.z - lo.z);
		pen_dimension(d->cr, (struct pen_point){ sl.x, below }, (struct pen_point){ sh.x, below }, "%.3f m", hi.z - lo.z);
	}
	if (hi.y - lo.y > 1e-3)
		pen_dimension(d->cr, (struct pen_point){ side_left, sl.y }, (struct pen_point){ side_left, sh.y }, "%.3f m",
		              hi.y - lo.y);
}

static const char *many(size_t n)
{
	return n == 1 ? "" : "s";
}

static void draw_view(struct drawing *d, const struct view *v, const char *title)
{
	const double centre = v->x0 + v->scale * (v->most_h - v->least_h) / 2;

	pen_text(d->cr, (struct pen_point){ centre, TOP + 12 }, PEN_CENTRE, 12, true, pen_grey, "%s", title);
	draw_flat(d, v);
	draw_cameras(d, v);
	draw_path(d, v, false);
	draw_path(d, v, true);
	draw_viewer(d, v);
	draw_edge_on(d, v);
	label_walls(d, v);
}

static void label_node(struct drawing *d, size_t node, double x, double y, double room_for_it)
{
	const char *id = d->room->nodes[node].id;

	cairo_save(d->cr);
	cairo_translate(d->cr, x, y);
	if (pen_text_width(d->cr, 11.5, id) > room_for_it)
		cairo_rotate(d->cr, -90 * RAD_PER_DEG);
	pen_text(d->cr, (struct pen_point){ 0, 0 }, PEN_CENTRE, 10.5, true, pen_ink, "%s", id);
	cairo_restore(d->cr);
}

/* Tiles of one wall as seen from inside; the node's id in the middle of the tiles it draws. */
static void unroll_wall(struct drawing *d, size_t wall, double x, double y)
{
	const struct bb_wall *w = &d->room->walls[wall];
	const double s = d->unrolled_scale, width = width_m(&w->corners) * s, height = height_m(&w->corners) * s;
	double sum_x[BB_LINK_NODES_MAX] = { 0 }, sum_y[BB_LINK_NODES_MAX] = { 0 };
	size_t n[BB_LINK_NODES_MAX] = { 0 };

	pen_rect(d->cr, x, y, width, height, (struct pen_colour){ 0.25, 0.27, 0.30, 1 }, pen_ink);
	for (size_t i = 0; i < d->room->n_screens; i++) {
		const struct bb_screen *t = &d->room->screens[i];
		if (t->wall != wall)
			continue;
		const struct bb_vec3 at_m = bb_vec3_sub(t->corners.lower_left, w->corners.lower_left);
		const struct bb_vec3 right = bb_vec3_unit(bb_vec3_sub(w->corners.lower_right, w->corners.lower_left), at_m);
		const struct bb_vec3 up = bb_vec3_unit(bb_vec3_sub(w->corners.upper_left, w->corners.lower_left), at_m);
		const double tw = width_m(&t->corners) * s, th = height_m(&t->corners) * s;
		const double tx = x + bb_vec3_dot(at_m, right) * s, ty = y + height - bb_vec3_dot(at_m, up) * s - th;
		pen_rect(d->cr, tx, ty, tw, th, pen_node_colour(t->node), pen_alpha(pen_ink, 0));
		if (t->node < BB_LINK_NODES_MAX) {
			sum_x[t->node] += tx + tw / 2;
			sum_y[t->node] += ty + th / 2;
			n[t->node]++;
		}
	}
	if (w->door_columns) {
		const double cw = width / (double)w->columns, ch = height / (double)w->rows;
		cairo_rectangle(d->cr, x + cw * (double)w->door_column, y + height - ch * (double)(w->door_row + w->door_rows),
		                cw * (double)w->door_columns, ch * (double)w->door_rows);
		pen_set(d->cr, pen_door);
		cairo_set_line_width(d->cr, 2);
		cairo_stroke(d->cr);
		pen_text(d->cr, (struct pen_point){ x + cw * ((double)w->door_column + 0.5 * (double)w->door_columns),
		                                    y + height - ch * ((double)w->door_row + 0.5) },
		         PEN_CENTRE, 10.5, true, pen_door, "door");
	}
	for (size_t i = 0; i < d->room->n_nodes && i < BB_LINK_NODES_MAX; i++)
		if (n[i])
			label_node(d, i, sum_x[i] / (double)n[i], sum_y[i] / (double)n[i],
			           width * ceil((double)n[i] / (double)w->rows) / (double)w->columns);
	pen_text(d->cr, (struct pen_point){ x + width / 2, y - 11 }, PEN_CENTRE, 11, true, pen_ink, "%s", w->id);
	pen_text(d->cr, (struct pen_point){ x + width / 2, y + height + 12 }, PEN_CENTRE, 10, false, pen_grey,
	         "%.3f x %.3f m", width / s, height / s);
	pen_text(d->cr, (struct pen_point){ x + width / 2, y + height + 25 }, PEN_CENTRE, 10, false, pen_grey,
	         w->columns * w->rows > 1 ? "%d x %d tiles" : "%d x %d px",
	         (int)(w->columns * w->rows > 1 ? w->columns : w->width_px),
	         (int)(w->columns * w->rows > 1 ? w->rows : w->height_px));
}

static void draw_unrolled(struct drawing *d)
{
	double total = 0, x;

	for (size_t i = 0; i < d->room->n_walls; i++)
		total += width_m(&d->room->walls[i].corners) * d->unrolled_scale + (i ? 18 : 0);
	x = (PAGE_WIDTH - total) / 2;
	pen_line(d->cr, (struct pen_point){ EDGE, d->unrolled_y }, (struct pen_point){ PAGE_WIDTH - EDGE, d->unrolled_y }, 0.6,
	         pen_faint);
	pen_text(d->cr, (struct pen_point){ EDGE, d->unrolled_y + 12 }, PEN_LEFT, 12, true, pen_grey,
	         "Walls as seen from inside, by node");
	for (size_t i = 0; i < d->room->n_walls; i++) {
		unroll_wall(d, i, x, d->unrolled_y + 40);
		x += width_m(&d->room->walls[i].corners) * d->unrolled_scale + 18;
	}
}

static void draw_title(struct drawing *d)
{
	const struct bb_room *r = d->room;
	double megapixels = 0;

	for (size_t i = 0; i < r->n_screens; i++)
		megapixels += (double)(r->screens[i].display.width_px * r->screens[i].display.height_px) * 1e-6;
	pen_text(d->cr, (struct pen_point){ EDGE, 34 }, PEN_LEFT, 22, true, pen_ink, "%s", r->name);
	pen_text(d->cr, (struct pen_point){ EDGE, 57 }, PEN_LEFT, 11.5, false, pen_grey,
	         "%zu wall%s, %zu screen%s, %.*f megapixels, %zu camera%s, %zu node%s", r->n_walls, many(r->n_walls),
	         r->n_screens, many(r->n_screens), megapixels < 100 ? 2 : 0, megapixels, r->n_cameras, many(r->n_cameras),
	         r->n_nodes, many(r->n_nodes));
	pen_line(d->cr, (struct pen_point){ EDGE, TOP - 6 }, (struct pen_point){ PAGE_WIDTH - EDGE, TOP - 6 }, 0.6, pen_faint);
}

static void draw_legend(struct drawing *d)
{
	const double y = d->height - EDGE - 8;
	double x = EDGE + 230;

	pen_scale_bar(d->cr, (struct pen_point){ EDGE + 6, y - 4 }, d->plan.scale, 160);
	pen_line(d->cr, (struct pen_point){ x, y }, (struct pen_point){ x + 22, y }, 1.8, pen_ink);
	pen_text(d->cr, (struct pen_point){ x + 28, y }, PEN_LEFT, 10.5, false, pen_ink, "picture plane, band behind it by node");
	x += 250;
	pen_rect(d->cr, x, y - 4, 12, 8, pen_camera, pen_camera);
	pen_text(d->cr, (struct pen_point){ x + 18, y }, PEN_LEFT, 10.5, false, pen_ink, "camera and its field of view");
	x += 210;
	head_symbol(d->cr, (struct pen_point){ x + 4, y }, 6, true);
	pen_text(d->cr, (struct pen_point){ x + 18, y }, PEN_LEFT, 10.5, false, pen_ink, "neutral viewer");
	x += 130;
	if (!d->n_path)
		return;
	pen_line(d->cr, (struct pen_point){ x, y }, (struct pen_point){ x + 22, y }, 1.6, pen_truth);
	pen_text(d->cr, (struct pen_point){ x + 28, y }, PEN_LEFT, 10.5, false, pen_ink, "head, truth");
	x += 110;
	pen_line(d->cr, (struct pen_point){ x, y }, (struct pen_point){ x + 22, y }, 1.2, pen_tracked);
	pen_text(d->cr, (struct pen_point){ x + 28, y }, PEN_LEFT, 10.5, false, pen_ink, "tracked");
}

static void paint(struct drawing *d)
{
	pen_set(d->cr, pen_paper);
	cairo_paint(d->cr);
	cairo_set_line_join(d->cr, CAIRO_LINE_JOIN_ROUND);
	draw_title(d);
	draw_view(d, &d->plan, "From above, front wall at the top");
	draw_door(d);
	draw_view(d, &d->side, "From the left");
	draw_dimensions(d);
	draw_unrolled(d);
	draw_legend(d);
}

static void prepare(struct drawing *d, const struct bb_room *room, const struct bb_path_point *path, size_t n_path)
{
	*d = (struct drawing){ .room = room, .path = path, .n_path = path ? n_path : 0, .min = room->min, .max = room->max };
	include(d, room->neutral);
	for (size_t i = 0; i < room->n_cameras; i++)
		include(d, room->cameras[i].pose.p);
	for (size_t i = 0; i < d->n_path; i++)
		include(d, path[i].truth);
	/* a single wall has no depth: give it the viewer's surroundings */
	include(d, bb_vec3_add(room->neutral, (struct bb_vec3){ 0.15, 0.15, 0.15 }));
	include(d, bb_vec3_sub(room->neutral, (struct bb_vec3){ 0.15, 0.15, 0.15 }));
	lay_out(d);
}

/* --- files and strings -------------------------------------------------------------------------------------------- */

static void paint_page(cairo_t *cr, void *ctx)
{
	struct drawing *d = ctx;

	d->cr = cr;
	paint(d);
}

static struct bb_page page_of(struct drawing *d)
{
	return (struct bb_page){ PAGE_WIDTH, d->height, "room-", paint_page, d };
}

char *bb_room_drawing_svg(const struct bb_room *room, const struct bb_path_point *path, size_t n_path)
{
	struct drawing d;

	prepare(&d, room, path, n_path);
	const struct bb_page page = page_of(&d);
	return bb_page_svg(&page);
}

enum bb_status bb_room_drawing_write(const struct bb_room *room, const char *file, struct bb_error *err)
{
	struct drawing d;

	prepare(&d, room, NULL, 0);
	const struct bb_page page = page_of(&d);
	return bb_page_write(&page, file, err);
}

void bb_drawing_forget_fonts(void)
{
	void (*fini)(void);

	cairo_debug_reset_static_data();
	/* fontconfig is cairo's affair and not linked by us: ask for it by name */
	*(void **)&fini = dlsym(RTLD_DEFAULT, "FcFini");
	if (fini)
		fini();
}
