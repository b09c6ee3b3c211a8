/*
 * sim/peer_ddcci.h: the far end of a monitor's DDC wires, byte by byte: a DDC/CI controller at 0x37 with its own
 * encoder and decoder, an EDID memory at 0x50 with the segment pointer at 0x30, power states, and the ways real
 * displays err. What the monitor knows comes from vcp_model and edid_model. Passive: a bus (sim/bus_sim_i2c.h, or an
 * adapter behind USB) calls it with the times a message began and ended on the wire. One thread; ns.
 *
 * Asleep it acknowledges and answers Null (option: not at all); a Set of D6 = 1 wakes it. Without mains or cable
 * nothing acknowledges. It keeps to the standard from its side: a reply read before it is ready is Null, a message
 * inside the wait after another is dropped and counted.
 */
#ifndef BB_SIM_PEER_DDCCI_H
#define BB_SIM_PEER_DDCCI_H

#include "hal/monitor.h"
#include "sim/faults.h"

#define PEER_EDID_MAX_BYTES 1024

struct peer_quirks {               /* may be changed at any time */
	bool doubled_source;       /* sends its address byte twice */
	bool null_for_unsupported; /* instead of the "unsupported" flag */
	bool zero_for_unsupported;
	bool malformed_capabilities;
	bool no_ack_asleep;  /* its controller sleeps as well */
	int64_t think_ns;    /* until a reply is ready; 30 ms */
	double busy_percent; /* of the requests meet a Null */
};

enum peer_fault {               /* what test and verb tables switch */
		  PEER_OFF,     /* by its button: dark, Null */
		  PEER_STANDBY, /* fell asleep: dark, Null */
		  PEER_SILENT,  /* the DDC controller hangs: no acknowledge at 0x37 */
		  PEER_BUSY,    /* Null to everything */
		  PEER_UNPLUG,
		  PEER_CORRUPT_EDID, /* one byte reads wrong */
		  PEER_BUS_ERROR,    /* messages to 0x37 end in a bus error */
		  PEER_STUCK,        /* SDA held low: no message gets through */
		  PEER_BAD_CHECKSUM,
		  PEER_WRONG_OPCODE,
		  PEER_STALE,        /* answers the question before the last */
		  PEER_ZERO,         /* replies read as zeros */
		  PEER_SLOW,         /* replies are ready after 65 ms */
		  PEER_IGNORE_WRITE, /* acknowledges a Set and does not apply it */
		  PEER_FAULT_COUNT
};

struct peer_counts {
	uint64_t requests, writes, saves;
	uint64_t writes_asleep; /* Sets that reached it dark, other than the one that wakes it */
	uint64_t too_early;     /* messages inside the wait after a Set (dropped) or a reply; replies read before 40 ms */
	uint64_t damaged;       /* requests it could not read */
};

struct peer_ddcci;

/* config is copied. world may be NULL: always fed, faults by peer_ddcci_fault only; else it registers there as
 * "monitor/ID" and "ddc/ID", and the world outlives it. BB_ERR_CONFIG when the mode fits no EDID. */
BB_MUST_CHECK enum bb_status peer_ddcci_create(const struct bb_monitor_config *config, struct sim_world *world,
					       uint64_t seed, int64_t now_ns, struct peer_ddcci **out);
void peer_ddcci_destroy(struct peer_ddcci *p);

enum peer_wire { PEER_ACK, PEER_NO_ACK, PEER_ERROR, PEER_HELD };
/* One message of a transfer; the transfer ends with a stop. Nothing is read unless PEER_ACK is answered. */
enum peer_wire peer_ddcci_write(struct peer_ddcci *p, uint16_t address, const uint8_t *bytes, size_t n, int64_t from_ns,
				int64_t to_ns);
enum peer_wire peer_ddcci_read(struct peer_ddcci *p, uint16_t address, uint8_t *bytes, size_t n, int64_t from_ns);
void peer_ddcci_stop(struct peer_ddcci *p);

/* Mains and time passing: called before every message; a bus whose monitor hangs on an outlet calls it besides. */
void peer_ddcci_look(struct peer_ddcci *p, int64_t at_ns);
bool peer_ddcci_on_outlet(const struct peer_ddcci *p);

/* The world's side. */
struct peer_quirks *peer_ddcci_quirks(struct peer_ddcci *p);
const struct peer_counts *peer_ddcci_counts(const struct peer_ddcci *p);
void peer_ddcci_fault(struct peer_ddcci *p, enum peer_fault fault, bool on, int64_t at_ns);
BB_MUST_CHECK enum bb_status peer_ddcci_set_edid(struct peer_ddcci *p, const uint8_t *bytes, size_t n);
double peer_ddcci_luminance(struct peer_ddcci *p, int64_t at_ns);         /* cd/m2 of white; a warm lamp */
bool peer_ddcci_value(struct peer_ddcci *p, uint8_t code, uint16_t *out); /* what is really set */
extern const struct sim_verb peer_ddcci_verbs[];
extern const struct sim_verb peer_ddcci_wire_verbs[];

#endif
