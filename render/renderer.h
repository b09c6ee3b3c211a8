/*
 * render/renderer.h: draws one view of what is there: volumes from their atlases, and meshes between and inside them. Back
 * ends: "gl" (GLSL on an offscreen context, OSMesa or EGL), "cpu" (native code for AVX-512, AVX2 or any processor) and
 * "reference" (double precision on the CPU, slow, full resolution: the judge).
 *
 * Front-to-back compositing, premultiplied; a sample every step_voxels voxels as measured along a volume's longest edge
 * (of a spherical one: along r), at (i + 0.5) steps from where the ray enters its box, or from the eye when that is inside;
 * opacity corrected for the step; linear in space and time; background black. Samples of several volumes and the surfaces
 * of meshes follow each other by their distance from the eye; at equal ones volumes come in their order, then meshes. All
 * back ends sample at the same points.
 *
 * Rays run from the eye through the pixels' centres, (column + 0.5) / width across and (row + 0.5) / height down the
 * screen's parallelogram. A channel c becomes floor(c * 255 + 0.5). One thread per renderer; several renderers may live
 * side by side.
 */
#ifndef BB_RENDER_RENDERER_H
#define BB_RENDER_RENDERER_H

#include "render/atlas.h"
#include "render/image.h"
#include "render/transfer.h"
#include "render/view.h"
#include "render/volume/volume.h"

#define BB_LAYERS_MOST 4
#define BB_MESH_FRAGMENTS_MOST 32 /* of one pixel; the farthest ones beyond are left out */

struct bb_layer { /* a volume; everything borrowed */
	const struct bb_atlas *atlas;
	const struct bb_transfer *transfer;
	struct bb_placement placement;
	const struct bb_volume *volume; /* what "reference" reads instead of the atlas; others need none */
};

struct bb_mesh { /* triangles, seen from both sides, not lit; borrowed */
	const float (*vertex_m)[3]; /* room */
	const float (*rgba)[4];     /* of a vertex: colour, not premultiplied, and opacity; 0..1 */
	const uint32_t (*triangle)[3];
	uint32_t n_vertices, n_triangles;
	uint64_t generation; /* another one: the mesh has changed */
};

struct bb_draw {
	const struct bb_view *view;
	const struct bb_layer *layers;
	size_t n_layers; /* 1 .. BB_LAYERS_MOST */
	const struct bb_mesh *meshes;
	size_t n_meshes;
	double step_voxels;
	/* A brick `up` levels above the leaves is sampled every 2^up-th step (i with i % 2^up == 2^up / 2), opacity
	 * corrected for the longer one; between two steps the finer of the two bricks decides. "reference" does not. */
	bool steps_by_level;
	/* Where bricks of different levels meet, values go over into each other within half a voxel of the coarser one, on
	 * the finer one's side, so that no seam shows ("cpu"; the others draw each brick for itself). */
	bool blend_levels;
};

struct bb_draw_stats {
	uint64_t rays, samples; /* taken; 0 where the back end cannot count */
	uint64_t upload_bytes;
	int64_t elapsed_ns;     /* real time of drawing and reading back */
};

struct bb_renderer;

/* kind: "osmesa", "egl", "auto" (osmesa, then egl). One GL kind per process. 1801: no such library on this machine. */
BB_MUST_CHECK enum bb_status bb_renderer_gl_create(const char *kind, struct bb_renderer **out, struct bb_error *err);
/* kernel: "avx512", "avx2", "portable"; "auto" is the widest this processor has. 1801: it does not have that one. */
BB_MUST_CHECK enum bb_status bb_renderer_cpu_create(const char *kernel, unsigned threads, struct bb_renderer **out,
                                                    struct bb_error *err);
/* threads >= 1; reads the volume of a layer, never its atlas (but for the time). */
BB_MUST_CHECK enum bb_status bb_renderer_reference_create(unsigned threads, struct bb_renderer **out);
void bb_renderer_destroy(struct bb_renderer *r);
/* "llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5, OSMesa" */
const char *bb_renderer_description(const struct bb_renderer *r);
/* The image's size is the picture's size. stats may be NULL. BB_ERR_RANGE: a number of
 * layers, a step_voxels outside 1/64..64, a placement without size, or a view that bb_view_make would not have made: not
 * finite, or the eye in its screen's plane. BB_ERR_UNSUPPORTED: "reference" without a volume. */
BB_MUST_CHECK enum bb_status bb_renderer_draw(struct bb_renderer *r, const struct bb_draw *draw, struct bb_image *image,
                                              struct bb_draw_stats *stats);
/* Why the last draw failed; number 0 when it did not. */
const struct bb_error *bb_renderer_last_error(const struct bb_renderer *r);
/* A renderer keeps copies of the atlases and meshes it drew last and brings them up to date by their generations. Call
 * this before one of them is destroyed: another one could come to lie at the same address. */
void bb_renderer_forget(struct bb_renderer *r);

/* Calibration pattern of a screen for one eye (no volume, no GL): grid lines of 10 cm in the wall's plane, the screen's
 * id, "L" in a circle or "R" in a square, and the tracked cursor (a cross) where the room point `cursor` appears. */
BB_MUST_CHECK enum bb_status bb_calibration_draw(const struct bb_view *view, const char *screen_id, int eye_is_left,
                                                 const struct bb_vec3 *cursor, struct bb_image *image);

#endif
