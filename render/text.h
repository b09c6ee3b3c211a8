/*
 * render/text.h: small text files that people write, line by line: transfer functions and raw headers. Files above
 * 1 MiB and files that are not text are refused. Numbers are plain decimals: no hex, no NaN, no infinity.
 */
#ifndef BB_RENDER_TEXT_H
#define BB_RENDER_TEXT_H

#include "hal/status.h"

struct bb_text {
	struct bb_where where; /* of the line handed out last; file is the caller's path */
	char *bytes;           /* owned */
	char *next;
};

/* number_not_text is the error given for a file that holds control bytes. */
BB_MUST_CHECK enum bb_status bb_text_open(const char *path, int number_not_text, struct bb_text *out,
                                          struct bb_error *err);
void bb_text_release(struct bb_text *text);
/* The next line that holds something, without comment and outer blanks; NULL at the end. */
char *bb_text_next(struct bb_text *text);

enum bb_text_word { BB_TEXT_END, BB_TEXT_NUMBER, BB_TEXT_NOT_A_NUMBER };
/* Takes the next blank-separated word off the cursor. */
enum bb_text_word bb_text_read_number(char **cursor, double *out);

#endif
