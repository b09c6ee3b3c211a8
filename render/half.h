/*
 * render/half.h: IEEE 754 binary16 of values from 0 to 1, nearest with ties to even. What needs no sign needs no more.
 */
#ifndef BB_RENDER_HALF_H
#define BB_RENDER_HALF_H

#include <stdint.h>
#include <string.h>

static inline uint16_t bb_to_half(float v)
{
	uint32_t bits;

	if (!(v > 0))
		return 0;
	if (v < 0x1p-14f) /* denormal: units of 2^-24 */
		return (uint16_t)(v * 0x1p24f + 0.5f);
	memcpy(&bits, &v, 4);
	bits += 0xFFF + (bits >> 13 & 1);
	return (uint16_t)((bits >> 13) - (112u << 10));
}

static inline float bb_from_half(uint16_t h)
{
	const uint32_t bits = ((uint32_t)(h & 0x7FFF) << 13) + (112u << 23);
	float v;

	if (!(h & 0x7C00))
		return (float)(h & 0x3FF) * 0x1p-24f;
	memcpy(&v, &bits, 4);
	return v;
}

#endif
