#include "bench/trade/grid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TOLERANT "colour-histogram"

/* ---- usual values ---- */

static void usual_budgets(struct bb_trade_grid *g, double complete_mib)
{
	static const double around[] = { 0.25, 0.5, 2, 4 };
	const bool memory = g->own.memory_mib > 0, stream = g->own.bricks_per_frame > 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(around); i++) {
		g->memory_mib[i] = memory ? g->own.memory_mib * around[i] : complete_mib / (double)(4U << i);
		g->stream[i] = stream ? (uint32_t)fmax(1, g->own.bricks_per_frame * around[i]) : 4U << (2 * i);
	}
	g->memory_mib[4] = 0;
	g->stream[4] = 0;
	g->n[BB_KNOB_MEMORY] = g->n[BB_KNOB_STREAM] = 5;
}

void bb_trade_grid_usual(struct bb_trade_grid *g, const struct bb_trade_setting *own, bool rebuilds, double complete_mib)
{
	static const char *const selectors[] = { "leaf", "opacity", "child", "uniform" };
	static const double steps[] = { 0.5, 1, 2, 4 }, tolerances[] = { 0.01, 0.03, 0.1, 0.3 };
	static const uint32_t bricks[] = { 8, 16, 32 };

	*g = (struct bb_trade_grid){ .own = *own };
	usual_budgets(g, complete_mib);
	memcpy(g->step, steps, sizeof(steps));
	memcpy(g->tolerance, tolerances, sizeof(tolerances));
	g->n[BB_KNOB_STEP] = BB_ARRAY_LEN(steps);
	g->n[BB_KNOB_TOLERANCE] = BB_ARRAY_LEN(tolerances);
	for (size_t i = 0; i < BB_ARRAY_LEN(selectors); i++)
		g->selector[g->n[BB_KNOB_SELECTOR]++] = bb_selector_find(selectors[i]);
	for (size_t i = 0; i < BB_ARRAY_LEN(bricks) && rebuilds; i++)
		g->brick[g->n[BB_KNOB_BRICK]++] = bricks[i];
	for (int i = 0; i < BB_BRICK_TYPES && rebuilds; i++)
		g->type[g->n[BB_KNOB_TYPE]++] = (enum bb_brick_type)i;
	if (rebuilds)
		return;
	g->brick[0] = own->brick;
	g->type[0] = own->type;
	g->n[BB_KNOB_BRICK] = g->n[BB_KNOB_TYPE] = 1;
}

/* ---- values from text ---- */

static bool read_number(const char *word, double least, double most, double *out)
{
	char *end;

	if (strspn(word, "0123456789+-.eE") != strlen(word) || !*word)
		return false;
	*out = strtod(word, &end);
	return !*end && *out >= least && *out <= most;
}

static bool read_budget(const char *word, double least, double most, double *out)
{
	*out = 0;
	return !strcmp(word, "all") || read_number(word, least, most, out);
}

static bool read_type(const char *word, enum bb_brick_type *out)
{
	for (*out = 0; *out < BB_BRICK_TYPES; ++*out)
		if (!strcmp(word, bb_brick_type_text(*out)))
			return true;
	return false;
}

/* "leaf", "leaf!": as algorithm 1 has it, for one step and no view, read at once. */
static bool read_selector(const char *word, const struct bb_selector **out, bool *at_once)
{
	const size_t n = strlen(word);
	char name[40];

	*at_once = n && word[n - 1] == '!';
	snprintf(name, sizeof(name), "%.*s", (int)(*at_once ? n - 1 : n), word);
	*out = bb_selector_find(name);
	return *out != NULL;
}

static bool read_word(struct bb_trade_grid *g, enum bb_trade_knob knob, const char *word)
{
	const size_t i = g->n[knob];
	double v = 0;
	bool ok = false;

	switch (knob) {
	case BB_KNOB_MEMORY:
		return read_budget(word, 1e-3, 1e6, &g->memory_mib[i]);
	case BB_KNOB_STREAM:
		ok = read_budget(word, 1, 1e9, &v);
		g->stream[i] = (uint32_t)v;
		return ok;
	case BB_KNOB_SELECTOR:
		return read_selector(word, &g->selector[i], &g->at_once[i]);
	case BB_KNOB_TOLERANCE:
		return read_number(word, 0, 1e9, &g->tolerance[i]);
	case BB_KNOB_STEP:
		return read_number(word, 1.0 / 16, 64, &g->step[i]);
	case BB_KNOB_BRICK:
		ok = read_number(word, 4, 64, &v) && !(fabs(v / 2 - floor(v / 2)) > 0);
		g->brick[i] = (uint32_t)v;
		return ok;
	case BB_KNOB_TYPE:
		return read_type(word, &g->type[i]);
	default:
		return false;
	}
}

enum bb_status bb_trade_grid_read(struct bb_trade_grid *g, enum bb_trade_knob knob, const char *text,
				  struct bb_error *err)
{
	char word[40];

	for (g->n[knob] = 0;; text++) {
		const size_t n = strcspn(text, ",");
		if (n && n < sizeof(word) && g->n[knob] < BB_GRID_VALUES_MOST) {
			memcpy(word, text, n);
			word[n] = '\0';
		}
		if (!n || n >= sizeof(word) || g->n[knob] == BB_GRID_VALUES_MOST || !read_word(g, knob, word))
			return bb_fail(err, BB_ERR_USAGE, 1481, NULL, "--%s: '%.*s'", bb_trade_knob_text(knob),
				       n < 40 ? (int)n : 40, text);
		g->n[knob]++;
		text += n;
		if (!*text)
			return BB_OK;
	}
}

