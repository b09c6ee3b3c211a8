/*
 * tests/bench/mpi_barrier.c SECONDS: MPI_Barrier back to back, as a peer of bench/barrier/real.c: prints rounds, p50, p99 and
 * max in us as rank 0 saw them, and CPU seconds of all ranks for 10^4 barriers. Run by mpirun; built where mpicc is.
 */
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>

#define MOST 2000000

static int ascending(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

static double cpu_s(void)
{
	struct rusage r;

	getrusage(RUSAGE_SELF, &r);
	return (double)(r.ru_utime.tv_sec + r.ru_stime.tv_sec) + 1e-6 * (double)(r.ru_utime.tv_usec + r.ru_stime.tv_usec);
}

int main(int argc, char **argv)
{
	const double seconds = argc > 1 ? strtod(argv[1], NULL) : 1;
	double *took_us = malloc(MOST * sizeof(*took_us)), all = 0;
	int rank, n = 0, go = 1;

	MPI_Init(&argc, &argv);
	MPI_Comm_rank(MPI_COMM_WORLD, &rank);
	if (!took_us)
		MPI_Abort(MPI_COMM_WORLD, 1);
	for (int i = 0; i < 100; i++)
		MPI_Barrier(MPI_COMM_WORLD);
	const double cpu_before_s = cpu_s(), start_s = MPI_Wtime();
	while (go && n < MOST) { /* rank 0 says when to stop, between hundreds so that saying it costs nothing */
		for (int i = 0; i < 100 && n < MOST; i++) {
			const double before_s = MPI_Wtime();
			MPI_Barrier(MPI_COMM_WORLD);
			took_us[n++] = (MPI_Wtime() - before_s) * 1e6;
		}
		go = MPI_Wtime() - start_s < seconds;
		MPI_Bcast(&go, 1, MPI_INT, 0, MPI_COMM_WORLD);
	}
	const double own = cpu_s() - cpu_before_s;
	MPI_Reduce(&own, &all, 1, MPI_DOUBLE, MPI_SUM, 0, MPI_COMM_WORLD);
	qsort(took_us, (size_t)n, sizeof(*took_us), ascending);
	if (!rank)
		printf("%d %.3f %.3f %.3f %.6f\n", n, took_us[n / 2], took_us[(size_t)n * 99 / 100], took_us[n - 1], all * 1e4 / n);
	free(took_us);
	MPI_Finalize();
	return 0;
}
