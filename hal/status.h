/*
 * hal/status.h: the closed list of what a call can answer, and the numbered errors a person reads.
 *
 * 0 is success, > 0 "no result, not a failure", < 0 failure. A status exists only where a caller acts differently
 * on it; what happened in words is a struct bb_error (files, commands) or a device's last_error (devices).
 */
#ifndef BB_HAL_STATUS_H
#define BB_HAL_STATUS_H

#include "hal/base.h"

#define BB_STATUS_LIST(X)                                                      \
	X(BB_OK, 0, "ok")                                                      \
	X(BB_TIMEOUT, 1, "nothing yet")                                        \
	X(BB_SKIPPED, 2, "skipped")                                            \
	X(BB_ERR_USAGE, -1, "wrong call or wrong arguments")                   \
	X(BB_ERR_CONFIG, -2, "the configuration is wrong")                     \
	X(BB_ERR_FORMAT, -3, "the bytes are not what they claim to be")        \
	X(BB_ERR_UNSUPPORTED, -4, "this device cannot do that")                \
	X(BB_ERR_RANGE, -5, "value out of range")                              \
	X(BB_ERR_REFUSED, -6, "a safety ceiling forbids it")                   \
	X(BB_ERR_BUSY, -7, "busy, try again")                                  \
	X(BB_ERR_IO, -8, "input or output failed")                             \
	X(BB_ERR_LOST, -9, "the device is gone")                               \
	X(BB_ERR_NOMEM, -10, "out of memory")                                  \
	X(BB_ERR_INTERNAL, -11, "a bug in blackburst")                         \
	X(BB_ERR_VERIFY, -12, "written, but it reads back as something else")

enum bb_status {
#define X(name, value, text) name = (value),
	BB_STATUS_LIST(X)
#undef X
};

/* The text of a status; static, never NULL. */
const char *bb_status_text(enum bb_status status);

/*
 * A numbered error, "BB1042: what, where, likely cause, what to do next". Numbers, causes and remedies stand in
 * hal/errors.def; a number never changes its meaning. The struct is the caller's; a NULL one is allowed everywhere.
 * The first error wins: a struct that holds one is not overwritten, so a clean-up path cannot hide the cause.
 */
struct bb_error {
	int number;        /* 0: none */
	char text[640];    /* the whole line, no newline; control bytes of the input are shown as \xNN */
};

/* Where in which file; line and column count from 1, 0 means "not known". file may be NULL. */
struct bb_where {
	const char *file;
	int line, column;
};

/* Fill err (once) and return status, so that a failing place reads `return bb_fail(...)`. fmt says what is wrong. */
BB_PRINTF(5, 6)
enum bb_status bb_fail(struct bb_error *err, enum bb_status status, int number, const struct bb_where *where,
                       const char *fmt, ...);

/* The catalogue, for --list-errors and its test: 0 based, NULL past the end. */
struct bb_error_entry {
	int number;
	const char *title, *cause, *remedy;
};
const struct bb_error_entry *bb_error_catalogue(size_t i);

#endif
