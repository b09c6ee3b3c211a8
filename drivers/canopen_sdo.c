/* drivers/canopen_sdo.c: see drivers/canopen_sdo.h. */
#include "drivers/canopen_sdo.h"

#include <string.h>

#define TRIES 3

void bb_co_sdo_init(struct bb_co_sdo *c, uint8_t node, int64_t wait_ns)
{
	memset(c, 0, sizeof(*c));
	c->node = node;
	c->wait_ns = wait_ns;
	c->status = BB_SKIPPED;
}

static void put(struct bb_co_sdo *c, int64_t now_ns)
{
	c->has_frame = true;
	c->deadline_ns = now_ns + c->wait_ns;
}

static void initiate(struct bb_co_sdo *c, int64_t now_ns)
{
	c->toggle = c->announced = false;
	c->done = 0;
	c->abort = 0;
	c->status = BB_TIMEOUT;
	if (c->write)
		bb_co_sdo_write(&c->frame, c->node, c->index, c->sub, c->bytes, c->n);
	else
		bb_co_sdo_read(&c->frame, c->node, c->index, c->sub);
	put(c, now_ns);
}

void bb_co_sdo_start_read(struct bb_co_sdo *c, uint16_t index, uint8_t sub, int64_t now_ns)
{
	c->index = index;
	c->sub = sub;
	c->write = false;
	c->n = 0;
	c->tries = 1;
	initiate(c, now_ns);
}

void bb_co_sdo_start_write(struct bb_co_sdo *c, uint16_t index, uint8_t sub, const uint8_t *bytes, size_t n,
                           int64_t now_ns)
{
	c->index = index;
	c->sub = sub;
	c->write = true;
	c->n = n < BB_CO_SDO_MOST ? n : BB_CO_SDO_MOST;
	memcpy(c->bytes, bytes, c->n);
	c->tries = 1;
	initiate(c, now_ns);
}

static enum bb_status give_up(struct bb_co_sdo *c, enum bb_status status, uint32_t code)
{
	bb_co_sdo_abort(&c->frame, c->node, c->index, c->sub, code);
	c->has_frame = true;
	c->abort = code;
	c->status = status;
	return status;
}

static void ask_segment(struct bb_co_sdo *c, int64_t now_ns)
{
	bb_co_sdo_read_segment(&c->frame, c->node, c->toggle);
	put(c, now_ns);
}

static void give_segment(struct bb_co_sdo *c, int64_t now_ns)
{
	const size_t left = c->n - c->done, n = left < 7 ? left : 7;

	bb_co_sdo_write_segment(&c->frame, c->node, c->toggle, c->bytes + c->done, n, n == left);
	c->done += n;
	put(c, now_ns);
}

static enum bb_status read_reply(struct bb_co_sdo *c, const struct bb_co_sdo_reply *r, int64_t now_ns)
{
	switch (r->kind) {
	case BB_CO_SDO_DATA:
		if (c->announced)
			return give_up(c, BB_ERR_FORMAT, CO_ABORT_COMMAND);
		memcpy(c->bytes, r->bytes, r->n);
		c->n = r->n;
		c->status = BB_OK;
		return BB_OK;
	case BB_CO_SDO_ANNOUNCED:
		if (c->announced || r->size > BB_CO_SDO_MOST)
			return give_up(c, BB_ERR_FORMAT, CO_ABORT_TOO_LONG);
		c->announced = true;
		c->n = r->size;
		ask_segment(c, now_ns);
		return BB_OK;
	case BB_CO_SDO_SEGMENT:
		if (!c->announced)
			return give_up(c, BB_ERR_FORMAT, CO_ABORT_COMMAND);
		if (r->toggle != c->toggle)
			return give_up(c, BB_ERR_FORMAT, CO_ABORT_TOGGLE);
		if (c->done + r->n > BB_CO_SDO_MOST || (c->n && c->done + r->n > c->n))
			return give_up(c, BB_ERR_FORMAT, CO_ABORT_TOO_LONG);
		memcpy(c->bytes + c->done, r->bytes, r->n);
		c->done += r->n;
		c->toggle = !c->toggle;
		if (!r->last) {
			ask_segment(c, now_ns);
			return BB_OK;
		}
		if (c->n && c->done != c->n)
			return give_up(c, BB_ERR_FORMAT, CO_ABORT_LENGTH);
		c->n = c->done;
		c->status = BB_OK;
		return BB_OK;
	default:
		return give_up(c, BB_ERR_FORMAT, CO_ABORT_COMMAND);
	}
}

static enum bb_status write_reply(struct bb_co_sdo *c, const struct bb_co_sdo_reply *r, int64_t now_ns)
{
	if (r->kind == BB_CO_SDO_WRITTEN && !c->announced) {
		if (c->n <= 4) {
			c->status = BB_OK;
			return BB_OK;
		}
		c->announced = true;
		give_segment(c, now_ns);
		return BB_OK;
	}
	if (r->kind != BB_CO_SDO_TAKEN || !c->announced)
		return give_up(c, BB_ERR_FORMAT, CO_ABORT_COMMAND);
	if (r->toggle != c->toggle)
		return give_up(c, BB_ERR_FORMAT, CO_ABORT_TOGGLE);
	c->toggle = !c->toggle;
	if (c->done == c->n)
		c->status = BB_OK;
	else
		give_segment(c, now_ns);
	return BB_OK;
}

enum bb_status bb_co_sdo_receive(struct bb_co_sdo *c, const struct bb_can_frame *f, int64_t now_ns)
{
	struct bb_co_sdo_reply r;

	if (!bb_co_sdo_busy(c) || bb_co_read_sdo(f, &r) != BB_OK)
		return BB_ERR_FORMAT;
	const bool names = r.kind == BB_CO_SDO_DATA || r.kind == BB_CO_SDO_ANNOUNCED || r.kind == BB_CO_SDO_WRITTEN ||
	                   r.kind == BB_CO_SDO_ABORTED;
	if (names && (r.index != c->index || r.sub != c->sub))
		return BB_ERR_FORMAT; /* an answer to a question of long ago */
	if (r.kind == BB_CO_SDO_ABORTED) {
		c->abort = r.code;
		c->status = BB_ERR_REFUSED;
		return BB_OK;
	}
	return c->write ? write_reply(c, &r, now_ns) : read_reply(c, &r, now_ns);
}

void bb_co_sdo_poll(struct bb_co_sdo *c, int64_t now_ns)
{
	if (!bb_co_sdo_busy(c) || now_ns < c->deadline_ns)
		return;
	if (c->tries == TRIES) {
		(void)give_up(c, BB_ERR_LOST, CO_ABORT_TIMEOUT);
		return;
	}
	c->tries++;
	initiate(c, now_ns);
}

bool bb_co_sdo_take(struct bb_co_sdo *c, struct bb_can_frame *out)
{
	if (!c->has_frame)
		return false;
	*out = c->frame;
	c->has_frame = false;
	return true;
}
