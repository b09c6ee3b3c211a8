/*
 * drivers/monitor_ddc_impl.h: the inside of struct monitor_ddc, shared by monitor_ddc.c (the class's calls, the
 * machine) and ddc_request.c (what an answer leads to) only. One thread, the clock's.
 */
#ifndef BB_DRIVERS_MONITOR_DDC_IMPL_H
#define BB_DRIVERS_MONITOR_DDC_IMPL_H

#include "drivers/ddc_line.h"
#include "drivers/monitor_ddc.h"

#define REOPENS_A_MINUTE 5 /* more are too many */

enum ddc_stage { STAGE_IDLE, STAGE_UNDER_WAY, STAGE_DONE };

enum ddc_ask {
	ASK_NOTHING,
	/* main questions */
	ASK_VALUE,
	ASK_AWAKE, /* before a Set to a display that was asleep */
	ASK_WRITE,
	ASK_SETTLE, /* no question: the wait after a write that cannot be read back */
	ASK_VERIFY,
	ASK_FRAGMENT,
	ASK_EDID,
	/* side questions */
	ASK_KNOWN,   /* a code that the display has answered */
	ASK_UNKNOWN, /* a code it cannot have */
	ASK_PRESENCE,
	/* idle */
	ASK_PROBE,
	ASK_PROBE_BUS,
};

struct monitor_ddc {
	struct bb_monitor base;
	const struct bb_log *log;
	struct ddc_line line;
	struct bb_timer timer;
	enum ddc_stage stage;
	enum ddc_ask ask, main;
	bool posed; /* the line has the question */
	struct monitor_ddc_report report;
	uint8_t answered[32]; /* a bit for each code that had a value */
	uint8_t refused[32];  /* and for each found out not to be there by Nulls or zeros */
	uint8_t known_code;   /* the last of them */
	unsigned int probes;
	uint32_t reopened; /* of bus->n_reopened: seen */
	int64_t reopened_ns[REOPENS_A_MINUTE];

	struct { /* of the request under way */
		enum ddc_outcome failure;
		unsigned int empties, zeros, no_acks, looks, strange, rewrites, reads;
		uint32_t most_tries; /* of one fragment */
		bool patient;        /* longest waits from now on */
		bool awake, perhaps_slow;
		size_t at; /* bytes of the EDID that are there */
	} job;
	struct bb_monitor_reply reply;
};

/* The answer to d->ask is in d->line. Returns when the machine steps again, or BB_NEVER. */
int64_t ddc_on_answer(struct monitor_ddc *d);
/* Other buses go on, this one is left alone. */
int64_t ddc_quarantine(struct monitor_ddc *d, enum ddc_fault fault, const char *what);
int64_t ddc_finish(struct monitor_ddc *d, enum bb_status status, int64_t value);
int64_t ddc_next_ask(struct monitor_ddc *d, enum ddc_ask ask, int64_t at_ns);
/* While something is wrong the machine asks on its own; BB_NEVER: nothing to do. */
int64_t ddc_idle(struct monitor_ddc *d, int64_t at_ns);
bool ddc_read_only(uint8_t code);
/* Does the request turn the display on (or to sleep)? */
bool ddc_sets_power(const struct monitor_ddc *d, bool on);

#endif
