/*
 * drivers/power_modbus.h: power strips on Modbus TCP and RTU: "modbus:tcp://192.168.1.40:502?model=netio&unit=1",
 * "modbus:rtu:/dev/ttyUSB0?unit=3&baud=9600". The options are the rows of modbus_map_options.
 *
 * libmodbus blocks, so a thread of the device's own does the talking and nothing the frame loop calls ever waits: set
 * leaves a command, read returns what was read back last. Nothing is written before the strip's identity registers were
 * read on this connection, and nothing but the outlets of the room file. The driver works on the posix clock only.
 */
#ifndef BB_DRIVERS_POWER_MODBUS_H
#define BB_DRIVERS_POWER_MODBUS_H

#include "hal/power_driver.h"

extern const struct bb_power_driver power_modbus_driver;

#define POWER_MODBUS_SPOILED_MOST 5 /* connections ended by lies within a minute: then the strip is quarantined */

/* Names of what can be wrong, as reports and last_error give them. */
#define POWER_MODBUS_FAULTS(X)                                                                                       \
	X(POWER_MODBUS_FINE, "")                                                                                     \
	X(POWER_MODBUS_TIMEOUT, "PDU_TIMEOUT")                                                                       \
	X(POWER_MODBUS_SKEW, "TID_SKEW")                                                                             \
	X(POWER_MODBUS_EXCEPTION, "EXCEPTION")                                                                       \
	X(POWER_MODBUS_HALF_OPEN, "HALF_OPEN")                                                                       \
	X(POWER_MODBUS_PROTO, "PROTO")                                                                               \
	X(POWER_MODBUS_ID, "ID_MISMATCH")                                                                            \
	X(POWER_MODBUS_LINK, "LINK_LOST")                                                                            \
	X(POWER_MODBUS_VERIFY, "VERIFY_FAIL")                                                                        \
	X(POWER_MODBUS_REFUSED, "WRITE_REFUSED")

enum power_modbus_fault {
#define X(name, text) name,
	POWER_MODBUS_FAULTS(X)
#undef X
	POWER_MODBUS_FAULT_COUNT
};
const char *power_modbus_fault_text(enum power_modbus_fault fault);

struct power_modbus_report {
	enum bb_health health;
	enum power_modbus_fault fault; /* the last one, until it is over: three good replies in a row */
	char text[80];           /* its details */
	int64_t at_ns;           /* when it was noticed first */
	uint64_t count[POWER_MODBUS_FAULT_COUNT]; /* how often each was noticed since open */
	uint64_t exchanges, connects;
	int64_t timeout_ns;      /* learned */
};
void power_modbus_report(struct bb_power *p, struct power_modbus_report *out);

#endif
