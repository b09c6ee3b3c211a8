/*
 * tests/fuzz/fuzz_link_packet.c: a packet between processes. What is taken is put again and must be the same bytes, but
 * for the mark, which fuzz builds do not ask for.
 */
#include <string.h>

#include "drivers/link/packet.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const uint8_t key[BB_SEAL_KEY_BYTES] = { 1, 2, 3 };
	static struct bb_seal *seal;
	uint8_t again[LINK_PACKET_MAX];
	struct link_packet p, q = { 0 };
	struct link_join join;
	struct link_welcome welcome;

	if (!seal)
		fuzz_must(bb_seal_create(key, &seal));
	if (link_packet_get(seal, data, size, &p) != LINK_WHOLE)
		return 0;
	fuzz_must(p.kind > 0 && p.kind < LINK_KINDS && p.n_bytes <= BB_LINK_MESSAGE_MAX);
	const size_t n = link_packet_put(seal, &p, again);
	fuzz_must(n == size && !memcmp(again, data, n - BB_SEAL_BYTES));
	if (link_join_get(&p, &join)) {
		link_join_put(&join, &q);
		fuzz_must(q.n_bytes == p.n_bytes && !memcmp(q.bytes, p.bytes, p.n_bytes));
	}
	if (link_welcome_get(&p, &welcome)) {
		link_welcome_put(&welcome, &q);
		fuzz_must(q.n_bytes == p.n_bytes && !memcmp(q.bytes, p.bytes, p.n_bytes));
	}
	return 0;
}
