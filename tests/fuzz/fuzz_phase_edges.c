/*
 * tests/fuzz/fuzz_phase_edges.c: any bytes as a list of measured edges, in a file in memory, beside a plan of a room with
 * shutters.
 */
#define _GNU_SOURCE /* memfd_create */
#include <math.h>
#include <sys/mman.h>
#include <unistd.h>

#include "bench/phase/edges.h"
#include "tests/fuzz/fuzz.h"

static const struct bb_plan plan = {
	.period_us = 8333.3,
	.timing = { .glasses_at_us = -200, .glasses_open_us = 6000, .shutter_at_us = 300, .shutter_open_us = 6000 },
	.n_cameras = 2,
	.camera = { { .first = "c1", .n = 8, .locked = true, .offset_us = 700, .exposure_us = 400 }, { .first = "c9", .n = 1 } },
};

static void check(const struct bb_phase_edges *e)
{
	fuzz_must(e->n_groups > 0 && e->n_groups <= BB_PHASE_GROUPS && e->cycle_us > 0 && isfinite(e->cycle_us));
	for (size_t i = 0; i < e->n_groups; i++) {
		const struct bb_phase_group *g = &e->group[i];
		fuzz_must(g->track[0] && strlen(g->track) < BB_PHASE_TEXT && g->event[0] && strlen(g->event) < sizeof(g->event));
		fuzz_must(g->mean_us >= 0 && g->mean_us <= e->cycle_us && g->least_us <= 0 && g->most_us >= 0);
		fuzz_must(g->most_us - g->least_us <= e->cycle_us * (1 + 1e-9));
		(void)bb_phase_loose(e, g);
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bb_room *room; /* these are made once */
	static char path[64];
	static int fd = -1;
	static struct bb_phase_edges edges;
	struct bb_error err = { 0 };

	if (fd < 0) {
		fuzz_must(bb_room_load("rooms/cabin.yaml", &room, &err) == BB_OK);
		fd = memfd_create("fuzz", MFD_CLOEXEC);
		snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	}
	fuzz_must(fd >= 0 && ftruncate(fd, 0) == 0 && pwrite(fd, data, size, 0) == (ssize_t)size);
	if (bb_phase_edges_read(path, room, &plan, &edges, &err) == BB_OK)
		check(&edges);
	else
		fuzz_must(err.number >= 1000);
	return 0;
}
