/*
 * bench/serve/serve.h: what `serve` is made of: kinds of wire, each a row that puts the simulated devices of a room on its own
 * wire. A row may use the poll loop of sim/wire.h (Modbus does), or bring open files of its own and a step function.
 * One thread, the posix clock.
 */
#ifndef BB_BENCH_SERVE_H
#define BB_BENCH_SERVE_H

#include "bench/cli.h"
#include "hal/room.h"
#include "sim/wire.h"
#include "sim/world.h"

#define BB_SERVE_ROWS_MAX 256

struct bb_serve_row { /* one device on one wire, as it is printed */
	char wire[16], device[BB_ID_MAX + 16];
	char where[96];       /* "127.0.0.1:1502", "/dev/pts/4", "127.0.0.1:3240 1-2" */
	char attach[160];     /* what to write or to type to use it */
};

struct bb_serve {
	const struct bb_cli *cli;
	const struct bb_room *room;
	struct bb_clock *clk;
	struct sim_wire *wire;
	struct sim_world *world;
	const char *bind;     /* numeric address; loopback unless there is a token */
	const char *token;    /* NULL: none */
	size_t n_rows;
	struct bb_serve_row row[BB_SERVE_ROWS_MAX];
};

struct bb_serve_kind { /* a table of these ends with name == NULL */
	const char *name;
	/* Puts its devices on its wire and adds a row for each; *state is handed to the others. No such device in the
	 * room: BB_OK and no row. Faults find what was registered with sim_world_register. */
	enum bb_status (*attach)(struct bb_serve *s, void **state, struct bb_error *err);
	/* Called after every wait, with nothing to do most of the time; returns when it wants to run again, besides the
	 * clock's timers. Its files were given to sim_wire_watch. May be NULL. */
	int64_t (*step)(struct bb_serve *s, void *state, int64_t now_ns);
	void (*detach)(struct bb_serve *s, void *state); /* state may be NULL */
};
extern const struct bb_serve_kind bb_serve_modbus, bb_serve_usbip, bb_serve_can;

/* The next free row, or NULL with error 1571. */
struct bb_serve_row *bb_serve_add(struct bb_serve *s, const char *wire, const char *class_name, const char *id,
                                  struct bb_error *err);
/* Is this device simulated, so that it has something to put on a wire? */
bool bb_serve_simulated(const char *device);

#endif
