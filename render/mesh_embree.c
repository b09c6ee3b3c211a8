/*
 * render/mesh_embree.c: which triangles a ray may meet, by Embree 3 (Wald et al. 2014). Its filter function sees every
 * candidate and turns all of them down, so that the ray goes on; bb_mesh_ray_meets decides in double. Embree counts in
 * float and may find the ray on one side of a shared edge where double finds it on the other: a candidate that double
 * turned down stands in when nothing of its mesh was met where it lies, so that no edge becomes a gap.
 */
#include "render/mesh_scene.h"

#include <dlfcn.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <embree3/rtcore.h>

#define LIBRARY "libembree3.so.3"
#define DOUBTS_MOST 8
#define SAME_PLACE 1e-4 /* of the distance: farther apart than float could move it */

struct library {
	void *handle;
	RTCDevice (*new_device)(const char *config);
	void (*release_device)(RTCDevice device);
	ssize_t (*device_property)(RTCDevice device, enum RTCDeviceProperty property);
	RTCScene (*new_scene)(RTCDevice device);
	void (*release_scene)(RTCScene scene);
	void (*scene_flags)(RTCScene scene, enum RTCSceneFlags flags);
	void (*commit_scene)(RTCScene scene);
	RTCGeometry (*new_geometry)(RTCDevice device, enum RTCGeometryType type);
	void (*release_geometry)(RTCGeometry geometry);
	void *(*new_buffer)(RTCGeometry geometry, enum RTCBufferType type, unsigned slot, enum RTCFormat format,
			    size_t stride, size_t n);
	void (*filter)(RTCGeometry geometry, RTCFilterFunctionN filter);
	void (*commit_geometry)(RTCGeometry geometry);
	void (*attach)(RTCScene scene, RTCGeometry geometry, unsigned id);
	void (*occluded)(RTCScene scene, struct RTCIntersectContext *context, struct RTCRay *ray);
};

struct bb_mesh_embree {
	struct library lib;
	RTCDevice device;
	RTCScene scene;
	const struct bb_mesh *meshes;
	char description[32];
};

struct look { /* what the filter finds behind Embree's context */
	struct RTCIntersectContext context; /* first */
	const struct bb_mesh *meshes;
	const struct bb_mesh_ray *ray;
	struct bb_mesh_fragments *out;
	size_t n_doubts;
	struct bb_mesh_fragment doubt[DOUBTS_MOST];
};

static bool load_library(struct library *l)
{
	const struct {
		const char *name;
		void *to;
	} functions[] = {
		{ "rtcNewDevice", &l->new_device },
		{ "rtcReleaseDevice", &l->release_device },
		{ "rtcGetDeviceProperty", &l->device_property },
		{ "rtcNewScene", &l->new_scene },
		{ "rtcReleaseScene", &l->release_scene },
		{ "rtcSetSceneFlags", &l->scene_flags },
		{ "rtcCommitScene", &l->commit_scene },
		{ "rtcNewGeometry", &l->new_geometry },
		{ "rtcReleaseGeometry", &l->release_geometry },
		{ "rtcSetNewGeometryBuffer", &l->new_buffer },
		{ "rtcSetGeometryOccludedFilterFunction", &l->filter },
		{ "rtcCommitGeometry", &l->commit_geometry },
		{ "rtcAttachGeometryByID", &l->attach },
		{ "rtcOccluded1", &l->occluded },
	};

	/* Never unloaded: it leaves the threads of its task scheduler behind. */
	l->handle = dlopen(LIBRARY, RTLD_LAZY | RTLD_LOCAL | RTLD_NODELETE);
	for (size_t i = 0; l->handle && i < BB_ARRAY_LEN(functions); i++) {
		void *symbol = dlsym(l->handle, functions[i].name);
		if (!symbol)
			return false;
		/* POSIX gives functions out as object pointers; copying the bytes is the way ISO C leaves open. */
		memcpy(functions[i].to, &symbol, sizeof(symbol));
	}
	return l->handle != NULL;
}

/* ---- candidates ---- */

static void doubt(struct look *k, const struct RTCHit *hit, float at_m, struct bb_mesh_fragment f)
{
	const double weight[3] = { 1 - (double)hit->u - (double)hit->v, (double)hit->u, (double)hit->v };

	if (k->n_doubts == DOUBTS_MOST)
		return;
	f.at_m = (double)at_m;
	bb_mesh_colour(&k->meshes[f.mesh], f.triangle, weight, f.rgba);
	k->doubt[k->n_doubts++] = f;
}

