/*
 * tests/fuzz/deep_shutter_can.c: the whole driver against a hostile bus: any frames at any time, error frames and
 * failing calls included. Input: one byte (1: configured by polite controllers first), then records of 12 bytes: id
 * low; id high and kind; length or status; 100 us units to wait; 8 data bytes.
 */
#include "drivers/canopen_wire.h"
#include "drivers/shutter_can.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define ANSWERS 8
#define RECORDS 64

struct hostile {
	struct bb_can_bus bus;
	struct bb_can_frame next, asked, answer[ANSWERS];
	size_t n_answers;
	bool has_next, polite;
	enum bb_status status;
};

/* Takes every write and knows every object, so that fuzzing gets past the configuration. */
static struct bb_can_frame polite(const struct bb_can_frame *q, const uint8_t *value)
{
	const uint16_t index = (uint16_t)(q->bytes[1] | q->bytes[2] << 8);
	struct bb_can_frame f = { .id = q->id - 0x80, .n_bytes = 8 };

	memcpy(f.bytes, q->bytes, 4);
	f.bytes[0] = q->bytes[0] == 0x40 ? 0x43 : (q->bytes[0] & 0xe0) == 0 ? (uint8_t)(0x20 | (q->bytes[0] & 0x10)) : 0x60;
	memcpy(f.bytes + 4, value, 4);
	if (index == CO_OD_TYPE)
		memcpy(f.bytes + 4, "\0\0\x53\0", 4);
	if (index == SHUT_OD_CHAIN) {
		f.bytes[0] = 0x4f;
		f.bytes[4] = (uint8_t)(q->id - 0x605);
	}
	return f;
}

static enum bb_status hostile_send(struct bb_can_bus *bus, const struct bb_can_frame *f)
{
	static const uint32_t delay_ns[3] = { 3000000, 35000, 70000 };
	struct hostile *h = bb_container_of(bus, struct hostile, bus);

	if (f->n_bytes > 8 || f->id > 0x7ff)
		abort();
	h->asked = *f;
	if (h->polite && h->n_answers < ANSWERS && f->id >= 0x605 && f->id < 0x608) {
		const uint32_t v = delay_ns[f->id - 0x605];
		const uint8_t bytes[4] = { (uint8_t)v, (uint8_t)(v >> 8), (uint8_t)(v >> 16), (uint8_t)(v >> 24) };
		h->answer[h->n_answers] = polite(f, bytes);
		h->answer[h->n_answers++].at_ns = bb_clock_now_ns(bus->clk);
	}
	return h->status < 0 ? h->status : BB_OK;
}

static enum bb_status hostile_receive(struct bb_can_bus *bus, struct bb_can_frame *f)
{
	struct hostile *h = bb_container_of(bus, struct hostile, bus);

	if (h->n_answers) {
		*f = h->answer[--h->n_answers];
		return BB_OK;
	}
	if (!h->has_next)
		return h->status < 0 ? h->status : BB_TIMEOUT;
	*f = h->next;
	h->has_next = false;
	return BB_OK;
}

static enum bb_status hostile_restart(struct bb_can_bus *bus)
{
	(void)bus;
	return BB_ERR_UNSUPPORTED;
}

static void hostile_close(struct bb_can_bus *bus)
{
	(void)bus;
}

static void act(struct hostile *h, struct bb_shutter *sh, const uint8_t *d)
{
	struct bb_shutter_edge e[8];
	size_t n;

	h->status = BB_OK;
	h->next = (struct bb_can_frame){ .id = (uint32_t)d[0] | (uint32_t)(d[1] & 7) << 8, .n_bytes = d[2] % 9 };
	memcpy(h->next.bytes, d + 4, 8);
	h->has_next = true;
	switch (d[1] >> 3 & 15) {
	case 0:
		h->next.error = true;
		h->next.id = (uint32_t)d[0] | (uint32_t)(d[1] & 3) << 8;
		break;
	case 1:
		h->has_next = false;
		h->status = d[2] & 1 ? BB_ERR_LOST : d[2] & 2 ? BB_ERR_IO : BB_ERR_BUSY;
		break;
	case 2:
		(void)!bb_shutter_set_phase(sh, d[4] % 3 == 2 ? BB_STAGE_EMITTER : d[4] % 3, d[5] * INT64_C(10000), 1000000);
		break;
	case 3:
		(void)!bb_shutter_set_mode(sh, d[4] & 1 ? BB_SHUTTER_STEREO : BB_SHUTTER_OPEN);
		break;
	case 4:
		h->next.id = CO_SYNC;
		break;
	case 5:
		h->next.id = CO_TPDO1 + 5 + (uint32_t)d[0] % 3;
		break;
	case 6:
		h->next.id = CO_TPDO2 + 5;
		break;
	case 7:
		h->next.id = CO_HEARTBEAT + 5 + (uint32_t)d[0] % 3;
		break;
	case 8:
		h->next.id = CO_LSS_REPLY;
		break;
	case 9:
		h->next.extended = true;
		break;
	case 10:
		break;
	default:
		h->next = polite(&h->asked, d + 4);
		h->next.id &= 0x7ff;
		break;
	}
	while (bb_shutter_read(sh, e, 8, &n) == BB_OK)
		for (size_t i = 0; i < n; i++)
			if (e[i].eye < 1 || e[i].eye > 2 || (e[i].stage > 1 && e[i].stage != BB_STAGE_EMITTER))
				abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const struct bb_can_ops ops = { hostile_send, hostile_receive, hostile_restart, hostile_close };
	const struct bb_shutter_config config = { .id = "chain", .rate = { 120, 1 }, .n_stages = 2,
		                                  .stage = { "front", "left" }, .stage_delay_us = 35,
		                                  .emitter_offset_us = 3000 };
	struct bb_uri uri = { .scheme = "can", .n_options = 1, .option = { { "node", "5" } } };
	struct bb_clock *clk;
	struct bb_shutter *sh;

	if (bb_clock_virtual_create(&clk) != BB_OK)
		return 0;
	struct hostile h = { .bus = { &ops, clk, 1000000 } };
	const struct bb_open open = { .clk = clk, .uri = &uri, .seed = 1 };
	if (bb_shutter_can_open_on(&h.bus, &config, &open, &sh) == BB_OK) {
		h.polite = size && data[0] & 1;
		for (int i = 0; h.polite && i < 80; i++)
			bb_clock_run_until(clk, bb_clock_now_ns(clk) + 1000000);
		h.polite = false;
		for (size_t at = 1; at + 12 <= size && at < 12 * RECORDS; at += 12) {
			h.next.at_ns = bb_clock_now_ns(clk);
			act(&h, sh, data + at);
			h.next.at_ns = bb_clock_now_ns(clk);
			bb_clock_run_until(clk, bb_clock_now_ns(clk) + (1 + data[at + 3] % 128) * INT64_C(100000));
		}
		if (bb_shutter_can_status(sh).n_ready > 3)
			abort();
		bb_shutter_close(sh);
	}
	bb_clock_destroy(clk);
	return 0;
}
