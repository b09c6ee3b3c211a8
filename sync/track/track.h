/*
 * sync/track/track.h: inside the tracker: sets of frames, candidates for a body's pose, the state kept per body.
 *
 * sync/track only. Flow of a set: tracker.c collects it, solve.c runs every body warm (associate.c from the prediction,
 * narrowing), then cold where that failed (acquire.c: match.c and label.c over several cameras, perspective.c over
 * one).
 */
#ifndef BB_SYNC_TRACK_TRACK_H
#define BB_SYNC_TRACK_TRACK_H

#include "sync/track/filter.h"
#include "sync/track/lens.h"
#include "sync/track/polish.h"
#include "sync/track/tracker.h"

#define BB_TRACK_MARKERS_MAX 6
#define BB_TRACK_CAMERAS_MAX 256
#define BB_TRACK_SETS 4        /* closed sets that may wait for bb_tracker_solve */
#define BB_TRACK_RING 64       /* solutions kept per body */
#define BB_TRACK_COLD_BLOBS 48 /* per camera that a cold start looks at */
#define BB_TRACK_POINTS 64     /* triangulated points a cold start keeps */
#define BB_TRACK_HYPOTHESES 8
#define BB_TRACK_FLOOD_MAX 16384 /* of more blobs in a frame the rest is not looked at */
#define BB_TRACK_PRIOR_S 1.0 /* an older pose says nothing about where to look or which of two twins it is */
#define BB_TRACK_GATE 5.0 /* sigmas a pixel may be off and still be the marker */

struct bb_track_view { /* one camera's frame in a set */
	bool here, flooded;
	uint16_t n;
	int64_t mid_ns;
	struct bb_blob *blobs; /* BB_CAMERA_BLOBS_MAX */
	uint8_t *owner;        /* of each blob: 0 nobody, else body + 1 */
};

struct bb_track_set {
	int64_t ref_ns, at_ns; /* first frame's mid-exposure; mean of all */
	size_t n_here;
	struct bb_track_view *views;
};

struct bb_track_candidate {
	bool ok;
	struct bb_track_obs *obs; /* n_cameras * BB_TRACK_MARKERS_MAX */
	size_t n_obs;
	struct bb_polish fit;
	double score; /* sum of GATE^2 - residual^2 in sigmas: more explained blobs, then nearer */
	uint16_t n_markers, n_cameras, n_seeing; /* seeing: at least one marker; n_cameras: at least three */
	uint16_t merged;                         /* blobs left out because they may be two markers */
};

struct bb_track_point { /* a triangulated blob */
	struct bb_vec3 p;
	double sigma_m;
	uint16_t n_cameras;
	int16_t *blob; /* per camera: index into the camera's cold list, -1 none */
};

/* What one set may cost beside what its own bodies cost warm: cold starts of all bodies together. At 24 cameras it is
 * about 3 ms on one core of 2020s' servers, less than a period of 250 Hz (`blackburst bench track`). */
#define BB_TRACK_PAIRS_MAX 199900 /* pairs of rays, nearest to the predictions first; looked at every 96, so 200,000 */
#define BB_TRACK_LOOKS_MAX 3000   /* cameras asked about a pair that met */
#define BB_TRACK_POSES_MAX 800 /* made from three points or bearings and held against all blobs */
#define BB_TRACK_REFINES_MAX 20   /* rough poses polished over all cameras */

struct bb_track_cold { /* scratch of a cold start */
	bool matched;  /* points are those of this set */
	unsigned refines;
	uint32_t looks;
	double reach_m; /* no ray that matters is longer */
	uint16_t *n;   /* per camera: blobs looked at */
	uint16_t (*index)[BB_TRACK_COLD_BLOBS];
	struct bb_ray (*ray)[BB_TRACK_COLD_BLOBS];
	int16_t (*point_of)[BB_TRACK_COLD_BLOBS]; /* strongest point through this blob so far, -1 none */
	struct bb_track_point points[BB_TRACK_POINTS];
	size_t n_points;
	struct bb_pose pose[BB_TRACK_HYPOTHESES];
	double rank[BB_TRACK_HYPOTHESES];
	size_t n_poses;
};

struct bb_track_noise { /* of a body's blobs in a camera: decaying sums of squared residuals and of what is left of them */
	double square, left;
};

struct bb_track_body {
	const struct bb_body *body;
	struct bb_vec3 centroid; /* body space */
	double radius_m;         /* farthest marker from the centroid */
	struct bb_filter filter;
	struct bb_track_solution last;
	bool fresh;        /* the newest set gave a solution */
	unsigned failures; /* sets in a row */
	bool swapped;      /* the newest set contradicted the labels of the one before */
	unsigned doubts;   /* sets in a row with more blobs around the body than the pose explains */
	double noise_chi2, noise_dof; /* decaying sums */
	struct bb_track_noise *noise; /* per camera */
	struct bb_track_candidate found;
	struct bb_track_solution ring[BB_TRACK_RING];
	uint64_t n_solutions, n_told;
};

