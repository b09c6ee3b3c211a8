#include "bench/phase/edges.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "hal/file.h"

#define TURN (2 * 3.14159265358979323846)
#ifdef BB_FUZZ
#define FILE_MOST ((size_t)1 << 13) /* less to take and give back for each input */
#else
#define FILE_MOST ((size_t)128 << 20)
#endif

struct edge {
	int64_t at_ns;
	uint16_t group;
};

struct list {
	const char *path;
	struct bb_phase_edges *out;
	size_t n, cap;
	struct edge *edge;
	struct bb_error *err;
	unsigned line;
};

/* --- reading ------------------------------------------------------------------------------------------------------ */

static enum bb_status bad(const struct list *l, const char *what)
{
	const struct bb_where where = { l->path, (int)l->line, 0 };

	return bb_fail(l->err, BB_ERR_CONFIG, 1613, &where, "%s", what);
}

/* The next field of a line, cut off; NULL: there is none. */
static char *field(char **rest)
{
	char *begin = *rest, *comma;

	if (!begin)
		return NULL;
	comma = strchr(begin, ',');
	*rest = comma ? comma + 1 : NULL;
	if (comma)
		*comma = 0;
	return begin;
}

static bool name_is_tame(const char *text, size_t cap)
{
	const size_t n = strlen(text);

	return n > 0 && n < cap && strspn(text, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.:-") == n;
}

static bool eye_of(const char *text, enum bb_eye *out)
{
	static const char *const words[] = { "NA", "left", "right" };

	for (int i = 0; i < 3; i++)
		if (!strcmp(text, words[i])) {
			*out = (enum bb_eye)i;
			return true;
		}
	return false;
}

static enum bb_status group_of(struct list *l, const char *track, enum bb_eye eye, const char *event, uint16_t *out)
{
	struct bb_phase_edges *e = l->out;

	for (size_t i = e->n_groups; i-- > 0;)
		if (e->group[i].eye == eye && !strcmp(e->group[i].track, track) && !strcmp(e->group[i].event, event)) {
			*out = (uint16_t)i;
			return BB_OK;
		}
	if (e->n_groups == BB_PHASE_GROUPS)
		return bad(l, "too many tracks");
	struct bb_phase_group *g = &e->group[e->n_groups];
	memset(g, 0, sizeof(*g));
	snprintf(g->track, sizeof(g->track), "%s", track);
	snprintf(g->event, sizeof(g->event), "%s", event);
	g->eye = eye;
	*out = (uint16_t)e->n_groups++;
	return BB_OK;
}

static enum bb_status add_line(struct list *l, char *line)
{
	char *rest = line, *t = field(&rest), *track = field(&rest), *eye = field(&rest), *event = field(&rest), *end;
	struct edge e = { 0 };
	enum bb_eye which;
	enum bb_status status;

	if (!event || rest || !*t)
		return bad(l, "not four fields");
	errno = 0;
	e.at_ns = strtoll(t, &end, 10);
	if (*end || errno || e.at_ns > INT64_MAX / 4 || e.at_ns < INT64_MIN / 4)
		return bad(l, "t_ns is no time");
	if (!name_is_tame(track, BB_PHASE_TEXT) || !name_is_tame(event, 16) || !eye_of(eye, &which))
		return bad(l, "a track, eye or event that cannot be");
	if (l->n == BB_PHASE_EDGES_MOST)
		return bad(l, "more than 2 million edges");
	status = group_of(l, track, which, event, &e.group);
	if (status)
		return status;
	if (l->n == l->cap) {
		const size_t cap = l->cap ? 2 * l->cap : 4096;
		struct edge *more = realloc(l->edge, cap * sizeof(*more));

		if (!more)
			return bb_fail(l->err, BB_ERR_NOMEM, 1702, NULL, "%zu edges", cap);
		l->edge = more;
		l->cap = cap;
	}
	l->edge[l->n++] = e;
	l->out->group[e.group].n++;
	return BB_OK;
}

static enum bb_status read_lines(struct list *l, char *text)
{
	enum bb_status status = BB_OK;

	for (char *line = text; line && *line && !status;) {
		char *end = strchr(line, '\n');

		l->line++;
		if (end)
			*end = 0;
		const size_t n = strlen(line);
		if (n && line[n - 1] == '\r')
			line[n - 1] = 0;
		if (l->line == 1)
			status = strcmp(line, "t_ns,track,eye,event") ? bad(l, "the first line is not t_ns,track,eye,event")
								      : BB_OK;
		else if (*line)
			status = add_line(l, line);
		line = end ? end + 1 : NULL;
	}
	return status;
}

/* --- folding ------------------------------------------------------------------------------------------------------ */

/* Where the plan has an edge; NAN: it does not say. */
static double planned(const struct bb_room *room, const struct bb_plan *p, const struct bb_phase_group *g)
{
	const double right = g->eye == BB_EYE_RIGHT ? p->period_us : 0;

	if (g->eye != BB_EYE_NONE && !strncmp(g->track, "vblank:", 7))
		return right;
	if (g->eye != BB_EYE_NONE && !strcmp(g->track, "glasses") && !strcmp(g->event, "open"))
		return fmod(p->timing.glasses_at_us + right + 4 * p->period_us, 2 * p->period_us);
	if (g->eye != BB_EYE_NONE && !strncmp(g->track, "shutter:", 8) && !strcmp(g->event, "open")) {
		const int w = bb_room_wall(room, g->track + 8);
		bool external = false;

		for (size_t i = 0; i < room->n_screens; i++)
			external |= room->screens[i].wall == w && room->screens[i].display.stereo == BB_STEREO_DUAL_PROJECTOR;
		return external ? fmod(p->timing.shutter_at_us + right + 4 * p->period_us, 2 * p->period_us) : (double)NAN;
	}
	for (size_t i = 0; i < p->n_cameras; i++)
		if (p->camera[i].locked && !strncmp(g->track, "strobe:", 7) && !strcmp(g->track + 7, p->camera[i].first))
			return fmod(p->camera[i].offset_us + p->camera[i].exposure_us / 2, p->period_us);
	return (double)NAN;
}

static int by_time(const void *a, const void *b)
{
	const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;

	return x < y ? -1 : x > y;
}

/* A wall's left pictures, or the left lens. */
static int reference(const struct bb_phase_edges *e)
{
	int lens = -1;

	for (size_t i = 0; i < e->n_groups; i++) {
		if (e->group[i].eye != BB_EYE_LEFT || e->group[i].n < 2)
			continue;
		if (!strncmp(e->group[i].track, "vblank:", 7))
			return (int)i;
		if (!strcmp(e->group[i].track, "glasses") && !strcmp(e->group[i].event, "open"))
			lens = (int)i;
	}
	return lens;
}

/* The newest of n sorted times at or before t; n: there is none. */
static size_t before(const int64_t *times, size_t n, int64_t t)
{
	size_t low = 0, high = n;

	while (low < high) {
		const size_t middle = (low + high) / 2;

		if (times[middle] <= t)
			low = middle + 1;
		else
			high = middle;
	}
	return low ? low - 1 : n;
}

/* The mean step in us, of steps that may have gaps: the median says how many cycles each one holds. */
static double mean_step(const int64_t *times, size_t n)
{
	int64_t *steps = n > 1 ? calloc(n, sizeof(*steps)) : NULL;
	const size_t middle = (n - 1) / 2;
	double cycles = 0, median;

	if (!steps)
		return 0;
	for (size_t i = 0; i + 1 < n; i++)
		steps[i] = times[i + 1] - times[i];
	qsort(steps, n - 1, sizeof(*steps), by_time);
	median = (double)steps[middle];
	for (size_t i = 0; i + 1 < n && median > 0; i++)
		cycles += round((double)steps[i] / median);
	free(steps);
	return cycles > 0 ? (double)(times[n - 1] - times[0]) / 1e3 / cycles : 0;
}

struct mean { /* on a circle */
	double sine, cosine;
	size_t n;
};

static double wrap(double us, double cycle)
{
	return us - cycle * floor(us / cycle + 0.5);
}

/* What belongs to no eye comes with every edge: its circle is half a cycle. */
static double circle(const struct bb_phase_edges *e, const struct bb_phase_group *g)
{
	return g->eye == BB_EYE_NONE ? e->cycle_us / 2 : e->cycle_us;
}

/* Place in its circle of an edge, or NAN where no cycle was under way. */
static double place(const struct list *l, const int64_t *begins, size_t n, const struct edge *edge)
{
	const struct bb_phase_edges *e = l->out;
	const size_t i = before(begins, n, edge->at_ns);
	const double us = i < n ? (double)(edge->at_ns - begins[i]) / 1e3 : (double)NAN;

	if (!(us < 1.5 * e->cycle_us))
		return (double)NAN;
	return fmod(us + e->reference_us + 2 * e->cycle_us, circle(e, &e->group[edge->group]));
}

static void fold(struct list *l, const int64_t *begins, size_t n)
{
	struct bb_phase_edges *e = l->out;
	struct mean mean[BB_PHASE_GROUPS] = { { 0 } };

	for (size_t i = 0; i < l->n; i++) {
		const double us = place(l, begins, n, &l->edge[i]);
		const double angle = us * TURN / circle(e, &e->group[l->edge[i].group]);
		struct mean *m = &mean[l->edge[i].group];

		if (isnan(us))
			continue;
		m->sine += sin(angle);
		m->cosine += cos(angle);
		m->n++;
	}
	for (size_t g = 0; g < e->n_groups; g++) {
		const double around = circle(e, &e->group[g]);

		e->group[g].n = mean[g].n;
		e->group[g].mean_us = fmod(atan2(mean[g].sine, mean[g].cosine) / TURN * around + around, around);
	}
	for (size_t i = 0; i < l->n; i++) {
		const double us = place(l, begins, n, &l->edge[i]);
		struct bb_phase_group *g = &e->group[l->edge[i].group];
		const double off = wrap(us - g->mean_us, circle(e, g));

		if (isnan(us))
			continue;
		g->least_us = fmin(g->least_us, off);
		g->most_us = fmax(g->most_us, off);
	}
}

static enum bb_status fold_all(struct list *l, const struct bb_room *room, const struct bb_plan *plan)
{
	struct bb_phase_edges *e = l->out;
	const int ref = reference(e);
	int64_t *begins = calloc(l->n + 1, sizeof(*begins));
	size_t n = 0;

	if (!begins || ref < 0) {
		free(begins);
		return begins ? bb_fail(l->err, BB_ERR_CONFIG, 1614, NULL, "%s", l->path)
			      : bb_fail(l->err, BB_ERR_NOMEM, 1702, NULL, "edges");
	}
	for (size_t i = 0; i < l->n; i++)
		if (l->edge[i].group == ref)
			begins[n++] = l->edge[i].at_ns;
	qsort(begins, n, sizeof(*begins), by_time);
	e->cycle_us = mean_step(begins, n);
	for (size_t i = 0; i < e->n_groups; i++)
		e->group[i].planned_us = planned(room, plan, &e->group[i]);
	snprintf(e->reference, sizeof(e->reference), "%s", e->group[ref].track);
	e->reference_us = isnan(e->group[ref].planned_us) ? 0 : e->group[ref].planned_us;
	if (e->cycle_us > 0)
		fold(l, begins, n);
	free(begins);
	return e->cycle_us > 0 ? BB_OK : bb_fail(l->err, BB_ERR_CONFIG, 1614, NULL, "%s: edges at one time", l->path);
}

enum bb_status bb_phase_edges_read(const char *path, const struct bb_room *room, const struct bb_plan *plan,
                                   struct bb_phase_edges *out, struct bb_error *err)
{
	struct list l = { .path = path, .out = out, .err = err };
	char *text;
	size_t n;
	enum bb_status status = bb_file_read(path, FILE_MOST, &text, &n, err);

	*out = (struct bb_phase_edges){ .n_groups = 0 };
	if (status)
		return status;
	if (strlen(text) != n) {
		l.line = 1;
		status = bad(&l, "not text");
	}
	if (!status)
		status = read_lines(&l, text);
	free(text);
	if (!status)
		status = fold_all(&l, room, plan);
	free(l.edge);
	return status;
}

bool bb_phase_loose(const struct bb_phase_edges *e, const struct bb_phase_group *g)
{
	return g->most_us - g->least_us > circle(e, g) / 4;
}

double bb_phase_off_us(const struct bb_phase_edges *e, const struct bb_phase_group *g)
{
	return wrap(g->mean_us - g->planned_us, circle(e, g));
}
