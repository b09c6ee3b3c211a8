/*
 * bench/cmd/trade_tracking.c: `blackburst trade --table tracking`: cameras, blob noise and fidelity against pose error
 * and cost (bench/trade/tracking.h).
 */
#include <stdlib.h>
#include <unistd.h>

#include "bench/cmd/trade.h"
#include "bench/trade/tracking.h"

int bb_trade_tracking_run(const struct bb_cli *cli)
{
	const char *plot = bb_cli_get(cli, "plot", NULL);
	const bool shown = isatty(STDERR_FILENO) && !bb_cli_has(cli, "quiet");
	struct bb_tracking *t = calloc(1, sizeof(*t));
	struct bb_error err = { 0 };
	double seed = 7, frames = 7200;
	enum bb_status status = t ? BB_OK : bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "a table");
	int code = BB_EXIT_OK;

	if (!status)
		status = bb_cli_whole(cli, "seed", 7, 0, 9e15, &seed, &err);
	if (!status)
		status = bb_cli_whole(cli, "frames", 7200, 10, 100000, &frames, &err);
	if (!status) {
		t->seed = (uint64_t)seed;
		t->n_frames = (unsigned)frames;
		t->n_pictures = (unsigned)(frames / 3);
		status = bb_tracking_measure(t, shown ? bb_trade_say : NULL, &err);
	}
	if (shown)
		bb_trade_say("");
	if (!status && plot)
		status = bb_tracking_plot(t, plot, &err);
	if (status)
		code = bb_cli_fail(status, &err);
	else if (bb_cli_has(cli, "json"))
		code = bb_cli_print_json(bb_tracking_json(t));
	else
		bb_tracking_print(t, stdout);
	free(t);
	return code;
}
