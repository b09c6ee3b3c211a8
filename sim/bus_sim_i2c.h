/*
 * sim/bus_sim_i2c.h: hal/bus.h's I2C bus with a simulated monitor at its end, at 100 kHz on the injected clock: a
 * transfer answers at once and free_ns says when it is over on the wire. Buses may share one adapter: then a transfer
 * is BB_ERR_BUSY while another owns the wire, and behind a mux the channel has to be selected first. One thread.
 */
#ifndef BB_SIM_BUS_SIM_I2C_H
#define BB_SIM_BUS_SIM_I2C_H

#include "hal/bus.h"
#include "sim/peer_ddcci.h"

#define BUS_SIM_I2C_BYTE_NS INT64_C(90000) /* nine bits */

struct bus_sim_adapter { /* the caller's memory; zero is free; outlives its buses */
	bool mux;        /* two bytes (address, channel) before a transfer on another channel than the last */
	int64_t free_ns;
	const struct bb_i2c_bus *selected;
	uint64_t transfers;
};

/* The peer is borrowed. adapter NULL: one of its own. */
BB_MUST_CHECK enum bb_status bus_sim_i2c_create(struct bb_clock *clk, struct peer_ddcci *peer,
						struct bus_sim_adapter *adapter, struct bb_i2c_bus **out);

#endif
