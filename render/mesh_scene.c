#include "render/mesh_scene.h"

#include <stdlib.h>
#include <string.h>

struct bb_mesh_scene {
	struct bb_mesh *source; /* as they were given: only their addresses and numbers */
	struct bb_mesh *copy;
	size_t n;
	struct bb_mesh_embree *embree; /* or */
	struct bb_mesh_tree *tree;
};

static void *copied(const void *from, size_t bytes)
{
	void *to = malloc(bytes + 1);

	if (to && bytes)
		memcpy(to, from, bytes);
	return to;
}

static bool copy_meshes(struct bb_mesh_scene *s, const struct bb_mesh *meshes)
{
	for (size_t m = 0; m < s->n; m++) {
		struct bb_mesh *c = &s->copy[m];
		*c = s->source[m] = meshes[m];
		c->vertex_m = copied(c->vertex_m, c->n_vertices * sizeof(*c->vertex_m));
		c->rgba = copied(c->rgba, c->n_vertices * sizeof(*c->rgba));
		c->triangle = copied(c->triangle, c->n_triangles * sizeof(*c->triangle));
		if (!c->vertex_m || !c->rgba || !c->triangle)
			return false;
	}
	return true;
}

enum bb_status bb_mesh_scene_create(const struct bb_mesh *meshes, size_t n, bool own, struct bb_mesh_scene **out,
				    struct bb_error *err)
{
	*out = NULL;
	enum bb_status st = bb_meshes_check(meshes, n, err);
	if (st != BB_OK)
		return st;
	struct bb_mesh_scene *s = calloc(1, sizeof(*s));
	if (s) {
		s->source = calloc(n + 1, sizeof(*s->source));
		s->copy = calloc(n + 1, sizeof(*s->copy));
		s->n = s->source && s->copy ? n : 0;
	}
	if (!s || s->n != n || !copy_meshes(s, meshes)) {
		bb_mesh_scene_destroy(s);
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "copies of %zu meshes", n);
	}
	s->embree = own ? NULL : bb_mesh_embree_create(s->copy, n);
	if (!s->embree)
		st = bb_mesh_tree_create(s->copy, n, &s->tree, err);
	if (st != BB_OK) {
		bb_mesh_scene_destroy(s);
		return st;
	}
	*out = s;
	return BB_OK;
}

void bb_mesh_scene_destroy(struct bb_mesh_scene *s)
{
	if (!s)
		return;
	bb_mesh_embree_destroy(s->embree);
	bb_mesh_tree_destroy(s->tree);
	for (size_t m = 0; m < s->n; m++) {
		free((void *)s->copy[m].vertex_m);
		free((void *)s->copy[m].rgba);
		free((void *)s->copy[m].triangle);
	}
	free(s->source);
	free(s->copy);
	free(s);
}

bool bb_mesh_scene_is_of(const struct bb_mesh_scene *s, const struct bb_mesh *meshes, size_t n)
{
	if (s->n != n)
		return false;
	for (size_t m = 0; m < n; m++) {
		const struct bb_mesh *a = &s->source[m], *b = &meshes[m];
		if (a->vertex_m != b->vertex_m || a->rgba != b->rgba || a->triangle != b->triangle ||
		    a->n_vertices != b->n_vertices || a->n_triangles != b->n_triangles ||
		    a->generation != b->generation)
			return false;
	}
	return true;
}

const char *bb_mesh_scene_description(const struct bb_mesh_scene *s)
{
	return s->embree ? bb_mesh_embree_description(s->embree) : "a tree of our own";
}

void bb_mesh_scene_meets(const struct bb_mesh_scene *s, const struct bb_mesh_ray *ray, struct bb_mesh_fragments *out)
{
	if (s->embree)
		bb_mesh_embree_meets(s->embree, ray, out);
	else
		bb_mesh_tree_meets(s->tree, ray, out);
}
