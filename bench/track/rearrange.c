#include "bench/track/rearrange.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/file.h"
#include "render/parallel.h"
#include "render/text.h"

#define TELL_M 1e-3 /* a camera hangs where the file says, to the millimetre */

/* ---- rails ---- */

static bool read_rail(char *line, struct bb_rail *out)
{
	double v[6], more;

	for (int i = 0; i < 6; i++)
		if (bb_text_read_number(&line, &v[i]) != BB_TEXT_NUMBER || !(fabs(v[i]) <= 1000))
			return false;
	out->a = (struct bb_vec3){ v[0], v[1], v[2] };
	out->b = (struct bb_vec3){ v[3], v[4], v[5] };
	return bb_text_read_number(&line, &more) == BB_TEXT_END && bb_vec3_norm(bb_vec3_sub(out->a, out->b)) > 1e-3;
}

enum bb_status bb_rails_load(const char *path, struct bb_rails *out, struct bb_error *err)
{
	struct bb_text text;
	enum bb_status status = bb_text_open(path, 1756, &text, err);
	char *line;

	out->n = 0;
	if (status)
		return status;
	while (!status && (line = bb_text_next(&text)) != NULL) {
		if (out->n == BB_RAILS_MAX)
			status = bb_fail(err, BB_ERR_FORMAT, 1756, &text.where, "more than %d rails", BB_RAILS_MAX);
		else if (!read_rail(line, &out->rail[out->n++]))
			status = bb_fail(err, BB_ERR_FORMAT, 1756, &text.where, "not six numbers, two points apart");
	}
	if (!status && !out->n)
		status = bb_fail(err, BB_ERR_FORMAT, 1756, &text.where, "no rail in it");
	bb_text_release(&text);
	return status;
}

/* ---- tries ---- */

struct tries {
	const struct bb_place_config *config;
	struct bb_placed *placed;
	enum bb_status *status;
};

static void one_try(void *ctx, size_t i, unsigned thread)
{
	struct tries *t = ctx;

	(void)thread;
	t->status[i] = bb_place_try(t->config, (unsigned)i, &t->placed[i]);
}

enum bb_status bb_rearrange(const struct bb_place_config *config, unsigned tries, unsigned threads,
			    struct bb_placed *out, struct bb_error *err)
{
	struct tries t = { config, calloc(tries, sizeof(*t.placed)), calloc(tries, sizeof(*t.status)) };
	enum bb_status status = t.placed && t.status ? BB_OK : BB_ERR_NOMEM;
	size_t best = 0;

	if (!status)
		bb_parallel(threads, tries, one_try, &t);
	for (size_t i = 0; i < tries && !status; i++) {
		status = t.status[i];
		if (!status && t.placed[i].apart >= t.placed[best].apart &&
		    (t.placed[i].apart > t.placed[best].apart || t.placed[i].reached > t.placed[best].reached))
			best = i;
	}
	if (!status)
		*out = t.placed[best];
	free(t.placed);
	free(t.status);
	if (status == BB_ERR_NOMEM)
		return bb_fail(err, status, 1702, NULL, "%u tries", tries);
	if (status)
		return bb_fail(err, status, 1757, NULL, "%zu rails, a grid of %g mm", config->n_rails, 1e3 * config->step_m);
	if (!out->apart)
		return bb_fail(err, BB_ERR_CONFIG, 1757, NULL, "the rails have no room for %zu cameras %g mm apart",
			       config->cover.n_cameras, 1e3 * config->apart_m);
	return BB_OK;
}

/* ---- files ---- */

void bb_rearranged_print(const struct bb_camera_config *cameras, size_t n, FILE *f)
{
	fputs("cameras:                         # as `track place` hung them\n", f);
	for (size_t i = 0; i < n; i++) {
		const struct bb_vec3 p = cameras[i].pose.p, at = bb_pose_apply(&cameras[i].pose, (struct bb_vec3){ 0, 0, 1.5 });
		fprintf(f, "  - {id: %s, position_m: [%.4f, %.4f, %.4f], look_at_m: [%.4f, %.4f, %.4f]}\n", cameras[i].id, p.x,
			p.y, p.z, at.x, at.y, at.z);
	}
}

