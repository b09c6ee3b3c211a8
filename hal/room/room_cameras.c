/*
 * hal/room/room_cameras.c: the cameras of a room: where they hang, what they look at, and through which lens.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hal/room/room_build.h"

#define RAD_PER_DEG (3.14159265358979323846 / 180.0)
#define MOST_OFF_AXIS_RAD 1.52 /* 87 degrees: further no plane in front of a lens reaches */
#define TEXT(key, type, member, must, help) \
	{ key, BB_OPT_TYPE_TEXT, offsetof(type, member), sizeof(((type *)0)->member), 0, 1, 0, 1, "", must, help }
#define F64(key, type, member, def, lo, hi, help) \
	{ key, BB_OPT_TYPE_F64, offsetof(type, member), 0, def, lo, hi, 1, NULL, false, help }

#define C struct room_camera_draft

const struct bb_option room_camera_options[] = {
	TEXT("id", C, ids, true, "id, or a row of ids: c01..c08"),
	TEXT("device", C, camera.device, false, "back end"),
	F64("fov_deg", C, camera.fov_deg, 56, 5, 150, "horizontal, full angle"),
	F64("focal_px", C, focal_px, 0, 1, 1e5, "focal length; given, fov_deg follows from it"),
	{ "lens", BB_OPT_TYPE_ENUM, offsetof(C, camera.lens), 0, BB_LENS_BROWN, 0, 0, 1, "brown-conrady|fisheye", false,
	  "what the coefficients belong to" },
	F64("k1", C, camera.k1, 0, -1, 1, "radial distortion, r^2 (fisheye: angle^2)"),
	F64("k2", C, camera.k2, 0, -1, 1, "radial distortion, r^4"),
	F64("k3", C, camera.k3, 0, -1, 1, "radial distortion, r^6"),
	F64("k4", C, camera.k4, 0, -1, 1, "radial distortion, angle^8: fisheye only"),
	F64("p1", C, camera.p1, 0, -0.1, 0.1, "tangential distortion: brown-conrady only"),
	F64("p2", C, camera.p2, 0, -0.1, 0.1, "tangential distortion: brown-conrady only"),
	F64("rate_hz", C, rate_hz, 60, 1, 1000, "frames a second"),
	{ "sync", BB_OPT_TYPE_ENUM, offsetof(C, camera.sync), 0, BB_SYNC_FREE, 0, 0, 1, "free|shutters|display", false,
	  "where the rhythm of the exposures comes from" },
	F64("sync_offset_us", C, camera.sync_offset_us, 0, 0, 100000, "exposure begins this long after its edge"),
	F64("exposure_us", C, camera.exposure_us, 1000, 1, 100000, "strobe and exposure"),
	F64("readout_us", C, camera.readout_us, 4000, 0, 100000, "end of exposure to end of read-out"),
	F64("row_us", C, camera.row_us, 0, 0, 100, "of a rolling shutter: row to row, downwards"),
	F64("transfer_us", C, camera.transfer_us, 1000, 0, 100000, "end of read-out to arrival on the host"),
	F64("transfer_jitter_us", C, camera.transfer_jitter_us, 100, 0, 100000, "simulated, sd"),
	F64("noise_px", C, camera.noise_px, 0.05, 0, 10, "simulated error of a blob's centre, sd, each axis"),
	BB_OPT_END
};

void room_camera_defaults(struct room_camera_draft *d)
{
	memset(d, 0, sizeof(*d));
	bb_options_defaults(room_camera_options, d);
}

static enum bb_status read_ends(struct bb_reader *r, const struct bb_yaml_node *v, struct bb_vec3 ends[2])
{
	const struct bb_yaml_node *from = bb_yaml_get(v, "from"), *to = bb_yaml_get(v, "to");
	enum bb_status status;

