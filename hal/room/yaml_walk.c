/*
 * hal/room/yaml_walk.c: reading a tree of nodes through option tables and branches. See hal/yaml.h.
 */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "hal/room/yaml.h"

static const char *kind_text(enum bb_yaml_kind kind)
{
	return kind == BB_YAML_SCALAR ? "a single value" : kind == BB_YAML_LIST ? "a list [a, b]" : "a mapping {key: value}";
}

struct bb_where bb_yaml_where(const struct bb_reader *r, const struct bb_yaml_node *node)
{
	return (struct bb_where){ r->file, node ? node->line : 0, node ? node->column : 0 };
}

enum bb_status bb_yaml_fail(const struct bb_reader *r, int number, const struct bb_yaml_node *node, const char *fmt, ...)
{
	const struct bb_where where = bb_yaml_where(r, node);
	char what[256];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(what, sizeof(what), fmt, ap);
	va_end(ap);
	return bb_fail(r->err, BB_ERR_CONFIG, number, &where, "%s", what);
}

const struct bb_yaml_node *bb_yaml_get(const struct bb_yaml_node *map, const char *key)
{
	if (map->kind != BB_YAML_MAP)
		return NULL;
	for (const struct bb_yaml_node *c = map->first; c; c = c->next)
		if (!strcmp(c->key, key))
			return c;
	return NULL;
}

/* "'seed'" for messages: the key a value stands at, or that it is an entry of a list. */
static const char *name_of(const struct bb_yaml_node *node)
{
	return node->key ? node->key : "this entry";
}

enum bb_status bb_yaml_want(struct bb_reader *r, const struct bb_yaml_node *node, enum bb_yaml_kind kind)
{
	if (node->kind == kind)
		return BB_OK;
	return bb_yaml_fail(r, 1019, node, "%s is %s, wanted %s", name_of(node), kind_text(node->kind), kind_text(kind));
}

/* A scalar with something in it; a number must not stand in quotes. */
static enum bb_status want_value(struct bb_reader *r, const struct bb_yaml_node *node, bool text)
{
	enum bb_status status = bb_yaml_want(r, node, BB_YAML_SCALAR);

	if (status)
		return status;
	if (!node->quoted && (!*node->text || !strcmp(node->text, "~") || !strcmp(node->text, "null")))
		return bb_yaml_fail(r, 1012, node, "%s has no value", name_of(node));
	if (node->quoted && !text)
		return bb_yaml_fail(r, 1012, node, "%s stands in quotes, wanted a bare value", name_of(node));
	return BB_OK;
}

static const struct bb_option *row_of(const struct bb_option *options, const char *key)
{
	for (; options && options->name; options++)
		if (!strcmp(options->name, key))
			return options;
	return NULL;
}

static enum bb_status unknown_key(struct bb_reader *r, const struct bb_yaml_node *node, const struct bb_option *options,
                                  const struct bb_yaml_branch *branches)
{
	const char *best = NULL;
	size_t best_distance = strlen(node->key) / 2 + 1;

	for (; options && options->name; options++)
		best = bb_nearer(node->key, options->name, best, &best_distance);
	for (; branches && branches->name; branches++)
		best = bb_nearer(node->key, branches->name, best, &best_distance);
	return best ? bb_yaml_fail(r, 1011, node, "'%s', did you mean '%s'?", node->key, best)
	            : bb_yaml_fail(r, 1011, node, "'%s'", node->key);
}

static enum bb_status walk_scalars(struct bb_reader *r, const struct bb_yaml_node *map, const struct bb_option *options,
                                   const struct bb_yaml_branch *branches, void *target)
{
	for (const struct bb_yaml_node *c = map->first; c; c = c->next) {
		const struct bb_option *row = row_of(options, c->key);
		const struct bb_yaml_branch *b = branches;
		enum bb_status status;

		while (!row && b && b->name && strcmp(b->name, c->key))
			b++;
		if (!row && (!b || !b->name))
			return unknown_key(r, c, options, branches);
		if (!row)
			continue;
		status = want_value(r, c, row->type == BB_OPT_TYPE_TEXT || row->type == BB_OPT_TYPE_ENUM);
		if (!status) {
			const struct bb_where where = bb_yaml_where(r, c);
			status = bb_options_set(options, target, c->key, c->text, &where, r->err);
		}
		if (status)
			return status;
	}
	return BB_OK;
}

