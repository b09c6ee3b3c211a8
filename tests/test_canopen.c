/*
 * tests/test_canopen.c: golden frames of CiA 301 and 305 both ways: the master's codec against the bytes of the
 * standard, and the slave's (which is written on its own) against the same bytes on a simulated medium. SDO transfers
 * and fastscan state machines against answers that are right, wrong and missing.
 */
#include "drivers/can_guard.h"
#include "drivers/canopen_lss.h"
#include "drivers/canopen_sdo.h"
#include "tests/fixture_can.h"

#define FRAME(cob, n, ...) ((struct bb_can_frame){ .id = (cob), .n_bytes = (n), .bytes = { __VA_ARGS__ } })

static void same_frame(const struct bb_can_frame *got, const struct bb_can_frame want)
{
	assert_int_equal(got->id, want.id);
	assert_int_equal(got->n_bytes, want.n_bytes);
	assert_memory_equal(got->bytes, want.bytes, 8);
	assert_false(got->extended || got->remote || got->error);
}

static void requests_are_the_standards_bytes(void **state)
{
	const uint8_t ms[2] = { 0xe8, 0x03 }, three[3] = { 1, 2, 3 }, label[6] = "front";
	struct bb_can_frame f;

	(void)state;
	bb_co_nmt(&f, CO_NMT_START, 5);
	same_frame(&f, FRAME(0x000, 2, 0x01, 0x05));
	bb_co_nmt(&f, CO_NMT_PREOP, 0);
	same_frame(&f, FRAME(0x000, 2, 0x80, 0x00));
	bb_co_heartbeat(&f, 127, CO_OPERATIONAL);
	same_frame(&f, FRAME(0x77f, 1, 0x05));
	bb_co_sdo_write(&f, 5, 0x1017, 0, ms, 2);
	same_frame(&f, FRAME(0x605, 8, 0x2b, 0x17, 0x10, 0x00, 0xe8, 0x03, 0x00, 0x00));
	bb_co_sdo_write(&f, 5, 0x2100, 3, three, 1);
	same_frame(&f, FRAME(0x605, 8, 0x2f, 0x00, 0x21, 0x03, 0x01));
	bb_co_sdo_write(&f, 5, 0x2100, 1, three, 3);
	same_frame(&f, FRAME(0x605, 8, 0x27, 0x00, 0x21, 0x01, 0x01, 0x02, 0x03));
	bb_co_sdo_read(&f, 5, 0x1018, 1);
	same_frame(&f, FRAME(0x605, 8, 0x40, 0x18, 0x10, 0x01));
	bb_co_sdo_abort(&f, 5, 0x2000, 0, 0x06020000);
	same_frame(&f, FRAME(0x605, 8, 0x80, 0x00, 0x20, 0x00, 0x00, 0x00, 0x02, 0x06));
	bb_co_sdo_write(&f, 5, 0x2000, 0, label, 6);
	same_frame(&f, FRAME(0x605, 8, 0x21, 0x00, 0x20, 0x00, 0x06));
	bb_co_sdo_write_segment(&f, 5, false, label, 6, true);
	same_frame(&f, FRAME(0x605, 8, 0x03, 'f', 'r', 'o', 'n', 't', 0));
	bb_co_sdo_write_segment(&f, 5, true, label, 5, false);
	same_frame(&f, FRAME(0x605, 8, 0x14, 'f', 'r', 'o', 'n', 't'));
	bb_co_sdo_read_segment(&f, 5, false);
	same_frame(&f, FRAME(0x605, 8, 0x60));
	bb_co_sdo_read_segment(&f, 5, true);
	same_frame(&f, FRAME(0x605, 8, 0x70));
	bb_co_lss(&f, CO_LSS_SWITCH, 1);
	same_frame(&f, FRAME(0x7e5, 8, 0x04, 0x01));
	bb_co_lss_fastscan(&f, 0x12345678, 31, 2, 3);
	same_frame(&f, FRAME(0x7e5, 8, 0x51, 0x78, 0x56, 0x34, 0x12, 31, 2, 3));
}

