#include "bench/loop/light.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/loop.h"
#include "render/image_metrics.h"

#define KNOTS 64
#define WATCHDOG_NS INT64_C(100000000) /* a stage that hears nothing opens by itself (docs/shutter-od.md) */
#define PATTERN_PX 1050                 /* of a wall, when its pattern is drawn to be measured */
#define PIXEL_STRIDE 2                 /* of a drawn picture every so many pixels of a row and rows are looked at */
#define FORESEE_S 20.0
#define FORESEE_HZ 240 /* both halves of the fastest patch: what a display samples of it moves no oftener */
#define FASTER 1.01 /* so that no display whose clock runs fast flashes after all */

struct gate { /* a stage's two shutters, or the glasses' two lenses */
	double through[2]; /* left, right */
	int64_t heard_ns;
	bool runs;
};

struct wall {
	int stage;                /* of the chain; -1: none before its displays */
	bool gated;               /* the glasses matter */
	double n_screens, lit;
	int64_t at_ns;            /* summed up to here */
	double sum_ns[2], seen[2];
	struct knot {             /* the sums as they were when a gate moved */
		int64_t at_ns;
		double sum_ns[2];
	} knot[KNOTS];
	unsigned n_knots;
	struct bb_flash_grid grid[2], under[2]; /* under: the patch */
	struct { double rgb[3], n; } pixel[2][BB_FLASH_CELLS]; /* of the pictures since the last frame */
	bool fed;
};

struct bb_light {
	struct bb_light_config c;
	struct bb_flash_meter *meter;
	struct gate glasses, stage[BB_STAGES_MAX];
	struct wall *wall;
	double *share;            /* by screen: of the light asked for */
	int64_t from_ns;
	double grey;              /* the patch's */
	int64_t edge_ns[3];       /* the glasses' last ones, newest first; 0: none */
};

static double linear(uint8_t v)
{
	return bb_srgb_to_linear(v / 255.0);
}

static uint8_t encoded(double y)
{
	const double c = y <= 0.0031308 ? 12.92 * y : 1.055 * pow(y, 1 / 2.4) - 0.055;

	return (uint8_t)lround(255 * fmin(1, fmax(0, c)));
}

/* ---- what the pictures show ---- */

static void fill(struct bb_flash_grid *g, const double rgb[3])
{
	g->generation++;
	for (unsigned i = 0; i < BB_FLASH_CELLS; i++)
		for (int c = 0; c < 3; c++)
			g->rgb[i][c] = (float)rgb[c];
}

/* The brightest colour a picture can have: opaque, at the brightest point of the transfer function. */
static void brightest(const struct bb_transfer *tf, double rgb[3])
{
	double most = 0;

	memset(rgb, 0, 3 * sizeof(rgb[0]));
	for (size_t i = 0; i < tf->n; i++) {
		const struct bb_transfer_point *p = &tf->point[i];
		const float c[3] = { (float)bb_srgb_to_linear(p->r), (float)bb_srgb_to_linear(p->g), (float)bb_srgb_to_linear(p->b) };
		if (p->opacity <= 0 || bb_flash_luminance(c) <= most)
			continue;
		most = bb_flash_luminance(c);
		for (int k = 0; k < 3; k++)
			rgb[k] = (double)c[k];
	}
}

/* Where a screen's picture lies on its wall: parts of the wall's width and height, from its lower left. */
static void place_on_wall(const struct bb_room *room, uint16_t screen, double uv[4])
{
	const struct bb_screen *s = &room->screens[screen];
	const struct bb_corners *w = &room->walls[s->wall].corners, *c = &s->corners;
	const struct bb_vec3 across = bb_vec3_sub(w->lower_right, w->lower_left), up = bb_vec3_sub(w->upper_left, w->lower_left);
	const struct bb_vec3 p[2] = { bb_vec3_sub(c->lower_left, w->lower_left),
		                      bb_vec3_sub(bb_corners_at(c, 1, 1), w->lower_left) };

	for (int k = 0; k < 2; k++) {
		uv[2 * k] = bb_vec3_dot(p[k], across) / bb_vec3_dot(across, across);
		uv[2 * k + 1] = bb_vec3_dot(p[k], up) / bb_vec3_dot(up, up);
	}
}

