/*
 * hal/room/scene.c: loading a scene. See hal/scene.h.
 */
#include "hal/scene.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/room/budget_read.h"
#include "hal/file.h"

#define S(member) offsetof(struct bb_scene, member)
#define SIZE_OF(member) sizeof(((struct bb_scene *)0)->member)
#define TEXT(key, member, must, help) { key, BB_OPT_TYPE_TEXT, S(member), SIZE_OF(member), 0, 1, 0, 1, "", must, help }
#define F64(key, member, def, lo, hi, help) { key, BB_OPT_TYPE_F64, S(member), 0, def, lo, hi, 1, NULL, false, help }

static const struct bb_option top_options[] = {
	TEXT("scene", name, true, "name of the scene"),
	{ "technique", BB_OPT_TYPE_ENUM, S(technique), 0, 0, 0, 0, 1, "volume|calibration", true, "what is drawn" },
	TEXT("transfer_function", transfer_function, false, "colours and opacities of the data"),
	TEXT("head_path", head_path, false, "key poses of the viewer's eyes"),
	TEXT("wand_path", wand_path, false, "key poses of the wand"),
	{ "steer_by", BB_OPT_TYPE_ENUM, S(steer_by), 0, BB_STEER_PAD, 0, 0, 1, "pad|head", false,
	  "where a pad's motion goes: as it says, or as the viewer's head is turned" },
	{ "duration_s", BB_OPT_TYPE_F64, S(duration_s), 0, 10, 0.1, 86400, 1, NULL, true, "scene time of a run" },
	BB_OPT_END
};

static const struct bb_option data_options[] = {
	TEXT("file", data.file, false, "volume: .nii, .nii.gz or .hdr.txt"),
	TEXT("generate", data.generate, false, "a made volume instead: cme, enlil, delta, wing or shock"),
	{ "edge_voxels", BB_OPT_TYPE_I64, S(data.edge_voxels), 0, 64, 8, 1024, 1, NULL, false, "of a made volume" },
	{ "steps", BB_OPT_TYPE_I64, S(data.steps), 0, 1, 1, 1000, 1, NULL, false, "of a made volume" },
	F64("seconds_per_step", data.seconds_per_step, 0.5, 1e-3, 3600, "scene time of one step of the data"),
	{ "loop", BB_OPT_TYPE_ENUM, S(data.loop), 0, 0, 0, 0, 1, "repeat|ping-pong|hold", false, "after the last step" },
	F64("width_m", data.width_m, 1, 1e-3, 100, "longest edge of the volume in the room"),
	F64("yaw_deg", data.yaw_deg, 0, -360, 360, "heading of the volume"),
	F64("pitch_deg", data.pitch_deg, 0, -360, 360, "then about x"),
	F64("roll_deg", data.roll_deg, 0, -360, 360, "then about z"),
	F64("step_voxels", data.step_voxels, 1, 0.05, 16, "distance of two samples along a ray"),
	{ "brick_voxels", BB_OPT_TYPE_I64, S(data.brick_voxels), 0, 16, 4, 64, 1, NULL, false,
	  "edge of the bricks a file that has none is cut into; even" },
	{ "values", BB_OPT_TYPE_ENUM, S(data.values), 0, 1, 0, 0, 1, "u8|u16|f16|f32", false, "how those bricks keep values" },
	{ "gain", BB_OPT_TYPE_ENUM, S(data.gain), 0, 3, 0, 0, 1, "opacity|leaf|child|far", false, "what a finer brick is worth" },
	{ "occlusion", BB_OPT_TYPE_BOOL, S(data.occlusion), 0, 0, 0, 0, 1, NULL, false, "what is hidden behind the rest is worth less" },
	{ "predict", BB_OPT_TYPE_BOOL, S(data.predict), 0, 1, 0, 0, 1, NULL, false, "bricks are read for the steps ahead" },
	BB_OPT_END
};

