/*
 * bench/cmd/trade_clocks.c: `blackburst trade --table clocks`: how many exchanges a clock estimate needs
 * (bench/trade/clocks.h).
 */
#include "bench/cmd/trade.h"
#include "bench/trade/clocks.h"

int bb_trade_clocks_run(const struct bb_cli *cli)
{
	const char *plot = bb_cli_get(cli, "plot", NULL);
	struct bb_error err = { 0 };
	struct bb_clocks clocks;
	double seed;
	enum bb_status status = bb_cli_whole(cli, "seed", 1, 0, 9e15, &seed, &err);

	if (status)
		return bb_cli_fail(status, &err);
	bb_clocks_measure((uint64_t)seed, &clocks);
	if (plot)
		status = bb_clocks_plot(&clocks, plot, &err);
	if (status)
		return bb_cli_fail(status, &err);
	if (bb_cli_has(cli, "json"))
		return bb_cli_print_json(bb_clocks_json(&clocks));
	bb_clocks_print(&clocks, stdout);
	return BB_EXIT_OK;
}