static struct bb_co_sdo_reply reply_of(struct bb_can_frame f)
{
	struct bb_co_sdo_reply r;

	assert_int_equal(bb_co_read_sdo(&f, &r), BB_OK);
	return r;
}

static void replies_are_understood(void **state)
{
	struct bb_co_sdo_reply r = reply_of(FRAME(0x585, 8, 0x60, 0x17, 0x10, 0x00));

	(void)state;
	assert_int_equal(r.kind, BB_CO_SDO_WRITTEN);
	assert_int_equal(r.index, 0x1017);
	for (uint8_t n = 1; n <= 4; n++) {
		r = reply_of(FRAME(0x585, 8, (uint8_t)(0x43 + (4 - n) * 4), 0x18, 0x10, 0x01, 1, 2, 3, 4));
		assert_int_equal(r.kind, BB_CO_SDO_DATA);
		assert_int_equal(r.n, n);
		assert_int_equal(r.sub, 1);
	}
	r = reply_of(FRAME(0x585, 8, 0x41, 0x08, 0x10, 0x00, 21));
	assert_int_equal(r.kind, BB_CO_SDO_ANNOUNCED);
	assert_int_equal(r.size, 21);
	r = reply_of(FRAME(0x585, 8, 0x10 | 3 << 1 | 1, 'a', 'b', 'c', 'd'));
	assert_int_equal(r.kind, BB_CO_SDO_SEGMENT);
	assert_true(r.toggle && r.last && r.n == 4);
	r = reply_of(FRAME(0x585, 8, 0x30));
	assert_true(r.kind == BB_CO_SDO_TAKEN && r.toggle);
	r = reply_of(FRAME(0x585, 8, 0x80, 0x00, 0x20, 0x00, 0x00, 0x00, 0x02, 0x06));
	assert_int_equal(r.kind, BB_CO_SDO_ABORTED);
	assert_int_equal(r.code, 0x06020000);
	assert_string_equal(bb_co_abort_text(r.code), "object does not exist");
	const struct bb_can_frame block = FRAME(0x585, 8, 0xc0), brief = FRAME(0x585, 7, 0x60);
	assert_int_equal(bb_co_read_sdo(&block, &r), BB_ERR_FORMAT);
	assert_int_equal(bb_co_read_sdo(&brief, &r), BB_ERR_FORMAT);
}

static void ids_name_kind_and_node(void **state)
{
	static const struct {
		uint32_t id;
		enum bb_co_kind kind;
		uint8_t node;
	} rows[] = {
		{ 0x000, BB_CO_NMT, 0 }, { 0x080, BB_CO_SYNC, 0 }, { 0x085, BB_CO_EMCY, 5 }, { 0x100, BB_CO_TIME, 0 },
		{ 0x185, BB_CO_TPDO1, 5 }, { 0x205, BB_CO_PDO, 5 }, { 0x285, BB_CO_TPDO2, 5 }, { 0x305, BB_CO_PDO, 5 },
		{ 0x385, BB_CO_PDO, 5 }, { 0x505, BB_CO_PDO, 5 }, { 0x585, BB_CO_SDO_REPLY, 5 },
		{ 0x605, BB_CO_SDO_REQUEST, 5 }, { 0x705, BB_CO_HEARTBEAT, 5 }, { 0x77f, BB_CO_HEARTBEAT, 127 },
		{ 0x7e4, BB_CO_LSS_REPLY, 0 }, { 0x7e5, BB_CO_LSS_REQUEST, 0 }, { 0x180, BB_CO_OTHER, 0 },
		{ 0x001, BB_CO_OTHER, 0 }, { 0x7ff, BB_CO_OTHER, 0 }, { 0x12345, BB_CO_OTHER, 0 },
	};
	uint8_t node;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		const struct bb_can_frame f = { .id = rows[i].id };
		assert_int_equal(bb_co_kind(&f, &node), rows[i].kind);
		assert_int_equal(node, rows[i].node);
	}
}

