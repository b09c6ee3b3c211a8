/* bench/track/cover_slices.c: three cuts through a room, coloured by the expected error, with lines of equal count. */
#include <math.h>
#include <stdlib.h>

#include "bench/report/drawing_pen.h"
#include "bench/stats.h"
#include "bench/track/cover_pictures.h"

#define EDGE 30.0
#define TOP 66.0
#define WIDE 980.0 /* the cuts together, and above each other */
#define TALL 600.0
#define AROUND 46.0 /* a cut's ticks and title */
#define SCALE_ROOM 96.0
#define CUTS 3

/* A colour map that grows evenly in lightness, for colour-blind eyes too; samples of viridis. */
static const double colours[][3] = { { 0.267, 0.005, 0.329 }, { 0.275, 0.195, 0.496 }, { 0.213, 0.359, 0.552 },
				     { 0.153, 0.498, 0.558 }, { 0.122, 0.632, 0.531 }, { 0.290, 0.758, 0.428 },
				     { 0.622, 0.854, 0.226 }, { 0.993, 0.906, 0.144 } };
static const struct pen_colour nowhere = { 0.80, 0.80, 0.82, 1 };

struct cut {          /* through a grid, along two axes */
	int across, up, through;
	bool falls;   /* `up` grows down the page: the front wall is at the top */
	size_t at;    /* voxel along `through` */
	double x, y;  /* of its lower left corner on the page */
	double scale; /* points per metre */
	const char *title;
};

struct scale {
	double low, high; /* ln mm */
};

static double low_of(const struct bb_coverage_grid *g, int axis)
{
	return axis == 0 ? g->min.x : axis == 1 ? g->min.y : g->min.z;
}

static double length_of(const struct bb_coverage_grid *g, int axis)
{
	return g->step_m * (double)g->n[axis];
}

static const struct bb_coverage_voxel *voxel(const struct bb_cover *c, const struct cut *k, size_t u, size_t v)
{
	size_t at[3];

	at[k->across] = u;
	at[k->up] = v;
	at[k->through] = k->at;
	return &c->voxels[(at[1] * c->grid.n[2] + at[2]) * c->grid.n[0] + at[0]];
}

/* Where a place stands on the page. */
static struct pen_point page_point(const struct bb_coverage_grid *g, const struct cut *k, double across_m, double up_m)
{
	const double u = across_m - low_of(g, k->across), v = up_m - low_of(g, k->up);

	return (struct pen_point){ k->x + k->scale * u, k->y - k->scale * (k->falls ? length_of(g, k->up) - v : v) };
}

static struct pen_colour colour_of(double t)
{
	const size_t n = BB_ARRAY_LEN(colours) - 1;
	const double s = fmin(fmax(t, 0), 1) * (double)n;
	const size_t i = s < (double)n ? (size_t)s : n - 1;
	const double f = s - (double)i;

	return (struct pen_colour){ colours[i][0] + f * (colours[i + 1][0] - colours[i][0]),
				    colours[i][1] + f * (colours[i + 1][1] - colours[i][1]),
				    colours[i][2] + f * (colours[i + 1][2] - colours[i][2]), 1 };
}

/* ---- one cut ---- */

static uint32_t pixel(struct pen_colour c)
{
	return 0xFF000000u | (uint32_t)lrint(255 * c.r) << 16 | (uint32_t)lrint(255 * c.g) << 8 | (uint32_t)lrint(255 * c.b);
}

