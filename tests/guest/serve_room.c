/* tests/guest/serve_room.c: `serve_room serve ROOM ...`: the command `blackburst serve` without the rest of the program,
 * which would bring the libraries of its drawings into the guest. */
#include "bench/cli.h"

static const struct bb_command *const commands[] = { &bb_cmd_serve, NULL };

int main(int argc, char **argv)
{
	return bb_cli_main(commands, argc, (const char *const *)argv);
}
