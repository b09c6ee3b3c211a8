#include "drivers/modbus_map.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define M struct modbus_map
#define ENUM(member, def, words, help) \
	{ #member, BB_OPT_TYPE_ENUM, offsetof(M, member), 0, def, 0, 0, 1, words, false, help }

enum { MODEL_BLACKBURST, MODEL_GENERIC, MODEL_NETIO, MODEL_GUDE, N_MODELS };
enum { KIND_COIL, KIND_HOLDING };
enum { ID_INPUT, ID_HOLDING };

const struct bb_option modbus_map_options[] = {
	ENUM(model, MODEL_BLACKBURST, "blackburst|generic|netio|gude", "register map of a known model"),
	BB_OPT_I64(M, unit, 1, 0, 255, "unit (slave) number"),
	BB_OPT_I64(M, base, 0, 0, 1, "first number in the strip's manual: 1 if it counts from 1"),
	ENUM(kind, KIND_COIL, "coil|holding", "what switches an outlet"),
	BB_OPT_I64(M, command, -1, -1, 65535, "address of outlet 1's coil or register"),
	BB_OPT_I64(M, contact, -1, -1, 65535, "discrete input of outlet 1's contact; -1: none"),
	BB_OPT_I64(M, current, -1, -1, 65535, "input register of outlet 1's current; -1: none"),
	BB_OPT_I64(M, current_step, 1, 1, 1024, "registers from one outlet's current to the next"),
	BB_OPT_I64(M, current_words, 1, 1, 2, "registers of one current"),
	ENUM(word_order, MODBUS_WORDS_BIG, "big|little", "which word of two comes first"),
	BB_OPT_F64(M, current_scale_a, 0.001, 1e-6, 100, "amperes of one count"),
	BB_OPT_I64(M, id_at, -1, -1, 65535, "first identity register; -1: none, and then nothing is written"),
	ENUM(id_kind, ID_INPUT, "input|holding", "kind of the identity registers"),
	{ "id", BB_OPT_TYPE_TEXT, offsetof(M, id), sizeof(((M *)0)->id), 0, 0, 0, 1, "", false,
	  "their words in hexadecimal: 4242-5057" },
	BB_OPT_I64(M, relay_ms, 50, 1, 2000, "a relay has settled after"),
	BB_OPT_I64(M, timeout_least_ms, 200, 20, 3000, "learned time-out, at least"),
	BB_OPT_I64(M, timeout_most_ms, 3000, 20, 3000, "learned time-out, at most"),
	BB_OPT_I64(M, poll_ms, 500, 10, 10000, "between two readings"),
	BB_OPT_I64(M, half_open_ms, 2500, 100, 60000, "silence after which a connection counts as dead"),
	BB_OPT_I64(M, baud, 19200, 1200, 921600, "RTU"),
	ENUM(parity, 1, "none|even|odd", "RTU"),
	BB_OPT_I64(M, stop, 1, 1, 2, "RTU: stop bits"),
	BB_OPT_END
};

/* What is known of each model; a manual's number where the manual gives one, see docs/modbus.md. */
static const struct {
	const char *key, *value[N_MODELS];
} presets[] = {
	{ "command", { "0", NULL, "101", "0" } },
	{ "contact", { "0", NULL, NULL, NULL } },
	{ "current", { "256", NULL, "101", NULL } },
	{ "id_at", { "0", NULL, NULL, NULL } },
	{ "id", { "4242-5057", NULL, NULL, NULL } },
};

static enum bb_status set(struct modbus_map *map, const char *key, const char *value, struct bb_error *err)
{
	const struct bb_where where = { 0 };

	return bb_options_set(modbus_map_options, map, key, value, &where, err);
}

static enum bb_status bad(const char *what, struct bb_error *err)
{
	return bb_fail(err, BB_ERR_CONFIG, 1570, NULL, "%s", what);
}

/* "4242-5057" */
static enum bb_status read_id(struct modbus_map *map, struct bb_error *err)
{
	const char *at = map->id;

	for (map->n_id = 0; *at; at += *at == '-') {
		char *end;
		const size_t digits = strspn(at, "0123456789abcdefABCDEF");
		if (digits < 1 || digits > 4 || map->n_id == MODBUS_ID_WORDS_MAX)
			return bad("id is up to eight words of four hexadecimal digits: 4242-5057", err);
		map->id_word[map->n_id++] = (uint16_t)strtoul(at, &end, 16);
		at = end;
		if (*at && (*at != '-' || !at[1]))
			return bad("id is words with '-' between them: 4242-5057", err);
	}
	return (map->id_at >= 0) == (map->n_id > 0) ? BB_OK : bad("id_at and id belong together", err);
}

static bool reaches(int64_t first, int64_t base, int64_t span)
{
	return first < 0 || (first - base >= 0 && first - base + span <= 65536);
}

static enum bb_status check(const struct modbus_map *m, const struct bb_power_config *config, struct bb_error *err)
{
	int64_t highest = 1;

	for (size_t i = 0; i < config->n_outlets; i++) {
		if (config->outlet[i].outlet < 1 || config->outlet[i].outlet > BB_OUTLETS_MAX)
			return bad("an outlet's number is 1 to 64", err);
		highest = config->outlet[i].outlet > highest ? config->outlet[i].outlet : highest;
	}
	if (m->command < 0)
		return bad("where is outlet 1 switched? give model or command", err);
	if (m->timeout_least_ms > m->timeout_most_ms)
		return bad("timeout_least_ms is above timeout_most_ms", err);
	if (!reaches(m->command, m->base, highest) || !reaches(m->contact, m->base, highest) ||
	    !reaches(m->current, m->base, (highest - 1) * m->current_step + m->current_words) ||
	    !reaches(m->id_at, m->base, (int64_t)m->n_id))
		return bad("an address is below the base or beyond 65535", err);
	return BB_OK;
}

enum bb_status modbus_map_read(const struct bb_uri *uri, const struct bb_power_config *config, struct modbus_map *map,
                               struct bb_error *err)
{
	enum bb_status status = BB_OK;

	memset(map, 0, sizeof(*map));
	bb_options_defaults(modbus_map_options, map);
	for (size_t i = 0; i < uri->n_options && status == BB_OK; i++)
		if (!strcmp(uri->option[i].key, "model"))
			status = set(map, "model", uri->option[i].value, err);
	for (size_t i = 0; i < BB_ARRAY_LEN(presets) && status == BB_OK; i++)
		if (presets[i].value[map->model])
			status = set(map, presets[i].key, presets[i].value[map->model], err);
	for (size_t i = 0; i < uri->n_options && status == BB_OK; i++)
		status = set(map, uri->option[i].key, uri->option[i].value, err);
	if (status == BB_OK)
		status = read_id(map, err);
	return status == BB_OK ? check(map, config, err) : status;
}

static enum bb_status read_tcp(const char *path, struct bus_modbus_config *link, struct bb_error *err)
{
	struct in_addr a;
	char *end;
	const char *colon = strchr(path, ':');
	const size_t n = colon ? (size_t)(colon - path) : strlen(path);

	if (n >= sizeof(link->host))
		return bb_fail(err, BB_ERR_CONFIG, 1501, NULL, "tcp://%.40s: want a dotted address", path);
	memcpy(link->host, path, n);
	link->host[n] = '\0';
	if (inet_pton(AF_INET, link->host, &a) != 1)
		return bb_fail(err, BB_ERR_CONFIG, 1501, NULL, "tcp://%.40s: want a dotted address, names are not looked up",
		               path);
	link->port = 502;
	if (!colon)
		return BB_OK;
	const unsigned long port = strtoul(colon + 1, &end, 10);
	if (colon[1] < '0' || colon[1] > '9' || *end || port < 1 || port > 65535)
		return bb_fail(err, BB_ERR_CONFIG, 1501, NULL, "tcp://%.40s: the port is 1 to 65535", path);
	link->port = (uint16_t)port;
	return BB_OK;
}

static enum bb_status read_path(const char *path, struct bus_modbus_config *link, struct bb_error *err)
{
	if (!strncmp(path, "tcp://", 6))
		return read_tcp(path + 6, link, err);
	if (strncmp(path, "rtu:/", 5) != 0 || strlen(path + 4) >= sizeof(link->tty))
		return bb_fail(err, BB_ERR_CONFIG, 1501, NULL,
		               "modbus:%.60s: want tcp://ADDRESS:PORT or rtu:/dev/TERMINAL", path);
	link->rtu = true;
	snprintf(link->tty, sizeof(link->tty), "%s", path + 4);
	return BB_OK;
}

enum bb_status modbus_map_link(const struct bb_uri *uri, const struct bb_power_config *config,
                               const struct modbus_map *map, struct bus_modbus_config *link, struct bb_error *err)
{
	memset(link, 0, sizeof(*link));
	const enum bb_status status = read_path(uri->path, link, err);
	if (status != BB_OK)
		return status;
	if (link->rtu && (map->unit < 1 || map->unit > 247))
		return bad("an RTU unit is 1 to 247", err);
	link->unit = (uint8_t)map->unit;
	link->baud = (int)map->baud;
	link->stop = (int)map->stop;
	link->parity = "NEO"[map->parity];
	link->user_timeout_ns = map->half_open_ms * 1000000;
	for (size_t i = 0; map->id_at >= 0 && i < config->n_outlets && i < MODBUS_ALLOW_MAX; i++) {
		const struct modbus_request on = modbus_map_write(map, config->outlet[i].outlet, true);
		link->allow[link->n_allow++] = (struct modbus_allow){ on.function, on.address, 0, on.value };
	}
	return BB_OK;
}

static struct modbus_request request(const struct modbus_map *m, uint8_t function, int64_t address, int64_t value)
{
	return (struct modbus_request){ (uint8_t)m->unit, function, (uint16_t)(address - m->base), (uint16_t)value };
}

struct modbus_request modbus_map_write(const struct modbus_map *m, int64_t outlet, bool on)
{
	const bool coil = m->kind == KIND_COIL;

	return request(m, coil ? MODBUS_FN_WRITE_COIL : MODBUS_FN_WRITE_REGISTER, m->command + outlet - 1,
	               !on ? 0 : coil ? MODBUS_COIL_ON : 1);
}

struct modbus_request modbus_map_read_command(const struct modbus_map *m, int64_t first, int64_t count)
{
	return request(m, m->kind == KIND_COIL ? MODBUS_FN_READ_COILS : MODBUS_FN_READ_HOLDING, m->command + first - 1,
	               count);
}

struct modbus_request modbus_map_read_contact(const struct modbus_map *m, int64_t first, int64_t count)
{
	return request(m, MODBUS_FN_READ_INPUTS, m->contact + first - 1, count);
}

size_t modbus_map_current_block(const struct modbus_map *m)
{
	const int64_t n = (MODBUS_READ_REGISTERS_MOST - m->current_words) / m->current_step + 1;

	return m->current_step > MODBUS_READ_REGISTERS_MOST ? 1 : (size_t)n;
}

struct modbus_request modbus_map_read_current(const struct modbus_map *m, int64_t first, int64_t count)
{
	return request(m, MODBUS_FN_READ_INPUT_REGISTERS, m->current + (first - 1) * m->current_step,
	               (count - 1) * m->current_step + m->current_words);
}

struct modbus_request modbus_map_read_id(const struct modbus_map *m)
{
	return request(m, m->id_kind == ID_INPUT ? MODBUS_FN_READ_INPUT_REGISTERS : MODBUS_FN_READ_HOLDING, m->id_at,
	               (int64_t)m->n_id);
}

double modbus_map_current_a(const struct modbus_map *m, const struct modbus_reply *reply, size_t i)
{
	const size_t at = i * (size_t)m->current_step;
	const uint32_t first = at < MODBUS_VALUES_MAX ? reply->value[at] : 0;
	const uint32_t second = at + 1 < MODBUS_VALUES_MAX ? reply->value[at + 1] : 0;

	if (m->current_words == 1)
		return first * m->current_scale_a;
	return (m->word_order == MODBUS_WORDS_BIG ? first << 16 | second : second << 16 | first) * m->current_scale_a;
}
