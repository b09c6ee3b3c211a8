/* drivers/mocap/vrpn.c: see vrpn.h. */
#include "drivers/mocap/vrpn.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TYPE_POS_QUAT, TYPE_VELOCITY, TYPE_PONG, TYPES };
static const char *const types[TYPES] = { VRPN_POS_QUAT, VRPN_VELOCITY, VRPN_PONG };

/* ---- numbers ---- */

static void put32(uint8_t *at, int32_t v)
{
	for (int i = 0; i < 4; i++)
		at[i] = (uint8_t)((uint32_t)v >> (24 - 8 * i));
}

static int32_t get32(const uint8_t *at)
{
	return (int32_t)((uint32_t)at[0] << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3]);
}

static uint8_t *put_double(uint8_t *at, double v)
{
	uint64_t bits;

	memcpy(&bits, &v, sizeof(bits));
	for (int i = 0; i < 8; i++)
		at[i] = (uint8_t)(bits >> (56 - 8 * i));
	return at + 8;
}

void vrpn_put_header(uint8_t out[VRPN_HEADER_BYTES], const struct vrpn_header *h)
{
	put32(out, h->length);
	put32(out + 4, h->seconds);
	put32(out + 8, h->micros);
	put32(out + 12, h->sender);
	put32(out + 16, h->type);
	put32(out + 20, h->sequence);
}

void vrpn_get_header(const uint8_t in[VRPN_HEADER_BYTES], struct vrpn_header *h)
{
	*h = (struct vrpn_header){ get32(in), get32(in + 4), get32(in + 8), get32(in + 12), get32(in + 16), get32(in + 20) };
}

void vrpn_put_cookie(uint8_t out[VRPN_COOKIE_BYTES])
{
	memset(out, 0, VRPN_COOKIE_BYTES);
	memcpy(out, VRPN_COOKIE "  0", VRPN_COOKIE_LOG + 1);
}

static uint8_t *put_pose(uint8_t *at, int32_t sensor, struct bb_vec3 p, struct bb_quat q)
{
	const double v[7] = { p.x, p.y, p.z, q.x, q.y, q.z, q.w };

	put32(at, sensor);
	put32(at + 4, sensor); /* fills up to 8 bytes */
	at += 8;
	for (int i = 0; i < 7; i++)
		at = put_double(at, v[i]);
	return at;
}

void vrpn_put_pos_quat(uint8_t out[VRPN_POS_QUAT_BYTES], int32_t sensor, const struct bb_pose *pose)
{
	put_pose(out, sensor, pose->p, pose->q);
}

void vrpn_put_velocity(uint8_t out[VRPN_VELOCITY_BYTES], int32_t sensor, struct bb_vec3 v_m_s, struct bb_quat turn,
                       double dt_s)
{
	put_double(put_pose(out, sensor, v_m_s, turn), dt_s);
}

/* ---- out ---- */

static size_t padded(size_t n)
{
	return (n + VRPN_ALIGN - 1) / VRPN_ALIGN * VRPN_ALIGN;
}

static bool fits(const struct vrpn_session *s, size_t n_payload)
{
	return s->n_out + VRPN_HEADER_BYTES + padded(n_payload) <= VRPN_OUT_BYTES;
}

static void say(struct vrpn_session *s, int64_t at_ns, int32_t sender, int32_t type, const void *payload, size_t n)
{
	uint8_t *at = s->out + s->n_out;
	const struct vrpn_header h = { .length = (int32_t)(VRPN_HEADER_BYTES + n), .seconds = (int32_t)(at_ns / BB_NS_PER_S),
		                       .micros = (int32_t)(at_ns % BB_NS_PER_S / 1000), .sender = sender, .type = type,
		                       .sequence = s->sequence++ };

	vrpn_put_header(at, &h);
	memset(at + VRPN_HEADER_BYTES, 0, padded(n));
	if (n)
		memcpy(at + VRPN_HEADER_BYTES, payload, n);
	s->n_out += VRPN_HEADER_BYTES + padded(n);
}

