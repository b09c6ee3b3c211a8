/*
 * hal/room/path.c: head and wand paths from text. See hal/scene.h. Seconds, metres and degrees in the file; ns, metres and
 * degrees in memory.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hal/file.h"
#include "hal/options.h"
#include "hal/rate.h"
#include "hal/scene.h"

#define KEYS_MAX 10000
#define SWAYS_MAX 16
#define AXES 6 /* x y z yaw pitch roll */
#define LINE_MAX_BYTES 256
#define TWO_PI 6.283185307179586

struct key {
	double t_s;
	double value[AXES];
	double slope[AXES]; /* per second */
};

struct sway {
	int axis;
	double amplitude, hz, phase;
};

struct bb_path {
	size_t n_keys, cap_keys, n_sways;
	struct key *keys;
	struct sway sways[SWAYS_MAX];
};

struct reader {
	const char *file;
	struct bb_error *err;
	int line;
	struct bb_path *path;
};

static const char *const axis_names[AXES] = { "x", "y", "z", "yaw", "pitch", "roll" };

/* --- reading ------------------------------------------------------------------------------------------------------ */

static enum bb_status number(const struct reader *rd, const char *word, const char *name, double least, double most,
                             double *out)
{
	const struct bb_option row[] = { { name, BB_OPT_TYPE_F64, 0, 0, 0, least, most, 1, NULL, false, NULL }, BB_OPT_END };
	const struct bb_where where = { rd->file, rd->line, 1 };

	return bb_options_set(row, out, name, word, &where, rd->err);
}

static enum bb_status add_sway(struct reader *rd, char *const word[], size_t n)
{
	const struct bb_where where = { rd->file, rd->line, 1 };
	struct bb_path *p = rd->path;
	struct sway s = { .axis = 0 };
	enum bb_status status;

	while (n == 4 && s.axis < AXES && strcmp(word[1], axis_names[s.axis]))
		s.axis++;
	if (n != 4 || s.axis == AXES)
		return bb_fail(rd->err, BB_ERR_CONFIG, 1350, &where, "wanted 'sway x|y|z|yaw|pitch|roll amplitude hz'");
	if (p->n_sways == SWAYS_MAX)
		return bb_fail(rd->err, BB_ERR_CONFIG, 1352, &where, "more than %d sways", SWAYS_MAX);
	status = number(rd, word[2], "amplitude", 0, 1000, &s.amplitude);
	if (!status)
		status = number(rd, word[3], "hz", 0, 50, &s.hz);
	if (status)
		return status;
	/* millimetres to metres; angles stay in degrees. The phases are spread so that sways do not add up at t = 0. */
	s.amplitude *= s.axis < 3 ? 1e-3 : 1;
	s.phase = TWO_PI * fmod(0.6180339887498949 * (double)p->n_sways, 1);
	p->sways[p->n_sways++] = s;
	return BB_OK;
}

static enum bb_status grow(struct reader *rd)
{
	struct bb_path *p = rd->path;
	const struct bb_where where = { rd->file, rd->line, 1 };
	const size_t cap = p->cap_keys ? 2 * p->cap_keys : 64;
	struct key *keys;

	if (p->n_keys == KEYS_MAX)
		return bb_fail(rd->err, BB_ERR_CONFIG, 1352, &where, "more than %d key poses", KEYS_MAX);
	if (p->n_keys < p->cap_keys)
		return BB_OK;
	keys = reallocarray(p->keys, cap, sizeof(*keys));
	if (!keys)
		return bb_fail(rd->err, BB_ERR_NOMEM, 1702, &where, "key poses");
	p->keys = keys;
	p->cap_keys = cap;
	return BB_OK;
}

/* Turn by the short way: 350 after 10 is -10. */
static void unwrap(struct key *k, const struct key *before)
{
	for (int a = 3; a < AXES; a++)
		k->value[a] -= 360 * round((k->value[a] - before->value[a]) / 360);
}

static enum bb_status add_key(struct reader *rd, char *const word[], size_t n)
{
	static const char *const names[1 + AXES] = { "t_s", "x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg" };
	static const double most[1 + AXES] = { 86400, 1000, 1000, 1000, 36000, 89, 180 };
	const struct bb_where where = { rd->file, rd->line, 1 };
	struct bb_path *p = rd->path;
	struct key k = { 0 };
	double v[1 + AXES];
	enum bb_status status;

	if (n != 1 + AXES)
		return bb_fail(rd->err, BB_ERR_CONFIG, 1350, &where, "%zu words, wanted %d numbers", n, 1 + AXES);
	for (int i = 0; i < 1 + AXES; i++) {
		status = number(rd, word[i], names[i], i ? -most[i] : 0, most[i], &v[i]);
		if (status)
			return status;
	}
	k.t_s = v[0];
	memcpy(k.value, v + 1, sizeof(k.value));
	if (p->n_keys && k.t_s < p->keys[p->n_keys - 1].t_s + 1e-6)
		return bb_fail(rd->err, BB_ERR_CONFIG, 1351, &where, "%g s after %g s", k.t_s, p->keys[p->n_keys - 1].t_s);
	status = grow(rd);
	if (status)
		return status;
	if (p->n_keys)
		unwrap(&k, &p->keys[p->n_keys - 1]);
	p->keys[p->n_keys++] = k;
	return BB_OK;
}