static const struct bb_option budget_options[] = {
	F64("memory_mib", memory_mib, 0, 0, 1 << 20, "brick memory of a node; 0: no limit"),
	{ "stream_bricks_per_frame", BB_OPT_TYPE_I64, S(stream_bricks_per_frame), 0, 0, 0, 1 << 20, 1, NULL, false,
	  "bricks a node loads in a frame; 0: no limit" },
	BB_OPT_END
};

static const struct bb_option picture_options[] = {
	F64("scale", pictures.scale, 1, 0.01, 1, "of the screen's pixels"),
	{ "levels", BB_OPT_TYPE_BOOL, S(pictures.levels), 0, 1, 0, 0, 1, NULL, false,
	  "one more a wall, coloured by the level of detail" },
	BB_OPT_END
};

static const struct bb_option patch_options[] = {
	F64("hz", patch.hz, 0, 0, 60, "so often a second it shows both its greys"),
	F64("size_m", patch.size_m, 0.2, 0, 100, "its edge; 0: the whole wall"),
	F64("low_percent", patch.low_percent, 0, 0, 100, "its darker grey, of white, linear"),
	F64("high_percent", patch.high_percent, 100, 0, 100, "its brighter grey"),
	{ "follows", BB_OPT_TYPE_ENUM, S(patch.follows), 0, BB_FOLLOWS_CLOCK, 0, 0, 1, "clock|cameras", false,
	  "the time of the frame, or that of the newest exposure: the latency self-test" },
	BB_OPT_END
};

const struct bb_scene_section *bb_scene_section(size_t i)
{
	static const struct bb_scene_section sections[] = {
		{ "scene", top_options },
		{ "data", data_options },
		{ "budgets", budget_options },
		{ "pictures", picture_options },
		{ "patch", patch_options },
	};

	return i < BB_ARRAY_LEN(sections) ? &sections[i] : NULL;
}

static enum bb_status read_centre(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_vec3(r, v, 1000, 1, &((struct bb_scene *)target)->data.centre_m);
}

static enum bb_status read_dim(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_scene *s = target;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_LIST);
	int64_t voxels;
	size_t n = 0;

	if (!status && v->n != 3)
		return bb_yaml_fail(r, 1012, v, "dim: %zu numbers, not 3", v->n);
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		status = bb_yaml_integer(r, c, 8, 1024, &voxels);
		s->data.dim[n++] = status ? 0 : (uint32_t)voxels;
	}
	return status;
}

static bool is_generator(const char *kind)
{
	static const char *const kinds[] = { "cme", "enlil", "delta", "wing", "shock" };

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++)
		if (!strcmp(kind, kinds[i]))
			return true;
	return false;
}

static enum bb_status read_data(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "centre_m", read_centre, false },
		                                          { "dim", read_dim, false },
		                                          { NULL, NULL, false } };
	const struct bb_scene *s = target;
	const enum bb_status status = bb_yaml_walk(r, v, data_options, branches, target, 0);

	if (status)
		return status;
	if (!*s->data.file == !*s->data.generate)
		return bb_yaml_fail(r, 1201, v, *s->data.file ? "both file and generate" : "neither file nor generate");
	if (*s->data.generate && !is_generator(s->data.generate))
		return bb_yaml_fail(r, 1012, bb_yaml_get(v, "generate"), "generate: '%s' is not cme, enlil, delta, wing or shock",
		                    s->data.generate);
	if (s->data.dim[0] && (!*s->data.generate || bb_yaml_get(v, "edge_voxels")))
		return bb_yaml_fail(r, 1012, bb_yaml_get(v, "dim"), "%s", *s->data.generate ? "dim: edge_voxels is given too" : "dim: only of a made volume");
	if (s->data.brick_voxels % 2)
		return bb_yaml_fail(r, 1012, bb_yaml_get(v, "brick_voxels"), "brick_voxels: %lld is odd",
		                    (long long)s->data.brick_voxels);
	return BB_OK;
}

