/*
 * drivers/hid_descriptor.h: walks a HID report descriptor: which reports a device has, how long they are, which fields
 * they hold. Every byte is hostile: at most 4096 bytes, 1024 fields, nesting and pushes 16 deep, and ranges of usages
 * are never expanded, so a field of two thousand usages costs what a field of one does. No recursion, no allocation.
 */
#ifndef BB_DRIVERS_HID_DESCRIPTOR_H
#define BB_DRIVERS_HID_DESCRIPTOR_H

#include "hal/status.h"

#define BB_HID_DESCRIPTOR_BYTES_MAX 4096
#define BB_HID_FIELDS_MAX 1024
#define BB_HID_DEPTH_MAX 16
#define BB_HID_REPORTS_MAX 64
#define BB_HID_REPORT_BITS_MAX (16384u * 8) /* as long as the kernel's longest */

enum bb_hid_way { BB_HID_INPUT, BB_HID_OUTPUT, BB_HID_FEATURE };

struct bb_hid_field {
	enum bb_hid_way way;
	uint8_t report_id; /* 0: the device has none */
	bool constant, variable;
	uint16_t usage_page, usage_least, usage_most;
	uint32_t bit_offset;  /* in its report, after the id */
	uint32_t bits, count; /* of one value; how many */
	int32_t logical_least, logical_most;
};

struct bb_hid_report {
	enum bb_hid_way way;
	uint8_t id;
	uint32_t bits; /* without the id */
};

struct bb_hid_layout {
	uint16_t usage_page, usage; /* of the first application collection */
	size_t n_reports, n_fields;
	struct bb_hid_report report[BB_HID_REPORTS_MAX];
	struct bb_hid_field field[BB_HID_FIELDS_MAX];
};

/* BB_ERR_FORMAT with error 1560, "DESC_REJECT at byte N: why". */
BB_MUST_CHECK enum bb_status bb_hid_layout_parse(const uint8_t *bytes, size_t n, const char *device,
						 struct bb_hid_layout *out, struct bb_error *err);
/* NULL: no such report. */
const struct bb_hid_report *bb_hid_layout_report(const struct bb_hid_layout *l, enum bb_hid_way way, uint8_t id);
/* Bytes of a report on the wire, with its id byte when it has one. */
size_t bb_hid_report_bytes(const struct bb_hid_report *r);

#endif
