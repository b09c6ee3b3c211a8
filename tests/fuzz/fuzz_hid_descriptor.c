/* tests/fuzz/fuzz_hid_descriptor.c: HID report descriptors. */
#include "drivers/hid_descriptor.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bb_hid_layout l;
	struct bb_error err = { 0 };

	if (bb_hid_layout_parse(data, size, "fuzz", &l, &err) != BB_OK) {
		fuzz_must(err.number == 1560);
		return 0;
	}
	fuzz_must(l.n_fields && l.n_fields <= BB_HID_FIELDS_MAX && l.n_reports <= BB_HID_REPORTS_MAX);
	for (size_t i = 0; i < l.n_fields; i++) {
		const struct bb_hid_field *f = &l.field[i];
		const struct bb_hid_report *r = bb_hid_layout_report(&l, f->way, f->report_id);
		fuzz_must(r && (uint64_t)f->bit_offset + (uint64_t)f->bits * f->count <= r->bits &&
			  bb_hid_report_bytes(r) <= BB_HID_REPORT_BITS_MAX / 8 + 1);
	}
	fuzz_must(!bb_hid_layout_report(&l, BB_HID_FEATURE + 1, 0));
	return 0;
}