	if (v->kind != BB_YAML_MAP) {
		status = bb_yaml_vec3(r, v, BB_ROOM_SPAN_M, 1, &ends[0]);
		ends[1] = ends[0];
		return status;
	}
	if (!from || !to || v->n != 2)
		return bb_yaml_fail(r, 1019, v, "wanted [x, y, z] or {from: [x, y, z], to: [x, y, z]}");
	status = bb_yaml_vec3(r, from, BB_ROOM_SPAN_M, 1, &ends[0]);
	return status ? status : bb_yaml_vec3(r, to, BB_ROOM_SPAN_M, 1, &ends[1]);
}

static enum bb_status read_position(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_camera_draft *d = target;
	return read_ends(r, v, d->position);
}

static enum bb_status read_target(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_camera_draft *d = target;
	return read_ends(r, v, d->target);
}

static enum bb_status read_camera_pixels(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_camera_draft *d = target;
	return bb_yaml_pixels(r, v, &d->camera.width_px, &d->camera.height_px);
}

/* `centre_px: [x, y]`: where the optical axis meets the sensor. */
static enum bb_status read_centre(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct room_camera_draft *d = target;

	d->has_centre = true;
	return bb_yaml_numbers(r, v, 2, -1e5, 1e5, 1, d->centre_px);
}

enum bb_status room_read_camera_default(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "pixels", read_camera_pixels, false },
		                                          { "centre_px", read_centre, false },
		                                          { "look_at_m", read_target, false },
		                                          { NULL, NULL, false } };
	struct room_build *b = target;
	const enum bb_status status = bb_yaml_walk(r, value, room_camera_options + 1, branches, &b->camera, BB_YAML_PARTIAL);

	b->camera.has_target = !status && bb_yaml_get(value, "look_at_m");
	return status;
}

/* The radial part and its slope, of the tangent of the angle off the axis or of a fisheye's angle itself. */
static double radial(const struct bb_camera_config *c, double t)
{
	const double s = t * t;
	return t * (1 + s * (c->k1 + s * (c->k2 + s * (c->k3 + s * c->k4))));
}

static double radial_slope(const struct bb_camera_config *c, double t)
{
	const double s = t * t;
	return 1 + s * (3 * c->k1 + s * (5 * c->k2 + s * (7 * c->k3 + s * 9 * c->k4)));
}

/* How far from the axis the picture reaches, in units of the focal length: its corner; of a fisheye, whose corners may stay
 * black, its farther edge. */
static double reach(const struct bb_camera_config *c)
{
	const double x = fmax(c->cx_px + 0.5, (double)c->width_px - 0.5 - c->cx_px) / c->fx_px;
	const double y = fmax(c->cy_px + 0.5, (double)c->height_px - 0.5 - c->cy_px) / c->fy_px;

	return c->lens == BB_LENS_FISHEYE ? fmax(x, y) : hypot(x, y);
}

/* Does distortion keep growing as far as the picture reaches? Otherwise two rays share a pixel and none can be undone.
 * The tangential part takes up to 6 |p| t off the slope. */
bool room_lens_unfolds(const struct bb_camera_config *c)
{
	const double far = reach(c), bend = 6 * hypot(c->p1, c->p2);
	const double most = c->lens == BB_LENS_FISHEYE ? fmin(4 * far, MOST_OFF_AXIS_RAD) : 4 * far;

	for (int i = 0; i <= 4000; i++) {
		const double t = most * i / 4000;
		if (radial(c, t) >= far)
			return true;
		if (!(radial_slope(c, t) - bend * t > 0.05))
			return false;
	}
	return false;
}

/* Camera space is x right, y down, z forward: bb_pose_look_at's (y up, -z forward) turned by 180 degrees about x. */
static struct bb_pose camera_pose(struct bb_vec3 position, struct bb_vec3 target)
{
	const struct bb_quat flip = { 1, 0, 0, 0 };
	struct bb_pose pose = bb_pose_look_at(position, target, (struct bb_vec3){ 0, 1, 0 });

	pose.q = bb_quat_unit(bb_quat_mul(pose.q, flip));
	return pose;
}