/* `needs: {cameras: 1}`: fidelity by class; a class that is not named is not modelled. */
static enum bb_status read_needs(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_scene *s = target;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_MAP);

	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		size_t distance = strlen(c->key) / 2 + 1;
		const char *best = NULL;
		int64_t fidelity;
		int k = 0;

		while (k < BB_CLASS_COUNT && strcmp(bb_class_text((enum bb_class)k), c->key))
			best = bb_nearer(c->key, bb_class_text((enum bb_class)k++), best, &distance);
		if (k == BB_CLASS_COUNT)
			return bb_yaml_fail(r, 1011, c, "'%s' is no device class%s%s", c->key, best ? ", did you mean " : "",
			                    best ? best : "");
		status = bb_yaml_integer(r, c, 0, 2, &fidelity);
		if (!status)
			s->needs[k] = (int)fidelity;
	}
	return status;
}

static enum bb_status read_budgets(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_scene *s = target;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_MAP);

	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		if (!strcmp(c->key, "memory_mib"))
			status = bb_yaml_number(r, c, budget_options[0].least, budget_options[0].most, &s->memory_mib);
		else if (!strcmp(c->key, "stream_bricks_per_frame"))
			status = bb_yaml_integer(r, c, 0, 1 << 20, &s->stream_bricks_per_frame);
		else
			status = bb_budget_read(r, c, s->budgets, &s->n_budgets);
	}
	return status;
}

static enum bb_status read_at(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_scene *s = target;
	enum bb_status status = bb_yaml_want(r, v, BB_YAML_LIST);

	if (!status && v->n > BB_PICTURES_MAX)
		status = bb_yaml_fail(r, 1202, v, "%zu instants", v->n);
	for (const struct bb_yaml_node *c = v->first; c && !status; c = c->next) {
		double *at = &s->pictures.at_s[s->pictures.n_at];

		status = bb_yaml_number(r, c, 0, 86400, at);
		if (!status && (*at > s->duration_s || (s->pictures.n_at && *at <= at[-1])))
			status = bb_yaml_fail(r, 1202, c, "%g s", *at);
		s->pictures.n_at += !status;
	}
	return status;
}

static enum bb_status read_walls(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	struct bb_scene *s = target;
	const enum bb_status status = bb_yaml_text(r, v, s->pictures.wall, sizeof(s->pictures.wall));

	s->pictures.all_walls = !strcmp(s->pictures.wall, "all");
	if (s->pictures.all_walls)
		*s->pictures.wall = '\0';
	return status;
}

static enum bb_status read_eyes(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const char *const words[] = { "left", "right", "both" };
	struct bb_scene *s = target;
	char word[16];
	const enum bb_status status = bb_yaml_text(r, v, word, sizeof(word));

	if (status)
		return status;
	for (int i = 0; i < 3; i++)
		if (!strcmp(word, words[i])) {
			s->pictures.eyes = i + 1;
			return BB_OK;
		}
	return bb_yaml_fail(r, 1012, v, "eyes: '%s' is not left, right or both", word);
}

static enum bb_status read_pictures(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	static const struct bb_yaml_branch branches[] = { { "at_s", read_at, true },
		                                          { "walls", read_walls, false },
		                                          { "eyes", read_eyes, false },
		                                          { NULL, NULL, false } };

	return bb_yaml_walk(r, v, picture_options, branches, target, 0);
}

static enum bb_status read_patch(struct bb_reader *r, const struct bb_yaml_node *v, void *target)
{
	return bb_yaml_walk(r, v, patch_options, NULL, target, 0);
}

static const struct bb_yaml_branch top_branches[] = {
	{ "data", read_data, false },       { "needs", read_needs, false }, { "budgets", read_budgets, false },
	{ "pictures", read_pictures, false }, { "patch", read_patch, false }, { NULL, NULL, false },
};

