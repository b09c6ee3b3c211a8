/* sync/calibrate/sequence.c: see sequence.h. */
#include "sync/calibrate/sequence.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/file.h"
#include "hal/hash.h"

#define HEAD "# blackburst wand 1"

/* A sequence */

void bb_sequence_defaults(struct bb_sequence *s)
{
	static const double along_m[3] = { 0, 0.15, 0.4 };
	static const struct bb_vec3 square[4] = { { 0, 0, 0 }, { 0.3, 0, 0 }, { 0, 0, -0.16 }, { 0, 0, -0.4 } };

	memset(s, 0, sizeof(*s));
	memcpy(s->along_m, along_m, sizeof(along_m));
	memcpy(s->square, square, sizeof(square));
}

enum bb_status bb_sequence_add_camera(struct bb_sequence *s, const char *id)
{
	if (s->n_cameras == BB_SEQUENCE_CAMERAS_MAX)
		return BB_ERR_RANGE;
	char (*ids)[BB_ID_MAX] = realloc(s->ids, (s->n_cameras + 1) * sizeof(*ids));
	if (!ids)
		return BB_ERR_NOMEM;
	s->ids = ids;
	snprintf(s->ids[s->n_cameras++], BB_ID_MAX, "%s", id);
	return BB_OK;
}

static bool grow(void *array_ptr, size_t size, size_t *cap, size_t want)
{
	void **array = array_ptr;

	if (want <= *cap)
		return true;
	const size_t more = want > 2 * *cap ? want + 1024 : 2 * *cap;
	void *bigger = realloc(*array, more * size);
	if (!bigger)
		return false;
	*array = bigger;
	*cap = more;
	return true;
}

enum bb_status bb_sequence_add(struct bb_sequence *s, int64_t t_ns, uint16_t camera, bool square, const float (*px)[2],
                               size_t n)
{
	if (s->n_sights == BB_SEQUENCE_LINES_MAX || n > BB_SEQUENCE_BLOBS_MAX)
		return BB_ERR_RANGE;
	if (!grow(&s->sights, sizeof(*s->sights), &s->cap_sights, s->n_sights + 1) ||
	    !grow(&s->px, sizeof(*s->px), &s->cap_px, s->n_px + n))
		return BB_ERR_NOMEM;
	s->sights[s->n_sights++] = (struct bb_sequence_sight){ t_ns, (uint32_t)s->n_px, (uint16_t)n, camera, square };
	if (n)
		memcpy(s->px + s->n_px, px, n * sizeof(*px));
	s->n_px += n;
	return BB_OK;
}

void bb_sequence_free(struct bb_sequence *s)
{
	free(s->ids);
	free(s->sights);
	free(s->px);
	memset(s, 0, sizeof(*s));
}

/* The file */

struct reading {
	struct bb_sequence *s;
	bool has_wand, has_square, in_part, square;
	int64_t last_ns[2]; /* of the square, of the wand */
};

static const char *take_wand(struct reading *r, const struct bb_sequence_line *l)
{
	const double a = l->number[0], b = l->number[1], c = l->number[2];

	if (r->has_wand)
		return "a second wand_mm";
	if (a != 0 || !(b > 0.02 && c > b + 0.02 && c < 5))
		return "three places on a wand ascend from 0, 20 mm apart or more";
	if (!(b < 0.45 * c))
		return "the middle marker of a wand is nearer to the first: its ends could not be told apart else";
	memcpy(r->s->along_m, l->number, 3 * sizeof(double));
	r->has_wand = true;
	return NULL;
}

static const char *take_square(struct reading *r, const struct bb_sequence_line *l)
{
	struct bb_vec3 *p = r->s->square;

	if (r->has_square)
		return "a second square_mm";
	for (int i = 0; i < 4; i++)
		p[i] = (struct bb_vec3){ l->number[3 * i], l->number[3 * i + 1], l->number[3 * i + 2] };
	const struct bb_vec3 arm = bb_vec3_sub(p[3], p[0]), mid = bb_vec3_sub(p[2], p[0]), side = bb_vec3_sub(p[1], p[0]);
	const double far = bb_vec3_norm(arm), at = far > 0 ? bb_vec3_dot(mid, arm) / (far * far) : 0;
	if (!(far > 0.05) || !(bb_vec3_norm(bb_vec3_cross(mid, arm)) < 0.002 * far) || !(at > 0.2 && at < 0.45))
		return "the long arm of a square: corner, middle at 20 to 45 % of it, end, on a line of 50 mm or more";
	if (!(bb_vec3_norm(bb_vec3_cross(side, arm)) > 0.05 * far))
		return "the short arm of a square ends 50 mm or more off the long one";
	r->has_square = true;
	return NULL;
}