enum bb_status bb_yaml_walk(struct bb_reader *r, const struct bb_yaml_node *map, const struct bb_option *options,
                            const struct bb_yaml_branch *branches, void *target, unsigned flags)
{
	enum bb_status status = bb_yaml_want(r, map, BB_YAML_MAP);

	if (!status)
		status = walk_scalars(r, map, options, branches, target);
	if (status)
		return status;
	for (const struct bb_option *o = options; o && o->name; o++)
		if (o->required && !(flags & BB_YAML_PARTIAL) && !bb_yaml_get(map, o->name))
			return bb_yaml_fail(r, 1017, map, "'%s'", o->name);
	for (const struct bb_yaml_branch *b = branches; b && b->name; b++) {
		const struct bb_yaml_node *value = bb_yaml_get(map, b->name);

		if (!value && b->required && !(flags & BB_YAML_PARTIAL))
			return bb_yaml_fail(r, 1017, map, "'%s'", b->name);
		status = value ? b->read(r, value, target) : BB_OK;
		if (status)
			return status;
	}
	return BB_OK;
}

enum bb_status bb_yaml_number(struct bb_reader *r, const struct bb_yaml_node *node, double least, double most,
                              double *out)
{
	const struct bb_option row[] = { { name_of(node), BB_OPT_TYPE_F64, 0, 0, 0, least, most, 1, NULL, false, NULL },
		                         BB_OPT_END };
	const struct bb_where where = bb_yaml_where(r, node);
	enum bb_status status = want_value(r, node, false);

	return status ? status : bb_options_set(row, out, row->name, node->text, &where, r->err);
}

enum bb_status bb_yaml_integer(struct bb_reader *r, const struct bb_yaml_node *node, int64_t least, int64_t most,
                               int64_t *out)
{
	const struct bb_option row[] = { { name_of(node), BB_OPT_TYPE_I64, 0, 0, 0, (double)least, (double)most, 1, NULL,
		                           false, NULL },
		                         BB_OPT_END };
	const struct bb_where where = bb_yaml_where(r, node);
	enum bb_status status = want_value(r, node, false);

	return status ? status : bb_options_set(row, out, row->name, node->text, &where, r->err);
}

enum bb_status bb_yaml_numbers(struct bb_reader *r, const struct bb_yaml_node *node, size_t n, double least, double most,
                               double scale, double *out)
{
	enum bb_status status = bb_yaml_want(r, node, BB_YAML_LIST);
	size_t i = 0;

	if (status)
		return status;
	if (node->n != n)
		return bb_yaml_fail(r, 1020, node, "%s has %zu numbers, wanted %zu", name_of(node), node->n, n);
	for (const struct bb_yaml_node *c = node->first; c; c = c->next, i++) {
		status = bb_yaml_number(r, c, least, most, &out[i]);
		if (status)
			return status;
		out[i] *= scale;
	}
	return BB_OK;
}

enum bb_status bb_yaml_vec3(struct bb_reader *r, const struct bb_yaml_node *node, double most, double scale,
                            struct bb_vec3 *out)
{
	double v[3];
	const enum bb_status status = bb_yaml_numbers(r, node, 3, -most, most, scale, v);

	if (!status)
		*out = (struct bb_vec3){ v[0], v[1], v[2] };
	return status;
}

enum bb_status bb_yaml_pixels(struct bb_reader *r, const struct bb_yaml_node *node, int64_t *width, int64_t *height)
{
	enum bb_status status = bb_yaml_want(r, node, BB_YAML_LIST);

	if (!status && node->n != 2)
		status = bb_yaml_fail(r, 1020, node, "%s is [width, height]", name_of(node));
	if (!status)
		status = bb_yaml_integer(r, node->first, 1, 16384, width);
	return status ? status : bb_yaml_integer(r, node->last, 1, 16384, height);
}

enum bb_status bb_yaml_text(struct bb_reader *r, const struct bb_yaml_node *node, char *out, size_t cap)
{
	const struct bb_option row[] = { { name_of(node), BB_OPT_TYPE_TEXT, 0, cap, 0, 0, 0, 1, NULL, false, NULL },
		                         BB_OPT_END };
	const struct bb_where where = bb_yaml_where(r, node);
	enum bb_status status = want_value(r, node, true);

	return status ? status : bb_options_set(row, out, row->name, node->text, &where, r->err);
}