static enum bb_status check_camera(struct room_build *b, const struct room_camera_draft *d,
                                   const struct bb_camera_config *c)
{
	const struct bb_reader *r = &b->r;

	if (c->exposure_us >= 1e6 / d->rate_hz)
		return bb_yaml_fail(r, 1110, d->at, "'%s' exposes longer than its period of %.0f us", c->id, 1e6 / d->rate_hz);
	if (c->row_us * (double)(c->height_px - 1) / 2 > c->readout_us)
		return bb_yaml_fail(r, 1110, d->at, "'%s': its last row exposes %.0f us after the middle one, longer than readout_us",
		                    c->id, c->row_us * (double)(c->height_px - 1) / 2);
	if (c->sync == BB_SYNC_SHUTTERS && !b->room->has_chain)
		return bb_yaml_fail(r, 1118, d->at, "'%s' follows shutters the room does not have", c->id);
	if (c->lens == BB_LENS_FISHEYE && (c->p1 != 0 || c->p2 != 0))
		return bb_yaml_fail(r, 1110, d->at, "'%s': p1 and p2 belong to the lens brown-conrady", c->id);
	if (c->lens != BB_LENS_FISHEYE && c->k4 != 0)
		return bb_yaml_fail(r, 1110, d->at, "'%s': k4 belongs to the lens fisheye", c->id);
	if (!(c->fov_deg >= 1 && c->fov_deg <= 170))
		return bb_yaml_fail(r, 1110, d->at, "'%s' with focal_px %g sees %.3g degrees; 1 to 170 will do", c->id, c->fx_px,
		                    c->fov_deg);
	if (!(c->cx_px > -0.5 && c->cy_px > -0.5 && c->cx_px < (double)c->width_px - 0.5 &&
	      c->cy_px < (double)c->height_px - 0.5))
		return bb_yaml_fail(r, 1110, d->at, "'%s': its centre_px [%g, %g] is outside the picture", c->id, c->cx_px,
		                    c->cy_px);
	if (!room_lens_unfolds(c))
		return bb_yaml_fail(r, 1110, d->at, "'%s': the lens (k1 %g, k2 %g, k3 %g) folds the picture's corners back",
		                    c->id, c->k1, c->k2, c->k3);
	for (size_t i = 0; i < b->room->n_cameras; i++)
		if (!strcmp(b->room->cameras[i].id, c->id))
			return bb_yaml_fail(r, 1105, d->at, "camera '%s'", c->id);
	return BB_OK;
}

static void set_intrinsics(struct bb_camera_config *c, const struct room_camera_draft *d)
{
	const double half = (double)c->width_px / 2, half_rad = c->fov_deg / 2 * RAD_PER_DEG;
	const bool fisheye = c->lens == BB_LENS_FISHEYE;

	if (d->focal_px > 0) {
		c->fx_px = d->focal_px;
		c->fov_deg = 2 / RAD_PER_DEG * (fisheye ? half / c->fx_px : atan(half / c->fx_px));
	} else {
		c->fx_px = half / (fisheye ? half_rad : tan(half_rad));
	}
	c->fy_px = c->fx_px;
	/* pixel (0, 0) is a pixel's centre, so the middle of the picture lies half a pixel before width / 2 */
	c->cx_px = d->has_centre ? d->centre_px[0] : ((double)c->width_px - 1) / 2;
	c->cy_px = d->has_centre ? d->centre_px[1] : ((double)c->height_px - 1) / 2;
}

static enum bb_status add_camera(struct room_build *b, const struct room_camera_draft *d, const struct room_ids *ids,
                                 unsigned i)
{
	const double t = ids->n > 1 ? (double)i / (ids->n - 1) : 0;
	const struct bb_vec3 position = bb_vec3_lerp(d->position[0], d->position[1], t);
	const struct bb_vec3 target = bb_vec3_lerp(d->target[0], d->target[1], t);
	struct bb_camera_config c = d->camera;
	enum bb_status status;

	room_ids_at(ids, i, c.id);
	if (bb_vec3_norm(bb_vec3_sub(target, position)) < 1e-3)
		return bb_yaml_fail(&b->r, 1110, d->at, "'%s' looks at itself", c.id);
	c.pose = camera_pose(position, target);
	c.rate = room_rate(d->rate_hz);
	set_intrinsics(&c, d);
	status = check_camera(b, d, &c);
	if (!status)
		b->room->cameras[b->room->n_cameras++] = c;
	return status;
}

