/*
 * tests/fuzz/fuzz_natnet.c: bytes as NatNet datagrams. Bit 7 of byte 0 off: one datagram, read and written again, which
 * must give the same bytes, and must fail in less room (byte 1 says how much). On: a row of datagrams at a server, each
 * after a byte of who sends it and when, and a byte of its length.
 */
#include "drivers/mocap/natnet_server.h"
#include "tests/fuzz/fuzz.h"

static struct natnet_message message;
static uint8_t out[NATNET_DATAGRAM_MOST];

static bool counts_only(const struct natnet_message *m)
{
	return (m->id == NATNET_FRAME && (m->frame.n_skeletons || m->frame.n_plates || m->frame.n_devices)) ||
	       (m->id == NATNET_MODELS && m->models.n_others);
}

static void one(const uint8_t *data, size_t n, uint8_t less)
{
	const uint8_t *bytes = fuzz_exact(data, n);
	const char *why;

	if (!natnet_read(bytes, n, &message, &why)) {
		fuzz_must(why != NULL);
		return;
	}
	fuzz_must(!why);
	const size_t written = natnet_write(&message, out, sizeof(out));
	if (counts_only(&message)) {
		fuzz_must(written == 0);
		return;
	}
	fuzz_must(written == n && !memcmp(out, data, n));
	if (less && less <= n)
		fuzz_must(natnet_write(&message, out, n - less) == 0);
}

static void check_answer(size_t n)
{
	const char *why;

	fuzz_must(n <= NATNET_DATAGRAM_MOST && (!n || natnet_read(out, n, &message, &why)));
}

static void tell(struct natnet_server *s, int32_t number)
{
	struct mocap_frame f = { .number = number, .mid_exposure_ns = 1000 * number, .recorded = number & 1 };
	struct natnet_address gone;
	const uint8_t *bytes;

	for (size_t i = 0; i < 3; i++)
		f.body[i] = (struct mocap_pose){ .valid = (number >> i) & 1, .pose = { { number, 1, 2 }, { 0, 0, 0, 1 } } };
	const size_t n = natnet_server_frame(s, &f, &bytes);
	fuzz_must(n > 0 && natnet_read(bytes, n, &message, &(const char *){ NULL }));
	for (size_t i = 0; natnet_server_client(s, i); i++)
		fuzz_must(i < NATNET_CLIENTS_MAX);
	while (natnet_server_expire(s, number * BB_NS_PER_S, &gone, out, sizeof(out)))
		fuzz_must(natnet_server_counts(s)->timed_out > 0);
}

static void row(struct fuzz_input *in)
{
	static struct natnet_server *s;
	const struct natnet_server_config c = { .model = { .n_bodies = 3, .body = { { .name = "glasses", .n_markers = 5 },
	                                                                            { .name = "wand", .n_markers = 4 },
	                                                                            { .name = "none" } }, .rate_hz = 120 },
		                                .data_port = 1511, .multicast = in->left & 1 };
	int64_t now_ns = 0;

	fuzz_must(s || natnet_server_create(&c, &s)); /* made once */
	natnet_server_begin(s, &c);
	for (int32_t i = 0; in->left && i < 64; i++) {
		const uint8_t who = fuzz_byte(in), length = fuzz_byte(in);
		const struct natnet_address from = { who & 31, 1000, who & 1 };
		size_t n;
		const uint8_t *bytes = fuzz_piece(in, length == 255 ? 268 : length, &n);
		now_ns += (int64_t)(who >> 5) * 1000000;
		check_answer(natnet_server_hear(s, &from, bytes, n, now_ns, out, who & 64 ? 300 : sizeof(out)));
		if (who & 128)
			tell(s, i);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	if (size < 2)
		return 0;
	if (data[0] & 128)
		row(&(struct fuzz_input){ data + 1, size - 1 });
	else
		one(data + 2, size - 2, data[1]);
	return 0;
}
