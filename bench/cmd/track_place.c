/* bench/cmd/track_place.c: `track place ROOM`: hang the cameras where the weakest part gains most. docs/coverage.md. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/cmd/track_cover.h"
#include "bench/file.h"
#include "bench/track/cover_pictures.h"
#include "bench/track/rearrange.h"

#define INSET_M 0.025 /* a camera's half depth from the wall, its half height below the edge */
#define BELOW_M 0.035
#define LOW_M 0.6     /* above the floor: where heads and hands are */
#define HIGH_M 2.0

static const unsigned levels[] = { 2, 3, 4, 6, 8 };
static const unsigned drawn[] = { 3, 6, 8 };

struct side { /* before or after */
	struct bb_room room; /* shallow: the cameras may be others */
	struct bb_cover cover;
	struct bb_cover_summary s[BB_COVERAGE_BODIES];
};

struct job {
	const struct bb_cli *cli;
	struct bb_cover_wishes wishes;
	enum bb_coverage_body body;
	double tries, sweeps, grid_mm, n_cameras, apart_mm, seed;
	struct bb_rails rails;
	struct bb_camera_config *cameras; /* as they begin, then as they hang */
	struct bb_placed placed;
	struct side before, after;
};

/* ---- what is asked ---- */

static enum bb_status read_numbers(struct job *j, struct bb_error *err)
{
	const struct {
		const char *name;
		double usual, least, most, *out;
	} numbers[] = { { "tries", 4, 1, 1000, &j->tries },	     { "sweeps", 300, 1, 10000, &j->sweeps },
			{ "cameras", 0, 1, BB_COVERAGE_CAMERAS_MAX, &j->n_cameras }, { "seed", 1, 0, 9e15, &j->seed },
			{ "grid-mm", 0, 50, 2000, &j->grid_mm },     { "apart-mm", 150, 0, 10000, &j->apart_mm } };
	enum { WHOLE_TO = 4 };
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < BB_ARRAY_LEN(numbers) && !status; i++)
		status = (i < WHOLE_TO ? bb_cli_whole : bb_cli_number)(j->cli, numbers[i].name, numbers[i].usual, numbers[i].least, numbers[i].most,
				       numbers[i].out, err);
	if (!status)
		status = bb_cover_wish(j->cli, 50, &j->wishes, err);
	if (!status)
		status = bb_cover_body(j->cli, BB_COVERAGE_MEAN, &j->body, err);
	return status;
}

/* The tracked volume, and about 700 places in it to judge by. */
static void settle_volume(struct job *j, const struct bb_room *room)
{
	if (!j->wishes.boxed) {
		j->wishes.boxed = true;
		j->wishes.min = (struct bb_vec3){ room->min.x, fmin(room->min.y + LOW_M, room->max.y), room->min.z };
		j->wishes.max = (struct bb_vec3){ room->max.x, fmin(room->min.y + HIGH_M, room->max.y), room->max.z };
	}
	const struct bb_vec3 size = bb_vec3_sub(j->wishes.max, j->wishes.min);
	if (!(j->grid_mm > 0))
		j->grid_mm = fmax(50, 1e3 * cbrt(size.x * size.y * size.z / 700));
}

static enum bb_status settle_rails(struct job *j, const struct bb_room *room, struct bb_error *err)
{
	const char *file = bb_cli_get(j->cli, "rails", NULL);

	if (file)
		return bb_rails_load(file, &j->rails, err);
	j->rails.n = bb_rails_of_room(room, INSET_M, BELOW_M, j->rails.rail, BB_RAILS_MAX);
	return j->rails.n ? BB_OK : bb_fail(err, BB_ERR_CONFIG, 1757, NULL, "no upright wall, and no --rails");
}

/* More cameras than there are: like the first. Fewer: the first ones. */
static enum bb_status settle_cameras(struct job *j, const struct bb_room *room, struct bb_error *err)
{
	const size_t n = j->n_cameras > 0 ? (size_t)j->n_cameras : room->n_cameras;

	if (!room->n_cameras)
		return bb_fail(err, BB_ERR_CONFIG, 1759, NULL, "room %s", room->name);
	j->n_cameras = (double)n;
	j->cameras = calloc(n, sizeof(*j->cameras));
	if (!j->cameras)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu cameras", n);
	for (size_t i = 0; i < n; i++) {
		j->cameras[i] = room->cameras[i < room->n_cameras ? i : 0];
		if (i >= room->n_cameras)
			bb_text_format(j->cameras[i].id, sizeof(j->cameras[i].id), "more-%zu", i + 1);
	}
	return BB_OK;
}

/* ---- the work ---- */

