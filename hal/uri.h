/*
 * hal/uri.h: a device URI taken apart: "sim:?rate_error_ppm=12", "gpio:/dev/gpiochip0?line=17",
 * "modbus:tcp://127.0.0.1:1502?unit=1&outlet=3", "usb:131d:0157?serial=A1". The scheme picks the back end, the path
 * is the back end's own, the options are read through its option table.
 */
#ifndef BB_HAL_URI_H
#define BB_HAL_URI_H

#include "hal/status.h"

#define BB_URI_OPTIONS_MAX 12

struct bb_uri {
	char scheme[16]; /* without the colon, lower case */
	char path[96];   /* may be empty */
	size_t n_options;
	struct {
		char key[32];
		char value[64];
	} option[BB_URI_OPTIONS_MAX];
};

/* BB_ERR_CONFIG with error 1501 for anything malformed, too long or repeated. */
BB_MUST_CHECK enum bb_status bb_uri_parse(const char *text, struct bb_uri *out, const struct bb_where *where,
                                          struct bb_error *err);

#endif