static void draw_heat(cairo_t *cr, const struct bb_cover_slices *s, const struct cut *k, const struct scale *scale)
{
	const struct bb_coverage_grid *g = &s->cover->grid;
	const int w = (int)g->n[k->across], h = (int)g->n[k->up];
	cairo_surface_t *image = cairo_image_surface_create(CAIRO_FORMAT_RGB24, w, h);

	if (cairo_surface_status(image) != CAIRO_STATUS_SUCCESS) {
		cairo_surface_destroy(image);
		return;
	}
	unsigned char *bytes = cairo_image_surface_get_data(image);
	for (int v = 0; v < h; v++) {
		const int row = k->falls ? v : h - 1 - v;
		uint32_t *line = (uint32_t *)(void *)(bytes + (size_t)row * (size_t)cairo_image_surface_get_stride(image));
		for (int u = 0; u < w; u++) {
			const struct bb_coverage_voxel *x = voxel(s->cover, k, (size_t)u, (size_t)v);
			const double e = log(1e3 * (double)x->error_m[s->body]);
			line[u] = pixel(!x->inside ? pen_paper : !isfinite(e) ? nowhere : colour_of((e - scale->low) / (scale->high - scale->low)));
		}
	}
	cairo_surface_mark_dirty(image);
	cairo_save(cr);
	cairo_translate(cr, k->x, k->y - k->scale * length_of(g, k->up));
	cairo_scale(cr, k->scale * g->step_m, k->scale * g->step_m);
	cairo_set_source_surface(cr, image, 0, 0);
	cairo_pattern_set_filter(cairo_get_source(cr), CAIRO_FILTER_BILINEAR);
	cairo_pattern_set_extend(cairo_get_source(cr), CAIRO_EXTEND_PAD);
	cairo_rectangle(cr, 0, 0, w, h);
	cairo_fill(cr);
	cairo_restore(cr);
	cairo_surface_destroy(image);
}

static const struct line_style {
	double width, halo;
	struct pen_colour ink, around;
} line_3 = { 1.7, 1.8, { 0.05, 0.06, 0.08, 1 }, { 1, 1, 1, 0.85 } }, line_6 = { 1.1, 1.0, { 1, 1, 1, 1 }, { 0, 0, 0, 0.35 } };

/* Lines along which the count passes a level: marching squares between voxel centres, saddles split by their mean. */
static void draw_contour(cairo_t *cr, const struct bb_cover_slices *s, const struct cut *k, double level,
			 const struct line_style *style)
{
	static const int edge[4][2] = { { 0, 1 }, { 1, 2 }, { 2, 3 }, { 3, 0 } };
	const struct bb_coverage_grid *g = &s->cover->grid;

	cairo_new_path(cr);
	for (size_t v = 0; v + 1 < g->n[k->up]; v++)
		for (size_t u = 0; u + 1 < g->n[k->across]; u++) {
			const double n[4] = { (double)voxel(s->cover, k, u, v)->n[s->body] - level,
					      (double)voxel(s->cover, k, u + 1, v)->n[s->body] - level,
					      (double)voxel(s->cover, k, u + 1, v + 1)->n[s->body] - level,
					      (double)voxel(s->cover, k, u, v + 1)->n[s->body] - level };
			const double x[4] = { 0.5, 1.5, 1.5, 0.5 }, y[4] = { 0.5, 0.5, 1.5, 1.5 };
			struct pen_point hit[4];
			int hits = 0;
			for (int e = 0; e < 4; e++) {
				const int a = edge[e][0], b = edge[e][1];
				if ((n[a] < 0) == (n[b] < 0))
					continue;
				const double t = n[a] / (n[a] - n[b]);
				hit[hits++] = page_point(g, k,
							 low_of(g, k->across) + g->step_m * ((double)u + x[a] + t * (x[b] - x[a])),
							 low_of(g, k->up) + g->step_m * ((double)v + y[a] + t * (y[b] - y[a])));
			}
			const bool turn = hits == 4 && (n[0] + n[1] + n[2] + n[3] < 0) != (n[0] < 0);
			for (int i = 0; i + 1 < hits; i += 2) {
				const struct pen_point p = hit[turn ? (i + 1) % 4 : i], q = hit[turn ? (i + 2) % 4 : i + 1];
				cairo_move_to(cr, p.x, p.y);
				cairo_line_to(cr, q.x, q.y);
			}
		}
	cairo_set_line_cap(cr, CAIRO_LINE_CAP_ROUND);
	pen_set(cr, style->around); /* an outline: readable on every colour */
	cairo_set_line_width(cr, style->width + style->halo);
	cairo_stroke_preserve(cr);
	pen_set(cr, style->ink);
	cairo_set_line_width(cr, style->width);
	cairo_stroke(cr);
}

/* In a box of less than a metre a power of ten, so that there are two at least. */
static double tick_m(const struct bb_coverage_grid *g, const struct cut *k, int axis)
{
	const double length_m = length_of(g, axis);

	return length_m < 1 ? pow(10, floor(log10(length_m / 2))) : length_of(g, k->across) > 5 ? 1 : 0.5;
}

