/*
 * hal/clock.h: the injected clock and its timer queue. Nothing outside hal/ reads a clock or sleeps.
 *
 * Time is int64_t ns on one monotonic axis that starts near 0 when the clock is created. Everything concurrent is a
 * state machine: a timer whose step runs at (or after) its time and answers when it wants to run again. On the virtual
 * clock running a timer moves `now` to its time exactly, so a run is a discrete-event simulation; on the posix clock
 * the thread sleeps until then. Timers due at one time run in order of (at_ns, rank, order of arming): no pointer or
 * hash order is ever seen. A clock and its timers belong to one thread.
 */
#ifndef BB_HAL_CLOCK_H
#define BB_HAL_CLOCK_H

#include "hal/rate.h"
#include "hal/status.h"

struct bb_clock;
struct bb_timer;

/* Called with the time the timer was armed for (scheduled_ns: use it for stamps) and now_ns >= scheduled_ns.
 * Returns the next time to run, or BB_NEVER. */
typedef int64_t (*bb_step_fn)(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);

struct bb_timer { /* the caller's memory; embed it; zero is "not armed" */
	bb_step_fn step;
	int64_t at_ns;
	uint8_t rank;      /* of equal times the lower rank runs first: 0 world, 1 devices, 2 links, 3 the loop */
	uint64_t order;    /* private: rank and arming order */
	size_t slot;       /* private: 1 + index in the queue, 0 when not armed */
};

BB_MUST_CHECK enum bb_status bb_clock_virtual_create(struct bb_clock **out);
BB_MUST_CHECK enum bb_status bb_clock_posix_create(struct bb_clock **out);
void bb_clock_destroy(struct bb_clock *clk); /* NULL is allowed; armed timers are forgotten */

bool bb_clock_is_virtual(const struct bb_clock *clk);
int64_t bb_clock_now_ns(const struct bb_clock *clk);
/* A kernel's CLOCK_MONOTONIC stamp on this clock's axis. On the virtual clock stamps come from peers: unchanged. */
int64_t bb_clock_from_monotonic_ns(const struct bb_clock *clk, int64_t monotonic_ns);

/* The host time of a CLOCK_REALTIME stamp, as the kernel gives them with received frames. Valid for stamps of the last
 * moments: the wall clock may be set between two calls. On the virtual clock stamps are host time already. */
int64_t bb_clock_of_realtime_ns(const struct bb_clock *clk, int64_t realtime_ns);

/* How far CLOCK_REALTIME is ahead of CLOCK_MONOTONIC: to tell that somebody set the wall clock, and for nothing else.
 * False: the two could not be read at one moment. On the virtual clock: what was set last, 0 before. */
bool bb_clock_wall_ahead_ns(const struct bb_clock *clk, int64_t *ahead_ns);
void bb_clock_set_wall_ahead(struct bb_clock *clk, int64_t ahead_ns);

/* The wall clock's date, "2026-11-22", UTC: for files that say when they were made, and for nothing else. */
void bb_clock_today(char out[32]);

/* Arm (or re-arm) for an absolute time; a time in the past runs next. Fails only with BB_ERR_NOMEM. */
BB_MUST_CHECK enum bb_status bb_clock_arm(struct bb_clock *clk, struct bb_timer *timer, int64_t at_ns);
void bb_clock_disarm(struct bb_clock *clk, struct bb_timer *timer);

/* When the next timer is due (it may have been long ago), or BB_NEVER: for a loop that waits for files as well. */
int64_t bb_clock_next_ns(const struct bb_clock *clk);

/* Run every timer due up to end_ns, then leave now at end_ns. Stops early when bb_clock_stop was called. */
void bb_clock_run_until(struct bb_clock *clk, int64_t end_ns);
void bb_clock_stop(struct bb_clock *clk);

/* Posix: what to do instead of sleeping, for a link whose messages come from other processes. Returns when
 * CLOCK_MONOTONIC reaches until_ns, or before that when something came for which it may have armed a timer. NULL: sleep. */
typedef void (*bb_wait_fn)(void *ctx, int64_t until_monotonic_ns);
void bb_clock_wait_by(struct bb_clock *clk, bb_wait_fn wait, void *ctx);
/* Posix, before any timer is armed: now is CLOCK_MONOTONIC minus this from here on, so that processes share one axis. */
void bb_clock_set_zero(struct bb_clock *clk, int64_t zero_monotonic_ns);
int64_t bb_clock_zero_ns(const struct bb_clock *clk);
/* Posix: from here on now runs that much faster than this machine's oscillator (sync/servo.h), without a step; within
 * +-9e8 ppb, or time would stand still or run back. */
void bb_clock_steer(struct bb_clock *clk, double ppb);
/* What nobody steers: CLOCK_MONOTONIC at a time of this clock. */
int64_t bb_clock_own_ns(const struct bb_clock *clk, int64_t at_ns);
/* For tests: from here on this machine's oscillator is that much too fast, for this process. */
void bb_clock_plant_crystal(struct bb_clock *clk, double ppb);

/* How late n bare sleeps of one period after another end on this machine, us: what no program here can do better than. */
void bb_clock_floor_us(int64_t period_ns, double *late_us, size_t n);

/* How many steps ran since creation: the cost of a simulation, counted. */
uint64_t bb_clock_steps(const struct bb_clock *clk);

/* CPU-independent stopwatch for measured costs: real monotonic ns on either clock. Never used for decisions on the
 * virtual clock. */
int64_t bb_clock_stopwatch_ns(void);
/* The same of the calling thread's processor time: what work costs, whoever else is busy. */
int64_t bb_clock_cpu_ns(void);

#endif
