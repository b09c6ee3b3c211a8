/*
 * bench/main.c: the program: which commands there are, in the order a person meets them.
 */
#include "bench/cli.h"
#include "bench/report/room_drawing.h"

static const struct bb_command *const commands[] = {
	&bb_cmd_run, &bb_cmd_node, &bb_cmd_room_check, &bb_cmd_room_draw, &bb_cmd_devices, &bb_cmd_doctor, &bb_cmd_serve,
	&bb_cmd_phase, &bb_cmd_phase_measure, &bb_cmd_phase_sense,
	&bb_cmd_track_calibrate, &bb_cmd_track_align, &bb_cmd_track_coverage, &bb_cmd_track_place,
	&bb_cmd_track_replay, &bb_cmd_track_import, &bb_cmd_track_serve,
	&bb_cmd_volume_generate, &bb_cmd_volume_build, &bb_cmd_volume_info, &bb_cmd_volume_verify, &bb_cmd_volume_select,
	&bb_cmd_volume_speed, &bb_cmd_volume_tables,
	&bb_cmd_bench, &bb_cmd_bench_barrier, &bb_cmd_bench_blobs, &bb_cmd_bench_track, &bb_cmd_compare, &bb_cmd_trade, NULL,
};

int main(int argc, char **argv)
{
	const int code = bb_cli_main(commands, argc, (const char *const *)argv);

	bb_drawing_forget_fonts(); /* or fontconfig's caches count as leaks */
	return code;
}
