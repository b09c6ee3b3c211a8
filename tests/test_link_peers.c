/*
 * tests/test_link_peers.c: what packets may and may not change, with a wire made of memory: the test is the attacker who
 * hears everything, repeats, cuts, alters and invents.
 */
#include "tests/fixture_room.h"
#include "drivers/link/peers.h"

#define HEARD_MAX 4096

/* A wire between a head and one other: what is sent lies in a row until the test lets it through. */
struct bytes {
	size_t n;
	uint8_t bytes[LINK_PACKET_MAX + 8];
};

static struct {
	struct bytes heard[2][HEARD_MAX];  /* by receiver: 0 is the head */
	size_t n_heard[2];
	struct bytes in[2];                /* let through next; n 0: nothing */
	uint8_t from;                      /* where it seems to come from */
	bool dead;                         /* nobody is there */
} wire;

struct memory_link {
	struct link_peers peers;
};

static int side(const struct link_peers *l)
{
	return link_peers_is_head(l) ? 0 : 1;
}

static enum bb_status wire_send(struct link_peers *l, const struct link_address *to, const uint8_t *bytes, size_t n)
{
	const int far = !side(l);

	(void)to;
	if (wire.n_heard[far] == HEARD_MAX)
		return BB_ERR_BUSY;
	wire.heard[far][wire.n_heard[far]].n = n;
	memcpy(wire.heard[far][wire.n_heard[far]++].bytes, bytes, n);
	return BB_OK;
}

static size_t wire_receive(struct link_peers *l, struct link_address *from, uint8_t *bytes, size_t cap)
{
	struct bytes *in = &wire.in[side(l)];
	const size_t n = in->n;

	*from = (struct link_address){ 1, { wire.from } };
	memcpy(bytes, in->bytes, n < cap ? n : cap);
	in->n = 0;
	return n;
}

static bool wire_alive(struct link_peers *l, const struct link_address *far)
{
	(void)l;
	(void)far;
	return !wire.dead;
}

static void wire_wait(struct link_peers *l, int64_t until_ns)
{
	(void)l;
	(void)until_ns;
}

static void wire_joined(struct link_peers *l, const struct link_address *far, uint32_t pid)
{
	(void)l;
	(void)far;
	(void)pid;
}

static const struct link_wire_ops memory_wire = { wire_send, wire_receive, wire_alive, wire_wait, wire_joined };

static enum bb_status memory_open(struct bb_link *l, const struct bb_open *open)
{
	(void)open;
	return link_peers_open(bb_container_of(l, struct link_peers, base), &memory_wire);
}

static void memory_close(struct bb_link *l)
{
	link_peers_close(bb_container_of(l, struct link_peers, base));
}

static const struct bb_link_ops ops = { memory_open, memory_close, link_peers_send, link_peers_receive, link_peers_notify };
static const struct bb_link_driver memory_driver = { "memory", sizeof(struct memory_link), &ops };

/* ---- two processes ---- */

struct bench {
	struct bb_clock *clk;
	struct bb_link *l[2];
	struct bb_link_message m;
	struct bb_log log;
	int lines;
};

static void count_line(void *ctx, enum bb_log_level level, const char *line)
{
	(void)level;
	(void)line;
	++*(int *)ctx;
}

static struct bb_link *open_side(struct bench *b, uint16_t process)
{
	const struct bb_link_group group = { .process = process, .n_processes = 3, .home = { 0, 1, 2 }, .secret = { 3, 1 } };
	const struct bb_link_config c = { .id = "net", .n_nodes = 3, .group = &group };
	const struct bb_open open = { .clk = b->clk, .log = &b->log };
	struct bb_link *l;

	assert_int_equal(bb_link_open(&memory_driver, &c, &open, &l), BB_OK);
	return l;
}

static void pass(struct bench *b, int64_t ns)
{
	bb_clock_run_until(b->clk, bb_clock_now_ns(b->clk) + ns);
}

static void hear(struct bench *b, int who, const struct bytes *packet)
{
	wire.in[who] = *packet;
	(void)link_joined(b->l[who]); /* takes what is there */
}

/* Lets through what was sent to one side since `*done`. */
static void let_through(struct bench *b, int who, size_t *done)
{
	for (; *done < wire.n_heard[who]; ++*done)
		hear(b, who, &wire.heard[who][*done]);
}

