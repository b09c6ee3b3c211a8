/* tests/fuzz/fuzz_hid_descriptor.c: HID report descriptors. */
#include <stdlib.h>
#include <string.h>

#include "drivers/hid_descriptor.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bb_hid_layout l;
	struct bb_error err = { 0 };
	uint8_t *copy = malloc(size ? size : 1);

	if (!copy)
		return 0;
	memcpy(copy, data, size);
	const enum bb_status status = bb_hid_layout_parse(copy, size, "fuzz", &l, &err);
	free(copy);
	if (status != BB_OK) {
		if (err.number != 1560)
			abort();
		return 0;
	}
	for (size_t i = 0; i < l.n_fields; i++) {
		const struct bb_hid_field *f = &l.field[i];
		const struct bb_hid_report *r = bb_hid_layout_report(&l, f->way, f->report_id);
		if (!r || (uint64_t)f->bit_offset + (uint64_t)f->bits * f->count > r->bits ||
		    bb_hid_report_bytes(r) > BB_HID_REPORT_BITS_MAX / 8 + 1)
			abort();
	}
	return 0;
}
