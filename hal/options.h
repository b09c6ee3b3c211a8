/*
 * hal/options.h: one table row is an option: its name (unit as last word), place in the owner's struct, default,
 * range and help. The same row makes the parser of room and scene keys, of URI options, the range error with file and
 * line, --help and the dump in each result.
 */
#ifndef BB_HAL_OPTIONS_H
#define BB_HAL_OPTIONS_H

#include "hal/status.h"

enum bb_option_type { BB_OPT_TYPE_I64, BB_OPT_TYPE_F64, BB_OPT_TYPE_BOOL, BB_OPT_TYPE_TEXT, BB_OPT_TYPE_ENUM };

struct bb_option {
	const char *name;
	enum bb_option_type type;
	size_t offset;      /* of the member in the owner's struct: int64_t, double, bool, char[], int */
	size_t size;        /* BB_OPT_TYPE_TEXT: bytes of the array */
	double fallback, least, most; /* as written, before scale; TEXT: least bytes */
	double scale;       /* F64 and I64 are stored times this: a key in mm lands in a member in m with 1e-3 */
	const char *words;  /* BB_OPT_TYPE_ENUM: "dlp|lcd|led", value = index; TEXT: the default */
	bool required;
	const char *help;
};

#define BB_OPT_I64(type, member, def, lo, hi, text) \
	{ #member, BB_OPT_TYPE_I64, offsetof(type, member), 0, def, lo, hi, 1, NULL, false, text }
#define BB_OPT_F64(type, member, def, lo, hi, text) \
	{ #member, BB_OPT_TYPE_F64, offsetof(type, member), 0, def, lo, hi, 1, NULL, false, text }
#define BB_OPT_END { NULL, BB_OPT_TYPE_I64, 0, 0, 0, 0, 0, 0, NULL, false, NULL }

/* Is `word` nearer to `asked` than anything so far (*distance)? Returns the nearer of word and best. */
const char *bb_nearer(const char *asked, const char *word, const char *best, size_t *distance);

/* Set every member of the table to its default. */
void bb_options_defaults(const struct bb_option *table, void *target);
/* Parse one value into the member that `key` names. BB_ERR_CONFIG with 1011 unknown key (with the nearest known one),
 * 1012 not a value of that type (or not finite), 1013 out of range. */
BB_MUST_CHECK enum bb_status bb_options_set(const struct bb_option *table, void *target, const char *key,
                                            const char *value, const struct bb_where *where, struct bb_error *err);
/* "name=value name=value": what a result records. Always NUL-terminated, truncated at cap. */
void bb_options_dump(const struct bb_option *table, const void *target, char *buf, size_t cap);

#endif