static void join(struct bench *b)
{
	size_t done[2] = { wire.n_heard[0], wire.n_heard[1] };

	pass(b, BB_NS_PER_S);
	assert_int_equal(link_joined(b->l[1]), BB_TIMEOUT); /* asks */
	let_through(b, 0, &done[0]);
	let_through(b, 1, &done[1]);
	let_through(b, 0, &done[0]);
	assert_int_equal(link_joined(b->l[1]), BB_OK);
	assert_int_equal(link_peer(b->l[0], 1).state, LINK_PEER_JOINED);
}

static int setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));

	if (!b)
		return -1;
	memset(&wire, 0, sizeof(wire));
	b->log = (struct bb_log){ count_line, &b->lines, BB_LOG_DEBUG };
	assert_int_equal(bb_clock_virtual_create(&b->clk), BB_OK);
	b->l[0] = open_side(b, 0);
	b->l[1] = open_side(b, 1);
	join(b);
	*state = b;
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	bb_link_close(b->l[1]);
	bb_link_close(b->l[0]);
	bb_clock_destroy(b->clk);
	free(b);
	return 0;
}

/* All that a packet could have changed at the head. */
struct picture {
	struct link_peer peer[3];
	uint64_t received;
	size_t n_answers, n_waiting;
};

static struct picture look(struct bench *b)
{
	struct picture p = { .received = link_counts(b->l[0]).received, .n_answers = wire.n_heard[1] };

	for (uint16_t i = 0; i < 3; i++)
		p.peer[i] = link_peer(b->l[0], i);
	while (bb_link_receive(b->l[0], 0, &b->m) == BB_OK)
		p.n_waiting++;
	return p;
}

static void nothing_changed(struct bench *b, const struct picture *before)
{
	const struct picture after = look(b);

	assert_int_equal(after.received, before->received);
	assert_int_equal(after.n_answers, before->n_answers);
	assert_int_equal(after.n_waiting, 0);
	for (int i = 0; i < 3; i++) {
		assert_int_equal(after.peer[i].state, before->peer[i].state);
		assert_int_equal(after.peer[i].joins, before->peer[i].joins);
		assert_int_equal(after.peer[i].heard_ns, before->peer[i].heard_ns);
	}
}

/* One good packet from node 1 to node 0, as it stood on the wire. */
static const struct bytes *good_packet(struct bench *b, const char *text)
{
	assert_int_equal(bb_link_send(b->l[1], 1, 0, text, strlen(text)), BB_OK);
	return &wire.heard[0][wire.n_heard[0] - 1];
}

/* ---- tests ---- */

/* Appendix A of the SipHash paper for 64 bits has a 128-bit sibling in the reference's vectors: key 00..0f, no bytes. */
static void marks_are_siphash_2_4(void **state)
{
	static const uint8_t want[BB_SEAL_BYTES] = { 0xa3, 0x81, 0x7f, 0x04, 0xba, 0x25, 0xa8, 0xe6,
		                                     0x6d, 0xf6, 0x72, 0x14, 0xc7, 0x55, 0x02, 0x93 };
	uint8_t key[BB_SEAL_KEY_BYTES], mark[BB_SEAL_BYTES];
	struct bb_seal *seal;

	(void)state;
	for (size_t i = 0; i < sizeof(key); i++)
		key[i] = (uint8_t)i;
	assert_true(bb_seal_create(key, &seal));
	for (int twice = 0; twice < 2; twice++) {
		assert_true(bb_seal_make(seal, "", 0, mark));
		assert_memory_equal(mark, want, sizeof(want));
	}
	assert_true(bb_seal_holds(seal, "", 0, want));
	assert_false(bb_seal_holds(seal, "x", 1, want));
	bb_seal_destroy(seal);
	bb_seal_destroy(NULL);
}

static void a_good_packet_counts_once(void **state)
{
	struct bench *b = *state;
	const struct bytes *packet = good_packet(b, "hello");

	hear(b, 0, packet);
	assert_int_equal(bb_link_receive(b->l[0], 0, &b->m), BB_OK);
	assert_int_equal(b->m.n_bytes, 5);
	const struct picture before = look(b);
	for (int i = 0; i < 100; i++)
		hear(b, 0, packet);
	nothing_changed(b, &before);
	assert_int_equal(link_counts(b->l[0]).replayed, 100);
}

