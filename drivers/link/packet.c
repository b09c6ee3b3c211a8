#include "drivers/link/packet.h"

#include "hal/bytes.h"

#include <string.h>

#define MAGIC 0x316c6262U /* "bbl1" */
#define JOIN_BYTES (8 + 4 + 32 + 32)
#define WELCOME_BYTES (8 + 2 + 16 + 8 + 8)

size_t link_packet_put(struct bb_seal *seal, const struct link_packet *p, uint8_t out[LINK_PACKET_MAX])
{
	const size_t n = LINK_HEADER_BYTES + p->n_bytes;

	if (p->n_bytes > BB_LINK_MESSAGE_MAX)
		return 0;
	bb_put_le(out, MAGIC, 4);
	bb_put_le(out + 4, (uint64_t)p->kind, 2);
	bb_put_le(out + 6, p->process, 2);
	bb_put_le(out + 8, p->session, 8);
	bb_put_le(out + 16, p->number, 8);
	bb_put_le(out + 24, (uint64_t)p->sent_ns, 8);
	bb_put_le(out + 32, p->from, 2);
	bb_put_le(out + 34, p->to, 2);
	bb_put_le(out + 36, p->n_bytes, 2);
	bb_put_le(out + 38, 0, 2);
	memcpy(out + LINK_HEADER_BYTES, p->bytes, p->n_bytes);
	return bb_seal_make(seal, out, n, out + n) ? n + BB_SEAL_BYTES : 0;
}

/* What is cut was refused before: here it may only be too long. */
static bool well_formed(const uint8_t *bytes, size_t n)
{
	const uint64_t kind = bb_get_le(bytes + 4, 2), n_bytes = bb_get_le(bytes + 36, 2);

	return bb_get_le(bytes, 4) == MAGIC && kind >= LINK_DATA && kind < LINK_KINDS && n_bytes <= BB_LINK_MESSAGE_MAX &&
	       !bb_get_le(bytes + 38, 2) && n <= LINK_HEADER_BYTES + n_bytes + BB_SEAL_BYTES &&
	       (kind == LINK_DATA || !bb_get_le(bytes + 32, 4));
}

enum link_fault link_packet_get(struct bb_seal *seal, const uint8_t *bytes, size_t n, struct link_packet *out)
{
	if (n < LINK_HEADER_BYTES + BB_SEAL_BYTES)
		return LINK_TRUNCATED;
	if (bb_get_le(bytes, 4) == MAGIC && n < LINK_HEADER_BYTES + bb_get_le(bytes + 36, 2) + BB_SEAL_BYTES)
		return LINK_TRUNCATED;
	if (!well_formed(bytes, n))
		return LINK_MALFORMED;
#ifndef BB_FUZZ /* a fuzzer would never guess the mark, and see nothing of what lies behind it */
	if (!bb_seal_holds(seal, bytes, n - BB_SEAL_BYTES, bytes + n - BB_SEAL_BYTES))
		return LINK_FORGED;
#else
	(void)seal;
#endif
	*out = (struct link_packet){ .kind = (enum link_kind)bb_get_le(bytes + 4, 2), .process = (uint16_t)bb_get_le(bytes + 6, 2),
		                     .session = bb_get_le(bytes + 8, 8), .number = bb_get_le(bytes + 16, 8),
		                     .sent_ns = (int64_t)bb_get_le(bytes + 24, 8), .from = (uint16_t)bb_get_le(bytes + 32, 2),
		                     .to = (uint16_t)bb_get_le(bytes + 34, 2), .n_bytes = (uint16_t)bb_get_le(bytes + 36, 2) };
	memcpy(out->bytes, bytes + LINK_HEADER_BYTES, out->n_bytes);
	return LINK_WHOLE;
}

void link_join_put(const struct link_join *j, struct link_packet *p)
{
	bb_put_le(p->bytes, j->nonce, 8);
	bb_put_le(p->bytes + 8, j->pid, 4);
	memcpy(p->bytes + 12, j->version_sha256, 32);
	memcpy(p->bytes + 44, j->config_sha256, 32);
	p->n_bytes = JOIN_BYTES;
}

bool link_join_get(const struct link_packet *p, struct link_join *out)
{
	if (p->n_bytes != JOIN_BYTES)
		return false;
	out->nonce = bb_get_le(p->bytes, 8);
	out->pid = (uint32_t)bb_get_le(p->bytes + 8, 4);
	memcpy(out->version_sha256, p->bytes + 12, 32);
	memcpy(out->config_sha256, p->bytes + 44, 32);
	return true;
}

void link_welcome_put(const struct link_welcome *w, struct link_packet *p)
{
	bb_put_le(p->bytes, w->nonce, 8);
	bb_put_le(p->bytes + 8, w->process, 2);
	memcpy(p->bytes + 10, w->machine, 16);
	bb_put_le(p->bytes + 26, (uint64_t)w->now_ns, 8);
	bb_put_le(p->bytes + 34, (uint64_t)w->zero_ns, 8);
	p->n_bytes = WELCOME_BYTES;
}

bool link_welcome_get(const struct link_packet *p, struct link_welcome *out)
{
	if (p->n_bytes != WELCOME_BYTES)
		return false;
	out->nonce = bb_get_le(p->bytes, 8);
	out->process = (uint16_t)bb_get_le(p->bytes + 8, 2);
	memcpy(out->machine, p->bytes + 10, 16);
	out->now_ns = (int64_t)bb_get_le(p->bytes + 26, 8);
	out->zero_ns = (int64_t)bb_get_le(p->bytes + 34, 8);
	return true;
}
