/* hal/room/calibration.c: see calibration.h. */
#include "hal/room/calibration.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "hal/room/room_build.h"

#define FORMAT 1

void bb_calibration_hash(const struct bb_camera_config *cameras, size_t n, char out[BB_HASH_HEX])
{
	struct bb_hash h;
	char line[640];

	memset(out, 0, BB_HASH_HEX);
	if (!bb_hash_init(&h))
		return;
	for (size_t i = 0; i < n; i++) {
		const struct bb_camera_config *c = &cameras[i];
		/* nine digits: what a room file says survives, the last bit of a libm's tangent does not matter */
		const int used = snprintf(line, sizeof(line), "%s %lld %lld %d %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g "
		                          "%.6f %.6f %.6f %.6f %.6f %.6f %.6f\n", c->id, (long long)c->width_px,
		                          (long long)c->height_px, (int)c->lens, c->fx_px, c->fy_px, c->cx_px, c->cy_px, c->k1,
		                          c->k2, c->k3, c->k4, c->p1, c->p2, c->pose.p.x, c->pose.p.y, c->pose.p.z, c->pose.q.x,
		                          c->pose.q.y, c->pose.q.z, c->pose.q.w);
		bb_hash_update(&h, line, used > 0 && (size_t)used < sizeof(line) ? (size_t)used : sizeof(line) - 1);
	}
	bb_hash_final_hex(&h, out);
}

/* Writing */

void bb_calibration_write(FILE *out, const struct bb_calibration_head *head, const struct bb_camera_config *cameras,
                          size_t n)
{
	const struct bb_pose *m = &head->moved;

	fprintf(out, "# Cameras as they really hang and see; `calibration: FILE` in the room file uses them. Made by blackburst.\n");
	fprintf(out, "calibration: %d\nroom: \"%s\"\nmade: \"%s\"\nrms_px: %.6f\n", FORMAT, head->room, head->made,
	        head->rms_px);
	fprintf(out, "room_sha256: \"%s\"\ncameras_sha256: \"%s\"\nsequence_sha256: \"%s\"\n", head->room_sha256,
	        head->cameras_sha256, head->sequence_sha256);
	fprintf(out, "moved_m: [%.9f, %.9f, %.9f]\nturned: [%.12f, %.12f, %.12f, %.12f]\ncameras:\n", m->p.x, m->p.y, m->p.z,
	        m->q.x, m->q.y, m->q.z, m->q.w);
	for (size_t i = 0; i < n; i++) {
		const struct bb_camera_config *c = &cameras[i];
		fprintf(out, "  - id: \"%s\"\n    position_m: [%.9f, %.9f, %.9f]\n    turned: [%.12f, %.12f, %.12f, %.12f]\n", c->id,
		        c->pose.p.x, c->pose.p.y, c->pose.p.z, c->pose.q.x, c->pose.q.y, c->pose.q.z, c->pose.q.w);
		fprintf(out, "    lens: %s\n    focal_px: %.6f\n    centre_px: [%.6f, %.6f]\n",
		        c->lens == BB_LENS_FISHEYE ? "fisheye" : "brown-conrady", c->fx_px, c->cx_px, c->cy_px);
		fprintf(out, "    k1: %.9f\n    k2: %.9f\n    k3: %.9f\n    k4: %.9f\n    p1: %.9f\n    p2: %.9f\n    rms_px: %.6f\n",
		        c->k1, c->k2, c->k3, c->k4, c->p1, c->p2, c->calibrated_px);
	}
}

/* Reading */

struct file {
	struct bb_reader r; /* first: branches are handed a pointer to it */
	int64_t format;
	struct bb_calibration_head head;
	const struct bb_camera_config *planned;
	size_t n;
	struct bb_camera_config *cameras; /* as planned, then as calibrated */
	bool *here;
};

struct entry {
	char id[BB_ID_MAX];
	struct bb_camera_config c;
};

#define E struct entry
#define F64(key, member, lo, hi) \
	{ key, BB_OPT_TYPE_F64, offsetof(E, member), 0, 0, lo, hi, 1, NULL, true, "" }
#define TEXT(key, type, member, must) \
	{ key, BB_OPT_TYPE_TEXT, offsetof(type, member), sizeof(((type *)0)->member), 0, must, 0, 1, "", must, "" }

static const struct bb_option entry_options[] = {
	TEXT("id", E, id, true),
	{ "lens", BB_OPT_TYPE_ENUM, offsetof(E, c.lens), 0, 0, 0, 0, 1, "brown-conrady|fisheye", true, "" },
	F64("focal_px", c.fx_px, 1, 1e6), F64("k1", c.k1, -10, 10), F64("k2", c.k2, -10, 10), F64("k3", c.k3, -10, 10),
	F64("k4", c.k4, -10, 10), F64("p1", c.p1, -1, 1), F64("p2", c.p2, -1, 1), F64("rms_px", c.calibrated_px, 0, 1000),
	BB_OPT_END
};

static enum bb_status read_quat(struct bb_reader *r, const struct bb_yaml_node *v, struct bb_quat *out)
{
	double q[4];
	const enum bb_status status = bb_yaml_numbers(r, v, 4, -1, 1, 1, q);

	if (status)
		return status;
	const double n = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
	if (!(fabs(n - 1) < 1e-6))
		return bb_yaml_fail(r, 1737, v, "a quaternion of length %.6g is no orientation", n);
	*out = bb_quat_unit((struct bb_quat){ q[0], q[1], q[2], q[3] });
	return BB_OK;
}

static enum bb_status read_position(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_vec3(r, v, BB_ROOM_SPAN_M, 1, &((struct entry *)target)->c.pose.p);
}

