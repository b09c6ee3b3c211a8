/* drivers/modbus_strip.c: see drivers/modbus_strip.h. */
#include "drivers/modbus_strip.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define MS INT64_C(1000000)
#define BUSY_RETRY_NS BB_NS_PER_S          /* exceptions 05 and 06: a second at least */
#define COMMAND_LIFE_NS (5 * BB_NS_PER_S)  /* an older command is dropped: nobody expects it any more */
#define SPOILED_WINDOW_NS (60 * BB_NS_PER_S)
#define GOOD_TO_RECOVER 3

void modbus_strip_init(struct modbus_strip *s, const struct bb_power_config *config, const struct modbus_map *map,
                       struct bus_modbus *bus, struct bb_clock *clk, uint64_t seed)
{
	memset(s, 0, sizeof(*s));
	s->config = config;
	s->map = map;
	s->bus = bus;
	s->clk = clk;
	s->pace.least_ns = map->timeout_least_ms * MS;
	s->pace.most_ns = map->timeout_most_ms * MS;
	s->backoff.random = seed;
	s->report.timeout_ns = s->pace.most_ns;
	s->last_heard_ns = bb_clock_now_ns(clk);
}

static int64_t now(const struct modbus_strip *s)
{
	return bb_clock_now_ns(s->clk);
}

/* ---- what is wrong ---- */

static void forget_states(struct modbus_strip *s)
{
	for (size_t i = 0; i < s->config->n_outlets; i++)
		s->outlet[i].state.known = false;
}

BB_PRINTF(4, 5)
static void notice(struct modbus_strip *s, enum power_modbus_fault fault, enum bb_health health, const char *fmt, ...)
{
	va_list ap;

	if (s->report.fault != fault)
		s->report.at_ns = now(s);
	s->report.fault = fault;
	s->report.count[fault]++;
	s->report.health = health;
	s->good_in_a_row = 0;
	va_start(ap, fmt);
	vsnprintf(s->report.text, sizeof(s->report.text), fmt, ap);
	va_end(ap);
}

static bool quarantined(const struct modbus_strip *s)
{
	return s->report.health == BB_HEALTH_QUARANTINED;
}

static bool any_mismatch(const struct modbus_strip *s)
{
	for (size_t i = 0; i < s->config->n_outlets; i++)
		if (s->outlet[i].mismatch)
			return true;
	return false;
}

static void good(struct modbus_strip *s)
{
	s->last_heard_ns = now(s);
	if (++s->good_in_a_row < GOOD_TO_RECOVER || quarantined(s))
		return;
	s->backoff.tries = 0;
	if (any_mismatch(s)) /* the link is well, an outlet is not */
		return;
	s->report.health = BB_HEALTH_OK;
	s->report.fault = POWER_MODBUS_FINE;
	s->report.text[0] = '\0';
}

static void try_later(struct modbus_strip *s)
{
	bus_modbus_hang_up(s->bus);
	s->next_try_ns = now(s) + modbus_backoff_next_ns(&s->backoff);
}

/* Lies, five within a minute: not a device to go on with. A person looks at it and opens it again. */
static void count_spoiled(struct modbus_strip *s, const char *why)
{
	int64_t *slot = &s->spoiled_ns[s->n_spoiled % POWER_MODBUS_SPOILED_MOST];
	const bool too_often = s->n_spoiled >= POWER_MODBUS_SPOILED_MOST && now(s) - *slot < SPOILED_WINDOW_NS;

	*slot = now(s);
	s->n_spoiled++;
	if (too_often)
		notice(s, POWER_MODBUS_PROTO, BB_HEALTH_QUARANTINED, "again and again: %s", why);
}

static void timed_out(struct modbus_strip *s, int64_t waited_ns)
{
	const int64_t silent_ns = now(s) - s->last_heard_ns;
	const unsigned n_late = bus_modbus_note(s->bus)->n_late;

	if (n_late) {
		notice(s, POWER_MODBUS_SKEW, BB_HEALTH_DEGRADED, "%u late replies, none in time", n_late);
		s->next_poll_ns = now(s);
		return;
	}
	if (silent_ns < s->map->half_open_ms * MS) {
		notice(s, POWER_MODBUS_TIMEOUT, BB_HEALTH_DEGRADED, "no answer within %lld ms", (long long)(waited_ns / MS));
		s->next_poll_ns = now(s);
		return;
	}
	notice(s, POWER_MODBUS_HALF_OPEN, BB_HEALTH_LOST, "connected, but silent for %lld ms", (long long)(silent_ns / MS));
	try_later(s);
}

