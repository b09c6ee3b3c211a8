/*
 * bench/latency.h: head to photon, link by link: from the middle of the exposure the pose came from to light of the middle row
 * through an open shutter, along the node and display that came last. A chain: each link begins where the one before ended, so
 * they add up to the total exactly.
 *
 * Each link has an owner and a source: measured (the difference of two stamps) or modelled (a number from the room file or a
 * cost profile). On the virtual clock what a processor does is modelled and what devices do is stamped by simulated ones.
 */
#ifndef BB_BENCH_LATENCY_H
#define BB_BENCH_LATENCY_H

#include "bench/stats.h"

/* link, name, owner, modelled: 0 never, 1 on the virtual clock, 2 always; what it covers */
#define BB_LINK_LIST(X)                                                                                              \
	X(BB_LINK_EXPOSURE, "exposure", "cameras", 2, "middle of the exposure to its end")                          \
	X(BB_LINK_READOUT, "read-out", "cameras", 2, "end of the exposure to the last row read out")                \
	X(BB_LINK_TRANSFER, "transfer", "cameras", 0, "last row to arrival on the host")                            \
	X(BB_LINK_WAIT, "wait", "frame loop", 0, "arrival to the begin of the frame that uses it")                  \
	X(BB_LINK_BLOBS, "blobs", "head node", 1, "camera frames read, pictures to blobs")                          \
	X(BB_LINK_POSE, "pose", "head node", 1, "blobs to solutions")                                               \
	X(BB_LINK_PREDICT, "predict", "head node", 1, "solutions to the pose at the photon; pads, eyes and time")   \
	X(BB_LINK_STATE, "state", "link", 0, "scene state sent to the node")                                        \
	X(BB_LINK_SELECT, "select", "render nodes", 1, "bricks selected and streamed")                              \
	X(BB_LINK_RENDER, "render", "render nodes", 1, "both eyes of every screen of the node drawn")               \
	X(BB_LINK_BARRIER, "barrier", "swap barrier", 0, "image ready to released by the last node and the head")   \
	X(BB_LINK_PRESENT, "present", "displays", 0, "release to the vblank of the flip")                           \
	X(BB_LINK_SCANOUT, "scan-out", "displays", 2, "flip to the middle row half as bright as it becomes") \
	X(BB_LINK_SHUTTER, "shutter", "shutters", 0, "middle row to a shutter that is open for it")

enum bb_link_id {
#define X(id, name, owner, modelled, help) id,
	BB_LINK_LIST(X)
#undef X
	BB_LINK_COUNT
};
_Static_assert(BB_LINK_COUNT == BB_LINKS, "a row of the ledger has a place for each");
const char *bb_latency_name(enum bb_link_id link);

struct bb_run_result;

struct bb_latency_link {
	const char *name, *owner, *help;
	bool modelled;
	double uncertainty_ms;       /* one sigma of a frame's value by the stamps it is made of; NAN: of a model nobody checked */
	struct bb_summary summary;   /* ms */
};

struct bb_prediction { /* over frames that had a pose: rms at the photon */
	size_t n;
	double with_mm, without_mm, with_deg, without_deg, horizon_ms;
};

struct bb_latency {
	size_t n;                    /* frames whose whole chain is known */
	struct bb_latency_link link[BB_LINK_COUNT];
	struct bb_summary total;     /* ms */
	double uncertainty_ms;
	double within_50, within_20; /* share of the frames */
	double floor_ms;             /* of the links that no room of these devices can shorten: exposure, read-out, scan-out */
	struct bb_prediction prediction;
	char attack[240];            /* which link first, and why: a sentence */
};

/* From the rows of the ledger; n 0: no frame had a camera's pose and a display. false: out of memory. */
bool bb_latency_of(const struct bb_run_result *r, struct bb_latency *out);

#endif
