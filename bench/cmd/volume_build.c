/* bench/cmd/volume_build.c: `blackburst volume build`: a sequence of volumes to one brick file
 * (render/bricks/format.h). */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "bench/cmd/volume_make.h"
#include "render/bricks/build.h"

static const struct bb_cli_option options[] = {
	{ "out", "FILE", "the brick file (default: the first file's name with .bricks)" },
	{ "generate", "KIND", "no files: a generated sequence, cme, enlil, delta, wing or shock" },
	{ "seed", "N", "of what is generated (default 1)" },
	{ "dim", "XxYxZ", "its voxels (default 128x128x128)" },
	{ "steps", "N", "its steps (default 8)" },
	{ "brick", "N", "voxels along a brick's edge, even, 4 to 64 (default 32)" },
	{ "pad", "N", "voxels of true neighbours around it, 0 to 2 (default 1)" },
	{ "type", "u8|u16|f16|f32", "how values are stored (default f32)" },
	{ "codec", "none|lz4|zstd", "how bricks are packed (default none)" },
	{ "range", "A:B", "the values' range, where it is known: the data is then read once" },
	{ "spherical", "R:R:T:T:P:P", "a spherical grid: radii, polar and azimuthal angles in radians, from and to" },
	{ "memory", "MIB", "at most so much memory (default 512)" },
	{ "threads", "N", "(default: one for each processor)" },
	{ "json", NULL, "machine-readable" },
	{ "quiet", NULL, "no progress" },
	{ NULL, NULL, NULL },
};

static enum bb_status bad(const struct bb_cli *cli, const char *name, struct bb_error *err)
{
	return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--%s cannot be '%.60s'", name, bb_cli_get(cli, name, ""));
}

static bool read_type(const char *text, enum bb_brick_type *out)
{
	for (*out = 0; *out < BB_BRICK_TYPES; ++*out)
		if (!strcmp(text, bb_brick_type_text(*out)))
			return true;
	return false;
}

static bool read_codec(const char *text, enum bb_brick_codec *out)
{
	for (*out = 0; *out < BB_BRICK_CODECS; ++*out)
		if (!strcmp(text, bb_brick_codec_text(*out)))
			return true;
	return false;
}

static enum bb_status read_words(const struct bb_cli *cli, struct bb_build_config *c, struct bb_error *err)
{
	double range[2];

	if (!read_type(bb_cli_get(cli, "type", "f32"), &c->type))
		return bad(cli, "type", err);
	if (!read_codec(bb_cli_get(cli, "codec", "none"), &c->codec))
		return bad(cli, "codec", err);
	if (bb_cli_has(cli, "range")) {
		if (!bb_cli_numbers(bb_cli_get(cli, "range", ""), ':', range, 2) || !(range[1] >= range[0]) ||
		    !(range[1] - range[0] < 1e300))
			return bad(cli, "range", err);
		c->has_range = true;
		c->least = range[0];
		c->most = range[1];
	}
	if (bb_cli_has(cli, "spherical")) {
		c->grid = BB_BRICK_SPHERICAL;
		if (!bb_cli_numbers(bb_cli_get(cli, "spherical", ""), ':', c->extent, 6) ||
		    !bb_steps_extent_is_sane(c->extent))
			return bad(cli, "spherical", err);
	}
	return BB_OK;
}

static enum bb_status read_numbers(const struct bb_cli *cli, struct bb_build_config *c, struct bb_error *err)
{
	double brick = 0, pad = 0, mib = 0;
	enum bb_status status = bb_cli_whole(cli, "brick", 32, 4, 64, &brick, err);

	if (!status)
		status = bb_cli_whole(cli, "pad", 1, 0, BB_BRICKS_PAD_MOST, &pad, err);
	if (!status)
		status = bb_cli_number(cli, "memory", 512, 1, 1 << 20, &mib, err);
	if (!status)
		status = bb_volume_threads(cli, &c->threads, err);
	c->edge = (uint32_t)brick;
	c->pad = (uint32_t)pad;
	c->memory_bytes = (uint64_t)(mib * (1 << 20));
	c->checkpoint_bytes = UINT64_C(8) << 30;
	return status;
}

static enum bb_status open_steps(const struct bb_cli *cli, const char *out, struct bb_steps **steps,
				 struct bb_error *err)
{
	char folder[BB_PATH_MAX_BYTES];