static void failed(struct modbus_strip *s, enum bb_status status, int64_t waited_ns)
{
	const struct bus_modbus_note *note = bus_modbus_note(s->bus);

	s->identified = false; /* whoever answers next may be another */
	forget_states(s);
	if (status == BB_TIMEOUT) {
		timed_out(s, waited_ns);
	} else if (status == BB_ERR_FORMAT) {
		notice(s, note->skewed ? POWER_MODBUS_SKEW : POWER_MODBUS_PROTO, BB_HEALTH_LOST, "%s", note->why);
		count_spoiled(s, note->why);
		try_later(s);
	} else {
		notice(s, POWER_MODBUS_LINK, BB_HEALTH_LOST, "%s", note->why);
		try_later(s);
	}
}

/* ---- one exchange ---- */

static enum bb_status ask(struct modbus_strip *s, const struct modbus_request *request, struct modbus_reply *reply)
{
	const int64_t wait_ns = modbus_pace_timeout_ns(&s->pace);
	const enum bb_status status = bus_modbus_exchange(s->bus, request, now(s) + wait_ns, reply);
	const struct bus_modbus_note *note = bus_modbus_note(s->bus);

	s->report.exchanges++;
	if (note->n_late) /* too late is not silent */
		s->last_heard_ns = now(s);
	if (note->late_ns)
		modbus_pace_add(&s->pace, note->late_ns);
	if (status == BB_OK)
		modbus_pace_add(&s->pace, note->took_ns);
	s->report.timeout_ns = modbus_pace_timeout_ns(&s->pace);
	if (status == BB_ERR_REFUSED) {
		notice(s, POWER_MODBUS_REFUSED, BB_HEALTH_DEGRADED, "function %02X address %u is not on the list",
		       request->function, request->address);
		return status;
	}
	if (status != BB_OK) {
		failed(s, status, wait_ns);
		return status;
	}
	if (note->n_late)
		notice(s, POWER_MODBUS_SKEW, BB_HEALTH_DEGRADED, "%u late replies discarded", note->n_late);
	if (reply->verdict == MODBUS_ANSWER)
		good(s);
	return BB_OK;
}

static void notice_exception(struct modbus_strip *s, const char *what, uint8_t code)
{
	s->last_heard_ns = now(s); /* it answers */
	notice(s, POWER_MODBUS_EXCEPTION, BB_HEALTH_DEGRADED, "%s: exception %02X", what, code);
}

/* 01 to 04 and 07 will be the same next time. */
static bool permanent(uint8_t code)
{
	return code <= MODBUS_EX_FAILURE || code == MODBUS_EX_NEGATIVE;
}

/* ---- connecting ---- */

static void refuse_identity(struct modbus_strip *s, const struct modbus_reply *reply)
{
	const struct modbus_map *m = s->map;
	size_t i = 0;

	while (i < m->n_id && i < reply->n && reply->value[i] == m->id_word[i])
		i++;
	forget_states(s);
	if (reply->verdict == MODBUS_EXCEPTION)
		notice(s, POWER_MODBUS_ID, BB_HEALTH_QUARANTINED, "identity registers: exception %02X", reply->exception);
	else
		notice(s, POWER_MODBUS_ID, BB_HEALTH_QUARANTINED, "register %lld is %04X, want %04X",
		       (long long)m->id_at + (long long)i, reply->value[i], m->id_word[i]);
	bus_modbus_hang_up(s->bus);
}

static void identify(struct modbus_strip *s)
{
	const struct modbus_request request = modbus_map_read_id(s->map);
	struct modbus_reply reply;

	if (s->map->id_at < 0) {
		s->identified = true;
		return;
	}
	if (ask(s, &request, &reply) != BB_OK)
		return;
	if (reply.verdict == MODBUS_EXCEPTION && !permanent(reply.exception)) {
		notice_exception(s, "identity", reply.exception);
		s->next_poll_ns = now(s) + BUSY_RETRY_NS;
		return;
	}
	if (reply.verdict == MODBUS_EXCEPTION || memcmp(reply.value, s->map->id_word, 2 * s->map->n_id) != 0) {
		refuse_identity(s, &reply);
		return;
	}
	s->identified = true;
	s->next_poll_ns = now(s);
}

static void connect(struct modbus_strip *s)
{
	if (bus_modbus_connect(s->bus, s->pace.most_ns) != BB_OK) {
		forget_states(s);
		notice(s, POWER_MODBUS_LINK, BB_HEALTH_LOST, "%s", bus_modbus_note(s->bus)->why);
		try_later(s);
		return;
	}
	s->report.connects++;
	s->identified = false;
	s->last_heard_ns = now(s);
	s->next_poll_ns = now(s);
	s->report.health = s->report.fault == POWER_MODBUS_FINE ? BB_HEALTH_INIT : BB_HEALTH_RECOVERING;
}

/* ---- reading back ---- */

