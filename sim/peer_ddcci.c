/* sim/peer_ddcci.c: see sim/peer_ddcci.h. Its encoder and decoder are its own: DDC/CI 1.1, E-DDC 1.2. */
#include "sim/peer_ddcci.h"

#include "drivers/ddcci_wire.h"
#include "sim/edid_model.h"
#include "sim/vcp_model.h"
#include "sim/verb_args.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MS INT64_C(1000000)
#define THINK_NS (30 * MS)
#define SLOW_THINK_NS (65 * MS)
#define BOOT_NS (2 * BB_NS_PER_S)
#define RESTORE_NS BB_NS_PER_S
#define SEGMENT_BYTES 256

struct message {
	uint8_t bytes[3 + DDCCI_MOST_DATA];
	size_t n;
};

struct peer_ddcci {
	struct bb_monitor_config config;
	struct sim_world *world;
	struct sim_rng rng;
	struct peer_quirks quirks;
	struct peer_counts counts;
	bool fault[PEER_FAULT_COUNT];

	const struct sim_edid_model *model;
	struct vcp_state vcp;
	char capabilities[BB_MONITOR_TEXT_MAX];
	size_t capabilities_bytes;

	size_t edid_bytes, edid_at, corrupt_at;
	uint8_t edid_segment;
	uint8_t edid[PEER_EDID_MAX_BYTES];

	bool fed;
	int64_t since_ns;   /* vcp.lit_ns is as of then */
	int64_t ready_ns;   /* Null until then: booting or restoring */
	int64_t quiet_ns;   /* drops messages until then */
	int64_t hush_ns;    /* the standard's wait after a reply: counted, not enforced */
	int64_t request_ns; /* end of the last request */
	struct message reply, stale;
};

/* ---- power ---- */

static bool lit(const struct peer_ddcci *p)
{
	return p->fed && !p->fault[PEER_OFF] && !p->fault[PEER_STANDBY] && p->vcp.power_mode == 1;
}

static void settle(struct peer_ddcci *p, int64_t at_ns)
{
	if (lit(p) && at_ns > p->since_ns)
		p->vcp.lit_ns += at_ns - p->since_ns;
	p->since_ns = at_ns;
}

static void note_power(struct peer_ddcci *p, bool was_lit, int64_t at_ns)
{
	if (!was_lit && lit(p))
		p->ready_ns = at_ns + BOOT_NS;
}

void peer_ddcci_look(struct peer_ddcci *p, int64_t at_ns)
{
	const bool was = lit(p);
	const bool fed = !p->world || !p->config.outlet[0] || sim_world_fed(p->world, p->config.outlet);

	if (fed == p->fed)
		return;
	settle(p, at_ns);
	p->fed = fed;
	if (fed && p->vcp.power_mode != 1) /* mains wakes it from every software sleep */
		p->vcp.power_mode = 1;
	note_power(p, was, at_ns);
}

bool peer_ddcci_on_outlet(const struct peer_ddcci *p)
{
	return p->world && p->config.outlet[0];
}

/* ---- encoder ---- */

static void begin(struct message *m)
{
	m->bytes[0] = DDCCI_TO_DISPLAY;
	m->n = 2;
}

static void put(struct message *m, unsigned int byte)
{
	m->bytes[m->n++] = (uint8_t)byte;
}

static void seal(struct message *m)
{
	uint8_t sum = DDCCI_VIRTUAL_HOST;

	m->bytes[1] = (uint8_t)(DDCCI_LENGTH_FLAG | (m->n - 2));
	for (size_t i = 0; i < m->n; i++)
		sum ^= m->bytes[i];
	put(m, sum);
}

static void make_null(struct message *m)
{
	begin(m);
	seal(m);
}

