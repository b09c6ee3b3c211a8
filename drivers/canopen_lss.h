/*
 * drivers/canopen_lss.h: gives node ids to new, identical controllers: LSS fastscan finds them one by one by their
 * 128-bit identity (CiA 305), then each gets an id and stores it. A state machine like drivers/canopen_sdo.h. The bit
 * rate is never touched: changing it can strand the chain.
 */
#ifndef BB_DRIVERS_CANOPEN_LSS_H
#define BB_DRIVERS_CANOPEN_LSS_H

#include "drivers/canopen_codec.h"

enum bb_co_lss_state {
	BB_CO_LSS_IDLE, BB_CO_LSS_ANYONE, BB_CO_LSS_BIT, BB_CO_LSS_CONFIRM, BB_CO_LSS_ASSIGN, BB_CO_LSS_STORE,
	BB_CO_LSS_LEAVE,
};
struct bb_co_lss_master {
	enum bb_co_lss_state state;
	uint32_t id[4];           /* vendor, product, revision, serial: as far as known */
	uint8_t sub, bit, node;
	bool heard, has_frame;
	struct bb_can_frame frame;
	int64_t wait_ns, deadline_ns;
	enum bb_status status;    /* BB_TIMEOUT: under way; BB_OK: one node got its id; BB_SKIPPED: nobody was there */
};

void bb_co_lss_init(struct bb_co_lss_master *m, int64_t wait_ns);
/* Find one controller without an id and make it `node`. */
void bb_co_lss_start(struct bb_co_lss_master *m, uint8_t node, int64_t now_ns);
void bb_co_lss_receive(struct bb_co_lss_master *m, const struct bb_can_frame *f, int64_t now_ns);
void bb_co_lss_poll(struct bb_co_lss_master *m, int64_t now_ns);
bool bb_co_lss_take(struct bb_co_lss_master *m, struct bb_can_frame *out);

#endif
