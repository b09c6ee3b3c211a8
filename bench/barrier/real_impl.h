/* bench/barrier/real_impl.h: between the files of bench/barrier/real*.c. */
#ifndef BB_BENCH_BARRIER_REAL_IMPL_H
#define BB_BENCH_BARRIER_REAL_IMPL_H

#include <stdatomic.h>

#include "bench/barrier/real.h"
#include "drivers/link/peers.h"

#define REAL_ROUNDS_MOST 200000

struct real_shared { /* memory of all processes of a row; each counter on a line of its own */
	_Alignas(64) _Atomic uint32_t arrived;
	_Alignas(64) _Atomic uint32_t turn;   /* futex: barriers passed */
	_Alignas(64) _Atomic uint32_t asleep; /* on it */
	_Alignas(64) _Atomic uint32_t here;   /* processes that are set up */
	_Atomic uint64_t last_round;          /* nobody goes on after this one */
	_Atomic uint32_t failed;
	uint16_t port;                        /* of rank 0 */
	char address[128];
	uint8_t secret[32];
	uint64_t rounds;                      /* of rank 0, */
	double cpu_s[BB_REAL_SIZE_MOST];
	double elapsed_s;
	float took_us[REAL_ROUNDS_MOST];      /* how long each barrier was, */
	float frame_us[REAL_ROUNDS_MOST];     /* and each frame, barrier and picture */
};

struct real_place { /* of one process in a row */
	struct real_shared *shared;
	unsigned rank, n;
	enum bb_real_method method;
	uint32_t round;
	int looks;                            /* before a yield */
	unsigned shy, patience;               /* adaptive: barriers at which it only sleeps: left, and the next time */
	int socket;
	struct bb_clock *clk;
	struct bb_link *link;
	struct bb_timer woken;
};

/* A way to wait for each other. False: it cannot be done here. */
void real_memory_begin(struct real_place *p);
BB_MUST_CHECK bool real_memory_wait(struct real_place *p);
BB_MUST_CHECK bool real_net_begin(struct real_place *p);
BB_MUST_CHECK bool real_net_wait(struct real_place *p);
void real_net_end(struct real_place *p);

/* Something to draw: a small volume, made once and drawn by every process in turn. */
struct real_easel;
BB_MUST_CHECK enum bb_status real_easel_create(struct real_easel **out, struct bb_error *err);
void real_easel_destroy(struct real_easel *e);
/* In the process that draws: false if it cannot. */
BB_MUST_CHECK bool real_easel_take(struct real_easel *e, uint32_t edge_px);
void real_easel_draw(struct real_easel *e);

#endif