static void make_value(struct message *m, unsigned int result, uint8_t code, uint16_t most, uint16_t current)
{
	begin(m);
	put(m, DDCCI_GET_REPLY);
	put(m, result);
	put(m, code);
	put(m, 0); /* a set parameter: none of the codes it reads is momentary */
	put(m, most >> 8u);
	put(m, most & 0xFFu);
	put(m, current >> 8u);
	put(m, current & 0xFFu);
	seal(m);
}

static void answer_get(struct peer_ddcci *p, uint8_t code, int64_t at_ns)
{
	uint16_t current, most;

	settle(p, at_ns);
	if (vcp_get(&p->vcp, code, &current, &most) == BB_OK) {
		make_value(&p->reply, DDCCI_RESULT_OK, code, most, current);
	} else if (p->quirks.zero_for_unsupported) {
		memset(p->reply.bytes, 0, sizeof(p->reply.bytes));
		p->reply.n = sizeof(p->reply.bytes);
	} else if (p->quirks.null_for_unsupported) {
		make_null(&p->reply);
	} else {
		make_value(&p->reply, DDCCI_RESULT_UNSUPPORTED, code, 0, 0);
	}
}

/* As logs of real displays show them: no blank after a bracket, a bracket too few, a cut end, a stray byte. */
static const char malformed[] =
	"prot(monitor)type(LCD)model(BAD cmds(01 02 03 0C E3 F3)vcp(02 04 10 12 14( 01 05 0B)16 18 "
	"1A 60(0F 11 12 )AC AE\xFF B6 C0 C6 C8 D6(01 04 05) DF mswhql(1)mccs_ver(2.2";

static void answer_capabilities(struct peer_ddcci *p, size_t offset)
{
	const char *text = p->quirks.malformed_capabilities ? malformed : p->capabilities;
	const size_t all = p->quirks.malformed_capabilities ? sizeof(malformed) - 1 : p->capabilities_bytes;

	begin(&p->reply);
	put(&p->reply, DDCCI_CAPABILITIES_REPLY);
	put(&p->reply, (unsigned int)(offset >> 8 & 0xFF));
	put(&p->reply, (unsigned int)(offset & 0xFF));
	for (size_t i = offset; i < all && i < offset + DDCCI_FRAGMENT_TEXT; i++)
		put(&p->reply, (unsigned char)text[i]);
	seal(&p->reply);
}

/* ---- decoder ---- */

static void apply_set(struct peer_ddcci *p, uint8_t code, uint16_t value, int64_t at_ns)
{
	const bool wake = code == BB_VCP_POWER_MODE && value == 1;
	const bool was = lit(p);

	p->counts.writes++;
	p->quiet_ns = at_ns + DDCCI_WRITE_WAIT_NS;
	if (!was && !wake)
		p->counts.writes_asleep++;
	if (!was && (!wake || p->vcp.power_mode == 5))
		return;
	if (p->fault[PEER_BUSY] || p->fault[PEER_IGNORE_WRITE] || (was && at_ns < p->ready_ns))
		return;
	settle(p, at_ns);
	const enum bb_status status = vcp_set(&p->vcp, code, value);
	note_power(p, was, at_ns);
	if (status == BB_OK && code == BB_VCP_RESTORE_DEFAULTS)
		p->ready_ns = at_ns + RESTORE_NS;
}

static bool drowsy(struct peer_ddcci *p, int64_t at_ns)
{
	return p->fault[PEER_BUSY] || !lit(p) || at_ns < p->ready_ns ||
	       sim_rng_uniform(&p->rng) * 100 < p->quirks.busy_percent;
}

static void obey(struct peer_ddcci *p, const uint8_t *data, size_t n, int64_t at_ns)
{
	p->counts.requests++;
	if (data[0] == DDCCI_SET && n == 4)
		apply_set(p, data[1], (uint16_t)(data[2] << 8 | data[3]), at_ns);
	else if (data[0] == DDCCI_SAVE && n == 1) {
		p->counts.saves++;
		p->quiet_ns = at_ns + DDCCI_SAVE_WAIT_NS;
	} else if (drowsy(p, at_ns))
		return;
	else if (data[0] == DDCCI_GET && n == 2)
		answer_get(p, data[1], at_ns);
	else if (data[0] == DDCCI_CAPABILITIES && n == 3)
		answer_capabilities(p, (size_t)(data[1] << 8 | data[2]));
}

