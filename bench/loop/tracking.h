/* bench/tracking.h: camera frames read in one turn of the loop; private to the loop's files. */
#ifndef BB_BENCH_TRACKING_H
#define BB_BENCH_TRACKING_H

#include "hal/camera.h"

#define TRACK_READS_MAX 512
#define TRACK_SOLUTIONS_MAX 32 /* of a turn and a body; earlier ones are passed over */

struct camera_read {
	size_t camera;
	int64_t mid_ns, arrived_ns; /* host */
	const struct bb_blob *blobs;
	size_t n;
	int64_t device_ns;          /* mid-exposure by the camera's own clock */
	uint32_t seq;
	bool overflow;
	bool given;                 /* to the tracker */
};

/* labels.c. What the labels of the newest solutions say; newest: of the glasses in this turn, or NULL. */
struct bb_frame_loop;
struct bb_track_solution;
enum bb_status bb_labels_create(struct bb_frame_loop *l);
void bb_labels_look(struct bb_frame_loop *l, const struct camera_read *reads, size_t n_reads, const struct bb_track_solution *newest,
                    int64_t now_ns);

/* cameras.c. A frame that came; what it shows, once the tracker has seen it; how the reading of a camera ended. */
struct bb_frame_loop;
void bb_cameras_begin(struct bb_frame_loop *l, size_t cam);
void bb_cameras_frame(struct bb_frame_loop *l, size_t cam, uint32_t seq, int64_t arrived_ns, int64_t now_ns);
void bb_cameras_look(struct bb_frame_loop *l, const struct camera_read *r, int64_t now_ns);
void bb_cameras_after(struct bb_frame_loop *l, size_t cam, enum bb_status status, int64_t now_ns);

#endif
