/* hal/clock.c: both clocks share one timer heap; they differ only in how time gets to the next timer. */
#include "hal/clock.h"

#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>

#define RANK_SHIFT 56 /* 2^56 armings are enough for years */

struct entry { /* what decides stands here and not in the timer: hundreds of displays wait for one vblank */
	int64_t at_ns;
	uint64_t order;          /* rank above the order of arming */
	struct bb_timer *timer;
};

struct bend { /* one time axis on another: t + off + rate (t - ref) */
	int64_t ref_ns, off_ns;
	double rate;
};

struct bb_clock {
	bool virtual_time, stopped;
	struct bend crystal;     /* posix: CLOCK_MONOTONIC as this process takes it, planted errors included */
	struct bend steer;       /* and as another machine's clock goes */
	int64_t now_ns;          /* virtual */
	int64_t zero_ns;         /* posix: CLOCK_MONOTONIC at creation */
	struct entry *heap;      /* least first */
	size_t n, cap;
	uint64_t order, steps;
	int64_t wall_ahead_ns;   /* virtual */
	bb_wait_fn wait;         /* posix: instead of sleeping */
	void *wait_ctx;
};

int64_t bb_clock_stopwatch_ns(void)
{
	struct timespec t;

	clock_gettime(CLOCK_MONOTONIC, &t);
	return (int64_t)t.tv_sec * BB_NS_PER_S + t.tv_nsec;
}

int64_t bb_clock_cpu_ns(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (int64_t)t.tv_sec * BB_NS_PER_S + t.tv_nsec;
}

static int64_t bent(const struct bend *b, int64_t t_ns)
{
	return t_ns + b->off_ns + (int64_t)(b->rate * (double)(t_ns - b->ref_ns));
}

static int64_t unbent(const struct bend *b, int64_t bent_ns)
{
	const int64_t t_ns = bent_ns - b->off_ns;

	return t_ns - (int64_t)(b->rate / (1 + b->rate) * (double)(t_ns - b->ref_ns));
}

static void bend_on(struct bend *b, int64_t from_ns, double rate)
{
	b->off_ns = bent(b, from_ns) - from_ns;
	b->ref_ns = from_ns;
	b->rate = rate;
}

static enum bb_status create(bool virtual_time, struct bb_clock **out)
{
	struct bb_clock *clk = calloc(1, sizeof(*clk));

	*out = clk;
	if (!clk)
		return BB_ERR_NOMEM;
	clk->virtual_time = virtual_time;
	clk->zero_ns = bb_clock_stopwatch_ns();
	return BB_OK;
}

enum bb_status bb_clock_virtual_create(struct bb_clock **out)
{
	return create(true, out);
}

enum bb_status bb_clock_posix_create(struct bb_clock **out)
{
	/* The kernel may let sleepers of ordinary priority oversleep by 50 us to save wake-ups: not these. */
	(void)prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
	return create(false, out);
}

void bb_clock_destroy(struct bb_clock *clk)
{
	if (!clk)
		return;
	for (size_t i = 0; i < clk->n; i++)
		clk->heap[i].timer->slot = 0;
	free(clk->heap);
	free(clk);
}

void bb_clock_today(char out[32])
{
	struct timespec t;
	struct tm day;

	clock_gettime(CLOCK_REALTIME, &t);
	gmtime_r(&t.tv_sec, &day);
	if (!strftime(out, 32, "%Y-%m-%d", &day))
		out[0] = 0;
}

bool bb_clock_is_virtual(const struct bb_clock *clk)
{
	return clk->virtual_time;
}

int64_t bb_clock_now_ns(const struct bb_clock *clk)
{
	return clk->virtual_time ? clk->now_ns : bb_clock_from_monotonic_ns(clk, bb_clock_stopwatch_ns());
}

int64_t bb_clock_own_ns(const struct bb_clock *clk, int64_t at_ns)
{
	return unbent(&clk->steer, at_ns + clk->zero_ns);
}

