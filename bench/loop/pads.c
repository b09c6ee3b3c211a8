/*
 * bench/loop/pads.c: gamepad reports into navigation, once a frame. The motion of a pad that goes ends with the frame (row
 * H1), that of one that falls silent with its stick deflected runs out within 200 ms (row H2); an axis that stands still
 * and a battery that is low are warnings, and samples for whoever sets a budget on them (row H5).
 */
#include "bench/loop/loop.h"

#include <math.h>
#include <string.h>

#define DEAD_ZONE 0.15F
#define SILENCE_NS INT64_C(250000000) /* row H2, */
#define RAMP_NS INT64_C(200000000)    /* and how long the motion takes to come down */
#define STUCK_NS (10 * BB_NS_PER_S)   /* row H5 */
#define BATTERY_LOW 0.15F
#define YAW_DEG_PER_S 12.0
#define WALK_M_PER_S 0.15
#define STEEP 0.2                      /* cosine: steeper than that a line of sight has little of a heading */
#define DEG (180 / 3.14159265358979323846)
#define NAVIGATION_MOST_M 0.3          /* how far from where the scene put the viewer */

static float most_deflection(const struct bb_pad_report *r)
{
	float most = 0;

	for (int i = 0; i < BB_PAD_AXES; i++)
		most = fmaxf(most, fabsf(r->axis[i]));
	return most;
}

/* ---- warnings ---- */

static void moves(struct bb_frame_loop *l, struct bb_pad *p, size_t axis, int64_t now_ns)
{
	if (p->stuck >> axis & 1)
		bb_watch_over(l->watch, p->stuck_warning[axis], now_ns);
	p->stuck &= ~(1u << axis);
	p->held[axis] = p->report.axis[axis];
	p->held_ns[axis] = now_ns;
}

static int64_t watch_axes(struct bb_frame_loop *l, size_t i, int64_t now_ns)
{
	struct bb_pad *p = &l->pads[i];
	const struct bb_device *dev = bb_gamepad_device(l->rig->gamepads[i]);
	const float still = fmaxf(1.0F / 64, 2 * (float)bb_gamepad_limits(l->rig->gamepads[i])->axis_step);
	int64_t longest_ns = 0;

	for (size_t a = 0; a < BB_PAD_AXES; a++) {
		const float v = p->report.axis[a];
		if (fabsf(v - p->held[a]) > still || fabsf(v) <= still)
			moves(l, p, a, now_ns);
		const int64_t ns = now_ns - p->held_ns[a];
		longest_ns = ns > longest_ns ? ns : longest_ns;
		if (ns < STUCK_NS || p->stuck >> a & 1)
			continue;
		p->stuck |= 1u << a;
		p->stuck_warning[a] = bb_watch_warn(l->watch, l->gamepad_slot[i], now_ns,
		                                    "PAD_DRIFT axis %zu stands still at %.2f for %.0f s", a + 1,
		                                    (double)v, (double)ns * 1e-9);
	}
	/* What a driver has taken off already, or shakes, is not seen in its reports. */
	if (!p->drift_told && !p->stuck && !strncmp(dev->last_error.detail, "PAD_DRIFT", 9)) {
		p->drift_told = true;
		(void)bb_watch_warn(l->watch, l->gamepad_slot[i], now_ns, "%s", dev->last_error.detail);
	}
	return longest_ns;
}

static void watch_battery(struct bb_frame_loop *l, size_t i, int64_t now_ns)
{
	struct bb_pad *p = &l->pads[i];

	if (!p->seen || p->battery_told || !(p->report.battery < BATTERY_LOW))
		return;
	p->battery_told = true;
	(void)bb_watch_warn(l->watch, l->gamepad_slot[i], now_ns, "PAD_BATTERY low: %.0f %%",
	                    (double)p->report.battery * 100);
}

static void sample(struct bb_frame_loop *l, enum bb_metric metric, double value, int64_t now_ns)
{
	const struct bb_sample s = { .value = value, .frame = l->n_frames ? l->n_frames - 1 : 0, .at_ns = now_ns,
		                     .node = BB_NOBODY, .stage = BB_STAGE_COUNT };

	bb_ledger_sample(l->ledger, metric, &s);
}

/* ---- motion ---- */