static const char *take_sight(struct reading *r, const struct bb_sequence_line *l, enum bb_status *status)
{
	int64_t *last_ns = &r->last_ns[!r->square];
	size_t camera = 0;

	if (!r->in_part)
		return "a frame before `part square` or `part wand`";
	while (camera < r->s->n_cameras && strcmp(r->s->ids[camera], l->id) != 0)
		camera++;
	if (camera == r->s->n_cameras)
		return "a camera that no line `camera ID` names";
	if (l->t_ns < *last_ns - BB_SEQUENCE_TOGETHER_NS)
		return "time goes back";
	*last_ns = l->t_ns > *last_ns ? l->t_ns : *last_ns;
	*status = bb_sequence_add(r->s, l->t_ns, (uint16_t)camera, r->square, l->px, l->n);
	return *status == BB_ERR_RANGE ? "more than 4 million lines" : NULL;
}

static const char *take(struct reading *r, const struct bb_sequence_line *l, enum bb_status *status)
{
	switch (l->kind) {
	case BB_SEQUENCE_WAND:
		return take_wand(r, l);
	case BB_SEQUENCE_SQUARE:
		return take_square(r, l);
	case BB_SEQUENCE_CAMERA:
		for (size_t i = 0; i < r->s->n_cameras; i++)
			if (!strcmp(r->s->ids[i], l->id))
				return "the same camera twice";
		*status = bb_sequence_add_camera(r->s, l->id);
		return *status == BB_ERR_RANGE ? "more than 256 cameras" : NULL;
	case BB_SEQUENCE_PART_SQUARE:
	case BB_SEQUENCE_PART_WAND:
		r->in_part = true;
		r->square = l->kind == BB_SEQUENCE_PART_SQUARE;
		return NULL;
	case BB_SEQUENCE_SIGHT:
		return take_sight(r, l, status);
	default:
		return NULL;
	}
}

enum bb_status bb_sequence_parse(const char *text, size_t n, const char *path, struct bb_sequence *out, struct bb_error *err)
{
	struct bb_where where = { path, 1, 0 };
	struct reading r = { .s = out };
	const char *at = text, *end = text + n;
	enum bb_status status = BB_OK;

	memset(out, 0, sizeof(*out));
	if (n < strlen(HEAD) || memcmp(text, HEAD, strlen(HEAD)) != 0)
		return bb_fail(err, BB_ERR_CONFIG, 1730, &where, "the first line is not '%s'", HEAD);
	for (; at < end && !status; where.line++) {
		const char *stop = memchr(at, '\n', (size_t)(end - at));
		struct bb_sequence_line line;
		const char *wrong = stop ? bb_sequence_line(at, (size_t)(stop - at), &line) : "the line has no end: cut short?";
		if (!wrong)
			wrong = take(&r, &line, &status);
		if (wrong)
			status = bb_fail(err, BB_ERR_CONFIG, 1731, &where, "%s", wrong);
		else if (status)
			status = bb_fail(err, status, 1702, &where, "%zu lines", out->n_sights);
		at = stop ? stop + 1 : end;
	}
	if (!status && (!r.has_wand || !r.has_square || !out->n_cameras || !out->n_sights))
		status = bb_fail(err, BB_ERR_CONFIG, 1731, &where, "wand_mm, square_mm, cameras or frames are missing");
	if (status)
		bb_sequence_free(out);
	else
		bb_hash_bytes(text, n, out->sha256);
	return status;
}

enum bb_status bb_sequence_read(const char *path, struct bb_sequence *out, struct bb_error *err)
{
	char *text = NULL;
	size_t n = 0;

	memset(out, 0, sizeof(*out));
	enum bb_status status = bb_file_read(path, BB_SEQUENCE_BYTES_MAX, &text, &n, err);
	if (!status)
		status = bb_sequence_parse(text, n, path, out, err);
	free(text);
	return status;
}
