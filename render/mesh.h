/*
 * render/mesh.h: where a ray through a pixel meets the triangles of a picture's meshes, in double. Every triangle that
 * the ray goes through is met exactly once, and a ray through an edge or a corner that triangles share meets one of
 * them: a semi-transparent surface shows neither gaps nor doubled lines (edge functions of Woop, Benthin and Wald
 * 2013, ties broken as if the ray were moved by an infinitely small step that is the same for all triangles).
 */
#ifndef BB_RENDER_MESH_H
#define BB_RENDER_MESH_H

#include "render/renderer.h"

struct bb_mesh_ray { /* room */
	double from[3], direction[3]; /* of length 1 */
	int axis[3];                  /* the last one is the direction's longest */
	double shear[3];
};

struct bb_mesh_fragment {
	double at_m; /* from the eye, to a nanometre */
	uint32_t mesh, triangle;
	double rgba[4]; /* not premultiplied */
};

struct bb_mesh_fragments { /* in the order of at_m, then mesh, then triangle; each triangle once */
	size_t n;
	struct bb_mesh_fragment at[BB_MESH_FRAGMENTS_MOST];
};

/* The same pixel's ray as bb_rays_at's, in the room. */
struct bb_mesh_ray bb_mesh_ray_at(const struct bb_view *view, uint32_t width, uint32_t height, uint32_t column,
				  uint32_t row);
/* In front of the eye only. mesh is left as it is. */
bool bb_mesh_ray_meets(const struct bb_mesh_ray *ray, const struct bb_mesh *mesh, uint32_t triangle,
		       struct bb_mesh_fragment *out);
/* Colour and opacity where the three weights, 0..1, say. */
void bb_mesh_colour(const struct bb_mesh *mesh, uint32_t triangle, const double weight[3], double rgba[4]);
/* Where there is no room, the farthest one is left out. */
void bb_mesh_fragments_add(struct bb_mesh_fragments *f, const struct bb_mesh_fragment *fragment);

/* 1816: a triangle of vertices that are not there, or vertices that are not finite or a thousand km away. */
BB_MUST_CHECK enum bb_status bb_meshes_check(const struct bb_mesh *meshes, size_t n, struct bb_error *err);

/* Boxes around boxes of triangles; meshes are borrowed and must have passed bb_meshes_check. Any number of threads. */
struct bb_mesh_tree;
BB_MUST_CHECK enum bb_status bb_mesh_tree_create(const struct bb_mesh *meshes, size_t n, struct bb_mesh_tree **out,
						 struct bb_error *err);
void bb_mesh_tree_destroy(struct bb_mesh_tree *t);
void bb_mesh_tree_meets(const struct bb_mesh_tree *t, const struct bb_mesh_ray *ray, struct bb_mesh_fragments *out);

#endif