static void add_pixels(struct bb_light *l, uint16_t screen, unsigned eye, const struct bb_image *image, uint32_t stride)
{
	struct wall *w = &l->wall[l->c.room->screens[screen].wall];
	double uv[4], value[256];

	for (int i = 0; i < 256; i++)
		value[i] = linear((uint8_t)i);
	place_on_wall(l->c.room, screen, uv);
	for (uint32_t y = stride / 2; y < image->height; y += stride)
		for (uint32_t x = stride / 2; x < image->width; x += stride) {
			const double u = uv[0] + (uv[2] - uv[0]) * (x + 0.5) / image->width;
			const double v = 1 - (uv[1] + (uv[3] - uv[1]) * (1 - (y + 0.5) / image->height));
			const int column = (int)fmin(BB_FLASH_COLUMNS - 1, fmax(0, u * BB_FLASH_COLUMNS));
			const int row = (int)fmin(BB_FLASH_ROWS - 1, fmax(0, v * BB_FLASH_ROWS));
			const uint8_t *p = &image->rgba[4 * ((size_t)y * image->width + x)];
			for (int c = 0; c < 3; c++)
				w->pixel[eye][row * BB_FLASH_COLUMNS + column].rgb[c] += value[p[c]];
			w->pixel[eye][row * BB_FLASH_COLUMNS + column].n++;
		}
	w->fed = true;
}

void bb_light_pixels(struct bb_light *l, uint16_t screen, unsigned eye, const struct bb_image *image)
{
	if (l && l->c.drawn)
		add_pixels(l, screen, eye, image, PIXEL_STRIDE);
}

static void take_pixels(struct wall *w)
{
	for (int e = 0; e < 2 && w->fed; e++) {
		for (unsigned i = 0; i < BB_FLASH_CELLS; i++)
			for (int c = 0; c < 3 && w->pixel[e][i].n > 0; c++)
				w->grid[e].rgb[i][c] = (float)(w->pixel[e][i].rgb[c] / w->pixel[e][i].n);
		w->grid[e].generation++;
	}
	memset(w->pixel, 0, sizeof(w->pixel));
	w->fed = false;
}

static enum bb_status measure_pattern(struct bb_light *l, uint16_t screen)
{
	const struct bb_screen *s = &l->c.room->screens[screen];
	const int64_t columns = l->c.room->walls[s->wall].columns;
	const uint32_t width = (uint32_t)fmax(64, PATTERN_PX / (double)(columns > 0 ? columns : 1));
	const double aspect = (double)s->display.height_px / fmax(1, (double)s->display.width_px);
	const struct bb_view view = bb_view_make(&s->corners, l->c.viewer, l->c.room->neutral, 0.05, 60);
	struct bb_image image;
	enum bb_status status = bb_image_create(width, (uint32_t)fmax(1, round(width * aspect)), &image);

	for (unsigned e = 0; e < 2 && status == BB_OK; e++) {
		status = bb_calibration_draw(&view, s->id, e == 0, NULL, &image);
		if (status == BB_OK)
			add_pixels(l, screen, e, &image, 1);
	}
	bb_image_release(&image);
	return status;
}

static enum bb_status measure_scene(struct bb_light *l)
{
	enum bb_status status = BB_OK;
	double rgb[3] = { 1, 1, 1 };

	if (l->c.transfer)
		brightest(l->c.transfer, rgb);
	for (size_t w = 0; w < l->c.room->n_walls; w++)
		for (int e = 0; e < 2; e++)
			fill(&l->wall[w].grid[e], rgb);
	l->grey = -1;
	if (l->c.scene->technique != BB_TECHNIQUE_CALIBRATION || (l->c.scene->patch.hz > 0 && !(l->c.scene->patch.size_m > 0)))
		return BB_OK; /* the second: nothing of the pattern is seen */
	for (uint16_t s = 0; s < l->c.room->n_screens && status == BB_OK; s++)
		status = measure_pattern(l, s);
	for (size_t w = 0; w < l->c.room->n_walls; w++) {
		take_pixels(&l->wall[w]);
		memcpy(l->wall[w].under, l->wall[w].grid, sizeof(l->wall[w].under));
	}
	return status;
}

