#include "bench/trade/tracking.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/solver/studio.h"
#include "bench/solver/walk.h"
#include "bench/stats.h"
#include "bench/file.h"
#include "bench/track/cover.h"

#define CABIN "rooms/cabin.yaml"
#define DECK "rooms/deck.yaml"
#define WALK "scenes/walk.path"
#define USUAL_NOISE_PX 0.05
#define SPIN_UP 60 /* frames that do not count: the filter has to find the viewer */

static const double noises_px[] = { 0.02, 0.05, 0.1, 0.2, 0.5, 1.0 };
static const unsigned deck_every[] = { 4, 3, 2, 1 }; /* of its 24 cameras, evenly round the room: 6, 8, 12, 24 */

/* ---- which cameras ---- */

static void drop(struct bb_room *room, size_t camera)
{
	memmove(&room->cameras[camera], &room->cameras[camera + 1],
		(room->n_cameras - camera - 1) * sizeof(*room->cameras));
	room->n_cameras--;
}

/* The weakest decile of where heads are, the viewer's body in the way; HUGE_VAL where much has no position at all. */
static double weakness(const struct bb_room *room, double *placed)
{
	const struct bb_cover_wishes w = { .voxel_m = 0.2,
					   .boxed = true,
					   .min = { -0.8, 1.1, -0.8 },
					   .max = { 0.8, 1.9, 0.8 },
					   .marker_m = 0.012,
					   .least_px = 1,
					   .headings = 12,
					   .threads = 1 };
	struct bb_cover_summary s = { .weak_m = HUGE_VAL };
	struct bb_cover c;

	if (!bb_cover_begin(room, &w, &c, NULL) && !bb_cover_run(&c, NULL))
		(void)!bb_cover_summarise(&c, BB_COVERAGE_MEAN, NULL, 0, &s);
	bb_cover_end(&c);
	*placed = s.p50_m;
	return s.weak_m;
}

/* Takes away the camera that is missed least. */
static size_t least_missed(const struct bb_room *room)
{
	struct bb_camera_config rest[BB_COVERAGE_CAMERAS_MAX];
	double best = HUGE_VAL, best_p50 = HUGE_VAL;
	size_t which = 0;

	for (size_t i = 0; i < room->n_cameras; i++) {
		struct bb_room without = *room;
		double p50 = HUGE_VAL;
		memcpy(rest, room->cameras, room->n_cameras * sizeof(*rest));
		without.cameras = rest;
		drop(&without, i);
		const double weak = weakness(&without, &p50);
		if (weak < best || (!(weak > best) && p50 < best_p50)) {
			best = weak;
			best_p50 = p50;
			which = i;
		}
	}
	return which;
}

static void thin_out_cabin(struct bb_room *room, unsigned n, char *left_out, size_t cap)
{
	left_out[0] = '\0';
	while (room->n_cameras > n) {
		const size_t i = least_missed(room);
		const size_t used = strlen(left_out);
		bb_text_format(left_out + used, cap - used, "%s%s", used ? " " : "", room->cameras[i].id);
		drop(room, i);
	}
}

static void thin_out_deck(struct bb_room *room, unsigned n)
{
	const size_t every = room->n_cameras / n;

	for (size_t i = room->n_cameras; i-- > 0;)
		if (i % every)
			drop(room, i);
}

/* ---- one point ---- */

struct sums {
	size_t n, n_four, n_frames, n_seen_four, seeing;
	double mm2, deg2, four_mm2, four_deg2, *mm, *solve_ms;
};

static void add_pose(struct sums *s, const struct bb_studio *studio, const struct bb_track_solution *sol, size_t seeing)
{
	const double mm = 1e3 * bb_vec3_norm(bb_vec3_sub(sol->centroid, bb_studio_centroid(studio, sol->at_ns)));
	const double deg = bb_vec3_norm(bb_walk_turn_deg(sim_world_body(studio->world, 0, sol->at_ns).q, sol->body.q));

	s->mm[s->n++] = mm;
	s->mm2 += mm * mm;
	s->deg2 += deg * deg;
	if (seeing < 4)
		return;
	s->n_four++;
	s->four_mm2 += mm * mm;
	s->four_deg2 += deg * deg;
}

