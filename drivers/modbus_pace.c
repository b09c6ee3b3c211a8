#include "drivers/modbus_pace.h"

#define FIRST_NS (100 * INT64_C(1000000))
#define MOST_NS (5000 * INT64_C(1000000))

void modbus_pace_add(struct modbus_pace *p, int64_t took_ns)
{
	p->took_ns[p->n++ % MODBUS_PACE_KEPT] = took_ns;
}

/* Of a thousand the 99.9th percentile is the second largest, of fewer the largest. */
int64_t modbus_pace_timeout_ns(const struct modbus_pace *p)
{
	const size_t kept = p->n < MODBUS_PACE_KEPT ? p->n : MODBUS_PACE_KEPT;
	int64_t largest = 0, second = 0;

	if (kept < MODBUS_PACE_LEAST)
		return p->most_ns;
	for (size_t i = 0; i < kept; i++) {
		const int64_t ns = p->took_ns[i];
		if (ns > largest) {
			second = largest;
			largest = ns;
		} else if (ns > second) {
			second = ns;
		}
	}
	const int64_t wait_ns = 2 * (kept == MODBUS_PACE_KEPT ? second : largest);
	if (wait_ns < p->least_ns)
		return p->least_ns;
	return wait_ns < p->most_ns ? wait_ns : p->most_ns;
}

int64_t modbus_backoff_next_ns(struct modbus_backoff *b)
{
	const int64_t plain_ns = b->tries < 6 ? FIRST_NS << b->tries : MOST_NS;

	b->tries++;
	b->random = b->random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	const int64_t percent = 80 + (int64_t)((b->random >> 33) % 41);
	return plain_ns / 100 * percent;
}