void bb_light_fade(struct bb_image *image, double fade)
{
	uint8_t to[256];

	for (int i = 0; i < 256; i++)
		to[i] = encoded(fade * linear((uint8_t)i));
	for (size_t i = 0; i < (size_t)image->width * image->height * 4; i++)
		if (i % 4 != 3)
			image->rgba[i] = to[image->rgba[i]];
}

/* ---- the patch ---- */

bool bb_patch_is_high(const struct bb_scene *s, double t_s)
{
	return fmod(floor(2 * s->patch.hz * t_s), 2) > 0;
}

static double grey_at(const struct bb_scene *s, double t_s)
{
	return (bb_patch_is_high(s, t_s) ? s->patch.high_percent : s->patch.low_percent) / 100;
}

/* Part of [from, to] of a length that the patch of this edge covers, which lies in its middle. */
static double covered(double size_m, double length_m, double from, double to)
{
	const double half = size_m > 0 ? fmin(0.5, size_m / length_m / 2) : 0.5;

	return fmax(0, fmin(to, 0.5 + half) - fmax(from, 0.5 - half)) / (to - from);
}

static void patch_grid(const struct bb_scene *s, const struct bb_corners *wall, double t_s, const struct bb_flash_grid *under,
                       struct bb_flash_grid *out)
{
	const double width_m = bb_vec3_norm(bb_vec3_sub(wall->lower_right, wall->lower_left));
	const double height_m = bb_vec3_norm(bb_vec3_sub(wall->upper_left, wall->lower_left));
	const double grey = grey_at(s, t_s);

	out->generation++;
	for (int i = 0; i < BB_FLASH_CELLS; i++) {
		const int column = i % BB_FLASH_COLUMNS, row = i / BB_FLASH_COLUMNS;
		const double u = (double)column / BB_FLASH_COLUMNS, v = (double)row / BB_FLASH_ROWS;
		const double part = covered(s->patch.size_m, width_m, u, u + 1.0 / BB_FLASH_COLUMNS) *
		                    covered(s->patch.size_m, height_m, v, v + 1.0 / BB_FLASH_ROWS);
		for (int c = 0; c < 3; c++)
			out->rgb[i][c] = (float)((1 - part) * (double)under->rgb[i][c] + part * grey);
	}
}

void bb_patch_draw(const struct bb_room *room, const struct bb_scene *s, uint16_t screen, double t_s, struct bb_image *image)
{
	const struct bb_corners *wall = &room->walls[room->screens[screen].wall].corners;
	const double width_m = bb_vec3_norm(bb_vec3_sub(wall->lower_right, wall->lower_left));
	const double height_m = bb_vec3_norm(bb_vec3_sub(wall->upper_left, wall->lower_left));
	const double size = s->patch.size_m > 0 ? s->patch.size_m : fmax(width_m, height_m);
	const uint8_t grey = encoded(grey_at(s, t_s));
	double uv[4];

	if (!(s->patch.hz > 0))
		return;
	place_on_wall(room, screen, uv);
	for (uint32_t y = 0; y < image->height; y++)
		for (uint32_t x = 0; x < image->width; x++) {
			const double u = uv[0] + (uv[2] - uv[0]) * (x + 0.5) / image->width;
			const double v = uv[3] + (uv[1] - uv[3]) * (y + 0.5) / image->height;
			if (fabs(u - 0.5) * width_m <= size / 2 && fabs(v - 0.5) * height_m <= size / 2)
				memset(&image->rgba[4 * ((size_t)y * image->width + x)], grey, 3);
		}
}

void bb_light_patch(struct bb_light *l, double t_s)
{
	const double grey = grey_at(l->c.scene, t_s);

	if (l->c.drawn || !(l->c.scene->patch.hz > 0) || !(grey < l->grey || grey > l->grey))
		return;
	l->grey = grey;
	for (size_t w = 0; w < l->c.room->n_walls; w++)
		for (int e = 0; e < 2; e++)
			patch_grid(l->c.scene, &l->c.room->walls[w].corners, t_s, &l->wall[w].under[e], &l->wall[w].grid[e]);
}

