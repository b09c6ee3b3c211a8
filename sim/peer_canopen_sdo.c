/* sim/peer_canopen_sdo.c: the node's SDO server, expedited and segmented (CiA 301 section 7.2.4.3). */
#include "sim/peer_canopen.h"

#include <string.h>

static const struct sim_co_object *in(const struct sim_co_object *list, size_t n, uint16_t index, uint8_t sub,
                                      bool *known)
{
	for (size_t i = 0; i < n; i++) {
		*known |= list[i].index == index;
		if (list[i].index == index && list[i].sub == sub)
			return &list[i];
	}
	return NULL;
}

static const struct sim_co_object *find(const struct sim_co_node *n, uint16_t index, uint8_t sub, uint32_t *abort)
{
	bool known = false;
	const struct sim_co_object *o = in(n->comm, n->n_comm, index, sub, &known);

	if (!o)
		o = in(n->app, n->n_app, index, sub, &known);
	*abort = known ? CO_ABORT_NO_SUB : CO_ABORT_NO_OBJECT;
	return o;
}

static void reply(struct sim_co_node *n, const uint8_t bytes[8])
{
	sim_co_send(n, CO_SDO_REPLY + n->id, bytes, 8);
}

static void refuse(struct sim_co_node *n, uint32_t code)
{
	const uint8_t bytes[8] = { 0x80, (uint8_t)n->sdo.index, (uint8_t)(n->sdo.index >> 8), n->sdo.sub,
		                   (uint8_t)code, (uint8_t)(code >> 8), (uint8_t)(code >> 16), (uint8_t)(code >> 24) };

	n->sdo.object = NULL;
	reply(n, bytes);
}

/* Answers that carry the multiplexer and up to four bytes. */
static void answer(struct sim_co_node *n, uint8_t command, const uint8_t *data, uint32_t n_data)
{
	uint8_t bytes[8] = { command, (uint8_t)n->sdo.index, (uint8_t)(n->sdo.index >> 8), n->sdo.sub };

	if (n_data)
		memcpy(bytes + 4, data, n_data);
	reply(n, bytes);
}

static void upload(struct sim_co_node *n, const struct sim_co_object *o)
{
	if (!(o->access & SIM_CO_RO)) {
		refuse(n, CO_ABORT_WRITE_ONLY);
		return;
	}
	if (n->hooks->reading)
		n->hooks->reading(n, o);
	n->sdo.n = o->width ? o->width : *o->n;
	for (uint32_t i = 0; i < n->sdo.n; i++) {
		if (o->width)
			n->sdo.bytes[i] = (uint8_t)(*o->value >> (8 * i));
		else
			n->sdo.bytes[i] = o->bytes[i];
	}
	if (n->sdo.n >= 1 && n->sdo.n <= 4) {
		answer(n, (uint8_t)(0x43 + (4 - n->sdo.n) * 4), n->sdo.bytes, n->sdo.n);
		return;
	}
	const uint8_t size[4] = { (uint8_t)n->sdo.n, 0, 0, 0 };
	n->sdo.object = o;
	n->sdo.writing = n->sdo.toggle = false;
	n->sdo.done = 0;
	answer(n, 0x41, size, 4);
}

static void upload_segment(struct sim_co_node *n, uint8_t command)
{
	uint8_t bytes[8] = { 0 };
	const uint32_t left = n->sdo.n - n->sdo.done, k = left < 7 ? left : 7;

	if (!n->sdo.object || n->sdo.writing) {
		refuse(n, CO_ABORT_COMMAND);
		return;
	}
	if ((command >> 4 & 1) != n->sdo.toggle) {
		refuse(n, CO_ABORT_TOGGLE);
		return;
	}
	bytes[0] = (uint8_t)((uint32_t)n->sdo.toggle << 4 | (7 - k) << 1 | (k == left));
	memcpy(bytes + 1, n->sdo.bytes + n->sdo.done, k);
	n->sdo.done += k;
	n->sdo.toggle = !n->sdo.toggle;
	if (k == left)
		n->sdo.object = NULL;
	reply(n, bytes);
}

/* Takes the n bytes of the transfer as the object's new value; 0 or an abort code. */
static uint32_t store(struct sim_co_node *n, const struct sim_co_object *o)
{
	uint32_t value = 0, code;

	if (!o->width) {
		if (n->sdo.n > o->cap)
			return CO_ABORT_TOO_LONG;
		memcpy(o->bytes, n->sdo.bytes, n->sdo.n);
		*o->n = (uint16_t)n->sdo.n;
		return 0;
	}
	if (n->sdo.n != o->width)
		return n->sdo.n > o->width ? CO_ABORT_TOO_LONG : CO_ABORT_TOO_SHORT;
	for (uint32_t i = 0; i < n->sdo.n; i++)
		value |= (uint32_t)n->sdo.bytes[i] << (8 * i);
	if (value > o->most)
		return CO_ABORT_TOO_HIGH;
	if (value < o->least)
		return CO_ABORT_TOO_LOW;
	if (n->hooks->check && (code = n->hooks->check(n, o, value)))
		return code;
	*o->value = value;
	return 0;
}

