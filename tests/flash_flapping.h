/* tests/flash_flapping.h: a sync line that is lost and comes back ten times a second, for eight seconds. */
#ifndef BB_TESTS_FLASH_FLAPPING_H
#define BB_TESTS_FLASH_FLAPPING_H

#include "tests/flash_campaign.h"

static inline struct campaign flapping(uint64_t room)
{
	struct sim_fault *f = calloc(100, sizeof(*f));
	size_t n = 0;

	assert_non_null(f);
	for (int i = 0; i < 80; i++) {
		char text[100];
		snprintf(text, sizeof(text), "at %dms shutter/chain stuck for 50ms", 1000 + 100 * i);
		plant(f, &n, text);
	}
	const struct campaign c = campaign_of(room, f, n, 0);
	free(f);
	return c;
}

#endif