/* The wall that is largest to the viewer stands for all: the patch and the steps are the same on each. */
static const struct bb_wall *nearest_wall(const struct bb_room *room)
{
	const struct bb_wall *best = &room->walls[0];
	double most = 0;

	for (size_t i = 0; i < room->n_walls; i++) {
		const struct bb_corners *c = &room->walls[i].corners;
		const double sr = bb_solid_angle(bb_vec3_sub(c->lower_left, room->neutral), bb_vec3_sub(c->lower_right, room->neutral),
		                                 bb_vec3_sub(c->upper_left, room->neutral));
		best = sr > most ? &room->walls[i] : best;
		most = fmax(most, sr);
	}
	return best;
}

enum bb_status bb_light_foresee(const struct bb_room *room, const struct bb_scene *scene, const float (*means)[3],
                                uint32_t n_steps, double fade, struct bb_flash_worst *out)
{
	const double all_s = fmax(FORESEE_S, means ? 2 * n_steps * scene->data.seconds_per_step : 0); /* there and back */
	const int64_t n_frames = (int64_t)(FORESEE_HZ * fmin(scene->duration_s, all_s));
	struct bb_flash_grid g = { 0 }, under = { 0 };
	struct bb_flash_meter *m;

	*out = (struct bb_flash_worst){ 0 };
	if (!room->n_walls || (!(scene->patch.hz > 0) && !means))
		return BB_OK;
	const struct bb_corners *wall = &nearest_wall(room)->corners;
	const enum bb_status status = bb_flash_create(wall, 1, room->neutral, &room->safety, &m);
	for (int64_t k = 0; k <= n_frames && status == BB_OK; k++) {
		const double t_s = FASTER * (double)k / FORESEE_HZ, at = means ? bb_loop_steps_at(scene, n_steps, t_s) : 0;
		const uint32_t step = (uint32_t)at, next = step + 1 < n_steps ? step + 1 : step;
		double rgb[3];

		for (int c = 0; c < 3 && means; c++)
			rgb[c] = (double)means[step][c] + (at - step) * (double)(means[next][c] - means[step][c]);
		if (means)
			fill(&g, rgb);
		else
			patch_grid(scene, wall, t_s, &under, &g);
		bb_flash_frame(m, 0, 0, k * BB_NS_PER_S / FORESEE_HZ, &g, fade);
	}
	if (status == BB_OK)
		*out = bb_flash_worst(m);
	bb_flash_destroy(m);
	return status;
}

/* ---- what comes through ---- */

static void settle(struct bb_light *l, struct wall *w, int64_t now_ns)
{
	const struct gate *s = w->stage >= 0 ? &l->stage[w->stage] : NULL;
	const double wall = s ? (s->through[0] + s->through[1]) / 2 : 1;
	const double passed_ns = (double)(now_ns - w->at_ns);

	if (passed_ns <= 0)
		return;
	struct knot *k = &w->knot[w->n_knots++ % KNOTS];
	*k = (struct knot){ w->at_ns, { w->sum_ns[0], w->sum_ns[1] } };
	for (int e = 0; e < 2; e++)
		w->sum_ns[e] += passed_ns * wall * (w->gated ? l->glasses.through[e] : 1);
	w->at_ns = now_ns;
}

/* The sum at a time not long ago; between two knots it grows evenly. */
static double sum_at(const struct wall *w, int e, int64_t at_ns)
{
	struct knot next = { w->at_ns, { w->sum_ns[0], w->sum_ns[1] } };

	for (unsigned i = 1; i <= KNOTS && i <= w->n_knots && next.at_ns > at_ns; i++) {
		const struct knot *k = &w->knot[(w->n_knots - i) % KNOTS];
		if (k->at_ns <= at_ns && next.at_ns > k->at_ns)
			return k->sum_ns[e] + (next.sum_ns[e] - k->sum_ns[e]) * (double)(at_ns - k->at_ns) /
			                              (double)(next.at_ns - k->at_ns);
		next = *k;
	}
	return next.sum_ns[e];
}

/* A running shutter's light is that of its last whole cycle: any other stretch would hold one eye more than the other.
 * False: there has been none yet, or it goes on by its own clock, and nothing has changed. */
