/*
 * sim/world.h: what the simulated devices share: the room, the viewer's true pose, markers and bodies, the sync
 * generator, mains. A pure function of (room, scene, seed, injected clock, faults so far). Sims reach it through
 * bb_open.world; only bench/ and tests/ create one. One thread.
 */
#ifndef BB_SIM_WORLD_H
#define BB_SIM_WORLD_H

#include "hal/room.h"
#include "hal/scene.h"

struct sim_world;

/* Borrows room, head (NULL: a still viewer at room->neutral) and wand (NULL: none); they outlive the world. */
BB_MUST_CHECK enum bb_status sim_world_create(const struct bb_room *room, const struct bb_path *head,
                                              const struct bb_path *wand, struct bb_clock *clk,
                                              struct bb_eventlog *events, uint64_t seed, struct sim_world **out);
void sim_world_destroy(struct sim_world *w);
struct bb_clock *sim_world_clock(struct sim_world *w);
const struct bb_room *sim_world_room(const struct sim_world *w);

/* Scene time 0 in clock time (bring-up comes before it); paths and faults count from here. 0 until told. */
void sim_world_set_scene_start(struct sim_world *w, int64_t at_ns);
int64_t sim_world_scene_start(const struct sim_world *w);

/* Truth. Pose of the eyes' midpoint; pose of a body's own space; positions of all markers of all present bodies. */
struct bb_pose sim_world_head(const struct sim_world *w, int64_t at_ns);
/* For tests: the head's pose from a function of scene time instead of a path. NULL: the path again. */
void sim_world_set_head_fn(struct sim_world *w, struct bb_pose (*head)(void *ctx, int64_t t_ns), void *ctx);
struct bb_pose sim_world_body(const struct sim_world *w, size_t body, int64_t at_ns);
size_t sim_world_markers(const struct sim_world *w, int64_t at_ns, struct bb_vec3 *out, size_t cap);
/* Does the straight line from a camera to a marker miss the viewer's head and torso, and the room's open door? */
bool sim_world_visible(const struct sim_world *w, struct bb_vec3 camera, struct bb_vec3 marker, int64_t at_ns);
/* What that head and torso are, for whoever foretells what they hide. */
struct sim_viewer_shape {
	struct bb_vec3 head_centre; /* from the eyes' midpoint, head space */
	double head_radius_m;
	double torso_top_m, torso_bottom_m, torso_radius_m; /* an upright capsule: its axis' ends below the head's centre */
};
struct sim_viewer_shape sim_viewer_shape(const struct bb_room *room);

/* The sync generator of the room: edge n (any n >= 0) without jitter, with the chain's rate error; the first edge at or
 * after a time. Genlocked displays and cameras with sync follow it. Without a chain it runs at the displays' rate. */
int64_t sim_world_sync_ns(const struct sim_world *w, int64_t n);
int64_t sim_world_sync_after(const struct sim_world *w, int64_t at_ns);
/* The generator as a time base for any rate locked to it: instant k of that rate, and the first k >= 0 at or after a
 * time. Instants of rates that divide each other coincide. */
int64_t sim_world_reference_ns(const struct sim_world *w, struct bb_rate rate, int64_t k);
int64_t sim_world_reference_after(const struct sim_world *w, struct bb_rate rate, int64_t at_ns);
/* Changes whenever the generator's rate was told to: instants computed before may no longer hold. */
uint32_t sim_world_reference_bends(const struct sim_world *w);
struct bb_rate sim_world_sync_rate(const struct sim_world *w);
/* From this time on the generator runs this much faster than nominal (sim_shutter: URI option, fault `rate`). */
int64_t sim_world_sync_error_ppb(const struct sim_world *w);
BB_MUST_CHECK enum bb_status sim_world_set_sync_error(struct sim_world *w, int64_t from_ns, int64_t ppb);

/* Mains: an outlet "pdu1/2" feeds whatever names it; sim_power tells, sim_monitor asks. Unknown names are fed. */
void sim_world_set_fed(struct sim_world *w, const char *outlet, bool fed);
bool sim_world_fed(const struct sim_world *w, const char *outlet);

/* How long a node's image is delayed at this moment by faults, ns (the loop adds it to the node's cost). */
int64_t sim_world_node_delay_ns(const struct sim_world *w, uint16_t node, int64_t at_ns);
/* How much longer its draws take, beyond once. */
int64_t sim_world_node_drag_ppm(const struct sim_world *w, uint16_t node);
/* A node with a stalled disk reads nothing. */
bool sim_world_node_stalled(const struct sim_world *w, uint16_t node);
/* A suspended node does nothing, and what comes for it waits; of the head: the frame loop stands still. */
bool sim_world_node_suspended(const struct sim_world *w, uint16_t node);
/* A crashed node sends, draws and answers nothing. */
bool sim_world_node_dead(const struct sim_world *w, uint16_t node, int64_t at_ns);

/* Every open sim registers itself so that faults can find "class/id", and leaves on close. */
struct sim_verb;
BB_MUST_CHECK enum bb_status sim_world_register(struct sim_world *w, const char *class_name, const char *id,
                                                void *device, const struct sim_verb *verbs);
void sim_world_unregister(struct sim_world *w, void *device);
void *sim_world_find(const struct sim_world *w, const char *class_name, const char *id, const struct sim_verb **verbs);

/* One generator per sim instance, seeded from the run's seed, class and id: independent of the order of opening. */
struct sim_rng {
	uint64_t s[4];
	bool has_spare;
	double spare;
};
void sim_rng_seed(struct sim_rng *r, uint64_t seed, const char *class_name, const char *id);
uint64_t sim_rng_u64(struct sim_rng *r);
double sim_rng_uniform(struct sim_rng *r); /* [0, 1) */
double sim_rng_normal(struct sim_rng *r);  /* mean 0, sd 1; the same bits on every machine */
double sim_rng_exponential(struct sim_rng *r); /* mean 1; the same bits on every machine */
/* A generator of its own for event number n of an instance: what one event draws does not move the next one's draws,
 * so a fault leaves every event outside its time as it was. */
struct sim_rng sim_rng_at(const struct sim_rng *instance, uint64_t n);

#endif
