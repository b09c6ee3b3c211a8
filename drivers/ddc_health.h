/*
 * drivers/ddc_health.h: what a DDC bus has been through: faults by name, the health they lead to, how long the
 * display needs between messages, and what Null means to it. Pure; times come from the caller, ns.
 */
#ifndef BB_DRIVERS_DDC_HEALTH_H
#define BB_DRIVERS_DDC_HEALTH_H

#include "hal/device.h"

#define DDC_FAULT_LIST(X)                                                                              \
	X(DDC_FAULT_NONE, "none")                                                                      \
	X(DDC_FAULT_NAK, "DDC_NAK")   /* no acknowledge from the display */                            \
	X(DDC_FAULT_EIO, "DDC_EIO")   /* the transfer broke off */                                     \
	X(DDC_FAULT_DATA, "DDC_DATA") /* checksum, opcode, or the answer to another question */        \
	X(DDC_FAULT_NULL, "NULL")     /* empty replies */                                              \
	X(DDC_FAULT_ZERO, "ALL_ZERO")                                                                  \
	X(DDC_FAULT_SLOW, "DDC_SLOW")        /* answers only after longer waits than the standard's */ \
	X(DDC_FAULT_STANDBY, "DISP_STANDBY") /* EDID answers, DDC does not */                          \
	X(DDC_FAULT_STUCK, "I2C_STUCK")      /* nothing gets through, whatever the address */          \
	X(DDC_FAULT_FLAPS, "BUS_FLAPS")      /* the adapter comes and goes */                          \
	X(DDC_FAULT_VERIFY, "VERIFY_FAIL")   /* written, acknowledged, reads back as something else */ \
	X(DDC_FAULT_EDID, "EDID_BAD")

enum ddc_fault {
#define X(name, text) name,
	DDC_FAULT_LIST(X)
#undef X
	DDC_FAULT_COUNT
};
const char *ddc_fault_text(enum ddc_fault fault);

struct ddc_health { /* zero: never asked */
	enum bb_health health;
	enum ddc_fault fault; /* the one health is about; kept while RECOVERING */
	uint32_t n_good;      /* in a row, since the first good one */
	int64_t found_ns, first_good_ns, recovered_ns;
	uint64_t count[DDC_FAULT_COUNT]; /* how often seen */
};

/* Seen once; true when health or fault changed. A fault that says less than the one that stands is only counted. */
bool ddc_health_bad(struct ddc_health *h, enum bb_health health, enum ddc_fault fault, int64_t at_ns);
/* A good reply. Back to OK after three in a row or 500 ms of them; true when health changed. */
bool ddc_health_good(struct ddc_health *h, int64_t at_ns);

/* Waits stretch from 1.0 to 2.0 times the standard's, and creep back. */
struct ddc_gap {
	int permille;
	bool slow;            /* it was found to need more */
	bool tried, on_trial; /* or only seemed to, being busy: the standard's waits get one more try soon */
	uint32_t n_clean, patience;
};
void ddc_gap_init(struct ddc_gap *g);
void ddc_gap_stretch(struct ddc_gap *g);          /* to the longest: it answered only then */
void ddc_gap_note(struct ddc_gap *g, bool clean); /* one exchange: an answer at the first try, or none */
int64_t ddc_gap_ns(const struct ddc_gap *g, int64_t standard_ns);

#endif
