/* sync/calibrate/choose.c: labels every picture, and chooses the moments a calibration is made from. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sync/calibrate/calibrate_private.h"
#include "sync/calibrate/label.h"
#include "sync/track/triangulate.h"

#define RODS_PER_CAMERA 200
#define LEAST_ANGLE_RAD 0.05

struct marked { /* a wand in a picture */
	uint16_t camera;
	uint32_t source[3]; /* places in the sequence's px */
	float px[3][2];
};

struct moment { /* all pictures of one exposure */
	int64_t t_ns;
	size_t first, n;
};

struct choice {
	const struct bb_calibrate_config *config;
	struct marked *marked;
	struct moment *moments;
	size_t n_marked, n_moments;
	uint16_t (*seen)[BB_CALIBRATE_CELLS_X * BB_CALIBRATE_CELLS_Y]; /* per camera: chosen wands by part of the picture */
};

unsigned bb_calibrate_cell(const struct bb_camera_config *c, double x_px, double y_px)
{
	const double x = (x_px + 0.5) / (double)c->width_px, y = (y_px + 0.5) / (double)c->height_px;
	const unsigned i = (unsigned)(fmin(fmax(x, 0), 0.999) * BB_CALIBRATE_CELLS_X);
	const unsigned j = (unsigned)(fmin(fmax(y, 0), 0.999) * BB_CALIBRATE_CELLS_Y);

	return j * BB_CALIBRATE_CELLS_X + i;
}

/* Every picture of the wand, grouped by exposure. */
static void label_all(struct choice *c, const struct bb_lens *lenses, struct bb_calibration *out)
{
	const struct bb_sequence *s = c->config->sequence;

	for (size_t i = 0; i < s->n_sights; i++) {
		const struct bb_sequence_sight *sight = &s->sights[i];
		const float (*px)[2] = (const float(*)[2])(s->px + sight->first);
		int order[3];

		if (sight->square || sight->n < 3)
			continue;
		out->n_lines++;
		if (!bb_label_wand(&lenses[sight->camera], s, px, sight->n, order))
			continue;
		out->n_pictures++;
		out->report[sight->camera].n_pictures++;
		struct moment *m = c->n_moments ? &c->moments[c->n_moments - 1] : NULL;
		if (!m || sight->t_ns - m->t_ns > BB_SEQUENCE_TOGETHER_NS) {
			m = &c->moments[c->n_moments++];
			*m = (struct moment){ sight->t_ns, c->n_marked, 0 };
		}
		struct marked *k = &c->marked[c->n_marked++];
		m->n++;
		k->camera = sight->camera;
		for (int j = 0; j < 3; j++) {
			memcpy(k->px[j], px[order[j]], sizeof(k->px[j]));
			k->source[j] = sight->first + (uint32_t)order[j];
		}
	}
}

static uint16_t *part_of(const struct choice *c, const struct marked *k)
{
	return &c->seen[k->camera][bb_calibrate_cell(&c->config->cameras[k->camera], (double)k->px[1][0], (double)k->px[1][1])];
}

/* What a moment adds: parts of pictures that few wands have been in count most. */
static double worth(const struct choice *c, const struct moment *m)
{
	double sum = 0;

	for (size_t i = 0; i < m->n; i++)
		sum += 1 / (1 + (double)*part_of(c, &c->marked[m->first + i]));
	return m->n >= 2 ? sum : 0;
}

/* The rod as the cameras that were planned would have seen it; false: they do not agree on any. */
static bool start_rod(const struct choice *c, const struct bb_lens *lenses, const struct moment *m, struct bb_rod *rod)
{
	struct bb_vec3 p[3];

	for (int j = 0; j < 3; j++) {
		struct bb_sight sights[64];
		struct bb_triangulated point;
		size_t n = 0;
		for (size_t i = 0; i < m->n && n < BB_ARRAY_LEN(sights); i++) {
			const struct marked *k = &c->marked[m->first + i];
			struct bb_ray ray;
			if (!bb_lens_ray(&lenses[k->camera], (double)k->px[j][0], (double)k->px[j][1], &ray))
				continue;
			sights[n++] = (struct bb_sight){ lenses[k->camera].o, ray.d, ray.sigma_rad };
		}
		if (n < 2 || !bb_triangulate(sights, n, LEAST_ANGLE_RAD, &point))
			return false;
		p[j] = point.p;
	}
	rod->p = bb_vec3_scale(bb_vec3_add(p[0], bb_vec3_add(p[1], p[2])), 1.0 / 3);
	rod->u = bb_vec3_unit(bb_vec3_sub(p[2], p[0]), (struct bb_vec3){ 1, 0, 0 });
	return true;
}

