/*
 * sim/peer_shutter.h: a chain of shutter controllers at the far end of a CAN: n stages and the emitter, each a CANopen
 * slave with the object dictionary of docs/shutter-od.md, wired to the world's sync generator.
 *
 * Model. The sync line runs through the emitter (position 0, no delay) and on through the stages, each stage_delay_us
 * later; a controller knows its delay and counts time from the generator's edge. The emitter makes SYNC from each edge,
 * its counter n % overflow + 1, and says in TPDO2 how long the frame took. A controller switches `delay` after an edge,
 * plus its unit's small error, when it is operational, armed and knows the eye from a counter; it then says in TPDO1
 * what it measured, in ticks of 100 ns. Without edges for its watchdog time, or when not operational, both eyes see.
 * Jitter and unit errors are drawn as in sim/sim_shutter.c: the same seed makes the same chain. One thread.
 */
#ifndef BB_SIM_PEER_SHUTTER_H
#define BB_SIM_PEER_SHUTTER_H

#include "hal/shutter.h"
#include "sim/faults.h"
#include "sim/peer_canopen.h"

struct sim_world;
struct sim_chain;

struct sim_chain_config {
	const struct bb_shutter_config *chain; /* borrowed */
	uint8_t node;          /* of the emitter; stage i is node + 1 + i. CO_NODE_NONE: all are new and have no id */
	uint32_t duty_ppm, watchdog_ms;
	int fidelity;          /* 0: no jitter, no unit errors */
	uint64_t seed;
};
BB_MUST_CHECK enum bb_status sim_chain_create(const struct sim_chain_config *config, struct sim_can *can,
                                              struct sim_world *world, struct bb_eventlog *events,
                                              struct sim_chain **out);
void sim_chain_destroy(struct sim_chain *c);

/* Position 0 is the emitter, 1 .. n_stages the stages in chain order. */
struct sim_co_node *sim_chain_node(struct sim_chain *c, size_t position);
size_t sim_chain_positions(const struct sim_chain *c);
const char *sim_chain_stage(const struct sim_chain *c, size_t position); /* "emitter", or the stage's id */
bool sim_chain_is_open(const struct sim_chain *c, size_t position); /* both eyes see */
const char *sim_chain_label(const struct sim_chain *c, size_t position);
/* The last switch of a position: when, truly; -1 before the first. */
int64_t sim_chain_switched_ns(const struct sim_chain *c, size_t position);
enum bb_eye sim_chain_eye(const struct sim_chain *c, size_t position); /* that sees since then; none: both */

/* Faults: on counts up, off counts down. */
void sim_chain_stuck(struct sim_chain *c, size_t position, bool on);   /* its sync line stops */
void sim_chain_late_sync(struct sim_chain *c, int64_t by_ns);          /* SYNC goes out that much late; 0: over */
void sim_chain_drop_sync(struct sim_chain *c, int n);                  /* the next n are not sent */
void sim_chain_freeze(struct sim_chain *c, size_t position, bool on);  /* TPDO1 keeps its old counter */
void sim_chain_power(struct sim_chain *c, size_t position, bool on);
void sim_chain_miss(struct sim_chain *c, size_t position, int64_t n);  /* so many more edges are missed; < 0: fewer */
void sim_chain_flip(struct sim_chain *c, size_t position, bool on);    /* its eyes are swapped */
void sim_chain_offset(struct sim_chain *c, size_t position, int64_t by_ns); /* it switches that much later */
/* The same as fault verbs, the device a struct sim_chain: class "can" is the wire and the controllers on it, and
 * "shutter" what sim/sim_shutter.c has a word for. */
extern const struct sim_verb sim_chain_can_verbs[], sim_chain_shutter_verbs[];

#endif