struct span {
	int64_t first, count;
};

static struct span outlets(const struct bb_power_config *c)
{
	int64_t least = BB_OUTLETS_MAX, most = 1;

	for (size_t i = 0; i < c->n_outlets; i++) {
		least = c->outlet[i].outlet < least ? c->outlet[i].outlet : least;
		most = c->outlet[i].outlet > most ? c->outlet[i].outlet : most;
	}
	return (struct span){ least, most - least + 1 };
}

/* Asks for one thing of all outlets. *missing becomes true once the strip has said that it has no such thing. */
static enum bb_status fetch(struct modbus_strip *s, const struct modbus_request *request, const char *what,
                            bool *missing, struct modbus_reply *reply)
{
	const enum bb_status status = ask(s, request, reply);

	if (status != BB_OK)
		return status;
	if (reply->verdict == MODBUS_ANSWER)
		return BB_OK;
	notice_exception(s, what, reply->exception);
	if (missing && permanent(reply->exception))
		*missing = true;
	return BB_ERR_IO;
}

static void read_currents(struct modbus_strip *s, struct span all)
{
	const int64_t block = (int64_t)modbus_map_current_block(s->map);
	struct modbus_reply reply;

	for (int64_t done = 0; done < all.count && !s->no_meter; done += block) {
		const int64_t first = all.first + done, n = all.count - done < block ? all.count - done : block;
		const struct modbus_request request = modbus_map_read_current(s->map, first, n);
		if (fetch(s, &request, "current", &s->no_meter, &reply) != BB_OK)
			return;
		for (size_t i = 0; i < s->config->n_outlets; i++) {
			const int64_t at = s->config->outlet[i].outlet - first;
			if (at >= 0 && at < n)
				s->outlet[i].state.current_a = modbus_map_current_a(s->map, &reply, (size_t)at);
		}
	}
}

/* Commands and contacts of all outlets: both or none become known. */
static enum bb_status read_outlets(struct modbus_strip *s, struct span all)
{
	struct modbus_request request = modbus_map_read_command(s->map, all.first, all.count);
	struct modbus_reply commands, contacts;
	enum bb_status status = fetch(s, &request, "outlets", NULL, &commands);

	if (status == BB_OK && s->map->contact >= 0) {
		request = modbus_map_read_contact(s->map, all.first, all.count);
		status = fetch(s, &request, "contacts", NULL, &contacts);
	} else {
		contacts = commands;
	}
	if (status != BB_OK) {
		forget_states(s);
		return status;
	}
	for (size_t i = 0; i < s->config->n_outlets; i++) {
		struct bb_outlet_state *state = &s->outlet[i].state;
		const int64_t at = s->config->outlet[i].outlet - all.first;
		state->commanded = commands.value[at] != 0;
		state->closed = contacts.value[at] != 0;
		state->known = true;
		state->at_ns = now(s);
	}
	return BB_OK;
}

/* Has what was written been seen? */
static void verify(struct modbus_strip *s, size_t i)
{
	struct modbus_strip_outlet *o = &s->outlet[i];

	if (!o->asked || !o->state.known)
		return;
	if (o->state.closed == o->want) {
		o->verifying = o->pending = o->mismatch = false;
		return;
	}
	if (o->pending || (o->verifying && now(s) < o->verify_end_ns))
		return;
	o->verifying = false;
	if (!o->mismatch || s->report.fault != POWER_MODBUS_VERIFY)
		notice(s, POWER_MODBUS_VERIFY, BB_HEALTH_DEGRADED, "outlet %lld was told %s and reads %s",
		       (long long)s->config->outlet[i].outlet, o->want ? "on" : "off", o->want ? "off" : "on");
	o->mismatch = true;
}

static void poll_all(struct modbus_strip *s)
{
	const struct span all = outlets(s->config);

	s->next_poll_ns = now(s) + s->map->poll_ms * MS;
	if (!s->config->n_outlets)
		return;
	const enum bb_status status = read_outlets(s, all);
	if (status == BB_ERR_IO && s->next_poll_ns < now(s) + BUSY_RETRY_NS)
		s->next_poll_ns = now(s) + BUSY_RETRY_NS;
	if (status != BB_OK)
		return;
	if (s->map->current >= 0)
		read_currents(s, all);
	for (size_t i = 0; i < s->config->n_outlets; i++) {
		verify(s, i);
		if (s->outlet[i].verifying)
			s->next_poll_ns = now(s) + (s->map->relay_ms < s->map->poll_ms ? s->map->relay_ms : s->map->poll_ms) * MS;
	}
}

/* ---- writing ---- */

