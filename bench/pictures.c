#include "bench/pictures.h"

#include "bench/loop/light.h"
#include "render/levels.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PICTURES_CAP 1024

struct bb_pictures {
	struct bb_pictures_config config;
	size_t next;                       /* of scene->pictures.at_s */
	double at_s;                       /* of the frame that is due */
	double light, scene_s;             /* bb_pictures_fade */
	size_t n;
	struct bb_picture_result *taken;
};

enum bb_status bb_pictures_create(const struct bb_pictures_config *config, struct bb_pictures **out)
{
	struct bb_pictures *p = calloc(1, sizeof(*p));

	*out = NULL;
	if (!p)
		return BB_ERR_NOMEM;
	p->config = *config;
	p->light = 1;
	p->taken = calloc(PICTURES_CAP, sizeof(*p->taken));
	if (!p->taken) {
		free(p);
		return BB_ERR_NOMEM;
	}
	*out = p;
	return BB_OK;
}

void bb_pictures_destroy(struct bb_pictures *p)
{
	if (!p)
		return;
	free(p->taken);
	free(p);
}

bool bb_pictures_due(struct bb_pictures *p, double scene_s)
{
	const struct bb_scene *s = p->config.scene;
	bool due = false;

	while (p->next < s->pictures.n_at && scene_s >= s->pictures.at_s[p->next]) {
		p->at_s = s->pictures.at_s[p->next++];
		due = true;
	}
	return due;
}

void bb_pictures_fade(struct bb_pictures *p, double light, double scene_s)
{
	p->light = light;
	p->scene_s = scene_s;
}

bool bb_pictures_wants(const struct bb_pictures *p, uint16_t wall)
{
	const struct bb_scene *s = p->config.scene;

	return s->pictures.all_walls || !strcmp(s->pictures.wall, p->config.room->walls[wall].id);
}

static enum bb_status measure(struct bb_pictures *p, const struct bb_draw *draw, const struct bb_image *image,
                              struct bb_picture_result *r)
{
	struct bb_image_difference d = { 0 };
	struct bb_draw full = *draw;
	struct bb_image reference;
	enum bb_status status = bb_image_create(image->width, image->height, &reference);

	if (status != BB_OK)
		return status;
	const struct bb_stream_frame frame = { .views = draw->view, .n_views = 1, .width_px = image->width,
		                               .height_px = image->height, .step = draw->layers[0].atlas->time,
		                               .step_voxels = draw->step_voxels, .bricks_most = UINT32_MAX };
	bb_stream_settle(p->config.full, &frame);
	const struct bb_layer layer = bb_stream_layer(p->config.full);
	full.layers = &layer;
	status = bb_renderer_draw(p->config.renderer, &full, &reference, NULL);
	if (status == BB_OK)
		status = bb_image_compare(image, &reference, &d);
	if (status == BB_OK && d.n_pixels) {
		r->psnr_db = d.psnr_db;
		r->identical = d.identical;
	}
	bb_image_release(&reference);
	return status;
}

static enum bb_status paint(struct bb_pictures *p, const struct bb_view *view, const struct bb_stream *stream,
                            unsigned eye, const struct bb_vec3 *cursor, struct bb_image *image,
                            const char *screen, struct bb_picture_result *r)
{
	struct bb_draw_stats stats = { 0 };

	if (!stream)
		return bb_calibration_draw(view, screen, eye == 0, cursor, image);
	const struct bb_layer layer = bb_stream_layer(stream);
	const struct bb_draw draw = { .view = view, .layers = &layer, .n_layers = 1,
		                      .step_voxels = p->config.scene->data.step_voxels };
	enum bb_status status = bb_renderer_draw(p->config.renderer, &draw, image, &stats);
	r->rays = stats.rays;
	r->samples = stats.samples;
	if (status == BB_OK && p->config.full)
		status = measure(p, &draw, image, r);
	return status;
}

/* Beside what the first eye sees: how fine it is. */
static enum bb_status take_levels(struct bb_pictures *p, const struct bb_view *view, const struct bb_stream *stream,
                                  const struct bb_picture_result *eye, struct bb_error *err)
{
	const struct bb_layer layer = bb_stream_layer(stream);
	struct bb_picture_result *r = &p->taken[p->n];
	struct bb_image image;
	char path[BB_PATH_MAX_BYTES];

	if (p->n == PICTURES_CAP)
		return BB_OK;
	*r = *eye;
	r->psnr_db = (double)NAN;
	r->identical = false;
	r->rays = r->samples = 0;
	snprintf(r->eye, sizeof(r->eye), "levels");
	snprintf(r->file, sizeof(r->file), "%s-levels-%06.2fs.png", r->wall, r->at_s);
	enum bb_status status = bb_image_create(r->width, r->height, &image);
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "a picture of %u x %u", r->width, r->height);
	status = bb_levels_draw(view, &layer, &image);
	snprintf(path, sizeof(path), "%s/%s", p->config.dir, r->file);
	if (status == BB_OK)
		status = bb_image_write_png(&image, path, err);
	bb_image_release(&image);
	p->n += status == BB_OK;
	return status;
}

enum bb_status bb_pictures_take(struct bb_pictures *p, uint16_t screen, unsigned eye, unsigned n_eyes,
                                const struct bb_view *view, const struct bb_stream *stream,
                                const struct bb_vec3 *cursor, struct bb_error *err)
{
	static const char *const eyes[] = { "left", "right", "mono" };
	const struct bb_screen *s = &p->config.room->screens[screen];
	const double scale = p->config.scene->pictures.scale > 0 ? p->config.scene->pictures.scale : 1;
	const unsigned word = n_eyes == 1 ? 2 : eye;
	struct bb_image image;

	if (p->n == PICTURES_CAP || (n_eyes == 2 && !(p->config.scene->pictures.eyes >> eye & 1)))
		return BB_OK;
	struct bb_picture_result *r = &p->taken[p->n];
	*r = (struct bb_picture_result){ .at_s = p->at_s, .screen = screen, .psnr_db = (double)NAN };
	snprintf(r->wall, sizeof(r->wall), "%s", s->id);
	snprintf(r->eye, sizeof(r->eye), "%s", eyes[word]);
	snprintf(r->file, sizeof(r->file), "%s-%s-%06.2fs.png", s->id, eyes[word], p->at_s);
	r->width = (uint32_t)fmax(1, scale * (double)s->display.width_px);
	r->height = (uint32_t)fmax(1, scale * (double)s->display.height_px);
	enum bb_status status = bb_image_create(r->width, r->height, &image);
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "a picture of %u x %u", r->width, r->height);
	status = paint(p, view, stream, eye, cursor, &image, s->id, r);
	bb_patch_draw(p->config.room, p->config.scene, screen, p->scene_s, &image);
	if (p->light < 1)
		bb_light_fade(&image, p->light);
	if (status == BB_OK && p->config.dir) {
		char path[BB_PATH_MAX_BYTES];
		snprintf(path, sizeof(path), "%s/%s", p->config.dir, r->file);
		status = bb_image_write_png(&image, path, err);
	}
	bb_image_release(&image);
	if (status != BB_OK)
		return status;
	p->n++;
	if (!stream || !p->config.dir || !p->config.scene->pictures.levels || eye)
		return BB_OK;
	const struct bb_picture_result first = *r;
	return take_levels(p, view, stream, &first, err);
}

size_t bb_pictures_count(const struct bb_pictures *p, const struct bb_picture_result **out)
{
	*out = p->taken;
	return p->n;
}