static enum bb_status check_paths(struct bb_reader *r, const struct bb_yaml_node *root, struct bb_scene *s)
{
	const struct bb_yaml_node *data = bb_yaml_get(root, "data");
	const struct {
		const struct bb_yaml_node *map;
		const char *key;
		char *text;
	} all[] = {
		{ data, "file", s->data.file },
		{ root, "transfer_function", s->transfer_function },
		{ root, "head_path", s->head_path },
		{ root, "wand_path", s->wand_path },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(all); i++)
		if (*all[i].text && !bb_path_is_tame(all[i].text))
			return bb_yaml_fail(r, 1204, bb_yaml_get(all[i].map, all[i].key), "%s: '%.80s'", all[i].key, all[i].text);
	for (size_t i = 0; i < BB_ARRAY_LEN(all); i++)
		bb_path_settle(all[i].text, BB_PATH_MAX_BYTES, s->path);
	return BB_OK;
}

static enum bb_status check_whole(struct bb_reader *r, const struct bb_yaml_node *root, struct bb_scene *s)
{
	const bool volume = s->technique == BB_TECHNIQUE_VOLUME;

	if (volume && !bb_yaml_get(root, "data"))
		return bb_yaml_fail(r, 1017, root, "'data', technique volume needs it");
	if (volume && !*s->transfer_function)
		return bb_yaml_fail(r, 1017, root, "'transfer_function', technique volume needs it");
	if (!volume && bb_yaml_get(root, "data"))
		return bb_yaml_fail(r, 1201, bb_yaml_get(root, "data"), "technique calibration shows none");
	if (volume && bb_yaml_get(root, "patch"))
		return bb_yaml_fail(r, 1011, bb_yaml_get(root, "patch"), "'patch', technique calibration has one");
	if (s->needs[BB_CLASS_CAMERAS] != BB_NOT_NEEDED && !*s->head_path)
		return bb_yaml_fail(r, 1205, root, "needs.cameras: %d", s->needs[BB_CLASS_CAMERAS]);
	return check_paths(r, root, s);
}

static void defaults(struct bb_scene *s)
{
	bb_options_defaults(top_options, s);
	bb_options_defaults(data_options, s);
	bb_options_defaults(budget_options, s);
	bb_options_defaults(picture_options, s);
	bb_options_defaults(patch_options, s);
	s->data.centre_m = (struct bb_vec3){ 0, 1.4, 0 };
	s->pictures.all_walls = true;
	s->pictures.eyes = 3;
	for (int i = 0; i < BB_CLASS_COUNT; i++)
		s->needs[i] = BB_NOT_NEEDED;
}

static enum bb_status read_scene(struct bb_reader *r, struct bb_scene *s)
{
	struct bb_yaml *doc;
	enum bb_status status = bb_yaml_load(s->path, &doc, r->err);

	if (status)
		return status;
	bb_yaml_sha256(doc, s->sha256);
	defaults(s);
	status = bb_yaml_walk(r, bb_yaml_root(doc), top_options, top_branches, s, 0);
	if (!status)
		status = check_whole(r, bb_yaml_root(doc), s);
	bb_yaml_free(doc);
	return status;
}

enum bb_status bb_scene_load(const char *path, struct bb_scene **out, struct bb_error *err)
{
	struct bb_scene *s;
	enum bb_status status;

	*out = NULL;
	if (strlen(path) >= BB_PATH_MAX_BYTES)
		return bb_fail(err, BB_ERR_CONFIG, 1001, NULL, "the path has more than %d bytes", BB_PATH_MAX_BYTES - 1);
	s = calloc(1, sizeof(*s));
	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a scene");
	snprintf(s->path, sizeof(s->path), "%s", path);
	struct bb_reader r = { s->path, err };
	status = read_scene(&r, s);
	if (status) {
		bb_scene_free(s);
		return status;
	}
	*out = s;
	return BB_OK;
}

void bb_scene_free(struct bb_scene *scene)
{
	free(scene);
}
