/* sim/peer_modbus.c: the strip's registers and both framings; see sim/peer_modbus.h. */
#include "sim/peer_modbus.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define RELAY_NS (20 * INT64_C(1000000))
#define FRAME_NS (2 * BB_NS_PER_S)
#define IDLE_NS (60 * BB_NS_PER_S)
#define RTU_SILENCE_NS (50 * INT64_C(1000000)) /* generous: a pty has no baud rate to count 3.5 characters by */
#define CRC_BYTES 2

static const char vendor_name[] = "blackburst", product_code[] = "simulated-power-strip", revision[] = "1";

/* ---- the strip ---- */

void peer_modbus_init(struct peer_modbus *p, const struct bb_power_config *config, uint8_t unit, int64_t now_ns)
{
	memset(p, 0, sizeof(*p));
	snprintf(p->id, sizeof(p->id), "%s", config->id);
	p->unit = unit;
	p->relay_ns = RELAY_NS;
	for (size_t i = 0; i < config->n_outlets; i++) {
		const struct bb_outlet_config *c = &config->outlet[i];
		if (c->outlet < 1 || c->outlet > BB_OUTLETS_MAX)
			continue;
		struct peer_modbus_outlet *o = &p->outlet[c->outlet - 1];
		o->present = true;
		o->load_a = c->load_a;
		o->inrush_a = c->inrush_a;
		o->inrush_ms = c->inrush_ms;
		p->n_outlets = (size_t)c->outlet > p->n_outlets ? (size_t)c->outlet : p->n_outlets;
	}
	for (size_t i = 0; i < p->n_outlets; i++) {
		p->outlet[i].coil = p->outlet[i].before = true;
		p->outlet[i].changed_ns = now_ns - 3600 * BB_NS_PER_S;
		p->outlet[i].current_a = -1;
	}
}

bool peer_modbus_contact(const struct peer_modbus *p, size_t outlet, int64_t now_ns)
{
	const struct peer_modbus_outlet *o = &p->outlet[outlet - 1];

	if (o->stick != PEER_MODBUS_FREE)
		return o->stick == PEER_MODBUS_STUCK_CLOSED;
	return now_ns - o->changed_ns >= p->relay_ns ? o->coil : o->before;
}

double peer_modbus_current_a(const struct peer_modbus *p, size_t outlet, int64_t now_ns)
{
	const struct peer_modbus_outlet *o = &p->outlet[outlet - 1];
	const int64_t since_ns = now_ns - o->changed_ns - p->relay_ns;

	if (!peer_modbus_contact(p, outlet, now_ns))
		return 0;
	if (o->coil && (double)since_ns < o->inrush_ms * 1e6)
		return fmax(o->inrush_a, o->load_a);
	return o->current_a >= 0 ? o->current_a : o->load_a;
}

void peer_modbus_switch(struct peer_modbus *p, size_t outlet, bool on, int64_t now_ns)
{
	struct peer_modbus_outlet *o = &p->outlet[outlet - 1];

	if (o->coil == on || p->faults.deaf_to_writes)
		return;
	o->before = peer_modbus_contact(p, outlet, now_ns);
	o->coil = on;
	o->changed_ns = now_ns;
}

/* ---- requests ---- */

struct job { /* one request and where its reply goes */
	struct peer_modbus *p;
	const uint8_t *pdu;
	size_t n;
	uint8_t *out;
	int64_t now_ns;
};

static unsigned word_at(const uint8_t *bytes)
{
	return (unsigned)bytes[0] << 8 | bytes[1];
}

static void put_word(uint8_t *bytes, unsigned value)
{
	bytes[0] = (uint8_t)(value >> 8);
	bytes[1] = (uint8_t)value;
}

static size_t exception(struct job *j, uint8_t code)
{
	j->p->n_exceptions++;
	j->out[0] = (uint8_t)(j->pdu[0] | MODBUS_FN_ERROR);
	j->out[1] = code;
	return 2;
}

static bool outlets_there(const struct peer_modbus *p, unsigned address, unsigned count)
{
	const long first = (long)address - MODBUS_MAP_OUTLETS;

	return first >= 0 && (size_t)first + count <= p->n_outlets;
}

static size_t read_bits(struct job *j, bool contacts)
{
	const unsigned address = word_at(j->pdu + 1), count = word_at(j->pdu + 3);

	if (j->n != 5 || count < 1 || count > MODBUS_READ_BITS_MOST)
		return exception(j, MODBUS_EX_VALUE);
	if (!outlets_there(j->p, address, count))
		return exception(j, MODBUS_EX_ADDRESS);
	const unsigned n_bytes = (count + 7) / 8;
	memset(j->out, 0, 2 + n_bytes);
	j->out[0] = j->pdu[0];
	j->out[1] = (uint8_t)n_bytes;
	for (unsigned i = 0; i < count; i++) {
		const unsigned outlet = address - MODBUS_MAP_OUTLETS + i + 1;
		const bool on = contacts ? peer_modbus_contact(j->p, outlet, j->now_ns) : j->p->outlet[outlet - 1].coil;
		j->out[2 + i / 8] = (uint8_t)(j->out[2 + i / 8] | on << i % 8);
	}
	return 2 + n_bytes;
}

