/* tests/fuzz/fuzz_vcp_capabilities.c: any bytes as a capabilities string. */
#include "drivers/vcp_capabilities.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct vcp_capabilities c;
	size_t known = 0;

	if (vcp_capabilities_parse((const char *)data, size, &c) != BB_OK)
		return 0;
	fuzz_must(c.n_values <= VCP_CAPABILITIES_VALUES);
	fuzz_must(strlen(c.model) < sizeof(c.model) && strlen(c.type) < sizeof(c.type) &&
		  strlen(c.prot) < sizeof(c.prot));
	for (unsigned int code = 0; code < 256; code++) {
		const struct vcp_capability *row = &c.code[code];
		fuzz_must((size_t)row->first + row->n <= c.n_values && (row->known || !row->n));
		known += row->known;
		if (row->known)
			fuzz_must(vcp_capabilities_allow(&c, (uint8_t)code, row->n ? c.value[row->first] : 0x0F));
		if (row->n)
			(void)vcp_capabilities_allow(&c, (uint8_t)code, 0x0F);
	}
	fuzz_must(known == c.n_codes);
	return 0;
}