/* Which part of its deflection the pad still drives with: 0: neutral, or silent or gone for long enough. */
static double drives(struct bb_frame_loop *l, size_t i, int64_t now_ns)
{
	struct bb_gamepad *g = l->rig->gamepads[i];
	struct bb_pad *p = &l->pads[i];
	struct bb_pad_report reports[16];
	enum bb_status status;
	size_t n;

	while ((status = bb_gamepad_read(g, reports, BB_ARRAY_LEN(reports), &n)) == BB_OK) {
		p->report = reports[n - 1];
		p->seen = true;
		p->gone = false;
	}
	p->gone |= status < 0; /* and what it said is of before, until it says something again */
	const int64_t silent_ns = now_ns - p->report.at_ns;
	const bool deflected = p->seen && most_deflection(&p->report) > DEAD_ZONE;
	const bool silent = deflected && !p->gone && !l->was_away && silent_ns > SILENCE_NS &&
	                    silent_ns > bb_gamepad_limits(g)->most_report_gap_ns;
	if (status < 0)
		bb_watch_bad(l->watch, l->gamepad_slot[i], now_ns, BB_HEALTH_LOST, "gone: %s",
		             bb_gamepad_device(g)->last_error.detail);
	else if (silent)
		bb_watch_bad(l->watch, l->gamepad_slot[i], now_ns, BB_HEALTH_LOST,
		             "silent for %.0f ms with its stick deflected (battery, radio?)", (double)silent_ns * 1e-6);
	else
		bb_watch_good(l->watch, l->gamepad_slot[i], now_ns);
	if (!p->gone && !silent) {
		p->let_go_ns = 0;
		return deflected;
	}
	for (size_t a = 0; a < BB_PAD_AXES; a++)
		moves(l, p, a, now_ns); /* nobody knows */
	p->let_go_ns = p->let_go_ns ? p->let_go_ns : now_ns;
	if (p->gone) /* row H1: neutral within the frame */
		return 0;
	return deflected ? fmax(0, 1 - (double)(now_ns - p->let_go_ns) / (double)RAMP_NS) : 0;
}

static double clamp(double v, double most)
{
	return fmax(-most, fmin(most, v));
}

/*
 * The head's heading and pitch without its roll. Who looks straight down or up has no heading by the line of sight, but by
 * the crown of the head, which then points ahead or back.
 */
static struct bb_quat line_of_sight(struct bb_quat head)
{
	const struct bb_vec3 ahead = bb_quat_rotate(head, (struct bb_vec3){ 0, 0, -1 });
	const struct bb_vec3 up = bb_quat_rotate(head, (struct bb_vec3){ 0, ahead.y > 0 ? -1 : 1, 0 });
	const double crown = fmax(0, 1 - hypot(ahead.x, ahead.z) / STEEP); /* from the one to the other without a jump */
	const struct bb_vec3 heading = bb_vec3_add(ahead, bb_vec3_scale(up, crown));

	return bb_quat_euler_deg(atan2(-heading.x, -heading.z) * DEG, asin(clamp(ahead.y, 1)) * DEG, 0);
}

static void move(struct bb_pose *nav, const struct bb_pad_report *r, bool space, double dt_s, struct bb_quat along)
{
	const double yaw = (double)(space ? r->axis[4] : r->axis[2]);
	const struct bb_vec3 step = { (double)r->axis[0], space ? (double)r->axis[1] : 0,
		                      (double)(space ? r->axis[2] : r->axis[1]) }; /* ahead is negative: a stick pushed away, and -z */

	nav->p = bb_vec3_add(nav->p, bb_quat_rotate(bb_quat_mul(nav->q, along), bb_vec3_scale(step, WALK_M_PER_S * dt_s)));
	nav->p = (struct bb_vec3){ clamp(nav->p.x, NAVIGATION_MOST_M), clamp(nav->p.y, NAVIGATION_MOST_M),
		                   clamp(nav->p.z, NAVIGATION_MOST_M) };
	nav->q = bb_quat_unit(bb_quat_mul(bb_quat_euler_deg(-yaw * YAW_DEG_PER_S * dt_s, 0, 0), nav->q));
}

void bb_pads_read(struct bb_frame_loop *l, int64_t now_ns)
{
	const double dt_s = l->pad_read_ns ? fmin(0.05, (double)(now_ns - l->pad_read_ns) * 1e-9) : 0;
	double emptiest = (double)INFINITY;
	int64_t stuck_ns = 0;
	bool any = false;
	/* As the pictures show the head: held, and neutral, with them. */
	const bool by_head = l->scene->steer_by == BB_STEER_HEAD;
	const struct bb_quat along = by_head ? line_of_sight(l->steady.last.q) : BB_QUAT_IDENTITY;

	l->pad_read_ns = now_ns;
	for (size_t i = 0; i < l->room->n_gamepads; i++) {
		if (!l->rig->gamepads[i])
			continue;
		const bool space = l->room->gamepads[i].model == BB_PAD_SPACEMOUSE;
		const double part = drives(l, i, now_ns);
		if (part > 0)
			move(&l->navigation, &l->pads[i].report, space, part * dt_s, along);
		const int64_t ns = watch_axes(l, i, now_ns);
		watch_battery(l, i, now_ns);
		any = true;
		stuck_ns = ns > stuck_ns ? ns : stuck_ns;
		if (l->pads[i].seen && isfinite(l->pads[i].report.battery))
			emptiest = fmin(emptiest, (double)l->pads[i].report.battery * 100);
	}
	if (any)
		sample(l, BB_METRIC_PAD_STUCK, (double)stuck_ns * 1e-9, now_ns);
	if (isfinite(emptiest))
		sample(l, BB_METRIC_PAD_BATTERY, emptiest, now_ns);
}
