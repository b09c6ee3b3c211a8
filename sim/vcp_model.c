/* sim/vcp_model.c: one row per code; see sim/vcp_model.h. */
#include "sim/vcp_model.h"

#include "sim/verb_args.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define UNKNOWN 0xFFFF
#define NOT_KEPT SIZE_MAX
#define KEPT(member) offsetof(struct vcp_state, member)

enum { CAN_READ = 1, CAN_WRITE = 2, RESTORED = 4 };

struct vcp {
	uint8_t code;
	uint8_t flags;
	size_t member;     /* a uint16_t of struct vcp_state, or NOT_KEPT */
	uint16_t most;     /* reported; and the limit of values without a list */
	uint16_t fallback;
	uint8_t legal[10]; /* to write; ends with 0; empty: 0..most */
};

static const struct vcp vcps[] = {
	{ BB_VCP_NEW_CONTROL, CAN_READ | CAN_WRITE, KEPT(new_control), UNKNOWN, 1, { 1 } },
	{ BB_VCP_RESTORE_DEFAULTS, CAN_WRITE, NOT_KEPT, UNKNOWN, 0, { 0 } },
	{ BB_VCP_LUMINANCE, CAN_READ | CAN_WRITE | RESTORED, KEPT(luminance), 100, 75, { 0 } },
	{ BB_VCP_CONTRAST, CAN_READ | CAN_WRITE | RESTORED, KEPT(contrast), 100, 75, { 0 } },
	{ BB_VCP_COLOR_PRESET, CAN_READ | CAN_WRITE | RESTORED, KEPT(preset), 0x0B, 5,
	  { 0x01, 0x02, 0x05, 0x06, 0x08, 0x0B } },
	{ BB_VCP_RED_GAIN, CAN_READ | CAN_WRITE | RESTORED, KEPT(red), 100, 100, { 0 } },
	{ BB_VCP_GREEN_GAIN, CAN_READ | CAN_WRITE | RESTORED, KEPT(green), 100, 100, { 0 } },
	{ BB_VCP_BLUE_GAIN, CAN_READ | CAN_WRITE | RESTORED, KEPT(blue), 100, 100, { 0 } },
	{ BB_VCP_INPUT, CAN_READ | CAN_WRITE, KEPT(input), 0x12, VCP_INPUT_DP1,
	  { 0x01, 0x03, 0x0F, 0x10, 0x11, 0x12 } },
	{ BB_VCP_H_FREQUENCY, CAN_READ, NOT_KEPT, 0, 0, { 0 } },
	{ BB_VCP_V_FREQUENCY, CAN_READ, NOT_KEPT, UNKNOWN, 0, { 0 } },
	{ BB_VCP_HOURS, CAN_READ, NOT_KEPT, 0, 0, { 0 } },
	{ BB_VCP_ENABLE_KEY, CAN_READ, NOT_KEPT, UNKNOWN, 0x006F, { 0 } },
	{ BB_VCP_CONTROLLER, CAN_READ, NOT_KEPT, UNKNOWN, 0x0009, { 0 } }, /* Realtek */
	{ BB_VCP_POWER_MODE, CAN_READ | CAN_WRITE, KEPT(power_mode), 5, 1, { 1, 2, 3, 4, 5 } },
	{ BB_VCP_VERSION, CAN_READ, NOT_KEPT, UNKNOWN, 0x0202, { 0 } },
};

static const struct vcp *find(uint8_t code)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(vcps); i++)
		if (vcps[i].code == code)
			return &vcps[i];
	return NULL;
}

static uint16_t *kept(struct vcp_state *v, const struct vcp *row)
{
	return (uint16_t *)(void *)((char *)v + row->member);
}

static void to_defaults(struct vcp_state *v, unsigned int flag)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(vcps); i++)
		if (vcps[i].member != NOT_KEPT && (vcps[i].flags & flag))
			*kept(v, &vcps[i]) = vcps[i].fallback;
}

void vcp_init(struct vcp_state *v, uint16_t cabled_input, double line_hz, double rate_hz, uint32_t base_hours)
{
	*v = (struct vcp_state){ .cabled_input = cabled_input, .line_hz = line_hz, .rate_hz = rate_hz,
		                 .base_hours = base_hours };
	to_defaults(v, CAN_READ);
	v->input = cabled_input;
}

static void frequency(const struct vcp_state *v, uint8_t code, uint16_t *current, uint16_t *most)
{
	const long line_hz = lround(v->line_hz), rate_chz = lround(v->rate_hz * 100);

	*current = *most = UNKNOWN;
	if (v->input != v->cabled_input)
		return;
	if (code == BB_VCP_H_FREQUENCY && line_hz < 0xFFFFFF) {
		*current = (uint16_t)(line_hz & 0xFFFF);
		*most = (uint16_t)(line_hz >> 16);
	}
	if (code == BB_VCP_V_FREQUENCY && rate_chz < UNKNOWN)
		*current = (uint16_t)rate_chz;
}

