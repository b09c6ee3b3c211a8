/*
 * bench/cmd/serve.c: `blackburst serve ROOM`: the simulated devices of a room on wires that other programs can open.
 * Loopback only; another address needs a token that clients must know. Runs until a signal, or --for so long.
 */
#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bench/serve/serve.h"
#include "hal/uri.h"
#include "sim/faults.h"

#define TOKEN_DIGITS_LEAST 32 /* hexadecimal: 128 bits */
#define FRAME_NS (BB_NS_PER_S / 60) /* of faults that last so many frames */
#define WAIT_MOST_NS (BB_NS_PER_S / 5)

/* The wires there are, in the order they are printed. */
static const struct bb_serve_kind *const kinds[] = { &bb_serve_modbus, &bb_serve_usbip, &bb_serve_can };

static const struct bb_cli_option options[] = {
	{ "modbus-port", "N", "port of the first power strip, the next ones follow; 0: any free ones (1502)" },
	{ "usbip-port", "N", "port of the USB devices, all on one; 0: any free one (3240)" },
	{ "pty", NULL, "serial devices too: Modbus RTU, a pty each" },
	{ "can", "INTERFACE", "the shutter chain as CANopen controllers on that interface, which is up: vcan0" },
	{ "can-hardware", NULL, "the interface has a cable, and nothing real is on it" },
	{ "bind", "ADDRESS", "listen there instead of 127.0.0.1; not loopback: only with --token-file" },
	{ "token-file", "FILE", "mode 0600, a line of at least 32 hexadecimal digits that a client must send first" },
	{ "fault", "TEXT", "plant a fault, as in run; times count from the start; may be repeated" },
	{ "for", "S", "end after so many seconds instead of at a signal" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

bool bb_serve_simulated(const char *device)
{
	return !device[0] || !strncmp(device, "sim:", 4);
}

struct bb_serve_row *bb_serve_add(struct bb_serve *s, const char *wire, const char *class_name, const char *id,
                                  struct bb_error *err)
{
	if (s->n_rows == BB_SERVE_ROWS_MAX) {
		bb_fail(err, BB_ERR_RANGE, 1571, NULL, "more than %d devices on wires", BB_SERVE_ROWS_MAX);
		return NULL;
	}
	struct bb_serve_row *row = &s->row[s->n_rows++];
	snprintf(row->wire, sizeof(row->wire), "%s", wire);
	snprintf(row->device, sizeof(row->device), "%s/%s", class_name, id);
	return row;
}

/* ---- who may connect ---- */

/* The token's file must be its owner's alone, or it is no secret. */
static enum bb_status read_token(const char *path, char *token, size_t cap, struct bb_error *err)
{
	struct stat st;
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
	ssize_t n = -1;

	if (fd < 0)
		return bb_fail(err, BB_ERR_USAGE, 1572, NULL, "%.200s: %s", path, strerror(errno));
	const bool private = fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && !(st.st_mode & 0177) && st.st_uid == geteuid();
	if (private)
		n = read(fd, token, cap - 1);
	close(fd);
	if (!private)
		return bb_fail(err, BB_ERR_USAGE, 1572, NULL, "%.200s is not a regular file of yours with mode 0600", path);
	token[n > 0 ? n : 0] = '\0';
	token[strcspn(token, "\r\n")] = '\0';
	if (strlen(token) < TOKEN_DIGITS_LEAST || strspn(token, "0123456789abcdefABCDEF") != strlen(token))
		return bb_fail(err, BB_ERR_USAGE, 1572, NULL, "%.200s has no line of %d hexadecimal digits or more", path,
		               TOKEN_DIGITS_LEAST);
	return BB_OK;
}

static enum bb_status choose_address(struct bb_serve *s, char *token, size_t cap, struct bb_error *err)
{
	const char *path = bb_cli_get(s->cli, "token-file", NULL);

	s->bind = bb_cli_get(s->cli, "bind", "127.0.0.1");
	if (path) {
		const enum bb_status status = read_token(path, token, cap, err);
		if (status != BB_OK)
			return status;
		s->token = token;
	}
	if (!s->token && !sim_wire_loopback(s->bind))
		return bb_fail(err, BB_ERR_USAGE, 1572, NULL, "%.60s is not loopback", s->bind);
	return BB_OK;
}

/* ---- what listens where ---- */

static int print_json(const struct bb_serve *s)
{
	json_t *all = json_object(), *rows = json_array();

	json_object_set_new(all, "room", json_string(s->room->name));
	json_object_set_new(all, "token", json_boolean(s->token != NULL));
	for (size_t i = 0; i < s->n_rows; i++)
		json_array_append_new(rows, json_pack("{s:s, s:s, s:s, s:s}", "wire", s->row[i].wire, "device",
		                                      s->row[i].device, "where", s->row[i].where, "attach",
		                                      s->row[i].attach));
	json_object_set_new(all, "endpoints", rows);
	return bb_cli_print_json(all);
}

static int print(const struct bb_serve *s)
{
	if (bb_cli_has(s->cli, "json"))
		return print_json(s);
	printf("%-11s %-24s %-24s %s\n", "wire", "device", "where", "attach it with");
	for (size_t i = 0; i < s->n_rows; i++)
		printf("%-11s %-24s %-24s %s\n", s->row[i].wire, s->row[i].device, s->row[i].where, s->row[i].attach);
	printf("\n%s%s\n", s->token ? "a client's first line is the token; " : "", "serving until interrupted");
	return BB_EXIT_OK;
}

/* ---- faults ---- */

struct faults {
	size_t n;
	struct sim_fault fault[BB_CLI_MAX];
};

static enum bb_status plant(struct bb_serve *s, struct faults *f, struct bb_error *err)
{
	const struct bb_where where = { "--fault", 0, 0 };
	enum bb_status status = BB_OK;
	const char *text;

	for (int i = 0; status == BB_OK && (text = bb_cli_nth(s->cli, "fault", i)); i++)
		status = sim_fault_parse(text, &f->fault[f->n++], &where, err);
	if (status == BB_OK)
		status = sim_faults_plant(s->world, f->fault, f->n, FRAME_NS, err);
	if (status != BB_OK)
		return status;
	sim_world_set_scene_start(s->world, bb_clock_now_ns(s->clk));
	status = sim_faults_start(s->world);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1702, NULL, "%zu faults", f->n);
}

/* ---- the loop ---- */

static void serve_until(struct bb_serve *s, void *const *states, int signal_fd, int64_t end_ns)
{
	struct signalfd_siginfo told;
	int64_t wake_ns = 0;

	for (;;) {
		const int64_t now_ns = bb_clock_now_ns(s->clk);
		const int64_t until_ns[] = { wake_ns, end_ns, bb_clock_next_ns(s->clk) };
		int64_t wait_ns = WAIT_MOST_NS;
		if (now_ns >= end_ns)
			return;
		for (size_t i = 0; i < BB_ARRAY_LEN(until_ns); i++)
			wait_ns = until_ns[i] - now_ns < wait_ns ? until_ns[i] - now_ns : wait_ns;
		if (sim_wire_wait(s->wire, wait_ns > 0 ? wait_ns : 0) && read(signal_fd, &told, sizeof(told)) > 0)
			return;
		bb_clock_run_until(s->clk, bb_clock_now_ns(s->clk)); /* faults and controllers that are due */
		sim_wire_serve(s->wire);
		wake_ns = BB_NEVER;
		for (size_t k = 0; k < BB_ARRAY_LEN(kinds); k++) {
			const int64_t next_ns = kinds[k]->step ? kinds[k]->step(s, states[k], bb_clock_now_ns(s->clk)) : BB_NEVER;
			wake_ns = next_ns < wake_ns ? next_ns : wake_ns;
		}
	}
}

static enum bb_status attach_all(struct bb_serve *s, void **states, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	for (size_t k = 0; k < BB_ARRAY_LEN(kinds) && status == BB_OK; k++)
		status = kinds[k]->attach(s, &states[k], err);
	if (status == BB_OK && !s->n_rows)
		return bb_fail(err, BB_ERR_CONFIG, 1573, NULL, "%s", s->room->path);
	return status;
}

static int serve(struct bb_serve *s, struct faults *faults, struct bb_error *err)
{
	void *states[BB_ARRAY_LEN(kinds)] = { NULL };
	double for_s;
	int code = BB_EXIT_INTERNAL;
	enum bb_status status = bb_cli_number(s->cli, "for", 0, 0.01, 1e9, &for_s, err);
	const int fd = bb_cli_signals();

	prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0); /* a controller's edge is not to be 50 us late for the sake of a battery */
	if (status == BB_OK && (fd < 0 || !sim_wire_watch(s->wire, fd)))
		status = bb_fail(err, BB_ERR_INTERNAL, 1571, NULL, "no signalfd: %s", strerror(errno));
	if (status == BB_OK)
		status = attach_all(s, states, err);
	if (status == BB_OK)
		status = plant(s, faults, err);
	if (status == BB_OK) {
		const int64_t end_ns = for_s > 0 ? bb_clock_now_ns(s->clk) + (int64_t)(for_s * 1e9) : BB_NEVER;
		code = print(s);
		fflush(stdout); /* whoever waits for the ports reads a pipe */
		serve_until(s, states, fd, end_ns);
	} else {
		code = bb_cli_fail(status, err);
	}
	for (size_t k = 0; k < BB_ARRAY_LEN(kinds); k++)
		kinds[k]->detach(s, states[k]);
	if (fd >= 0)
		close(fd);
	return code;
}

