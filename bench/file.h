/*
 * bench/file.h: files that are either old or new, never a part; and text that cannot break the format it is put in.
 * A name, an EDID or a USB serial is somebody else's bytes: every one passes through one of the bb_put_* below.
 */
#ifndef BB_BENCH_FILE_H
#define BB_BENCH_FILE_H

#include "hal/file.h"
#include "hal/status.h"

#include <stdio.h>

struct bb_file { /* the caller's memory */
	FILE *out;
	char path[BB_PATH_MAX_BYTES], part[BB_PATH_MAX_BYTES + 32];
};
/* Opens a temporary file beside path. Then exactly one of the other two: commit syncs and renames, abort removes. */
BB_MUST_CHECK enum bb_status bb_file_begin(struct bb_file *f, const char *path, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_file_commit(struct bb_file *f, struct bb_error *err);
void bb_file_abort(struct bb_file *f);

/* Text for HTML and XML: markup escaped, control bytes and broken UTF-8 shown as U+FFFD. */
void bb_put_markup(FILE *out, const char *text);
BB_PRINTF(2, 3)
void bb_put_markupf(FILE *out, const char *fmt, ...);
/* A JSON string with its quotes. */
void bb_put_json(FILE *out, const char *text);
/* A CSV field: quoted where needed; one that a spreadsheet would run as a formula gets a leading apostrophe. */
void bb_put_csv(FILE *out, const char *text);
void bb_put_base64(FILE *out, const unsigned char *bytes, size_t n);
/* Copies text to out[cap], broken UTF-8 and control bytes as '?'; cut at a character, always NUL-terminated. */
void bb_text_clean(char *out, size_t cap, const char *text);
/* Formats into out[cap]; a text that is too long is cut, on purpose and always NUL-terminated. */
BB_PRINTF(3, 4)
void bb_text_format(char *out, size_t cap, const char *fmt, ...);
/* "8.33", "24.9", "12500": four significant digits, never an exponent below 1e15; "n/a" for NAN. Returns out. */
const char *bb_text_number(char *out, size_t cap, double v);

#endif