static bool stretch_of(const struct bb_light *l, const struct wall *w, int64_t now_ns, int64_t *from_ns, int64_t *to_ns)
{
	const int64_t period_ns = l->c.room->has_chain ? bb_rate_period_ns(l->c.room->chain.rate) : 0;
	const bool cycles = w->gated && l->glasses.runs && now_ns - l->edge_ns[0] < 2 * period_ns;

	const bool coasts = w->gated && l->glasses.runs && now_ns - l->edge_ns[0] < l->c.coast_ns;

	*from_ns = cycles ? l->edge_ns[2] : l->from_ns;
	*to_ns = cycles ? l->edge_ns[0] : now_ns;
	return *from_ns > 0 && (cycles || !coasts);
}

static void set_gate(struct bb_light *l, int stage, double left, double right, int64_t at_ns)
{
	struct gate *g = stage < 0 ? &l->glasses : &l->stage[stage];

	for (size_t i = 0; i < l->c.room->n_walls; i++)
		if (stage < 0 ? l->wall[i].gated : l->wall[i].stage == stage)
			settle(l, &l->wall[i], at_ns);
	g->through[0] = left;
	g->through[1] = right;
}

void bb_light_edge(struct bb_light *l, const struct bb_shutter_edge *e)
{
	const int stage = e->stage == BB_STAGE_EMITTER ? -1 : e->stage;

	if (!l || stage >= BB_STAGES_MAX)
		return;
	struct gate *g = stage < 0 ? &l->glasses : &l->stage[stage];
	const double either = e->eye == BB_EYE_NONE ? 0.5 : 0; /* one of them, who knows which */
	set_gate(l, stage, e->eye == BB_EYE_LEFT ? 1 : either, e->eye == BB_EYE_RIGHT ? 1 : either, e->at_ns);
	if (stage < 0) {
		const bool fresh = !g->runs || (l->c.coast_ns > 0 &&
		                                e->at_ns - l->edge_ns[0] > 2 * bb_rate_period_ns(l->c.room->chain.rate));
		l->edge_ns[2] = fresh ? 0 : l->edge_ns[1];
		l->edge_ns[1] = fresh ? 0 : l->edge_ns[0];
		l->edge_ns[0] = e->at_ns;
	}
	g->heard_ns = e->at_ns;
	g->runs = true;
}

void bb_light_open(struct bb_light *l, int64_t at_ns)
{
	for (int i = -1; l && i < l->c.room->chain.n_stages; i++) {
		set_gate(l, i, 1, 1, at_ns);
		(i < 0 ? &l->glasses : &l->stage[i])->runs = false;
	}
}

/* A stage that is silent has opened by itself meanwhile, or goes on by its own clock. */
static void watch_silence(struct bb_light *l, int64_t now_ns)
{
	const int64_t coast_ns = l->c.coast_ns, period_ns = bb_rate_period_ns(l->c.room->chain.rate);

	for (int i = -1; i < l->c.room->chain.n_stages; i++) {
		struct gate *g = i < 0 ? &l->glasses : &l->stage[i];
		if (!g->runs || now_ns - g->heard_ns < 2 * period_ns)
			continue;
		if (now_ns - g->heard_ns < coast_ns) {
			set_gate(l, i, 0.5, 0.5, g->heard_ns + 2 * period_ns);
		} else if (now_ns - g->heard_ns >= (coast_ns > WATCHDOG_NS ? coast_ns : WATCHDOG_NS)) {
			set_gate(l, i, 1, 1, g->heard_ns + (coast_ns > WATCHDOG_NS ? coast_ns : WATCHDOG_NS));
			g->runs = false;
		}
	}
}

void bb_light_screen(struct bb_light *l, uint16_t screen, double share)
{
	if (!l)
		return;
	const double is = l->c.drawn && share > 0 ? 1 : share; /* drawn pixels come with their share */
	l->wall[l->c.room->screens[screen].wall].lit += is - l->share[screen];
	l->share[screen] = is;
}

void bb_light_skip(struct bb_light *l, int64_t now_ns)
{
	for (size_t i = 0; l && i < l->c.room->n_walls; i++) {
		l->wall[i].at_ns = now_ns;
		l->wall[i].n_knots = 0;
	}
	if (l) {
		l->from_ns = now_ns;
		memset(l->edge_ns, 0, sizeof(l->edge_ns));
	}
}

