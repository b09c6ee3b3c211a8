/* bench/barrier/real_memory.c: barriers that are a counter in memory that processes share. */
#include "bench/barrier/real_impl.h"

#include <limits.h>
#include <linux/futex.h>
#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

#define PAUSES 200
#define LOOKS 100              /* before a yield, when every process has a core: a few us */
#define YIELD_MOST_NS 50000    /* what took longer did not pay: a core was given to somebody who kept it */
#define PATIENCE_LEAST 16      /* barriers at which it only sleeps, after yielding did not pay; doubled each time, */
#define PATIENCE_EASES 64      /* and less by this part each time it does pay */
#define PATIENCE_MOST 4096

static void pause_a_little(void)
{
#if defined(__x86_64__) || defined(__i386__)
	__builtin_ia32_pause();
#endif
}

static bool passed(const struct real_shared *s, uint32_t turn)
{
	return atomic_load(&s->turn) != turn;
}

static void sleep_until_passed(struct real_shared *s, uint32_t turn)
{
	atomic_fetch_add(&s->asleep, 1);
	while (!passed(s, turn))
		syscall(SYS_futex, &s->turn, FUTEX_WAIT, turn, NULL, NULL, 0);
	atomic_fetch_sub(&s->asleep, 1);
}

/* While nobody else wants this core a look costs least; a pause between two is worth it, a yield is not. */
static bool look(const struct real_place *p, uint32_t turn)
{
	for (int i = 0; i < p->looks; i++) {
		if (passed(p->shared, turn))
			return true;
		pause_a_little();
	}
	return passed(p->shared, turn);
}

static void spin(struct real_place *p, uint32_t turn)
{
	while (!look(p, turn))
		sched_yield();
}

static void spin_then_sleep(struct real_shared *s, uint32_t turn)
{
	for (int i = 0; i < PAUSES && !passed(s, turn); i++)
		pause_a_little();
	sleep_until_passed(s, turn);
}

/*
 * Yields as long as that pays: the others need the core to arrive. On a busy machine a yield hands it to somebody who keeps
 * it for a slice, thousands of times what waking from a futex takes: then it sleeps, and tries again later.
 */
static void adapt(struct real_place *p, uint32_t turn)
{
	if (p->shy) {
		p->shy--;
		sleep_until_passed(p->shared, turn);
		return;
	}
	const int64_t end_ns = bb_clock_stopwatch_ns() + YIELD_MOST_NS;
	bool in_time = true, here = look(p, turn);
	while (!here && in_time) {
		sched_yield();
		here = passed(p->shared, turn);
		in_time = bb_clock_stopwatch_ns() < end_ns;
	}
	if (here && in_time) {
		p->patience -= p->patience / PATIENCE_EASES;
		p->patience = p->patience > PATIENCE_LEAST ? p->patience : PATIENCE_LEAST;
		return;
	}
	p->shy = p->patience;
	p->patience = 2 * p->patience < PATIENCE_MOST ? 2 * p->patience : PATIENCE_MOST;
	sleep_until_passed(p->shared, turn);
}

void real_memory_begin(struct real_place *p)
{
	const long cores = sysconf(_SC_NPROCESSORS_ONLN);

	p->looks = cores >= (long)p->n ? LOOKS : 1;
	p->patience = PATIENCE_LEAST;
}

bool real_memory_wait(struct real_place *p)
{
	struct real_shared *s = p->shared;
	const uint32_t turn = atomic_load(&s->turn);

	if (atomic_fetch_add(&s->arrived, 1) + 1 == p->n) {
		atomic_store(&s->arrived, 0);
		atomic_fetch_add(&s->turn, 1);
		if (atomic_load(&s->asleep))
			syscall(SYS_futex, &s->turn, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
		return true;
	}
	if (p->method == BB_REAL_SPIN)
		spin(p, turn);
	else if (p->method == BB_REAL_FUTEX)
		sleep_until_passed(s, turn);
	else if (p->method == BB_REAL_SPIN_FUTEX)
		spin_then_sleep(s, turn);
	else
		adapt(p, turn);
	return true;
}
