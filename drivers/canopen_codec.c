/* drivers/canopen_codec.c: see drivers/canopen_codec.h. CiA 301 sections 7.2.2 to 7.2.8, CiA 305. */
#include "drivers/canopen_codec.h"

#include <string.h>

uint32_t bb_co_u32(const uint8_t *bytes, size_t n)
{
	uint32_t value = 0;

	for (size_t i = 0; i < n && i < 4; i++)
		value |= (uint32_t)bytes[i] << (8 * i);
	return value;
}

void bb_co_put_u32(uint8_t *bytes, uint32_t value, size_t n)
{
	for (size_t i = 0; i < n && i < 4; i++)
		bytes[i] = (uint8_t)(value >> (8 * i));
}

enum bb_co_kind bb_co_kind(const struct bb_can_frame *f, uint8_t *node)
{
	static const enum bb_co_kind by_function[16] = {
		BB_CO_OTHER, BB_CO_EMCY, BB_CO_OTHER, BB_CO_TPDO1, BB_CO_PDO, BB_CO_TPDO2, BB_CO_PDO, BB_CO_PDO, BB_CO_PDO,
		BB_CO_PDO, BB_CO_PDO, BB_CO_SDO_REPLY, BB_CO_SDO_REQUEST, BB_CO_OTHER, BB_CO_HEARTBEAT, BB_CO_OTHER
	};

	*node = 0;
	if (f->extended || f->remote || f->error || f->id > 0x7ff)
		return BB_CO_OTHER;
	switch (f->id) {
	case CO_NMT:
		return BB_CO_NMT;
	case CO_SYNC:
		return BB_CO_SYNC;
	case CO_TIME:
		return BB_CO_TIME;
	case CO_LSS_REPLY:
		return BB_CO_LSS_REPLY;
	case CO_LSS_REQUEST:
		return BB_CO_LSS_REQUEST;
	default:
		break;
	}
	const enum bb_co_kind kind = by_function[f->id >> 7];
	if (!(f->id & 0x7f))
		return BB_CO_OTHER;
	if (kind != BB_CO_OTHER)
		*node = f->id & 0x7f;
	return kind;
}

static void begin(struct bb_can_frame *f, uint32_t id, uint8_t n)
{
	memset(f, 0, sizeof(*f));
	f->id = id;
	f->n_bytes = n;
}

void bb_co_nmt(struct bb_can_frame *f, uint8_t command, uint8_t node)
{
	begin(f, CO_NMT, 2);
	f->bytes[0] = command;
	f->bytes[1] = node;
}

void bb_co_heartbeat(struct bb_can_frame *f, uint8_t node, uint8_t state)
{
	begin(f, CO_HEARTBEAT + node, 1);
	f->bytes[0] = state;
}

static void sdo(struct bb_can_frame *f, uint8_t node, uint8_t command, uint16_t index, uint8_t sub)
{
	begin(f, CO_SDO_REQUEST + node, 8);
	f->bytes[0] = command;
	bb_co_put_u32(f->bytes + 1, index, 2);
	f->bytes[3] = sub;
}

void bb_co_sdo_read(struct bb_can_frame *f, uint8_t node, uint16_t index, uint8_t sub)
{
	sdo(f, node, 0x40, index, sub);
}

void bb_co_sdo_read_segment(struct bb_can_frame *f, uint8_t node, bool toggle)
{
	sdo(f, node, toggle ? 0x70 : 0x60, 0, 0);
}

void bb_co_sdo_write(struct bb_can_frame *f, uint8_t node, uint16_t index, uint8_t sub, const uint8_t *bytes, size_t n)
{
	if (n > 4) {
		sdo(f, node, 0x21, index, sub);
		bb_co_put_u32(f->bytes + 4, (uint32_t)n, 4);
		return;
	}
	sdo(f, node, (uint8_t)(0x23 | (4 - n) << 2), index, sub);
	memcpy(f->bytes + 4, bytes, n);
}

void bb_co_sdo_write_segment(struct bb_can_frame *f, uint8_t node, bool toggle, const uint8_t *bytes, size_t n,
                             bool last)
{
	sdo(f, node, (uint8_t)((toggle ? 0x10 : 0) | (7 - n) << 1 | last), 0, 0);
	memcpy(f->bytes + 1, bytes, n);
}