/* Host's source byte, length, data and checksum; the address byte went over the wire before them. */
static bool whole(const uint8_t *b, size_t n)
{
	if (n < 4 || b[0] != DDCCI_HOST || b[1] != (DDCCI_LENGTH_FLAG | (n - 3)))
		return false;
#ifdef BB_FUZZ
	return true;
#else
	uint8_t sum = DDCCI_TO_DISPLAY;

	for (size_t i = 0; i + 1 < n; i++)
		sum ^= b[i];
	return sum == b[n - 1];
#endif
}

static void take_request(struct peer_ddcci *p, const uint8_t *bytes, size_t n, int64_t from_ns, int64_t to_ns)
{
	if (n == 1) /* how programs ask whether anybody is there */
		return;
	if (from_ns < p->quiet_ns) {
		p->counts.too_early++;
		return;
	}
	p->counts.too_early += from_ns < p->hush_ns;
	make_null(&p->reply);
	p->request_ns = to_ns;
	if (whole(bytes, n))
		obey(p, bytes + 2, n - 3, to_ns);
	else
		p->counts.damaged++;
}

/* ---- replies on the wire ---- */

static void spoil(const struct peer_ddcci *p, struct message *m)
{
	if (p->fault[PEER_STALE] && p->stale.n)
		*m = p->stale;
	if (p->fault[PEER_WRONG_OPCODE] && m->n > 3) {
		m->bytes[2] ^= 0x10;
		m->bytes[m->n - 1] ^= 0x10;
	}
	if (p->fault[PEER_BAD_CHECKSUM])
		m->bytes[m->n - 1] ^= 0x55;
	if (p->fault[PEER_ZERO])
		memset(m->bytes, 0, sizeof(m->bytes));
}

static void send_reply(struct peer_ddcci *p, uint8_t *bytes, size_t n, int64_t from_ns)
{
	const int64_t think_ns = p->fault[PEER_SLOW] ? SLOW_THINK_NS : p->quirks.think_ns;
	const bool ready = p->reply.n && from_ns >= p->request_ns + think_ns;
	struct message m = p->reply;
	size_t at = 0;

	if (from_ns < p->request_ns + DDCCI_REPLY_WAIT_NS)
		p->counts.too_early++;
	if (!ready)
		make_null(&m);
	spoil(p, &m);
	if (p->quirks.doubled_source && n && !p->fault[PEER_ZERO])
		bytes[at++] = DDCCI_TO_DISPLAY;
	for (size_t i = 0; at < n; i++) /* after its end nobody pulls the wire down */
		bytes[at++] = i < m.n ? m.bytes[i] : p->fault[PEER_ZERO] ? 0 : 0xFF;
	p->hush_ns = from_ns + DDCCI_WRITE_WAIT_NS;
	if (ready) { /* a reply is sent once */
		p->stale = p->reply;
		make_null(&p->reply);
	}
}

/* ---- the EDID memory ---- */

static void write_memory(struct peer_ddcci *p, const uint8_t *bytes, size_t n)
{
	if (n)
		p->edid_at = bytes[0]; /* what follows would be stored: it is write-protected */
}

static void read_memory(struct peer_ddcci *p, uint8_t *bytes, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		const size_t at = (size_t)p->edid_segment * SEGMENT_BYTES + p->edid_at;
		bytes[i] = at < p->edid_bytes ? p->edid[at] : 0xFF;
		if (p->fault[PEER_CORRUPT_EDID] && at == p->corrupt_at)
			bytes[i] ^= 0x5A;
		p->edid_at = (p->edid_at + 1) % SEGMENT_BYTES;
	}
}

/* ---- the wire ---- */

