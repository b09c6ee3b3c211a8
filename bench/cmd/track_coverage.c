/* bench/cmd/track_coverage.c: `track coverage ROOM`: what the cameras see, and how well. docs/coverage.md. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "bench/cmd/track_cover.h"
#include "bench/file.h"
#include "bench/track/cover_pictures.h"
#include "render/parallel.h"

#define LEVELS_USUAL "2,3,4,6,8"
#define PICTURES_USUAL "3,6,8"

/* ---- options ---- */

static enum bb_status read_box(const char *text, struct bb_cover_wishes *w, struct bb_error *err)
{
	double v[6];

	if (!text)
		return BB_OK;
	w->boxed = true;
	if (strspn(text, "0123456789+-.:") != strlen(text) || !bb_cli_numbers(text, ':', v, 6))
		return bb_fail(err, BB_ERR_USAGE, 1752, NULL, "--box '%.60s'", text);
	for (int i = 0; i < 6; i++)
		if (!(fabs(v[i]) <= 1000) || (i > 2 && !(v[i] > v[i - 3])))
			return bb_fail(err, BB_ERR_USAGE, 1752, NULL, "--box '%.60s'", text);
	w->min = (struct bb_vec3){ v[0], v[1], v[2] };
	w->max = (struct bb_vec3){ v[3], v[4], v[5] };
	return BB_OK;
}

enum bb_status bb_cover_wish(const struct bb_cli *cli, double voxel_mm, struct bb_cover_wishes *out,
			     struct bb_error *err)
{
	const struct {
		const char *name;
		double usual, least, most;
	} numbers[] = { { "voxel-mm", voxel_mm, 1, 1000 },	{ "marker-mm", 12, 0.1, 1000 },
			{ "least-px", 1, 0, 1000 },		{ "noise-px", 0, 0, 100 },
			{ "headings", 16, 1, BB_COVERAGE_HEADINGS_MAX },
			{ "threads", bb_parallel_processors(), 1, BB_PARALLEL_MOST } };
	enum { WHOLE_FROM = 4 };
	double v[BB_ARRAY_LEN(numbers)] = { 0 };

	*out = (struct bb_cover_wishes){ 0 };
	for (size_t i = 0; i < BB_ARRAY_LEN(numbers); i++) {
		const enum bb_status status = (i < WHOLE_FROM ? bb_cli_number : bb_cli_whole)(
			cli, numbers[i].name, numbers[i].usual, numbers[i].least, numbers[i].most, &v[i], err);
		if (status)
			return status;
	}
	out->voxel_m = v[0] * 1e-3;
	out->marker_m = v[1] * 1e-3;
	out->least_px = v[2];
	out->noise_px = v[3];
	out->headings = (unsigned)v[4];
	out->threads = (unsigned)v[5];
	return read_box(bb_cli_get(cli, "box", NULL), out, err);
}

enum bb_status bb_cover_body(const struct bb_cli *cli, enum bb_coverage_body usual, enum bb_coverage_body *out,
			     struct bb_error *err)
{
	const char *text = bb_cli_get(cli, "body", bb_cover_body_text(usual));

	for (int k = 0; k < BB_COVERAGE_BODIES; k++)
		if (!strcmp(text, bb_cover_body_text((enum bb_coverage_body)k))) {
			*out = (enum bb_coverage_body)k;
			return BB_OK;
		}
	return bb_fail(err, BB_ERR_USAGE, 1753, NULL, "--body '%.40s'", text);
}

enum bb_status bb_cover_folder(const char *dir, struct bb_error *err)
{
	const struct bb_where where = { dir, 0, 0 };

	if (!*dir || strlen(dir) > BB_PATH_MAX_BYTES - 64)
		return bb_fail(err, BB_ERR_USAGE, 1754, &where, "its path has %zu bytes", strlen(dir));
	if (mkdir(dir, 0777) && errno != EEXIST)
		return bb_fail(err, BB_ERR_IO, 1754, &where, "%s", strerror(errno));
	return BB_OK;
}

struct levels {
	unsigned of[BB_COVER_LEVELS_MAX];
	size_t n;
};

static enum bb_status read_levels(const char *text, size_t most, struct levels *out, struct bb_error *err)
{
	uint32_t v[BB_COVER_LEVELS_MAX];
	size_t n = 1;

