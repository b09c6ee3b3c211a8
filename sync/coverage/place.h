/*
 * sync/coverage/place.h: where on given rails cameras should hang and whither they should look, so that the weakest part
 * of a volume becomes as good as it can.
 *
 * A place's worth is 1 / (expected error), 0 where there is no position; with the viewer in the way its mean, or its
 * least, over the headings. Sought is the largest mean worth of the weakest tenth of the places of a coarse grid; the
 * weaker half and the whole count as well, for a hundredth and a thousandth, so that there is a way up from nothing.
 * Every camera in turn moves along its rail and turns by a step if that helps (pattern search, Hooke and Jeeves 1961),
 * with steps that halve when none does; then one camera is hung anywhere and the search goes on from there (iterated
 * local search). Try 0 begins at the cameras' own poses, each further one anywhere.
 *
 * Metres, room axes. A try is pure, allocates for itself and may run beside others.
 */
#ifndef BB_SYNC_COVERAGE_PLACE_H
#define BB_SYNC_COVERAGE_PLACE_H

#include "sync/coverage/coverage.h"

#define BB_RAILS_MAX 256
#define BB_PLACE_GRID_MAX 40000u

struct bb_rail {
	struct bb_vec3 a, b;
};

struct bb_place_config {
	struct bb_coverage_config cover; /* cameras: how they begin, and all but their poses */
	const struct bb_rail *rails;     /* borrowed; one after the other they are one way */
	size_t n_rails;
	struct bb_vec3 min, max; /* the volume; what of it lies outside the room does not count */
	double step_m;           /* of the coarse grid */
	enum bb_coverage_body body;
	double apart_m;          /* between any two cameras */
	unsigned sweeps;         /* over all cameras, at most */
	uint64_t seed;
};

struct bb_placed {
	struct bb_pose pose[BB_COVERAGE_CAMERAS_MAX];
	double begun, reached;   /* what is sought, 1 / m */
	bool apart;              /* any two cameras are; false: the rails have no room for them, or none was found */
	uint64_t n_probes;
};

/* The top edges of upright walls, `inset_m` into the room and `below_m` under the edge. Returns how many, at most cap. */
size_t bb_rails_of_room(const struct bb_room *room, double inset_m, double below_m, struct bb_rail *out, size_t cap);
/* BB_ERR_CONFIG: no rails, no volume, or a grid above BB_PLACE_GRID_MAX; BB_ERR_NOMEM. */
BB_MUST_CHECK enum bb_status bb_place_try(const struct bb_place_config *config, unsigned index, struct bb_placed *out);

#endif
