/*
 * bench/cmd/trade_prediction.c: `blackburst trade --table prediction`: what predicting the head to the photon buys
 * (bench/solver/prediction.h).
 */
#include "bench/cmd/trade.h"
#include "bench/solver/prediction.h"

int bb_trade_prediction_run(const struct bb_cli *cli)
{
	const char *plot = bb_cli_get(cli, "plot", NULL);
	struct bb_prediction_config config = { "rooms/cabin.yaml", "scenes/walk.path", 7, 0 };
	struct bb_prediction result;
	struct bb_error err = { 0 };
	double seed, frames;
	enum bb_status status = bb_cli_whole(cli, "seed", 7, 0, 9e15, &seed, &err);

	if (!status)
		status = bb_cli_whole(cli, "frames", 1e5, 100, 1e6, &frames, &err);
	if (status)
		return bb_cli_fail(status, &err);
	config.seed = (uint64_t)seed;
	config.n_frames = (size_t)frames;
	config.room = cli->n_args ? cli->arg[0] : config.room;
	status = bb_prediction_measure(&config, &result, &err);
	if (!status && plot)
		status = bb_prediction_plot(&result, plot, &err);
	if (status)
		return bb_cli_fail(status, &err);
	if (bb_cli_has(cli, "json"))
		return bb_cli_print_json(bb_prediction_json(&result));
	bb_prediction_print(&result, stdout);
	return BB_EXIT_OK;
}
