/* tests/fuzz/fuzz_vcp_capabilities.c: any bytes as a capabilities string. */
#include "drivers/vcp_capabilities.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct vcp_capabilities c;
	size_t known = 0;

	if (vcp_capabilities_parse((const char *)data, size, &c) != BB_OK)
		return 0;
	if (c.n_values > VCP_CAPABILITIES_VALUES || strlen(c.model) >= sizeof(c.model))
		abort();
	for (unsigned int code = 0; code < 256; code++) {
		known += c.code[code].known;
		if ((size_t)c.code[code].first + c.code[code].n > c.n_values)
			abort();
		(void)vcp_capabilities_allow(&c, (uint8_t)code, 0x0F);
	}
	if (known != c.n_codes)
		abort();
	return 0;
}
