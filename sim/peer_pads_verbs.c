/* sim/peer_pads_verbs.c: what can happen to a peer, as faults; the first five are the simulated gamepad's as well. */
#include "sim/peer_pads_impl.h"
#include "sim/verb_args.h"

static enum bb_status flag(void *device, const struct sim_fault_args *args, bool on, size_t offset,
			   struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		*(bool *)((char *)device + offset) = on;
	return status;
}

static enum bb_status verb_silence(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return flag(device, args, on, offsetof(struct sim_peer_pad, fault_silence), err);
}

static enum bb_status verb_short(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return flag(device, args, on, offsetof(struct sim_peer_pad, fault_short), err);
}

static enum bb_status verb_wrong_id(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return flag(device, args, on, offsetof(struct sim_peer_pad, fault_id), err);
}

static enum bb_status verb_descriptor(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return flag(device, args, on, offsetof(struct sim_peer_pad, fault_descriptor), err);
}

static enum bb_status verb_unplug(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		sim_peer_pad_unplug(device, on);
	return status;
}

static enum bb_status verb_off(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	static const uint8_t nobody[] = { 0x08, 0x00 };
	struct sim_peer_pad *p = device;
	const enum bb_status status = sim_args_only(args, "", err);

	if (status != BB_OK || !p || p->fault_off == on)
		return status;
	p->fault_off = on;
	p->told = (struct peer_values){ 0 };
	if (!on)
		p->model->joined(p);
	else if (p->kind == SIM_PEER_XBOX_PAD)
		sim_peer_pad_send(p, nobody, sizeof(nobody));
	return BB_OK;
}

static enum bb_status verb_battery(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_peer_pad *p = device;
	double level = 0;
	enum bb_status status = sim_args_only(args, "level", err);

	if (status == BB_OK)
		status = sim_args_real(args, "level", 0.05, 0, 1, &level, err);
	if (status != BB_OK || !p)
		return status;
	p->fault_battery = on;
	p->fault_level = level;
	p->battery_due_ns = bb_clock_now_ns(p->clk);
	return BB_OK;
}

static enum bb_status verb_garbage(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	double share = 0;
	enum bb_status status = sim_args_only(args, "share", err);

	if (status == BB_OK)
		status = sim_args_real(args, "share", 0.05, 0, 1, &share, err);
	if (status == BB_OK && device)
		((struct sim_peer_pad *)device)->garbage_share = on ? share : 0;
	return status;
}

/* "axis=N key=V": V goes into one of the arrays over axes. */
static enum bb_status of_axis(const struct sim_fault_args *args, const char *known, const char *key, double fallback,
			      double least, size_t *axis, double *value, struct bb_error *err)
{
	long n = 1;
	enum bb_status status = sim_args_only(args, known, err);

	if (status == BB_OK)
		status = sim_args_whole(args, "axis", 1, 1, BB_PAD_AXES, &n, err);
	if (status == BB_OK)
		status = sim_args_real(args, key, fallback, least, 1, value, err);
	*axis = (size_t)n - 1;
	return status;
}

static enum bb_status verb_stick_axis(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_peer_pad *p = device;
	double value = 0;
	size_t axis;
	const enum bb_status status = of_axis(args, "axis value", "value", 1, -1, &axis, &value, err);

	if (status != BB_OK || !p)
		return status;
	p->fault_stick[axis] = on;
	p->stick_value[axis] = value;
	return BB_OK;
}

static enum bb_status verb_drift(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	double offset = 0;
	size_t axis;
	const enum bb_status status = of_axis(args, "axis offset", "offset", 0.1, -1, &axis, &offset, err);

	if (status == BB_OK && device)
		((struct sim_peer_pad *)device)->drift[axis] = on ? offset : 0;
	return status;
}

static enum bb_status verb_noise(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	double size = 0;
	size_t axis;
	const enum bb_status status = of_axis(args, "axis size", "size", 0.2, 0, &axis, &size, err);

	if (status == BB_OK && device)
		((struct sim_peer_pad *)device)->shake[axis] = on ? size : 0;
	return status;
}

const struct sim_verb sim_peer_pad_verbs[] = {
	{ "silence", "", "no reports although its receiver is alive", "", verb_silence },
	{ "unplug", "", "the receiver or the cable is pulled out", "", verb_unplug },
	{ "battery", "[level=N]", "its battery is at that level, 0.05 unless told; at 0 it falls silent", "level=0.05",
	  verb_battery },
	{ "stick_axis", "[axis=N] [value=N]", "an axis (1..6, default 1) is stuck at a value (default 1)",
	  "axis=2 value=0.6", verb_stick_axis },
	{ "drift", "[axis=N] [offset=N]", "an axis (default 1) is off by that much (default 0.1)", "axis=1 offset=0.1",
	  verb_drift },
	{ "noise", "[axis=N] [size=N]", "an axis (default 1) shakes by that much (default 0.2)", "axis=1 size=0.3",
	  verb_noise },
	{ "off", "", "the pad is switched off, its receiver stays", "", verb_off },
	{ "garbage", "[share=N]", "that share of the reports (default 0.05) is noise", "share=0.2", verb_garbage },
	{ "short", "", "reports are cut short", "", verb_short },
	{ "wrong_id", "", "reports begin with an id there is not", "", verb_wrong_id },
	{ "bad_descriptor", "", "its HID descriptor is hostile, from the next opening", "", verb_descriptor },
	{ NULL, NULL, NULL, NULL, NULL },
};