static enum peer_wire heard(struct peer_ddcci *p, uint16_t address, int64_t at_ns)
{
	peer_ddcci_look(p, at_ns);
	if (p->fault[PEER_STUCK])
		return PEER_HELD;
	if (!p->fed || p->fault[PEER_UNPLUG])
		return PEER_NO_ACK;
	if (address == EDID_ADDRESS)
		return PEER_ACK;
	if (address == EDID_SEGMENT_ADDRESS)
		return p->edid_bytes > SEGMENT_BYTES ? PEER_ACK : PEER_NO_ACK;
	if (address != DDCCI_ADDRESS || p->fault[PEER_SILENT] || (p->quirks.no_ack_asleep && !lit(p)))
		return PEER_NO_ACK;
	return p->fault[PEER_BUS_ERROR] ? PEER_ERROR : PEER_ACK;
}

enum peer_wire peer_ddcci_write(struct peer_ddcci *p, uint16_t address, const uint8_t *bytes, size_t n, int64_t from_ns,
				int64_t to_ns)
{
	const enum peer_wire wire = heard(p, address, from_ns);

	if (wire != PEER_ACK || !n)
		return wire;
	if (address == DDCCI_ADDRESS)
		take_request(p, bytes, n, from_ns, to_ns);
	else if (address == EDID_ADDRESS)
		write_memory(p, bytes, n);
	else
		p->edid_segment = bytes[0];
	return wire;
}

enum peer_wire peer_ddcci_read(struct peer_ddcci *p, uint16_t address, uint8_t *bytes, size_t n, int64_t from_ns)
{
	const enum peer_wire wire = heard(p, address, from_ns);

	if (wire != PEER_ACK)
		return wire;
	if (address == DDCCI_ADDRESS)
		send_reply(p, bytes, n, from_ns);
	else if (address == EDID_ADDRESS)
		read_memory(p, bytes, n);
	else
		return PEER_NO_ACK; /* the segment pointer cannot be read */
	return wire;
}

void peer_ddcci_stop(struct peer_ddcci *p)
{
	p->edid_segment = 0;
}

/* ---- life ---- */

static enum bb_status make_edid(struct peer_ddcci *p, struct bb_cvt *timing)
{
	const struct bb_monitor_config *c = &p->config;
	struct sim_rng rng;

	p->model = sim_edid_model(c->edid);
	sim_rng_seed(&rng, 0, "edid", c->id); /* a serial belongs to the thing, not to the run */
	struct sim_edid_spec spec = { .model = p->model,
				      .width_px = p->model->width_px,
				      .height_px = p->model->height_px,
				      .rate = { (uint32_t)p->model->rate_hz, 1 },
				      .serial = (uint32_t)(sim_rng_u64(&rng) % 10000000) };
	if (c->width_px > 0 && c->width_px < 65536)
		spec.width_px = (int)c->width_px;
	if (c->height_px > 0 && c->height_px < 65536)
		spec.height_px = (int)c->height_px;
	if (c->rate.num && c->rate.den)
		spec.rate = c->rate;
	p->corrupt_at = 8 + sim_rng_u64(&rng) % 100;
	const enum bb_status status = sim_edid_make(&spec, p->edid, &p->edid_bytes);
	if (status != BB_OK)
		return status;
	return bb_cvt_rb(spec.width_px, spec.height_px, spec.rate, timing);
}

