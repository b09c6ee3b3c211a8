/*
 * bench/track_record/streaming.h: what commands that stream poses share: their options, the model of bodies, and where
 * clients find them.
 */
#ifndef BB_BENCH_STREAMING_H
#define BB_BENCH_STREAMING_H

#include <stdio.h>

#include "bench/cli.h"
#include "drivers/mocap/mocap_port.h"
#include "hal/room.h"

/* --stream natnet[:COMMAND[:DATA]],vrpn[:PORT], --bind, --allow, --multicast; text NULL: both at their own ports. 1701. */
BB_MUST_CHECK enum bb_status bb_streaming_read(const struct bb_cli *cli, const char *text, struct bb_mocap_config *out,
                                               struct bb_error *err);
void bb_streaming_model(struct mocap_model *model, const struct bb_body *bodies, size_t n, double rate_hz);
void bb_streaming_print(const struct bb_mocap *m, const struct bb_mocap_config *c, FILE *out);
struct json_t *bb_streaming_json(const struct bb_mocap *m, const struct bb_mocap_config *c);

#endif