static enum bb_status read_line(struct reader *rd, const char *text, size_t n)
{
	const struct bb_where where = { rd->file, rd->line, 1 };
	char line[LINE_MAX_BYTES], *word[9], *save = NULL;
	size_t n_words = 0;

	if (n >= sizeof(line))
		return bb_fail(rd->err, BB_ERR_CONFIG, 1350, &where, "more than %d bytes", LINE_MAX_BYTES - 1);
	memcpy(line, text, n);
	line[n] = '\0';
	line[strcspn(line, "#")] = '\0';
	for (char *w = strtok_r(line, " \t\r", &save); w && n_words < BB_ARRAY_LEN(word); w = strtok_r(NULL, " \t\r", &save))
		word[n_words++] = w;
	if (!n_words)
		return BB_OK;
	return strcmp(word[0], "sway") ? add_key(rd, word, n_words) : add_sway(rd, word, n_words);
}

static enum bb_status read_lines(struct reader *rd, const char *text)
{
	enum bb_status status = BB_OK;

	while (*text && !status) {
		const size_t n = strcspn(text, "\n");
		rd->line++;
		status = read_line(rd, text, n);
		text += n + (text[n] == '\n');
	}
	if (!status && !rd->path->n_keys) {
		const struct bb_where where = { rd->file, rd->line, 1 };
		return bb_fail(rd->err, BB_ERR_CONFIG, 1352, &where, "no key pose");
	}
	return status;
}

/* --- monotone cubics ---------------------------------------------------------------------------------------------- */

static double secant(const struct key *k, int axis)
{
	return (k[1].value[axis] - k[0].value[axis]) / (k[1].t_s - k[0].t_s);
}

/*
 * Slopes at the keys by the weighted harmonic mean of the neighbouring secants (Fritsch and Butland), 0 at a turning
 * point and at both ends: within the region that Fritsch and Carlson prove monotone, and a path begins and ends at rest.
 */
static void set_slopes(struct bb_path *p)
{
	for (size_t i = 0; i < p->n_keys; i++)
		for (int a = 0; a < AXES; a++) {
			struct key *k = &p->keys[i];
			k->slope[a] = 0;
			if (i == 0 || i + 1 == p->n_keys)
				continue;
			const double before = secant(k - 1, a), after = secant(k, a);
			const double h0 = k->t_s - k[-1].t_s, h1 = k[1].t_s - k->t_s;
			if (before * after > 0)
				k->slope[a] = 3 * (h0 + h1) / ((2 * h1 + h0) / before + (h1 + 2 * h0) / after);
		}
}

static double hermite(const struct key *k, int axis, double t_s)
{
	const double h = k[1].t_s - k[0].t_s, u = (t_s - k[0].t_s) / h;
	const double rise = k[1].value[axis] - k[0].value[axis];
	const double m0 = h * k[0].slope[axis], m1 = h * k[1].slope[axis];

	return k[0].value[axis] + u * (m0 + u * (3 * rise - 2 * m0 - m1 + u * (m0 + m1 - 2 * rise)));
}

/* --- the public half ---------------------------------------------------------------------------------------------- */

enum bb_status bb_path_load(const char *file, struct bb_path **out, struct bb_error *err)
{
	struct reader rd = { .file = file, .err = err };
	enum bb_status status;
	char *text;
	size_t n;

	*out = NULL;
	status = bb_file_read(file, BB_TEXT_FILE_CAP_BYTES, &text, &n, err);
	if (status)
		return status;
	status = bb_file_check_text(file, text, n, err);
	rd.path = status ? NULL : calloc(1, sizeof(*rd.path));
	if (!status && !rd.path)
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a path");
	if (!status)
		status = read_lines(&rd, text);
	free(text);
	if (status) {
		bb_path_free(rd.path);
		return status;
	}
	set_slopes(rd.path);
	*out = rd.path;
	return BB_OK;
}

void bb_path_free(struct bb_path *path)
{
	if (!path)
		return;
	free(path->keys);
	free(path);
}

int64_t bb_path_duration_ns(const struct bb_path *path)
{
	return (int64_t)llround(path->keys[path->n_keys - 1].t_s * 1e9);
}

/* The last key at or before t, but never the very last: there is one after it. */
static size_t find(const struct bb_path *p, double t_s)
{
	size_t low = 0, high = p->n_keys - 1;

	while (high - low > 1) {
		const size_t mid = low + (high - low) / 2;
		if (p->keys[mid].t_s <= t_s)
			low = mid;
		else
			high = mid;
	}
	return low;
}

struct bb_pose bb_path_at(const struct bb_path *path, int64_t t_ns)
{
	const double first = path->keys[0].t_s, last = path->keys[path->n_keys - 1].t_s;
	const double t_s = fmin(fmax((double)t_ns * 1e-9, first), last);
	const struct key *k = &path->keys[path->n_keys > 1 ? find(path, t_s) : 0];
	double v[AXES];

	for (int a = 0; a < AXES; a++)
		v[a] = path->n_keys > 1 ? hermite(k, a, t_s) : k->value[a];
	for (size_t i = 0; i < path->n_sways; i++) {
		const struct sway *s = &path->sways[i];
		v[s->axis] += s->amplitude * sin(TWO_PI * fmod(s->hz * t_s, 1) + s->phase);
	}
	return (struct bb_pose){ { v[0], v[1], v[2] }, bb_quat_euler_deg(v[3], v[4], v[5]) };
}