	for (const char *c = text; *c; c++)
		n += *c == ',';
	if (n > most || !bb_cli_whole_numbers(text, ',', v, (int)n))
		return bb_fail(err, BB_ERR_USAGE, 1755, NULL, "--at-least '%.40s'", text);
	for (size_t i = 0; i < n; i++) {
		if (v[i] < 1 || v[i] > BB_COVERAGE_CAMERAS_MAX || (i && v[i] <= v[i - 1]))
			return bb_fail(err, BB_ERR_USAGE, 1755, NULL, "--at-least '%.40s'", text);
		out->of[i] = v[i];
	}
	out->n = n;
	return BB_OK;
}

/* ---- files ---- */

struct job {
	const struct bb_cli *cli;
	struct bb_cover cover;
	enum bb_coverage_body body;
	struct levels told, drawn;
	double height_m, seed;
	struct bb_cover_summary summary[BB_COVERAGE_BODIES];
};

static const char *in_folder(const struct job *j, const char *name, char *out, size_t cap)
{
	bb_text_format(out, cap, "%s/%s", bb_cli_get(j->cli, "out", "."), name);
	return out;
}

static enum bb_status draw(const struct job *j, const struct bb_page *clouds, const struct bb_page *slices,
			   struct bb_error *err)
{
	char path[BB_PATH_MAX_BYTES];
	enum bb_status status = bb_page_write(clouds, in_folder(j, "clouds.png", path, sizeof(path)), err);

	if (!status)
		status = bb_page_write(slices, in_folder(j, "slices.png", path, sizeof(path)), err);
	if (!status)
		status = bb_cover_html(&j->cover, j->summary, j->told.of, j->told.n, clouds, slices,
				       in_folder(j, "coverage.html", path, sizeof(path)), err);
	if (!status)
		status = bb_cover_csv(&j->cover, in_folder(j, "voxels.csv", path, sizeof(path)), err);
	return status;
}

/* With the viewer in the way there are two rows: what planning without one would have promised comes first. */
static enum bb_status write_all(const struct job *j, struct bb_error *err)
{
	struct bb_cover_clouds what = { .cover = { &j->cover, &j->cover },
					.body = { BB_COVERAGE_NONE, j->body },
					.title = { "nobody in the way", j->body == BB_COVERAGE_MEAN
								? "with the viewer's body in the way, mean over all headings"
								: "with the viewer's body in the way, at the worst heading" },
					.n_rows = 2,
					.n_levels = j->drawn.n };
	struct bb_cover_slices cuts = { .cover = &j->cover, .body = j->body, .height_m = j->height_m };
	const struct bb_page slices = bb_cover_slices_page(&cuts);

	struct bb_cloud_page *page;
	struct bb_page clouds;

	bb_cover_slices_fit(&cuts);
	if (j->body == BB_COVERAGE_NONE) {
		what.n_rows = 1;
		what.title[0] = NULL;
	}
	memcpy(what.level, j->drawn.of, j->drawn.n * sizeof(what.level[0]));
	enum bb_status status = bb_cover_folder(bb_cli_get(j->cli, "out", "."), err);
	if (status)
		return status;
	status = bb_cover_clouds_begin(&what, &page, &clouds);
	status = status ? bb_fail(err, status, 1702, NULL, "the clouds") : draw(j, &clouds, &slices, err);
	bb_cover_clouds_end(page);
	return status;
}

/* ---- the command ---- */

static int tell_trial(const struct job *j, json_t *root)
{
	struct bb_cover_trial t;

	bb_cover_trial(&j->cover, 200, 1000, (uint64_t)j->seed, &t);
	if (root && !t.n_points)
		json_object_set_new(root, "monte_carlo", json_pack("{s:i}", "points", 0));
	else if (root)
		json_object_set_new(root, "monte_carlo",
				    json_pack("{s:I, s:I, s:I, s:I, s:f, s:f, s:f, s:f}", "points", (json_int_t)t.n_points,
					      "samples", (json_int_t)t.n_samples, "within_10_percent", (json_int_t)t.n_within,
					      "refused", (json_int_t)t.n_refused, "least_ratio", t.least_ratio, "most_ratio",
					      t.most_ratio, "mean_ratio", t.mean_ratio, "rms_deviation", t.rms_deviation));
	else if (!t.n_points)
		printf("\nMonte Carlo: nowhere a position to try\n");
	else
		printf("\nMonte Carlo: %zu points x %zu samples through lens and triangulation, %.1f cameras a point: measured "
		       "over\nexpected error %.3f on average (%.3f to %.3f), %zu of %zu points within 10 %%, %zu samples "
		       "refused\n",
		       t.n_points, t.n_samples, t.cameras_mean, t.mean_ratio, t.least_ratio, t.most_ratio, t.n_within,
		       t.n_points, t.n_refused);
	return t.n_points && t.n_within == t.n_points && !t.n_refused ? BB_EXIT_OK : BB_EXIT_FAILED;
}