static void cut_and_altered_packets_change_nothing(void **state)
{
	struct bench *b = *state;
	const struct bytes packet = *good_packet(b, "a pose of the head, say");
	struct bytes bad;
	const struct picture before = look(b);

	for (size_t n = 1; n < packet.n; n++) {
		bad = packet;
		bad.n = n;
		hear(b, 0, &bad);
	}
	assert_int_equal(link_counts(b->l[0]).truncated, packet.n - 1);
	for (size_t bit = 0; bit < 8 * packet.n; bit++) {
		bad = packet;
		bad.bytes[bit / 8] ^= (uint8_t)(1U << bit % 8);
		hear(b, 0, &bad);
	}
	for (size_t more = 1; more < 8; more++) {
		bad = packet;
		bad.n += more;
		hear(b, 0, &bad);
	}
	nothing_changed(b, &before);
	const struct link_counts c = link_counts(b->l[0]);
	assert_int_equal(c.truncated + c.malformed + c.forged, packet.n - 1 + 8 * packet.n + 7);
	assert_true(c.forged > 4 * packet.n);
	hear(b, 0, &packet); /* and the good one is as good as before */
	assert_int_equal(bb_link_receive(b->l[0], 0, &b->m), BB_OK);
}

static void a_million_random_datagrams_change_nothing(void **state)
{
	struct bench *b = *state;
	const struct bytes packet = *good_packet(b, "a pose of the head, say");
	const struct picture before = look(b);
	const int lines = b->lines;
	struct sim_rng rng;
	struct bytes bad;

	sim_rng_seed(&rng, 5, "test", "datagrams");
	for (int i = 0; i < 1000000; i++) {
		const uint64_t draw = sim_rng_u64(&rng);
		bad.n = 1 + draw % LINK_PACKET_MAX;
		if (i % 4 == 0) { /* a good one with some bytes of chance */
			bad = packet;
			for (unsigned k = 0; k < 1 + draw % 3; k++)
				bad.bytes[(draw >> (8 + 16 * k)) % bad.n] ^= (uint8_t)(1 + (draw >> 56) % 255);
		} else {
			for (size_t k = 0; k < bad.n; k += 8) {
				const uint64_t r = sim_rng_u64(&rng);
				memcpy(&bad.bytes[k], &r, 8);
			}
		}
		if (i % 4 == 1 && bad.n > 8) /* past the first look */
			memcpy(bad.bytes, packet.bytes, 8);
		if (memcmp(bad.bytes, packet.bytes, packet.n) != 0 || bad.n != packet.n)
			hear(b, 0, &bad);
		if (i % 1000 == 0)
			pass(b, 10 * MS); /* 10 s in all */
	}
	nothing_changed(b, &before);
	assert_true(link_counts(b->l[0]).forged > 100000);
	assert_true(b->lines - lines <= 110);
}

static void what_an_old_session_said_is_stale(void **state)
{
	struct bench *b = *state;
	const size_t n_old = wire.n_heard[0];
	const struct bytes old = *good_packet(b, "from the first session");

	bb_link_close(b->l[1]);
	hear(b, 0, &wire.heard[0][wire.n_heard[0] - 1]); /* its BYE */
	assert_int_equal(link_peer(b->l[0], 1).state, LINK_PEER_LOST);
	b->l[1] = open_side(b, 1);
	join(b);
	assert_int_equal(link_peer(b->l[0], 1).joins, 2);
	struct picture before = look(b);
	hear(b, 0, &old);
	nothing_changed(b, &before);
	/* All that was ever said, once more: a JOIN is answered, and its offer comes to nothing. */
	for (size_t i = 0; i < n_old; i++)
		hear(b, 0, &wire.heard[0][i]);
	before.n_answers = wire.n_heard[1];
	nothing_changed(b, &before);
	assert_true(wire.n_heard[1] < 10);
}

