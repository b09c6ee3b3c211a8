/*
 * render/mesh_scene.h: the meshes of a picture ready for many rays: copies of them behind Embree's trees, or behind
 * ours (mesh.h) where libembree3 is not installed. Embree only says which triangles a ray may meet; where and whether
 * it does is bb_mesh_ray_meets', so that pictures do not depend on which of the two it is.
 *
 * Embree is loaded when the first mesh is drawn: it takes 40 MB of address space and its start-up, which no run
 * without meshes should pay, and the program runs without it.
 */
#ifndef BB_RENDER_MESH_SCENE_H
#define BB_RENDER_MESH_SCENE_H

#include "render/mesh.h"

struct bb_mesh_scene;

/* BB_ERR_RANGE and 1816, 1702. own: never Embree. */
BB_MUST_CHECK enum bb_status bb_mesh_scene_create(const struct bb_mesh *meshes, size_t n, bool own,
						  struct bb_mesh_scene **out, struct bb_error *err);
void bb_mesh_scene_destroy(struct bb_mesh_scene *s);
/* Was it made of these, as they are now? By their addresses, sizes and generations. */
bool bb_mesh_scene_is_of(const struct bb_mesh_scene *s, const struct bb_mesh *meshes, size_t n);
const char *bb_mesh_scene_description(const struct bb_mesh_scene *s); /* "Embree 3.13.5" */
/* Any number of threads. */
void bb_mesh_scene_meets(const struct bb_mesh_scene *s, const struct bb_mesh_ray *ray, struct bb_mesh_fragments *out);

/* mesh_embree.c, the only file that knows it. */
struct bb_mesh_embree;
/* NULL: it is not installed, or has no memory. Borrows the meshes. */
struct bb_mesh_embree *bb_mesh_embree_create(const struct bb_mesh *meshes, size_t n);
void bb_mesh_embree_destroy(struct bb_mesh_embree *e);
const char *bb_mesh_embree_description(const struct bb_mesh_embree *e);
void bb_mesh_embree_meets(const struct bb_mesh_embree *e, const struct bb_mesh_ray *ray, struct bb_mesh_fragments *out);

#endif
