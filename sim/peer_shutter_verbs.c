/* sim/peer_shutter_verbs.c: what can be done to a chain on a CAN, as fault verbs; see sim/peer_shutter.h. */
#include "sim/peer_shutter.h"
#include "sim/verb_args.h"

#include <math.h>
#include <string.h>

/* Position of stage=ID: the emitter is 0. Without the argument, `fallback`, or -1 for all. */
static long position_of(const struct sim_chain *c, const struct sim_fault_args *args, long fallback)
{
	const char *stage = sim_fault_arg(args, "stage");

	if (!stage)
		return fallback;
	for (size_t i = 0; i < sim_chain_positions(c); i++)
		if (!strcmp(sim_chain_stage(c, i), stage))
			return (long)i;
	return 0; /* names were checked against the room */
}

static bool chosen(long position, size_t i)
{
	return position < 0 || (size_t)position == i;
}

/* One that is said of a stage, or of all of them. */
static enum bb_status each(struct sim_chain *c, const struct sim_fault_args *args, bool on, struct bb_error *err,
                           void (*fault)(struct sim_chain *c, size_t position, bool on))
{
	const enum bb_status status = sim_args_only(args, "stage", err);

	if (status != BB_OK || !c)
		return status;
	const long position = position_of(c, args, -1);
	for (size_t i = 0; i < sim_chain_positions(c); i++)
		if (chosen(position, i))
			fault(c, i, on);
	return BB_OK;
}

static struct sim_can *medium(struct sim_chain *c)
{
	return sim_chain_node(c, 0)->port.can;
}

static void mute(struct sim_chain *c, size_t position, bool on)
{
	sim_can_mute(&sim_chain_node(c, position)->port, on);
}

static void cut(struct sim_chain *c, size_t position, bool on)
{
	sim_chain_power(c, position, !on);
}

#define EACH(name, fault)                                                                                            \
	static enum bb_status name(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)   \
	{                                                                                                            \
		return each(device, args, on, err, fault);                                                           \
	}
EACH(verb_stuck, sim_chain_stuck)
EACH(verb_unplug, mute)
EACH(verb_power, cut)
EACH(verb_freeze, sim_chain_freeze)

/* ---- class "can" ---- */

static enum bb_status verb_late_sync(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	double us = 0;
	enum bb_status status = sim_args_only(args, "us", err);

	if (status == BB_OK)
		status = sim_args_need(args, "us", err);
	if (status == BB_OK)
		status = sim_args_real(args, "us", 0, 1, 8000, &us, err);
	if (status == BB_OK && device)
		sim_chain_late_sync(device, on ? llround(us * 1000) : 0);
	return status;
}

static enum bb_status verb_drop_sync(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long n = 0;
	enum bb_status status = sim_args_only(args, "n", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "n", 1, 1, 1000000, &n, err);
	if (status == BB_OK && device)
		sim_chain_drop_sync(device, on ? (int)n : 0);
	return status;
}

static enum bb_status verb_babble(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct bb_can_frame f = { .n_bytes = 8, .bytes = { 1, 2, 3 } };
	long id = 0, us = 0;
	enum bb_status status = sim_args_only(args, "id us", err);

	if (status == BB_OK)
		status = sim_args_need(args, "id", err);
	if (status == BB_OK)
		status = sim_args_whole(args, "id", 0, 0, 0x7ff, &id, err);
	if (status == BB_OK)
		status = sim_args_whole(args, "us", 300, 100, 1000000, &us, err);
	f.id = (uint32_t)id;
	if (status == BB_OK && device)
		sim_can_babble(medium(device), &f, on ? us * 1000 : 0);
	return status;
}

static enum bb_status verb_noise(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long ppm = 0;
	enum bb_status status = sim_args_only(args, "ppm", err);

	if (status == BB_OK)
		status = sim_args_need(args, "ppm", err);
	if (status == BB_OK)
		status = sim_args_whole(args, "ppm", 0, 1, 500000, &ppm, err);
	if (status == BB_OK && device)
		sim_can_error_ppm(medium(device), on ? (uint32_t)ppm : 0);
	return status;
}

static enum bb_status verb_emergency(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long code = 0;
	enum bb_status status = sim_args_only(args, "stage code", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "code", CO_EMCY_TEMPERATURE, 1, 0xffff, &code, err);
	if (status != BB_OK || !device)
		return status;
	struct sim_co_node *n = sim_chain_node(device, (size_t)position_of(device, args, 0));
	sim_co_emcy(n, on ? (uint16_t)code : CO_EMCY_NONE, on ? 0x09 : 0);
	return BB_OK;
}

