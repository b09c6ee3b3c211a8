/*
 * drivers/modbus_map.h: where a model of power strip keeps what in its registers, and how the link is set up: the
 * options of a "modbus:" URI over the presets of known models. Data, filled once at open. Stateless.
 */
#ifndef BB_DRIVERS_MODBUS_MAP_H
#define BB_DRIVERS_MODBUS_MAP_H

#include "drivers/bus_modbus.h"
#include "hal/options.h"
#include "hal/power.h"
#include "hal/uri.h"

#define MODBUS_ID_WORDS_MAX 8

enum modbus_word_order { MODBUS_WORDS_BIG, MODBUS_WORDS_LITTLE };

struct modbus_map { /* addresses as the strip's manual counts them; `base` is subtracted on the way to the wire */
	int model, kind, id_kind, parity;
	int64_t unit, base;
	int64_t command;         /* of outlet 1: coil or holding register, by kind */
	int64_t contact;         /* discrete input of outlet 1; -1: reading the command back is all there is */
	int64_t current;         /* input register of outlet 1; -1: no meter */
	int64_t current_step, current_words;
	int word_order;
	double current_scale_a;
	int64_t id_at;           /* identity registers; -1: none known, and then nothing is ever written */
	char id[48];             /* "4242-5057": their words */
	int64_t relay_ms, timeout_least_ms, timeout_most_ms, poll_ms, half_open_ms;
	int64_t baud, stop;
	size_t n_id;
	uint16_t id_word[MODBUS_ID_WORDS_MAX];
};

extern const struct bb_option modbus_map_options[];
/* The URI's options over its model's preset; every outlet must have a place on the wire. Errors 1501, 1570, 101x. */
BB_MUST_CHECK enum bb_status modbus_map_read(const struct bb_uri *uri, const struct bb_power_config *config,
                                             struct modbus_map *map, struct bb_error *err);
/* "tcp://127.0.0.1:1502" or "rtu:/dev/ttyUSB0" and the map's part of it; the writes of config's outlets are allowed. */
BB_MUST_CHECK enum bb_status modbus_map_link(const struct bb_uri *uri, const struct bb_power_config *config,
                                             const struct modbus_map *map, struct bus_modbus_config *link,
                                             struct bb_error *err);

/* Requests. outlet: the strip's own number. */
struct modbus_request modbus_map_write(const struct modbus_map *m, int64_t outlet, bool on);
struct modbus_request modbus_map_read_command(const struct modbus_map *m, int64_t first, int64_t count);
struct modbus_request modbus_map_read_contact(const struct modbus_map *m, int64_t first, int64_t count);
/* Currents of so many outlets fit one request. */
size_t modbus_map_current_block(const struct modbus_map *m);
struct modbus_request modbus_map_read_current(const struct modbus_map *m, int64_t first, int64_t count);
struct modbus_request modbus_map_read_id(const struct modbus_map *m);
/* Of the i-th outlet of such a request. */
double modbus_map_current_a(const struct modbus_map *m, const struct modbus_reply *reply, size_t i);

#endif
