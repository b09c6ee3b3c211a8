/*
 * tests/guest/align.c: sleeps until a whole second of CLOCK_MONOTONIC and ends, so that a fork's first stamps are easy to
 * compare. Goes into the guest with the tools, not with the tests.
 */
#include <errno.h>
#include <time.h>

int main(void)
{
	struct timespec t;

	if (clock_gettime(CLOCK_MONOTONIC, &t))
		return 1;
	t = (struct timespec){ .tv_sec = t.tv_sec + 2 };
	while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR)
		;
	return 0;
}
