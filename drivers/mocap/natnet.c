/*
 * drivers/mocap/natnet.c: one walk over the fields of each message, which reads or writes: the layout stands here once.
 * It is pinned by captures of Motive and by bytes written out by hand in tests/test_natnet.c.
 */
#include "drivers/mocap/natnet.h"

#include <string.h>

#include "hal/bytes.h"

struct walk {
	const uint8_t *in;  /* NULL: writing */
	uint8_t *out;
	size_t left;        /* bytes to read, or room to write */
	const char *why;    /* NULL: so far so good */
};

static bool good(const struct walk *w)
{
	return !w->why;
}

static void bytes(struct walk *w, void *at, size_t n)
{
	if (w->why || n > w->left) {
		w->why = w->why ? w->why : "it ends too soon";
		return;
	}
	if (w->in) {
		memcpy(at, w->in, n);
		w->in += n;
	} else {
		memcpy(w->out, at, n);
		w->out += n;
	}
	w->left -= n;
}

/* The machine is little-endian as the wire is, or this would not compile. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are copied as they are");
#define number(w, at) bytes(w, at, sizeof(*(at)))

static void skip(struct walk *w, size_t n)
{
	if (w->why || n > w->left) {
		w->why = w->why ? w->why : "it ends too soon";
		return;
	}
	w->in += n;
	w->left -= n;
}

/* A count that an array of ours has to hold, of things of so many bytes at least. */
static void count(struct walk *w, int32_t *n, int32_t most, size_t least_bytes)
{
	number(w, n);
	if (good(w) && (*n < 0 || *n > most))
		w->why = "a count out of range";
	if (good(w) && w->in && (size_t)*n * least_bytes > w->left)
		w->why = "more is counted than comes";
	if (!good(w) && w->in)
		*n = 0;
}

static void name(struct walk *w, char at[NATNET_NAME_MOST])
{
	size_t n = 0;

	if (!good(w))
		return;
	const char *from = w->in ? (const char *)w->in : at;
	const size_t most = w->in && w->left < NATNET_NAME_MOST ? w->left : NATNET_NAME_MOST;
	while (n < most && from[n])
		n++;
	if (n == most)
		w->why = "a name without end";
	else
		bytes(w, at, n + 1);
}

/* ---- frames ---- */

static void rigid_body(struct walk *w, struct natnet_rigid_body *b)
{
	number(w, &b->id);
	number(w, &b->at);
	number(w, &b->q);
	number(w, &b->error);
	number(w, &b->params);
}
#define RIGID_BODY_BYTES 38

static void marker(struct walk *w, struct natnet_marker *m)
{
	number(w, &m->id);
	number(w, &m->at);
	number(w, &m->size);
	number(w, &m->params);
	number(w, &m->residual);
}
#define MARKER_BYTES 26

static void marker_set(struct walk *w, struct natnet_marker_set *s)
{
	name(w, s->name);
	count(w, &s->n, NATNET_SET_MARKERS_MOST, sizeof(s->at[0]));
	bytes(w, s->at, (size_t)s->n * sizeof(s->at[0]));
}

/* What we neither have nor make: written as none, read past. */
static void skeletons(struct walk *w, int32_t *n)
{
	count(w, n, w->in ? 256 : 0, 8);
	for (int32_t i = 0; i < *n && good(w); i++) {
		int32_t bones = 0;
		skip(w, 4);
		count(w, &bones, 256, RIGID_BODY_BYTES);
		skip(w, (size_t)bones * RIGID_BODY_BYTES);
	}
}

/* Force plates and devices: channels of samples. */
static void analogs(struct walk *w, int32_t *n)
{
	count(w, n, w->in ? 64 : 0, 8);
	for (int32_t i = 0; i < *n && good(w); i++) {
		int32_t channels = 0;
		skip(w, 4);
		count(w, &channels, 256, 4);
		for (int32_t c = 0; c < channels && good(w); c++) {
			int32_t samples = 0;
			count(w, &samples, 4096, 4);
			skip(w, (size_t)samples * 4);
		}
	}
}

static void suffix(struct walk *w, struct natnet_frame *f)
{
	number(w, &f->timecode);
	number(w, &f->timecode_sub);
	number(w, &f->timestamp_s);
	number(w, &f->mid_exposure);
	number(w, &f->received);
	number(w, &f->transmitted);
	number(w, &f->params);
	if (w->in)
		f->has_end = good(w) && w->left == sizeof(f->end);
	if (f->has_end)
		number(w, &f->end);
}

static void frame(struct walk *w, struct natnet_frame *f)
{
	number(w, &f->number);
	count(w, &f->n_sets, NATNET_SETS_MOST, 5);
	for (int32_t i = 0; i < f->n_sets && good(w); i++)
		marker_set(w, &f->set[i]);
	count(w, &f->n_unlabelled, NATNET_MARKERS_MOST, sizeof(f->unlabelled[0]));
	bytes(w, f->unlabelled, (size_t)f->n_unlabelled * sizeof(f->unlabelled[0]));
	count(w, &f->n_bodies, NATNET_BODIES_MOST, RIGID_BODY_BYTES);
	for (int32_t i = 0; i < f->n_bodies && good(w); i++)
		rigid_body(w, &f->body[i]);
	skeletons(w, &f->n_skeletons);
	count(w, &f->n_markers, NATNET_MARKERS_MOST, MARKER_BYTES);
	for (int32_t i = 0; i < f->n_markers && good(w); i++)
		marker(w, &f->marker[i]);
	analogs(w, &f->n_plates);
	analogs(w, &f->n_devices);
	suffix(w, f);
}