static int by_camera(const void *a, const void *b)
{
	const struct marked *x = a, *y = b;
	return x->camera < y->camera ? -1 : x->camera > y->camera;
}

static void take(struct choice *c, const struct moment *m, const struct bb_rod *rod, struct bb_calibration *out)
{
	struct bb_bundle *b = &out->bundle;

	qsort(c->marked + m->first, m->n, sizeof(*c->marked), by_camera);
	for (size_t i = 0; i < m->n; i++) {
		const struct marked *k = &c->marked[m->first + i];
		if (i && k->camera == k[-1].camera)
			continue; /* one picture of a camera a moment */
		++*part_of(c, k);
		for (uint8_t j = 0; j < 3; j++)
			b->obs[b->n_obs++] = (struct bb_bundle_obs){ .rod = (uint32_t)b->n_rods,
				                                     .camera = k->camera,
				                                     .marker = j,
				                                     .source = k->source[j],
				                                     .px = { (double)k->px[j][0], (double)k->px[j][1] } };
	}
	out->rod_ns[b->n_rods] = m->t_ns;
	b->rods[b->n_rods++] = *rod;
}

/* The most worthy moment of each of `most` spans of time. */
static void choose(struct choice *c, const struct bb_lens *lenses, size_t most, struct bb_calibration *out)
{
	for (size_t k = 0; k < most; k++) { /* NOLINT(clang-analyzer-unix.Malloc): what take() fills belongs to out */
		const size_t from = k * c->n_moments / most, to = (k + 1) * c->n_moments / most;
		double best = 0;
		size_t chosen = 0;
		struct bb_rod rod;

		for (size_t i = from; i < to; i++) {
			const double w = worth(c, &c->moments[i]);
			if (w > best) {
				best = w;
				chosen = i;
			}
		}
		if (best > 0 && start_rod(c, lenses, &c->moments[chosen], &rod))
			take(c, &c->moments[chosen], &rod, out);
	}
}

static void set_lengths(const struct bb_sequence *s, struct bb_bundle *b)
{
	const double mean = (s->along_m[0] + s->along_m[1] + s->along_m[2]) / 3;

	for (int i = 0; i < 3; i++)
		b->along_m[i] = s->along_m[i] - mean;
}

enum bb_status bb_calibrate_choose(const struct bb_calibrate_config *config, const struct bb_lens *lenses,
                                   struct bb_calibration *out)
{
	const size_t n = config->sequence->n_sights + 1, asked = config->rods_most ? config->rods_most : SIZE_MAX;
	size_t most = RODS_PER_CAMERA * config->n_cameras < BB_CALIBRATE_RODS ? RODS_PER_CAMERA * config->n_cameras : BB_CALIBRATE_RODS;
	struct choice c = { .config = config };
	struct bb_bundle *b = &out->bundle;

	most = asked < most ? asked : most;
	c.marked = calloc(n, sizeof(*c.marked));
	c.moments = calloc(n, sizeof(*c.moments));
	c.seen = calloc(config->n_cameras, sizeof(*c.seen));
	b->rods = calloc(most, sizeof(*b->rods));
	b->obs = calloc(most * config->n_cameras * 3, sizeof(*b->obs));
	out->rod_ns = calloc(most, sizeof(*out->rod_ns));
	const bool fits = c.marked && c.moments && c.seen && b->rods && b->obs && out->rod_ns;
	if (fits) {
		set_lengths(config->sequence, b);
		label_all(&c, lenses, out);
		choose(&c, lenses, most, out);
	}
	free(c.marked);
	free(c.moments);
	free(c.seen);
	return fits ? BB_OK : BB_ERR_NOMEM;
}
