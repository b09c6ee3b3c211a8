/*
 * render/volume/raw.c: raw voxels beside a text header, NAME.hdr.txt, one `key: value` a line:
 *   file: voxels.raw          the plain name of a file in the header's own folder
 *   dims: 87 87 87            voxels along x (fastest), y, z
 *   type: u16                 u8 i8 i16 u16 i32 f32 f64
 *   byte_order: little        or big; default little
 *   steps: 5                  default 1
 *   spacing_mm: 1 1 2.5       default 1 1 1
 *   offset_bytes: 0           bytes before the first voxel, default 0
 *   spherical: 0.1 1.7 0 3.14 0 6.283185307179586
 *                             x, y, z are r, theta (from the pole) and phi, each from and to, angles in radians
 */
#include "render/volume/volume_private.h"

#include "render/text.h"
#include "render/volume/steps.h"

#include <stdio.h>
#include <string.h>

enum key { KEY_FILE, KEY_DIMS, KEY_TYPE, KEY_BYTE_ORDER, KEY_STEPS, KEY_SPACING, KEY_OFFSET, KEY_SPHERICAL, KEY_COUNT };

static const char *const key_text[KEY_COUNT] = { "file",  "dims",       "type",        "byte_order",
	                                         "steps", "spacing_mm", "offset_bytes", "spherical" };

struct raw_header {
	struct bb_layout layout;
	unsigned seen; /* bit per key */
	char file[256];
};

static int index_of(const char *word, const char *const *words, int n)
{
	for (int i = 0; i < n; i++)
		if (!strcmp(word, words[i]))
			return i;
	return -1;
}

/* Exactly n numbers within least..most; whole ones when asked. */
static enum bb_status numbers(char *value, int n, double least, double most, bool whole, double *out,
                              const struct bb_where *where, struct bb_error *err)
{
	double spare;

	for (int i = 0; i < n; i++) {
		if (bb_text_read_number(&value, &out[i]) != BB_TEXT_NUMBER)
			return bb_fail(err, BB_ERR_FORMAT, 1422, where, "%d number%s wanted", n, n > 1 ? "s" : "");
		if (!(out[i] >= least && out[i] <= most) || (whole && out[i] != (double)(int64_t)out[i]))
			return bb_fail(err, BB_ERR_FORMAT, 1422, where, "%g is not %s within %g .. %g", out[i],
			               whole ? "a whole number" : "a number", least, most);
	}
	if (bb_text_read_number(&value, &spare) != BB_TEXT_END)
		return bb_fail(err, BB_ERR_FORMAT, 1422, where, "more than %d number%s", n, n > 1 ? "s" : "");
	return BB_OK;
}

static enum bb_status set_file(struct raw_header *h, const char *value, const struct bb_where *where,
                               struct bb_error *err)
{
	if (strchr(value, '/') || !strcmp(value, "..") || !strcmp(value, "."))
		return bb_fail(err, BB_ERR_CONFIG, 1424, where, "`%.100s` is not a plain file name", value);
	if (strlen(value) >= sizeof(h->file))
		return bb_fail(err, BB_ERR_FORMAT, 1422, where, "the file's name is too long");
	memcpy(h->file, value, strlen(value) + 1);
	return BB_OK;
}

static enum bb_status set_word(struct raw_header *h, enum key key, const char *value, const struct bb_where *where,
                               struct bb_error *err)
{
	static const char *const types[BB_VOXEL_TYPES] = { "u8", "i8", "i16", "u16", "i32", "f32", "f64" };
	static const char *const orders[] = { "little", "big" };
	const int i = key == KEY_TYPE ? index_of(value, types, BB_VOXEL_TYPES) : index_of(value, orders, 2);

	if (i < 0)
		return bb_fail(err, BB_ERR_FORMAT, 1422, where, "%s cannot be `%.32s`", key_text[key], value);
	if (key == KEY_TYPE)
		h->layout.type = (enum bb_voxel_type)i;
	else
		h->layout.big_endian = i == 1;
	return BB_OK;
}

bool bb_steps_extent_is_sane(const double e[6])
{
	const bool r = e[0] >= 0 && e[1] > e[0] && e[1] <= 1e12, theta = e[2] >= 0 && e[3] > e[2] && e[3] < 3.1416;

	return r && theta && e[4] >= -10 && e[4] <= 10 && e[5] > e[4] && e[5] - e[4] < 6.2833;
}

static enum bb_status set_spherical(struct bb_layout *l, char *value, const struct bb_where *where,
                                    struct bb_error *err)
{
	const enum bb_status status = numbers(value, 6, -1e12, 1e12, false, l->extent, where, err);

