/*
 * tests/guest/measure.h: what the programs that run in the guest share: a failure that names its line, the clock, and
 * latencies as members of the one JSON line a program prints. Times in ns.
 */
#ifndef BB_TESTS_GUEST_MEASURE_H
#define BB_TESTS_GUEST_MEASURE_H

#include <dirent.h>
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Ends the program with the line, the expression and errno when it does not hold. */
#define NEED(expression)                                                                                      \
	do {                                                                                                  \
		if (!(expression)) {                                                                          \
			printf("%s:%d: %s: %s\n", __FILE__, __LINE__, #expression, strerror(errno));          \
			exit(1);                                                                              \
		}                                                                                             \
	} while (0)

static inline int64_t clock_ns(clockid_t clock)
{
	struct timespec t;

	NEED(clock_gettime(clock, &t) == 0);
	return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static inline void pause_ns(int64_t ns)
{
	const struct timespec t = { .tv_sec = ns / 1000000000, .tv_nsec = ns % 1000000000 };

	nanosleep(&t, NULL);
}

/* How many files this process has open. */
static inline long descriptors(void)
{
	DIR *d = opendir("/proc/self/fd");
	long n = 0;

	while (d && readdir(d))
		n++;
	if (d)
		closedir(d);
	return n;
}

static inline int compare_ns(const void *a, const void *b)
{
	const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;

	return (x > y) - (x < y);
}

/* Sorts the samples. */
static inline void print_latency(const char *name, int64_t *ns, size_t n)
{
	qsort(ns, n, sizeof ns[0], compare_ns);
	printf(", \"%s_p50_ns\": %lld, \"%s_p99_ns\": %lld, \"%s_max_ns\": %lld", name, (long long)ns[n / 2], name,
	       (long long)ns[n * 99 / 100], name, (long long)ns[n - 1]);
}

/* The same in us and under names that no gate looks at: times that hang on when somebody looked. Sorts the samples. */
static inline void print_seen(const char *name, int64_t *ns, size_t n)
{
	qsort(ns, n, sizeof ns[0], compare_ns);
	printf(", \"%s_us_p50\": %.1f, \"%s_us_p99\": %.1f, \"%s_us_max\": %.1f", name, (double)ns[n / 2] * 1e-3, name,
	       (double)ns[n * 99 / 100] * 1e-3, name, (double)ns[n - 1] * 1e-3);
}

#endif
