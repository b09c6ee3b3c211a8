/*
 * drivers/link/packet.h: what processes of one room say to each other, bytes <-> struct. Pure: no state but the key.
 *
 *   0 magic u32 | 4 kind u16 | 6 process u16 | 8 session u64 | 16 number u64 | 24 sent_ns i64 | 32 from u16 | 34 to u16
 *   36 n_bytes u16 | 38 zero u16 | 40 bytes ... | mark, 16 bytes over all before it (hal/hash.h)
 *
 * Little endian. A packet is refused whole: too short, too long, of another magic or kind, unused bytes not zero, or
 * with a mark that the key did not make. Sessions and numbers (replays) are the business of drivers/link/peers.c.
 */
#ifndef BB_DRIVERS_LINK_PACKET_H
#define BB_DRIVERS_LINK_PACKET_H

#include "hal/hash.h"
#include "hal/link.h"

enum link_kind {
	LINK_DATA = 1,  /* from a node to a node */
	LINK_JOIN,      /* a process asks the head for its place */
	LINK_WELCOME,   /* the head's answer: the session from now on */
	LINK_REFUSED,   /* or why not: one byte, enum link_reason */
	LINK_HELLO,     /* first packet of a session, and a sign of life */
	LINK_BYE,       /* the last one */
	LINK_KINDS
};

enum link_reason { LINK_FINE, LINK_OTHER_VERSION, LINK_OTHER_CONFIG, LINK_NO_PLACE, LINK_REASONS };

#define LINK_HEADER_BYTES 40
#define LINK_PACKET_MAX (LINK_HEADER_BYTES + BB_LINK_MESSAGE_MAX + BB_SEAL_BYTES)

struct link_packet {
	enum link_kind kind;
	uint16_t process;       /* the sender; BB_LINK_ANY in a JOIN that takes any place */
	uint64_t session, number;
	int64_t sent_ns;
	uint16_t from, to;      /* nodes; 0 unless DATA */
	uint16_t n_bytes;
	uint8_t bytes[BB_LINK_MESSAGE_MAX];
};

struct link_join { /* the bytes of a JOIN */
	uint64_t nonce;
	uint32_t pid;
	uint8_t version_sha256[32], config_sha256[32];
};

struct link_welcome { /* the bytes of a WELCOME */
	uint64_t nonce;         /* of the JOIN it answers */
	uint16_t process;       /* the place given */
	uint8_t machine[16];    /* two processes of one machine share its CLOCK_MONOTONIC */
	int64_t now_ns, zero_ns; /* of the head: CLOCK_MONOTONIC now, and where its time 0 lies on it */
};

enum link_fault { LINK_WHOLE, LINK_TRUNCATED, LINK_MALFORMED, LINK_FORGED };

/* Returns how many bytes, at most LINK_PACKET_MAX; 0: too much to carry, or out of memory. */
size_t link_packet_put(struct bb_seal *seal, const struct link_packet *p, uint8_t out[LINK_PACKET_MAX]);
/* out is filled only when the answer is LINK_WHOLE. */
enum link_fault link_packet_get(struct bb_seal *seal, const uint8_t *bytes, size_t n, struct link_packet *out);

void link_join_put(const struct link_join *j, struct link_packet *p);
BB_MUST_CHECK bool link_join_get(const struct link_packet *p, struct link_join *out);
void link_welcome_put(const struct link_welcome *w, struct link_packet *p);
BB_MUST_CHECK bool link_welcome_get(const struct link_packet *p, struct link_welcome *out);

#endif
