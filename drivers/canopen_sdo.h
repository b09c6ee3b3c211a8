/*
 * drivers/canopen_sdo.h: one SDO transfer at a time with one node, expedited or segmented by length. A state machine:
 * the owner hands over replies and the time, and sends what comes out. No allocation; times are host ns.
 */
#ifndef BB_DRIVERS_CANOPEN_SDO_H
#define BB_DRIVERS_CANOPEN_SDO_H

#include "drivers/canopen_codec.h"

#define BB_CO_SDO_MOST 64 /* bytes of a value */

struct bb_co_sdo {
	uint8_t node;
	uint16_t index;
	uint8_t sub;
	bool write, toggle, announced;
	bool has_frame;           /* something to send */
	struct bb_can_frame frame;
	uint8_t bytes[BB_CO_SDO_MOST];
	size_t n, done;           /* of the value; passed so far */
	int tries;
	int64_t wait_ns, deadline_ns;
	enum bb_status status;    /* BB_TIMEOUT: under way; BB_SKIPPED: nothing asked yet */
	uint32_t abort;           /* the node's reason, or ours */
};

void bb_co_sdo_init(struct bb_co_sdo *c, uint8_t node, int64_t wait_ns);
/* Begin; what was under way is forgotten. n is 1..BB_CO_SDO_MOST. */
void bb_co_sdo_start_read(struct bb_co_sdo *c, uint16_t index, uint8_t sub, int64_t now_ns);
void bb_co_sdo_start_write(struct bb_co_sdo *c, uint16_t index, uint8_t sub, const uint8_t *bytes, size_t n,
                           int64_t now_ns);
/* A frame with this node's reply id. BB_ERR_FORMAT: it is none, or nobody asked: often an answer to a question that was
 * repeated. */
enum bb_status bb_co_sdo_receive(struct bb_co_sdo *c, const struct bb_can_frame *f, int64_t now_ns);
/* Repeats a transfer that went unanswered, and gives up after three. */
void bb_co_sdo_poll(struct bb_co_sdo *c, int64_t now_ns);
/* The frame to send, once. */
bool bb_co_sdo_take(struct bb_co_sdo *c, struct bb_can_frame *out);

static inline bool bb_co_sdo_busy(const struct bb_co_sdo *c)
{
	return c->status == BB_TIMEOUT;
}

#endif