static void walk(struct bb_studio *studio, unsigned n_frames, struct sums *s)
{
	struct bb_track_solution sol;
	bool solved;

	for (unsigned i = 0; i < n_frames + SPIN_UP && bb_studio_step(studio, &sol, &solved); i++) {
		if (i < SPIN_UP)
			continue;
		const size_t seeing = bb_studio_seeing(studio, solved ? sol.at_ns : studio->mid_ns);
		s->solve_ms[s->n_frames++] = 1e-6 * (double)studio->solve_ns;
		s->seeing += seeing;
		s->n_seen_four += seeing >= 4;
		if (solved)
			add_pose(s, studio, &sol, seeing);
	}
}

static void conclude(struct sums *s, struct bb_tracking_point *p)
{
	const double n = fmax(1, (double)s->n), frames = fmax(1, (double)s->n_frames);

	p->n_frames = (unsigned)s->n_frames;
	p->solved = (double)s->n / frames;
	p->four = (double)s->n_seen_four / frames;
	p->seeing = (double)s->seeing / frames;
	p->rms_mm = s->n ? sqrt(s->mm2 / n) : BB_UNKNOWN;
	p->rms_deg = s->n ? sqrt(s->deg2 / n) : BB_UNKNOWN;
	p->four_mm = s->n_four ? sqrt(s->four_mm2 / (double)s->n_four) : BB_UNKNOWN;
	p->four_deg = s->n_four ? sqrt(s->four_deg2 / (double)s->n_four) : BB_UNKNOWN;
	bb_stats_sort(s->mm, s->n);
	bb_stats_sort(s->solve_ms, s->n_frames);
	p->p95_mm = bb_stats_nearest_rank(s->mm, s->n, 0.95);
	p->solve_ms = bb_stats_nearest_rank(s->solve_ms, s->n_frames, 0.5);
	p->solve_p99_ms = bb_stats_nearest_rank(s->solve_ms, s->n_frames, 0.99);
}

static enum bb_status measure(const struct bb_tracking *t, struct bb_tracking_point *p, struct bb_error *err)
{
	const struct bb_studio_config config = { p->knob == BB_TRACKING_DECK ? DECK : CABIN, WALK, p->fidelity, t->seed };
	const unsigned n_frames = p->fidelity == 2 ? t->n_pictures : t->n_frames;
	struct sums s = { .mm = calloc(n_frames + 1, sizeof(double)), .solve_ms = calloc(n_frames + 1, sizeof(double)) };
	struct bb_studio studio = { 0 };
	struct bb_room *room = NULL;
	enum bb_status status = bb_room_load(config.room, &room, err);

	if (!status && (!s.mm || !s.solve_ms))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%u frames", n_frames);
	if (status) {
		bb_room_free(room);
	} else {
		if (p->knob == BB_TRACKING_DECK)
			thin_out_deck(room, p->n_cameras);
		else
			thin_out_cabin(room, p->n_cameras, p->left_out, sizeof(p->left_out));
		for (size_t i = 0; i < room->n_cameras; i++)
			room->cameras[i].noise_px = p->noise_px;
		status = bb_studio_open_room(&config, room, &studio, err);
	}
	if (!status) {
		walk(&studio, n_frames, &s);
		conclude(&s, p);
		bb_studio_close(&studio);
	}
	free(s.mm);
	free(s.solve_ms);
	return status;
}

/* ---- all of them ---- */

static void add(struct bb_tracking *t, enum bb_tracking_knob knob, unsigned n_cameras, double noise_px, int fidelity)
{
	t->point[t->n++] = (struct bb_tracking_point){
		.knob = knob, .n_cameras = n_cameras, .noise_px = noise_px, .fidelity = fidelity
	};
}

enum bb_status bb_tracking_measure(struct bb_tracking *t, void (*progress)(const char *text), struct bb_error *err)
{
	enum bb_status status = BB_OK;

	t->n = 0;
	for (unsigned n = 2; n <= 8; n++)
		add(t, BB_TRACKING_CAMERAS, n, USUAL_NOISE_PX, 1);
	for (size_t i = 0; i < BB_ARRAY_LEN(deck_every); i++)
		add(t, BB_TRACKING_DECK, 24 / deck_every[i], USUAL_NOISE_PX, 1);
	for (size_t i = 0; i < BB_ARRAY_LEN(noises_px); i++)
		add(t, BB_TRACKING_NOISE, 8, noises_px[i], 1);
	for (int f = 0; f <= 2; f++)
		add(t, BB_TRACKING_FIDELITY, 8, USUAL_NOISE_PX, f);
	for (size_t i = 0; i < t->n && !status; i++) {
		char text[80];
		bb_text_format(text, sizeof(text), "point %zu of %zu", i + 1, t->n);
		if (progress)
			progress(text);
		status = measure(t, &t->point[i], err);
	}
	return status;
}
