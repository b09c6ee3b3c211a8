/* bench/barrier/real.c: starts the processes of a row, lets them wait for each other, gathers what it took. */
#define _GNU_SOURCE
#include "bench/barrier/real_impl.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bench/stats.h"

#define PICTURE_PX 24      /* a fraction of a millisecond */
#define BURN_PX 256
#define BURNERS_MOST 64
#define WARM_ROUNDS 20
#define HANG_S 20          /* beyond its time a row that does not end is a row that hangs */

const char *bb_real_method_text(enum bb_real_method m)
{
	static const char *const text[] = {
#define X(id, name, what) name,
		BB_REAL_METHODS(X)
#undef X
	};

	return text[m];
}

const char *bb_real_load_text(enum bb_real_load l)
{
	static const char *const text[] = { "idle", "busy", "drawing" };

	return text[l];
}

/* ---- one process of a row ---- */

static bool wait_for_all(struct real_place *p)
{
	if (p->method == BB_REAL_NONE)
		return true;
	return p->method <= BB_REAL_ADAPTIVE ? real_memory_wait(p) : real_net_wait(p);
}

static double cpu_s(void)
{
	struct rusage r;

	getrusage(RUSAGE_SELF, &r);
	return (double)(r.ru_utime.tv_sec + r.ru_stime.tv_sec) + 1e-6 * (double)(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
}

/* All are set up, rank 0 first: the others need its address. */
static bool set_up(struct real_place *p)
{
	struct real_shared *s = p->shared;

	while (p->rank && !atomic_load(&s->here) && !atomic_load(&s->failed))
		sched_yield();
	if (p->method > BB_REAL_ADAPTIVE && !real_net_begin(p))
		return false;
	atomic_fetch_add(&s->here, 1);
	while (atomic_load(&s->here) < p->n && !atomic_load(&s->failed)) {
		if (p->link)
			bb_clock_run_until(p->clk, bb_clock_now_ns(p->clk) + BB_NS_PER_S / 1000);
		sched_yield();
	}
	return !atomic_load(&s->failed);
}

static bool rounds(struct real_place *p, const struct bb_real_table *t, struct real_easel *easel)
{
	struct real_shared *s = p->shared;
	double cpu_before_s = 0;
	int64_t start_ns = 0, frame_ns = bb_clock_stopwatch_ns();

	for (uint64_t round = 0;; round++) {
		if (round == WARM_ROUNDS) {
			cpu_before_s = cpu_s();
			start_ns = bb_clock_stopwatch_ns();
		}
		if (easel)
			real_easel_draw(easel);
		const int64_t before_ns = bb_clock_stopwatch_ns();
		/* Rank 0 names the last round before it arrives at it, so all see it in time. */
		if (!p->rank && round > WARM_ROUNDS && (double)(before_ns - start_ns) * 1e-9 > t->seconds)
			atomic_store(&s->last_round, round);
		if (!wait_for_all(p))
			return false;
		const int64_t after_ns = bb_clock_stopwatch_ns();
		if (!p->rank && round >= WARM_ROUNDS && round - WARM_ROUNDS < REAL_ROUNDS_MOST) {
			s->took_us[round - WARM_ROUNDS] = (float)((double)(after_ns - before_ns) * 1e-3);
			s->frame_us[round - WARM_ROUNDS] = (float)((double)(after_ns - frame_ns) * 1e-3);
		}
		frame_ns = after_ns;
		if (!p->rank && round == WARM_ROUNDS + REAL_ROUNDS_MOST - 2)
			atomic_store(&s->last_round, round + 1);
		if (round < atomic_load(&s->last_round))
			continue;
		if (!p->rank) {
			s->rounds = round - WARM_ROUNDS + 1;
			s->elapsed_s = (double)(after_ns - start_ns) * 1e-9;
		}
		s->cpu_s[p->rank] = cpu_s() - cpu_before_s;
		return true;
	}
}

static int play(struct real_place *p, const struct bb_real_table *t, struct real_easel *easel)
{
	real_memory_begin(p);
	p->socket = -1;
	const bool well = (!easel || real_easel_take(easel, PICTURE_PX)) && set_up(p) && rounds(p, t, easel);
	if (!well)
		atomic_store(&p->shared->failed, 1);
	real_net_end(p);
	return well ? 0 : 1;
}

/* ---- processes ---- */

/* 0 in the child, which the kernel ends with its parent. */
static pid_t start(pid_t parent)
{
	const pid_t pid = fork();

	if (!pid && (prctl(PR_SET_PDEATHSIG, SIGKILL) || getppid() != parent))
		_exit(1);
	return pid;
}

static size_t start_burners(struct real_easel *easel, pid_t *burner)
{
	const long cores = sysconf(_SC_NPROCESSORS_ONLN);
	const pid_t parent = getpid();
	size_t n = 0;

	for (long i = 0; i < cores && n < BURNERS_MOST; i++) {
		burner[n] = start(parent);
		if (!burner[n]) {
			if (real_easel_take(easel, BURN_PX))
				for (;;)
					real_easel_draw(easel);
			_exit(1);
		}
		n += burner[n] > 0;
	}
	return n;
}

static void end_all(const pid_t *pid, size_t n)
{
	for (size_t i = 0; i < n; i++)
		kill(pid[i], SIGKILL);
	for (size_t i = 0; i < n; i++)
		waitpid(pid[i], NULL, 0);
}

/* Until all have ended well; one that fails or hangs ends the others. */
static bool wait_for_end(const pid_t *pid, size_t n, double most_s)
{
	const int64_t end_ns = bb_clock_stopwatch_ns() + (int64_t)(most_s * 1e9);
	bool ended[BB_REAL_SIZE_MOST] = { false };
	struct bb_clock *clk;
	size_t left = n;
	bool well = bb_clock_posix_create(&clk) == BB_OK;

	while (well && left) {
		for (size_t i = 0; i < n; i++) {
			int status = 0;
			if (ended[i] || waitpid(pid[i], &status, WNOHANG) != pid[i])
				continue;
			ended[i] = true;
			left--;
			well &= WIFEXITED(status) && !WEXITSTATUS(status);
		}
		well &= bb_clock_stopwatch_ns() < end_ns;
		if (left)
			bb_clock_run_until(clk, bb_clock_now_ns(clk) + BB_NS_PER_S / 200);
	}
	for (size_t i = 0; i < n; i++)
		if (!ended[i])
			end_all(&pid[i], 1);
	bb_clock_destroy(clk);
	return well;
}

static bool play_all(const struct bb_real_table *t, const struct bb_real_row *row, struct real_shared *s,
                     struct real_easel *easel)
{
	const pid_t parent = getpid();
	pid_t pid[BB_REAL_SIZE_MOST];

	for (unsigned i = 0; i < row->n; i++) {
		pid[i] = start(parent);
		if (!pid[i]) {
			struct real_place p = { .shared = s, .rank = i, .n = row->n, .method = row->method };
			_exit(play(&p, t, row->load == BB_REAL_DRAWING ? easel : NULL));
		}
		if (pid[i] < 0) {
			end_all(pid, i);
			return false;
		}
	}
	return wait_for_end(pid, row->n, t->seconds + HANG_S);
}

static void gather(struct bb_real_row *row, const struct real_shared *s)
{
	const double cores = (double)sysconf(_SC_NPROCESSORS_ONLN);
	double *took_us = calloc(s->rounds + 1, sizeof(*took_us)), cpu = 0;

	if (!took_us || !s->rounds) {
		free(took_us);
		return;
	}
	for (uint64_t i = 0; i < s->rounds; i++)
		took_us[i] = (double)s->took_us[i];
	bb_stats_sort(took_us, s->rounds);
	for (unsigned i = 0; i < row->n; i++)
		cpu += s->cpu_s[i];
	row->rounds = s->rounds;
	row->p50_us = bb_stats_nearest_rank(took_us, s->rounds, 0.5);
	row->p99_us = bb_stats_nearest_rank(took_us, s->rounds, 0.99);
	row->max_us = took_us[s->rounds - 1];
	row->cpu_s = cpu * 1e4 / (double)s->rounds;
	for (uint64_t i = 0; i < s->rounds; i++)
		took_us[i] = (double)s->frame_us[i];
	bb_stats_sort(took_us, s->rounds);
	row->frame_us = row->load == BB_REAL_DRAWING ? bb_stats_nearest_rank(took_us, s->rounds, 0.5) : 0;
	if (row->method == BB_REAL_NONE) { /* what the cores could do: its own picture's time, shared by as many as there are */
		row->frame_us = s->cpu_s[0] * 1e6 / (double)s->rounds * fmax(1, row->n / cores);
		row->lost_us = fmax(0, s->elapsed_s * 1e6 / (double)s->rounds - row->frame_us);
	}
	free(took_us);
}

static void run_ours(const struct bb_real_table *t, struct bb_real_row *row, struct real_easel *easel)
{
	struct real_shared *s = mmap(NULL, sizeof(*s), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);

	if (s == MAP_FAILED || !bb_random_secret(s->secret, sizeof(s->secret))) {
		snprintf(row->skipped, sizeof(row->skipped), "no shared memory: %s", strerror(errno));
		return;
	}
	atomic_store(&s->last_round, UINT64_MAX);
	if (play_all(t, row, s, easel))
		gather(row, s);
	if (!row->rounds)
		snprintf(row->skipped, sizeof(row->skipped), "a process of it failed or hung");
	munmap(s, sizeof(*s));
}

/* ---- the peer ---- */

/* In the child: mpirun, and a limit on its time that survives exec. */
static void become_mpirun(const struct bb_real_table *t, unsigned n, int out)
{
	char count[16], seconds[32];
	const int nowhere = open("/dev/null", O_RDWR);

	snprintf(count, sizeof(count), "%u", n);
	snprintf(seconds, sizeof(seconds), "%.3f", t->seconds);
	if (nowhere < 0 || dup2(nowhere, 0) < 0 || dup2(out, 1) < 0 || dup2(nowhere, 2) < 0)
		_exit(127);
	alarm((unsigned)t->seconds + HANG_S);
	execlp("mpirun", "mpirun", "--allow-run-as-root", "--oversubscribe", "--mca", "btl", "vader,self", "-n", count,
	       t->mpi_program, seconds, (char *)NULL);
	_exit(127);
}

static void run_mpi(const struct bb_real_table *t, struct bb_real_row *row)
{
	char text[256];
	int pipe_fd[2], status = -1;
	ssize_t n;
	size_t has = 0;

	if (!t->mpi_program || access(t->mpi_program, X_OK)) {
		snprintf(row->skipped, sizeof(row->skipped), "%s", t->mpi_program ? "its program is not built: no mpicc?" :
		                                                                   "no program named with --mpi");
		return;
	}
	if (pipe2(pipe_fd, O_CLOEXEC)) {
		snprintf(row->skipped, sizeof(row->skipped), "no pipe");
		return;
	}
	const pid_t pid = start(getpid());
	if (!pid)
		become_mpirun(t, row->n, pipe_fd[1]);
	close(pipe_fd[1]);
	while (has < sizeof(text) - 1 && (n = read(pipe_fd[0], text + has, sizeof(text) - 1 - has)) > 0)
		has += (size_t)n;
	close(pipe_fd[0]);
	text[has] = '\0';
	if (pid > 0)
		waitpid(pid, &status, 0);
	double told[5] = { 0 }; /* rounds, p50, p99, max, CPU */
	char *end = text;
	for (size_t i = 0; i < BB_ARRAY_LEN(told); i++)
		told[i] = strtod(end, &end);
	if (status || !(told[0] >= 1)) {
		snprintf(row->skipped, sizeof(row->skipped), "mpirun failed or is not there");
		return;
	}
	row->rounds = (uint64_t)told[0];
	row->p50_us = told[1];
	row->p99_us = told[2];
	row->max_us = told[3];
	row->cpu_s = told[4];
}

/* ---- the table ---- */

static const struct bb_real_row *find(const struct bb_real_table *t, enum bb_real_method m, enum bb_real_load load, unsigned n)
{
	for (size_t i = 0; i < t->n_rows; i++)
		if (t->rows[i].method == m && t->rows[i].load == load && t->rows[i].n == n)
			return &t->rows[i];
	return NULL;
}

const struct bb_real_row *bb_barrier_real_row(const struct bb_real_table *t, enum bb_real_method m, enum bb_real_load load,
                                              unsigned n)
{
	return find(t, m, load, n);
}

/* None waits for nobody, so only its frames say something; the peer draws nothing. */
static bool makes_sense(enum bb_real_method m, enum bb_real_load load)
{
	return load == BB_REAL_DRAWING ? m != BB_REAL_MPI : m != BB_REAL_NONE;
}

static void run_row(struct bb_real_table *t, struct bb_real_row *row, struct real_easel *easel)
{
	pid_t burner[BURNERS_MOST];
	const size_t n_burners = row->load == BB_REAL_BUSY ? start_burners(easel, burner) : 0;
	char text[80];

	snprintf(text, sizeof(text), "%s, %u processes, %s", bb_real_method_text(row->method), row->n,
	         bb_real_load_text(row->load));
	if (t->progress)
		t->progress(text);
	if (row->method == BB_REAL_MPI)
		run_mpi(t, row);
	else
		run_ours(t, row, easel);
	end_all(burner, n_burners);
	const struct bb_real_row *alone = find(t, BB_REAL_NONE, BB_REAL_DRAWING, row->n);
	if (row->load == BB_REAL_DRAWING && row->method != BB_REAL_NONE && row->rounds && alone)
		row->lost_us = row->frame_us - alone->frame_us;
}

enum bb_status bb_barrier_real(struct bb_real_table *t, struct bb_error *err)
{
	struct real_easel *easel = NULL;

	t->rows = calloc((size_t)BB_REAL_METHOD_COUNT * BB_REAL_LOADS * t->n_sizes, sizeof(*t->rows));
	if (!t->rows)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the table");
	fflush(NULL); /* what is buffered must not be written by every child */
	const enum bb_status status = real_easel_create(&easel, err);
	for (int load = 0; status == BB_OK && load < BB_REAL_LOADS; load++)
		for (size_t k = 0; k < t->n_sizes; k++)
			for (int m = 0; m < BB_REAL_METHOD_COUNT; m++) {
				if (!makes_sense((enum bb_real_method)m, (enum bb_real_load)load))
					continue;
				struct bb_real_row *row = &t->rows[t->n_rows++];
				*row = (struct bb_real_row){ .method = (enum bb_real_method)m, .load = (enum bb_real_load)load,
					                     .n = t->sizes[k] };
				run_row(t, row, easel);
			}
	real_easel_destroy(easel);
	return status;
}

void bb_barrier_real_release(struct bb_real_table *t)
{
	free(t->rows);
	t->rows = NULL;
	t->n_rows = 0;
}