static void draw_ticks(cairo_t *cr, const struct bb_coverage_grid *g, const struct cut *k)
{
	static const char name[3] = { 'x', 'y', 'z' };
	const double w = k->scale * length_of(g, k->across), h = k->scale * length_of(g, k->up);

	cairo_rectangle(cr, k->x, k->y - h, w, h);
	pen_set(cr, pen_ink);
	cairo_set_line_width(cr, 1);
	cairo_stroke(cr);
	for (int pass = 0; pass < 2; pass++) {
		const int axis = pass ? k->up : k->across;
		const double low = low_of(g, axis), high = low + length_of(g, axis), step = tick_m(g, k, axis);
		for (int i = (int)ceil(low / step - 1e-9); i * step <= high + 1e-9; i++) {
			const double m = i * step;
			const struct pen_point on = page_point(g, k, pass ? low_of(g, k->across) : m, pass ? m : low_of(g, k->up));
			const struct pen_point a = { on.x, pass ? on.y : k->y };
			const struct pen_point b = pass ? (struct pen_point){ a.x - 4, a.y } : (struct pen_point){ a.x, a.y + 4 };
			pen_line(cr, a, b, 0.8, pen_ink);
			pen_text(cr, (struct pen_point){ pass ? b.x - 3 : b.x, pass ? b.y : b.y + 8 }, pass ? PEN_RIGHT : PEN_CENTRE, 9.5,
				 false, pen_ink, "%g", m);
		}
	}
	pen_text(cr, (struct pen_point){ k->x + w, k->y + 27 }, PEN_RIGHT, 10.5, false, pen_grey, "%c, m", name[k->across]);
	pen_text(cr, (struct pen_point){ k->x - 4, k->y - h - 10 }, PEN_RIGHT, 10.5, false, pen_grey, "%c, m", name[k->up]);
}

