/*
 * tests/fuzz/fuzz_peer_canopen.c: any frames into a simulated CANopen node, which `serve` puts on a wire that other
 * programs write to. Byte 0: has it an id already? Then records of 12 bytes: id low, id high and flags, length, 100 us
 * units to wait, 8 data bytes; bit 7 of the second makes it an SDO, NMT, LSS, SYNC or heartbeat frame.
 * deep_peer_canopen.c has whole controllers on a medium.
 */
#include "sim/peer_canopen.h"
#include "tests/fuzz/fuzz.h"

#define RECORD 12
#define OBJECTS 4

struct application { /* objects of every kind the server knows */
	uint32_t number, word;
	uint8_t text[20];
	uint16_t n_text;
	struct sim_co_object object[OBJECTS];
};

static uint32_t check(struct sim_co_node *n, const struct sim_co_object *o, uint32_t value)
{
	(void)n;
	return o->index == 0x2001 && value == 0x0D ? CO_ABORT_STATE : 0;
}

static size_t fill(struct sim_co_node *n, unsigned int pdo, uint8_t bytes[8])
{
	bytes[0] = n->counter;
	return pdo ? 6 : 8;
}

static void wrote(struct sim_co_node *n, const struct sim_co_object *o)
{
	struct application *a = n->ctx;

	fuzz_must(a->n_text <= sizeof(a->text) && a->number >= 10 && a->number <= 20 && a->word <= 0xFFFF);
	if (o->value == &a->number)
		sim_co_event(n, a->number & 1);
}

static void changed(struct sim_co_node *n, uint8_t state, int64_t at_ns)
{
	(void)at_ns;
	fuzz_must(state == n->state && (state == CO_PREOP || state == CO_OPERATIONAL || state == CO_STOPPED));
}

static void beat(struct sim_co_node *n, uint8_t counter, int64_t at_ns)
{
	(void)at_ns;
	fuzz_must(counter == n->counter);
}

static void reading(struct sim_co_node *n, const struct sim_co_object *o)
{
	(void)n;
	fuzz_must(o->access & SIM_CO_RO);
}

static void heard(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns)
{
	(void)port;
	(void)at_ns;
	fuzz_must(f->n_bytes <= 8 && f->id <= 0x7FF);
}

static void set_up(struct sim_co_node *n, struct application *a, uint8_t id)
{
	static const struct sim_co_hooks hooks = { check, wrote, reading, changed, beat, fill };

	*a = (struct application){ .number = 10, .n_text = 9, .text = "blackburst" };
	a->object[0] = (struct sim_co_object){
		.index = 0x2000, .access = SIM_CO_RW, .width = 1, .least = 10, .most = 20, .value = &a->number
	};
	a->object[1] = (struct sim_co_object){
		.index = 0x2001, .sub = 1, .access = SIM_CO_RW, .width = 2, .most = 0xFFFF, .value = &a->word
	};
	a->object[2] = (struct sim_co_object){
		.index = 0x2002, .access = SIM_CO_RW, .bytes = a->text, .cap = sizeof(a->text), .n = &a->n_text
	};
	a->object[3] = (struct sim_co_object){
		.index = 0x2003, .access = SIM_CO_WO, .width = 2, .most = 0xFFFF, .value = &a->word
	};
	*n = (struct sim_co_node){ .hooks = &hooks,
				   .ctx = a,
				   .stored_id = id,
				   .identity = { 1, 2, 3, 4 },
				   .type = 0x530000,
				   .name = "a controller",
				   .app = a->object,
				   .n_app = OBJECTS };
}

static void feed(struct sim_co_node *n, struct bb_clock *clk, const uint8_t *d)
{
	static const uint32_t ids[16] = { 0x605, 0x605, 0x605, 0x605, 0x605, 0x605, 0x000, 0x7e5, 0x080, 0x77f };
	struct bb_can_frame f = { .id = (uint32_t)d[0] | (uint32_t)(d[1] & 7) << 8,
				  .extended = (d[1] & 0xF8) == 0x08,
				  .n_bytes = d[2] % 9 };

	if (d[1] & 0x80) {
		f.id = ids[d[1] >> 3 & 15];
		f.n_bytes = f.id == 0 ? 2 : f.id == 0x77f ? 1 : f.id == 0x080 ? d[2] & 1 : 8;
	}
	memcpy(f.bytes, d + 4, 8);
	n->port.frame(&n->port, &f, bb_clock_now_ns(clk));
	if (d[3] & 0x40)
		sim_co_send_sync(n, bb_clock_now_ns(clk));
	bb_clock_run_until(clk, bb_clock_now_ns(clk) + (1 + d[3] % 64) * INT64_C(100000));
	fuzz_must(n->sdo.n <= sizeof(n->sdo.bytes) && (!n->sdo.object || n->sdo.done <= sizeof(n->sdo.bytes)));
	fuzz_must(n->lss.position < 4 && n->lss.selected < 4);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bb_clock *clk; /* the medium outlives an input, the node does not */
	static struct sim_can *can;
	static struct sim_can_port other = { .frame = heard };
	struct application a;
	struct sim_co_node n;

	if (!size)
		return 0;
	if (!clk) {
		fuzz_must(bb_clock_virtual_create(&clk) == BB_OK && sim_can_create(clk, 1000000, 1, &can) == BB_OK);
		sim_can_attach(can, &other);
	}
	set_up(&n, &a, data[0] & 1 ? 5 : CO_NODE_NONE);
	fuzz_must(sim_co_start(&n, can, clk) == BB_OK);
	for (size_t at = 1; at + RECORD <= size; at += RECORD)
		feed(&n, clk, data + at);
	sim_co_end(&n);
	bb_clock_run_until(clk, bb_clock_now_ns(clk) + 10000000); /* what is on the wire still */
	return 0;
}
