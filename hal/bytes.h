/* hal/bytes.h: whole numbers as bytes, the lowest first. n: 1 .. 8. */
#ifndef BB_HAL_BYTES_H
#define BB_HAL_BYTES_H

#include <stddef.h>
#include <stdint.h>

static inline void bb_put_le(uint8_t *at, uint64_t value, size_t n)
{
	for (size_t i = 0; i < n; i++)
		at[i] = (uint8_t)(value >> 8 * i);
}

static inline uint64_t bb_get_le(const uint8_t *at, size_t n)
{
	uint64_t value = 0;

	for (size_t i = 0; i < n; i++)
		value |= (uint64_t)at[i] << 8 * i;
	return value;
}

#endif