/* i32 length with its NUL, the name; the id that it describes stands where the sender does. */
static void describe(struct vrpn_session *s, int64_t now_ns, int32_t kind, int32_t id, const char *name)
{
	uint8_t payload[4 + VRPN_NAME_MOST] = { 0 };
	const int n = snprintf((char *)payload + 4, VRPN_NAME_MOST, "%s", name);

	put32(payload, n + 1);
	say(s, now_ns, id, kind, payload, (size_t)n + 5);
}

static void introduce(struct vrpn_session *s, int64_t now_ns)
{
	for (size_t i = 0; i < s->model->n_bodies; i++)
		describe(s, now_ns, VRPN_SENDER_DESCRIPTION, (int32_t)i, s->model->body[i].name);
	for (int32_t i = 0; i < TYPES; i++)
		describe(s, now_ns, VRPN_TYPE_DESCRIPTION, i, types[i]);
}

void vrpn_session_begin(struct vrpn_session *s, const struct mocap_model *model, int64_t now_ns)
{
	memset(s, 0, sizeof(*s));
	s->model = model;
	s->began_ns = now_ns;
	s->ping = -1;
	vrpn_put_cookie(s->out);
	s->n_out = VRPN_COOKIE_BYTES;
}

void vrpn_session_sent(struct vrpn_session *s, size_t n)
{
	s->n_out -= n;
	memmove(s->out, s->out + n, s->n_out);
}

/* ---- in ---- */

static bool hang_up(struct vrpn_session *s, const char *why)
{
	s->why = why;
	return false;
}

static bool take_cookie(struct vrpn_session *s, int64_t now_ns)
{
	if (memcmp(s->in, VRPN_COOKIE, VRPN_COOKIE_MAJOR) != 0)
		return hang_up(s, "no VRPN 7 at the other end");
	s->greeted = true;
	introduce(s, now_ns);
	return true;
}

/* "glasses" and "glasses@tcp://host:3883" are the same sender. */
static int8_t body_named(const struct mocap_model *model, const char *name, size_t n)
{
	const char *at = memchr(name, '@', n);

	n = at ? (size_t)(at - name) : n;
	for (size_t i = 0; i < model->n_bodies; i++)
		if (strlen(model->body[i].name) == n && !memcmp(model->body[i].name, name, n))
			return (int8_t)(i + 1);
	return 0;
}

static bool take_description(struct vrpn_session *s, const struct vrpn_header *h, const uint8_t *payload, size_t n)
{
	const int32_t length = n >= 4 ? get32(payload) : 0;

	if (length < 1 || length > VRPN_NAME_MOST || (size_t)length + 4 > n || payload[3 + length])
		return hang_up(s, "a description that is none");
	if (h->sender < 0 || h->sender >= VRPN_IDS_MAX)
		return hang_up(s, "an id out of range");
	const char *name = (const char *)payload + 4;
	const size_t n_name = strlen(name);
	if (h->type == VRPN_SENDER_DESCRIPTION)
		s->body_of[h->sender] = body_named(s->model, name, n_name);
	else if (n_name == sizeof(VRPN_PING) - 1 && !memcmp(name, VRPN_PING, n_name))
		s->ping = h->sender;
	return true;
}

static bool take_message(struct vrpn_session *s, const struct vrpn_header *h, const uint8_t *payload, size_t n,
                         int64_t now_ns)
{
	if (h->type == VRPN_SENDER_DESCRIPTION || h->type == VRPN_TYPE_DESCRIPTION)
		return take_description(s, h, payload, n);
	if (h->type == VRPN_DISCONNECT)
		return hang_up(s, "they said good-bye");
	if (h->type < VRPN_DISCONNECT)
		return hang_up(s, "a message of a kind nobody knows");
	/* A remote device asks every second whether anybody is there, and complains when nobody is. */
	if (h->type >= 0 && h->type == s->ping && h->sender >= 0 && h->sender < VRPN_IDS_MAX && s->body_of[h->sender] &&
	    fits(s, 0))
		say(s, now_ns, s->body_of[h->sender] - 1, TYPE_PONG, NULL, 0);
	return true;
}

