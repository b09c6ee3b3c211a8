/* drivers/ddc_line.c: see drivers/ddc_line.h. */
#include "drivers/ddc_line.h"

#include "drivers/ddcci_wire.h"

#include <string.h>

#define TRY_AGAIN_NS INT64_C(500000) /* another owner has the wire and does not say for how long */
#define PRESENCE_BYTES 8
#define SEGMENT_BYTES 256

void ddc_line_ask(struct ddc_line *l, const struct ddc_question *question)
{
	l->question = *question;
	l->reading = false;
	l->why = "";
}

static int64_t wait_ns(const struct ddc_line *l, int64_t standard_ns)
{
	return l->question.patient ? 2 * standard_ns : ddc_gap_ns(&l->gap, standard_ns);
}

/* The wire's end of a transfer: on the posix clock the call took that long, on the virtual one free_ns tells. */
static enum bb_status transfer(struct ddc_line *l, struct bb_i2c_message *messages, size_t n)
{
	const enum bb_status status = l->bus->ops->transfer(l->bus, messages, n);

	l->end_ns = bb_clock_now_ns(l->bus->clk);
	if (l->bus->free_ns > l->end_ns)
		l->end_ns = l->bus->free_ns;
	l->transfers += status != BB_ERR_BUSY;
	return status;
}

static int64_t over(struct ddc_line *l, enum ddc_outcome outcome)
{
	l->outcome = outcome;
	l->reading = false;
	return BB_NEVER;
}

static int64_t failed(struct ddc_line *l, enum bb_status status, int64_t now_ns)
{
	if (status == BB_ERR_BUSY)
		return l->end_ns > now_ns ? l->end_ns : now_ns + TRY_AGAIN_NS;
	return over(l, status == BB_ERR_LOST ? DDC_NO_ACK : DDC_BROKEN);
}

/* ---- the EDID memory: needs no waits ---- */

static int64_t read_memory(struct ddc_line *l, int64_t now_ns)
{
	const bool presence = l->question.what == DDC_PRESENCE;
	const size_t n = presence ? PRESENCE_BYTES : DDC_MEMORY_BYTES;
	uint8_t segment = (uint8_t)(l->question.value / SEGMENT_BYTES);
	uint8_t offset = (uint8_t)(l->question.value % SEGMENT_BYTES);
	struct bb_i2c_message m[] = { { EDID_SEGMENT_ADDRESS, false, 1, &segment },
				      { EDID_ADDRESS, false, 1, &offset },
				      { EDID_ADDRESS, true, (uint16_t)n, l->bytes } };
	/* Displays of up to two blocks need not know the segment pointer. A stop would clear it: one transfer. */
	const enum bb_status status = segment ? transfer(l, m, 3) : transfer(l, m + 1, 2);

	if (status != BB_OK)
		return failed(l, status, now_ns);
	/* The EDID's header holds ones: zeros mean that something pulls the wire down. */
	for (size_t i = 0; presence && i < n; i++)
		if (l->bytes[i])
			return over(l, DDC_GOOD);
	return over(l, presence ? DDC_ZEROS : DDC_GOOD);
}

/* ---- the DDC/CI controller ---- */

static size_t request_bytes(const struct ddc_question *q, uint8_t out[DDCCI_MOST_REQUEST])
{
	switch (q->what) {
	case DDC_SET_VCP:
		return ddcci_put_set(out, q->code, q->value);
	case DDC_FRAGMENT:
		return ddcci_put_capabilities(out, q->value);
	case DDC_GET_VCP:
	case DDC_MEMORY:
	case DDC_PRESENCE:
		break;
	}
	return ddcci_put_get(out, q->code);
}

static int64_t send_request(struct ddc_line *l, int64_t now_ns)
{
	uint8_t bytes[DDCCI_MOST_REQUEST];
	const size_t n = request_bytes(&l->question, bytes);
	struct bb_i2c_message m = { DDCCI_ADDRESS, false, (uint16_t)n, bytes };
	const enum bb_status status = transfer(l, &m, 1);

	if (status != BB_OK)
		return failed(l, status, now_ns);
	l->quiet_ns = l->end_ns + wait_ns(l, DDCCI_WRITE_WAIT_NS);
	if (l->question.what == DDC_SET_VCP)
		return over(l, DDC_GOOD);
	l->reading = true;
	return l->end_ns + wait_ns(l, DDCCI_REPLY_WAIT_NS);
}

static enum ddc_outcome decode(struct ddc_line *l, size_t n)
{
	const struct ddc_question *q = &l->question;
	bool doubled;
	const enum ddcci_answer answer =
		q->what == DDC_FRAGMENT ? ddcci_take_fragment(l->bytes, n, q->value, &l->fragment, &doubled, &l->why)
					: ddcci_take_vcp(l->bytes, n, q->code, &l->vcp, &doubled, &l->why);

	/* Learned at the cost of one reply that was read one byte too short. */
	l->doubled |= doubled;
	switch (answer) {
	case DDCCI_ANSWER:
		return DDC_GOOD;
	case DDCCI_NULL:
		return DDC_EMPTY;
	case DDCCI_ALL_ZERO:
		return DDC_ZEROS;
	case DDCCI_BAD:
		break;
	}
	return DDC_DAMAGED;
}

static int64_t read_reply(struct ddc_line *l, int64_t now_ns)
{
	const size_t plain = l->question.what == DDC_FRAGMENT ? DDCCI_FRAGMENT_BYTES : DDCCI_VCP_REPLY_BYTES;
	const size_t n = plain + l->doubled;
	struct bb_i2c_message m = { DDCCI_ADDRESS, true, (uint16_t)n, l->bytes };
	const enum bb_status status = transfer(l, &m, 1);

	if (status != BB_OK)
		return failed(l, status, now_ns);
	l->quiet_ns = l->end_ns + wait_ns(l, DDCCI_WRITE_WAIT_NS);
	return over(l, decode(l, n));
}

int64_t ddc_line_step(struct ddc_line *l, int64_t now_ns)
{
	if (l->question.what == DDC_MEMORY || l->question.what == DDC_PRESENCE)
		return read_memory(l, now_ns);
	if (l->reading)
		return read_reply(l, now_ns);
	return now_ns < l->quiet_ns ? l->quiet_ns : send_request(l, now_ns);
}