static enum bb_status judge(const struct job *j, struct side *s, const struct bb_room *room,
			    struct bb_camera_config *cameras, size_t n, struct bb_error *err)
{
	s->room = *room;
	s->room.cameras = cameras;
	s->room.n_cameras = n;
	enum bb_status status = bb_cover_begin(&s->room, &j->wishes, &s->cover, err);
	if (!status)
		status = bb_cover_run(&s->cover, err);
	for (int k = 0; k < BB_COVERAGE_BODIES && !status; k++)
		if (bb_cover_summarise(&s->cover, (enum bb_coverage_body)k, levels, BB_ARRAY_LEN(levels), &s->s[k]))
			status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a table");
	return status;
}

static enum bb_status search(struct job *j, const struct bb_room *room, struct bb_error *err)
{
	struct bb_place_config config = { .cover = bb_cover_config(room, &j->wishes),
					  .rails = j->rails.rail,
					  .n_rails = j->rails.n,
					  .min = j->wishes.min,
					  .max = j->wishes.max,
					  .step_m = 1e-3 * j->grid_mm,
					  .body = j->body,
					  .apart_m = 1e-3 * j->apart_mm,
					  .sweeps = (unsigned)j->sweeps,
					  .seed = (uint64_t)j->seed };

	config.cover.cameras = j->cameras;
	config.cover.n_cameras = (size_t)j->n_cameras;
	config.cover.headings = j->wishes.headings < 8 ? j->wishes.headings : 8; /* enough to choose by */
	const enum bb_status status = bb_rearrange(&config, (unsigned)j->tries, j->wishes.threads, &j->placed, err);
	for (size_t i = 0; i < config.cover.n_cameras && !status; i++)
		j->cameras[i].pose = j->placed.pose[i];
	return status;
}

static enum bb_status draw(struct job *j, const char *dir, struct bb_error *err)
{
	struct bb_cover_clouds what = { .cover = { &j->before.cover, &j->after.cover },
					.body = { j->body, j->body },
					.title = { "before", "after" },
					.n_rows = 2,
					.level = { drawn[0], drawn[1], drawn[2] },
					.n_levels = BB_ARRAY_LEN(drawn) };
	char path[BB_PATH_MAX_BYTES];
	struct bb_cloud_page *clouds;
	struct bb_page page;
	enum bb_status status = bb_cover_folder(dir, err);

	if (status)
		return status;
	if (bb_cover_clouds_begin(&what, &clouds, &page))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the clouds");
	bb_text_format(path, sizeof(path), "%s/clouds.png", dir);
	if (!status)
		status = bb_page_write(&page, path, err);
	bb_cover_clouds_end(clouds);
	struct bb_cover_slices s = { .cover = &j->before.cover, .body = j->body, .height_m = 1.6 };
	bb_cover_slices_fit(&s); /* one scale for both */
	for (int i = 0; i < 2 && !status; i++) {
		s.cover = i ? &j->after.cover : &j->before.cover;
		page = bb_cover_slices_page(&s);
		bb_text_format(path, sizeof(path), "%s/slices-%s.png", dir, i ? "after" : "before");
		status = bb_page_write(&page, path, err);
	}
	return status;
}

/* ---- telling ---- */

static double factor(const struct job *j)
{
	return j->before.s[j->body].weak_m / j->after.s[j->body].weak_m;
}

static void print(const struct job *j, FILE *f)
{
	const struct bb_vec3 a = j->wishes.min, b = j->wishes.max;

	fprintf(f,
		"%zu cameras on %zu rails, %.0f tries (%llu probes in the best) on a grid of %.0f mm; judged at %g mm\n"
		"within x %.2f to %.2f, y %.2f to %.2f, z %.2f to %.2f m, the viewer in the way: %s.\n\nBefore\n\n",
		(size_t)j->n_cameras, j->rails.n, j->tries, (unsigned long long)j->placed.n_probes, j->grid_mm,
		1e3 * j->wishes.voxel_m, a.x, b.x, a.y, b.y, a.z, b.z, bb_cover_body_text(j->body));
	bb_cover_print(&j->before.cover, j->before.s, levels, BB_ARRAY_LEN(levels), f);
	fprintf(f, "\nAfter\n\n");
	bb_cover_print(&j->after.cover, j->after.s, levels, BB_ARRAY_LEN(levels), f);
	const double k = factor(j);
	if (isfinite(k) && k > 0)
		fprintf(f, "\nThe weakest decile of the volume (viewer: %s) is %s by a factor of %.2f.\n\n",
			bb_cover_body_text(j->body), k < 1 ? "worse" : "better", k < 1 ? 1 / k : k);
	else
		fprintf(f, "\nThe weakest decile had %s position before and has %s now.\n\n",
			isfinite(j->before.s[j->body].weak_m) ? "a" : "no", isfinite(j->after.s[j->body].weak_m) ? "one" : "none");
}

