#include "bench/cmd/volume_make.h"

#include <signal.h>
#include <stdio.h>
#include <unistd.h>

#include "render/parallel.h"

enum bb_status bb_volume_make(const struct bb_cli *cli, const char *kind, struct bb_steps **out, struct bb_error *err)
{
	const char *text = bb_cli_get(cli, "dim", "128x128x128");
	double n_steps = 0, seed = 0;
	uint32_t dim[3];

	*out = NULL;
	if (!bb_cli_whole_numbers(text, 'x', dim, 3))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--dim cannot be '%.60s'", text);
	enum bb_status status = bb_cli_whole(cli, "steps", 8, 1, 1 << 16, &n_steps, err);
	if (!status)
		status = bb_cli_whole(cli, "seed", 1, 0, UINT32_MAX, &seed, err);
	if (!status)
		status = bb_steps_generate(kind, dim, (uint32_t)n_steps, out, err);
	if (!status)
		bb_steps_seed(*out, (uint32_t)seed);
	return status;
}

enum bb_status bb_volume_threads(const struct bb_cli *cli, unsigned *out, struct bb_error *err)
{
	double threads = 0;
	const enum bb_status status =
		bb_cli_whole(cli, "threads", bb_parallel_processors(), 1, BB_PARALLEL_MOST, &threads, err);

	*out = (unsigned)threads;
	return status;
}

static volatile sig_atomic_t interrupted;

static void on_interrupt(int number)
{
	(void)number;
	interrupted = 1;
}

enum bb_status bb_volume_work_begin(struct bb_volume_work *w, const struct bb_cli *cli, const char *unit,
				    struct bb_error *err)
{
	const struct sigaction once = { .sa_handler = on_interrupt, .sa_flags = (int)SA_RESETHAND };

	*w = (struct bb_volume_work){ .unit = unit, .shown = isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet") };
	if (bb_clock_posix_create(&w->clk))
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a clock");
	w->begun_ns = bb_clock_now_ns(w->clk);
	sigaction(SIGINT, &once, NULL);
	sigaction(SIGTERM, &once, NULL);
	return BB_OK;
}

/* "  42.0 %  38100 bricks/s  12 s left" */
bool bb_volume_work_progress(void *work, uint64_t done, uint64_t total)
{
	struct bb_volume_work *w = work;
	const int permille = (int)(done * 1000 / total);
	const double took_s = (double)(bb_clock_now_ns(w->clk) - w->begun_ns) * 1e-9;

	if (!w->started)
		w->first = done;
	w->started = true;
	if (w->shown && permille != w->permille && took_s > 0 && done > w->first) {
		const double rate = (double)(done - w->first) / took_s;
		fprintf(stderr, "\r%6.1f %%  %.0f %s/s  %.0f s left   ", permille / 10.0, rate, w->unit,
			(double)(total - done) / rate);
		fflush(stderr);
	}
	w->permille = permille;
	return !interrupted;
}

double bb_volume_work_end(struct bb_volume_work *w)
{
	if (!w->clk)
		return 0;
	const double took_s = (double)(bb_clock_now_ns(w->clk) - w->begun_ns) * 1e-9;
	bb_clock_destroy(w->clk);
	w->clk = NULL;
	if (w->shown)
		fprintf(stderr, "\r%60s\r", "");
	return took_s;
}
