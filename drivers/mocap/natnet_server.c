/* drivers/mocap/natnet_server.c: clients, answers, frames; see natnet_server.h. */
#include "drivers/mocap/natnet_server.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/bytes.h"

#define MARKER_SIZE_M 0.012F /* of a small tracking sphere; rooms do not say */
#define FRAME_BYTES_MOST 16384

struct client {
	struct natnet_address at;
	int64_t heard_ns;
};

struct natnet_server {
	struct natnet_server_config config;
	size_t n_clients;
	struct client client[NATNET_CLIENTS_MAX];
	struct natnet_counts counts;
	int64_t filled_ns;       /* when tokens were counted last */
	int64_t tokens_ns;       /* each answer costs a second / NATNET_ANSWERS_PER_S */
	size_t n_frame;
	uint8_t frame[FRAME_BYTES_MOST];
	struct natnet_message heard, said;
};

bool natnet_server_create(const struct natnet_server_config *config, struct natnet_server **out)
{
	*out = calloc(1, sizeof(**out));
	if (*out)
		natnet_server_begin(*out, config);
	return *out;
}

void natnet_server_begin(struct natnet_server *s, const struct natnet_server_config *config)
{
	memset(s, 0, offsetof(struct natnet_server, frame));
	s->config = *config;
	s->tokens_ns = NATNET_ANSWERS_BURST * (BB_NS_PER_S / NATNET_ANSWERS_PER_S);
}

void natnet_server_destroy(struct natnet_server *s)
{
	free(s);
}

const struct natnet_counts *natnet_server_counts(const struct natnet_server *s)
{
	return &s->counts;
}

/* ---- clients ---- */

static struct client *client_of(struct natnet_server *s, const struct natnet_address *at)
{
	for (size_t i = 0; i < s->n_clients; i++)
		if (s->client[i].at.ip == at->ip && s->client[i].at.port == at->port && s->client[i].at.way == at->way)
			return &s->client[i];
	return NULL;
}

static void admit(struct natnet_server *s, const struct natnet_address *at, int64_t now_ns)
{
	if (s->n_clients == NATNET_CLIENTS_MAX) {
		s->counts.refused_clients++;
		return;
	}
	s->client[s->n_clients++] = (struct client){ *at, now_ns };
}

const struct natnet_address *natnet_server_client(const struct natnet_server *s, size_t i)
{
	return i < s->n_clients && !s->config.multicast ? &s->client[i].at : NULL;
}

size_t natnet_server_expire(struct natnet_server *s, int64_t now_ns, struct natnet_address *who, uint8_t *out, size_t cap)
{
	for (size_t i = 0; i < s->n_clients; i++) {
		if (now_ns - s->client[i].heard_ns < NATNET_SILENCE_NS)
			continue;
		*who = s->client[i].at;
		s->client[i] = s->client[--s->n_clients];
		s->counts.timed_out++;
		s->said.id = NATNET_DISCONNECT_TIMEOUT;
		s->said.raw.n = 0;
		return natnet_write(&s->said, out, cap);
	}
	return 0;
}

/* ---- answers ---- */

static bool may_answer(struct natnet_server *s, int64_t now_ns)
{
	const int64_t price_ns = BB_NS_PER_S / NATNET_ANSWERS_PER_S, most_ns = NATNET_ANSWERS_BURST * price_ns;
	const int64_t since_ns = now_ns - s->filled_ns;

	s->tokens_ns = since_ns < 0 ? s->tokens_ns : since_ns > most_ns ? most_ns : s->tokens_ns + since_ns;
	s->tokens_ns = s->tokens_ns > most_ns ? most_ns : s->tokens_ns;
	s->filled_ns = now_ns;
	if (s->tokens_ns < price_ns) {
		s->counts.beyond_rate++;
		return false;
	}
	s->tokens_ns -= price_ns;
	return true;
}

static void tell_server(const struct natnet_server *s, struct natnet_message *m)
{
	static const uint8_t group[4] = { 239, 255, 42, 99 };

	memset(&m->server, 0, sizeof(m->server));
	m->id = NATNET_SERVER_INFO;
	snprintf(m->server.hello.name, sizeof(m->server.hello.name), "blackburst");
	m->server.hello.version[0] = 1;
	m->server.hello.natnet_version[0] = 3;
	m->server.clock_hz = BB_NS_PER_S;
	m->server.data_port = s->config.data_port;
	m->server.multicast = s->config.multicast;
	memcpy(m->server.address, group, sizeof(group)); /* told by Motive in unicast, too */
}