static enum bb_status set_up(struct bb_serve *s, struct bb_room **room, struct bb_error *err)
{
	enum bb_status status = bb_room_load(s->cli->arg[0], room, err);

	if (status != BB_OK)
		return status;
	s->room = *room;
	status = bb_clock_posix_create(&s->clk);
	if (status == BB_OK)
		status = sim_wire_create(s->clk, &s->wire);
	if (status == BB_OK)
		status = sim_world_create(s->room, NULL, NULL, s->clk, NULL, 1, &s->world);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1702, NULL, "serve");
}

static int command(const struct bb_cli *cli)
{
	struct bb_serve *s = calloc(1, sizeof(*s));
	struct faults *faults = calloc(1, sizeof(*faults));
	struct bb_room *room = NULL;
	struct bb_error err = { 0 };
	char token[SIM_WIRE_TOKEN_MOST] = "";
	int code;

	if (!s || !faults) {
		free(s);
		free(faults);
		return bb_cli_fail(bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "serve"), &err);
	}
	s->cli = cli;
	enum bb_status status = choose_address(s, token, sizeof(token), &err);
	if (status == BB_OK)
		status = set_up(s, &room, &err);
	code = status == BB_OK ? serve(s, faults, &err) : bb_cli_fail(status, &err);
	sim_wire_destroy(s->wire);
	sim_world_destroy(s->world);
	if (s->clk)
		bb_clock_destroy(s->clk);
	bb_room_free(room);
	free(faults);
	free(s);
	return code;
}

const struct bb_command bb_cmd_serve = {
	"serve",
	"the simulated devices of a room on wires that other programs can open",
	"ROOM [--modbus-port N] [--usbip-port N] [--pty] [--can INTERFACE] [--bind ADDRESS --token-file FILE] "
	"[--fault TEXT]... [--for S] [--json]",
	options,
	1,
	1,
	command,
};