static const char *next_line(const char *at)
{
	const char *end = strchr(at, '\n');

	return end ? end + 1 : at + strlen(at);
}

/* From the key at the line's beginning to the next one; blank lines and comments before that belong to it. */
static bool find_block(const char *text, const char **begin, const char **end)
{
	for (*begin = text; **begin && strncmp(*begin, "cameras:", 8) != 0;)
		*begin = next_line(*begin);
	*end = *begin;
	if (!**begin)
		return false;
	*end = next_line(*begin);
	for (const char *at = *end; *at && (strchr(" \t\n\r-#", *at) != NULL); at = next_line(at))
		if (*at == ' ' || *at == '\t' || *at == '-')
			*end = next_line(at);
	return true;
}

static bool same(double a, double b)
{
	return fabs(a - b) <= 1e-9 * fmax(1, fabs(a));
}

static bool same_camera(const struct bb_camera_config *a, const struct bb_camera_config *b)
{
	const double x[] = { a->fx_px, a->fy_px, a->cx_px, a->cy_px, a->k1, a->k2, a->k3, a->k4, a->p1, a->p2, a->sync_offset_us,
			     a->exposure_us, a->readout_us, a->row_us, a->transfer_us, a->transfer_jitter_us, a->noise_px };
	const double y[] = { b->fx_px, b->fy_px, b->cx_px, b->cy_px, b->k1, b->k2, b->k3, b->k4, b->p1, b->p2, b->sync_offset_us,
			     b->exposure_us, b->readout_us, b->row_us, b->transfer_us, b->transfer_jitter_us, b->noise_px };

	for (size_t i = 0; i < BB_ARRAY_LEN(x); i++)
		if (!same(x[i], y[i]))
			return false;
	return !strcmp(a->id, b->id) && !strcmp(a->device, b->device) && a->width_px == b->width_px &&
	       a->height_px == b->height_px && a->lens == b->lens && a->rate.num == b->rate.num &&
	       a->rate.den == b->rate.den && a->sync == b->sync &&
	       bb_vec3_norm(bb_vec3_sub(a->pose.p, b->pose.p)) < TELL_M && bb_quat_angle(a->pose.q, b->pose.q) < TELL_M;
}

static enum bb_status check(const char *part, const char *path, const struct bb_camera_config *cameras, size_t n,
			    struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	struct bb_room *room;
	enum bb_status status = bb_room_load(part, &room, err);

	if (status)
		return status;
	if (room->n_cameras != n)
		status = bb_fail(err, BB_ERR_CONFIG, 1758, &where, "it would have %zu cameras, not %zu", room->n_cameras, n);
	for (size_t i = 0; i < n && !status; i++)
		if (!same_camera(&room->cameras[i], &cameras[i]))
			status = bb_fail(err, BB_ERR_CONFIG, 1758, &where, "camera/%s", cameras[i].id);
	bb_room_free(room);
	return status;
}

enum bb_status bb_rearranged_write(const struct bb_room *room, const struct bb_camera_config *cameras, size_t n,
				   const char *path, struct bb_error *err)
{
	const char *begin, *end;
	struct bb_file file;
	char *text;
	size_t size;
	enum bb_status status = bb_file_read(room->path, BB_TEXT_FILE_CAP_BYTES, &text, &size, err);

	if (!status)
		status = bb_file_begin(&file, path, err);
	if (status) {
		free(text);
		return status;
	}
	const bool found = find_block(text, &begin, &end);
	fwrite(text, 1, (size_t)(begin - text), file.out);
	if (!found)
		fputc('\n', file.out);
	bb_rearranged_print(cameras, n, file.out);
	fputs(end, file.out);
	free(text);
	if (ferror(file.out) || fflush(file.out))
		return bb_file_commit(&file, err); /* it says why it cannot */
	status = check(file.part, path, cameras, n, err);
	if (!status)
		return bb_file_commit(&file, err);
	bb_file_abort(&file);
	return status;
}