static void tell_body(const struct mocap_model *from, size_t i, struct natnet_model *set, struct natnet_model *body,
                      struct natnet_model *all)
{
	const size_t n = from->body[i].n_markers;

	set->kind = all->kind = NATNET_MARKER_SET;
	body->kind = NATNET_RIGID_BODY;
	snprintf(set->name, sizeof(set->name), "%s", from->body[i].name);
	snprintf(body->name, sizeof(body->name), "%s", from->body[i].name);
	snprintf(all->name, sizeof(all->name), "all");
	body->id = (int32_t)i + 1;
	body->parent = -1;
	memset(body->offset, 0, sizeof(body->offset));
	set->n_markers = body->n_markers = (int32_t)n;
	for (size_t k = 0; k < n; k++) {
		const struct bb_vec3 at = from->body[i].marker[k];
		body->at[k][0] = (float)at.x;
		body->at[k][1] = (float)at.y;
		body->at[k][2] = (float)at.z;
		body->label[k] = 0; /* of active markers */
		snprintf(set->marker[k], NATNET_NAME_MOST, "Marker%zu", k + 1);
		if (all->n_markers < NATNET_MODEL_MARKERS_MOST)
			snprintf(all->marker[all->n_markers++], NATNET_NAME_MOST, "%s_%zu", from->body[i].name, k + 1);
	}
}

/* As Motive does: each body, a marker set of the same name, and in the end a set of all. */
static void tell_models(const struct natnet_server *s, struct natnet_message *m)
{
	const struct mocap_model *from = &s->config.model;
	const size_t n = from->n_bodies < (NATNET_MODELS_MOST - 1) / 2 ? from->n_bodies : (NATNET_MODELS_MOST - 1) / 2;
	struct natnet_model *model = m->models.model, *all = &model[2 * n];

	m->id = NATNET_MODELS;
	m->models.n = (int32_t)(2 * n + 1);
	m->models.n_others = 0;
	all->kind = NATNET_MARKER_SET;
	all->n_markers = 0;
	snprintf(all->name, sizeof(all->name), "all");
	for (size_t i = 0; i < n; i++)
		tell_body(from, i, &model[2 * i + 1], &model[2 * i], all);
}

/* The few commands that a stream without Motive's remote control can answer. */
static void tell_answer(const struct natnet_server *s, const struct natnet_message *heard, struct natnet_message *m)
{
	const struct { const char *command; float number; int32_t whole; } known[] = {
		{ "FrameRate", (float)s->config.model.rate_hz, 0 },
		{ "UnitsToMillimeters", 1000, 0 },
		{ "UpAxis", 0, 1 }, /* Y */
	};

	m->id = NATNET_UNRECOGNIZED;
	m->raw.n = 0;
	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++) {
		const size_t n = strlen(known[i].command);
		if (heard->raw.n < n || memcmp(heard->raw.bytes, known[i].command, n) ||
		    (heard->raw.n > n && heard->raw.bytes[n]))
			continue;
		m->id = NATNET_RESPONSE;
		m->raw.n = 4;
		memcpy(m->raw.bytes, known[i].whole ? (const void *)&known[i].whole : (const void *)&known[i].number, 4);
	}
}

static size_t answer(struct natnet_server *s, const struct natnet_message *heard, int64_t now_ns, uint8_t *out, size_t cap)
{
	struct natnet_message *m = &s->said;

	switch (heard->id) {
	case NATNET_CONNECT:
	case NATNET_DISCOVERY:
		tell_server(s, m);
		break;
	case NATNET_REQUEST_MODELS:
		tell_models(s, m);
		break;
	case NATNET_REQUEST_FRAME:
		if (!s->n_frame || s->n_frame > cap)
			return 0;
		memcpy(out, s->frame, s->n_frame);
		return s->n_frame;
	case NATNET_ECHO_REQUEST:
		m->id = NATNET_ECHO_RESPONSE;
		m->echo.sent = heard->echo.sent;
		m->echo.received = (uint64_t)now_ns;
		break;
	case NATNET_REQUEST:
		tell_answer(s, heard, m);
		break;
	default: /* keepalive; the rest is what servers say */
		return 0;
	}
	return natnet_write(m, out, cap);
}

