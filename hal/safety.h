/*
 * hal/safety.h: the ceilings that protect people and lamps, in one small file. Configuration can only tighten them.
 * Sources: WCAG 2.3.1 (three flashes in any second; a surround room fills the visual field, so the area exemption never
 * holds), projector makers' relight lock-out and inrush advice. blackburst is not a certified safety function. What the outputs do
 * about it: hal/safe_state.h; who measures it: sync/flash_meter.h; what it all amounts to: docs/safety.md.
 */
#ifndef BB_HAL_SAFETY_H
#define BB_HAL_SAFETY_H

#include "hal/status.h"

struct bb_safety {
	double flashes_per_s;          /* at most; ceiling 3 */
	double fade_ms;                /* stereo/mono/black transitions take at least; ceiling floor 500 */
	double transition_gap_s;       /* between two such transitions at least; floor 2 */
	double shutter_least_hz;       /* per eye; floor 50 */
	double holdover_most_s;        /* the outputs coast on the last known rhythm at most; ceiling 900 */
	double white_cd_m2;            /* what an eye is taken to see of white through open shutters; floor 200 */
	double outlet_least_off_s;     /* floor 180 */
	double outlet_least_on_s;      /* floor 60 */
	double outlet_cycles_per_hour; /* at most; ceiling 4 */
	double outlet_stagger_ms;      /* between two outlets switching on; floor 500 */
	bool allow_ddc_power_off;      /* VCP D6 = 5; can only be made false: it is false */
	bool allow_ddc_save;           /* DDC/CI save current settings; false */
};

/* The ceilings themselves. */
struct bb_safety bb_safety_ceilings(void);
/* Take over one wish if it is at least as strict as the ceiling; otherwise BB_ERR_REFUSED, error 1120, *s untouched. */
BB_MUST_CHECK enum bb_status bb_safety_tighten(struct bb_safety *s, const char *key, double value,
                                               const struct bb_where *where, struct bb_error *err);
/* How long a rhythm of this period, known to this uncertainty (one sigma), may be coasted on until its phase is a tenth
 * of a period off: 8.3 s for 120 Hz at 100 ppm; never more than holdover_most_s, 0 when the uncertainty is unknown. */
int64_t bb_safety_holdover_ns(const struct bb_safety *s, int64_t period_ns, double uncertainty_ppm);

#endif