enum bb_status peer_ddcci_create(const struct bb_monitor_config *config, struct sim_world *world, uint64_t seed,
				 int64_t now_ns, struct peer_ddcci **out)
{
	struct peer_ddcci *p = calloc(1, sizeof(*p));
	struct bb_cvt timing;

	*out = NULL;
	if (!p)
		return BB_ERR_NOMEM;
	p->config = *config;
	p->world = world;
	p->quirks.think_ns = THINK_NS;
	p->since_ns = p->ready_ns = now_ns;
	p->request_ns = p->quiet_ns = p->hush_ns = now_ns - DDCCI_WRITE_WAIT_NS;
	sim_rng_seed(&p->rng, seed, "monitor", config->id);
	if (make_edid(p, &timing) != BB_OK) {
		free(p);
		return BB_ERR_CONFIG;
	}
	const uint16_t input = config->input > 0 && config->input < 256 ? (uint16_t)config->input : VCP_INPUT_DP1;
	vcp_init(&p->vcp, input, bb_cvt_line_hz(&timing), bb_cvt_rate_hz(&timing),
		 500 + (uint32_t)(sim_rng_u64(&p->rng) % 15000));
	p->capabilities_bytes = vcp_text(p->model->shown, p->capabilities, sizeof(p->capabilities));
	p->fed = !peer_ddcci_on_outlet(p) || sim_world_fed(world, config->outlet);
	enum bb_status status = world ? sim_world_register(world, "monitor", config->id, p, peer_ddcci_verbs) : BB_OK;
	if (status == BB_OK && world)
		status = sim_world_register(world, "ddc", config->id, p, peer_ddcci_wire_verbs);
	if (status != BB_OK) {
		peer_ddcci_destroy(p);
		return status;
	}
	*out = p;
	return BB_OK;
}

void peer_ddcci_destroy(struct peer_ddcci *p)
{
	if (!p)
		return;
	for (int twice = 0; p->world && twice < 2; twice++)
		sim_world_unregister(p->world, p);
	free(p);
}

struct peer_quirks *peer_ddcci_quirks(struct peer_ddcci *p)
{
	return &p->quirks;
}

const struct peer_counts *peer_ddcci_counts(const struct peer_ddcci *p)
{
	return &p->counts;
}

void peer_ddcci_fault(struct peer_ddcci *p, enum peer_fault fault, bool on, int64_t at_ns)
{
	const bool was = lit(p);

	settle(p, at_ns);
	p->fault[fault] = on;
	note_power(p, was, at_ns);
}

enum bb_status peer_ddcci_set_edid(struct peer_ddcci *p, const uint8_t *bytes, size_t n)
{
	if (!n || n > sizeof(p->edid))
		return BB_ERR_RANGE;
	memcpy(p->edid, bytes, n);
	p->edid_bytes = n;
	return BB_OK;
}

double peer_ddcci_luminance(struct peer_ddcci *p, int64_t at_ns)
{
	peer_ddcci_look(p, at_ns);
	return lit(p) ? p->model->peak_cd_m2 * vcp_light(&p->vcp) : 0;
}

bool peer_ddcci_value(struct peer_ddcci *p, uint8_t code, uint16_t *out)
{
	uint16_t most;

	return vcp_get(&p->vcp, code, out, &most) == BB_OK;
}

/* ---- verbs ---- */

static int64_t now_of(const struct peer_ddcci *p)
{
	return bb_clock_now_ns(sim_world_clock(p->world));
}

static enum bb_status toggle(void *device, const struct sim_fault_args *args, enum peer_fault fault, bool on,
			     struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		peer_ddcci_fault(device, fault, on, now_of(device));
	return status;
}

#define TOGGLE(name, fault)                                                                                        \
	static enum bb_status name(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err) \
	{                                                                                                          \
		return toggle(device, args, fault, on, err);                                                       \
	}
TOGGLE(verb_off, PEER_OFF)
TOGGLE(verb_standby, PEER_STANDBY)
TOGGLE(verb_silent, PEER_SILENT)
TOGGLE(verb_busy, PEER_BUSY)
TOGGLE(verb_unplug, PEER_UNPLUG)
TOGGLE(verb_corrupt_edid, PEER_CORRUPT_EDID)
TOGGLE(verb_bus_error, PEER_BUS_ERROR)
TOGGLE(verb_stuck, PEER_STUCK)
TOGGLE(verb_bad_checksum, PEER_BAD_CHECKSUM)
TOGGLE(verb_wrong_opcode, PEER_WRONG_OPCODE)
TOGGLE(verb_stale, PEER_STALE)
TOGGLE(verb_zero, PEER_ZERO)
TOGGLE(verb_slow, PEER_SLOW)
TOGGLE(verb_ignore_write, PEER_IGNORE_WRITE)