/* What a new value means to the node itself. */
static void wrote(struct sim_co_node *n, const struct sim_co_object *o)
{
	const int64_t now_ns = bb_clock_now_ns(n->clk);

	if (o->value == &n->producer)
		n->beat_ns = now_ns + n->producer * INT64_C(1000000);
	if (o->value == &n->consumer) {
		n->master_lost = false;
		n->master_ns = now_ns + (n->consumer & 0xffff) * INT64_C(1000000);
	}
	if (n->hooks->wrote)
		n->hooks->wrote(n, o);
	sim_co_rearm(n);
}

static void download(struct sim_co_node *n, const struct sim_co_object *o, const struct bb_can_frame *f)
{
	const uint8_t command = f->bytes[0];

	if (!(o->access & SIM_CO_WO)) {
		refuse(n, CO_ABORT_READ_ONLY);
		return;
	}
	if (!(command & 2)) {
		n->sdo.object = o;
		n->sdo.writing = true;
		n->sdo.toggle = false;
		n->sdo.n = 0;
		n->sdo.done = command & 1 ? (uint32_t)f->bytes[4] | (uint32_t)f->bytes[5] << 8 | (uint32_t)f->bytes[6] << 16 |
		                                    (uint32_t)f->bytes[7] << 24
		                          : 0; /* announced */
		if (n->sdo.done > sizeof(n->sdo.bytes) || (!o->width && n->sdo.done > o->cap))
			refuse(n, CO_ABORT_TOO_LONG);
		else
			answer(n, 0x60, NULL, 0);
		return;
	}
	n->sdo.n = command & 1 ? 4u - (command >> 2 & 3) : o->width ? o->width : 4;
	memcpy(n->sdo.bytes, f->bytes + 4, n->sdo.n);
	const uint32_t code = store(n, o);
	if (code) {
		refuse(n, code);
		return;
	}
	answer(n, 0x60, NULL, 0);
	wrote(n, o);
}

static void download_segment(struct sim_co_node *n, const struct bb_can_frame *f)
{
	const struct sim_co_object *o = n->sdo.object;
	const uint8_t command = f->bytes[0];
	const uint32_t k = 7u - (command >> 1 & 7);

	if (!o || !n->sdo.writing) {
		refuse(n, CO_ABORT_COMMAND);
		return;
	}
	if ((command >> 4 & 1) != n->sdo.toggle) {
		refuse(n, CO_ABORT_TOGGLE);
		return;
	}
	if (n->sdo.n + k > sizeof(n->sdo.bytes)) {
		refuse(n, CO_ABORT_TOO_LONG);
		return;
	}
	memcpy(n->sdo.bytes + n->sdo.n, f->bytes + 1, k);
	n->sdo.n += k;
	const uint8_t taken[8] = { (uint8_t)(0x20 | n->sdo.toggle << 4) };
	n->sdo.toggle = !n->sdo.toggle;
	if (command & 1) {
		const uint32_t code = n->sdo.done && n->sdo.done != n->sdo.n ? CO_ABORT_LENGTH : store(n, o);
		if (code) {
			refuse(n, code);
			return;
		}
		n->sdo.object = NULL;
		wrote(n, o);
	}
	reply(n, taken);
}

void sim_co_sdo_frame(struct sim_co_node *n, const struct bb_can_frame *f)
{
	uint32_t code = 0;

	if (f->n_bytes != 8)
		return;
	const uint8_t kind = f->bytes[0] >> 5;
	if (kind == 4) { /* the client gives up */
		n->sdo.object = NULL;
		return;
	}
	if (kind == 0) {
		download_segment(n, f);
		return;
	}
	if (kind == 3) {
		upload_segment(n, f->bytes[0]);
		return;
	}
	n->sdo.index = (uint16_t)(f->bytes[1] | f->bytes[2] << 8);
	n->sdo.sub = f->bytes[3];
	n->sdo.object = NULL;
	const struct sim_co_object *o = find(n, n->sdo.index, n->sdo.sub, &code);
	if (kind != 1 && kind != 2)
		refuse(n, CO_ABORT_COMMAND);
	else if (!o)
		refuse(n, code);
	else if (kind == 2)
		upload(n, o);
	else
		download(n, o, f);
}
