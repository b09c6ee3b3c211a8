/*
 * bench/track_record/import.h: NatNet 3.0 datagrams of somebody else's server, as payloads one after the other in a file,
 * into a recording or, when the name ends in .csv, into a table of poses.
 */
#ifndef BB_BENCH_IMPORT_H
#define BB_BENCH_IMPORT_H

#include "bench/track_record/record.h"

struct bb_import {
	uint64_t datagrams, frames, poses;
	uint64_t untracked, left_out; /* poses that their sender did not vouch for; of bodies beyond BB_BODIES_MAX */
	size_t n_bodies;
	char body[BB_BODIES_MAX][BB_ID_MAX];
	bool truncated;               /* what follows the datagrams read is none: err says where */
};

/* BB_OK: out_path holds what could be read (truncated, with 1767 in err). 1001, 1767 when nothing could, 1901. */
BB_MUST_CHECK enum bb_status bb_import_natnet(const char *path, const char *out_path, struct bb_import *out,
                                              struct bb_error *err);

#endif