void bb_clock_steer(struct bb_clock *clk, double ppb)
{
	bend_on(&clk->steer, bent(&clk->crystal, bb_clock_stopwatch_ns()), ppb * 1e-9);
}

void bb_clock_plant_crystal(struct bb_clock *clk, double ppb)
{
	bend_on(&clk->crystal, bb_clock_stopwatch_ns(), ppb * 1e-9);
}

int64_t bb_clock_from_monotonic_ns(const struct bb_clock *clk, int64_t monotonic_ns)
{
	return clk->virtual_time ? monotonic_ns : bent(&clk->steer, bent(&clk->crystal, monotonic_ns)) - clk->zero_ns;
}

int64_t bb_clock_of_realtime_ns(const struct bb_clock *clk, int64_t realtime_ns)
{
	struct timespec t;

	if (clk->virtual_time)
		return realtime_ns;
	const int64_t before_ns = bb_clock_now_ns(clk);
	clock_gettime(CLOCK_REALTIME, &t);
	const int64_t after_ns = bb_clock_now_ns(clk);
	const int64_t age_ns = (int64_t)t.tv_sec * BB_NS_PER_S + t.tv_nsec - realtime_ns;
	return before_ns + (after_ns - before_ns) / 2 - age_ns;
}

#define ONE_MOMENT_NS 500000

bool bb_clock_wall_ahead_ns(const struct bb_clock *clk, int64_t *ahead_ns)
{
	struct timespec t;

	*ahead_ns = clk->wall_ahead_ns;
	if (clk->virtual_time)
		return true;
	const int64_t before_ns = bb_clock_stopwatch_ns();
	clock_gettime(CLOCK_REALTIME, &t);
	const int64_t after_ns = bb_clock_stopwatch_ns();
	*ahead_ns = (int64_t)t.tv_sec * BB_NS_PER_S + t.tv_nsec - before_ns;
	return after_ns - before_ns < ONE_MOMENT_NS;
}

void bb_clock_set_wall_ahead(struct bb_clock *clk, int64_t ahead_ns)
{
	clk->wall_ahead_ns = ahead_ns;
}

uint64_t bb_clock_steps(const struct bb_clock *clk)
{
	return clk->steps;
}

static inline bool before(const struct entry *a, const struct entry *b)
{
	return a->at_ns != b->at_ns ? a->at_ns < b->at_ns : a->order < b->order;
}

static inline void place(struct bb_clock *clk, size_t i, const struct entry *e)
{
	clk->heap[i] = *e;
	e->timer->slot = i + 1;
}

/* A heap of four children is half as deep. */
static void sift(struct bb_clock *clk, size_t i, struct entry e)
{
	while (i > 0 && before(&e, &clk->heap[(i - 1) / 4])) {
		place(clk, i, &clk->heap[(i - 1) / 4]);
		i = (i - 1) / 4;
	}
	for (;;) {
		const size_t first = 4 * i + 1, end = first + 4 < clk->n ? first + 4 : clk->n;
		size_t least = first;
		if (first >= clk->n)
			break;
		for (size_t child = first + 1; child < end; child++)
			if (before(&clk->heap[child], &clk->heap[least]))
				least = child;
		if (!before(&clk->heap[least], &e))
			break;
		place(clk, i, &clk->heap[least]);
		i = least;
	}
	place(clk, i, &e);
}

enum bb_status bb_clock_arm(struct bb_clock *clk, struct bb_timer *timer, int64_t at_ns)
{
	size_t i = timer->slot - 1;

