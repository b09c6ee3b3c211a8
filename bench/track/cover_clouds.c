/* bench/track/cover_clouds.c: the page of clouds: the room as a wire frame, its cameras and what they see together. */
#include <math.h>
#include <stdlib.h>

#include "bench/report/drawing_pen.h"
#include "bench/track/cloud.h"
#include "bench/track/cover_pictures.h"
#include "sync/track/lens.h"

#define PANEL 372.0
#define GAP 12.0
#define EDGE 26.0
#define TOP 62.0
#define CAPTION 44.0
#define ROW_TITLE 26.0
#define LEGEND 34.0
#define SHARPER 1.5
#define MARGIN 24.0
#define AZIMUTH_DEG 33.0
#define ELEVATION_DEG 24.0

static const struct pen_colour cloud_blue = { 0.20, 0.48, 0.86, 1 };
static const struct pen_colour wire = { 0.30, 0.33, 0.38, 1 };

struct panel {
	cairo_surface_t *cloud, *shadow;
	double share;
};

struct bb_cloud_page {
	struct bb_cover_clouds what;
	struct bb_eyepoint eye;
	struct bb_vec3 min, max; /* of room and cameras */
	double panel_height;
	struct panel panel[2][BB_COVER_CLOUDS_MAX];
};

/* ---- pixels ---- */

static enum bb_status make_panel(const struct bb_cloud_page *p, size_t row, unsigned level, struct panel *out)
{
	const struct bb_cover *c = p->what.cover[row];
	const size_t n = bb_coverage_rows(&c->grid) * c->grid.n[0];
	float *value = malloc(n * sizeof(*value));
	struct bb_cloud cloud = { 0 };
	size_t seen = 0;

	for (size_t i = 0; value && i < n; i++) {
		const struct bb_coverage_voxel *v = &c->voxels[i];
		const bool enough = v->inside && (double)v->n[p->what.body[row]] >= level - 1e-6;
		value[i] = enough ? 1 : 0;
		seen += enough;
	}
	out->share = (double)seen / (double)c->n_inside;
	if (value && bb_cloud_init(&cloud, &c->grid, value) == BB_OK) {
		out->cloud = bb_cloud_picture(&cloud, &p->eye, PANEL, p->panel_height, SHARPER, c->threads);
		out->shadow = bb_cloud_shadow(&cloud, &p->eye, c->room->min.y, PANEL, p->panel_height, SHARPER, c->threads);
	}
	bb_cloud_fini(&cloud);
	free(value);
	return out->cloud && out->shadow ? BB_OK : BB_ERR_NOMEM;
}

/* ---- strokes ---- */

static struct pen_point at(const struct bb_cloud_page *p, struct bb_vec3 v)
{
	struct pen_point out;

	bb_eyepoint_project(&p->eye, v, &out.x, &out.y);
	return out;
}

static void stroke(cairo_t *cr, const struct bb_cloud_page *p, struct bb_vec3 a, struct bb_vec3 b, double width,
		   struct pen_colour c)
{
	pen_line(cr, at(p, a), at(p, b), width, c);
}

static struct bb_vec3 corner(const struct bb_room *r, int i)
{
	return (struct bb_vec3){ i & 1 ? r->max.x : r->min.x, i & 2 ? r->max.y : r->min.y, i & 4 ? r->max.z : r->min.z };
}

/* The eye stands beyond max in every axis: what touches that corner lies before the cloud. */
static void draw_box(cairo_t *cr, const struct bb_cloud_page *p, bool front)
{
	const struct bb_room *r = p->what.cover[0]->room;

	for (int i = 0; i < 8; i++)
		for (int a = 1; a < 8; a <<= 1)
			if (!(i & a) && front == ((i | a) == 7 || i == 7))
				stroke(cr, p, corner(r, i), corner(r, i | a), front ? 0.9 : 1.2, pen_alpha(wire, front ? 0.45 : 0.9));
}

