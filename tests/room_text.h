/* tests/room_text.h: a file from text for tests of loaders, gone after the load. */
#ifndef BB_TESTS_ROOM_TEXT_H
#define BB_TESTS_ROOM_TEXT_H

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "hal/room.h"

static inline struct bb_room *room_from(const char *text, struct bb_error *err)
{
	char name[] = "/tmp/bb-room-XXXXXX";
	struct bb_room *room = NULL;
	const int fd = mkstemp(name);
	FILE *f = fd < 0 ? NULL : fdopen(fd, "w");

	if (!f)
		return NULL;
	fputs(text, f);
	fclose(f);
	if (bb_room_load(name, &room, err))
		room = NULL;
	unlink(name);
	return room;
}

#endif