enum bb_status vcp_get(const struct vcp_state *v, uint8_t code, uint16_t *current, uint16_t *most)
{
	const struct vcp *row = find(code);

	*current = *most = 0;
	if (!row || !(row->flags & CAN_READ))
		return BB_ERR_UNSUPPORTED;
	*most = row->most;
	if (row->member != NOT_KEPT) {
		*current = *(const uint16_t *)(const void *)((const char *)v + row->member);
	} else if (code == BB_VCP_H_FREQUENCY || code == BB_VCP_V_FREQUENCY) {
		frequency(v, code, current, most);
	} else if (code == BB_VCP_HOURS) {
		*current = (uint16_t)((int64_t)v->base_hours + v->lit_ns / (3600 * BB_NS_PER_S));
	} else {
		*current = row->fallback;
	}
	return BB_OK;
}

static bool legal(const struct vcp *row, const struct vcp_state *v, uint16_t value)
{
	if (row->code == BB_VCP_RESTORE_DEFAULTS)
		return value != 0;
	if (row->code == BB_VCP_INPUT && value == v->cabled_input)
		return true; /* makers have inputs of their own, USB-C for one */
	if (!row->legal[0])
		return value <= row->most;
	for (size_t i = 0; i < sizeof(row->legal) && row->legal[i]; i++)
		if (row->legal[i] == value)
			return true;
	return false;
}

enum bb_status vcp_set(struct vcp_state *v, uint8_t code, uint16_t value)
{
	const struct vcp *row = find(code);

	if (!row || !(row->flags & CAN_WRITE))
		return BB_ERR_UNSUPPORTED;
	if (!legal(row, v, value))
		return BB_ERR_RANGE;
	if (code == BB_VCP_RESTORE_DEFAULTS)
		to_defaults(v, RESTORED);
	else
		*kept(v, row) = value;
	return BB_OK;
}

void vcp_by_hand(struct vcp_state *v, uint8_t code, uint16_t value)
{
	if (code == BB_VCP_INPUT)
		v->input = value;
	if (code == BB_VCP_LUMINANCE)
		v->luminance = value;
	v->new_control = 2;
}

static bool add(char *out, size_t cap, size_t *n, const char *text)
{
	const size_t more = strlen(text);

	if (*n + more >= cap)
		return false;
	memcpy(out + *n, text, more + 1);
	*n += more;
	return true;
}

static bool add_code(char *out, size_t cap, size_t *n, const struct vcp *row)
{
	char hex[8];
	bool good;

	snprintf(hex, sizeof(hex), " %02X", row->code);
	good = add(out, cap, n, hex);
	for (size_t i = 0; good && i < sizeof(row->legal) && row->legal[i]; i++) {
		snprintf(hex, sizeof(hex), "%c%02X", i ? ' ' : '(', row->legal[i]);
		good = add(out, cap, n, hex);
	}
	return good && (!row->legal[0] || add(out, cap, n, ")"));
}

size_t vcp_text(const char *model, char *out, size_t cap)
{
	size_t n = 0;
	bool good = add(out, cap, &n, "(prot(monitor)type(lcd)model(") && add(out, cap, &n, model) &&
	            add(out, cap, &n, ")cmds(01 02 03 0C E3 F3)vcp(");

	for (size_t i = 0; good && i < BB_ARRAY_LEN(vcps); i++)
		good = add_code(out, cap, &n, &vcps[i]);
	good = good && add(out, cap, &n, ")mccs_ver(2.2))");
	return good ? n : 0;
}

double vcp_light(const struct vcp_state *v)
{
	/* Shares of the primaries in the luminance of white (Rec. 709). A backlight at 0 is not dark. */
	const double gain = (0.2126 * v->red + 0.7152 * v->green + 0.0722 * v->blue) / 100;

	return (0.15 + 0.85 * v->luminance / 100.0) * gain;
}

enum bb_status vcp_fault_input(struct vcp_state *v, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long value;
	enum bb_status status = sim_args_only(args, "value", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "value", 0, 1, 255, &value, err);
	if (status != BB_OK || !v)
		return status;
	if (!value) /* the next input, whatever it is */
		value = v->input == VCP_INPUT_HDMI1 ? VCP_INPUT_DP1 : VCP_INPUT_HDMI1;
	if (on)
		v->before_input = v->input;
	vcp_by_hand(v, BB_VCP_INPUT, on ? (uint16_t)value : v->before_input);
	return BB_OK;
}

enum bb_status vcp_fault_drift(struct vcp_state *v, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	long value;
	enum bb_status status = sim_args_only(args, "luminance", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "luminance", 20, 0, 100, &value, err);
	if (status != BB_OK || !v)
		return status;
	if (on)
		v->before_luminance = v->luminance;
	vcp_by_hand(v, BB_VCP_LUMINANCE, on ? (uint16_t)value : v->before_luminance);
	return BB_OK;
}