static void draw_floor(cairo_t *cr, const struct bb_cloud_page *p)
{
	const struct bb_room *r = p->what.cover[0]->room;
	const double y = r->min.y, grid_m = r->max.x - r->min.x > 5 ? 1 : 0.5;

	for (int i = 0; i < 4; i++) {
		const struct pen_point q = at(p, corner(r, i == 0 ? 0 : i == 1 ? 1 : i == 2 ? 5 : 4));
		if (i)
			cairo_line_to(cr, q.x, q.y);
		else
			cairo_move_to(cr, q.x, q.y);
	}
	cairo_close_path(cr);
	pen_set(cr, (struct pen_colour){ 0.945, 0.950, 0.960, 1 });
	cairo_fill(cr);
	for (int i = (int)ceil(r->min.x / grid_m); i * grid_m <= r->max.x; i++)
		stroke(cr, p, (struct bb_vec3){ i * grid_m, y, r->min.z }, (struct bb_vec3){ i * grid_m, y, r->max.z }, 0.6,
		       pen_alpha(pen_grey, 0.28));
	for (int i = (int)ceil(r->min.z / grid_m); i * grid_m <= r->max.z; i++)
		stroke(cr, p, (struct bb_vec3){ r->min.x, y, i * grid_m }, (struct bb_vec3){ r->max.x, y, i * grid_m }, 0.6,
		       pen_alpha(pen_grey, 0.28));
}

/* What one picture takes in, cut off at a length: through the lens, so that its edges bend as they do. */
static void draw_frustum(cairo_t *cr, const struct bb_cloud_page *p, const struct bb_camera_config *c, double length_m,
			 double alpha)
{
	const double w = (double)c->width_px - 1, h = (double)c->height_px - 1;
	const double px[5][2] = { { 0, 0 }, { w, 0 }, { w, h }, { 0, h }, { 0, 0 } };
	struct bb_vec3 last = { 0, 0, 0 };
	struct bb_lens lens;
	struct bb_ray ray;

	if (!bb_lens_init(&lens, c))
		return;
	for (int i = 0; i < 5; i++) {
		if (!bb_lens_ray(&lens, px[i][0], px[i][1], &ray))
			return;
		const struct bb_vec3 end = bb_vec3_add(c->pose.p, bb_vec3_scale(ray.d, length_m));
		if (i)
			stroke(cr, p, last, end, 0.8, pen_alpha(pen_camera, alpha));
		if (i < 4)
			stroke(cr, p, c->pose.p, end, 0.8, pen_alpha(pen_camera, alpha));
		last = end;
	}
}

static void draw_frusta(cairo_t *cr, const struct bb_cloud_page *p, const struct bb_room *r, double alpha)
{
	const double length_m = r->n_cameras > 12 ? 0.7 : 0.5;

	for (size_t i = 0; i < r->n_cameras; i++)
		draw_frustum(cr, p, &r->cameras[i], length_m, alpha);
}

static void draw_cameras(cairo_t *cr, const struct bb_cloud_page *p, const struct bb_room *r)
{
	for (size_t i = 0; i < r->n_cameras; i++) {
		const struct pen_point q = at(p, r->cameras[i].pose.p);
		cairo_new_path(cr);
		cairo_arc(cr, q.x, q.y, 3.4, 0, 2 * 3.14159265358979323846);
		pen_set(cr, pen_camera);
		cairo_fill_preserve(cr);
		pen_set(cr, pen_paper);
		cairo_set_line_width(cr, 0.8);
		cairo_stroke(cr);
	}
}

