/* drivers/pad_uri.c: see drivers/pad_uri.h. */
#include "drivers/pad_uri.h"

#include <stdio.h>
#include <string.h>

#include "hal/options.h"

struct keys {
	char serial[64], mapping[64];
	int64_t slot, gap_ms;
};

static const struct bb_option table[] = {
	{ "serial", BB_OPT_TYPE_TEXT, offsetof(struct keys, serial), sizeof(((struct keys *)NULL)->serial), 0, 0, 0, 1,
	  "", false, "serial number of the device" },
	{ "mapping", BB_OPT_TYPE_TEXT, offsetof(struct keys, mapping), sizeof(((struct keys *)NULL)->mapping), 0, 0, 0,
	  1, "", false, "file of SDL_GameControllerDB lines" },
	BB_OPT_I64(struct keys, slot, 1, 1, 4, "pad of a receiver"),
	BB_OPT_I64(struct keys, gap_ms, 200, 0, 10000, "silence with a deflected stick that is a fault; 0: none is"),
	BB_OPT_END,
};

enum bb_status bb_pad_uri_fail(struct bb_device *dev, const struct bb_open *open, const char *what)
{
	struct bb_error err = { 0 };
	const enum bb_status status = bb_fail(&err, BB_ERR_CONFIG, 1501, NULL, "%s: '%s:%s' %s", dev->id,
					      open->uri->scheme, open->uri->path, what);

	bb_log(open->log, BB_LOG_ERROR, BB_BLAME_CONFIG, dev->id, "%s", err.text);
	return bb_device_fail(dev, status, "open", "%.90s", err.text);
}

static int hex_digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	if (c >= 'a' && c <= 'f')
		return c - 'a' + 10;
	return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

/* Exactly four digits. */
static bool hex4(const char *text, uint16_t *out)
{
	unsigned int v = 0;

	for (int i = 0; i < 4; i++) {
		const int digit = hex_digit(text[i]);
		if (digit < 0)
			return false;
		v = v << 4 | (unsigned int)digit;
	}
	*out = (uint16_t)v;
	return true;
}

enum bb_status bb_pad_uri_read(struct bb_device *dev, const struct bb_open *open, struct bb_pad_uri *out)
{
	const struct bb_uri *uri = open->uri;
	struct bb_error err = { 0 };
	struct keys keys;

	memset(out, 0, sizeof(*out));
	bb_options_defaults(table, &keys);
	for (size_t i = 0; i < uri->n_options; i++)
		if (bb_options_set(table, &keys, uri->option[i].key, uri->option[i].value, NULL, &err) != BB_OK) {
			bb_log(open->log, BB_LOG_ERROR, BB_BLAME_CONFIG, dev->id, "%s", err.text);
			return bb_device_fail(dev, BB_ERR_CONFIG, "open", "%.90s", err.text);
		}
	out->has_identity = strlen(uri->path) == 9 && uri->path[4] == ':' && hex4(uri->path, &out->vendor) &&
			    hex4(uri->path + 5, &out->product);
	snprintf(out->path, sizeof(out->path), "%s", uri->path);
	memcpy(out->serial, keys.serial, sizeof(out->serial));
	memcpy(out->mapping, keys.mapping, sizeof(out->mapping));
	out->slot = keys.slot;
	out->gap_ns = keys.gap_ms ? keys.gap_ms * 1000000 : BB_NEVER;
	return BB_OK;
}
