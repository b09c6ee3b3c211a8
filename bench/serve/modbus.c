/* bench/serve/modbus.c: power strips of a room on Modbus TCP, one port each, and with --pty on Modbus RTU. */
#include "bench/serve/serve.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "sim/peer_modbus.h"

#define UNIT 1

struct strips {
	size_t n;
	struct strip {
		struct peer_modbus peer;
		struct peer_modbus_handle handle;
	} strip[];
};

static enum bb_status on_tcp(struct bb_serve *s, struct strip *t, double first_port, size_t i, struct bb_error *err)
{
	uint16_t port = (uint16_t)(first_port > 0 ? first_port + (double)i : 0);
	const struct sim_wire_listen at = { s->bind, port, s->token };
	const char *const v6[] = { strchr(s->bind, ':') ? "[" : "", strchr(s->bind, ':') ? "]" : "" };

	if (first_port > 0 && first_port + (double)i > 65535)
		return bb_fail(err, BB_ERR_USAGE, 1704, NULL, "--modbus-port %.0f leaves no port for strip %zu", first_port, i + 1);
	const enum bb_status status = sim_wire_tcp(s->wire, &at, &peer_modbus_tcp, &t->peer, &port, err);
	if (status != BB_OK)
		return status;
	struct bb_serve_row *row = bb_serve_add(s, "modbus-tcp", "power", t->peer.id, err);
	if (!row)
		return BB_ERR_RANGE;
	snprintf(row->where, sizeof(row->where), "%s%s%s:%u", v6[0], s->bind, v6[1], port);
	snprintf(row->attach, sizeof(row->attach), "modbus:tcp://%s?unit=%d", row->where, UNIT);
	return BB_OK;
}

static enum bb_status on_pty(struct bb_serve *s, struct strip *t, struct bb_error *err)
{
	char path[64];
	const enum bb_status status = sim_wire_pty(s->wire, &peer_modbus_rtu, &t->peer, path, sizeof(path), err);
	struct bb_serve_row *row;

	if (status != BB_OK)
		return status;
	row = bb_serve_add(s, "modbus-rtu", "power", t->peer.id, err);
	if (!row)
		return BB_ERR_RANGE;
	snprintf(row->where, sizeof(row->where), "%s", path);
	snprintf(row->attach, sizeof(row->attach), "modbus:rtu:%s?unit=%d", path, UNIT);
	return BB_OK;
}

static enum bb_status put_strip(struct bb_serve *s, struct strip *t, const struct bb_power_config *config,
                                double first_port, size_t i, struct bb_error *err)
{
	enum bb_status status;

	peer_modbus_init(&t->peer, config, UNIT, bb_clock_now_ns(s->clk));
	t->handle = (struct peer_modbus_handle){ &t->peer, s->clk };
	status = sim_world_register(s->world, "modbus", config->id, &t->handle, peer_modbus_verbs);
	if (status == BB_OK)
		status = sim_world_register(s->world, "power", config->id, &t->handle, peer_modbus_power_verbs);
	if (status != BB_OK)
		return bb_fail(err, status, 1702, NULL, "power/%s", config->id);
	status = on_tcp(s, t, first_port, i, err);
	return status == BB_OK && bb_cli_has(s->cli, "pty") ? on_pty(s, t, err) : status;
}

static enum bb_status attach(struct bb_serve *s, void **state, struct bb_error *err)
{
	double port;
	enum bb_status status = bb_cli_whole(s->cli, "modbus-port", 1502, 0, 65535, &port, err);
	struct strips *all = calloc(1, sizeof(*all) + s->room->n_pdus * sizeof(all->strip[0]));

	*state = all;
	if (!all)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu strips", s->room->n_pdus);
	for (size_t i = 0; i < s->room->n_pdus && status == BB_OK; i++)
		if (bb_serve_simulated(s->room->pdus[i].device)) {
			status = put_strip(s, &all->strip[all->n], &s->room->pdus[i], port, all->n, err);
			all->n++;
		}
	return status;
}

static void detach(struct bb_serve *s, void *state)
{
	struct strips *all = state;

	for (size_t i = 0; all && i < all->n; i++)
		for (int twice = 0; twice < 2; twice++)
			sim_world_unregister(s->world, &all->strip[i].handle);
	free(all);
}

const struct bb_serve_kind bb_serve_modbus = { "modbus", attach, NULL, detach };
