#include "hal/profile.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "hal/room/yaml.h"

#define COST(key, help) \
	{ #key, BB_OPT_TYPE_F64, offsetof(struct bb_profile, key), 0, 0, 0, 1e9, 1, NULL, true, help }

static const struct bb_option options[] = {
	{ "profile", BB_OPT_TYPE_TEXT, offsetof(struct bb_profile, name), BB_ID_MAX, 0, 1, 0, 1, "", true, "its name" },
	COST(frame_base_ns, "once a frame"),
	COST(per_view_ns, "per screen and eye"),
	COST(per_ray_ns, "per ray that meets the volume's box"),
	COST(per_sample_ns, "per sample along a ray"),
	COST(per_brick_ns, "per brick uploaded"),
	COST(per_byte_ns, "per byte uploaded"),
	COST(track_ns, "blobs of one frame to a pose"),
	COST(select_per_brick_ns, "per brick looked at by the selection"),
	BB_OPT_F64(struct bb_profile, disk_read_ns, 0, 0, 1e9, "per brick read from the disk"),
	BB_OPT_F64(struct bb_profile, disk_byte_ns, 0, 0, 1e9, "per byte read from the disk"),
	BB_OPT_END
};

enum bb_status bb_profile_load(const char *path, struct bb_profile *out, struct bb_error *err)
{
	struct bb_reader r = { path, err };
	struct bb_profile p = { .name = "" };
	struct bb_yaml *doc;
	enum bb_status status;

	memset(out, 0, sizeof(*out));
	status = bb_yaml_load(path, &doc, err);
	if (status)
		return status;
	bb_options_defaults(options, &p);
	bb_yaml_sha256(doc, p.sha256);
	status = bb_yaml_walk(&r, bb_yaml_root(doc), options, NULL, &p, 0);
	bb_yaml_free(doc);
	if (!status)
		*out = p;
	return status;
}

enum bb_status bb_profile_load_for(const char *room_path, const char *name, struct bb_profile *out, struct bb_error *err)
{
	const char *slash = strrchr(room_path, '/');
	char path[BB_PATH_MAX_BYTES];
	const int folder = slash ? (int)(slash - room_path + 1) : 0;
	const int n = snprintf(path, sizeof(path), "%.*sprofiles/%s.yaml", folder, room_path, name);

	memset(out, 0, sizeof(*out));
	if (n < 0 || (size_t)n >= sizeof(path))
		return bb_fail(err, BB_ERR_CONFIG, 1001, NULL, "the path of profile '%.31s' is too long", name);
	return bb_profile_load(path, out, err);
}

int64_t bb_profile_draw_ns(const struct bb_profile *p, uint64_t n_views, uint64_t rays, uint64_t samples,
                           uint64_t bricks_loaded, uint64_t bytes_loaded)
{
	const double ns = p->frame_base_ns + p->per_view_ns * (double)n_views + p->per_ray_ns * (double)rays +
	                  p->per_sample_ns * (double)samples + p->per_brick_ns * (double)bricks_loaded +
	                  p->per_byte_ns * (double)bytes_loaded;

	return ns < 9e18 ? (int64_t)llround(ns) : INT64_MAX;
}
