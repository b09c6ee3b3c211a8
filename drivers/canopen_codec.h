/*
 * drivers/canopen_codec.h: CANopen frames to and from structs, as a master needs them. Pure: no state, no clock.
 * Readers take any frame and answer BB_ERR_FORMAT for one that is not what its id claims.
 */
#ifndef BB_DRIVERS_CANOPEN_CODEC_H
#define BB_DRIVERS_CANOPEN_CODEC_H

#include "drivers/canopen_wire.h"
#include "hal/bus.h"

enum bb_co_kind {
	BB_CO_OTHER, BB_CO_NMT, BB_CO_SYNC, BB_CO_EMCY, BB_CO_TIME, BB_CO_TPDO1, BB_CO_TPDO2, BB_CO_PDO, BB_CO_SDO_REPLY,
	BB_CO_SDO_REQUEST, BB_CO_HEARTBEAT, BB_CO_LSS_REPLY, BB_CO_LSS_REQUEST,
};
/* By id alone; *node is 0 where the id holds none. */
enum bb_co_kind bb_co_kind(const struct bb_can_frame *f, uint8_t *node);

/* What a master says. */
void bb_co_nmt(struct bb_can_frame *f, uint8_t command, uint8_t node);
void bb_co_heartbeat(struct bb_can_frame *f, uint8_t node, uint8_t state);
void bb_co_sdo_read(struct bb_can_frame *f, uint8_t node, uint16_t index, uint8_t sub);
void bb_co_sdo_read_segment(struct bb_can_frame *f, uint8_t node, bool toggle);
/* Expedited for 1..4 bytes; more announces a segmented download. n is 1..UINT32_MAX. */
void bb_co_sdo_write(struct bb_can_frame *f, uint8_t node, uint16_t index, uint8_t sub, const uint8_t *bytes, size_t n);
/* n is 1..7. */
void bb_co_sdo_write_segment(struct bb_can_frame *f, uint8_t node, bool toggle, const uint8_t *bytes, size_t n,
                             bool last);
void bb_co_sdo_abort(struct bb_can_frame *f, uint8_t node, uint16_t index, uint8_t sub, uint32_t code);
void bb_co_lss(struct bb_can_frame *f, uint8_t command, uint32_t value);
void bb_co_lss_fastscan(struct bb_can_frame *f, uint32_t id, uint8_t bit, uint8_t sub, uint8_t next);

/* What it hears. */
enum bb_co_sdo_kind {
	BB_CO_SDO_DATA,         /* expedited upload: bytes, n */
	BB_CO_SDO_ANNOUNCED,    /* segmented upload begins: size (0: not told) */
	BB_CO_SDO_SEGMENT,      /* bytes, n, toggle, last */
	BB_CO_SDO_WRITTEN,      /* download, or its announcement, is taken */
	BB_CO_SDO_TAKEN,        /* a download's segment is taken: toggle */
	BB_CO_SDO_ABORTED,      /* code */
};
struct bb_co_sdo_reply {
	enum bb_co_sdo_kind kind;
	uint16_t index;
	uint8_t sub;
	bool toggle, last;
	uint8_t n;
	uint8_t bytes[7];
	uint32_t size, code;
};
struct bb_co_emcy {
	uint16_t code;
	uint8_t error_register;
	uint8_t detail[5];
};
struct bb_co_phase { /* TPDO1 of a shutter controller */
	uint8_t counter, flags, sequence;
	uint32_t phase_ns;
};
struct bb_co_follow { /* TPDO2 of the SYNC producer */
	uint8_t counter;
	uint32_t latency_ns;
};
struct bb_co_lss_reply {
	uint8_t command;
	uint8_t error;
	uint32_t value;
};
BB_MUST_CHECK enum bb_status bb_co_read_sync(const struct bb_can_frame *f, uint8_t *counter); /* 0: it has none */
BB_MUST_CHECK enum bb_status bb_co_read_heartbeat(const struct bb_can_frame *f, uint8_t *state);
BB_MUST_CHECK enum bb_status bb_co_read_emcy(const struct bb_can_frame *f, struct bb_co_emcy *out);
BB_MUST_CHECK enum bb_status bb_co_read_sdo(const struct bb_can_frame *f, struct bb_co_sdo_reply *out);
BB_MUST_CHECK enum bb_status bb_co_read_phase(const struct bb_can_frame *f, struct bb_co_phase *out);
BB_MUST_CHECK enum bb_status bb_co_read_follow(const struct bb_can_frame *f, struct bb_co_follow *out);
BB_MUST_CHECK enum bb_status bb_co_read_lss(const struct bb_can_frame *f, struct bb_co_lss_reply *out);

uint32_t bb_co_u32(const uint8_t *bytes, size_t n); /* little endian, n <= 4 */
void bb_co_put_u32(uint8_t *bytes, uint32_t value, size_t n);
/* In words, for messages; never NULL. */
const char *bb_co_abort_text(uint32_t code);

#endif