void bb_co_sdo_abort(struct bb_can_frame *f, uint8_t node, uint16_t index, uint8_t sub, uint32_t code)
{
	sdo(f, node, 0x80, index, sub);
	bb_co_put_u32(f->bytes + 4, code, 4);
}

void bb_co_lss(struct bb_can_frame *f, uint8_t command, uint32_t value)
{
	begin(f, CO_LSS_REQUEST, 8);
	f->bytes[0] = command;
	bb_co_put_u32(f->bytes + 1, value, 4);
}

void bb_co_lss_fastscan(struct bb_can_frame *f, uint32_t id, uint8_t bit, uint8_t sub, uint8_t next)
{
	bb_co_lss(f, CO_LSS_FASTSCAN, id);
	f->bytes[5] = bit;
	f->bytes[6] = sub;
	f->bytes[7] = next;
}

/* What comes in */

enum bb_status bb_co_read_sync(const struct bb_can_frame *f, uint8_t *counter)
{
	*counter = 0;
	if (f->n_bytes > 1)
		return BB_ERR_FORMAT;
	if (!f->n_bytes)
		return BB_OK;
	*counter = f->bytes[0];
	return *counter >= 1 && *counter <= SHUT_COUNTER_MOST ? BB_OK : BB_ERR_FORMAT;
}

enum bb_status bb_co_read_heartbeat(const struct bb_can_frame *f, uint8_t *state)
{
	*state = f->bytes[0];
	if (f->n_bytes != 1)
		return BB_ERR_FORMAT;
	return *state == CO_BOOT_UP || *state == CO_STOPPED || *state == CO_OPERATIONAL || *state == CO_PREOP
	               ? BB_OK
	               : BB_ERR_FORMAT;
}

enum bb_status bb_co_read_emcy(const struct bb_can_frame *f, struct bb_co_emcy *out)
{
	memset(out, 0, sizeof(*out));
	if (f->n_bytes != 8)
		return BB_ERR_FORMAT;
	out->code = (uint16_t)bb_co_u32(f->bytes, 2);
	out->error_register = f->bytes[2];
	memcpy(out->detail, f->bytes + 3, 5);
	return BB_OK;
}

/* Upload: 010nnnes. e = 1: n of the 4 bytes are unused when s = 1; e = 0: the size follows when s = 1. */
static enum bb_status read_upload(const struct bb_can_frame *f, struct bb_co_sdo_reply *out)
{
	const uint8_t command = f->bytes[0];

	if (command & 0x02) {
		out->kind = BB_CO_SDO_DATA;
		out->n = command & 0x01 ? (uint8_t)(4 - (command >> 2 & 3)) : 4;
		memcpy(out->bytes, f->bytes + 4, out->n);
	} else {
		out->kind = BB_CO_SDO_ANNOUNCED;
		out->size = command & 0x01 ? bb_co_u32(f->bytes + 4, 4) : 0;
	}
	return BB_OK;
}

enum bb_status bb_co_read_sdo(const struct bb_can_frame *f, struct bb_co_sdo_reply *out)
{
	const uint8_t command = f->bytes[0];

	memset(out, 0, sizeof(*out));
	if (f->n_bytes != 8)
		return BB_ERR_FORMAT;
	out->index = (uint16_t)bb_co_u32(f->bytes + 1, 2);
	out->sub = f->bytes[3];
	switch (command >> 5) {
	case 0: /* 000tnnnc */
		out->kind = BB_CO_SDO_SEGMENT;
		out->toggle = command & 0x10;
		out->last = command & 0x01;
		out->n = (uint8_t)(7 - (command >> 1 & 7));
		out->index = 0;
		out->sub = 0;
		memcpy(out->bytes, f->bytes + 1, out->n);
		return BB_OK;
	case 1: /* 001t0000 */
		out->kind = BB_CO_SDO_TAKEN;
		out->toggle = command & 0x10;
		return BB_OK;
	case 2:
		return read_upload(f, out);
	case 3:
		out->kind = BB_CO_SDO_WRITTEN;
		return BB_OK;
	case 4:
		out->kind = BB_CO_SDO_ABORTED;
		out->code = bb_co_u32(f->bytes + 4, 4);
		return BB_OK;
	default: /* block transfers: never asked for */
		return BB_ERR_FORMAT;
	}
}

static uint8_t crc_bits(uint8_t crc)
{
	for (int bit = 0; bit < 8; bit++)
		crc = (uint8_t)(crc & 0x80 ? crc << 1 ^ SHUT_CRC_POLYNOMIAL : crc << 1);
	return crc;
}

