/*
 * tests/fuzz/deep_vcp_reply.c: the driver's machine against a wire that answers with the input: its bytes are
 * replies, missing acknowledges, bus errors and EDID reads in any order. Whatever comes, requests end, tries stay
 * bounded, and nothing but harmless messages goes out.
 *
 * The input: two bytes for the kinds of requests and their codes, then for each transfer a byte that says how it goes
 * (0 no acknowledge, 1 bus error, 2 busy, else it works) and what a read brings: 4 a value, 5 "unsupported", 6 Null,
 * 7 zeros (for the code asked last), any other the bytes that follow.
 */
#include "drivers/ddcci_codec.h"
#include "drivers/ddcci_wire.h"
#include "drivers/monitor_ddc.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct wire {
	struct bb_i2c_bus base;
	const uint8_t *at;
	size_t left;
	unsigned int busy;
	uint8_t code; /* asked last */
};

static void check(bool good)
{
	if (!good)
		abort();
}

static uint8_t next(struct wire *w)
{
	if (!w->left)
		return 0;
	w->left--;
	return *w->at++;
}

static void check_message(const struct bb_i2c_message *m)
{
	check(m->n_bytes > 0 && m->n_bytes <= DDCCI_MOST_REPLY && m->bytes);
	if (m->read || m->address != DDCCI_ADDRESS)
		return;
	check(m->n_bytes >= 4 && m->bytes[0] == DDCCI_HOST && m->bytes[2] != DDCCI_SAVE);
	check(ddcci_checksum(DDCCI_TO_DISPLAY, m->bytes, m->n_bytes) == 0);
}

static void fill(struct wire *w, struct bb_i2c_message *m, uint8_t how)
{
	const uint8_t value[11] = { DDCCI_TO_DISPLAY, 0x88, DDCCI_GET_REPLY, how == 5, w->code };

	for (size_t k = 0; k < m->n_bytes; k++)
		m->bytes[k] = how == 7                                    ? 0
			      : how < 4 || how > 7 || (how < 6 && k >= 7) ? next(w)
			      : k < 11                                    ? value[k]
									  : 0;
	if (how == 6)
		m->bytes[1] = DDCCI_LENGTH_FLAG;
}

static enum bb_status transfer(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n)
{
	struct wire *w = bb_container_of(bus, struct wire, base);
	const uint8_t how = next(w);

	for (size_t i = 0; i < n; i++)
		check_message(&messages[i]);
	if (how == 2 && w->busy++ < 50)
		return BB_ERR_BUSY;
	if (how < 2)
		return how ? BB_ERR_IO : BB_ERR_LOST;
	for (size_t i = 0; i < n; i++)
		if (messages[i].read)
			fill(w, &messages[i], how);
		else if (messages[i].n_bytes > 3)
			w->code = messages[i].bytes[3];
	bus->free_ns = bb_clock_now_ns(bus->clk) + 1000000;
	return BB_OK;
}

static void close_wire(struct bb_i2c_bus *bus)
{
	(void)bus;
}

static const struct bb_i2c_ops ops = { transfer, close_wire };

static void one_request(struct bb_monitor *m, struct bb_clock *clk, enum bb_monitor_request_kind kind, uint8_t code,
			unsigned int value)
{
	static struct bb_monitor_reply r;
	const struct bb_monitor_request q = { kind, code, (uint16_t)(value - 1) };
	int64_t left_ms = 600000;

	if (bb_monitor_submit(m, &q) != BB_OK)
		return;
	while (bb_monitor_poll(m, &r) != BB_OK) {
		bb_clock_run_until(clk, bb_clock_now_ns(clk) + 500000000);
		check((left_ms -= 500) > 0);
	}
	check(r.tries <= MONITOR_DDC_MOST_TRIES && r.edid_bytes <= sizeof(r.edid) && r.text_bytes <= sizeof(r.text));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const uint8_t codes[] = { BB_VCP_LUMINANCE, BB_VCP_POWER_MODE,  BB_VCP_INPUT,   0x59,
					 BB_VCP_HOURS,     BB_VCP_NEW_CONTROL, BB_VCP_VERSION, BB_VCP_CONTRAST };
	struct wire w = { .base = { .ops = &ops }, .at = data, .left = size };
	const struct bb_monitor_config config = { .id = "fuzz" };
	struct bb_monitor *m;

	if (bb_clock_virtual_create(&w.base.clk) != BB_OK)
		return 0;
	const struct bb_open open = { .clk = w.base.clk };
	const unsigned int kinds = next(&w), which = next(&w);
	if (monitor_ddc_open_on(&w.base, &config, &open, &m) == BB_OK) {
		for (unsigned int i = 0; i < 3; i++)
			one_request(m, w.base.clk, (enum bb_monitor_request_kind)(kinds >> (2 * i) & 3),
				    codes[which >> (2 * i) & 7], 2 + (kinds >> 6));
		bb_clock_run_until(w.base.clk, bb_clock_now_ns(w.base.clk) + 20 * BB_NS_PER_S);
		monitor_ddc_release(m);
		bb_clock_run_until(w.base.clk, bb_clock_now_ns(w.base.clk) + BB_NS_PER_S);
		bb_monitor_close(m);
	}
	bb_clock_destroy(w.base.clk);
	return 0;
}
