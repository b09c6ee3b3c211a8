/* tests/fuzz/fuzz_sdl_mapping.c: a file of SDL_GameControllerDB lines, looked through and each line parsed. */
#include "drivers/sdl_mapping.h"
#include "tests/fuzz/fuzz.h"

static void check(const struct bb_sdl_mapping *m)
{
	fuzz_must(m->n <= BB_SDL_BINDINGS_MAX && memchr(m->name, 0, sizeof(m->name)));
	for (size_t i = 0; i < m->n; i++)
		fuzz_must(m->binding[i].target < BB_SDL_TARGETS && m->binding[i].index <= 127);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct bb_input_identity id = { .bus = 3, .vendor = 0x046D, .product = 0xC219, .version = 0x0110 };
	const char *text = (const char *)data;
	struct bb_sdl_mapping m;
	struct bb_error err = { 0 };

	if (bb_sdl_mapping_find(text, size, "fuzz", &id, &m, &err) == BB_OK)
		check(&m);
	for (size_t at = 0; at < size;) {
		const char *end = memchr(text + at, '\n', size - at);
		const size_t n = end ? (size_t)(end - text) - at : size - at;
		if (bb_sdl_mapping_parse(text + at, n, NULL, &m, NULL) == BB_OK)
			check(&m);
		at += n + 1;
	}
	return 0;
}