static enum bb_status read_camera(struct room_build *b, const struct bb_yaml_node *entry)
{
	const struct bb_yaml_branch branches[] = { { "pixels", read_camera_pixels, b->camera.camera.width_px == 0 },
		                                   { "centre_px", read_centre, false },
		                                   { "position_m", read_position, true },
		                                   { "look_at_m", read_target, !b->camera.has_target },
		                                   { NULL, NULL, false } };
	struct room_camera_draft d = b->camera;
	struct room_ids ids = { .n = 0 };
	struct bb_room *room = b->room;
	enum bb_status status;

	d.at = entry;
	if (bb_yaml_get(entry, "fov_deg")) /* what an entry says beats the defaults, whichever of the two keys they have */
		d.focal_px = 0;
	if (bb_yaml_get(entry, "fov_deg") && bb_yaml_get(entry, "focal_px"))
		return bb_yaml_fail(&b->r, 1110, entry, "fov_deg and focal_px say the same; give one of them");
	status = bb_yaml_walk(&b->r, entry, room_camera_options, branches, &d, 0);
	if (!status)
		status = room_ids_parse(&b->r, entry, d.ids, &ids);
	if (!status)
		status = room_check_device(b, entry, d.camera.device);
	if (!status)
		status = room_grow(b, entry, &room->cameras, sizeof(*room->cameras), room->n_cameras, ids.n,
		                   BB_ROOM_CAMERAS_MAX, "cameras");
	for (unsigned i = 0; !status && i < ids.n; i++)
		status = add_camera(b, &d, &ids, i);
	return status;
}

enum bb_status room_read_cameras(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	(void)target;
	struct room_build *b = bb_container_of(r, struct room_build, r);
	enum bb_status status = bb_yaml_want(r, value, BB_YAML_LIST);

	for (const struct bb_yaml_node *c = value->first; c && !status; c = c->next)
		status = read_camera(b, c);
	return status;
}

static bool pixel_of(const struct bb_camera_config *camera, struct bb_vec3 p, double px[2])
{
	const struct bb_vec3 c = bb_pose_inverse_apply(&camera->pose, p);

	if (!(c.z > 0.05))
		return false;
	const double x = c.x / c.z, y = c.y / c.z, r = hypot(x, y);
	const double t = camera->lens == BB_LENS_FISHEYE ? atan(r) : r, far = hypot((double)camera->width_px / camera->fx_px,
	                                                                            (double)camera->height_px / camera->fy_px);
	/* Beyond the picture's corner a distortion may fold back: what leaves the undistorted cone by far is not seen. */
	if (t > 2 * far || radial_slope(camera, t) <= 0)
		return false;
	const double f = r > 0 ? radial(camera, t) / r : 1;
	const double xd = x * f + 2 * camera->p1 * x * y + camera->p2 * (r * r + 2 * x * x);
	const double yd = y * f + camera->p1 * (r * r + 2 * y * y) + 2 * camera->p2 * x * y;
	px[0] = camera->cx_px + camera->fx_px * xd;
	px[1] = camera->cy_px + camera->fy_px * yd;
	return true;
}

bool bb_camera_sees(const struct bb_camera_config *camera, struct bb_vec3 p, double margin_px)
{
	double px[2];

	return pixel_of(camera, p, px) && px[0] >= margin_px && px[1] >= margin_px &&
	       px[0] <= (double)(camera->width_px - 1) - margin_px && px[1] <= (double)(camera->height_px - 1) - margin_px;
}