	if (cli->n_args) {
		const char *slash = strrchr(out, '/');
		snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - out) + 1 : 1, slash ? out : ".");
		return bb_steps_open(cli->arg, (size_t)cli->n_args, folder, steps, err);
	}
	if (!bb_cli_has(cli, "generate"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "give the files of a sequence, or --generate");
	return bb_volume_make(cli, bb_cli_get(cli, "generate", ""), steps, err);
}

/* What the kernel says of this process: the most memory it ever had, libraries and all, and its threads' time. */
static void what_it_took(double *resident_bytes, double *cpu_s)
{
	struct rusage use = { 0 };

	(void)getrusage(RUSAGE_SELF, &use);
	*resident_bytes = (double)use.ru_maxrss * 1024;
	*cpu_s = (double)(use.ru_utime.tv_sec + use.ru_stime.tv_sec) +
		 (double)(use.ru_utime.tv_usec + use.ru_stime.tv_usec) * 1e-6;
}

static int tell(const struct bb_cli *cli, const char *path, const struct bb_build_report *r, double took_s)
{
	double resident_bytes, cpu_s;

	what_it_took(&resident_bytes, &cpu_s);
	if (bb_cli_has(cli, "json")) {
		json_t *j = json_pack("{s:s, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:b}", "file", path, "bricks",
				      (json_int_t)r->n_bricks, "bytes", (json_int_t)r->result_bytes, "bytes_read",
				      (json_int_t)r->bytes_read, "bytes_written", (json_int_t)r->bytes_written,
				      "peak_bytes", (json_int_t)r->peak_bytes, "resident_bytes",
				      (json_int_t)resident_bytes, "nonfinite_voxels", (json_int_t)r->n_nonfinite,
				      "seconds", took_s, "cpu_seconds", cpu_s, "resumed", r->resumed);
		return bb_cli_print_json(j);
	}
	printf("%s: %llu bricks, %.1f MiB in %.2f s; read %.1f MiB, wrote %.1f MiB, memory %.1f MiB (process %.1f)%s\n",
	       path, (unsigned long long)r->n_bricks, (double)r->result_bytes / 1048576, took_s,
	       (double)r->bytes_read / 1048576, (double)r->bytes_written / 1048576, (double)r->peak_bytes / 1048576,
	       resident_bytes / 1048576, r->resumed ? "; went on with an earlier build" : "");
	if (r->n_nonfinite)
		printf("%llu voxels were not finite and have the least value instead\n",
		       (unsigned long long)r->n_nonfinite);
	return BB_EXIT_OK;
}

static void default_out(char *out, size_t cap, const struct bb_cli *cli)
{
	const char *first = cli->n_args ? cli->arg[0] : bb_cli_get(cli, "generate", "volume");
	const char *slash = strrchr(first, '/'), *base = slash ? slash + 1 : first;

	snprintf(out, cap, "%.*s%.*s.bricks", (int)(base - first), first, (int)strcspn(base, "."), base);
}

static int command(const struct bb_cli *cli)
{
	struct bb_build_config config = { 0 };
	struct bb_build_report report = { 0 };
	struct bb_error err = { 0 };
	struct bb_volume_work work = { 0 };
	struct bb_steps *steps = NULL;
	char usual[BB_PATH_MAX_BYTES];

	default_out(usual, sizeof(usual), cli);
	config.path = bb_cli_get(cli, "out", usual);
	enum bb_status status = read_numbers(cli, &config, &err);
	if (!status)
		status = read_words(cli, &config, &err);
	if (!status)
		status = open_steps(cli, config.path, &steps, &err);
	if (!status)
		status = bb_volume_work_begin(&work, cli, "bricks", &err);
	if (!status) {
		config.steps = steps;
		config.progress = bb_volume_work_progress;
		config.ctx = &work;
		status = bb_bricks_build(&config, &report, &err);
	}
	const double took_s = bb_volume_work_end(&work);
	bb_steps_close(steps);
	if (status == BB_SKIPPED) {
		fprintf(stderr, "stopped; the same command goes on from here\n");
		return 130;
	}
	return status ? bb_cli_fail(status, &err) : tell(cli, config.path, &report, took_s);
}

const struct bb_command bb_cmd_volume_build = {
	"volume build",
	"a sequence of volumes to one file of bricks, out of core",
	"[FILE...] [options]",
	options,
	0,
	1024,
	command,
};