/* Sizes stand along the floor's front edges and the upright edge on the left. */
static void draw_sizes(cairo_t *cr, const struct bb_cloud_page *p)
{
	const struct bb_room *r = p->what.cover[0]->room;
	const struct bb_vec3 s = bb_vec3_sub(r->max, r->min);
	const struct pen_point x = at(p, (struct bb_vec3){ (r->min.x + r->max.x) / 2, r->min.y, r->max.z });
	const struct pen_point z = at(p, (struct bb_vec3){ r->max.x, r->min.y, (r->min.z + r->max.z) / 2 });
	const struct pen_point y = at(p, (struct bb_vec3){ r->min.x, (r->min.y + r->max.y) / 2, r->max.z });

	pen_text(cr, (struct pen_point){ x.x - 6, x.y + 13 }, PEN_RIGHT, 10.5, false, pen_ink, "x  %.2f m", s.x);
	pen_text(cr, (struct pen_point){ z.x + 7, z.y + 12 }, PEN_LEFT, 10.5, false, pen_ink, "z  %.2f m", s.z);
	cairo_save(cr);
	cairo_translate(cr, y.x - 10, y.y);
	cairo_rotate(cr, -3.14159265358979323846 / 2);
	pen_text(cr, (struct pen_point){ 0, 0 }, PEN_CENTRE, 10.5, false, pen_ink, "y  %.2f m", s.y);
	cairo_restore(cr);
}

static void lay(cairo_t *cr, cairo_surface_t *s)
{
	cairo_save(cr);
	cairo_scale(cr, 1 / SHARPER, 1 / SHARPER);
	cairo_set_source_surface(cr, s, 0, 0);
	cairo_paint(cr);
	cairo_restore(cr);
}

static void draw_panel(cairo_t *cr, const struct bb_cloud_page *p, size_t row, size_t i)
{
	const struct panel *q = &p->panel[row][i];
	const struct bb_room *room = p->what.cover[row]->room;
	char text[64];

	draw_floor(cr, p);
	lay(cr, q->shadow);
	draw_box(cr, p, false);
	draw_frusta(cr, p, room, 0.55);
	lay(cr, q->cloud);
	draw_frusta(cr, p, room, 0.18);
	draw_box(cr, p, true);
	draw_cameras(cr, p, room);
	draw_sizes(cr, p);
	snprintf(text, sizeof(text), "at least %u cameras", p->what.level[i]);
	pen_text(cr, (struct pen_point){ PANEL / 2, p->panel_height + 14 }, PEN_CENTRE, 13.5, true, pen_ink, "%s", text);
	pen_text(cr, (struct pen_point){ PANEL / 2, p->panel_height + 31 }, PEN_CENTRE, 11.5, false, pen_grey,
		 "%.1f %% of the volume", 100 * q->share);
}

static double page_width(const struct bb_cloud_page *p)
{
	return 2 * EDGE + (double)p->what.n_levels * (PANEL + GAP) - GAP;
}

static double row_height(const struct bb_cloud_page *p)
{
	return p->panel_height + CAPTION + (p->what.title[0] ? ROW_TITLE : 0);
}

static void legend(cairo_t *cr, double y)
{
	pen_rect(cr, EDGE, y - 5, 16, 10, pen_alpha(cloud_blue, 0.75), cloud_blue);
	pen_text(cr, (struct pen_point){ EDGE + 22, y }, PEN_LEFT, 11, false, pen_ink, "seen together");
	cairo_new_path(cr);
	cairo_arc(cr, EDGE + 124, y, 3.4, 0, 2 * 3.14159265358979323846);
	pen_set(cr, pen_camera);
	cairo_fill(cr);
	pen_text(cr, (struct pen_point){ EDGE + 133, y }, PEN_LEFT, 11, false, pen_ink, "camera, and how its picture spreads");
	pen_text(cr, (struct pen_point){ EDGE + 350, y }, PEN_LEFT, 11, false, pen_grey,
		 "the front wall is the far one on the right, at -z");
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct bb_cloud_page *p = ctx;
	const double width = page_width(p), height = TOP + (double)p->what.n_rows * row_height(p) + LEGEND;

	pen_rect(cr, 0, 0, width, height, pen_paper, pen_paper);
	pen_text(cr, (struct pen_point){ EDGE, 24 }, PEN_LEFT, 17, true, pen_ink, "%s: where cameras see a marker",
		 p->what.cover[0]->room->name);
	pen_text(cr, (struct pen_point){ EDGE, 44 }, PEN_LEFT, 11.5, false, pen_grey,
		 "%zu cameras, marker of %g mm, voxels of %g mm", p->what.cover[0]->room->n_cameras,
		 1e3 * p->what.cover[0]->config.marker_m, 1e3 * p->what.cover[0]->grid.step_m);
	for (size_t row = 0; row < p->what.n_rows; row++) {
		const double y = TOP + (double)row * row_height(p);
		if (p->what.title[row])
			pen_text(cr, (struct pen_point){ EDGE, y + 10 }, PEN_LEFT, 13, true, pen_ink, "%s", p->what.title[row]);
		for (size_t i = 0; i < p->what.n_levels; i++) {
			cairo_save(cr);
			cairo_translate(cr, EDGE + (double)i * (PANEL + GAP), y + (p->what.title[row] ? ROW_TITLE : 0));
			draw_panel(cr, p, row, i);
			cairo_restore(cr);
		}
	}
	legend(cr, height - LEGEND / 2);
}