size_t natnet_server_hear(struct natnet_server *s, const struct natnet_address *from, const uint8_t *bytes, size_t n,
                          int64_t now_ns, uint8_t *out, size_t cap)
{
	struct client *client = client_of(s, from);
	const char *why;

	s->counts.heard++;
	if (!natnet_read(bytes, n, &s->heard, &why)) {
		s->counts.malformed++;
		return 0;
	}
	const uint16_t id = s->heard.id;
	if (client && id == NATNET_DISCONNECT)
		*client = s->client[--s->n_clients];
	else if (client)
		client->heard_ns = now_ns;
	else if (id == NATNET_CONNECT || id == NATNET_KEEPALIVE)
		admit(s, from, now_ns);
	if (id == NATNET_KEEPALIVE || id == NATNET_DISCONNECT || !may_answer(s, now_ns))
		return 0;
	const size_t said = answer(s, &s->heard, now_ns, out, cap);
	s->counts.answered += said > 0;
	return said;
}

/* ---- frames ---- */

static void put_vec(float at[3], struct bb_vec3 v)
{
	at[0] = (float)v.x;
	at[1] = (float)v.y;
	at[2] = (float)v.z;
}

static void put_markers(const struct mocap_model *model, size_t i, const struct mocap_pose *b, struct natnet_frame *f)
{
	struct natnet_marker_set *set = &f->set[i], *all = &f->set[f->n_sets - 1];

	for (size_t k = 0; k < model->body[i].n_markers; k++) {
		struct natnet_marker *m = &f->marker[f->n_markers++];
		const struct bb_vec3 at = bb_pose_apply(&b->pose, model->body[i].marker[k]);
		*m = (struct natnet_marker){ .id = (int32_t)((i + 1) << 16 | (k + 1)), .size = MARKER_SIZE_M,
			                     .params = NATNET_MODEL_SOLVED | NATNET_HAS_MODEL,
			                     .residual = (float)b->error_m };
		m->params = (int16_t)(m->params | (b->valid ? 0 : NATNET_OCCLUDED));
		put_vec(m->at, at);
		put_vec(set->at[set->n++], at);
		if (all->n < NATNET_SET_MARKERS_MOST)
			put_vec(all->at[all->n++], at);
	}
}

static void put_body(size_t i, const struct mocap_pose *b, struct natnet_frame *f)
{
	struct natnet_rigid_body *r = &f->body[i];

	*r = (struct natnet_rigid_body){ .id = (int32_t)i + 1, .error = (float)b->error_m,
		                         .q = { (float)b->pose.q.x, (float)b->pose.q.y, (float)b->pose.q.z, (float)b->pose.q.w },
		                         .params = b->valid ? NATNET_TRACKED : 0 };
	put_vec(r->at, b->pose.p);
}

static void put_stamps(const struct mocap_frame *frame, struct natnet_frame *f)
{
	f->timecode = f->timecode_sub = 0;
	f->timestamp_s = (double)frame->mid_exposure_ns * 1e-9;
	f->mid_exposure = (uint64_t)frame->mid_exposure_ns;
	f->received = (uint64_t)frame->received_ns;
	f->transmitted = (uint64_t)frame->sent_ns;
	f->params = frame->recorded ? NATNET_RECORDING : 0;
	f->has_end = true;
	f->end = 0;
}

size_t natnet_server_frame(struct natnet_server *s, const struct mocap_frame *frame, const uint8_t **bytes)
{
	const struct mocap_model *model = &s->config.model;
	struct natnet_frame *f = &s->said.frame;
	const size_t most = NATNET_SETS_MOST - 1, n = model->n_bodies < most ? model->n_bodies : most;

	s->said.id = NATNET_FRAME;
	f->number = frame->number;
	f->n_unlabelled = f->n_skeletons = f->n_plates = f->n_devices = f->n_markers = 0;
	f->n_sets = (int32_t)n + 1;
	f->n_bodies = (int32_t)n;
	for (size_t i = 0; i <= n; i++) {
		f->set[i].n = 0;
		snprintf(f->set[i].name, NATNET_NAME_MOST, "%s", i < n ? model->body[i].name : "all");
	}
	for (size_t i = 0; i < n; i++) {
		put_markers(model, i, &frame->body[i], f);
		put_body(i, &frame->body[i], f);
	}
	put_stamps(frame, f);
	s->n_frame = natnet_write(&s->said, s->frame, sizeof(s->frame));
	*bytes = s->frame;
	return s->n_frame;
}