/* ---- model definitions ---- */

static void body_model(struct walk *w, struct natnet_model *m)
{
	number(w, &m->id);
	number(w, &m->parent);
	number(w, &m->offset);
	count(w, &m->n_markers, NATNET_MODEL_MARKERS_MOST, sizeof(m->at[0]) + sizeof(m->label[0]));
	bytes(w, m->at, (size_t)m->n_markers * sizeof(m->at[0]));
	bytes(w, m->label, (size_t)m->n_markers * sizeof(m->label[0]));
}

static void set_model(struct walk *w, struct natnet_model *m)
{
	count(w, &m->n_markers, NATNET_MODEL_MARKERS_MOST, 1);
	for (int32_t i = 0; i < m->n_markers && good(w); i++)
		name(w, m->marker[i]);
}

/* Bones are rigid bodies with names, which end before the place of the next model is needed. */
static void skeleton_model(struct walk *w, struct natnet_model *spare)
{
	int32_t bones = 0;

	skip(w, 4);
	count(w, &bones, 256, 25);
	for (int32_t i = 0; i < bones && good(w); i++) {
		name(w, spare->name);
		body_model(w, spare);
	}
}

static void models(struct walk *w, struct natnet_models *all)
{
	int32_t n = all->n;

	count(w, &n, NATNET_MODELS_MOST, sizeof(int32_t));
	if (w->in)
		all->n = all->n_others = 0;
	else if (all->n_others)
		w->why = "only sets and bodies are written";
	for (int32_t i = 0; i < n && good(w); i++) {
		struct natnet_model *m = &all->model[w->in ? all->n : i];
		number(w, &m->kind);
		if (good(w) && w->in && m->kind > NATNET_SKELETON) { /* force plates, devices, cameras: they come last */
			all->n_others += n - i;
			skip(w, w->left);
			return;
		}
		name(w, m->name);
		if (m->kind == NATNET_RIGID_BODY)
			body_model(w, m);
		else if (m->kind == NATNET_MARKER_SET)
			set_model(w, m);
		else if (m->kind == NATNET_SKELETON && w->in)
			skeleton_model(w, m);
		else
			w->why = w->why ? w->why : "a kind of model nobody knows";
		if (w->in)
			*(m->kind == NATNET_SKELETON ? &all->n_others : &all->n) += 1;
	}
}

/* ---- messages ---- */

static void hello(struct walk *w, struct natnet_hello *h)
{
	number(w, &h->name);
	number(w, &h->version);
	number(w, &h->natnet_version);
}

static void server_info(struct walk *w, struct natnet_server_info *s)
{
	hello(w, &s->hello);
	number(w, &s->clock_hz);
	number(w, &s->data_port);
	number(w, &s->multicast);
	number(w, &s->address);
}

static void raw(struct walk *w, struct natnet_message *m)
{
	if (w->in && w->left > NATNET_RAW_MOST)
		w->why = "longer than such a message is";
	else if (w->in)
		m->raw.n = (uint16_t)w->left;
	else if (m->raw.n > NATNET_RAW_MOST)
		w->why = "longer than such a message is";
	if (good(w))
		bytes(w, m->raw.bytes, m->raw.n);
}

static void payload(struct walk *w, struct natnet_message *m)
{
	if (w->in)
		m->bare = m->id == NATNET_CONNECT && w->left != sizeof(m->hello);
	if (m->id == NATNET_CONNECT && !m->bare)
		hello(w, &m->hello);
	else if (m->id == NATNET_SERVER_INFO)
		server_info(w, &m->server);
	else if (m->id == NATNET_MODELS)
		models(w, &m->models);
	else if (m->id == NATNET_FRAME)
		frame(w, &m->frame);
	else if (m->id == NATNET_ECHO_REQUEST || m->id == NATNET_ECHO_RESPONSE)
		bytes(w, &m->echo, m->id == NATNET_ECHO_REQUEST ? 8 : 16);
	else
		raw(w, m);
}

static bool known(uint16_t id)
{
	return id <= NATNET_DISCOVERY || id == NATNET_UNRECOGNIZED;
}

bool natnet_read(const uint8_t *in, size_t n, struct natnet_message *out, const char **why)
{
	*why = NULL;
	out->id = n < NATNET_HEADER_BYTES ? 0 : (uint16_t)bb_get_le(in, 2);
	if (n < NATNET_HEADER_BYTES || bb_get_le(in + 2, 2) != n - NATNET_HEADER_BYTES)
		*why = "not as long as it says";
	else if (!known(out->id))
		*why = "a message nobody knows";
	if (*why)
		return false;
	struct walk w = { .in = in + NATNET_HEADER_BYTES, .left = n - NATNET_HEADER_BYTES };
	payload(&w, out);
	*why = w.why ? w.why : w.left ? "there is more than belongs to it" : NULL;
	return !*why;
}

size_t natnet_write(const struct natnet_message *m, uint8_t *out, size_t cap)
{
	struct natnet_message *same = (struct natnet_message *)(uintptr_t)m; /* a walk that writes changes no field */

	if (cap < NATNET_HEADER_BYTES || !known(m->id))
		return 0;
	const size_t room = (cap < NATNET_DATAGRAM_MOST ? cap : NATNET_DATAGRAM_MOST) - NATNET_HEADER_BYTES;
	struct walk w = { .out = out + NATNET_HEADER_BYTES, .left = room };
	payload(&w, same);
	if (w.why)
		return 0;
	bb_put_le(out, m->id, 2);
	bb_put_le(out + 2, room - w.left, 2);
	return NATNET_HEADER_BYTES + room - w.left;
}