/* ---- begin and end ---- */

static void include(struct bb_cloud_page *p, struct bb_vec3 v)
{
	p->min = (struct bb_vec3){ fmin(p->min.x, v.x), fmin(p->min.y, v.y), fmin(p->min.z, v.z) };
	p->max = (struct bb_vec3){ fmax(p->max.x, v.x), fmax(p->max.y, v.y), fmax(p->max.z, v.z) };
}

/* Of a box as wide as the panel; a very tall one becomes narrower. */
static double panel_height(struct bb_vec3 min, struct bb_vec3 max)
{
	const struct bb_eyepoint e = bb_eyepoint_of_box(min, max, AZIMUTH_DEG, ELEVATION_DEG, PANEL, 4000, MARGIN);
	double low = HUGE_VAL, high = -HUGE_VAL;

	for (int i = 0; i < 8; i++) {
		double x, y;
		bb_eyepoint_project(&e, (struct bb_vec3){ i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z }, &x, &y);
		low = fmin(low, y);
		high = fmax(high, y);
	}
	return fmin(fmax(high - low + 2 * MARGIN, 150), 420);
}

enum bb_status bb_cover_clouds_begin(const struct bb_cover_clouds *c, struct bb_cloud_page **out, struct bb_page *page)
{
	struct bb_cloud_page *p = calloc(1, sizeof(*p));
	const struct bb_room *room = c->cover[0]->room;
	enum bb_status status = p ? BB_OK : BB_ERR_NOMEM;

	*out = p;
	if (status)
		return status;
	p->what = *c;
	p->min = room->min;
	p->max = room->max;
	for (size_t row = 0; row < c->n_rows; row++)
		for (size_t i = 0; i < c->cover[row]->room->n_cameras; i++)
			include(p, c->cover[row]->room->cameras[i].pose.p);
	p->panel_height = panel_height(p->min, p->max);
	p->eye = bb_eyepoint_of_box(p->min, p->max, AZIMUTH_DEG, ELEVATION_DEG, PANEL, p->panel_height, MARGIN);
	for (size_t row = 0; row < c->n_rows && !status; row++)
		for (size_t i = 0; i < c->n_levels && !status; i++)
			status = make_panel(p, row, c->level[i], &p->panel[row][i]);
	*page = (struct bb_page){ .width = page_width(p),
				  .height = TOP + (double)c->n_rows * row_height(p) + LEGEND,
				  .prefix = "clouds-",
				  .paint = paint,
				  .ctx = p };
	return status;
}

void bb_cover_clouds_end(struct bb_cloud_page *p)
{
	if (!p)
		return;
	for (size_t row = 0; row < 2; row++)
		for (size_t i = 0; i < BB_COVER_CLOUDS_MAX; i++) {
			cairo_surface_destroy(p->panel[row][i].cloud);
			cairo_surface_destroy(p->panel[row][i].shadow);
		}
	free(p);
}
