/* bench/cmd/volume_generate.c: `blackburst volume generate`: a made sequence as raw voxels with their header. */
#include <jansson.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/cli.h"
#include "hal/clock.h"
#include "render/parallel.h"
#include "render/volume/steps.h"

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

static volatile sig_atomic_t interrupted;

static void on_interrupt(int number)
{
	(void)number;
	interrupted = 1;
}

static bool progress(void *ctx, uint64_t done, uint64_t total)
{
	const bool *shown = ctx;

	if (*shown) {
		fprintf(stderr, "\r%6.1f %%", 100.0 * (double)done / (double)total);
		fflush(stderr);
	}
	return !interrupted;
}

static enum bb_status read_shape(const struct bb_cli *cli, uint32_t dim[3], uint32_t *n_steps, uint32_t *seed,
				 unsigned *threads, struct bb_error *err)
{
	const long processors = sysconf(_SC_NPROCESSORS_ONLN);
	const char *text = bb_cli_get(cli, "dim", "128x128x128");
	double voxels[3], steps = 0, seeded = 0, many = 0;
	bool sane = bb_cli_numbers(text, 'x', voxels, 3);

	for (int a = 0; a < 3 && sane; a++)
		sane = voxels[a] >= 1 && voxels[a] <= 1 << 16;
	if (!sane)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--dim cannot be '%.60s'", text);
	for (int a = 0; a < 3; a++)
		dim[a] = (uint32_t)voxels[a];
	enum bb_status status = bb_cli_number(cli, "steps", 8, 1, 1 << 16, &steps, err);
	if (!status)
		status = bb_cli_number(cli, "seed", 1, 0, UINT32_MAX, &seeded, err);
	if (!status)
		status = bb_cli_number(cli, "threads", processors > 0 ? (double)processors : 1, 1, BB_PARALLEL_MOST,
				       &many, err);
	*n_steps = (uint32_t)steps;
	*seed = (uint32_t)seeded;
	*threads = (unsigned)many;
	return status;
}

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
	bool shown = isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet");
	struct bb_error err = { 0 };
	struct bb_steps *steps = NULL;
	struct bb_clock *clk = NULL;
	char usual[BB_PATH_MAX_BYTES];
	uint32_t dim[3], n_steps = 0, seed = 0;
	unsigned threads = 1;
	int64_t begun_ns = 0;

	snprintf(usual, sizeof(usual), "%.32s.hdr.txt", cli->arg[0]);
	const char *path = bb_cli_get(cli, "out", usual);
	enum bb_status status = read_shape(cli, dim, &n_steps, &seed, &threads, &err);
	if (!status)
		status = bb_steps_generate(cli->arg[0], dim, n_steps, &steps, &err);
	if (!status)
		status = bb_clock_posix_create(&clk);
	if (!status) {
		begun_ns = bb_clock_now_ns(clk);
		bb_steps_seed(steps, seed);
		sigaction(SIGINT, &(struct sigaction){ .sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND },
			  NULL);
		sigaction(SIGTERM, &(struct sigaction){ .sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND },
			  NULL);
		status = bb_steps_write(steps, path, threads, progress, &shown, &err);
	}
	if (shown)
		fprintf(stderr, "\r%60s\r", "");
	const int code = status == BB_SKIPPED ? 130
			 : status             ? bb_cli_fail(status, &err)
				  : tell(cli, steps, path, (double)(bb_clock_now_ns(clk) - begun_ns) * 1e-9);
	bb_clock_destroy(clk);
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
