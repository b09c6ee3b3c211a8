#include "bench/data.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "render/bricks/build.h"

#define MEMORY_BYTES (UINT64_C(512) << 20)

static bool is_bricks(const char *path)
{
	const size_t n = strlen(path);

	return n > 7 && !strcmp(path + n - 7, ".bricks");
}

static enum bb_status open_steps(const struct bb_scene *s, const char *scratch, struct bb_steps **out,
				 struct bb_error *err)
{
	const char *const paths[] = { s->data.file };
	const uint32_t edge = (uint32_t)s->data.edge_voxels, cube[3] = { edge, edge, edge };

	if (s->data.generate[0])
		return bb_steps_generate(s->data.generate, s->data.dim[0] ? s->data.dim : cube, (uint32_t)s->data.steps, out, err);
	return bb_steps_open(paths, 1, scratch, out, err);
}

static enum bb_status build(const struct bb_scene *s, const char *dir, struct bb_bricks **out, struct bb_error *err)
{
	struct bb_build_config config = { .edge = (uint32_t)s->data.brick_voxels, .pad = 1,
					  .type = (enum bb_brick_type)s->data.values, .memory_bytes = MEMORY_BYTES };
	const long processors = sysconf(_SC_NPROCESSORS_ONLN);
	struct bb_build_report report;
	char path[BB_PATH_MAX_BYTES];
	struct bb_steps *steps;

	enum bb_status status = open_steps(s, dir, &steps, err);
	if (status)
		return status;
	snprintf(path, sizeof(path), "%.900s/data.bricks", dir);
	config.steps = steps;
	config.path = path;
	config.threads = (unsigned)(processors > 0 && processors < 64 ? processors : 1);
	status = bb_bricks_build(&config, &report, err);
	bb_steps_close(steps);
	if (!status)
		status = bb_bricks_open(path, out, err);
	unlink(path);
	return status;
}

enum bb_status bb_data_open(const struct bb_scene *scene, struct bb_bricks **out, struct bb_error *err)
{
	const char *tmp = getenv("TMPDIR");
	char dir[BB_PATH_MAX_BYTES];

	*out = NULL;
	if (is_bricks(scene->data.file))
		return bb_bricks_open(scene->data.file, out, err);
	snprintf(dir, sizeof(dir), "%.800s/blackburst-XXXXXX", tmp && *tmp ? tmp : "/tmp");
	if (!mkdtemp(dir))
		return bb_fail(err, BB_ERR_IO, 1002, &(struct bb_where){ dir, 0, 0 }, "%s", strerror(errno));
	const enum bb_status status = build(scene, dir, out, err);
	rmdir(dir);
	return status;
}
