/* bench/loop/seeing.c: see bench/loop/seeing.h. */
#include "bench/loop/seeing.h"

#include <stdlib.h>

#include "sync/blobs/blobs.h"

struct bb_seeing {
	struct bb_blob_finder **finder; /* by camera; NULL: it finds its own blobs */
	int64_t *width_px;
	size_t n;
	uint8_t *grey;                  /* of the largest picture */
	struct bb_spot spot[BB_CAMERA_BLOBS_MAX];
};

static enum bb_status take(struct bb_seeing *s, const struct bb_camera_config *configs, struct bb_camera *const *cameras,
                           struct bb_error *err)
{
	enum bb_status status = BB_OK;
	size_t most = 1;

	s->finder = calloc(s->n + 1, sizeof(struct bb_blob_finder *));
	s->width_px = calloc(s->n + 1, sizeof(*s->width_px));
	if (!s->finder || !s->width_px)
		return BB_ERR_NOMEM;
	for (size_t i = 0; i < s->n && status == BB_OK; i++) {
		const struct bb_camera_config *c = &configs[i];
		const struct bb_camera_limits *limits = cameras[i] ? bb_camera_limits(cameras[i]) : NULL;
		if (!limits || !limits->grey)
			continue;
		const struct bb_blobs_config finder = bb_blobs_above(limits->black, limits->black_noise);
		status = bb_blob_finder_create(&finder, c->width_px, c->height_px, &s->finder[i]);
		if (status == BB_ERR_RANGE)
			return bb_fail(err, BB_ERR_CONFIG, 1722, NULL, "camera/%s: black %g, noise %g, %lld x %lld pixels", c->id,
			               limits->black, limits->black_noise, (long long)c->width_px, (long long)c->height_px);
		s->width_px[i] = c->width_px;
		const size_t pixels = status == BB_OK ? (size_t)c->width_px * (size_t)c->height_px : 0;
		most = pixels > most ? pixels : most;
	}
	s->grey = status == BB_OK ? malloc(most) : NULL;
	return status == BB_OK && !s->grey ? BB_ERR_NOMEM : status;
}

enum bb_status bb_seeing_create(const struct bb_camera_config *configs, struct bb_camera *const *cameras, size_t n,
                                struct bb_seeing **out, struct bb_error *err)
{
	bool any = false;

	*out = NULL;
	for (size_t i = 0; i < n; i++)
		any |= cameras[i] && bb_camera_limits(cameras[i])->grey;
	if (!any)
		return BB_OK;
	struct bb_seeing *s = calloc(1, sizeof(*s));
	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "blob finders");
	s->n = n;
	const enum bb_status status = take(s, configs, cameras, err);
	if (status != BB_OK) {
		bb_seeing_destroy(s);
		return bb_fail(err, status, 1702, NULL, "blob finders");
	}
	*out = s;
	return BB_OK;
}

void bb_seeing_destroy(struct bb_seeing *s)
{
	if (!s)
		return;
	for (size_t i = 0; i < s->n && s->finder; i++)
		bb_blob_finder_destroy(s->finder[i]);
	free(s->finder);
	free(s->width_px);
	free(s->grey);
	free(s);
}

static void look(struct bb_seeing *s, size_t camera, struct bb_camera_frame *frame)
{
	const size_t cap = frame->cap < BB_ARRAY_LEN(s->spot) ? frame->cap : BB_ARRAY_LEN(s->spot);
	const struct bb_blobs_found found = bb_blobs_find(s->finder[camera], frame->grey, (size_t)s->width_px[camera], s->spot, cap);

	for (size_t i = 0; i < found.n; i++)
		frame->blobs[i] = bb_spot_blob(&s->spot[i]);
	frame->n = found.n;
	frame->overflow = found.overflow;
}

enum bb_status bb_seeing_read(struct bb_seeing *s, size_t camera, struct bb_camera *cam, struct bb_camera_frame *frame)
{
	frame->grey = s && s->finder[camera] ? s->grey : NULL;
	const enum bb_status status = bb_camera_read(cam, frame);
	if (status == BB_OK && s && frame->has_grey)
		look(s, camera, frame);
	return status;
}