/* One cookie or message from the front of in; *used 0: it is not there yet. */
static bool take_one(struct vrpn_session *s, size_t *used, int64_t now_ns)
{
	struct vrpn_header h;

	*used = 0;
	if (!s->greeted) {
		if (s->n_in < VRPN_COOKIE_BYTES)
			return true;
		*used = VRPN_COOKIE_BYTES;
		return take_cookie(s, now_ns);
	}
	if (s->n_in < VRPN_HEADER_BYTES)
		return true;
	vrpn_get_header(s->in, &h);
	if (h.length < VRPN_HEADER_BYTES || padded((size_t)h.length) > VRPN_MESSAGE_MOST)
		return hang_up(s, "a message of a length that cannot be");
	if (s->n_in < padded((size_t)h.length))
		return true;
	*used = padded((size_t)h.length);
	return take_message(s, &h, s->in + VRPN_HEADER_BYTES, (size_t)h.length - VRPN_HEADER_BYTES, now_ns);
}

bool vrpn_session_take(struct vrpn_session *s, const uint8_t *bytes, size_t n, int64_t now_ns)
{
	while (n) {
		const size_t room = VRPN_MESSAGE_MOST - s->n_in, piece = n < room ? n : room;
		size_t used = 1;
		memcpy(s->in + s->n_in, bytes, piece);
		s->n_in += piece;
		bytes += piece;
		n -= piece;
		while (used) {
			if (!take_one(s, &used, now_ns))
				return false;
			s->n_in -= used;
			memmove(s->in, s->in + used, s->n_in);
		}
	}
	return true;
}

/* ---- frames ---- */

static void say_velocity(struct vrpn_session *s, int32_t i, const struct mocap_frame *now, const struct mocap_frame *before)
{
	const double dt_s = (double)(now->mid_exposure_ns - before->mid_exposure_ns) * 1e-9;
	const struct bb_pose *a = &before->body[i].pose, *b = &now->body[i].pose;
	uint8_t payload[VRPN_VELOCITY_BYTES];

	if (!before->body[i].valid || !(dt_s > 1e-6 && dt_s < 0.5))
		return;
	vrpn_put_velocity(payload, 0, bb_vec3_scale(bb_vec3_sub(b->p, a->p), 1 / dt_s),
	                  bb_quat_mul(b->q, bb_quat_conj(a->q)), dt_s);
	say(s, now->mid_exposure_ns, i, TYPE_VELOCITY, payload, sizeof(payload));
}

void vrpn_session_frame(struct vrpn_session *s, const struct mocap_frame *frame, const struct mocap_frame *before)
{
	const size_t most = s->model->n_bodies * (2 * VRPN_HEADER_BYTES + VRPN_POS_QUAT_BYTES + VRPN_VELOCITY_BYTES);

	if (!s->greeted)
		return;
	if (s->n_out + most > VRPN_OUT_BYTES) {
		s->dropped++;
		return;
	}
	for (size_t i = 0; i < s->model->n_bodies; i++) {
		uint8_t payload[VRPN_POS_QUAT_BYTES];
		if (!frame->body[i].valid) /* a tracker that sees nothing says nothing */
			continue;
		vrpn_put_pos_quat(payload, 0, &frame->body[i].pose);
		say(s, frame->mid_exposure_ns, (int32_t)i, TYPE_POS_QUAT, payload, sizeof(payload));
		if (before)
			say_velocity(s, (int32_t)i, frame, before);
		s->poses++;
	}
}

/* ---- lobs ---- */

/* Digits, most at most, and then exactly this sign. */
static bool number_then(const char **text, char sign, long most, long *out)
{
	char *end;

	if (**text < '0' || **text > '9')
		return false;
	*out = strtol(*text, &end, 10);
	*text = end + 1;
	return *end == sign && *out <= most;
}

bool vrpn_lob_read(const uint8_t *bytes, size_t n, uint32_t *ip, uint16_t *port)
{
	static const char signs[] = "... ";
	const char *at;
	char text[64];
	uint8_t part[4];
	long v;

	while (n && !bytes[n - 1])
		n--;
	if (n >= sizeof(text) || memchr(bytes, 0, n))
		return false;
	memcpy(text, bytes, n);
	text[n] = '\0';
	at = text;
	for (int i = 0; i < 4; i++) {
		if (!number_then(&at, signs[i], 255, &v))
			return false;
		part[i] = (uint8_t)v;
	}
	if (!number_then(&at, '\0', 65535, &v) || !v)
		return false;
	memcpy(ip, part, sizeof(part));
	*port = (uint16_t)v;
	return true;
}
