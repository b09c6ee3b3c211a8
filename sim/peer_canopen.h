/*
 * sim/peer_canopen.h: a CANopen slave on a simulated medium: NMT, heartbeat both ways, SYNC, two TPDOs, EMCY, an SDO
 * server and an LSS slave. It speaks its own bytes: nothing of drivers/canopen_*.c is in here. What the node is for is
 * its owner's: objects and hooks. Times are clock ns; one thread.
 */
#ifndef BB_SIM_PEER_CANOPEN_H
#define BB_SIM_PEER_CANOPEN_H

#include "drivers/canopen_wire.h"
#include "sim/bus_sim_can.h"

enum sim_co_access { SIM_CO_RO = 1, SIM_CO_WO = 2, SIM_CO_RW = 3 };
struct sim_co_object {
	uint16_t index;
	uint8_t sub;
	uint8_t access;
	uint8_t width;           /* bytes of a number: 1, 2 or 4; 0: bytes */
	uint32_t least, most;    /* of a number */
	uint32_t *value;         /* a number */
	uint8_t *bytes;          /* else */
	uint16_t cap, *n;
};

struct sim_co_node;
struct sim_co_hooks { /* every one may be NULL; ctx is the node's */
	uint32_t (*check)(struct sim_co_node *n, const struct sim_co_object *o, uint32_t value); /* 0 or an abort code */
	void (*wrote)(struct sim_co_node *n, const struct sim_co_object *o);
	void (*reading)(struct sim_co_node *n, const struct sim_co_object *o);
	void (*state)(struct sim_co_node *n, uint8_t state, int64_t at_ns);
	void (*sync)(struct sim_co_node *n, uint8_t counter, int64_t at_ns);      /* heard, or sent by itself */
	size_t (*fill)(struct sim_co_node *n, unsigned pdo, uint8_t bytes[8]);    /* a TPDO is about to go */
};

struct sim_co_pdo {
	uint32_t cob, type, inhibit;    /* 1800h:01 .. :03; inhibit in 100 us */
	uint32_t heard;                 /* SYNCs since it was sent */
	int64_t sent_ns;
	bool wanted;                    /* an event waits for the inhibit time */
};

#define SIM_CO_COMM_OBJECTS 28
struct sim_co_node {
	struct sim_can_port port;
	struct bb_clock *clk;
	struct bb_timer timer;
	const struct sim_co_hooks *hooks;
	void *ctx;
	uint8_t id, stored_id, pending_id;      /* CO_NODE_NONE: none */
	uint8_t state;
	bool dead;                              /* without power */
	int64_t no_heartbeat, stale;            /* faults */
	uint32_t identity[4], type;
	char name[48];
	uint16_t name_bytes;
	uint32_t error_register, history[4], n_history, sync_cob, sync_period, emcy_cob, consumer, producer, overflow;
	uint32_t n_subs[4];
	struct sim_co_pdo pdo[2];
	int64_t beat_ns, master_ns;             /* next own heartbeat; the master's is late at that time */
	bool master_lost, sync_length_wrong;
	uint8_t counter;                        /* of the last SYNC */
	struct sim_co_object comm[SIM_CO_COMM_OBJECTS];
	size_t n_comm;
	const struct sim_co_object *app;
	size_t n_app;
	struct { /* SDO server */
		const struct sim_co_object *object;
		bool writing, toggle;
		uint32_t n, done;
		uint8_t bytes[64];
		uint16_t index;
		uint8_t sub;
	} sdo;
	struct { /* LSS slave */
		bool configuring;
		uint8_t position, selected;
	} lss;
};

/* The fields identity, type, name, stored_id and hooks, ctx, app, n_app are set by the owner before. */
BB_MUST_CHECK enum bb_status sim_co_start(struct sim_co_node *n, struct sim_can *can, struct bb_clock *clk);
void sim_co_end(struct sim_co_node *n);
/* Power off; on again: as from the factory, with what was stored. */
void sim_co_power(struct sim_co_node *n, bool on);
/* An event of TPDO 1 or 2 (pdo 0, 1): sent now if it is enabled, of type 254 or 255, and the node is operational. */
void sim_co_event(struct sim_co_node *n, unsigned pdo);
/* As producer: counts and sends SYNC. */
void sim_co_send_sync(struct sim_co_node *n, int64_t at_ns);
void sim_co_emcy(struct sim_co_node *n, uint16_t code, uint8_t error_register);

/* Inside: sim/peer_canopen*.c only. */
void sim_co_send(struct sim_co_node *n, uint32_t id, const uint8_t *bytes, size_t n_bytes);
void sim_co_sdo_frame(struct sim_co_node *n, const struct bb_can_frame *f);
void sim_co_lss_frame(struct sim_co_node *n, const struct bb_can_frame *f);
void sim_co_reset(struct sim_co_node *n, int64_t at_ns);
void sim_co_rearm(struct sim_co_node *n);

#endif
