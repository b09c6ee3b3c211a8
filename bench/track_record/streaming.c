/* bench/track_record/streaming.c: see streaming.h. */
#include "bench/track_record/streaming.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/mocap/natnet_wire.h"
#include "drivers/mocap/vrpn_wire.h"

/* ":1510:1511" into as many ports as there are; those that are not said stay. */
static bool read_ports(const char *text, uint16_t **port, size_t n)
{
	for (size_t i = 0; *text; i++) {
		char *end;
		if (*text != ':' || i == n || text[1] < '0' || text[1] > '9')
			return false;
		const unsigned long v = strtoul(text + 1, &end, 10);
		if (v > 65535)
			return false;
		*port[i] = (uint16_t)v;
		if (i == 0 && n == 2 && !v) /* any free one, then the other as well */
			*port[1] = 0;
		text = end;
	}
	return true;
}

static bool read_protocol(const char *word, struct bb_mocap_config *c)
{
	uint16_t *natnet[] = { &c->command_port, &c->data_port }, *vrpn[] = { &c->vrpn_port };

	if (!strncmp(word, "natnet", 6) && !c->natnet)
		return c->natnet = read_ports(word + 6, natnet, 2);
	if (!strncmp(word, "vrpn", 4) && !c->vrpn)
		return c->vrpn = read_ports(word + 4, vrpn, 1);
	return false;
}

enum bb_status bb_streaming_read(const struct bb_cli *cli, const char *text, struct bb_mocap_config *out,
                                 struct bb_error *err)
{
	const char *rest = text ? text : "natnet,vrpn", *address;
	char word[64];

	*out = (struct bb_mocap_config){ .command_port = NATNET_COMMAND_PORT, .data_port = NATNET_DATA_PORT,
		                         .vrpn_port = VRPN_PORT, .bind = bb_cli_get(cli, "bind", NULL),
		                         .multicast = bb_cli_get(cli, "multicast", NULL) };
	while (rest) {
		const char *comma = strchr(rest, ',');
		const size_t n = comma ? (size_t)(comma - rest) : strlen(rest);
		snprintf(word, sizeof(word), "%.*s", (int)(n < sizeof(word) ? n : sizeof(word) - 1), rest);
		if (n >= sizeof(word) || !read_protocol(word, out))
			return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--stream %.60s: want natnet[:COMMAND[:DATA]],vrpn[:PORT]",
			               text ? text : "");
		rest = comma ? comma + 1 : NULL;
	}
	for (int i = 0; (address = bb_cli_nth(cli, "allow", i)); i++) {
		if (out->n_allow == MOCAP_ALLOW_MAX)
			return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--allow more than %d times", MOCAP_ALLOW_MAX);
		out->allow[out->n_allow++] = address;
	}
	if (out->multicast && !out->natnet)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--multicast is of NatNet");
	return BB_OK;
}

void bb_streaming_model(struct mocap_model *model, const struct bb_body *bodies, size_t n, double rate_hz)
{
	memset(model, 0, sizeof(*model));
	model->rate_hz = rate_hz;
	model->n_bodies = n < MOCAP_BODIES_MAX ? n : MOCAP_BODIES_MAX;
	for (size_t i = 0; i < model->n_bodies; i++) {
		snprintf(model->body[i].name, sizeof(model->body[i].name), "%s", bodies[i].id);
		model->body[i].n_markers = bodies[i].n_markers;
		memcpy(model->body[i].marker, bodies[i].marker, sizeof(bodies[i].marker));
	}
}

void bb_streaming_print(const struct bb_mocap *m, const struct bb_mocap_config *c, FILE *out)
{
	const struct bb_mocap_ports p = bb_mocap_ports(m);
	const char *host = c->bind ? c->bind : "127.0.0.1";

	if (p.command)
		fprintf(out, "NatNet 3.0: %s, command port %u, data port %u%s%s\n", host, p.command, p.data,
		        c->multicast ? ", frames to 239.255.42.99 by " : "", c->multicast ? c->multicast : "");
	if (p.vrpn)
		for (size_t i = 0; i < c->model.n_bodies; i++)
			fprintf(out, "VRPN: %s@tcp://%s:%u\n", c->model.body[i].name, host, p.vrpn);
	fflush(out); /* whoever waits for the ports reads a pipe */
}

json_t *bb_streaming_json(const struct bb_mocap *m, const struct bb_mocap_config *c)
{
	const struct bb_mocap_ports p = bb_mocap_ports(m);
	json_t *bodies = json_array();

	for (size_t i = 0; i < c->model.n_bodies; i++)
		json_array_append_new(bodies, json_string(c->model.body[i].name));
	return json_pack("{s:s, s:i, s:i, s:i, s:b, s:f, s:o}", "address", c->bind ? c->bind : "127.0.0.1",
	                 "natnet_command_port", p.command, "natnet_data_port", p.data, "vrpn_port", p.vrpn, "multicast",
	                 c->multicast != NULL, "rate_hz", c->model.rate_hz, "bodies", bodies);
}
