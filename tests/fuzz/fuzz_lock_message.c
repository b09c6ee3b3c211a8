/*
 * tests/fuzz/fuzz_lock_message.c: what a node of a framelock hears. What is taken is written again and must be the same
 * bytes: nothing in them may go unread.
 */
#include "sync/framelock/message.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	uint8_t again[BB_LOCK_MESSAGE_MAX];
	struct bb_lock_message m;

	if (!bb_lock_read(fuzz_exact(data, size), size, &m))
		return 0;
	fuzz_must(size <= sizeof(again) && m.master < m.n_nodes && m.n_nodes <= BB_LOCK_NODES_MAX);
	fuzz_must(bb_lock_write(&m, again) == size && !memcmp(again, data, size));
	if (m.kind == BB_LOCK_EPOCH)
		fuzz_must(bb_lock_set_has(&m.u.epoch.members, m.master) && bb_lock_set_count(&m.u.epoch.members) <= m.n_nodes);
	return 0;
}