static void candidate(const struct RTCFilterFunctionNArguments *args)
{
	struct look *k = (struct look *)args->context;
	struct RTCRay ray;
	struct RTCHit hit;

	/* One ray has the layout of the single structs, but not their alignment. */
	memcpy(&ray, args->ray, sizeof(ray));
	memcpy(&hit, args->hit, offsetof(struct RTCHit, instID));
	struct bb_mesh_fragment f = { .mesh = hit.geomID, .triangle = hit.primID };
	args->valid[0] = 0;
	if (bb_mesh_ray_meets(k->ray, &k->meshes[f.mesh], f.triangle, &f))
		bb_mesh_fragments_add(k->out, &f);
	else
		doubt(k, &hit, ray.tfar, f);
}

static bool met_there(const struct bb_mesh_fragments *out, const struct bb_mesh_fragment *f)
{
	for (size_t i = 0; i < out->n; i++)
		if (out->at[i].mesh == f->mesh && fabs(out->at[i].at_m - f->at_m) <= SAME_PLACE * f->at_m)
			return true;
	return false;
}

void bb_mesh_embree_meets(const struct bb_mesh_embree *e, const struct bb_mesh_ray *ray, struct bb_mesh_fragments *out)
{
	struct look k = { .meshes = e->meshes, .ray = ray, .out = out };
	struct RTCRay r = { .org_x = (float)ray->from[0],      .org_y = (float)ray->from[1],
			    .org_z = (float)ray->from[2],      .dir_x = (float)ray->direction[0],
			    .dir_y = (float)ray->direction[1], .dir_z = (float)ray->direction[2],
			    .tfar = HUGE_VALF,                 .mask = ~0U };

	rtcInitIntersectContext(&k.context);
	out->n = 0;
	e->lib.occluded(e->scene, &k.context, &r);
	for (size_t i = 0; i < k.n_doubts; i++)
		if (k.doubt[i].at_m > 0 && !met_there(out, &k.doubt[i]))
			bb_mesh_fragments_add(out, &k.doubt[i]);
}

/* ---- the scene ---- */

static bool attach_mesh(struct bb_mesh_embree *e, const struct bb_mesh *m, unsigned id)
{
	RTCGeometry g = e->lib.new_geometry(e->device, RTC_GEOMETRY_TYPE_TRIANGLE);
	void *vertex = g ? e->lib.new_buffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(*m->vertex_m),
					     m->n_vertices)
			 : NULL;
	void *index = g ? e->lib.new_buffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(*m->triangle),
					    m->n_triangles)
			: NULL;

	if (vertex && index) {
		memcpy(vertex, m->vertex_m, m->n_vertices * sizeof(*m->vertex_m));
		memcpy(index, m->triangle, m->n_triangles * sizeof(*m->triangle));
		e->lib.filter(g, candidate);
		e->lib.commit_geometry(g);
		e->lib.attach(e->scene, g, id);
	}
	if (g)
		e->lib.release_geometry(g);
	return vertex && index;
}

static bool fill(struct bb_mesh_embree *e, size_t n)
{
	/* One thread, the caller's: a draw must not start others behind its back. */
	e->device = e->lib.new_device("threads=1,set_affinity=0");
	e->scene = e->device ? e->lib.new_scene(e->device) : NULL;
	if (!e->scene)
		return false;
	e->lib.scene_flags(e->scene, RTC_SCENE_FLAG_ROBUST);
	for (size_t m = 0; m < n; m++)
		if (e->meshes[m].n_triangles && !attach_mesh(e, &e->meshes[m], (unsigned)m))
			return false;
	e->lib.commit_scene(e->scene);
	const ssize_t v = e->lib.device_property(e->device, RTC_DEVICE_PROPERTY_VERSION);
	snprintf(e->description, sizeof(e->description), "Embree %d.%d.%d", (int)(v / 10000 % 100), (int)(v / 100 % 100),
		 (int)(v % 100));
	return true;
}

struct bb_mesh_embree *bb_mesh_embree_create(const struct bb_mesh *meshes, size_t n)
{
	struct bb_mesh_embree *e = calloc(1, sizeof(*e));

	if (!e)
		return NULL;
	e->meshes = meshes;
	if (load_library(&e->lib) && fill(e, n))
		return e;
	bb_mesh_embree_destroy(e);
	return NULL;
}

void bb_mesh_embree_destroy(struct bb_mesh_embree *e)
{
	if (!e)
		return;
	if (e->scene)
		e->lib.release_scene(e->scene);
	if (e->device)
		e->lib.release_device(e->device);
	if (e->lib.handle)
		dlclose(e->lib.handle); /* balances the count; the library stays */
	free(e);
}

const char *bb_mesh_embree_description(const struct bb_mesh_embree *e)
{
	return e->description;
}