static void small_messages_are_checked(void **state)
{
	struct bb_co_emcy e;
	uint8_t b;

	(void)state;
	const struct bb_can_frame emcy = FRAME(0x85, 8, 0x30, 0x81, 0x11, 1, 2, 3, 4, 5), none = FRAME(0x80, 0, 0),
	                          sync = FRAME(0x80, 1, 240), zero = FRAME(0x80, 1, 0), two = FRAME(0x80, 2, 1, 1),
	                          beat = FRAME(0x705, 1, 0x7f), odd = FRAME(0x705, 1, 0x06);
	assert_int_equal(bb_co_read_emcy(&emcy, &e), BB_OK);
	assert_int_equal(e.code, 0x8130);
	assert_int_equal(e.error_register, 0x11);
	assert_int_equal(e.detail[4], 5);
	assert_int_equal(bb_co_read_emcy(&beat, &e), BB_ERR_FORMAT);
	assert_int_equal(bb_co_read_sync(&none, &b), BB_OK);
	assert_int_equal(b, 0);
	assert_int_equal(bb_co_read_sync(&sync, &b), BB_OK);
	assert_int_equal(b, 240);
	assert_int_equal(bb_co_read_sync(&zero, &b), BB_ERR_FORMAT);
	assert_int_equal(bb_co_read_sync(&two, &b), BB_ERR_FORMAT);
	assert_int_equal(bb_co_read_heartbeat(&beat, &b), BB_OK);
	assert_int_equal(b, CO_PREOP);
	assert_int_equal(bb_co_read_heartbeat(&odd, &b), BB_ERR_FORMAT);
}

/* A phase of 3.0154 ms of SYNC 17, right eye, from node 6. CRC by hand: poly 2F, start FF, over 86 01 and the bytes. */
static void a_phase_needs_its_crc_and_its_id(void **state)
{
	struct bb_can_frame f = FRAME(0x186, 8, 17, 0x06, 0x68, 0x02, 0x2e, 0x00, 9, 0x12);
	const struct bb_can_frame follow = FRAME(0x285, 6, 17, 0x60, 0xea, 0x00, 0x00, 0x8a);
	struct bb_co_follow l;
	struct bb_co_phase p;

	(void)state;
	assert_int_equal(bb_co_read_follow(&follow, &l), BB_OK);
	assert_true(l.counter == 17 && l.latency_ns == 60000);
	assert_int_equal(bb_co_read_phase(&f, &p), BB_OK);
	assert_true(p.counter == 17 && p.flags == 6 && p.phase_ns == 0x2e0268 && p.sequence == 9);
	for (int bit = 0; bit < 64; bit++) {
		f.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
		assert_int_equal(bb_co_read_phase(&f, &p), BB_ERR_FORMAT);
		f.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
	}
	f.id = 0x187;
	assert_int_equal(bb_co_read_phase(&f, &p), BB_ERR_FORMAT);
	f.id = 0x186;
	f.n_bytes = 7;
	assert_int_equal(bb_co_read_phase(&f, &p), BB_ERR_FORMAT);
}

/* The slave's bytes on the wire. */

struct wire {
	struct rig rig;
	struct can_far far;
	struct sim_can_port tap;
	struct bb_can_frame heard[400];
	size_t n;
};

static void on_frame(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns)
{
	struct wire *w = bb_container_of(port, struct wire, tap);

	(void)at_ns;
	if (w->n < BB_ARRAY_LEN(w->heard))
		w->heard[w->n++] = *f;
}

static int setup(void **state)
{
	struct wire *w = calloc(1, sizeof(*w));

	if (!w)
		return -1;
	rig_init(&w->rig, 3, 0);
	can_far_wire(&w->rig, &w->far, 1000000, CAN_NODE);
	w->tap.frame = on_frame;
	sim_can_attach(w->far.can, &w->tap);
	*state = w;
	return 0;
}

static int teardown(void **state)
{
	struct wire *w = *state;

	can_far_close(&w->far);
	rig_done(&w->rig);
	free(w);
	return 0;
}

