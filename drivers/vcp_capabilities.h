/*
 * drivers/vcp_capabilities.h: reads the capabilities string of a display, "(prot(monitor)type(LCD)...vcp(02 10
 * 60(0F 11))mccs_ver(2.2))". Real ones are malformed in many ways, so this takes what it can and says what was wrong:
 * missing blanks and brackets, cut ends, noise. One pass, no recursion, nothing allocated.
 */
#ifndef BB_DRIVERS_VCP_CAPABILITIES_H
#define BB_DRIVERS_VCP_CAPABILITIES_H

#include "hal/status.h"

#define VCP_CAPABILITIES_VALUES 1024

struct vcp_capability {
	bool known;        /* the display lists this code */
	uint16_t first, n; /* its legal values: in vcp_capabilities.value; n == 0: any, or not told */
};

struct vcp_capabilities {
	char prot[16], type[16], model[32];
	uint8_t mccs_major, mccs_minor; /* 0, 0: not told */
	bool command[256];
	struct vcp_capability code[256];
	size_t n_codes, n_values;
	uint8_t value[VCP_CAPABILITIES_VALUES];
	bool unbalanced; /* a bracket is missing or one too many */
	bool noise;      /* something that is no code where a code belongs */
};

/* BB_ERR_FORMAT when not a single code or keyword was found; *out then says nothing. */
BB_MUST_CHECK enum bb_status vcp_capabilities_parse(const char *text, size_t n, struct vcp_capabilities *out);
/* Does the display list this value for this code? True as well when it lists the code without values. */
bool vcp_capabilities_allow(const struct vcp_capabilities *c, uint8_t code, uint8_t value);

#endif