static bool input_register(const struct job *j, unsigned address, unsigned *value)
{
	const struct peer_modbus *p = j->p;
	const bool foreign = p->faults.foreign;
	const long id = (long)address - MODBUS_MAP_IDENTITY, meter = (long)address - MODBUS_MAP_CURRENT_MA;
	const unsigned identity[MODBUS_MAP_IDENTITY_WORDS] = { foreign ? 0x1234 : MODBUS_MAP_ID_0,
		                                               foreign ? 0x5678 : MODBUS_MAP_ID_1, MODBUS_MAP_VERSION,
		                                               (unsigned)p->n_outlets };

	if (id >= 0 && id < MODBUS_MAP_IDENTITY_WORDS) {
		*value = identity[id];
		return true;
	}
	if (meter < 0 || (size_t)meter >= p->n_outlets)
		return false;
	*value = (unsigned)fmin(65535, round(1000 * peer_modbus_current_a(p, (size_t)meter + 1, j->now_ns)));
	return true;
}

static bool holding_register(const struct job *j, unsigned address, unsigned *value)
{
	if (!outlets_there(j->p, address, 1))
		return false;
	*value = j->p->outlet[address - MODBUS_MAP_OUTLETS].coil;
	return true;
}

static size_t read_words(struct job *j, bool (*one)(const struct job *, unsigned, unsigned *))
{
	const unsigned address = word_at(j->pdu + 1), count = word_at(j->pdu + 3);
	unsigned value;

	if (j->n != 5 || count < 1 || count > MODBUS_READ_REGISTERS_MOST)
		return exception(j, MODBUS_EX_VALUE);
	for (unsigned i = 0; i < count; i++) {
		if (!one(j, address + i, &value))
			return exception(j, MODBUS_EX_ADDRESS);
		put_word(j->out + 2 + 2 * i, value);
	}
	j->out[0] = j->pdu[0];
	j->out[1] = (uint8_t)(2 * count);
	return 2 + 2 * count;
}

static size_t write_one(struct job *j, unsigned on_value)
{
	const unsigned address = word_at(j->pdu + 1), value = word_at(j->pdu + 3);

	if (j->n != 5 || (value != on_value && value != 0))
		return exception(j, MODBUS_EX_VALUE);
	if (!outlets_there(j->p, address, 1))
		return exception(j, MODBUS_EX_ADDRESS);
	j->p->n_writes++;
	peer_modbus_switch(j->p, address - MODBUS_MAP_OUTLETS + 1, value != 0, j->now_ns);
	memcpy(j->out, j->pdu, 5);
	return 5;
}

static size_t write_many(struct job *j, bool words)
{
	const unsigned most = words ? MODBUS_WRITE_REGISTERS_MOST : MODBUS_WRITE_BITS_MOST;

	if (j->n < 6)
		return exception(j, MODBUS_EX_VALUE);
	const unsigned address = word_at(j->pdu + 1), count = word_at(j->pdu + 3);
	const unsigned n_bytes = words ? 2 * count : (count + 7) / 8;
	if (count < 1 || count > most || j->pdu[5] != n_bytes || j->n != 6 + n_bytes)
		return exception(j, MODBUS_EX_VALUE);
	if (!outlets_there(j->p, address, count))
		return exception(j, MODBUS_EX_ADDRESS);
	for (unsigned i = 0; words && i < count; i++)
		if (word_at(j->pdu + 6 + 2 * i) > 1)
			return exception(j, MODBUS_EX_VALUE);
	j->p->n_writes++;
	for (unsigned i = 0; i < count; i++) {
		const bool on = words ? word_at(j->pdu + 6 + 2 * i) != 0 : (j->pdu[6 + i / 8] >> i % 8 & 1) != 0;
		peer_modbus_switch(j->p, address - MODBUS_MAP_OUTLETS + i + 1, on, j->now_ns);
	}
	memcpy(j->out, j->pdu, 5);
	return 5;
}

