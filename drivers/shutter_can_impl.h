/* drivers/shutter_can_impl.h: the inside of struct shutter_can, for drivers/shutter_can*.c only. */
#ifndef BB_DRIVERS_SHUTTER_CAN_IMPL_H
#define BB_DRIVERS_SHUTTER_CAN_IMPL_H

#include "drivers/can_guard.h"
#include "drivers/canopen_lss.h"
#include "drivers/canopen_sdo.h"
#include "drivers/shutter_can.h"

#define SC_NODES (BB_STAGES_MAX + 1)
#define SC_EDGES 1024
#define SC_SYNCS 16
#define SC_PENDING 128
#define SC_MS INT64_C(1000000)
#define SC_GOOD_SYNCS 10 /* in a row, to be in order again */

struct sc_options {
	int64_t node, master, overflow, heartbeat_ms, sdo_ms, lss_ms, pdo_type, watchdog_ms;
	double stamp_error_us;
	bool lss;
};

struct sc_wanted { /* and as written and read back */
	uint32_t delay_ns, duty_ppm, polarity;
};

struct sc_node {
	uint8_t id, state;
	bool heard, ready, lost, failed;
	int position;
	int step;                   /* of the configuration */
	int beats;                  /* heard since it was lost */
	int64_t beat_ns;            /* the last heartbeat */
	int64_t again_ns;           /* when to try again */
	struct bb_co_sdo sdo;
	struct sc_wanted written;
	int parameter;              /* 1 + the one under way, 0: none */
	bool verifying;             /* it is being read back */
	uint32_t asked, serial;
	char name[33];
	uint16_t emcy;
	uint8_t counter, sequence;  /* of its last phase */
	bool counted;
	int repeats;
	int64_t phase_ns;           /* when it came */
	uint64_t phases;
};

struct sc_sync { /* an edge of the generator */
	uint32_t seq;
	int64_t stamp_ns, edge_ns;
	bool valid, exact;
};

struct sc_pending { /* a phase whose edge is not known exactly yet */
	uint32_t seq;
	uint32_t phase_ns;
	uint8_t eye, stage;
};

struct shutter_can {
	struct bb_shutter base;
	struct bb_can_bus *bus;
	struct bb_timer timer;
	struct sc_options opt;
	uint64_t random;
	bool stereo;
	struct bb_can_guard guard;
	struct bb_can_queue tx;
	size_t n_nodes;
	struct sc_node node[SC_NODES];
	struct sc_wanted want[SC_NODES];   /* by position on the line */
	uint8_t node_of[CO_NODE_MOST + 1]; /* 1 + index, 0: not ours */
	struct bb_co_lss_master lss;
	int64_t lss_next_ns;
	int64_t beat_ns, open_ns;
	struct bb_shutter_can_alarm alarm[BB_CANF_COUNT];
	/* sync */
	bool locked;
	struct sc_sync sync[SC_SYNCS];
	uint32_t sync_at;           /* ring position of the newest */
	double period_ns;
	int good, bad;
	int64_t bad_ns;             /* the last one outside the window, to lock again */
	uint32_t bad_counter;
	int64_t heard_ns;           /* last SYNC that counted */
	uint64_t syncs, phases, freewheeled;
	struct sc_pending pending[SC_PENDING];
	size_t n_pending;
	/* edges to be read */
	struct bb_shutter_edge edge[SC_EDGES];
	uint32_t head, n_edges;
	uint64_t dropped;
	/* bus state */
	bool off, quarantined;
	uint8_t tx_errors, rx_errors;
	int tries;                  /* restarts in a row: the back-off's exponent */
	int64_t restart_ns;         /* the next restart, or BB_NEVER */
	int64_t restarts_ns[5];     /* the last five */
	int64_t back_ns;            /* on the bus again since */
	int64_t down_ns;            /* interface down since, or BB_NEVER */
	int64_t busy_ns;            /* the bus takes nothing since, or BB_NEVER */
	enum bb_health health;
};

/* shutter_can.c */
void sc_send(struct shutter_can *s, const struct bb_can_frame *f, bool state);
BB_PRINTF(5, 6)
void sc_raise(struct shutter_can *s, enum bb_shutter_can_fault fault, uint32_t detail, int64_t now_ns, const char *fmt,
              ...);
void sc_clear(struct shutter_can *s, enum bb_shutter_can_fault fault, int64_t now_ns);
/* shutter_can_boot.c: finding and configuring controllers */
void sc_boot_init(struct shutter_can *s);
void sc_boot_poll(struct shutter_can *s, int64_t now_ns);
void sc_boot_restart(struct shutter_can *s, struct sc_node *n, int64_t now_ns);
bool sc_boot_busy(const struct shutter_can *s);
void sc_node_state(struct shutter_can *s, struct sc_node *n, uint8_t state, int64_t now_ns);
bool sc_all_ready(const struct shutter_can *s);
/* shutter_can_sync.c: SYNC and phases to edges */
void sc_sync_frame(struct shutter_can *s, const struct bb_can_frame *f);
void sc_follow_frame(struct shutter_can *s, const struct bb_can_frame *f);
void sc_phase_frame(struct shutter_can *s, struct sc_node *n, const struct bb_can_frame *f);
void sc_sync_poll(struct shutter_can *s, int64_t now_ns);
/* shutter_can_bus.c: error frames, bus-off, a lost interface */
void sc_error_frame(struct shutter_can *s, const struct bb_can_frame *f, int64_t now_ns);
void sc_bus_status(struct shutter_can *s, enum bb_status status, int64_t now_ns);
void sc_bus_poll(struct shutter_can *s, int64_t now_ns);

#endif