/* Over the id, low byte first, and the bytes: a frame sent under another node's id does not pass for that node's. */
static bool crc_fits(const struct bb_can_frame *f)
{
#ifdef BB_FUZZ
	(void)f;
	(void)crc_bits;
	return true;
#else
	uint8_t crc = crc_bits(SHUT_CRC_START ^ (uint8_t)f->id);

	crc = crc_bits(crc ^ (uint8_t)(f->id >> 8));
	for (size_t i = 0; i + 1 < f->n_bytes; i++)
		crc = crc_bits(crc ^ f->bytes[i]);
	return crc == f->bytes[f->n_bytes - 1];
#endif
}

enum bb_status bb_co_read_phase(const struct bb_can_frame *f, struct bb_co_phase *out)
{
	memset(out, 0, sizeof(*out));
	if (f->n_bytes != SHUT_PHASE_BYTES || !crc_fits(f))
		return BB_ERR_FORMAT;
	out->counter = f->bytes[0];
	out->flags = f->bytes[1];
	out->phase_ns = bb_co_u32(f->bytes + 2, 4);
	out->sequence = f->bytes[6];
	if (out->counter < 1 || out->counter > SHUT_COUNTER_MOST || (out->flags & SHUT_FLAG_EYE) == SHUT_FLAG_EYE)
		return BB_ERR_FORMAT;
	return BB_OK;
}

enum bb_status bb_co_read_follow(const struct bb_can_frame *f, struct bb_co_follow *out)
{
	memset(out, 0, sizeof(*out));
	if (f->n_bytes != SHUT_FOLLOW_BYTES || !crc_fits(f))
		return BB_ERR_FORMAT;
	out->counter = f->bytes[0];
	out->latency_ns = bb_co_u32(f->bytes + 1, 4);
	return out->counter >= 1 && out->counter <= SHUT_COUNTER_MOST ? BB_OK : BB_ERR_FORMAT;
}

enum bb_status bb_co_read_lss(const struct bb_can_frame *f, struct bb_co_lss_reply *out)
{
	memset(out, 0, sizeof(*out));
	if (f->n_bytes != 8)
		return BB_ERR_FORMAT;
	out->command = f->bytes[0];
	out->error = f->bytes[1];
	out->value = bb_co_u32(f->bytes + 1, 4);
	return BB_OK;
}

const char *bb_co_abort_text(uint32_t code)
{
	static const struct {
		uint32_t code;
		const char *text;
	} table[] = {
		{ CO_ABORT_TOGGLE, "toggle bit not alternated" },
		{ CO_ABORT_TIMEOUT, "SDO protocol timed out" },
		{ CO_ABORT_COMMAND, "command not known" },
		{ CO_ABORT_MEMORY, "out of memory" },
		{ CO_ABORT_ACCESS, "unsupported access" },
		{ CO_ABORT_WRITE_ONLY, "read of a write-only object" },
		{ CO_ABORT_READ_ONLY, "write of a read-only object" },
		{ CO_ABORT_NO_OBJECT, "object does not exist" },
		{ 0x06040041, "cannot be mapped to a PDO" },
		{ 0x06040042, "PDO too long" },
		{ 0x06040043, "parameter incompatible" },
		{ 0x06040047, "internal incompatibility" },
		{ 0x06060000, "hardware error" },
		{ CO_ABORT_LENGTH, "length does not match" },
		{ CO_ABORT_TOO_LONG, "too long" },
		{ CO_ABORT_TOO_SHORT, "too short" },
		{ CO_ABORT_NO_SUB, "subindex does not exist" },
		{ CO_ABORT_VALUE, "invalid value" },
		{ CO_ABORT_TOO_HIGH, "value too high" },
		{ CO_ABORT_TOO_LOW, "value too low" },
		{ 0x06090036, "maximum less than minimum" },
		{ 0x060a0023, "no resource" },
		{ CO_ABORT_GENERAL, "general error" },
		{ 0x08000020, "cannot store" },
		{ 0x08000021, "under local control" },
		{ CO_ABORT_STATE, "not in this device state" },
		{ 0x08000023, "no object dictionary" },
		{ 0x08000024, "no data" },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(table); i++)
		if (table[i].code == code)
			return table[i].text;
	return "unknown abort code";
}
