/* bench/cmd/volume_generate.c: `blackburst volume generate`: a made sequence as raw voxels with their header. */
#include <jansson.h>
#include <stdio.h>

#include "bench/cmd/volume_make.h"

static const struct bb_cli_option options[] = {
	{ "out", "FILE", "the header, NAME.hdr.txt; voxels go to NAME.raw (default KIND.hdr.txt)" },
	{ "dim", "XxYxZ", "voxels (default 128x128x128)" },
	{ "steps", "N", "steps (default 8)" },
	{ "seed", "N", "(default 1)" },
	{ "threads", "N", "(default: one for each processor)" },
	{ "json", NULL, "machine-readable" },
	{ "quiet", NULL, "no progress" },
	{ NULL, NULL, NULL },
};

static int tell(const struct bb_cli *cli, const struct bb_steps *s, const char *path, double took_s)
{
	const double bytes = 4.0 * s->dim[0] * s->dim[1] * s->dim[2] * s->n_steps;

	if (bb_cli_has(cli, "json"))
		return bb_cli_print_json(
			json_pack("{s:s, s:I, s:f}", "file", path, "bytes", (json_int_t)bytes, "seconds", took_s));
	printf("%s: %u x %u x %u voxels, %u steps, %.1f MiB in %.2f s\n", path, s->dim[0], s->dim[1], s->dim[2],
	       s->n_steps, bytes / 1048576, took_s);
	return BB_EXIT_OK;
}

static int command(const struct bb_cli *cli)
{
	struct bb_volume_work work = { 0 };
	struct bb_error err = { 0 };
	struct bb_steps *steps = NULL;
	char usual[BB_PATH_MAX_BYTES];
	unsigned threads = 1;

	snprintf(usual, sizeof(usual), "%.32s.hdr.txt", cli->arg[0]);
	const char *path = bb_cli_get(cli, "out", usual);
	enum bb_status status = bb_volume_threads(cli, &threads, &err);
	if (!status)
		status = bb_volume_make(cli, cli->arg[0], &steps, &err);
	if (!status)
		status = bb_volume_work_begin(&work, cli, "planes", &err);
	if (!status)
		status = bb_steps_write(steps, path, threads, bb_volume_work_progress, &work, &err);
	const double took_s = bb_volume_work_end(&work);
	const int code = status == BB_SKIPPED ? 130 : status ? bb_cli_fail(status, &err) : tell(cli, steps, path, took_s);
	bb_steps_close(steps);
	return code;
}

const struct bb_command bb_cmd_volume_generate = {
	"volume generate",
	"a made sequence (cme, enlil, delta, wing, shock) as raw voxels",
	"KIND [options]",
	options,
	1,
	1,
	command,
};