static int tell(const struct job *j)
{
	const bool json = bb_cli_has(j->cli, "json");
	json_t *root = json ? bb_cover_json(&j->cover, j->summary, j->told.of, j->told.n) : NULL;
	int code = BB_EXIT_OK;

	if (!json)
		bb_cover_print(&j->cover, j->summary, j->told.of, j->told.n, stdout);
	if (bb_cli_has(j->cli, "monte-carlo"))
		code = tell_trial(j, root);
	if (!json)
		return code;
	const int printed = bb_cli_print_json(root);
	return printed ? printed : code;
}

static enum bb_status read_options(struct job *j, struct bb_cover_wishes *w, struct bb_error *err)
{
	const char *at_least = bb_cli_get(j->cli, "at-least", NULL);
	enum bb_status status = bb_cover_wish(j->cli, 50, w, err);

	if (!status)
		status = bb_cover_body(j->cli, BB_COVERAGE_MEAN, &j->body, err);
	if (!status)
		status = read_levels(at_least ? at_least : LEVELS_USUAL, BB_COVER_LEVELS_MAX, &j->told, err);
	if (!status)
		status = read_levels(at_least ? at_least : PICTURES_USUAL, BB_COVER_LEVELS_MAX, &j->drawn, err);
	if (!status)
		status = bb_cli_number(j->cli, "height-m", 1.6, -100, 100, &j->height_m, err);
	if (!status)
		status = bb_cli_whole(j->cli, "seed", 1, 0, 9e15, &j->seed, err);
	j->drawn.n = j->drawn.n < BB_COVER_CLOUDS_MAX ? j->drawn.n : BB_COVER_CLOUDS_MAX;
	return status;
}

static enum bb_status measure(struct job *j, const struct bb_room *room, const struct bb_cover_wishes *w,
			      struct bb_error *err)
{
	enum bb_status status = bb_cover_begin(room, w, &j->cover, err);

	if (!status)
		status = bb_cover_run(&j->cover, err);
	for (int k = 0; k < BB_COVERAGE_BODIES && !status; k++)
		if (bb_cover_summarise(&j->cover, (enum bb_coverage_body)k, j->told.of, j->told.n, &j->summary[k]))
			status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a table");
	if (!status && bb_cli_has(j->cli, "out"))
		status = write_all(j, err);
	return status;
}

static int run(const struct bb_cli *cli)
{
	struct job j = { .cli = cli };
	struct bb_cover_wishes wishes;
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	enum bb_status status = read_options(&j, &wishes, &err);

	if (!status)
		status = bb_room_load(cli->arg[0], &room, &err);
	if (!status)
		status = measure(&j, room, &wishes, &err);
	const int code = status ? bb_cli_fail(status, &err) : tell(&j);
	bb_cover_end(&j.cover);
	bb_room_free(room);
	return code;
}

static const struct bb_cli_option options[] = {
	{ "voxel-mm", "MM", "edge of a voxel (50)" },
	{ "box", "X0:Y0:Z0:X1:Y1:Z1", "only this part, metres (the room's own box)" },
	{ "at-least", "N,...", "cameras to ask for (table 2,3,4,6,8; pictures 3,6,8, of a list the first four)" },
	{ "body", "none|mean|worst", "the viewer in the pictures: nobody, over all headings (mean), at the worst heading" },
	{ "headings", "N", "directions the viewer turns through (16)" },
	{ "marker-mm", "MM", "diameter of a marker (12)" },
	{ "least-px", "PX", "diameter its image must have (1)" },
	{ "noise-px", "PX", "of a blob's centre (as each camera has it)" },
	{ "height-m", "M", "of the level slice (1.6)" },
	{ "monte-carlo", NULL, "200 points x 1000 noisy samples through lens and triangulation against the expected error" },
	{ "seed", "N", "of the samples (1)" },
	{ "out", "DIR", "write clouds.png, slices.png, coverage.html and voxels.csv there" },
	{ "threads", "N", "as many as processors" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_coverage = { "track coverage", "say and draw where cameras see a marker, and how well",
						  "ROOM [--out DIR] [options]", options, 1, 1, run };
