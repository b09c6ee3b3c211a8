/*
 * sim/peer_modbus.h: a power strip at the far end of a Modbus wire: relays that take a moment, a meter, the register map
 * of drivers/modbus_wire.h, and every way in which such strips misbehave. Bytes in, bytes out: it owns no socket and
 * no thread, and its state is a function of the times it is given (ns of any one clock). Answers are its own code,
 * nothing is shared with the driver but numbers.
 */
#ifndef BB_SIM_PEER_MODBUS_H
#define BB_SIM_PEER_MODBUS_H

#include "drivers/modbus_wire.h"
#include "hal/power.h"
#include "sim/faults.h"
#include "sim/wire.h"

enum peer_modbus_stick { PEER_MODBUS_FREE, PEER_MODBUS_STUCK_OPEN, PEER_MODBUS_STUCK_CLOSED };

struct peer_modbus_outlet {
	bool present;            /* a strip may have fewer names than sockets: those without one still switch */
	bool coil, before;       /* before: the contact until the relay has settled */
	int64_t changed_ns;
	enum peer_modbus_stick stick;
	double load_a, inrush_a, inrush_ms;
	double current_a;        /* < 0: load_a */
};

struct peer_modbus_faults {      /* set by whoever plays the world; zero is a healthy strip */
	bool silent;             /* hears, does nothing, answers nothing */
	bool half_open;          /* connections made before or during it stay dead for ever */
	bool foreign;            /* another device's identity registers */
	bool deaf_to_writes;     /* acknowledges, does not switch */
	bool garbage;            /* bytes after the reply */
	uint8_t exception;       /* answers everything with this code */
	int64_t late_ns;         /* every answer this much later */
	int64_t late_left;       /* > 0: only that many answers */
	int64_t dribble_ns;      /* one byte at a time, this far apart */
	int64_t length_lie;      /* added to the MBAP length field */
};

struct peer_modbus {
	char id[BB_ID_MAX];
	uint8_t unit;
	int64_t relay_ns;
	size_t n_outlets;        /* sockets of the strip: the highest number in use */
	struct peer_modbus_outlet outlet[BB_OUTLETS_MAX]; /* [number - 1] */
	struct peer_modbus_faults faults;
	uint64_t n_requests, n_writes, n_exceptions, n_refused_frames; /* what came in, for tests and `serve` */
};

/* All outlets on, settled long ago. */
void peer_modbus_init(struct peer_modbus *p, const struct bb_power_config *config, uint8_t unit, int64_t now_ns);
/* One request PDU to one reply PDU (at most MODBUS_PDU_MOST bytes into out); 0: no answer. n may be anything. */
size_t peer_modbus_pdu(struct peer_modbus *p, const uint8_t *pdu, size_t n, uint8_t *out, int64_t now_ns);
bool peer_modbus_contact(const struct peer_modbus *p, size_t outlet, int64_t now_ns);
double peer_modbus_current_a(const struct peer_modbus *p, size_t outlet, int64_t now_ns);
void peer_modbus_switch(struct peer_modbus *p, size_t outlet, bool on, int64_t now_ns);
uint16_t peer_modbus_crc(const uint8_t *bytes, size_t n);

/* The two framings as protocols of sim/wire.h; the peer given there is a struct peer_modbus. */
extern const struct sim_wire_protocol peer_modbus_tcp, peer_modbus_rtu;
struct peer_modbus_session { /* one connection's unfinished frame */
	uint8_t bytes[MODBUS_TCP_ADU_MOST];
	size_t n;
	int64_t since_ns;        /* of its first byte */
	bool dead;
};

/* Fault verbs of class "modbus" and, under the names of sim_power's verbs, of class "power". A verb applied to a peer
 * needs its clock: the registered device is a struct peer_modbus_handle. */
struct peer_modbus_handle {
	struct peer_modbus *peer;
	struct bb_clock *clk;
};
extern const struct sim_verb peer_modbus_verbs[], peer_modbus_power_verbs[];

#endif
