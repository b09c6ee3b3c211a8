/*
 * hal/yaml.h: the part of YAML that room, scene and profile files are written in: mappings, lists, scalars; no aliases,
 * anchors or tags, one document, at most 16 deep, at most 1 MiB. libyaml's events become a tree of nodes that know
 * their line and column; option tables (hal/options.h) and branches walk it. Owns the only libyaml call.
 *
 * No recursion over input. All memory belongs to the document. One thread.
 */
#ifndef BB_HAL_YAML_H
#define BB_HAL_YAML_H

#include "hal/geometry.h"
#include "hal/hash.h"
#include "hal/options.h"

#define BB_YAML_DEPTH_MAX 16
#define BB_YAML_NODES_MAX 65536
#define BB_YAML_KEYS_MAX 256 /* of one mapping: duplicates are looked for pair by pair */

enum bb_yaml_kind { BB_YAML_SCALAR, BB_YAML_LIST, BB_YAML_MAP };

struct bb_yaml_node {
	enum bb_yaml_kind kind;
	bool quoted;               /* a scalar in quotes is text, never a number */
	int line, column;          /* from 1 */
	const char *key;           /* of an entry of a mapping, else NULL */
	const char *text;          /* scalar */
	size_t n;                  /* children */
	struct bb_yaml_node *first, *last, *next;
};

struct bb_yaml; /* a document */

BB_MUST_CHECK enum bb_status bb_yaml_load(const char *path, struct bb_yaml **out, struct bb_error *err);
void bb_yaml_free(struct bb_yaml *doc);
const struct bb_yaml_node *bb_yaml_root(const struct bb_yaml *doc); /* never NULL */
void bb_yaml_sha256(const struct bb_yaml *doc, uint8_t out[BB_HASH_BYTES]); /* of the file's bytes */

/* Entry of a mapping by key; NULL when there is none. */
const struct bb_yaml_node *bb_yaml_get(const struct bb_yaml_node *map, const char *key);

/* Where errors go while a document is read. A reader's own context embeds it first. */
struct bb_reader {
	const char *file;
	struct bb_error *err;
};
struct bb_where bb_yaml_where(const struct bb_reader *r, const struct bb_yaml_node *node);
/* BB_ERR_CONFIG with a number at a node. */
BB_PRINTF(4, 5)
enum bb_status bb_yaml_fail(const struct bb_reader *r, int number, const struct bb_yaml_node *node, const char *fmt, ...);

/* What an option table cannot say: a key whose value has a shape of its own. */
struct bb_yaml_branch {
	const char *name; /* NULL ends the list */
	enum bb_status (*read)(struct bb_reader *r, const struct bb_yaml_node *value, void *target);
	bool required;
};
enum bb_yaml_walk_flags { BB_YAML_PARTIAL = 1 /* defaults for others: nothing is required */ };

/*
 * Read a mapping: every key is a row of `options` (scalar into target) or a branch; 1011 unknown, 1017 missing, 1019
 * not a mapping. Branches are read in the order of their table after all scalars, whatever order the file has.
 */
BB_MUST_CHECK enum bb_status bb_yaml_walk(struct bb_reader *r, const struct bb_yaml_node *map,
                                          const struct bb_option *options, const struct bb_yaml_branch *branches,
                                          void *target, unsigned flags);

BB_MUST_CHECK enum bb_status bb_yaml_want(struct bb_reader *r, const struct bb_yaml_node *node, enum bb_yaml_kind kind);
/* A number within [least, most], as written. */
BB_MUST_CHECK enum bb_status bb_yaml_number(struct bb_reader *r, const struct bb_yaml_node *node, double least,
                                            double most, double *out);
BB_MUST_CHECK enum bb_status bb_yaml_integer(struct bb_reader *r, const struct bb_yaml_node *node, int64_t least,
                                             int64_t most, int64_t *out);
/* A list of exactly n numbers, each times scale. */
BB_MUST_CHECK enum bb_status bb_yaml_numbers(struct bb_reader *r, const struct bb_yaml_node *node, size_t n, double least,
                                             double most, double scale, double *out);
BB_MUST_CHECK enum bb_status bb_yaml_vec3(struct bb_reader *r, const struct bb_yaml_node *node, double most, double scale,
                                          struct bb_vec3 *out);
BB_MUST_CHECK enum bb_status bb_yaml_pixels(struct bb_reader *r, const struct bb_yaml_node *node, int64_t *width,
                                            int64_t *height);
/* Text that fits into cap bytes with its NUL. */
BB_MUST_CHECK enum bb_status bb_yaml_text(struct bb_reader *r, const struct bb_yaml_node *node, char *out, size_t cap);

#endif
