/*
 * render/cpu/layers.h: the native ray caster for what the fast kernels of one Cartesian volume do not draw: several
 * volumes, spherical ones, meshes between them, values mixed across levels. Private to render/cpu and its tests.
 *
 * A ray is drawn by itself: each layer hands out its samples in batches of one brick (vectors run along the ray), and
 * batches and fragments of meshes are merged by the distances that rays.c gives, in double, so that their order is the
 * reference's. Cells and blocks of 8^3 voxels whose ranges show nothing cost no sampling.
 */
#ifndef BB_RENDER_CPU_LAYERS_H
#define BB_RENDER_CPU_LAYERS_H

#include "render/mesh_scene.h"
#include "render/renderer_driver.h"

#define BB_LAYER_BATCH 64
#define BB_LAYER_WIDEST 16 /* lanes of a vector */
#define BB_LAYER_ROOM (BB_LAYER_BATCH + BB_LAYER_WIDEST)
#define BB_LAYER_TABLE 8192
#define BB_LAYER_UPS 24 /* levels above the leaves, and more than there can be */

/* ---- kernels: layer_kernel.inc for portable C, AVX2 and AVX-512 ---- */

struct bb_layer_brick {
	const uint8_t *voxels;
	enum bb_brick_type type;
	uint32_t stored;
	float scale;
};

struct bb_layer_ball { /* bb_spherical in float; positions are relative to the centre */
	float from[3], per_unit[3], most[3];
	float around; /* 1: phi has no ends */
};

struct bb_layer_kernel {
	const char *name;
	/* n <= BB_LAYER_BATCH points: base + (number - the first number) * stride. Arrays have BB_LAYER_WIDEST numbers more
	 * than there are points: what lies there does not matter. */
	void (*line)(const float base[3], const float stride[3], const int32_t *number, uint32_t n,
		     float out[3][BB_LAYER_ROOM]);
	/* Values at these points times `per` plus `off`, in stored voxels; outside: the nearest. */
	void (*sample)(const struct bb_layer_brick *brick, float at[3][BB_LAYER_ROOM], float per, const float off[3],
		       uint32_t n, float *out);
	/* Grid coordinates of the points first + k * stride; inside: 0 or not. */
	void (*spherical)(const struct bb_layer_ball *ball, const float first[3], const float stride[3], uint32_t n,
			  float grid[3][BB_LAYER_ROOM], int32_t *inside);
};
extern const struct bb_layer_kernel bb_layer_kernel_portable, bb_layer_kernel_avx2, bb_layer_kernel_avx512;

/* ---- layer_values.c: one point at a time ---- */

/* The value at a point of the grid's own corner coordinates of the time on show. blend: see bb_draw.blend_levels. */
double bb_layer_value(const struct bb_atlas *atlas, const double at[3], bool blend);
/* The same where no neighbour that matters reaches farther than `reach` voxels of the leaves; 0: not blended. */
double bb_layer_value_within(const struct bb_atlas *atlas, const double at[3], double reach);
/* Of a cell: what of its neighbours is mixed into it. */
struct bb_layer_seam {
	uint8_t up_most; /* 0: nothing; else the highest of their levels, and 1 */
	uint8_t sides;   /* bit 2 axis + (0: low, 1: high): something comes from there */
};
void bb_layer_seams(const struct bb_atlas *atlas, uint32_t plane, struct bb_layer_seam *seam);
bool bb_layer_around(const struct bb_atlas *atlas);

/* ---- layer_prepare.c: what all rays of a picture need of a layer ---- */

typedef float bb_layer_rgba __attribute__((vector_size(16)));

enum bb_layer_shows { BB_SHOWS_NOTHING, BB_SHOWS_BLOCKS, BB_SHOWS_ALL };

struct bb_layer_ready {
	const struct bb_atlas *atlas;
	const struct bb_rays *rays;
	const struct bb_layer_kernel *kernel;
	bool steps_by_level, blend;
	bool spherical;
	struct bb_spherical ball;
	struct bb_layer_ball ball_float;
	uint32_t *visible;   /* [65536 + 1]: the first part of the range from here on that shows; 65536: none */
	uint8_t *shows;      /* of a cell: */
	struct bb_layer_seam *seam; /* of a cell; NULL: not blended */
	bb_layer_rgba *table[BB_LAYER_UPS]; /* [BB_LAYER_TABLE + 2]: premultiplied; NULL: no brick needs it */
};

BB_MUST_CHECK enum bb_status bb_layer_make_ready(const struct bb_draw *draw, size_t layer, const struct bb_rays *rays,
						 const struct bb_layer_kernel *kernel, unsigned threads,
						 struct bb_layer_ready *out, struct bb_error *err);
void bb_layer_unready(struct bb_layer_ready *r);

static inline bool bb_layer_range_shows(const struct bb_layer_ready *r, struct bb_atlas_range range)
{
	return r->visible[range.least] <= range.most;
}

/* ---- layer_walk.c: the samples of one ray in one layer ---- */

struct bb_layer_walk {
	const struct bb_layer_ready *layer;
	struct bb_ray ray;
	double next, end;     /* sample numbers to look at */
	double hole[2];       /* of a ball: inside its innermost shell from .. to - 1 */
	uint32_t n, at;       /* of the batch; those before `at` are drawn */
	int32_t number[BB_LAYER_ROOM];
	float value[BB_LAYER_ROOM];
	uint8_t up[BB_LAYER_BATCH];
	uint64_t samples;
};

void bb_layer_walk_begin(struct bb_layer_walk *w, const struct bb_layer_ready *layer, uint32_t column, uint32_t row);
/* The next batch; false: there is none. */
bool bb_layer_walk_on(struct bb_layer_walk *w);

/* ---- cast_layers.c ---- */

/* One picture, nothing kept. rays: of each layer. BB_ERR_RANGE and 1816: a mesh; 1702. */
BB_MUST_CHECK enum bb_status bb_cast_layers(const struct bb_draw *draw, const struct bb_rays *rays, unsigned threads,
					    struct bb_image *image, struct bb_draw_stats *stats, struct bb_error *err);

/* The same with the kernel's choice ("avx512", "avx2", "portable", "auto") and the meshes' scene kept from picture to
 * picture as long as their generations stay. */
struct bb_layers_caster {
	const struct bb_layer_kernel *kernel;
	unsigned threads;
	bool without_embree;
	struct bb_mesh_scene *meshes;
};
BB_MUST_CHECK enum bb_status bb_layers_caster_init(struct bb_layers_caster *c, const char *kernel, unsigned threads,
						   struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_layers_caster_draw(struct bb_layers_caster *c, const struct bb_draw *draw,
						   const struct bb_rays *rays, struct bb_image *image,
						   struct bb_draw_stats *stats, struct bb_error *err);
void bb_layers_caster_fini(struct bb_layers_caster *c); /* also: forget */

/* A renderer of its own, for tests. */
BB_MUST_CHECK enum bb_status bb_renderer_layers_create(const char *kernel, unsigned threads, bool without_embree,
						       struct bb_renderer **out, struct bb_error *err);

#endif
