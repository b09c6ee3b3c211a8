/*
 * sim/sim_i2c_target.h: what hangs on a simulated I2C bus, for whatever carries it (an adapter in this process, or
 * i2c-tiny-usb). One target may answer at several addresses. One thread; nothing waits.
 */
#ifndef BB_SIM_I2C_TARGET_H
#define BB_SIM_I2C_TARGET_H

#include "hal/base.h"

struct sim_i2c_target {
	/* A message of n bytes to, or from, a 7-bit address. False: nobody acknowledges it. */
	bool (*write)(void *ctx, uint8_t address, const uint8_t *bytes, size_t n);
	bool (*read)(void *ctx, uint8_t address, uint8_t *bytes, size_t n);
	void *ctx;
};

#endif
