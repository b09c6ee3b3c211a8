/* sync/calibrate/drift.c: see drift.h. */
#include "sync/calibrate/drift.h"

#include <math.h>
#include <stdlib.h>

#include "sync/track/lens.h"

#define HOLD_NS INT64_C(2000000000)
#define RATIO 2.0
#define MEMORY_S 0.25     /* of the rms */
#define SHIFT_MEMORY_S 1.0
#define LEARN_SAMPLES 400 /* markers seen until a baseline is believed */
#define LEAST_SAMPLES 40  /* in which the distances were too large */
#define ALIKE 0.5         /* of the squares: what the markers' common shift explains */
#define NEAR_PX 1.5       /* a blob nearer than this to where a marker belongs is that marker */
#define REACH_PX 60.0     /* a knock is looked for this far */
#define BLOBS_MAX 64

struct watched {
	struct bb_lens lens;
	struct bb_drift_state state;
	int64_t last_ns, good_ns; /* good_ns: a drifted camera is where it belongs since; 0: it is not */
	double square_px2;        /* decaying mean of squares, per axis */
	double slow_px2;          /* the same over as long as the shift */
	double learned_px2;
	uint64_t n, n_bad; /* samples ever; since since_ns */
};

struct bb_drift {
	size_t n_cameras;
	double ratio, noise_px;
	int64_t hold_ns;
	struct watched *cameras;
};

enum bb_status bb_drift_create(const struct bb_drift_config *config, struct bb_drift **out)
{
	*out = NULL;
	if (!config->n_cameras || !(config->noise_px > 0))
		return BB_ERR_USAGE;
	struct bb_drift *d = calloc(1, sizeof(*d));
	struct watched *cameras = calloc(config->n_cameras, sizeof(*cameras));
	enum bb_status status = d && cameras ? BB_OK : BB_ERR_NOMEM;
	for (size_t i = 0; !status && i < config->n_cameras; i++) {
		if (!bb_lens_init(&cameras[i].lens, &config->cameras[i]))
			status = BB_ERR_CONFIG;
		if (!status && config->baseline_px && config->baseline_px[i] > 0)
			cameras[i].state.baseline_px = fmax(config->baseline_px[i], config->noise_px);
	}
	if (status) {
		free(cameras);
		free(d);
		return status;
	}
	*d = (struct bb_drift){ .n_cameras = config->n_cameras,
		                .ratio = config->ratio > 0 ? config->ratio : RATIO,
		                .noise_px = config->noise_px,
		                .hold_ns = config->hold_ns > 0 ? config->hold_ns : HOLD_NS,
		                .cameras = cameras };
	*out = d;
	return BB_OK;
}

void bb_drift_destroy(struct bb_drift *d)
{
	if (!d)
		return;
	free(d->cameras);
	free(d);
}

/* Blob nearest to a place, and how far. */
static size_t nearest(const struct bb_blob *blobs, size_t n, double x, double y, double *distance_px)
{
	size_t best = 0;

	*distance_px = (double)INFINITY;
	for (size_t i = 0; i < n; i++) {
		const double far = hypot((double)blobs[i].x_px - x, (double)blobs[i].y_px - y);
		if (far < *distance_px) {
			*distance_px = far;
			best = i;
		}
	}
	return best;
}

/* How many markers have a blob where a shift puts them; off: how far those are from where they belong. */
static size_t support(const double (*px)[2], size_t n_px, const struct bb_blob *blobs, size_t n, const double shift[2],
                      double (*off)[2])
{
	size_t found = 0;

	for (size_t i = 0; i < n_px; i++) {
		double far;
		const size_t b = nearest(blobs, n, px[i][0] + shift[0], px[i][1] + shift[1], &far);
		if (far > NEAR_PX)
			continue;
		if (off) {
			off[found][0] = (double)blobs[b].x_px - px[i][0];
			off[found][1] = (double)blobs[b].y_px - px[i][1];
		}
		found++;
	}
	return found;
}

/*
 * Distances of the markers that were seen. A knock moves all of them alike, often further than they are apart, so when
 * fewer than two are where they belong, the shift that explains most blobs is looked for: three of them, or it is chance.
 */
static size_t distances(const double (*px)[2], size_t n_px, const struct bb_blob *blobs, size_t n, double (*off)[2])
{
	const double none[2] = { 0, 0 };
	double best[2] = { 0, 0 };
	size_t most = 2;

	if (support(px, n_px, blobs, n, none, NULL) >= 2)
		return support(px, n_px, blobs, n, none, off);
	for (size_t i = 0; i < n_px; i++)
		for (size_t k = 0; k < n; k++) {
			const double shift[2] = { (double)blobs[k].x_px - px[i][0], (double)blobs[k].y_px - px[i][1] };
			const double far = hypot(shift[0], shift[1]);
			if (far > REACH_PX)
				continue;
			const size_t found = support(px, n_px, blobs, n, shift, NULL);
			if (found > most || (found == most && most > 2 && far < hypot(best[0], best[1]))) {
				most = found;
				best[0] = shift[0];
				best[1] = shift[1];
			}
		}
	return most > 2 ? support(px, n_px, blobs, n, best, off) : 0;
}

