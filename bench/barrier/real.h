/*
 * bench/barrier/real.h: barriers of real processes on this machine, 2 to 8 of them: how long one takes, what it costs the
 * processors, and what it takes from frames that are drawn between them.
 *
 *   idle     barriers back to back, nothing else runs: what one call takes on rank 0
 *   busy     the same while a ray caster keeps every core busy
 *   drawing  every process casts a small picture, then waits for the others: how much longer the frame in the middle takes than the
 *            pictures of all do on as many cores as there are
 *
 * MPI_Barrier is a peer: a program of its own, run by mpirun where there is one. Real time, so never the same twice: the
 * middle can be compared, the tail tells what else the machine did.
 */
#ifndef BB_BENCH_BARRIER_REAL_H
#define BB_BENCH_BARRIER_REAL_H

#include <jansson.h>
#include <stdio.h>

#include "hal/status.h"

#define BB_REAL_METHODS(X)                                                                                           \
	X(BB_REAL_NONE, "none", "nobody waits: what the pictures alone need")                                         \
	X(BB_REAL_SPIN, "spin", "a counter in shared memory; spins and yields")                                      \
	X(BB_REAL_FUTEX, "futex", "a counter and a futex; sleeps at once")                                           \
	X(BB_REAL_SPIN_FUTEX, "spin-futex", "spins 200 pauses, then sleeps on the futex")                            \
	X(BB_REAL_ADAPTIVE, "adaptive", "spins and yields while that pays; else sleeps on the futex")                     \
	X(BB_REAL_SHM, "shm link", "messages to rank 0 and back through drivers/link/shm.c, sealed")                 \
	X(BB_REAL_UDP, "udp", "datagrams over loopback to rank 0 and back")                                          \
	X(BB_REAL_ZMQ, "zmq link", "messages to rank 0 and back through drivers/link/zmq.c, sealed, CURVE")          \
	X(BB_REAL_MPI, "mpi", "MPI_Barrier, a program of its own")

enum bb_real_method {
#define X(id, name, what) id,
	BB_REAL_METHODS(X)
#undef X
	BB_REAL_METHOD_COUNT
};

enum bb_real_load { BB_REAL_IDLE, BB_REAL_BUSY, BB_REAL_DRAWING, BB_REAL_LOADS };

#define BB_REAL_SIZE_MOST 8
#define BB_REAL_SIZES_MOST 4

struct bb_real_row {
	enum bb_real_method method;
	enum bb_real_load load;
	unsigned n;
	uint64_t rounds;              /* 0: not measured, and why: */
	char skipped[80];
	double p50_us, p99_us, max_us; /* of a barrier, on rank 0 */
	double cpu_s;                 /* of all processes, for 10^4 barriers; drawing: pictures included */
	double frame_us, lost_us;     /* drawing: the frame in the middle; what of it the barrier took; "none": what others took */
};

struct bb_real_table {
	unsigned sizes[BB_REAL_SIZES_MOST]; /* 2 .. 8 */
	size_t n_sizes;
	double seconds;               /* each row */
	const char *mpi_program;      /* tests/bench/mpi_barrier.c as built; NULL: none */
	void (*progress)(const char *text); /* may be NULL */
	struct bb_real_row *rows;     /* calloc'ed by the run */
	size_t n_rows;
};

BB_MUST_CHECK enum bb_status bb_barrier_real(struct bb_real_table *t, struct bb_error *err);
void bb_barrier_real_release(struct bb_real_table *t);
const struct bb_real_row *bb_barrier_real_row(const struct bb_real_table *t, enum bb_real_method m, enum bb_real_load load,
                                              unsigned n);
/* The share of its cores that other programs had meanwhile, as far as the processes that wait for nobody noticed. */
double bb_barrier_real_disturbed(const struct bb_real_table *t);
void bb_barrier_real_print(const struct bb_real_table *t, FILE *out);
json_t *bb_barrier_real_json(const struct bb_real_table *t);
const char *bb_real_method_text(enum bb_real_method m);
const char *bb_real_load_text(enum bb_real_load l);

#endif