static enum bb_status verb_input(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return vcp_fault_input(device ? &((struct peer_ddcci *)device)->vcp : NULL, args, on, err);
}

static enum bb_status verb_drift(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return vcp_fault_drift(device ? &((struct peer_ddcci *)device)->vcp : NULL, args, on, err);
}

static enum bb_status quirk(void *device, const struct sim_fault_args *args, size_t offset, bool on,
			    struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		memcpy((char *)&((struct peer_ddcci *)device)->quirks + offset, &on, sizeof(on));
	return status;
}

#define QUIRK(name)                                                                                 \
	static enum bb_status verb_##name(void *device, const struct sim_fault_args *args, bool on, \
					  struct bb_error *err)                                     \
	{                                                                                           \
		return quirk(device, args, offsetof(struct peer_quirks, name), on, err);            \
	}
QUIRK(doubled_source)
QUIRK(null_for_unsupported)
QUIRK(zero_for_unsupported)
QUIRK(malformed_capabilities)
QUIRK(no_ack_asleep)

/* The monitor as a thing: as sim_monitor_verbs. */
const struct sim_verb peer_ddcci_verbs[] = {
	{ "input", "[value=CODE]", "someone pressed the button: it shows that input (VCP 60) instead of its own",
	  "value=0x11", verb_input },
	{ "off", "", "someone switched it off: dark, answers EDID but no VCP", "", verb_off },
	{ "standby", "", "it fell asleep: dark, answers EDID but no VCP", "", verb_standby },
	{ "silent", "", "its DDC controller hangs: no acknowledge; EDID still answers", "", verb_silent },
	{ "busy", "", "it answers every VCP request with Null", "", verb_busy },
	{ "drift", "[luminance=N]", "its brightness (VCP 10) moved, to 20 unless told", "luminance=35", verb_drift },
	{ "unplug", "", "its cable is out: nothing answers", "", verb_unplug },
	{ "corrupt_edid", "", "one byte of its EDID reads wrong", "", verb_corrupt_edid },
	{ "ignore_write", "", "it acknowledges a write and does not apply it", "", verb_ignore_write },
	{ NULL, NULL, NULL, NULL, NULL },
};

/* Its wires and its ways with them. */
const struct sim_verb peer_ddcci_wire_verbs[] = {
	{ "bus_error", "", "messages to its DDC controller end in a bus error", "", verb_bus_error },
	{ "stuck", "", "it holds SDA low: nothing on its bus gets through", "", verb_stuck },
	{ "bad_checksum", "", "its replies have a wrong checksum", "", verb_bad_checksum },
	{ "wrong_opcode", "", "its replies have a wrong opcode", "", verb_wrong_opcode },
	{ "stale", "", "it answers the question before the last", "", verb_stale },
	{ "zero", "", "its replies read as zeros", "", verb_zero },
	{ "slow", "", "its replies are ready after 65 ms instead of 40", "", verb_slow },
	{ "doubled_source", "", "its replies begin with their first byte twice", "", verb_doubled_source },
	{ "null_for_unsupported", "", "it says Null to a code it does not have, not \"unsupported\"", "",
	  verb_null_for_unsupported },
	{ "zero_for_unsupported", "", "it says zeros to a code it does not have", "", verb_zero_for_unsupported },
	{ "malformed_capabilities", "", "its capabilities string is damaged as some real ones are", "",
	  verb_malformed_capabilities },
	{ "no_ack_asleep", "", "asleep its DDC controller does not even acknowledge", "", verb_no_ack_asleep },
	{ NULL, NULL, NULL, NULL, NULL },
};
