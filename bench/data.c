#include "bench/data.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "render/bricks/build.h"
#include "render/parallel.h"

#define MEMORY_BYTES (UINT64_C(512) << 20)

bool bb_data_is_bricks(const struct bb_scene *scene)
{
	const char *path = scene->data.file;
	const size_t n = strlen(path);

	return n > 7 && !strcmp(path + n - 7, ".bricks");
}

enum bb_status bb_data_steps(const struct bb_scene *s, const char *scratch, struct bb_steps **out, struct bb_error *err)
{
	const char *const paths[] = { s->data.file };
	const uint32_t edge = (uint32_t)s->data.edge_voxels, cube[3] = { edge, edge, edge };

	if (s->data.generate[0])
		return bb_steps_generate(s->data.generate, s->data.dim[0] ? s->data.dim : cube, (uint32_t)s->data.steps, out, err);
	return bb_steps_open(paths, 1, scratch, out, err);
}

enum bb_status bb_data_build(struct bb_steps *steps, uint32_t edge, enum bb_brick_type type, const char *dir,
			     struct bb_bricks **out, struct bb_error *err)
{
	struct bb_build_config config = { .steps = steps, .edge = edge, .pad = 1, .type = type,
					  .memory_bytes = MEMORY_BYTES };
	struct bb_build_report report;
	char path[BB_PATH_MAX_BYTES];

	*out = NULL;
	snprintf(path, sizeof(path), "%.900s/data.bricks", dir);
	config.path = path;
	config.threads = bb_parallel_processors();
	enum bb_status status = bb_bricks_build(&config, &report, err);
	if (!status)
		status = bb_bricks_open(path, out, err);
	unlink(path);
	return status;
}

enum bb_status bb_data_folder(char *dir, size_t cap, struct bb_error *err)
{
	snprintf(dir, cap, "/tmp/blackburst-XXXXXX");
	if (!mkdtemp(dir))
		return bb_fail(err, BB_ERR_IO, 1002, &(struct bb_where){ dir, 0, 0 }, "%s", strerror(errno));
	return BB_OK;
}

enum bb_status bb_data_open(const struct bb_scene *scene, struct bb_bricks **out, struct bb_error *err)
{
	char dir[BB_PATH_MAX_BYTES];
	struct bb_steps *steps;

	*out = NULL;
	if (bb_data_is_bricks(scene))
		return bb_bricks_open(scene->data.file, out, err);
	enum bb_status status = bb_data_folder(dir, sizeof(dir), err);
	if (status)
		return status;
	status = bb_data_steps(scene, dir, &steps, err);
	if (!status) {
		status = bb_data_build(steps, (uint32_t)scene->data.brick_voxels, (enum bb_brick_type)scene->data.values, dir, out, err);
		bb_steps_close(steps);
	}
	rmdir(dir);
	return status;
}
