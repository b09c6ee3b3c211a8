#include "bench/cmd/trade.h"
int bb_trade_table_run(const struct bb_cli *cli)
{
	(void)cli;
	return BB_EXIT_INTERNAL;
}
