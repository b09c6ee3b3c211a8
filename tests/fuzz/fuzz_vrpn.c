/*
 * tests/fuzz/fuzz_vrpn.c: a VRPN client's bytes at our end of the connection. Byte 0: bit 0, the rest is a lob; bits 1 and
 * 2, the cookie is put in front; the rest, in what pieces it comes. A frame is told between pieces. What we say must be
 * well-formed messages all the way.
 */
#include "drivers/mocap/vrpn.h"
#include "tests/fuzz/fuzz.h"

static const struct mocap_model model = { .n_bodies = 2, .body = { { .name = "glasses" }, { .name = "wand" } } };

/* Cookie first, then whole messages; *greeted: the cookie has been seen. */
static void check_out(struct vrpn_session *s, bool *cookie)
{
	size_t at = 0;

	if (!*cookie && s->n_out) {
		fuzz_must(s->n_out >= VRPN_COOKIE_BYTES && !memcmp(s->out, VRPN_COOKIE, 16));
		at = VRPN_COOKIE_BYTES;
		*cookie = true;
	}
	while (at < s->n_out) {
		struct vrpn_header h;
		fuzz_must(s->n_out - at >= VRPN_HEADER_BYTES);
		vrpn_get_header(s->out + at, &h);
		fuzz_must(h.length >= VRPN_HEADER_BYTES && h.length <= 24 + 4 + VRPN_NAME_MOST && h.type >= -2 && h.type <= 2);
		at += ((size_t)h.length + 7) / 8 * 8;
		fuzz_must(at <= s->n_out);
	}
	vrpn_session_sent(s, s->n_out);
}

static void lob(const uint8_t *data, size_t n)
{
	uint32_t ip;
	uint16_t port = 0;

	if (vrpn_lob_read(fuzz_exact(data, n), n, &ip, &port))
		fuzz_must(port > 0);
}

static void converse(struct fuzz_input *in, uint8_t how)
{
	static struct vrpn_session s;
	struct mocap_frame frames[2] = { { .number = 0 } };
	bool cookie = false, up = true;
	int64_t now_ns = 0;

	vrpn_session_begin(&s, &model, 0);
	if (how & 6) {
		uint8_t bytes[VRPN_COOKIE_BYTES];
		vrpn_put_cookie(bytes);
		up = vrpn_session_take(&s, bytes, sizeof(bytes), 0);
		fuzz_must(up && s.greeted);
	}
	for (int k = 0; up && in->left; k++) {
		struct mocap_frame *f = &frames[k & 1], *before = &frames[!(k & 1)];
		size_t n;
		const uint8_t *bytes = fuzz_piece(in, how & 6 ? in->left : 1u + (how >> 3), &n);
		now_ns += 8000000;
		up = vrpn_session_take(&s, bytes, n, now_ns);
		fuzz_must(up == !s.why && s.n_in < sizeof(s.in));
		f->mid_exposure_ns = now_ns;
		f->body[0] = f->body[1] = (struct mocap_pose){ .valid = k % 5 != 3, .pose = { { k, 0, 0 }, { 0, 0, 0, 1 } } };
		for (int i = 0; i < (k == 2 && how & 128 ? 200 : 1); i++) /* more than they may leave unread */
			vrpn_session_frame(&s, f, k ? before : NULL);
		fuzz_must(s.n_out <= sizeof(s.out));
		check_out(&s, &cookie);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	if (!size)
		return 0;
	if (data[0] & 1)
		lob(data + 1, size - 1);
	else
		converse(&(struct fuzz_input){ data + 1, size - 1 }, data[0]);
	return 0;
}