	timer->at_ns = at_ns;
	timer->order = (uint64_t)timer->rank << RANK_SHIFT | clk->order++;
	if (!timer->slot) {
		if (clk->n == clk->cap) {
			const size_t cap = clk->cap ? 2 * clk->cap : 64;
			struct entry *heap = realloc(clk->heap, cap * sizeof(*heap));
			if (!heap)
				return BB_ERR_NOMEM;
			clk->heap = heap;
			clk->cap = cap;
		}
		i = clk->n++;
	}
	sift(clk, i, (struct entry){ at_ns, timer->order, timer });
	return BB_OK;
}

void bb_clock_disarm(struct bb_clock *clk, struct bb_timer *timer)
{
	const size_t i = timer->slot - 1;

	if (!timer->slot)
		return;
	timer->slot = 0;
	const struct entry last = clk->heap[--clk->n];
	if (last.timer != timer)
		sift(clk, i, last);
}

int64_t bb_clock_next_ns(const struct bb_clock *clk)
{
	return clk->n ? clk->heap[0].at_ns : BB_NEVER;
}

void bb_clock_stop(struct bb_clock *clk)
{
	clk->stopped = true;
}

static void wait_until(struct bb_clock *clk, int64_t at_ns)
{
	const int64_t abs_ns = unbent(&clk->crystal, bb_clock_own_ns(clk, at_ns));
	const struct timespec t = { .tv_sec = abs_ns / BB_NS_PER_S, .tv_nsec = abs_ns % BB_NS_PER_S };

	if (clk->virtual_time) {
		if (at_ns > clk->now_ns)
			clk->now_ns = at_ns;
		return;
	}
	if (clk->wait)
		clk->wait(clk->wait_ctx, abs_ns);
	else
		(void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL); /* a signal ends it: the caller looks again */
}

void bb_clock_wait_by(struct bb_clock *clk, bb_wait_fn wait, void *ctx)
{
	clk->wait = wait;
	clk->wait_ctx = ctx;
}

void bb_clock_set_zero(struct bb_clock *clk, int64_t zero_monotonic_ns)
{
	clk->zero_ns = zero_monotonic_ns;
}

int64_t bb_clock_zero_ns(const struct bb_clock *clk)
{
	return clk->zero_ns;
}

/* The next timer up to end_ns, when it is due; a wait may have armed an earlier one, so it looks again after each. */
static struct bb_timer *next_due(struct bb_clock *clk, int64_t end_ns)
{
	while (!clk->stopped) {
		const int64_t next_ns = bb_clock_next_ns(clk), until_ns = next_ns < end_ns ? next_ns : end_ns;
		if (bb_clock_now_ns(clk) >= until_ns)
			return next_ns <= end_ns ? clk->heap[0].timer : NULL;
		wait_until(clk, until_ns);
	}
	return NULL;
}

void bb_clock_run_until(struct bb_clock *clk, int64_t end_ns)
{
	struct bb_timer *t;

	clk->stopped = false;
	while ((t = next_due(clk, end_ns))) {
		const int64_t at_ns = t->at_ns;

		bb_clock_disarm(clk, t);
		clk->steps++;
		const int64_t next_ns = t->step(t, at_ns, bb_clock_now_ns(clk));
		/* The heap just shrank by one, so this cannot need memory. */
		if (next_ns != BB_NEVER && !t->slot && bb_clock_arm(clk, t, next_ns) != BB_OK)
			return;
	}
}

void bb_clock_floor_us(int64_t period_ns, double *late_us, size_t n)
{
	int64_t at_ns = bb_clock_stopwatch_ns();

	for (size_t i = 0; i < n; i++) {
		at_ns += period_ns;
		const struct timespec t = { .tv_sec = at_ns / BB_NS_PER_S, .tv_nsec = at_ns % BB_NS_PER_S };
		while (bb_clock_stopwatch_ns() < at_ns)
			(void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
		const int64_t now_ns = bb_clock_stopwatch_ns();
		late_us[i] = (double)(now_ns - at_ns) * 1e-3;
		at_ns = now_ns > at_ns + period_ns ? now_ns : at_ns; /* what was missed is not caught up on */
	}
}