/* One frame from nowhere; NULL: none. */
static enum bb_status inject(struct sim_chain *c, const struct sim_fault_args *args, const struct bb_can_frame *f,
                             struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && c && f)
		sim_can_inject(medium(c), f);
	return status;
}

static enum bb_status verb_twin(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	static const struct bb_can_frame beat = { .id = CO_HEARTBEAT + CO_NODE_MOST, .n_bytes = 1,
		                                  .bytes = { CO_OPERATIONAL } };

	return inject(device, args, on ? &beat : NULL, err);
}

static enum bb_status verb_bad_sync(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	static const struct bb_can_frame sync = { .id = CO_SYNC, .n_bytes = 3, .bytes = { 1, 1, 1 } };

	return inject(device, args, on ? &sync : NULL, err);
}

static enum bb_status verb_bus_off(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	static const struct bb_can_frame off = { .id = CAN_CLASS_BUS_OFF | CAN_CLASS_COUNTERS, .error = true,
		                                 .n_bytes = 8, .bytes = { [6] = 255 } };
	static const struct bb_can_frame back = { .id = CAN_CLASS_RESTARTED | CAN_CLASS_COUNTERS, .error = true,
		                                  .n_bytes = 8 };

	return inject(device, args, on ? &off : &back, err);
}

const struct sim_verb sim_chain_can_verbs[] = {
	{ "babble", "id=ID [us=N]", "a node says 8 bytes with that id every so often (300), whatever anybody else does",
	  "id=0x123 us=400", verb_babble },
	{ "unplug", "[stage=ID]", "the controller is off the bus; without stage: all are", "stage=emitter", verb_unplug },
	{ "power", "[stage=ID]", "the controller has no power, and boots after it", "stage=emitter", verb_power },
	{ "drop_sync", "[n=N]", "n SYNCs are not sent", "n=3", verb_drop_sync },
	{ "late_sync", "us=N", "SYNC goes out that much late", "us=3000", verb_late_sync },
	{ "freeze", "[stage=ID]", "the controller's phases keep their old counter", "stage=emitter", verb_freeze },
	{ "noise", "ppm=N", "so many of a million frames are destroyed and sent again", "ppm=20000", verb_noise },
	{ "emergency", "[stage=ID] [code=ID]", "the controller reports it (0x4200: hot), and its end", "stage=emitter",
	  verb_emergency },
	{ "twin", "", "somebody else beats as the host's node, 127", "", verb_twin },
	{ "bad_sync", "", "a SYNC of three bytes", "", verb_bad_sync },
	{ "bus_off", "", "error frames say that the host's controller left the bus, then that it is back", "",
	  verb_bus_off },
	{ NULL, NULL, NULL, NULL, NULL },
};

/* ---- class "shutter": with the words of sim/sim_shutter.c ---- */

static enum bb_status verb_miss(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long n = 0;
	enum bb_status status = sim_args_only(args, "stage n", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "n", 1, 1, 1000000, &n, err);
	if (status != BB_OK || !device)
		return status;
	const long position = position_of(device, args, -1);
	for (size_t i = 0; i < sim_chain_positions(device); i++)
		if (chosen(position, i))
			sim_chain_miss(device, i, on ? n : -n);
	return BB_OK;
}

static enum bb_status verb_flip(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "stage", err);

	if (status == BB_OK && device)
		sim_chain_flip(device, (size_t)position_of(device, args, 0), on);
	return status;
}

static enum bb_status verb_offset(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	double us = 0;
	enum bb_status status = sim_args_only(args, "stage us", err);

	if (status == BB_OK)
		status = sim_args_need(args, "stage", err);
	if (status == BB_OK)
		status = sim_args_need(args, "us", err);
	if (status == BB_OK)
		status = sim_args_real(args, "us", 0, -100000, 100000, &us, err);
	if (status == BB_OK && device)
		sim_chain_offset(device, (size_t)position_of(device, args, 0), llround(on ? us * 1000 : us * -1000));
	return status;
}

const struct sim_verb sim_chain_shutter_verbs[] = {
	{ "miss", "[stage=ID] [n=N]", "n sync edges do not arrive (at one stage, or at all)", "n=3", verb_miss },
	{ "flip_polarity", "[stage=ID]", "the eyes are swapped at one stage; without stage: in the glasses", "",
	  verb_flip },
	{ "stuck", "[stage=ID]", "the sync line stops toggling; after 100 ms the shutters open", "", verb_stuck },
	{ "stage_offset", "stage=ID us=N", "a stage switches that much late", "stage=emitter us=900", verb_offset },
	{ "unplug", "", "the chain is gone; the shutters open", "", verb_unplug },
	{ NULL, NULL, NULL, NULL, NULL },
};
