/* hal/room/room_link.c: how the nodes of a room speak to each other and flip together. */
#include "hal/room/room_build.h"

#define F64(member, def, lo, hi, help) BB_OPT_F64(struct bb_link_config, member, def, lo, hi, help)

const struct bb_option room_link_options[] = {
	{ "device", BB_OPT_TYPE_TEXT, offsetof(struct bb_link_config, device), sizeof(((struct bb_link_config *)0)->device), 0, 1,
	  0, 1, "", false, "back end" },
	F64(delay_us, 60, 0, 1e6, "one way"),
	F64(jitter_us, 10, 0, 1e6, "simulated: sd of a half normal, mean of an exponential"),
	{ "spread", BB_OPT_TYPE_ENUM, offsetof(struct bb_link_config, spread), 0, BB_LINK_HALF_NORMAL, 0, 0, 1,
	  BB_LINK_SPREAD_WORDS, false, "simulated, of the delays" },
	F64(loss_ppm, 0, 0, 1e6, "simulated, of the messages"),
	F64(duplicate_ppm, 0, 0, 1e6, "simulated, of the messages"),
	F64(send_us, 0, 0, 1e4, "simulated: a sender is busy with each message"),
	BB_OPT_END
};

const struct bb_option room_framelock_options[] = {
	{ "barrier", BB_OPT_TYPE_ENUM, offsetof(struct bb_room, barrier), 0, BB_LOCK_CENTRAL, 0, 0, 1, BB_LOCK_METHOD_WORDS,
	  false, "how nodes flip together" },
	BB_OPT_END
};

enum bb_status room_read_link(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	struct room_build *b = bb_container_of(r, struct room_build, r);
	const enum bb_status status = bb_yaml_walk(r, value, room_link_options, NULL, &b->room->link, 0);

	(void)target;
	return status ? status : room_check_device(b, value, b->room->link.device);
}

enum bb_status room_read_framelock(struct bb_reader *r, const struct bb_yaml_node *value, void *target)
{
	return bb_yaml_walk(r, value, room_framelock_options, NULL, target, 0);
}
