/*
 * tests/fuzz/fuzz_room.c: any bytes as a room file, in a file in memory: the YAML reader, option tables and the readers
 * of a room's sections; what loads is looked over as `room check` does.
 */
#define _GNU_SOURCE /* memfd_create */
#include <stdio.h>
#include <sys/mman.h>
#include <unistd.h>

#include "hal/room.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static char path[64];
	static int fd = -1; /* made once */
	struct bb_finding findings[8];
	struct bb_room *room = NULL;
	struct bb_error err = { 0 };

	if (fd < 0) {
		fd = memfd_create("fuzz", MFD_CLOEXEC);
		snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	}
	fuzz_must(fd >= 0 && ftruncate(fd, 0) == 0 && pwrite(fd, data, size, 0) == (ssize_t)size);
	if (bb_room_load(path, &room, &err) != BB_OK) {
		fuzz_must(!room && err.number >= 1000);
		return 0;
	}
	fuzz_must(room && !err.number && room->n_budgets <= BB_BUDGETS_MAX && room->n_bodies <= BB_BODIES_MAX);
	(void)bb_room_lint(room, findings, BB_ARRAY_LEN(findings));
	bb_room_free(room);
	return 0;
}
