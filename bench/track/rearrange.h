/*
 * bench/track/rearrange.h: a room's cameras hung anew: rails from a file, tries of sync/coverage/place.h on all
 * processors, the result as a room file. Metres.
 */
#ifndef BB_BENCH_TRACK_REARRANGE_H
#define BB_BENCH_TRACK_REARRANGE_H

#include "bench/track/cover.h"
#include "sync/coverage/place.h"

struct bb_rails {
	struct bb_rail rail[BB_RAILS_MAX];
	size_t n;
};
/* Lines of "x y z x y z", metres, # begins a comment. 1756. */
BB_MUST_CHECK enum bb_status bb_rails_load(const char *path, struct bb_rails *out, struct bb_error *err);

/* The best of `tries` tries; the first that is as good wins, whatever the number of threads. 1757 when nothing can be
 * sought. */
BB_MUST_CHECK enum bb_status bb_rearrange(const struct bb_place_config *config, unsigned tries, unsigned threads,
					  struct bb_placed *out, struct bb_error *err);

/* The `cameras:` of a room file, new; ids as in cameras. */
void bb_rearranged_print(const struct bb_camera_config *cameras, size_t n, FILE *f);
/* The room's file with that instead of its own. Loaded again before it takes its name: 1758 when a camera would then
 * not be what it was, poses aside (a key of its own in the old block). */
BB_MUST_CHECK enum bb_status bb_rearranged_write(const struct bb_room *room, const struct bb_camera_config *cameras,
						 size_t n, const char *path, struct bb_error *err);

#endif