static enum bb_status read_turned(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return read_quat(r, v, &((struct entry *)target)->c.pose.q);
}

static enum bb_status read_centre(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	double centre[2];
	const enum bb_status status = bb_yaml_numbers(r, v, 2, -1e5, 1e5, 1, centre);

	((struct entry *)target)->c.cx_px = status ? 0 : centre[0];
	((struct entry *)target)->c.cy_px = status ? 0 : centre[1];
	return status;
}

static const struct bb_yaml_branch entry_branches[] = { { "position_m", read_position, true },
	                                                { "turned", read_turned, true },
	                                                { "centre_px", read_centre, true },
	                                                { NULL, NULL, false } };

static void take(struct bb_camera_config *c, const struct bb_camera_config *from)
{
	const double half = (double)c->width_px / 2 / from->fx_px;

	c->pose = from->pose;
	c->lens = from->lens;
	c->fx_px = c->fy_px = from->fx_px;
	c->cx_px = from->cx_px;
	c->cy_px = from->cy_px;
	c->k1 = from->k1;
	c->k2 = from->k2;
	c->k3 = from->k3;
	c->k4 = from->k4;
	c->p1 = from->p1;
	c->p2 = from->p2;
	c->calibrated_px = from->calibrated_px;
	c->fov_deg = 360 / 3.14159265358979323846 * (c->lens == BB_LENS_FISHEYE ? half : atan(half));
}

static enum bb_status read_entry(struct file *f, const struct bb_yaml_node *node)
{
	struct entry e = { .id = "" };
	enum bb_status status;
	size_t i = 0;

	bb_options_defaults(entry_options, &e);
	status = bb_yaml_walk(&f->r, node, entry_options, entry_branches, &e, 0);
	if (status)
		return status;
	while (i < f->n && strcmp(f->cameras[i].id, e.id) != 0)
		i++;
	if (i == f->n || f->here[i])
		return bb_yaml_fail(&f->r, 1738, node, "camera '%s' %s", e.id, i == f->n ? "is not in the room" : "stands here twice");
	f->here[i] = true;
	take(&f->cameras[i], &e.c);
	if (!room_lens_unfolds(&f->cameras[i]))
		return bb_yaml_fail(&f->r, 1737, node, "the lens of '%s' folds its picture", e.id);
	return BB_OK;
}

static enum bb_status read_cameras(struct bb_reader *r, const struct bb_yaml_node *list, void *target)
{
	struct file *f = target;
	enum bb_status status = bb_yaml_want(r, list, BB_YAML_LIST);
	char hash[BB_HASH_HEX];

	bb_calibration_hash(f->planned, f->n, hash);
	if (!status && strcmp(hash, f->head.cameras_sha256) != 0)
		return bb_yaml_fail(r, 1738, list, "made %s for cameras that were planned otherwise than the room's are",
		                    f->head.made);
	for (const struct bb_yaml_node *c = list->first; c && !status; c = c->next)
		status = read_entry(f, c);
	for (size_t i = 0; i < f->n && !status; i++)
		if (!f->here[i])
			status = bb_yaml_fail(r, 1738, list, "camera '%s' is missing", f->cameras[i].id);
	return status;
}

static enum bb_status read_moved(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_vec3(r, v, BB_ROOM_SPAN_M, 1, &((struct file *)target)->head.moved.p);
}

static enum bb_status read_head_turned(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return read_quat(r, v, &((struct file *)target)->head.moved.q);
}

static const struct bb_option head_options[] = {
	{ "calibration", BB_OPT_TYPE_I64, offsetof(struct file, format), 0, 0, FORMAT, FORMAT, 1, NULL, true, "" },
	{ "rms_px", BB_OPT_TYPE_F64, offsetof(struct file, head.rms_px), 0, 0, 0, 1000, 1, NULL, true, "" },
	TEXT("room", struct file, head.room, true),
	TEXT("made", struct file, head.made, true),
	TEXT("room_sha256", struct file, head.room_sha256, true),
	TEXT("cameras_sha256", struct file, head.cameras_sha256, true),
	TEXT("sequence_sha256", struct file, head.sequence_sha256, true),
	BB_OPT_END
};
static const struct bb_yaml_branch head_branches[] = { { "moved_m", read_moved, false },
	                                               { "turned", read_head_turned, false },
	                                               { "cameras", read_cameras, true },
	                                               { NULL, NULL, false } };

enum bb_status bb_calibration_read(const char *path, struct bb_camera_config *cameras, size_t n,
                                   struct bb_calibration_head *head, struct bb_error *err)
{
	struct file f = { .r = { path, err }, .planned = cameras, .n = n };
	struct bb_yaml *doc = NULL;

	memset(head, 0, sizeof(*head));
	f.cameras = malloc((n + 1) * sizeof(*f.cameras));
	f.here = calloc(n + 1, sizeof(*f.here));
	enum bb_status status = f.cameras && f.here ? bb_yaml_load(path, &doc, err) :
	                                              bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a calibration");
	if (!status) {
		if (n)
			memcpy(f.cameras, cameras, n * sizeof(*cameras));
		bb_options_defaults(head_options, &f);
		f.head.moved = BB_POSE_IDENTITY;
		status = bb_yaml_walk(&f.r, bb_yaml_root(doc), head_options, head_branches, &f, 0);
	}
	if (!status && n) {
		memcpy(cameras, f.cameras, n * sizeof(*cameras));
		*head = f.head;
	}
	bb_yaml_free(doc);
	free(f.cameras);
	free(f.here);
	return status;
}
