/*
 * drivers/bus_i2c.h: hal/bus.h's I2C on Linux i2c-dev. A transfer blocks for as long as it is on the wire (about 3 ms
 * for the longest that monitor_ddc asks for), so the caller keeps transfers short. One thread a bus.
 */
#ifndef BB_DRIVERS_BUS_I2C_H
#define BB_DRIVERS_BUS_I2C_H

#include "hal/bus.h"

/* path: "/dev/i2c-4". BB_ERR_LOST: no such device; BB_ERR_REFUSED: no permission; BB_ERR_UNSUPPORTED: not an I2C
 * adapter, or one that only speaks SMBus. errno is left for the caller's message. plain: read() and write() instead
 * of I2C_RDWR, for drivers that do not have it; then messages have no repeated starts. */
BB_MUST_CHECK enum bb_status bus_i2c_open(const char *path, bool plain, struct bb_clock *clk, struct bb_i2c_bus **out);

#endif