static double component(struct bb_vec3 v, int axis)
{
	return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

static void draw_cameras(cairo_t *cr, const struct bb_cover *c, const struct cut *k)
{
	const struct bb_coverage_grid *g = &c->grid;

	for (size_t i = 0; i < c->room->n_cameras; i++) {
		const struct bb_pose *p = &c->room->cameras[i].pose;
		const struct bb_vec3 axis = bb_quat_rotate(p->q, (struct bb_vec3){ 0, 0, 1 });
		const struct pen_point q = page_point(g, k, component(p->p, k->across), component(p->p, k->up));
		const double rise = (k->falls ? 11 : -11) * component(axis, k->up);
		pen_line(cr, q, (struct pen_point){ q.x + 11 * component(axis, k->across), q.y + rise }, 1.6, pen_camera);
		cairo_new_path(cr);
		cairo_arc(cr, q.x, q.y, 3, 0, 2 * 3.14159265358979323846);
		pen_set(cr, pen_camera);
		cairo_fill(cr);
	}
}

/* Cameras may hang above what is cut. */
static double head_room(const struct bb_cover *c, const struct cut *k)
{
	double most_m = 0;

	for (size_t i = 0; i < c->room->n_cameras; i++)
		most_m = fmax(most_m, k->up == 1 ? c->room->cameras[i].pose.p.y - c->grid.min.y - length_of(&c->grid, 1) : 0);
	return most_m > 0 ? fmin(k->scale * most_m + 4, 60) : 0;
}

static void draw_cut(cairo_t *cr, const struct bb_cover_slices *s, const struct cut *k, const struct scale *scale)
{
	const struct bb_coverage_grid *g = &s->cover->grid;
	const double where = low_of(g, k->through) + ((double)k->at + 0.5) * g->step_m;
	const double half = s->body == BB_COVERAGE_MEAN ? 0 : 0.5;

	draw_heat(cr, s, k, scale);
	draw_contour(cr, s, k, 6 - half, &line_6);
	draw_contour(cr, s, k, 3 - half, &line_3);
	draw_cameras(cr, s->cover, k);
	draw_ticks(cr, g, k);
	const double above = k->y - k->scale * length_of(g, k->up) - head_room(s->cover, k);
	pen_text(cr, (struct pen_point){ k->x + 20, above - 12 }, PEN_LEFT, 12, true, pen_ink, "%s %.2f m", k->title,
		 fabs(where) < 5e-3 ? 0 : where);
}

/* ---- the page ---- */

static size_t nearest(const struct bb_coverage_grid *g, int axis, double at)
{
	const double k = floor((at - low_of(g, axis)) / g->step_m);

	return k < 0 ? 0 : k > (double)g->n[axis] - 1 ? g->n[axis] - 1 : (size_t)k;
}

struct layout {
	struct cut cut[CUTS];
	double width, height;
};

/* The level cut on the left, the two upright ones above each other on its right; all to one scale. */
static struct layout lay_out(const struct bb_cover_slices *s)
{
	const struct bb_coverage_grid *g = &s->cover->grid;
	const struct bb_vec3 middle = bb_vec3_lerp(s->cover->room->min, s->cover->room->max, 0.5);
	const double x = length_of(g, 0), y = length_of(g, 1), z = length_of(g, 2);
	const double scale = fmin(fmin(WIDE / (x + fmax(x, z)), TALL / z), TALL / (2 * y));
	struct layout l = { .cut = { { .across = 0, .up = 2, .through = 1, .falls = true, .title = "level, y =" },
				     { .across = 0, .up = 1, .through = 2, .title = "upright, z =" },
				     { .across = 2, .up = 1, .through = 0, .title = "upright, x =" } } };

	l.cut[0].at = nearest(g, 1, s->height_m);
	l.cut[1].at = nearest(g, 2, middle.z);
	l.cut[2].at = nearest(g, 0, middle.x);
	for (int i = 0; i < CUTS; i++) {
		l.cut[i].scale = scale;
		l.cut[i].x = EDGE + AROUND + (i ? scale * x + AROUND + 20 : 0);
	}
	const double head = head_room(s->cover, &l.cut[1]);
	l.cut[0].y = TOP + 30 + head + scale * z;
	l.cut[1].y = TOP + 30 + head + scale * y;
	l.cut[2].y = l.cut[1].y + AROUND + 24 + head + scale * y;
	l.width = l.cut[1].x + scale * fmax(x, z) + SCALE_ROOM + EDGE;
	l.height = fmax(l.cut[0].y, l.cut[2].y) + AROUND + 36;
	return l;
}

static void mark(cairo_t *cr, double x, double y, double mm)
{
	pen_line(cr, (struct pen_point){ x, y }, (struct pen_point){ x + 4, y }, 0.8, pen_ink);
	pen_text(cr, (struct pen_point){ x + 8, y }, PEN_LEFT, 10, false, pen_ink, "%.3g", mm);
}

static void draw_scale(cairo_t *cr, const struct scale *scale, double x, double top, double height)
{
	static const double round_mm[] = { 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1, 1.5, 2, 3, 5, 10, 20, 50, 100 };
	cairo_pattern_t *ramp = cairo_pattern_create_linear(0, top + height, 0, top);
	const size_t last = BB_ARRAY_LEN(colours) - 1;

	for (size_t i = 0; i <= last; i++)
		cairo_pattern_add_color_stop_rgb(ramp, (double)i / (double)last, colours[i][0], colours[i][1], colours[i][2]);
	cairo_rectangle(cr, x, top, 18, height);
	cairo_set_source(cr, ramp);
	cairo_fill_preserve(cr);
	cairo_pattern_destroy(ramp);
	pen_set(cr, pen_ink);
	cairo_set_line_width(cr, 0.8);
	cairo_stroke(cr);
	int marks = 0;
	for (size_t i = 0; i < BB_ARRAY_LEN(round_mm); i++) {
		const double t = (log(round_mm[i]) - scale->low) / (scale->high - scale->low);
		if (t < 0 || t > 1)
			continue;
		mark(cr, x + 18, top + height * (1 - t), round_mm[i]);
		marks++;
	}
	if (marks < 2) { /* so narrow that round numbers say nothing of how steep it is */
		mark(cr, x + 18, top + height, exp(scale->low));
		mark(cr, x + 18, top, exp(scale->high));
	}
	pen_text(cr, (struct pen_point){ x + 9, top - 26 }, PEN_CENTRE, 11, true, pen_ink, "error");
	pen_text(cr, (struct pen_point){ x + 9, top - 12 }, PEN_CENTRE, 10.5, false, pen_grey, "mm");
	pen_rect(cr, x, top + height + 14, 18, 12, nowhere, pen_ink);
	pen_text(cr, (struct pen_point){ x + 9, top + height + 37 }, PEN_CENTRE, 10, false, pen_ink, "no position");
}

static double legend_line(cairo_t *cr, double x, double y, const struct line_style *style, const char *text)
{
	const struct pen_point a = { x, y }, b = { x + 30, y };

	pen_rect(cr, x - 4, y - 8, 38, 16, colour_of(0.4), colour_of(0.4));
	pen_line(cr, a, b, style->width + style->halo, style->around);
	pen_line(cr, a, b, style->width, style->ink);
	pen_text(cr, (struct pen_point){ x + 42, y }, PEN_LEFT, 11, false, pen_ink, "%s", text);
	return x + 66 + pen_text_width(cr, 11, text);
}

static void legend(cairo_t *cr, double y)
{
	double x = legend_line(cr, EDGE + 4, y, &line_3, "within: at least 3 cameras");

	x = legend_line(cr, x, y, &line_6, "at least 6");
	cairo_new_path(cr);
	cairo_arc(cr, x + 6, y, 3, 0, 2 * 3.14159265358979323846);
	pen_set(cr, pen_camera);
	cairo_fill(cr);
	pen_text(cr, (struct pen_point){ x + 16, y }, PEN_LEFT, 11, false, pen_ink, "camera");
}

static void paint(cairo_t *cr, void *ctx)
{
	static const char *const viewer[BB_COVERAGE_BODIES] = { "nobody in the way", "the viewer's body in the way, over all headings",
								"the viewer's body in the way, at the worst heading" };
	const struct bb_cover_slices *s = ctx;
	const struct layout l = lay_out(s);
	const struct scale scale = { log(s->least_mm), log(s->most_mm) };

	pen_rect(cr, 0, 0, l.width, l.height, pen_paper, pen_paper);
	pen_text(cr, (struct pen_point){ EDGE, 24 }, PEN_LEFT, 17, true, pen_ink, "%s: expected error of a marker's position",
		 s->cover->room->name);
	pen_text(cr, (struct pen_point){ EDGE, 44 }, PEN_LEFT, 11.5, false, pen_grey,
		 "root of the covariance's trace, from the cameras' rays and blob noise; %s", viewer[s->body]);
	for (int k = 0; k < CUTS; k++)
		draw_cut(cr, s, &l.cut[k], &scale);
	draw_scale(cr, &scale, l.width - EDGE - 60, TOP + 40, fmax(120, l.height - TOP - 170));
	legend(cr, l.height - 22);
}

void bb_cover_slices_fit(struct bb_cover_slices *s)
{
	const struct layout l = lay_out(s);
	const size_t *n = s->cover->grid.n;
	double *v = malloc((n[0] * n[1] + n[1] * n[2] + n[2] * n[0]) * sizeof(*v));
	size_t k = 0;

	s->least_mm = 0.1;
	s->most_mm = 1;
	for (int i = 0; v && i < CUTS; i++)
		for (size_t b = 0; b < n[l.cut[i].up]; b++)
			for (size_t a = 0; a < n[l.cut[i].across]; a++) {
				const struct bb_coverage_voxel *x = voxel(s->cover, &l.cut[i], a, b);
				if (x->inside && isfinite(x->error_m[s->body]))
					v[k++] = 1e3 * (double)x->error_m[s->body];
			}
	if (k) {
		bb_stats_sort(v, k);
		s->least_mm = bb_stats_nearest_rank(v, k, 0.01);
		s->most_mm = fmax(bb_stats_nearest_rank(v, k, 0.97), 1.1 * s->least_mm);
	}
	free(v);
}

struct bb_page bb_cover_slices_page(struct bb_cover_slices *s)
{
	const struct layout l = lay_out(s);

	return (struct bb_page){ .width = l.width, .height = l.height, .prefix = "slices-", .paint = paint, .ctx = s };
}
