/*
 * drivers/shutter_can.h: a chain of CANopen shutter controllers as a shutter: "can:can0?node=5". The emitter is node 5,
 * the stages 6, 7, .. in chain order; docs/shutter-od.md has their object dictionary.
 *
 * open() returns at once: a state machine on the clock finds, checks and configures the controllers, gives ids to new
 * ones, and repeats it for each that comes back. What is asked for meanwhile is kept, the newest of each kind. A stage
 * reports the phase it measured; the host time of its edge is the emitter's edge, which is SYNC's receive stamp less
 * what the emitter says the frame took, plus that phase. Everything found wrong has a name below, in last_error and in
 * the log. The thread that opened it reads and runs the clock.
 */
#ifndef BB_DRIVERS_SHUTTER_CAN_H
#define BB_DRIVERS_SHUTTER_CAN_H

#include "hal/bus.h"
#include "hal/shutter_driver.h"

extern const struct bb_shutter_driver bb_shutter_can_driver;

/* On a bus that is open already; it is closed with the handle, or at once when this fails. */
BB_MUST_CHECK enum bb_status bb_shutter_can_open_on(struct bb_can_bus *bus, const struct bb_shutter_config *config,
                                                    const struct bb_open *open, struct bb_shutter **out);

#define BB_SHUTTER_CAN_FAULTS(X)                                                                                     \
	X(BB_CANF_BUS_OFF, "BUS_OFF")       /* C1: the host's controller left the bus */                              \
	X(BB_CANF_BUS_ERROR, "BUS_ERROR")   /* warning or passive */                                                  \
	X(BB_CANF_BABBLE, "BABBLE")         /* C2: an id far above its rate is filtered */                            \
	X(BB_CANF_NODE_LOST, "NODE_LOST")   /* C3: heartbeats missing */                                              \
	X(BB_CANF_TX_DROP, "TX_DROP")       /* C4: the queue to the bus is full */                                    \
	X(BB_CANF_PROTO, "PROTO")           /* C5: wrong length, CRC or field */                                      \
	X(BB_CANF_STALE, "STALE")           /* C5: a phase that was reported before */                                \
	X(BB_CANF_DUP_ID, "DUP_ID")         /* C5: two nodes with one id */                                           \
	X(BB_CANF_SYNC_LATE, "SYNC_LATE")   /* C6: SYNC missing or outside its window */                              \
	X(BB_CANF_IF_DOWN, "IF_DOWN")       /* C6: the interface is down */                                           \
	X(BB_CANF_NODE, "NODE")             /* a controller refuses its configuration or reports an emergency */

enum bb_shutter_can_fault {
#define X(name, text) name,
	BB_SHUTTER_CAN_FAULTS(X)
#undef X
	BB_CANF_COUNT
};
struct bb_shutter_can_alarm {
	const char *name;
	bool active;
	uint64_t count;             /* of single causes: frames, nodes, drops */
	int64_t raised_ns, last_ns, cleared_ns; /* the first and the last cause since; when it was over */
	uint32_t detail;            /* node, id or count of the last cause */
};
struct bb_shutter_can_status {
	enum bb_health health;
	bool ready;                 /* every controller is found and configured */
	bool tx_stopped;
	int restarts;               /* after bus-off, within the last minute */
	uint8_t tx_errors, rx_errors;
	int n_ready;
	double period_ns;           /* of the generator as heard */
	uint64_t syncs, phases, freewheeled;
	int64_t sync_ns;            /* the last edge of the generator, host time */
	uint32_t sync_seq;
};
struct bb_shutter_can_node {
	uint8_t id, state;          /* state: the last heartbeat's */
	bool ready, lost;
	int position;               /* on the line; -1: not known yet */
	uint32_t serial;
	char name[33];
	uint16_t emcy;
	uint64_t phases;
};
struct bb_shutter_can_alarm bb_shutter_can_alarm(const struct bb_shutter *sh, enum bb_shutter_can_fault fault);
struct bb_shutter_can_status bb_shutter_can_status(const struct bb_shutter *sh);
/* Node i of 1 + n_stages; false past the end. */
bool bb_shutter_can_node(const struct bb_shutter *sh, size_t i, struct bb_shutter_can_node *out);

#endif
