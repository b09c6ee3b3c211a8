/* tests/guest/blackburst_serve.c: `blackburst` with no command but serve: the whole program brings 10 MB of fonts along. */
#include "bench/cli.h"

int main(int argc, char **argv)
{
	static const struct bb_command *const commands[] = { &bb_cmd_serve, NULL };

	return bb_cli_main(commands, argc, (const char *const *)argv);
}
