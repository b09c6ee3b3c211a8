/*
 * bench/main.c: the program: which commands there are, in the order a person meets them.
 */
#include "bench/cli.h"

static const struct bb_command *const commands[] = { &bb_cmd_run,     &bb_cmd_room_check, &bb_cmd_room_draw,
	                                             &bb_cmd_devices, &bb_cmd_doctor,     &bb_cmd_bench,
	                                             &bb_cmd_compare, &bb_cmd_trade,      &bb_cmd_serve, NULL };

int main(int argc, char **argv)
{
	return bb_cli_main(commands, argc, (const char *const *)argv);
}
