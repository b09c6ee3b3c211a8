/*
 * bench/loop/light.h: how bright every wall is to each eye, frame by frame, for the flash meter: what the pictures show,
 * times what the shutters and the glasses let through as told by their edges, times the fade. Of pictures that are drawn
 * the pixels are taken; else the calibration pattern as drawn once, and of a volume the brightest colour its transfer
 * function has, which no picture of it exceeds. Memory is taken at creation. One thread.
 */
#ifndef BB_BENCH_LOOP_LIGHT_H
#define BB_BENCH_LOOP_LIGHT_H

#include "hal/room.h"
#include "hal/scene.h"
#include "render/renderer.h"
#include "sync/flash_meter.h"

struct bb_light;

struct bb_light_config {
	const struct bb_room *room;
	const struct bb_scene *scene;
	const struct bb_transfer *transfer; /* NULL: no volume */
	struct bb_vec3 viewer;
	int64_t coast_ns;                   /* of the chain: hal/shutter.h */
	bool drawn;                         /* every frame is: bb_light_pixels comes for each picture */
};

BB_MUST_CHECK enum bb_status bb_light_create(const struct bb_light_config *c, struct bb_light **out);
void bb_light_destroy(struct bb_light *l); /* NULL allowed */
/* Of the shutters: an edge; all of them opened; what they do from now on is their own clocks' affair. */
void bb_light_edge(struct bb_light *l, const struct bb_shutter_edge *e);
void bb_light_open(struct bb_light *l, int64_t at_ns);
/* Of the displays: how much of the light asked for does this screen show? 0: it is dark. */
void bb_light_screen(struct bb_light *l, uint16_t screen, double share);
/* Of the pictures: pixels of a screen for an eye (mono: 0), as they will be shown. */
void bb_light_pixels(struct bb_light *l, uint16_t screen, unsigned eye, const struct bb_image *image);
/* Of the scene's patch: what it shows at this time of the scene. */
void bb_light_patch(struct bb_light *l, double t_s);
/* A frame ends: the light since the last one goes to the meter. fade: of pictures that are not drawn, 0..1. */
void bb_light_frame(struct bb_light *l, int64_t now_ns, double fade);
/* Starts afresh at now: nothing is known of the time before (a gap). */
void bb_light_skip(struct bb_light *l, int64_t now_ns);
const struct bb_flash_meter *bb_light_meter(const struct bb_light *l);
/* What an eye gets of white through running shutters over what it gets through open ones. */
double bb_light_dim(const struct bb_room *room);
/* What the pictures of a wall show an eye, for tests. */
const struct bb_flash_grid *bb_light_grid(const struct bb_light *l, unsigned wall, unsigned eye);
/* Mean since the last frame of what an eye gets of white on a wall, 0..1: for tests. */
double bb_light_seen(const struct bb_light *l, unsigned wall, unsigned eye);

/* Scales pixels in linear light, as a fade does. */
void bb_light_fade(struct bb_image *image, double fade);

/* The patch of a scene at a time after its begin: its brighter grey? Its square on a picture, in pixels. */
bool bb_patch_is_high(const struct bb_scene *s, double t_s);
void bb_patch_draw(const struct bb_room *room, const struct bb_scene *s, uint16_t screen, double t_s,
                   struct bb_image *image);

/* Would the scene flash by itself, its patch or its steps, before any fault? means: [n_steps] colours of the steps in
 * linear light, or NULL; fade: of all pictures. */
BB_MUST_CHECK enum bb_status bb_light_foresee(const struct bb_room *room, const struct bb_scene *scene,
                                              const float (*means)[3], uint32_t n_steps, double fade,
                                              struct bb_flash_worst *out);

#endif