void bb_light_frame(struct bb_light *l, int64_t now_ns, double fade)
{
	if (!l || now_ns <= l->from_ns)
		return;
	if (l->c.room->has_chain)
		watch_silence(l, now_ns);
	for (unsigned i = 0; i < l->c.room->n_walls; i++) {
		struct wall *w = &l->wall[i];
		const double lit = w->n_screens > 0 ? fmax(0, w->lit) / w->n_screens : 1;
		int64_t from_ns, to_ns;

		settle(l, w, now_ns);
		take_pixels(w);
		if (!stretch_of(l, w, now_ns, &from_ns, &to_ns))
			continue;
		for (unsigned e = 0; e < 2; e++) {
			w->seen[e] = lit * (sum_at(w, (int)e, to_ns) - sum_at(w, (int)e, from_ns)) / (double)(to_ns - from_ns);
			bb_flash_frame(l->meter, i, e, now_ns, &w->grid[e], w->seen[e] * (l->c.drawn ? 1 : fade));
		}
	}
	l->from_ns = now_ns;
}

const struct bb_flash_meter *bb_light_meter(const struct bb_light *l)
{
	return l->meter;
}

const struct bb_flash_grid *bb_light_grid(const struct bb_light *l, unsigned wall, unsigned eye)
{
	return &l->wall[wall].grid[eye];
}

double bb_light_seen(const struct bb_light *l, unsigned wall, unsigned eye)
{
	return l->wall[wall].seen[eye];
}

double bb_light_dim(const struct bb_room *room)
{
	const bool behind = room->n_screens && room->screens[0].display.stereo == BB_STEREO_DUAL_PROJECTOR;

	/* Half of the time; of two projectors behind shutters only one of them. */
	return room->has_chain ? (behind ? 0.25 : 0.5) : 1;
}

/* ---- creation ---- */

static int stage_of(const struct bb_room *room, size_t wall)
{
	for (int i = 0; room->has_chain && i < room->chain.n_stages; i++)
		if (!strcmp(room->chain.stage[i], room->walls[wall].id))
			return i;
	return -1;
}

static void init_walls(struct bb_light *l)
{
	const struct bb_room *room = l->c.room;

	for (uint16_t s = 0; s < room->n_screens; s++) {
		struct wall *w = &l->wall[room->screens[s].wall];
		const enum bb_stereo stereo = room->screens[s].display.stereo;
		w->n_screens++;
		w->lit++;
		l->share[s] = 1;
		w->gated = room->has_chain && stereo != BB_STEREO_MONO;
		w->stage = stereo == BB_STEREO_DUAL_PROJECTOR ? stage_of(room, room->screens[s].wall) : -1;
	}
	l->glasses.through[0] = l->glasses.through[1] = 1;
	for (size_t i = 0; i < BB_STAGES_MAX; i++)
		l->stage[i].through[0] = l->stage[i].through[1] = 1;
}

enum bb_status bb_light_create(const struct bb_light_config *c, struct bb_light **out)
{
	struct bb_light *l = calloc(1, sizeof(*l));
	struct bb_corners *corners = calloc(c->room->n_walls + 1, sizeof(*corners));
	enum bb_status status = BB_ERR_NOMEM;

	*out = NULL;
	if (l) {
		l->c = *c;
		l->wall = calloc(c->room->n_walls + 1, sizeof(*l->wall));
		l->share = calloc(c->room->n_screens + 1, sizeof(*l->share));
	}
	if (l && l->wall && l->share && corners) {
		for (size_t w = 0; w < c->room->n_walls; w++)
			corners[w] = c->room->walls[w].corners;
		init_walls(l);
		status = bb_flash_create(corners, c->room->n_walls, c->viewer, &c->room->safety, &l->meter);
	}
	free(corners);
	if (status == BB_OK)
		status = measure_scene(l);
	if (status == BB_OK)
		*out = l;
	else
		bb_light_destroy(l);
	return status;
}

void bb_light_destroy(struct bb_light *l)
{
	if (!l)
		return;
	bb_flash_destroy(l->meter);
	free(l->wall);
	free(l->share);
	free(l);
}