/* A process that holds the key still speaks for its own nodes only, and not as another. */
static void nobody_speaks_for_another(void **state)
{
	struct bench *b = *state;
	struct link_packet p;
	const struct picture before = look(b);
	struct link_peers *mine = bb_container_of(b->l[1], struct link_peers, base);
	struct bytes bad = *good_packet(b, "x");

	assert_int_equal(link_packet_get(mine->seal, bad.bytes, bad.n, &p), LINK_WHOLE);
	const struct link_packet good = p;
	for (int k = 0; k < 5; k++) {
		p = good;
		p.from = k == 0 ? 2 : k == 1 ? 0 : p.from;
		p.to = k == 2 ? 9 : p.to;
		p.process = k == 3 ? 0 : k == 4 ? 2 : p.process;
		p.number += (uint64_t)k + 1;
		bad.n = link_packet_put(mine->seal, &p, bad.bytes);
		hear(b, 0, &bad);
	}
	assert_int_equal(look(b).received, before.received);
	assert_int_equal(link_counts(b->l[0]).malformed, 3);
	assert_int_equal(link_counts(b->l[0]).stale, 2);
	assert_int_equal(bb_link_send(b->l[1], 2, 0, "x", 1), BB_ERR_RANGE);
	assert_int_equal(bb_link_receive(b->l[1], 2, &b->m), BB_ERR_RANGE);
}

/* Somebody who takes any place asks once more, from there; the place the head offers, 0: refused. */
static uint16_t offered(struct bench *b, uint8_t from)
{
	const struct link_peers *head = bb_container_of(b->l[0], struct link_peers, base);
	struct link_welcome w = { 0 };
	struct link_packet p;

	pass(b, BB_NS_PER_S / 5);
	assert_int_equal(link_joined(b->l[1]), BB_TIMEOUT);
	wire.from = from;
	hear(b, 0, &wire.heard[0][wire.n_heard[0] - 1]);
	const struct bytes *answer = &wire.heard[1][wire.n_heard[1] - 1];
	assert_int_equal(link_packet_get(head->seal, answer->bytes, answer->n, &p), LINK_WHOLE);
	return p.kind == LINK_WELCOME && link_welcome_get(&p, &w) ? w.process : 0;
}

/* Who takes any place and asks often, for the head is long in answering, takes one; who asks and dies keeps none. */
static void any_place_is_promised_once_and_not_for_ever(void **state)
{
	struct bench *b = *state;

	bb_link_close(b->l[1]);
	hear(b, 0, &wire.heard[0][wire.n_heard[0] - 1]);
	b->l[1] = open_side(b, BB_LINK_ANY);
	for (int i = 0; i < 3; i++)
		assert_int_equal(offered(b, 1), 1);
	assert_int_equal(offered(b, 2), 2);
	assert_int_equal(offered(b, 3), 0);
	pass(b, BB_NS_PER_S);
	assert_int_equal(offered(b, 3), 1);
	for (size_t done[2] = { wire.n_heard[0], wire.n_heard[1] - 1 }; link_joined(b->l[1]) != BB_OK;) {
		let_through(b, 1, &done[1]);
		let_through(b, 0, &done[0]);
	}
	assert_int_equal(link_process(b->l[1]), 1);
	assert_int_equal(link_peer(b->l[0], 1).state, LINK_PEER_JOINED);
}

/* Who joined and says nothing for long, because it loads or waits for others, keeps its place as long as it is there. */
static void the_silent_keep_their_places(void **state)
{
	struct bench *b = *state;

	struct bb_link *first = b->l[1];

	assert_int_equal(link_peer(b->l[0], 1).state, LINK_PEER_JOINED);
	pass(b, 20 * BB_NS_PER_S);
	b->l[1] = open_side(b, BB_LINK_ANY);
	assert_int_equal(offered(b, 9), 2);
	wire.dead = true;
	assert_int_equal(offered(b, 9), 1);
	bb_link_close(first);
}

static void gaps_are_counted(void **state)
{
	struct bench *b = *state;
	const size_t first = wire.n_heard[0];

	for (int i = 0; i < 9; i++)
		good_packet(b, "x");
	hear(b, 0, &wire.heard[0][first]);
	hear(b, 0, &wire.heard[0][first + 8]);
	hear(b, 0, &wire.heard[0][first + 4]); /* late: as good as lost */
	assert_int_equal(link_counts(b->l[0]).missed, 7);
	assert_int_equal(link_counts(b->l[0]).received, 2);
	assert_int_equal(link_counts(b->l[0]).replayed, 1);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(marks_are_siphash_2_4), T(a_good_packet_counts_once),
		T(cut_and_altered_packets_change_nothing), T(a_million_random_datagrams_change_nothing),
		T(what_an_old_session_said_is_stale), T(nobody_speaks_for_another),
		T(any_place_is_promised_once_and_not_for_ever),
		T(the_silent_keep_their_places), T(gaps_are_counted),
	};

	return cmocka_run_group_tests_name("what packets may change", tests, NULL, NULL);
}