void modbus_strip_ask(struct modbus_strip *s, size_t index, bool on, int64_t asked_ns)
{
	struct modbus_strip_outlet *o = &s->outlet[index];

	o->asked = o->pending = true;
	o->want = on;
	o->verifying = o->mismatch = false;
	o->due_ns = asked_ns;
	o->give_up_ns = asked_ns + s->pace.most_ns + COMMAND_LIFE_NS;
}

static bool moves_to_on(const struct modbus_strip_outlet *o)
{
	return o->want && !(o->state.known && o->state.closed);
}

/* When may this outlet's command go out? Two switched on at once would draw their inrush together, so even commands
 * that had to wait for the link keep their distance. */
static int64_t due_ns(const struct modbus_strip *s, const struct modbus_strip_outlet *o)
{
	return moves_to_on(o) && o->due_ns < s->stagger_until_ns ? s->stagger_until_ns : o->due_ns;
}

static void write_answered(struct modbus_strip *s, size_t i, const struct modbus_reply *reply)
{
	struct modbus_strip_outlet *o = &s->outlet[i];

	o->verify_end_ns = now(s) + s->map->relay_ms * MS + s->pace.most_ns;
	if (reply->verdict == MODBUS_ANSWER) {
		o->pending = false;
		o->verifying = true;
		s->next_poll_ns = now(s) + s->map->relay_ms * MS;
		return;
	}
	notice_exception(s, o->want ? "switching on" : "switching off", reply->exception);
	if (permanent(reply->exception)) {
		o->pending = false;
		o->mismatch = true;
		return;
	}
	o->due_ns = now(s) + BUSY_RETRY_NS; /* a read-back comes first: 05 may mean that it is being done */
	s->next_poll_ns = o->due_ns - 1;
}

static void write_outlet(struct modbus_strip *s, size_t i)
{
	struct modbus_strip_outlet *o = &s->outlet[i];
	const struct modbus_request request = modbus_map_write(s->map, s->config->outlet[i].outlet, o->want);
	struct modbus_reply reply;
	const bool moves = moves_to_on(o);

	const enum bb_status status = ask(s, &request, &reply);
	if (moves && status != BB_ERR_REFUSED)
		s->stagger_until_ns = now(s) + (int64_t)(s->config->safety.outlet_stagger_ms * 1e6);
	if (status == BB_OK) {
		write_answered(s, i, &reply);
		return;
	}
	/* Done or not? Reading back tells, and nothing is written a second time unasked. */
	o->pending = false;
	o->verifying = status != BB_ERR_REFUSED;
	o->verify_end_ns = now(s) + s->pace.most_ns;
}

/* ---- the machine ---- */

static int64_t next_ns(const struct modbus_strip *s)
{
	int64_t wake_ns = s->next_poll_ns;

	if (quarantined(s))
		return BB_NEVER;
	if (!bus_modbus_up(s->bus))
		return s->next_try_ns;
	for (size_t i = 0; i < s->config->n_outlets && s->identified; i++)
		if (s->outlet[i].pending && due_ns(s, &s->outlet[i]) < wake_ns)
			wake_ns = due_ns(s, &s->outlet[i]);
	return wake_ns;
}

/* The write that has waited longest, if it was due before the next reading: a strip that is busy is read first. */
static int due_write(const struct modbus_strip *s)
{
	int best = -1;

	for (size_t i = 0; i < s->config->n_outlets; i++) {
		const struct modbus_strip_outlet *o = &s->outlet[i];
		if (o->pending && due_ns(s, o) <= now(s) && due_ns(s, o) < s->next_poll_ns && (best < 0 || o->due_ns < s->outlet[best].due_ns))
			best = (int)i;
	}
	return best;
}

/* A command that could not be given in time is not given later: nobody expects it any more. */
static void drop_old(struct modbus_strip *s)
{
	for (size_t i = 0; i < s->config->n_outlets; i++) {
		struct modbus_strip_outlet *o = &s->outlet[i];
		if (!o->pending || now(s) <= o->give_up_ns)
			continue;
		o->pending = false;
		o->mismatch = true;
		notice(s, POWER_MODBUS_VERIFY, s->report.health == BB_HEALTH_LOST ? BB_HEALTH_LOST : BB_HEALTH_DEGRADED,
		       "outlet %lld: the command was dropped, too late", (long long)s->config->outlet[i].outlet);
	}
}

int64_t modbus_strip_step(struct modbus_strip *s)
{
	drop_old(s);
	if (quarantined(s) || next_ns(s) > now(s))
		return next_ns(s);
	if (!bus_modbus_up(s->bus)) {
		connect(s);
	} else if (!s->identified) {
		identify(s);
	} else {
		const int write = due_write(s);
		if (write >= 0)
			write_outlet(s, (size_t)write);
		else
			poll_all(s);
	}
	return next_ns(s);
}