static json_t *cameras_json(const struct job *j)
{
	json_t *list = json_array();

	for (size_t i = 0; i < (size_t)j->n_cameras; i++) {
		const struct bb_pose *p = &j->cameras[i].pose;
		const struct bb_vec3 at = bb_pose_apply(p, (struct bb_vec3){ 0, 0, 1.5 });
		json_array_append_new(list, json_pack("{s:s, s:[f,f,f], s:[f,f,f]}", "id", j->cameras[i].id, "position_m", p->p.x,
						      p->p.y, p->p.z, "look_at_m", at.x, at.y, at.z));
	}
	return list;
}

static int tell(const struct job *j)
{
	const double k = factor(j);

	if (!bb_cli_has(j->cli, "json")) {
		print(j, stdout);
		if (!bb_cli_has(j->cli, "out"))
			bb_rearranged_print(j->cameras, (size_t)j->n_cameras, stdout);
		return BB_EXIT_OK;
	}
	return bb_cli_print_json(json_pack(
		"{s:s, s:s, s:o, s:o, s:o, s:o}", "kind", "blackburst-place", "body", bb_cover_body_text(j->body), "before",
		bb_cover_json(&j->before.cover, j->before.s, levels, BB_ARRAY_LEN(levels)), "after",
		bb_cover_json(&j->after.cover, j->after.s, levels, BB_ARRAY_LEN(levels)), "weakest_decile_factor",
		isfinite(k) && k > 0 ? json_real(k) : json_null(), "cameras", cameras_json(j)));
}

static enum bb_status work(struct job *j, const struct bb_room *room, struct bb_error *err)
{
	const char *out = bb_cli_get(j->cli, "out", NULL), *pictures = bb_cli_get(j->cli, "pictures", NULL);
	enum bb_status status = settle_rails(j, room, err);

	settle_volume(j, room);
	if (!status)
		status = settle_cameras(j, room, err);
	if (!status)
		status = judge(j, &j->before, room, room->cameras, room->n_cameras, err);
	if (!status)
		status = search(j, room, err);
	if (!status)
		status = judge(j, &j->after, room, j->cameras, (size_t)j->n_cameras, err);
	if (!status && pictures)
		status = draw(j, pictures, err);
	if (!status && out)
		status = bb_rearranged_write(room, j->cameras, (size_t)j->n_cameras, out, err);
	return status;
}

static int run(const struct bb_cli *cli)
{
	struct job *j = calloc(1, sizeof(*j));
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;

	if (!j)
		return bb_cli_fail(bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "the search"), &err);
	j->cli = cli;
	enum bb_status status = read_numbers(j, &err);
	if (!status)
		status = bb_room_load(cli->arg[0], &room, &err);
	if (!status)
		status = work(j, room, &err);
	const int code = status ? bb_cli_fail(status, &err) : tell(j);
	bb_cover_end(&j->before.cover);
	bb_cover_end(&j->after.cover);
	free(j->cameras);
	free(j);
	bb_room_free(room);
	return code;
}

static const struct bb_cli_option options[] = {
	{ "rails", "FILE", "lines of x y z x y z in metres (the top edges of the upright walls)" },
	{ "cameras", "N", "how many to hang, further ones like the first (as many as there are)" },
	{ "tries", "N", "searches; the first begins as the room is, others anywhere (4)" },
	{ "sweeps", "N", "over all cameras, at most, in each (300)" },
	{ "apart-mm", "MM", "between any two cameras, at least (150)" },
	{ "seed", "N", "of where the others begin (1)" },
	{ "grid-mm", "MM", "of the places that a search judges by (about 700 of them)" },
	{ "voxel-mm", "MM", "of the verdict before and after (50)" },
	{ "box", "X0:Y0:Z0:X1:Y1:Z1", "the volume that counts, metres (the room, 0.6 to 2 m above its floor)" },
	{ "body", "none|mean|worst", "the viewer in the way: nobody, over all headings (mean), at the worst heading" },
	{ "headings", "N", "directions the viewer turns through (16; the search takes 8 at most)" },
	{ "marker-mm", "MM", "diameter of a marker (12)" },
	{ "least-px", "PX", "diameter its image must have (1)" },
	{ "noise-px", "PX", "of a blob's centre (as each camera has it)" },
	{ "pictures", "DIR", "write clouds.png, slices-before.png and slices-after.png there" },
	{ "out", "FILE", "write the room with its cameras hung anew; left out: their block is printed" },
	{ "threads", "N", "as many as processors" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_place = { "track place", "find where cameras see the weakest part of a room best",
					       "ROOM [--rails FILE] [--cameras N] [--out ROOM.yaml] [options]",
					       options, 1, 1, run };