/* Says a frame and hears what comes within 3 ms. */
static void say(struct wire *w, struct bb_can_frame f)
{
	w->n = 0;
	assert_int_equal(sim_can_send(&w->tap, &f), BB_OK);
	rig_run(&w->rig, 3 * MS);
}

static void ask(struct wire *w, struct bb_can_frame f, struct bb_can_frame want)
{
	say(w, f);
	assert_int_equal(w->n, 1);
	same_frame(&w->heard[0], want);
}

static void the_slave_answers_in_the_standards_bytes(void **state)
{
	struct wire *w = *state;

	rig_run(&w->rig, 5 * MS);
	assert_int_equal(w->n, 4); /* boot-ups, lowest id first */
	same_frame(&w->heard[0], FRAME(0x705, 1, 0));
	same_frame(&w->heard[3], FRAME(0x708, 1, 0));
	ask(w, FRAME(0x605, 8, 0x2b, 0x17, 0x10, 0x00, 0xe8, 0x03), FRAME(0x585, 8, 0x60, 0x17, 0x10, 0x00));
	ask(w, FRAME(0x605, 8, 0x40, 0x17, 0x10, 0x00), FRAME(0x585, 8, 0x4b, 0x17, 0x10, 0x00, 0xe8, 0x03));
	ask(w, FRAME(0x605, 8, 0x40, 0x18, 0x10, 0x01), FRAME(0x585, 8, 0x43, 0x18, 0x10, 0x01, 'b', 'l', 'b', 0));
	ask(w, FRAME(0x605, 8, 0x40, 0x18, 0x10, 0x00), FRAME(0x585, 8, 0x4f, 0x18, 0x10, 0x00, 4));
	ask(w, FRAME(0x605, 8, 0x40, 0x77, 0x20, 0x00), FRAME(0x585, 8, 0x80, 0x77, 0x20, 0x00, 0x00, 0x00, 0x02, 0x06));
	ask(w, FRAME(0x605, 8, 0x40, 0x18, 0x10, 0x09), FRAME(0x585, 8, 0x80, 0x18, 0x10, 0x09, 0x11, 0x00, 0x09, 0x06));
	ask(w, FRAME(0x605, 8, 0x2f, 0x01, 0x10, 0x00, 1), FRAME(0x585, 8, 0x80, 0x01, 0x10, 0x00, 0x02, 0x00, 0x01, 0x06));
	ask(w, FRAME(0x605, 8, 0x2f, 0x17, 0x10, 0x00, 1), FRAME(0x585, 8, 0x80, 0x17, 0x10, 0x00, 0x13, 0x00, 0x07, 0x06));
	ask(w, FRAME(0x605, 8, 0x2f, 0x00, 0x21, 0x03, 2), FRAME(0x585, 8, 0x80, 0x00, 0x21, 0x03, 0x31, 0x00, 0x09, 0x06));
	ask(w, FRAME(0x605, 8, 0x2f, 0x19, 0x10, 0x00, 7), FRAME(0x585, 8, 0x80, 0x19, 0x10, 0x00, 0x30, 0x00, 0x09, 0x06));
	ask(w, FRAME(0x605, 8, 0xc0, 0x17, 0x10), FRAME(0x585, 8, 0x80, 0x17, 0x10, 0x00, 0x01, 0x00, 0x04, 0x05));
	/* Segmented both ways, and a wrong toggle. */
	ask(w, FRAME(0x605, 8, 0x21, 0x00, 0x20, 0x00, 9), FRAME(0x585, 8, 0x60, 0x00, 0x20, 0x00));
	ask(w, FRAME(0x605, 8, 0x00, 'f', 'r', 'o', 'n', 't', '-', 'w'), FRAME(0x585, 8, 0x20));
	ask(w, FRAME(0x605, 8, 0x1b, 'a', 'l'), FRAME(0x585, 8, 0x30));
	assert_string_equal(sim_chain_label(w->far.chain, 0), "front-wal");
	ask(w, FRAME(0x605, 8, 0x40, 0x00, 0x20, 0x00), FRAME(0x585, 8, 0x41, 0x00, 0x20, 0x00, 9));
	ask(w, FRAME(0x605, 8, 0x60), FRAME(0x585, 8, 0x00, 'f', 'r', 'o', 'n', 't', '-', 'w'));
	ask(w, FRAME(0x605, 8, 0x60), FRAME(0x585, 8, 0x80, 0x00, 0x20, 0x00, 0x00, 0x00, 0x03, 0x05));
	ask(w, FRAME(0x605, 8, 0x21, 0x00, 0x20, 0x00, 32), FRAME(0x585, 8, 0x80, 0x00, 0x20, 0x00, 0x12, 0x00, 0x07, 0x06));
}

