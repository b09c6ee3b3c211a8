/*
 * drivers/bus_modbus.h: one Modbus link through libmodbus: connect, one exchange at a time, hang up. libmodbus connects,
 * sets up the serial line, and collects a reply's bytes; it owns its waits, so everything here blocks up to the
 * deadline given and belongs on a thread of its own. Times are ns of the posix clock given. Requests over TCP are
 * framed here, because libmodbus 3.1.6 sends raw requests with transaction 0, and a late reply could not be told from
 * the one that is waited for.
 */
#ifndef BB_DRIVERS_BUS_MODBUS_H
#define BB_DRIVERS_BUS_MODBUS_H

#include "drivers/modbus_codec.h"
#include "hal/clock.h"

#define MODBUS_ALLOW_MAX 64
#define MODBUS_SENT_KEPT 16

struct bus_modbus_config {
	bool rtu;
	char host[16];            /* dotted IPv4: libmodbus takes a name for "any address" */
	uint16_t port;
	char tty[64];
	int baud, stop;
	char parity;              /* N E O */
	uint8_t unit;
	int64_t user_timeout_ns;  /* TCP_USER_TIMEOUT: unacknowledged data for so long ends the connection */
	size_t n_allow;
	struct modbus_allow allow[MODBUS_ALLOW_MAX];
};

struct bus_modbus;
BB_MUST_CHECK enum bb_status bus_modbus_create(const struct bus_modbus_config *config, struct bb_clock *clk,
                                               struct bus_modbus **out);
void bus_modbus_destroy(struct bus_modbus *b); /* NULL is allowed */
BB_MUST_CHECK enum bb_status bus_modbus_connect(struct bus_modbus *b, int64_t within_ns);
void bus_modbus_hang_up(struct bus_modbus *b);
bool bus_modbus_up(const struct bus_modbus *b);

/*
 * BB_OK: reply holds an answer or an exception. BB_TIMEOUT: nothing whole by the deadline; over TCP the link stays.
 * BB_ERR_REFUSED: not on the list, nothing was sent. BB_ERR_FORMAT: lies or garbage; BB_ERR_LOST: the link broke: both
 * have hung up (a serial line is drained instead). Late replies are discarded while waiting goes on; three in a row
 * without an answer are BB_ERR_FORMAT.
 */
BB_MUST_CHECK enum bb_status bus_modbus_exchange(struct bus_modbus *b, const struct modbus_request *request,
                                                 int64_t deadline_ns, struct modbus_reply *reply);
/* What the last exchange was like. */
struct bus_modbus_note {
	const char *why;          /* FORMAT and LOST: in words, static */
	int64_t took_ns;          /* BB_OK: request to reply */
	unsigned n_late;          /* replies to older requests seen in it */
	int64_t late_ns;          /* the slowest of them, request to arrival; 0: its request is forgotten */
	bool skewed;              /* FORMAT because of three late ones */
};
const struct bus_modbus_note *bus_modbus_note(const struct bus_modbus *b);

#endif
