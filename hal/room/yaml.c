/*
 * hal/room/yaml.c: from a file's bytes to a tree of nodes. See hal/yaml.h; the walking half is hal/room/yaml_walk.c.
 */
#include "hal/room/yaml.h"

#include <stdlib.h>
#include <string.h>
#include <yaml.h>

#include "hal/file.h"

#define KEY_MAX_BYTES 64
#define CHUNK_BYTES 16384

struct chunk {
	struct chunk *next;
	size_t used, cap;
	_Alignas(16) unsigned char bytes[];
};

struct bb_yaml {
	struct chunk *chunks;
	struct bb_yaml_node *root;
	size_t n_nodes;
	uint8_t sha256[BB_HASH_BYTES];
};

struct parse {
	struct bb_yaml *doc;
	struct bb_reader r;
	struct bb_yaml_node *open[BB_YAML_DEPTH_MAX];
	size_t depth;
	const char *key; /* read, its value not yet */
	bool done;
};

static void *take(struct bb_yaml *doc, size_t n)
{
	struct chunk *c = doc->chunks;

	n = (n + 15) & ~(size_t)15;
	if (!c || c->cap - c->used < n) {
		const size_t cap = n > CHUNK_BYTES ? n : CHUNK_BYTES;
		c = malloc(sizeof(*c) + cap);
		if (!c)
			return NULL;
		*c = (struct chunk){ doc->chunks, 0, cap };
		doc->chunks = c;
	}
	c->used += n;
	return c->bytes + c->used - n;
}

static char *take_text(struct bb_yaml *doc, const char *text, size_t n)
{
	char *copy = take(doc, n + 1);

	if (copy) {
		memcpy(copy, text, n);
		copy[n] = '\0';
	}
	return copy;
}

static struct bb_where event_where(const struct parse *p, const yaml_mark_t *mark)
{
	return (struct bb_where){ p->r.file, (int)mark->line + 1, (int)mark->column + 1 };
}

static enum bb_status nomem(const struct parse *p)
{
	return bb_fail(p->r.err, BB_ERR_NOMEM, 1702, NULL, "while reading %s", p->r.file);
}

static enum bb_status take_key(struct parse *p, const yaml_event_t *ev)
{
	const struct bb_where where = event_where(p, &ev->start_mark);
	const struct bb_yaml_node *map = p->open[p->depth - 1];
	const char *text = (const char *)ev->data.scalar.value;
	const size_t n = ev->data.scalar.length;

	if (n == 0 || n >= KEY_MAX_BYTES || memchr(text, '\0', n))
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1011, &where, "a key has 1 to %d bytes", KEY_MAX_BYTES - 1);
	if (map->n >= BB_YAML_KEYS_MAX)
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1016, &where, "more than %d keys in one mapping", BB_YAML_KEYS_MAX);
	for (const struct bb_yaml_node *c = map->first; c; c = c->next)
		if (!strcmp(c->key, text))
			return bb_fail(p->r.err, BB_ERR_CONFIG, 1015, &where, "'%s' stands in line %d already", text, c->line);
	p->key = take_text(p->doc, text, n);
	return p->key ? BB_OK : nomem(p);
}

/* A new node at the place the walk has reached: the root, the next entry of a list, or the value of the last key. */
static enum bb_status add_node(struct parse *p, enum bb_yaml_kind kind, const yaml_mark_t *mark,
                               struct bb_yaml_node **out)
{
	const struct bb_where where = event_where(p, mark);
	struct bb_yaml_node *parent = p->depth ? p->open[p->depth - 1] : NULL;
	struct bb_yaml_node *node;

	if (parent && parent->kind == BB_YAML_MAP && !p->key)
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1019, &where, "a key is a plain word");
	if (++p->doc->n_nodes > BB_YAML_NODES_MAX)
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1016, &where, "more than %d values", BB_YAML_NODES_MAX);
	node = take(p->doc, sizeof(*node));
	if (!node)
		return nomem(p);
	*node = (struct bb_yaml_node){ .kind = kind, .line = where.line, .column = where.column, .key = p->key };
	p->key = NULL;
	if (!parent)
		p->doc->root = node;
	else if (parent->last)
		parent->last->next = node;
	else
		parent->first = node;
	if (parent) {
		parent->last = node;
		parent->n++;
	}
	*out = node;
	return BB_OK;
}

static enum bb_status on_scalar(struct parse *p, const yaml_event_t *ev)
{
	const struct bb_where where = event_where(p, &ev->start_mark);
	const char *text = (const char *)ev->data.scalar.value;
	const size_t n = ev->data.scalar.length;
	struct bb_yaml_node *node;
	enum bb_status status;

	if (p->depth && p->open[p->depth - 1]->kind == BB_YAML_MAP && !p->key)
		return take_key(p, ev);
	for (size_t i = 0; i < n; i++) /* "\0" and its like come from escapes */
		if ((unsigned char)text[i] < 0x20 && text[i] != '\n' && text[i] != '\t')
			return bb_fail(p->r.err, BB_ERR_FORMAT, 1006, &where, "an escaped control character");
	status = add_node(p, BB_YAML_SCALAR, &ev->start_mark, &node);
	if (status)
		return status;
	node->quoted = ev->data.scalar.style != YAML_PLAIN_SCALAR_STYLE;
	node->text = take_text(p->doc, text, n);
	return node->text ? BB_OK : nomem(p);
}

static enum bb_status on_open(struct parse *p, enum bb_yaml_kind kind, const yaml_mark_t *mark)
{
	const struct bb_where where = event_where(p, mark);
	struct bb_yaml_node *node;
	enum bb_status status;

