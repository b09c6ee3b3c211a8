/* bench/cmd/trade.h: the forms of `blackburst trade`; the arguments choose. Each returns an exit code. */
#ifndef BB_BENCH_CMD_TRADE_H
#define BB_BENCH_CMD_TRADE_H

#include "bench/cli.h"
#include "hal/clock.h"

int bb_trade_device_run(const struct bb_cli *cli); /* ROOM SCENE --device CLASS */
int bb_trade_scene_run(const struct bb_cli *cli);  /* SCENE, FILE, or --generate KIND */
int bb_trade_table_run(const struct bb_cli *cli);  /* --table gains */
int bb_trade_clocks_run(const struct bb_cli *cli); /* --table clocks */
int bb_trade_tracking_run(const struct bb_cli *cli); /* --table tracking */
int bb_trade_prediction_run(const struct bb_cli *cli); /* [ROOM] --table prediction */

struct bb_trade;
struct bb_trade_config;
/* With config's renderer by --draw: "cpu", "osmesa", "egl", or "auto", the first of these that can draw this data. The
 * caller destroys config->renderer in any case. 1480, 1701, 1801, and as bb_trade_create. */
BB_MUST_CHECK enum bb_status bb_trade_begin(const struct bb_cli *cli, struct bb_trade_config *config,
					    struct bb_trade **out, struct bb_error *err);
/* --size WxH. 1481. */
BB_MUST_CHECK enum bb_status bb_trade_size(const struct bb_cli *cli, const char *usual, uint32_t *width_px,
					   uint32_t *height_px, struct bb_error *err);

/* A line of progress on a terminal, over the last one; "" wipes it. */
void bb_trade_say(const char *text);

#endif
