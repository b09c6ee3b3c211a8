/* tests/fuzz/fuzz_uri.c: any text as a device URI. */
#include "hal/uri.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_uri u;
	struct bb_error err = { 0 };

	if (size >= FUZZ_PIECE_MOST || memchr(data, 0, size))
		return 0;
	char *text = (char *)fuzz_exact(data, size) - 1; /* a byte further down: room for its end */
	memmove(text, text + 1, size);
	text[size] = '\0';
	if (bb_uri_parse(text, &u, NULL, &err) != BB_OK) {
		fuzz_must(err.number == 1501 && !u.n_options && !u.scheme[0]);
		return 0;
	}
	fuzz_must(u.n_options <= BB_URI_OPTIONS_MAX && strlen(u.scheme) < sizeof(u.scheme) &&
		  strlen(u.path) < sizeof(u.path));
	fuzz_must(!strncmp(text, u.scheme, strlen(u.scheme)) && text[strlen(u.scheme)] == ':');
	for (size_t i = 0; i < u.n_options; i++)
		fuzz_must(u.option[i].key[0] && memchr(u.option[i].value, 0, sizeof(u.option[i].value)));
	return 0;
}
