/*
 * sim/vcp_model.h: the VCP codes of a simulated monitor (MCCS 2.2) and what they may hold: which can be read or
 * written, legal values, factory defaults. Values only: no time, no wire.
 */
#ifndef BB_SIM_VCP_MODEL_H
#define BB_SIM_VCP_MODEL_H

#include "hal/monitor.h"
#include "sim/faults.h"

#define VCP_INPUT_DP1 0x0F
#define VCP_INPUT_HDMI1 0x11

struct vcp_state {
	uint16_t new_control, luminance, contrast, preset, red, green, blue, input, power_mode;
	uint16_t cabled_input; /* frequencies can be told on this one only */
	double line_hz, rate_hz;
	uint32_t base_hours;
	int64_t lit_ns;        /* kept by the owner: adds to the hours */
	uint16_t before_input, before_luminance; /* what ending the faults "input" and "drift" goes back to */
};

void vcp_init(struct vcp_state *v, uint16_t cabled_input, double line_hz, double rate_hz, uint32_t base_hours);
/* As DDC/CI answers: *most is the maximum; 24-bit values have their high byte there, 0xFFFF in both is "cannot
 * determine". BB_ERR_UNSUPPORTED for codes that are unknown or write-only. */
BB_MUST_CHECK enum bb_status vcp_get(const struct vcp_state *v, uint8_t code, uint16_t *current, uint16_t *most);
/* BB_ERR_UNSUPPORTED for codes that are unknown or read-only, BB_ERR_RANGE (and no change) for illegal values. */
BB_MUST_CHECK enum bb_status vcp_set(struct vcp_state *v, uint8_t code, uint16_t value);
/* At the monitor's own buttons: tells the host by code 02. Only for input and luminance. */
void vcp_by_hand(struct vcp_state *v, uint8_t code, uint16_t value);
/* The faults "input [value=CODE]" and "drift [luminance=N]" of whoever has these codes; v NULL: arguments only. */
BB_MUST_CHECK enum bb_status vcp_fault_input(struct vcp_state *v, const struct sim_fault_args *args, bool on,
                                             struct bb_error *err);
BB_MUST_CHECK enum bb_status vcp_fault_drift(struct vcp_state *v, const struct sim_fault_args *args, bool on,
                                             struct bb_error *err);
/* The capabilities string: every code above with its legal values. Returns its length; 0 when cap is too small. */
size_t vcp_text(const char *model, char *out, size_t cap);
/* Share of the peak luminance that the settings leave. */
double vcp_light(const struct vcp_state *v);

#endif