/* ---- settings ---- */

struct list {
	struct bb_trade_item *item;
	size_t n, cap;
	bool full; /* no memory, or too many */
};

static bool differ(double a, double b)
{
	return fabs(a - b) > 0;
}

/* As far as it matters to this selector. */
static bool same(const struct bb_trade_setting *a, const struct bb_trade_setting *b)
{
	if (a->selector != b->selector || a->at_once != b->at_once || differ(a->step_voxels, b->step_voxels) || a->brick != b->brick ||
	    a->type != b->type)
		return false;
	if (a->selector->by_tolerance)
		return !differ(a->tolerance, b->tolerance);
	return !differ(a->memory_mib, b->memory_mib) && a->bricks_per_frame == b->bricks_per_frame;
}

static void add(struct list *l, const struct bb_trade_setting *s, enum bb_trade_knob knob)
{
	for (size_t i = 0; i < l->n; i++)
		if (same(&l->item[i].setting, s))
			return;
	if (l->n == l->cap) {
		const size_t cap = l->cap ? 2 * l->cap : 64;
		struct bb_trade_item *more = l->n < BB_GRID_POINTS_MOST ? realloc(l->item, cap * sizeof(*more)) : NULL;
		if (!more) {
			l->full = true;
			return;
		}
		l->item = more;
		l->cap = cap;
	}
	l->item[l->n++] = (struct bb_trade_item){ *s, knob };
}

/* The i-th value of a knob in a setting. A tolerance means a selector by tolerance. */
static void turn(const struct bb_trade_grid *g, enum bb_trade_knob knob, size_t i, struct bb_trade_setting *s)
{
	switch (knob) {
	case BB_KNOB_MEMORY:
		s->memory_mib = g->memory_mib[i];
		break;
	case BB_KNOB_STREAM:
		s->bricks_per_frame = g->stream[i];
		break;
	case BB_KNOB_SELECTOR:
		s->selector = g->selector[i];
		s->at_once = g->at_once[i];
		break;
	case BB_KNOB_TOLERANCE:
		s->tolerance = g->tolerance[i];
		break;
	case BB_KNOB_STEP:
		s->step_voxels = g->step[i];
		break;
	case BB_KNOB_BRICK:
		s->brick = g->brick[i];
		break;
	case BB_KNOB_TYPE:
		s->type = g->type[i];
		break;
	case BB_KNOB_NONE:
		break;
	}
}

static void one_by_one(const struct bb_trade_grid *g, struct list *l)
{
	add(l, &g->own, BB_KNOB_NONE);
	for (enum bb_trade_knob knob = 0; knob < BB_KNOBS; knob++)
		for (size_t i = 0; i < g->n[knob]; i++) {
			struct bb_trade_setting s = g->own;
			turn(g, knob, i, &s);
			if (knob == BB_KNOB_TOLERANCE && !s.selector->by_tolerance)
				s.selector = bb_selector_find(TOLERANT);
			if (knob != BB_KNOB_SELECTOR || !s.selector->by_tolerance)
				add(l, &s, knob);
			for (size_t k = 0; k < g->n[BB_KNOB_TOLERANCE] && knob == BB_KNOB_SELECTOR && s.selector->by_tolerance;
			     k++) {
				turn(g, BB_KNOB_TOLERANCE, k, &s);
				add(l, &s, knob);
			}
		}
}

/* Counts through all values as a mileage does. */
static void all_of_them(const struct bb_trade_grid *g, struct list *l)
{
	size_t at[BB_KNOBS] = { 0 };
	int knob;

	add(l, &g->own, BB_KNOB_NONE);
	do {
		struct bb_trade_setting s = g->own;
		enum bb_trade_knob differs = BB_KNOB_NONE;
		for (knob = 0; knob < BB_KNOBS; knob++)
			turn(g, (enum bb_trade_knob)knob, at[knob], &s);
		differs = s.selector != g->own.selector ? BB_KNOB_SELECTOR : BB_KNOB_MEMORY;
		/* What a selector does not know of is not another setting. */
		if (s.selector->by_tolerance || !strcmp(s.selector->name, "uniform"))
			s.bricks_per_frame = g->own.bricks_per_frame;
		add(l, &s, differs);
		for (knob = BB_KNOBS - 1; knob >= 0 && ++at[knob] == g->n[knob]; knob--)
			at[knob] = 0;
	} while (knob >= 0 && !l->full);
}

enum bb_status bb_trade_grid_make(const struct bb_trade_grid *g, bool full, struct bb_trade_item **out, size_t *n,
				  struct bb_error *err)
{
	struct list l = { 0 };

	*out = NULL;
	*n = 0;
	if (full)
		all_of_them(g, &l);
	else
		one_by_one(g, &l);
	if (l.full) {
		free(l.item);
		return bb_fail(err, BB_ERR_USAGE, 1481, NULL, "more than %d settings", BB_GRID_POINTS_MOST);
	}
	*out = l.item;
	*n = l.n;
	return BB_OK;
}
