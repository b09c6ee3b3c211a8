/*
 * sim/world_impl.h: the inside of struct sim_world, shared by world.c, reference.c, body.c, node.c and fault_plan.c
 * only. One thread.
 */
#ifndef BB_SIM_WORLD_IMPL_H
#define BB_SIM_WORLD_IMPL_H

#include "sim/faults.h"

struct sim_registered {
	char class_name[16], id[BB_ID_MAX];
	void *device;
	const struct sim_verb *verbs;
};

/* Reference time tau (ns of an ideal generator since its edge 0) against clock time: linear pieces, oldest first. */
struct sim_piece {
	int64_t tau_ns, at_ns;
	int64_t ppb; /* how much faster than nominal the generator runs from here on */
};

struct sim_node_state { /* sums over the faults that are set */
	struct sim_world *world;
	int64_t late_frames;
	int64_t slow_ns;
	int64_t drag_ppm;
	int64_t crashed;
	int64_t stalled;
	int64_t suspended;
};

#define SIM_MARKERS 6 /* of a body, at most */

struct sim_viewer_state {
	int64_t left; /* > 0: the viewer is not in the room */
	int64_t gripped[SIM_MARKERS];  /* of the wand: fingers on it */
	int64_t loose_nm[SIM_MARKERS]; /* of the glasses: how far out of its place */
	int64_t door_mdeg; /* how far the room's door stands open, into the room */
};

struct sim_planted {
	struct bb_timer timer;
	struct sim_world *world;
	const struct sim_fault *fault;
	const struct sim_verb *verb;
	int64_t set_ns, cleared_ns; /* clock time; BB_NEVER: not yet */
	enum bb_status status;      /* of the last apply */
};

struct sim_world {
	const struct bb_room *room;
	const struct bb_path *head_path, *wand_path;
	struct bb_pose (*head_fn)(void *ctx, int64_t t_ns);
	void *head_ctx;
	struct bb_clock *clk;
	struct bb_eventlog *events;
	uint16_t fault_source;
	uint64_t seed;
	int64_t scene_start_ns;

	struct sim_registered *registered;
	size_t n_registered, cap_registered;

	struct bb_rate sync_rate;
	struct sim_piece *piece;
	size_t n_pieces, cap_pieces;
	uint32_t n_bends;          /* changes of the pieces */

	double head_radius_m;
	struct { /* the last head asked for: cameras that expose together ask for the same instant */
		bool valid;
		int64_t at_ns;
		struct bb_pose pose;
	} memo;

	struct { /* outlets told to be off; the rest are fed */
		char outlet[2 * BB_ID_MAX];
	} *unfed;
	size_t n_unfed, cap_unfed;

	struct sim_node_state *nodes;
	struct sim_viewer_state viewer;

	struct sim_planted *planted;
	size_t n_planted;
	int64_t frame_ns;
};

extern const struct sim_verb sim_node_verbs[];
extern const struct sim_verb sim_viewer_verbs[];

/* Room for one more in an array; false: out of memory or more than most. */
bool sim_grow(void **array, size_t element_bytes, size_t n, size_t *cap, size_t most);
enum bb_status sim_reference_init(struct sim_world *w);
void sim_body_init(struct sim_world *w);
void sim_faults_forget(struct sim_world *w); /* disarm and free what was planted */

#endif