	if (status)
		return status;
	if (!bb_steps_extent_is_sane(l->extent))
		return bb_fail(err, BB_ERR_FORMAT, 1422, where, "no such part of a sphere");
	l->spherical = true;
	return BB_OK;
}

static enum bb_status set(struct raw_header *h, enum key key, char *value, const struct bb_where *where,
                          struct bb_error *err)
{
	struct bb_layout *l = &h->layout;
	double v[3] = { 0 };
	enum bb_status status = BB_OK;

	switch (key) {
	case KEY_FILE:
		return set_file(h, value, where, err);
	case KEY_TYPE:
	case KEY_BYTE_ORDER:
		return set_word(h, key, value, where, err);
	case KEY_DIMS:
		status = numbers(value, 3, 1, 1e9, true, v, where, err);
		for (int i = 0; i < 3 && !status; i++)
			l->dim[i] = (int64_t)v[i];
		return status;
	case KEY_STEPS:
		status = numbers(value, 1, 1, 1e9, true, v, where, err);
		l->n_steps = status ? 0 : (int64_t)v[0];
		return status;
	case KEY_SPACING:
		return numbers(value, 3, 1e-6, 1e6, false, l->spacing_mm, where, err);
	case KEY_OFFSET:
		status = numbers(value, 1, 0, 1e12, true, v, where, err);
		l->offset_bytes = status ? 0 : (uint64_t)v[0];
		return status;
	case KEY_SPHERICAL:
		return set_spherical(l, value, where, err);
	case KEY_COUNT:
		break;
	}
	return BB_ERR_INTERNAL;
}

static enum bb_status read_line(struct raw_header *h, char *line, const struct bb_where *where, struct bb_error *err)
{
	char *colon = strchr(line, ':');

	if (!colon || colon == line)
		return bb_fail(err, BB_ERR_FORMAT, 1420, where, "`%.60s`", line);
	*colon = '\0';
	const int key = index_of(line, key_text, KEY_COUNT);
	if (key < 0)
		return bb_fail(err, BB_ERR_FORMAT, 1421, where, "`%.60s` is no key", line);
	if (h->seen & 1u << key)
		return bb_fail(err, BB_ERR_FORMAT, 1421, where, "`%s` is given twice", line);
	h->seen |= 1u << key;
	char *value = colon + 1 + strspn(colon + 1, " \t");
	if (!*value)
		return bb_fail(err, BB_ERR_FORMAT, 1422, where, "`%s` has no value", line);
	return set(h, (enum key)key, value, where, err);
}

static enum bb_status read_header(const char *path, struct raw_header *h, struct bb_error *err)
{
	struct bb_text text;
	enum bb_status status = bb_text_open(path, 1425, &text, err);
	char *line;

	while (!status && (line = bb_text_next(&text)))
		status = read_line(h, line, &text.where, err);
	text.where.line = 0;
	for (int key = KEY_FILE; key <= KEY_TYPE && !status; key++)
		if (!(h->seen & 1u << key))
			status = bb_fail(err, BB_ERR_FORMAT, 1423, &text.where, "`%s`", key_text[key]);
	bb_text_release(&text);
	return status;
}

enum bb_status bb_raw_layout(const char *path, struct bb_layout *out, char voxels[BB_PATH_MAX_BYTES],
                             struct bb_error *err)
{
	struct raw_header h = { .layout = { .n_steps = 1, .spacing_mm = { 1, 1, 1 }, .slope = 1 } };
	const enum bb_status status = read_header(path, &h, err);

	if (status)
		return status;
	const char *slash = strrchr(path, '/');
	const int folder = slash ? (int)(slash - path) + 1 : 0;
	if (snprintf(voxels, BB_PATH_MAX_BYTES, "%.*s%s", folder, path, h.file) >= BB_PATH_MAX_BYTES)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &(struct bb_where){ path, 0, 0 }, "the path is too long");
	*out = h.layout;
	return BB_OK;
}

enum bb_status bb_volume_load_raw(const char *path, uint64_t cap_bytes, struct bb_volume **out, struct bb_error *err)
{
	char voxels[BB_PATH_MAX_BYTES];
	struct bb_layout layout;
	struct bb_bytes bytes;
	enum bb_status status = bb_raw_layout(path, &layout, voxels, err);

	if (!status)
		status = bb_bytes_open(voxels, BB_BYTES_NO_LINK, &bytes, err);
	if (status)
		return status;
	status = bb_volume_decode(&bytes, &layout, cap_bytes, out, err);
	bb_bytes_close(&bytes);
	return status;
}