static void the_slave_obeys_nmt_and_beats(void **state)
{
	struct wire *w = *state;

	rig_run(&w->rig, 5 * MS);
	say(w, FRAME(0x605, 8, 0x2b, 0x17, 0x10, 0x00, 10, 0));
	w->n = 0;
	rig_run(&w->rig, 10 * MS);
	same_frame(&w->heard[0], FRAME(0x705, 1, 0x7f));
	say(w, FRAME(0x000, 2, 0x01, 0x05));
	w->n = 0;
	rig_run(&w->rig, 10 * MS);
	same_frame(&w->heard[0], FRAME(0x705, 1, 0x05));
	say(w, FRAME(0x000, 2, 0x02, 0x00));
	say(w, FRAME(0x605, 8, 0x40, 0x17, 0x10, 0x00)); /* stopped: no SDO */
	for (size_t i = 0; i < w->n; i++)
		same_frame(&w->heard[i], FRAME(0x705, 1, 0x04));
	say(w, FRAME(0x000, 2, 0x82, 0x05));
	same_frame(&w->heard[w->n - 1], FRAME(0x705, 1, 0x00));
}

static void the_slave_counts_sync_and_its_length(void **state)
{
	struct wire *w = *state;

	rig_run(&w->rig, 5 * MS);
	say(w, FRAME(0x606, 8, 0x2f, 0x19, 0x10, 0x00, 240));
	say(w, FRAME(0x080, 0, 0)); /* of another length: 8240h */
	assert_int_equal(w->n, 1);
	same_frame(&w->heard[0], FRAME(0x086, 8, 0x40, 0x82, 0x11));
	say(w, FRAME(0x080, 1, 3)); /* right for 6, wrong for the others, which expect none */
	assert_int_equal(w->n, 4);
	same_frame(&w->heard[1], FRAME(0x086, 8, 0, 0, 0));
	say(w, FRAME(0x605, 8, 0x2f, 0x19, 0x10, 0x00, 240));
	say(w, FRAME(0x605, 8, 0x23, 0x05, 0x10, 0x00, 0x80, 0, 0, 0x40));
	w->n = 0;
	rig_run(&w->rig, 25 * MS);
	const int64_t n = (bb_clock_now_ns(w->rig.clk) - 25 * MS) * 120 / BB_NS_PER_S;
	size_t syncs = 0;
	for (size_t i = 0; i < w->n; i++)
		if (w->heard[i].id == 0x80)
			same_frame(&w->heard[i], FRAME(0x080, 1, (uint8_t)((n + 1 + (int64_t)syncs++) % 240 + 1)));
	assert_int_equal(syncs, 3);
}

