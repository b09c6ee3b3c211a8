/*
 * hal/file.h: small text files read whole, as hostile as they come: only regular files, never above the cap, and the
 * rule which relative paths a configuration may name.
 */
#ifndef BB_HAL_FILE_H
#define BB_HAL_FILE_H

#include "hal/status.h"

#ifdef BB_FUZZ
#define BB_TEXT_FILE_CAP_BYTES (1u << 13) /* less to take and give back for each input */
#else
#define BB_TEXT_FILE_CAP_BYTES (1u << 20)
#endif

/* The whole file, malloc'ed, with a NUL after its last byte; *out is NULL on failure. 1001, 1002, 1003, 1018. */
BB_MUST_CHECK enum bb_status bb_file_read(const char *path, size_t cap_bytes, char **out, size_t *n_out,
                                          struct bb_error *err);
/* Text only: 1004 empty, 1006 control bytes, 1007 byte order mark, with the line they stand in. */
BB_MUST_CHECK enum bb_status bb_file_check_text(const char *path, const char *text, size_t n, struct bb_error *err);
/* May a configuration name this file? Not empty, relative, no ".." component. */
bool bb_path_is_tame(const char *path);
/* May a result be renamed to this? A regular file or nothing is there: root could else replace a device by its rename. */
bool bb_path_may_be_replaced(const char *path);
/* Do both name one file that is there? */
bool bb_path_is_same(const char *a, const char *b);
/*
 * Where is a file that a configuration names? In the current folder; else beside the configuration; else in the folder
 * above it, since rooms/, scenes/ and their data stand side by side and are used from elsewhere once installed. name
 * (cap bytes) is rewritten when that is where it is, and stays as it is when it is nowhere.
 */
void bb_path_settle(char *name, size_t cap, const char *configuration);

#endif