#define BB_DEG_PER_RAD 57.29577951308232

struct bb_tracker {
	struct bb_tracker_config config; /* cameras and bodies point at the caller's */
	struct bb_lens *lenses;
	struct bb_track_body *bodies;
	struct bb_track_set sets[BB_TRACK_SETS + 1]; /* waiting ones, oldest first, then the open one */
	size_t n_closed;
	bool open;
	bool any_closed;
	int64_t last_ref_ns; /* of the newest closed set */
	unsigned late;       /* frames in a row older than the open set */
	struct bb_track_camera_stats *stats;
	struct bb_track_stats counted;
	uint16_t *flood; /* scratch */
	uint8_t order[BB_BODIES_MAX]; /* of cold starts */
	bool flooded;                 /* a camera of this set sent as many blobs as fit, or more */
	bool reconsidered;            /* one body a set may be looked for again though it was found */
	unsigned turn;                /* who begins: the next one after a set that spent its budget */
	double *mean_square_px2; /* per camera: decaying squared residual, per axis */
	struct bb_track_candidate trial, best, rival, aside;
	struct bb_track_cold cold;
};

/* How far the images may lie from where a pose puts them. */
struct bb_track_gate {
	double position_sigma_m, angle_sigma_rad, most_px;
};

/* Blobs for the markers of a body under a pose; blobs of other bodies are not touched. */
size_t bb_track_associate(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
			  const struct bb_pose *pose, const struct bb_track_gate *gate, struct bb_track_candidate *c);
/* From a rough pose to a polished candidate, or c->ok = false. */
void bb_track_refine(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		     const struct bb_pose *start, const struct bb_track_gate *gate, struct bb_track_candidate *c);
/* Blobs near the body that nobody claims: a good share of the explained ones, in several cameras, means wrong labels.
 */
bool bb_track_doubtful(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		       const struct bb_track_candidate *c, double share);
/* Cold start for one body; the answer is in out, ok = false when there is none or it is ambiguous. */
void bb_track_acquire(struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		      struct bb_track_candidate *out);
/* Triangulated points of all blobs nobody owns, strongest first, into tr->cold: once a set, for all bodies. */
void bb_track_match(struct bb_tracker *tr, const struct bb_track_set *set);
/* In the room, or so near to its walls that a marker may be there. */
bool bb_track_in_room(const struct bb_tracker_config *c, struct bb_vec3 p);
/* Takes out points whose blobs have found an owner since. */
void bb_track_match_again(struct bb_tracker *tr, const struct bb_track_set *set);
/* Hypotheses into tr->cold.pose, best first: from points by distances; from one camera by perspective. */
void bb_track_label(struct bb_tracker *tr, size_t body);
void bb_track_perspective(struct bb_tracker *tr, const struct bb_track_set *set, size_t body, size_t camera);
/* Adds a hypothesis unless a better one is as good as the same; keeps the best. */
void bb_track_hypothesis(struct bb_track_cold *cold, const struct bb_track_body *b, const struct bb_pose *pose,
			 double rank);
bool bb_track_same_pose(const struct bb_track_body *b, const struct bb_pose *x, const struct bb_pose *y);
/* Every body of a closed set. */
void bb_track_solve_set(struct bb_tracker *tr, struct bb_track_set *set);
/* The prediction for a set if the body was seen within max_age_s of it. */
bool bb_track_prior(const struct bb_track_body *b, int64_t at_ns, double max_age_s, struct bb_filter_state *state);
/* The noise of a body's blobs in a camera over the configured one. */
double bb_track_noise(const struct bb_track_body *b, size_t camera);
/* Is a pose where the filter expects the body? false when it was last seen more than max_age_s ago. */
bool bb_track_continues(const struct bb_track_body *b, const struct bb_track_set *set, const struct bb_pose *pose,
			double max_age_s);
/* Lends the filter's velocity to a candidate, so that cameras with their own mid-exposure fit. */
void bb_track_set_motion(const struct bb_track_body *b, const struct bb_track_set *set, struct bb_track_candidate *c);
/* The upper half of a 3 x 3 block on the diagonal, in another unit; and the sum over its axes. */
void bb_track_pack(const double from[6][6], int at, double scale, double out[6]);
double bb_track_trace(const double packed[6]);
struct bb_pose bb_track_pose_about(const struct bb_track_body *b, struct bb_vec3 centroid, struct bb_quat q);

static inline void bb_track_swap(struct bb_track_candidate *a, struct bb_track_candidate *b)
{
	const struct bb_track_candidate keep = *a;
	*a = *b;
	*b = keep;
}

#endif