/* Every object of docs/shutter.eds is there, with its type's length, writable where it says so; and none besides. */
static void check_object(struct wire *w, unsigned index, unsigned sub, unsigned type, bool writable)
{
	static const uint8_t width[] = { [3] = 2, [5] = 1, [6] = 2, [7] = 4 };

	say(w, FRAME(0x605, 8, 0x40, (uint8_t)index, (uint8_t)(index >> 8), (uint8_t)sub));
	if (w->n != 1 || w->heard[0].bytes[0] == 0x80)
		fail_msg("no object %04xh:%02x", index, sub);
	const struct bb_can_frame got = w->heard[0];
	if (type < BB_ARRAY_LEN(width) && width[type])
		assert_int_equal(got.bytes[0], 0x43 + (4 - width[type]) * 4);
	else
		assert_int_equal(got.bytes[0], 0x41);
	if (got.bytes[0] == 0x41)
		return;
	struct bb_can_frame back = got; /* its own value is one it takes; the watchdog's too */
	back.id = 0x605;
	back.bytes[0] = (uint8_t)(got.bytes[0] - 0x20);
	say(w, back);
	const struct bb_can_frame refused = w->heard[0];
	if (!writable && (refused.bytes[0] != 0x80 || refused.bytes[4] != 0x02 || refused.bytes[7] != 0x06))
		fail_msg("%04xh:%02x can be written", index, sub);
	if (writable && refused.bytes[0] != 0x60)
		fail_msg("%04xh:%02x cannot be written", index, sub);
}

static void the_eds_tells_the_truth(void **state)
{
	struct wire *w = *state;
	const struct sim_co_node *node = sim_chain_node(w->far.chain, 0);
	FILE *eds = fopen("docs/shutter.eds", "r");
	unsigned index = 0, sub = 0, type = 0, value;
	size_t objects = 0;
	char line[128], access[8];

	if (!eds) {
		print_message("docs/shutter.eds is not below the working directory\n");
		skip();
	}
	rig_run(&w->rig, 5 * MS);
	while (fgets(line, sizeof(line), eds)) {
		if (sscanf(line, "[%4xsub%x]", &index, &sub) == 2 ||
		    (sscanf(line, "[%4x]", &index) == 1 && line[5] == ']' && !(sub = 0)))
			type = 0;
		else if (sscanf(line, "DataType=%x", &value) == 1)
			type = value;
		else if (sscanf(line, "AccessType=%7s", access) == 1 && type) {
			check_object(w, index, sub, type, !strcmp(access, "rw"));
			objects++;
		}
	}
	fclose(eds);
	assert_int_equal(objects, node->n_comm + node->n_app);
}

/* SDO client against a scripted server. */

static void answer(struct bb_co_sdo *c, struct bb_can_frame f)
{
	bb_co_sdo_receive(c, &f, 0);
}

static void transfers_end_as_they_should(void **state)
{
	struct bb_co_sdo c;
	struct bb_can_frame f;

	(void)state;
	bb_co_sdo_init(&c, 5, 20 * MS);
	bb_co_sdo_start_read(&c, 0x1008, 0, 0);
	assert_true(bb_co_sdo_take(&c, &f) && !bb_co_sdo_take(&c, &f));
	answer(&c, FRAME(0x585, 8, 0x60, 0x17, 0x10)); /* to another question */
	assert_true(bb_co_sdo_busy(&c));
	answer(&c, FRAME(0x585, 8, 0x41, 0x08, 0x10, 0, 9));
	assert_true(bb_co_sdo_take(&c, &f));
	same_frame(&f, FRAME(0x605, 8, 0x60));
	answer(&c, FRAME(0x585, 8, 0x00, '1', '2', '3', '4', '5', '6', '7'));
	assert_true(bb_co_sdo_take(&c, &f));
	same_frame(&f, FRAME(0x605, 8, 0x70));
	answer(&c, FRAME(0x585, 8, 0x1b, '8', '9'));
	assert_int_equal(c.status, BB_OK);
	assert_int_equal(c.n, 9);
	assert_memory_equal(c.bytes, "123456789", 9);
	/* Longer than announced, wrong toggle, too long to take, refused. */
	static const struct {
		struct bb_can_frame f;
		uint32_t code;
	} wrong[] = {
		{ { .n_bytes = 8, .bytes = { 0x00 } }, CO_ABORT_TOO_LONG },
		{ { .n_bytes = 8, .bytes = { 0x10 } }, CO_ABORT_TOGGLE },
		{ { .n_bytes = 8, .bytes = { 0x0d } }, CO_ABORT_LENGTH },
		{ { .n_bytes = 8, .bytes = { 0x20 } }, CO_ABORT_COMMAND },
	};
	for (size_t i = 0; i < BB_ARRAY_LEN(wrong); i++) {
		bb_co_sdo_start_read(&c, 0x1008, 0, 0);
		answer(&c, FRAME(0x585, 8, 0x41, 0x08, 0x10, 0, 5));
		answer(&c, wrong[i].f);
		assert_int_equal(c.status, BB_ERR_FORMAT);
		assert_int_equal(c.abort, wrong[i].code);
		assert_true(bb_co_sdo_take(&c, &f));
		assert_int_equal(f.bytes[0], 0x80);
	}
	bb_co_sdo_start_read(&c, 0x1008, 0, 0);
	answer(&c, FRAME(0x585, 8, 0x41, 0x08, 0x10, 0, 65));
	assert_int_equal(c.status, BB_ERR_FORMAT);
	bb_co_sdo_start_read(&c, 0x1008, 0, 0);
	answer(&c, FRAME(0x585, 8, 0x80, 0x08, 0x10, 0, 0, 0, 2, 6));
	assert_int_equal(c.status, BB_ERR_REFUSED);
	assert_int_equal(c.abort, CO_ABORT_NO_OBJECT);
}