/* Function 2B/0E, the three basic objects in one answer. */
static size_t device_id(struct job *j)
{
	const char *const text[] = { vendor_name, product_code, revision };
	size_t n = 7;

	if (j->n != 4 || j->pdu[1] != MODBUS_MEI_DEVICE_ID)
		return exception(j, MODBUS_EX_FUNCTION);
	if (j->pdu[2] != 1 || j->pdu[3] >= BB_ARRAY_LEN(text))
		return exception(j, j->pdu[2] != 1 ? MODBUS_EX_VALUE : MODBUS_EX_ADDRESS);
	memcpy(j->out, (const uint8_t[]){ MODBUS_FN_DEVICE_ID, MODBUS_MEI_DEVICE_ID, 1, 1, 0, 0, 0 }, n);
	for (size_t i = j->pdu[3]; i < BB_ARRAY_LEN(text); i++) {
		const size_t length = strlen(text[i]);
		j->out[n++] = (uint8_t)i;
		j->out[n++] = (uint8_t)length;
		memcpy(j->out + n, text[i], length);
		n += length;
		j->out[6]++;
	}
	return n;
}

static size_t answer(struct job *j)
{
	if (j->n < 5 && j->pdu[0] != MODBUS_FN_DEVICE_ID)
		return exception(j, MODBUS_EX_VALUE);
	switch (j->pdu[0]) {
	case MODBUS_FN_READ_COILS:
		return read_bits(j, false);
	case MODBUS_FN_READ_INPUTS:
		return read_bits(j, true);
	case MODBUS_FN_READ_HOLDING:
		return read_words(j, holding_register);
	case MODBUS_FN_READ_INPUT_REGISTERS:
		return read_words(j, input_register);
	case MODBUS_FN_WRITE_COIL:
		return write_one(j, MODBUS_COIL_ON);
	case MODBUS_FN_WRITE_REGISTER:
		return write_one(j, 1);
	case MODBUS_FN_WRITE_COILS:
		return write_many(j, false);
	case MODBUS_FN_WRITE_REGISTERS:
		return write_many(j, true);
	case MODBUS_FN_DEVICE_ID:
		return device_id(j);
	default:
		return exception(j, MODBUS_EX_FUNCTION);
	}
}

size_t peer_modbus_pdu(struct peer_modbus *p, const uint8_t *pdu, size_t n, uint8_t *out, int64_t now_ns)
{
	struct job j = { p, pdu, n, out, now_ns };

	if (!n || n > MODBUS_PDU_MOST)
		return 0;
	p->n_requests++;
	if (p->faults.silent)
		return 0;
	return p->faults.exception ? exception(&j, p->faults.exception) : answer(&j);
}

/* ---- framing ---- */

/* Says a whole frame with whatever is wrong with it. */
static bool say(struct peer_modbus *p, struct sim_wire_line *line, uint8_t *adu, size_t n, int64_t now_ns)
{
	static const uint8_t rubbish[] = { 0xDE, 0xAD, 0xBE, 0xEF, 0x00 };
	struct peer_modbus_faults *f = &p->faults;
	const bool late = f->late_ns && f->late_left >= 0;

	if (f->garbage) {
		memcpy(adu + n, rubbish, sizeof(rubbish));
		n += sizeof(rubbish);
	}
	if (late && f->late_left && !--f->late_left)
		f->late_left = -1;
	return sim_wire_say(line, adu, n, now_ns + (late ? f->late_ns : 0), f->dribble_ns);
}

static bool dead(struct peer_modbus *p, struct peer_modbus_session *s)
{
	s->dead |= p->faults.half_open;
	return s->dead;
}

static bool unfinished(const void *session)
{
	return ((const struct peer_modbus_session *)session)->n > 0;
}

/* s->bytes holds one whole TCP frame of n bytes. A unit that is not ours is a target behind a gateway that is not there. */
static bool tcp_frame(struct peer_modbus *p, struct peer_modbus_session *s, struct sim_wire_line *line, size_t n,
                      int64_t now_ns)
{
	uint8_t adu[SIM_WIRE_SAY_MAX];
	const uint8_t unit = s->bytes[6], *pdu = s->bytes + MODBUS_MBAP_BYTES;
	size_t n_pdu;

	if (unit == p->unit || unit == 0 || unit == 0xFF) {
		n_pdu = peer_modbus_pdu(p, pdu, n - MODBUS_MBAP_BYTES, adu + MODBUS_MBAP_BYTES, now_ns);
	} else {
		adu[MODBUS_MBAP_BYTES] = (uint8_t)(pdu[0] | MODBUS_FN_ERROR);
		adu[MODBUS_MBAP_BYTES + 1] = MODBUS_EX_GATEWAY_TARGET;
		n_pdu = p->faults.silent ? 0 : 2;
	}
	if (!n_pdu)
		return true;
	memcpy(adu, s->bytes, MODBUS_MBAP_BYTES);
	put_word(adu + 4, (unsigned)((int64_t)n_pdu + 1 + p->faults.length_lie));
	return say(p, line, adu, MODBUS_MBAP_BYTES + n_pdu, now_ns);
}

