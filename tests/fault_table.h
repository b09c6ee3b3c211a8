/*
 * tests/fault_table.h: the lines of the fault table, the same for every class: which row of the fault matrix, what was
 * injected, the word it was reported by, and how long until it was noticed and, once it was over, until all was well.
 * tests/run.sh shows the lines, since they begin with "fault".
 */
#ifndef BB_TESTS_FAULT_TABLE_H
#define BB_TESTS_FAULT_TABLE_H

#include "hal/clock.h"

#include <stdio.h>
#include <string.h>

/*
 * The first word of "named" is shown. budget_ns below 0: the test asserts it by other means; recovered_ns BB_NEVER: an
 * operator has to.
 */
static inline void fault_row(const char *row, const char *injected, const char *named, int64_t detected_ns,
                             int64_t budget_ns, int64_t recovered_ns)
{
	static int headed;
	char budget[24] = "", recovered[24] = "by hand";
	const int word = (int)strcspn(named, " :,");

	if (!headed++)
		printf("fault %-4s %-46s %-13s %12s %10s %13s\n", "row", "injected", "named", "detected, ms", "budget",
		       "recovered, ms");
	if (budget_ns >= 0)
		snprintf(budget, sizeof(budget), "%.1f", (double)budget_ns * 1e-6);
	if (recovered_ns != BB_NEVER)
		snprintf(recovered, sizeof(recovered), "%.2f", (double)recovered_ns * 1e-6);
	printf("fault %-4s %-46s %-13.*s %12.2f %10s %13s\n", row, injected, word, named, (double)detected_ns * 1e-6, budget, recovered);
	fflush(stdout);
}

#endif
