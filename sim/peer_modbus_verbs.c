/* sim/peer_modbus_verbs.c: what can be done to a peer on a Modbus wire, as fault verbs; see sim/peer_modbus.h. */
#include "sim/peer_modbus.h"

#include "sim/verb_args.h"

#include <string.h>

#define MS INT64_C(1000000)

static struct peer_modbus *peer_of(void *device)
{
	return device ? ((struct peer_modbus_handle *)device)->peer : NULL;
}

/* ---- class "modbus": the wire ---- */

static enum bb_status plain(void *device, const struct sim_fault_args *args, size_t offset, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		memcpy((char *)&peer_of(device)->faults + offset, &on, sizeof(on));
	return status;
}

#define PLAIN(name, member)                                                                                          \
	static enum bb_status name(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)   \
	{                                                                                                            \
		return plain(device, args, offsetof(struct peer_modbus_faults, member), on, err);                    \
	}
PLAIN(verb_silent, silent)
PLAIN(verb_half_open, half_open)
PLAIN(verb_foreign, foreign)
PLAIN(verb_deaf, deaf_to_writes)
PLAIN(verb_garbage, garbage)

static enum bb_status verb_exception(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long code = 0;
	enum bb_status status = sim_args_only(args, "code", err);

	if (status == BB_OK)
		status = sim_args_need(args, "code", err);
	if (status == BB_OK)
		status = sim_args_whole(args, "code", 0, 1, MODBUS_EX_MOST, &code, err);
	if (status == BB_OK && device)
		peer_of(device)->faults.exception = on ? (uint8_t)code : 0;
	return status;
}

static enum bb_status verb_late(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long ms = 0, count = 0;
	enum bb_status status = sim_args_only(args, "ms count", err);

	if (status == BB_OK)
		status = sim_args_need(args, "ms", err);
	if (status == BB_OK)
		status = sim_args_whole(args, "ms", 0, 1, 60000, &ms, err);
	if (status == BB_OK)
		status = sim_args_whole(args, "count", 0, 0, 1000000, &count, err);
	if (status == BB_OK && device) {
		peer_of(device)->faults.late_ns = on ? ms * MS : 0;
		peer_of(device)->faults.late_left = count;
	}
	return status;
}

static enum bb_status verb_dribble(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long ms = 0;
	enum bb_status status = sim_args_only(args, "ms", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "ms", 50, 1, 10000, &ms, err);
	if (status == BB_OK && device)
		peer_of(device)->faults.dribble_ns = on ? ms * MS : 0;
	return status;
}

static enum bb_status verb_length(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long by = 0;
	enum bb_status status = sim_args_only(args, "by", err);

	if (status == BB_OK)
		status = sim_args_need(args, "by", err);
	if (status == BB_OK)
		status = sim_args_whole(args, "by", 0, -300, 65000, &by, err);
	if (status == BB_OK && device)
		peer_of(device)->faults.length_lie = on ? by : 0;
	return status;
}

const struct sim_verb peer_modbus_verbs[] = {
	{ "silent", "", "hears and does not answer", "", verb_silent },
	{ "late", "ms=N [count=N]", "answers come so much later; only so many of them", "ms=300 count=1", verb_late },
	{ "exception", "code=N", "every request is answered with this exception, 1 to 11", "code=2", verb_exception },
	{ "half_open", "", "connections stay open and dead, even afterwards: the cable was pulled", "", verb_half_open },
	{ "length", "by=N", "the MBAP header's length is wrong by so many bytes", "by=3", verb_length },
	{ "garbage", "", "five bytes of rubbish after every answer", "", verb_garbage },
	{ "dribble", "[ms=N]", "answers come byte by byte, so far apart (default 50)", "ms=20", verb_dribble },
	{ "foreign", "", "the identity registers are another device's", "", verb_foreign },
	{ "deaf", "", "writes are acknowledged and not done", "", verb_deaf },
	{ NULL, NULL, NULL, NULL, NULL },
};

/* ---- class "power": the strip, with the words of sim/sim_power.c ---- */

static enum bb_status outlet_number(void *device, const struct sim_fault_args *args, long *number, struct bb_error *err)
{
	enum bb_status status = sim_args_need(args, "outlet", err);

	*number = 0;
	if (status == BB_OK)
		status = sim_args_whole(args, "outlet", 0, 1, BB_OUTLETS_MAX, number, err);
	if (status == BB_OK && device && (size_t)*number > peer_of(device)->n_outlets)
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "power/%s has no outlet %ld", peer_of(device)->id, *number);
	return status;
}

static enum bb_status verb_stick(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const char *state = sim_fault_arg(args, "state");
	long number = 0;
	enum bb_status status = sim_args_only(args, "outlet state", err);

	if (status == BB_OK)
		status = outlet_number(device, args, &number, err);
	if (status != BB_OK)
		return status;
	if (state && strcmp(state, "on") != 0 && strcmp(state, "off") != 0)
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "state=%s: want on or off", state);
	const bool closed = state && !strcmp(state, "on");
	if (device)
		peer_of(device)->outlet[number - 1].stick = !on     ? PEER_MODBUS_FREE
		                                            : closed ? PEER_MODBUS_STUCK_CLOSED
		                                                     : PEER_MODBUS_STUCK_OPEN;
	return BB_OK;
}

static enum bb_status verb_drop(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		peer_of(device)->faults.half_open = peer_of(device)->faults.silent = on; /* it lost its own mains as well */
	return status;
}

static enum bb_status verb_current(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	double a = 0;
	long number = 0;
	enum bb_status status = sim_args_only(args, "outlet a", err);

	if (status == BB_OK)
		status = outlet_number(device, args, &number, err);
	if (status == BB_OK)
		status = sim_args_need(args, "a", err);
	if (status == BB_OK)
		status = sim_args_real(args, "a", 0, 0, 65, &a, err);
	if (status == BB_OK && device)
		peer_of(device)->outlet[number - 1].current_a = on ? a : -1;
	return status;
}

const struct sim_verb peer_modbus_power_verbs[] = {
	{ "stick", "outlet=N [state=off|on]", "the relay goes to that state at once (default off) and obeys nothing",
	  "outlet=1", verb_stick },
	{ "timeout", "", "the strip does not answer", "", verb_silent },
	{ "drop", "", "no mains at the strip: no answer, and connections made before are dead", "", verb_drop },
	{ "current", "outlet=N a=X", "the outlet's load draws X amperes", "outlet=1 a=0.05", verb_current },
	{ NULL, NULL, NULL, NULL, NULL },
};
