/* bench/cmd/volume_build.c: `blackburst volume build`: a sequence of volumes to one brick file
 * (render/bricks/format.h). */
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "bench/cli.h"
#include "hal/clock.h"
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

static volatile sig_atomic_t interrupted;

static void on_interrupt(int number)
{
	(void)number;
	interrupted = 1;
}

struct showing {
	struct bb_clock *clk;
	int64_t begun_ns;
	uint64_t first; /* bricks done before this call */
	int permille;
	bool shown, started;
};

/* "  42.0 %  38100 bricks/s  12 s left" */
static bool progress(void *ctx, uint64_t done, uint64_t total)
{
	struct showing *s = ctx;
	const int permille = (int)(done * 1000 / total);
	const double took_s = (double)(bb_clock_now_ns(s->clk) - s->begun_ns) * 1e-9;

	if (!s->started)
		s->first = done;
	s->started = true;
	if (s->shown && permille != s->permille && took_s > 0 && done > s->first) {
		const double rate = (double)(done - s->first) / took_s;
		fprintf(stderr, "\r%6.1f %%  %.0f bricks/s  %.0f s left   ", permille / 10.0, rate,
			(double)(total - done) / rate);
		fflush(stderr);
	}
	s->permille = permille;
	return !interrupted;
}

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
	const long processors = sysconf(_SC_NPROCESSORS_ONLN);
	double brick = 0, pad = 0, mib = 0, threads = 0;
	enum bb_status status = bb_cli_number(cli, "brick", 32, 4, 64, &brick, err);

	if (!status)
		status = bb_cli_number(cli, "pad", 1, 0, BB_BRICKS_PAD_MOST, &pad, err);
	if (!status)
		status = bb_cli_number(cli, "memory", 512, 1, 1 << 20, &mib, err);
	if (!status)
		status = bb_cli_number(cli, "threads", processors > 0 ? (double)processors : 1, 1, 64, &threads, err);
	c->edge = (uint32_t)brick;
	c->pad = (uint32_t)pad;
	c->memory_bytes = (uint64_t)(mib * (1 << 20));
	c->threads = (unsigned)threads;
	c->checkpoint_bytes = UINT64_C(8) << 30;
	return status;
}

static enum bb_status open_steps(const struct bb_cli *cli, const char *out, struct bb_steps **steps,
				 struct bb_error *err)
{
	char folder[BB_PATH_MAX_BYTES];
	double dim[3] = { 128, 128, 128 }, n_steps = 8, seed = 1;
	enum bb_status status;

	if (cli->n_args) {
		const char *slash = strrchr(out, '/');
		snprintf(folder, sizeof(folder), "%.*s", slash ? (int)(slash - out) + 1 : 1, slash ? out : ".");
		return bb_steps_open(cli->arg, (size_t)cli->n_args, folder, steps, err);
	}
	if (!bb_cli_has(cli, "generate"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "give the files of a sequence, or --generate");
	if (!bb_cli_numbers(bb_cli_get(cli, "dim", "128x128x128"), 'x', dim, 3))
		return bad(cli, "dim", err);
	for (int a = 0; a < 3; a++)
		if (!(dim[a] >= 1 && dim[a] <= 1 << 16))
			return bad(cli, "dim", err);
	status = bb_cli_number(cli, "steps", 8, 1, 1 << 16, &n_steps, err);
	if (status)
		return status;
	const uint32_t voxels[3] = { (uint32_t)dim[0], (uint32_t)dim[1], (uint32_t)dim[2] };
	status = bb_cli_number(cli, "seed", 1, 0, UINT32_MAX, &seed, err);
	if (!status)
		status = bb_steps_generate(bb_cli_get(cli, "generate", ""), voxels, (uint32_t)n_steps, steps, err);
	if (!status)
		bb_steps_seed(*steps, (uint32_t)seed);
	return status;
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
	struct bb_build_report report;
	struct bb_error err = { 0 };
	struct showing showing = { .shown = isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet") };
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
		status = bb_clock_posix_create(&showing.clk);
	if (status) {
		bb_steps_close(steps);
		return bb_cli_fail(status, &err);
	}
	config.steps = steps;
	config.progress = progress;
	config.ctx = &showing;
	showing.begun_ns = bb_clock_now_ns(showing.clk);
	sigaction(SIGINT, &(struct sigaction){ .sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND }, NULL);
	sigaction(SIGTERM, &(struct sigaction){ .sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND }, NULL);
	status = bb_bricks_build(&config, &report, &err);
	const double took_s = (double)(bb_clock_now_ns(showing.clk) - showing.begun_ns) * 1e-9;
	bb_clock_destroy(showing.clk);
	bb_steps_close(steps);
	if (showing.shown)
		fprintf(stderr, "\r%60s\r", "");
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
