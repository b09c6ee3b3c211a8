/*
 * drivers/can_guard.h: what keeps one bad node from drowning a bus: a token bucket per 11-bit id on the way in, and a
 * short queue on the way out in which a newer state replaces an older one of the same id. No allocation; host ns.
 */
#ifndef BB_DRIVERS_CAN_GUARD_H
#define BB_DRIVERS_CAN_GUARD_H

#include "hal/bus.h"

#define BB_CAN_IDS 2048
#define BB_CAN_QUEUE 64
#define BB_CAN_CALM_NS INT64_C(5000000000) /* a filtered id comes back after that long below its rate */

struct bb_can_guard {
	int64_t load_most_per_s;      /* 30 % of the bus in frames of one id */
	struct {
		uint32_t contract_per_s; /* promised; three times that is babble */
		uint32_t filtered;       /* frames dropped */
		int64_t tokens_ns;       /* time in hand: a frame costs one period of the highest rate */
		int64_t last_ns, excess_ns;
		bool seen, babbles;
	} id[BB_CAN_IDS];
	uint32_t n_babbling;
};

void bb_can_guard_init(struct bb_can_guard *g, int64_t bitrate);
void bb_can_guard_contract(struct bb_can_guard *g, uint32_t id, uint32_t per_s);
enum bb_can_verdict { BB_CAN_PASS, BB_CAN_BABBLE_BEGINS, BB_CAN_FILTERED };
enum bb_can_verdict bb_can_guard_frame(struct bb_can_guard *g, uint32_t id, int64_t at_ns);
/* Ids that have been calm long enough are let in again; how many babble still. */
uint32_t bb_can_guard_poll(struct bb_can_guard *g, int64_t now_ns);

struct bb_can_queue {
	struct bb_can_frame frame[BB_CAN_QUEUE];
	bool state[BB_CAN_QUEUE];
	uint32_t n;
	uint64_t dropped, sent;
};
/* state: a newer frame of the same id takes the place of the older one. false: the queue is full, an event is lost. */
bool bb_can_queue_put(struct bb_can_queue *q, const struct bb_can_frame *frame, bool state);
/* Sends what the bus takes: BB_OK all of it, BB_ERR_BUSY some is left, else the bus's failure. */
enum bb_status bb_can_queue_flush(struct bb_can_queue *q, struct bb_can_bus *bus);

#endif