static bool tcp_take(void *peer, void *session, struct sim_wire_line *line, const uint8_t *bytes, size_t n,
                     int64_t now_ns)
{
	struct peer_modbus *p = peer;
	struct peer_modbus_session *s = session;

	if (dead(p, s))
		return true;
	for (size_t i = 0; i < n; i++) {
		s->bytes[s->n++] = bytes[i];
		if (s->n < 6)
			continue;
		const unsigned length = word_at(s->bytes + 4);
		/* A header that cannot be: no way to find the next frame in this stream. */
		if (word_at(s->bytes + 2) != 0 || length < 2 || length > MODBUS_PDU_MOST + 1) {
			p->n_refused_frames++;
			return false;
		}
		if (s->n < 6 + length)
			continue;
		s->n = 0;
		if (!tcp_frame(p, s, line, 6 + length, now_ns))
			return false;
	}
	return true;
}

uint16_t peer_modbus_crc(const uint8_t *bytes, size_t n)
{
	unsigned crc = 0xFFFF;

	for (size_t i = 0; i < n; i++) {
		crc ^= bytes[i];
		for (int bit = 0; bit < 8; bit++)
			crc = crc & 1 ? crc >> 1 ^ 0xA001 : crc >> 1;
	}
	return (uint16_t)crc;
}

static bool crc_good(const uint8_t *bytes, size_t n)
{
#ifdef BB_FUZZ
	(void)bytes;
	return n > CRC_BYTES;
#else
	const uint16_t crc = peer_modbus_crc(bytes, n - CRC_BYTES);

	return bytes[n - 2] == (uint8_t)crc && bytes[n - 1] == (uint8_t)(crc >> 8);
#endif
}

/* How long a request is by its function, checksum included; 0: not known yet, or not a function we know. */
static size_t rtu_length(const uint8_t *bytes, size_t n)
{
	if (n < 2)
		return 0;
	switch (bytes[1]) {
	case MODBUS_FN_WRITE_COILS:
	case MODBUS_FN_WRITE_REGISTERS:
		return n < 7 ? 0 : 7 + (size_t)bytes[6] + CRC_BYTES;
	case MODBUS_FN_DEVICE_ID:
		return 5 + CRC_BYTES;
	default:
		return 6 + CRC_BYTES;
	}
}

static bool rtu_frame(struct peer_modbus *p, struct peer_modbus_session *s, struct sim_wire_line *line, size_t n,
                      int64_t now_ns)
{
	uint8_t adu[SIM_WIRE_SAY_MAX];
	const bool broadcast = s->bytes[0] == 0;

	if (!crc_good(s->bytes, n)) {
		p->n_refused_frames++;
		return true;
	}
	if (s->bytes[0] != p->unit && !broadcast)
		return true; /* another strip's */
	const size_t n_pdu = peer_modbus_pdu(p, s->bytes + 1, n - 1 - CRC_BYTES, adu + 1, now_ns);
	if (!n_pdu || broadcast)
		return true;
	adu[0] = p->unit;
	const uint16_t crc = peer_modbus_crc(adu, 1 + n_pdu);
	adu[1 + n_pdu] = (uint8_t)crc;
	adu[2 + n_pdu] = (uint8_t)(crc >> 8);
	return say(p, line, adu, 1 + n_pdu + CRC_BYTES, now_ns);
}

static bool rtu_take(void *peer, void *session, struct sim_wire_line *line, const uint8_t *bytes, size_t n,
                     int64_t now_ns)
{
	struct peer_modbus *p = peer;
	struct peer_modbus_session *s = session;

	if (p->faults.half_open) /* a cable that is not plugged in: over when it is again */
		return true;
	if (s->n && now_ns - s->since_ns > RTU_SILENCE_NS)
		s->n = 0;
	s->since_ns = now_ns;
	for (size_t i = 0; i < n; i++) {
		s->bytes[s->n++] = bytes[i];
		const size_t length = rtu_length(s->bytes, s->n);
		if (length > MODBUS_RTU_ADU_MOST) {
			p->n_refused_frames++;
			s->n = 0;
			return true;
		}
		if (!length || s->n < length)
			continue;
		s->n = 0;
		if (!rtu_frame(p, s, line, length, now_ns))
			return false;
	}
	return true;
}

const struct sim_wire_protocol peer_modbus_tcp = { "modbus-tcp", sizeof(struct peer_modbus_session), tcp_take,
	                                           unfinished, FRAME_NS, IDLE_NS, NULL };
const struct sim_wire_protocol peer_modbus_rtu = { "modbus-rtu", sizeof(struct peer_modbus_session), rtu_take,
	                                           unfinished, FRAME_NS, IDLE_NS, NULL };