static void learn(const struct bb_drift *d, struct watched *w)
{
	if (!(w->state.baseline_px > 0) && w->n >= LEARN_SAMPLES)
		w->state.baseline_px = fmax(sqrt(w->learned_px2), d->noise_px);
}

static void take(struct watched *w, double dt_s, const double off[2])
{
	const double square = (off[0] * off[0] + off[1] * off[1]) / 2;
	const double fast = 1 - exp(-dt_s / MEMORY_S), slow = 1 - exp(-dt_s / SHIFT_MEMORY_S);

	w->n++;
	w->learned_px2 += (square - w->learned_px2) / (double)w->n;
	w->square_px2 += fast * (square - w->square_px2);
	w->slow_px2 += slow * (square - w->slow_px2);
	for (int i = 0; i < 2; i++)
		w->state.shift_px[i] += slow * (off[i] - w->state.shift_px[i]);
}

static bool is_worst(const struct bb_drift *d, const struct watched *w)
{
	for (size_t i = 0; i < d->n_cameras; i++)
		if (!d->cameras[i].state.drifted && d->cameras[i].square_px2 > w->square_px2)
			return false;
	return true;
}

/* Do the markers move all alike? Blobs that only scatter, or a body that is not what it was, are no knock. */
static bool is_shift(const struct watched *w)
{
	const double *s = w->state.shift_px;

	return (s[0] * s[0] + s[1] * s[1]) / 2 > ALIKE * w->slow_px2;
}

static void accuse(struct bb_drift *d, struct watched *w, int64_t now_ns)
{
	w->state.drifted = true;
	w->state.drifted_ns = now_ns;
	w->good_ns = 0;
	for (size_t i = 0; i < d->n_cameras; i++)
		d->cameras[i].state.since_ns = 0;
}

static void judge(struct bb_drift *d, struct watched *w, int64_t now_ns, size_t n_new)
{
	const bool bad = w->state.rms_px > d->ratio * w->state.baseline_px;

	if (w->state.drifted) {
		w->good_ns = bad ? 0 : w->good_ns ? w->good_ns : now_ns;
		w->state.settled = w->good_ns && now_ns - w->good_ns >= d->hold_ns;
		return;
	}
	if (!bad) {
		w->state.since_ns = 0;
		return;
	}
	if (!w->state.since_ns) {
		w->state.since_ns = now_ns;
		w->n_bad = 0;
	}
	w->n_bad += n_new;
	if (now_ns - w->state.since_ns >= d->hold_ns && w->n_bad >= LEAST_SAMPLES && is_shift(w) && is_worst(d, w))
		accuse(d, w, now_ns);
}

void bb_drift_frame(struct bb_drift *d, size_t camera, int64_t mid_ns, const struct bb_pose *pose,
                    const struct bb_body *body, const struct bb_blob *blobs, size_t n)
{
	struct watched *w = camera < d->n_cameras ? &d->cameras[camera] : NULL;
	double px[BB_ARRAY_LEN(body->marker)][2], off[BB_ARRAY_LEN(body->marker)][2];
	size_t n_px = 0;

	if (!w)
		return;
	for (size_t m = 0; m < body->n_markers && m < BB_ARRAY_LEN(px); m++)
		n_px += bb_lens_project(&w->lens, bb_pose_apply(pose, body->marker[m]), px[n_px]);
	const size_t found = distances((const double(*)[2])px, n_px, blobs, n < BLOBS_MAX ? n : BLOBS_MAX, off);
	if (!found)
		return; /* covered, or somebody stands before it: no word about its calibration */
	const double dt_s = w->n ? (double)(mid_ns - w->last_ns) * 1e-9 : (double)INFINITY;
	for (size_t i = 0; i < found; i++)
		take(w, fmax(dt_s, 0) / (double)found, off[i]);
	w->last_ns = mid_ns;
	w->state.rms_px = sqrt(w->square_px2);
	learn(d, w);
	if (w->state.baseline_px > 0)
		judge(d, w, mid_ns, found);
}

struct bb_drift_state bb_drift_state(const struct bb_drift *d, size_t camera)
{
	return camera < d->n_cameras ? d->cameras[camera].state : (struct bb_drift_state){ 0 };
}

double bb_drift_weight(const struct bb_drift *d, size_t camera)
{
	return bb_drift_state(d, camera).drifted ? 0 : 1;
}

void bb_drift_forgive(struct bb_drift *d, size_t camera)
{
	if (camera >= d->n_cameras)
		return;
	d->cameras[camera].state.drifted = d->cameras[camera].state.settled = false;
	d->cameras[camera].state.since_ns = d->cameras[camera].good_ns = 0;
}