static void silence_is_asked_three_times(void **state)
{
	const uint8_t bytes[6] = "front";
	struct bb_co_sdo c;
	struct bb_can_frame f;

	(void)state;
	bb_co_sdo_init(&c, 5, 20 * MS);
	bb_co_sdo_start_write(&c, 0x2000, 0, bytes, 6, 0);
	for (int64_t t = 0; t < 3; t++) {
		bb_co_sdo_poll(&c, t * 20 * MS);
		assert_true(bb_co_sdo_take(&c, &f));
		same_frame(&f, FRAME(0x605, 8, 0x21, 0x00, 0x20, 0x00, 6));
		bb_co_sdo_poll(&c, t * 20 * MS + 19 * MS);
		assert_false(bb_co_sdo_take(&c, &f));
	}
	bb_co_sdo_poll(&c, 60 * MS);
	assert_int_equal(c.status, BB_ERR_LOST);
	assert_true(bb_co_sdo_take(&c, &f));
	same_frame(&f, FRAME(0x605, 8, 0x80, 0x00, 0x20, 0x00, 0x00, 0x00, 0x04, 0x05));
}

/* The medium */

static void frames_take_their_true_time(void **state)
{
	(void)state;
	/* Worst cases with stuffing and the pause of 3: 55, 65, 75 and 135 bits. */
	static const int worst[9] = { 55, 65, 75, 85, 95, 105, 115, 125, 135 };
	struct sim_rng r;

	sim_rng_seed(&r, 5, "can", "bits");
	for (int i = 0; i < 20000; i++) {
		struct bb_can_frame f = { .id = (uint32_t)sim_rng_u64(&r) & 0x7ff, .n_bytes = (uint8_t)(i % 9) };
		for (int k = 0; k < 8; k++)
			f.bytes[k] = i % 3 ? (uint8_t)sim_rng_u64(&r) : 0;
		const int bits = sim_can_frame_bits(&f) + 3;
		assert_true(bits >= 47 + 8 * f.n_bytes && bits <= worst[f.n_bytes]);
	}
	/* Counted by hand: SOF, fields, CRC-15 and stuffing, then 10 bits of delimiters, acknowledge and end. */
	static const struct {
		struct bb_can_frame f;
		int bits;
	} known[] = {
		{ { .id = 0x555, .n_bytes = 1, .bytes = { 0xaa } }, 54 },
		{ { .id = 0x080 }, 48 },
		{ { .id = 0x080, .n_bytes = 1, .bytes = { 1 } }, 56 },
		{ { .id = 0x000 }, 50 },
		{ { .id = 0x000, .n_bytes = 8 }, 124 },
		{ { .id = 0x7ff, .n_bytes = 8, .bytes = { 255, 255, 255, 255, 255, 255, 255, 255 } }, 123 },
	};
	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++)
		assert_int_equal(sim_can_frame_bits(&known[i].f), known[i].bits);
}

