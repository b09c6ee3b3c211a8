/*
 * drivers/bus_i2c.h: hal/bus.h's I2C on Linux i2c-dev, on the posix clock. The kernel blocks a caller for as long as a
 * transfer is on the wire, and for seconds when an adapter does not answer: each bus has a thread for that, and a
 * transfer is BB_ERR_BUSY until it is over. The caller is one thread; closing does not wait either.
 *
 * Between transfers the node is closed: a kernel waits for the last one to close it before it lets an unplugged adapter
 * go, and holds up every other plug of that USB hub until then.
 */
#ifndef BB_DRIVERS_BUS_I2C_H
#define BB_DRIVERS_BUS_I2C_H

#include "hal/bus.h"

struct bus_i2c_options {
	const char *path;   /* "/dev/i2c-4"; "" with a serial */
	const char *serial; /* the bus on which an EDID has it (text, or number in decimal), wherever that is plugged
			       in; "" */
	bool plain;         /* read() and write() instead of I2C_RDWR, for drivers without it: no repeated starts */
};

/* BB_ERR_LOST: no such device; BB_ERR_REFUSED: no permission; BB_ERR_UNSUPPORTED: not an I2C adapter, or one that only
 * speaks SMBus. errno is left for the caller's message. With a serial BB_OK: transfers look for it, and are BB_ERR_LOST
 * when no bus has it. A message has at most 64 bytes. */
BB_MUST_CHECK enum bb_status bus_i2c_open(const struct bus_i2c_options *options, struct bb_clock *clk,
					  struct bb_i2c_bus **out);

#endif
