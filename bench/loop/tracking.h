/* bench/tracking.h: camera frames read in one turn of the loop; private to the loop's files. */
#ifndef BB_BENCH_TRACKING_H
#define BB_BENCH_TRACKING_H

#include "hal/camera.h"

#define TRACK_READS_MAX 512

struct camera_read {
	size_t camera;
	int64_t mid_ns, arrived_ns; /* host */
	const struct bb_blob *blobs;
	size_t n;
};

#endif