static void babble_is_filtered_and_forgiven(void **state)
{
	struct bb_can_guard *g = malloc(sizeof(*g));
	int64_t t = 0;
	int passed = 0;

	(void)state;
	assert_non_null(g);
	bb_can_guard_init(g, 1000000);
	bb_can_guard_contract(g, 0x185, 121);
	for (; t < 60 * BB_NS_PER_S; t += BB_NS_PER_S / 240) /* twice the rate is allowed for ever */
		assert_int_equal(bb_can_guard_frame(g, 0x185, t), BB_CAN_PASS);
	const int64_t from_ns = t;
	while (passed < 1000 && bb_can_guard_frame(g, 0x185, t) == BB_CAN_PASS) {
		passed++;
		t += BB_NS_PER_S / 2700;
	}
	assert_true(t - from_ns < 100 * MS && passed < 100);
	assert_int_equal(bb_can_guard_poll(g, t), 1);
	for (int i = 0; i < 5000; i++, t += BB_NS_PER_S / 2700)
		assert_int_equal(bb_can_guard_frame(g, 0x185, t), BB_CAN_FILTERED);
	const int64_t calm_ns = t;
	for (; bb_can_guard_poll(g, t); t += BB_NS_PER_S / 120)
		bb_can_guard_frame(g, 0x185, t);
	assert_true(llabs(t - calm_ns - 5 * BB_NS_PER_S) < 100 * MS);
	assert_int_equal(bb_can_guard_frame(g, 0x185, t), BB_CAN_PASS);
	free(g);
}

static enum bb_status full(struct bb_can_bus *bus, const struct bb_can_frame *f)
{
	(void)bus;
	(void)f;
	return BB_ERR_BUSY;
}

static void a_full_queue_keeps_the_newest_state(void **state)
{
	const struct bb_can_ops ops = { full, NULL, NULL, NULL };
	struct bb_can_bus bus = { &ops, NULL, 0 };
	struct bb_can_queue q = { .n = 0 };

	(void)state;
	for (uint8_t i = 0; i < 100; i++) {
		const struct bb_can_frame f = FRAME(0x605, 8, i);
		assert_true(bb_can_queue_put(&q, &f, true));
	}
	assert_int_equal(q.n, 1);
	assert_int_equal(q.frame[0].bytes[0], 99);
	assert_int_equal(bb_can_queue_flush(&q, &bus), BB_ERR_BUSY);
	for (uint8_t i = 0; i < 100; i++) {
		const struct bb_can_frame f = FRAME(0x000, 2, 1, i);
		assert_int_equal(bb_can_queue_put(&q, &f, false), i < BB_CAN_QUEUE - 1);
	}
	assert_int_equal(q.dropped, 100 - (BB_CAN_QUEUE - 1));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(requests_are_the_standards_bytes),
		cmocka_unit_test(replies_are_understood),
		cmocka_unit_test(ids_name_kind_and_node),
		cmocka_unit_test(small_messages_are_checked),
		cmocka_unit_test(a_phase_needs_its_crc_and_its_id),
		cmocka_unit_test_setup_teardown(the_slave_answers_in_the_standards_bytes, setup, teardown),
		cmocka_unit_test_setup_teardown(the_slave_obeys_nmt_and_beats, setup, teardown),
		cmocka_unit_test_setup_teardown(the_slave_counts_sync_and_its_length, setup, teardown),
		cmocka_unit_test_setup_teardown(the_eds_tells_the_truth, setup, teardown),
		cmocka_unit_test(transfers_end_as_they_should),
		cmocka_unit_test(silence_is_asked_three_times),
		cmocka_unit_test(frames_take_their_true_time),
		cmocka_unit_test(babble_is_filtered_and_forgiven),
		cmocka_unit_test(a_full_queue_keeps_the_newest_state),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
