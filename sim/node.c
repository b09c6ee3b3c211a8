/* sim/node.c: what can go wrong with a render node or with the viewer: the verbs of the classes "node" and "world". */
#include "sim/world_impl.h"

#include <math.h>

static enum bb_status node_late(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;
	double frames;
	const enum bb_status status = sim_fault_range(args, "frames", 1, 1, 1000, &frames, err);

	if (status == BB_OK && node)
		node->late_frames += on ? lround(frames) : -lround(frames);
	return status;
}

static enum bb_status node_slow(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;
	double ms;
	const enum bb_status status = sim_fault_range(args, "ms", SIM_FAULT_REQUIRED, 0, 60000, &ms, err);

	if (status == BB_OK && node)
		node->slow_ns += on ? llround(ms * 1e6) : -llround(ms * 1e6);
	return status;
}

static enum bb_status node_drag(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;
	double factor;
	const enum bb_status status = sim_fault_range(args, "factor", SIM_FAULT_REQUIRED, 1, 100, &factor, err);

	if (status == BB_OK && node)
		node->drag_ppm += llround((on ? 1e6 : -1e6) * (factor - 1));
	return status;
}

static enum bb_status node_crash(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;

	(void)args;
	(void)err;
	if (node)
		node->crashed += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status node_stall(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;

	(void)args;
	(void)err;
	if (node)
		node->stalled += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status node_suspend(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;

	(void)args;
	(void)err;
	if (node)
		node->suspended += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status node_set_clock(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_node_state *node = device;
	int64_t ahead_ns;
	double s;
	const enum bb_status status = sim_fault_range(args, "s", SIM_FAULT_REQUIRED, -1e9, 1e9, &s, err);

	if (status == BB_OK && node && bb_clock_wall_ahead_ns(node->world->clk, &ahead_ns))
		bb_clock_set_wall_ahead(node->world->clk, ahead_ns + llround((on ? 1e9 : -1e9) * s));
	return status;
}

const struct sim_verb sim_node_verbs[] = {
	{ "late", "[frames=N]", "the node's image is N loop frames late", "frames=1", node_late },
	{ "slow", "ms=N", "every frame of the node takes N ms longer", "ms=5", node_slow },
	{ "drag", "factor=N", "every draw of the node takes N times as long", "factor=1.5", node_drag },
	{ "crash", "", "the node is silent: it draws, sends and answers nothing", "", node_crash },
	{ "set_clock", "s=N", "somebody sets the head's wall clock by N seconds", "s=3600", node_set_clock },
	{ "stall", "", "the node's disk reads nothing", "", node_stall },
	{ "suspend", "", "the process stands still, as after closing a lid; of the head: the frame loop", "", node_suspend },
	{ NULL, NULL, NULL, NULL, NULL },
};

static enum bb_status viewer_leave(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_viewer_state *viewer = device;

	(void)args;
	(void)err;
	if (viewer)
		viewer->left += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status viewer_grip(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_viewer_state *viewer = device;
	double marker;
	const enum bb_status status = sim_fault_range(args, "marker", SIM_FAULT_REQUIRED, 1, SIM_MARKERS, &marker, err);

	if (status == BB_OK && viewer)
		viewer->gripped[(size_t)marker - 1] += on ? 1 : -1;
	return status;
}

static enum bb_status viewer_loosen(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_viewer_state *viewer = device;
	double marker, mm;
	enum bb_status status = sim_fault_range(args, "marker", SIM_FAULT_REQUIRED, 1, SIM_MARKERS, &marker, err);

	if (status == BB_OK)
		status = sim_fault_range(args, "mm", SIM_FAULT_REQUIRED, 0, 1000, &mm, err);
	if (status == BB_OK && viewer)
		viewer->loose_nm[(size_t)marker - 1] += llround((on ? 1e6 : -1e6) * mm);
	return status;
}

static enum bb_status viewer_door(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_viewer_state *viewer = device;
	double deg;
	const enum bb_status status = sim_fault_range(args, "deg", SIM_FAULT_REQUIRED, 0, 170, &deg, err);

	if (status == BB_OK && viewer)
		viewer->door_mdeg += llround((on ? 1e3 : -1e3) * deg);
	return status;
}

const struct sim_verb sim_viewer_verbs[] = {
	{ "leave", "", "nobody is in the room: no marker, nothing that hides one", "", viewer_leave },
	{ "grip", "marker=N", "a finger lies on marker N of the wand (from 1)", "marker=4", viewer_grip },
	{ "loosen", "marker=N mm=N", "marker N of the glasses (from 1) is out of its place by so much", "marker=2 mm=20",
	  viewer_loosen },
	{ "door", "deg=N", "the room's door, if it has one, stands open into the room: cameras do not see through it", "deg=80",
	  viewer_door },
	{ NULL, NULL, NULL, NULL, NULL },
};

int64_t sim_world_node_delay_ns(const struct sim_world *w, uint16_t node, int64_t at_ns)
{
	(void)at_ns; /* faults set and clear on the world's rank, before anybody asks at the same instant */
	if (node >= w->room->n_nodes)
		return 0;
	return w->nodes[node].late_frames * w->frame_ns + w->nodes[node].slow_ns;
}

int64_t sim_world_node_drag_ppm(const struct sim_world *w, uint16_t node)
{
	return node < w->room->n_nodes ? w->nodes[node].drag_ppm : 0;
}

bool sim_world_node_stalled(const struct sim_world *w, uint16_t node)
{
	return node < w->room->n_nodes && w->nodes[node].stalled > 0;
}

bool sim_world_node_suspended(const struct sim_world *w, uint16_t node)
{
	return node < w->room->n_nodes && w->nodes[node].suspended > 0;
}

bool sim_world_node_dead(const struct sim_world *w, uint16_t node, int64_t at_ns)
{
	(void)at_ns;
	return node < w->room->n_nodes && w->nodes[node].crashed > 0;
}