	if (p->depth == BB_YAML_DEPTH_MAX)
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1014, &where, "more than %d levels", BB_YAML_DEPTH_MAX);
	status = add_node(p, kind, mark, &node);
	if (!status)
		p->open[p->depth++] = node;
	return status;
}

/* Anchors, aliases and tags make a small file mean a large thing, or another thing: none of them. */
static enum bb_status refuse_extras(const struct parse *p, const yaml_event_t *ev)
{
	const struct bb_where where = event_where(p, &ev->start_mark);
	const yaml_char_t *anchor = NULL, *tag = NULL;

	switch (ev->type) {
	case YAML_ALIAS_EVENT:
		anchor = ev->data.alias.anchor;
		break;
	case YAML_SCALAR_EVENT:
		anchor = ev->data.scalar.anchor;
		tag = ev->data.scalar.tag;
		break;
	case YAML_SEQUENCE_START_EVENT:
		anchor = ev->data.sequence_start.anchor;
		tag = ev->data.sequence_start.tag;
		break;
	case YAML_MAPPING_START_EVENT:
		anchor = ev->data.mapping_start.anchor;
		tag = ev->data.mapping_start.tag;
		break;
	case YAML_DOCUMENT_START_EVENT:
		if (ev->data.document_start.tag_directives.start != ev->data.document_start.tag_directives.end)
			return bb_fail(p->r.err, BB_ERR_CONFIG, 1010, &where, "%%TAG");
		break;
	default:
		break;
	}
	if (anchor)
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1009, &where, "'%.40s'", (const char *)anchor);
	if (tag)
		return bb_fail(p->r.err, BB_ERR_CONFIG, 1010, &where, "'%.40s'", (const char *)tag);
	return BB_OK;
}

static enum bb_status on_event(struct parse *p, const yaml_event_t *ev)
{
	const struct bb_where where = event_where(p, &ev->start_mark);
	enum bb_status status = refuse_extras(p, ev);

	if (status)
		return status;
	switch (ev->type) {
	case YAML_DOCUMENT_START_EVENT:
		if (p->doc->root)
			return bb_fail(p->r.err, BB_ERR_CONFIG, 1008, &where, "a second one begins here");
		return BB_OK;
	case YAML_SCALAR_EVENT:
		return on_scalar(p, ev);
	case YAML_SEQUENCE_START_EVENT:
		return on_open(p, BB_YAML_LIST, &ev->start_mark);
	case YAML_MAPPING_START_EVENT:
		return on_open(p, BB_YAML_MAP, &ev->start_mark);
	case YAML_SEQUENCE_END_EVENT:
	case YAML_MAPPING_END_EVENT:
		p->depth--;
		return BB_OK;
	case YAML_STREAM_END_EVENT:
		p->done = true;
		return BB_OK;
	default:
		return BB_OK;
	}
}

static enum bb_status syntax_error(const struct parse *p, const yaml_parser_t *yp)
{
	struct bb_where where = event_where(p, &yp->problem_mark);

	if (yp->error == YAML_MEMORY_ERROR)
		return nomem(p);
	if (yp->error == YAML_READER_ERROR) { /* it knows a byte, not a line */
		where = event_where(p, &yp->mark);
		return bb_fail(p->r.err, BB_ERR_FORMAT, 1006, &where, "%s, byte %zu", yp->problem, yp->problem_offset);
	}
	return bb_fail(p->r.err, BB_ERR_FORMAT, 1005, &where, "%s%s%s", yp->problem ? yp->problem : "unknown",
	               yp->context ? ", " : "", yp->context ? yp->context : "");
}

static enum bb_status parse_text(struct parse *p, const char *text, size_t n)
{
	enum bb_status status = BB_OK;
	yaml_parser_t yp;
	yaml_event_t ev;

	if (!yaml_parser_initialize(&yp))
		return nomem(p);
	yaml_parser_set_encoding(&yp, YAML_UTF8_ENCODING);
	yaml_parser_set_input_string(&yp, (const unsigned char *)text, n);
	while (!status && !p->done) {
		if (!yaml_parser_parse(&yp, &ev)) {
			status = syntax_error(p, &yp);
			break;
		}
		status = on_event(p, &ev);
		yaml_event_delete(&ev);
	}
	yaml_parser_delete(&yp);
	if (!status && !p->doc->root) { /* only comments, or only markers */
		const struct bb_where where = { p->r.file, 1, 1 };
		status = bb_fail(p->r.err, BB_ERR_FORMAT, 1004, &where, "only comments in it");
	}
	return status;
}

enum bb_status bb_yaml_load(const char *path, struct bb_yaml **out, struct bb_error *err)
{
	struct parse p = { .r = { path, err } };
	enum bb_status status;
	char *text;
	size_t n;

	*out = NULL;
	status = bb_file_read(path, BB_TEXT_FILE_CAP_BYTES, &text, &n, err);
	if (status)
		return status;
	p.doc = calloc(1, sizeof(*p.doc));
	status = p.doc ? bb_file_check_text(path, text, n, err) : nomem(&p);
	if (!status) {
		bb_hash_bytes(text, n, p.doc->sha256);
		status = parse_text(&p, text, n);
	}
	free(text);
	if (status) {
		bb_yaml_free(p.doc);
		return status;
	}
	*out = p.doc;
	return BB_OK;
}

void bb_yaml_free(struct bb_yaml *doc)
{
	if (!doc)
		return;
	for (struct chunk *c = doc->chunks, *next; c; c = next) {
		next = c->next;
		free(c);
	}
	free(doc);
}

const struct bb_yaml_node *bb_yaml_root(const struct bb_yaml *doc)
{
	return doc->root;
}

void bb_yaml_sha256(const struct bb_yaml *doc, uint8_t out[BB_HASH_BYTES])
{
	memcpy(out, doc->sha256, BB_HASH_BYTES);
}
