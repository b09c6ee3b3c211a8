/* bench/loop/pads.c: gamepad reports into navigation, once a frame; silence with a deflected stick stops the motion. */
#include "bench/loop/loop.h"

#include <math.h>

#define DEAD_ZONE 0.15F
#define SILENCE_NS INT64_C(250000000) /* row H2 */
#define YAW_DEG_PER_S 12.0
#define WALK_M_PER_S 0.15
#define NAVIGATION_MOST_M 0.3          /* how far from where the scene put the viewer */

static float most_deflection(const struct bb_pad_report *r)
{
	float most = 0;

	for (int i = 0; i < BB_PAD_AXES; i++)
		most = fmaxf(most, fabsf(r->axis[i]));
	return most;
}

/* Newest report of a pad that still drives; false: neutral, silent or gone. */
static bool drives(struct bb_frame_loop *l, size_t i, int64_t now_ns)
{
	struct bb_gamepad *g = l->rig->gamepads[i];
	struct bb_pad_report reports[16];
	enum bb_status status;
	size_t n;

	while ((status = bb_gamepad_read(g, reports, BB_ARRAY_LEN(reports), &n)) == BB_OK) {
		l->pad[i] = reports[n - 1];
		l->pad_seen[i] = true;
	}
	const int64_t silent_ns = now_ns - l->pad[i].at_ns;
	const bool deflected = l->pad_seen[i] && most_deflection(&l->pad[i]) > DEAD_ZONE;
	if (status < 0) {
		bb_watch_bad(l->watch, l->gamepad_slot[i], now_ns, BB_HEALTH_LOST, "gone: %s",
		             bb_gamepad_device(g)->last_error.detail);
		return false;
	}
	if (deflected && !l->was_away && silent_ns > SILENCE_NS && silent_ns > bb_gamepad_limits(g)->most_report_gap_ns) {
		bb_watch_bad(l->watch, l->gamepad_slot[i], now_ns, BB_HEALTH_LOST,
		             "silent for %.0f ms with its stick deflected (battery, radio?)", (double)silent_ns * 1e-6);
		return false;
	}
	bb_watch_good(l->watch, l->gamepad_slot[i], now_ns);
	return deflected;
}

static double clamp(double v, double most)
{
	return fmax(-most, fmin(most, v));
}

void bb_pads_read(struct bb_frame_loop *l, int64_t now_ns)
{
	const double dt_s = l->pad_read_ns ? fmin(0.05, (double)(now_ns - l->pad_read_ns) * 1e-9) : 0;
	struct bb_pose *nav = &l->navigation;

	l->pad_read_ns = now_ns;
	for (size_t i = 0; i < l->room->n_gamepads; i++) {
		if (!l->rig->gamepads[i] || !drives(l, i, now_ns))
			continue;
		const bool space = l->room->gamepads[i].model == BB_PAD_SPACEMOUSE;
		const double yaw = (double)(space ? l->pad[i].axis[4] : l->pad[i].axis[2]);
		const struct bb_vec3 move = { (double)l->pad[i].axis[0], space ? (double)l->pad[i].axis[1] : 0,
			                      (double)(space ? l->pad[i].axis[2] : -l->pad[i].axis[1]) };
		const struct bb_vec3 by = bb_quat_rotate(nav->q, bb_vec3_scale(move, WALK_M_PER_S * dt_s));
		nav->p = bb_vec3_add(nav->p, by);
		nav->p = (struct bb_vec3){ clamp(nav->p.x, NAVIGATION_MOST_M), clamp(nav->p.y, NAVIGATION_MOST_M),
			                   clamp(nav->p.z, NAVIGATION_MOST_M) };
		nav->q = bb_quat_unit(bb_quat_mul(bb_quat_euler_deg(-yaw * YAW_DEG_PER_S * dt_s, 0, 0), nav->q));
	}
}
