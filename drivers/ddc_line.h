/*
 * drivers/ddc_line.h: one question and its answer on a DDC bus: the bytes, the waits before, between and after them,
 * and the quirk of a doubled source byte. Stepped with the time; never waits itself. ns.
 */
#ifndef BB_DRIVERS_DDC_LINE_H
#define BB_DRIVERS_DDC_LINE_H

#include "drivers/ddc_health.h"
#include "drivers/ddcci_codec.h"
#include "hal/bus.h"

enum ddc_what {
	DDC_GET_VCP,
	DDC_SET_VCP,
	DDC_FRAGMENT, /* value: offset in the capabilities */
	DDC_MEMORY,   /* value: offset in the EDID; DDC_MEMORY_BYTES of it */
	DDC_PRESENCE, /* the EDID's first bytes: is anything there, does the wire work? */
};
#define DDC_MEMORY_BYTES 32 /* 3.2 ms on the wire: a frame loop in the same thread must not wait for a whole block */

struct ddc_question {
	enum ddc_what what;
	uint8_t code;
	uint16_t value;
	bool patient; /* with the longest waits, whatever the gap */
};

enum ddc_outcome { DDC_GOOD, DDC_EMPTY, DDC_ZEROS, DDC_DAMAGED, DDC_NO_ACK, DDC_BROKEN };

struct ddc_line {
	struct bb_i2c_bus *bus;
	struct ddc_gap gap;
	bool doubled; /* this display sends its source byte twice */
	uint64_t transfers;
	int64_t quiet_ns; /* the controller is left alone until then */

	struct ddc_question question;
	bool reading;
	/* The answer, when a step returned BB_NEVER. */
	enum ddc_outcome outcome;
	int64_t end_ns;
	struct ddcci_vcp vcp;
	struct ddcci_fragment fragment;
	const char *why;
	uint8_t bytes[DDCCI_MOST_REPLY];
};

void ddc_line_ask(struct ddc_line *l, const struct ddc_question *question);
/* Returns when to step again; BB_NEVER: the answer is there. */
int64_t ddc_line_step(struct ddc_line *l, int64_t now_ns);

#endif
