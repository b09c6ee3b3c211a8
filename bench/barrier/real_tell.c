/* bench/barrier/real_tell.c: the table of real barriers as text and JSON, and what a user should conclude from it. */
#include "bench/barrier/real.h"

#include <string.h>

static const enum bb_real_method ours[] = { BB_REAL_SPIN, BB_REAL_FUTEX, BB_REAL_SPIN_FUTEX, BB_REAL_ADAPTIVE };

static void print_load(const struct bb_real_table *t, enum bb_real_load load, FILE *out)
{
	const bool drawing = load == BB_REAL_DRAWING;

	fprintf(out, "\n%s\n  %-11s %2s %9s %9s %9s %11s%s\n", bb_real_load_text(load), "barrier", "n", "p50 us", "p99 us", "max us",
	        "CPU s/10^4", drawing ? "  frame us   lost us" : "");
	for (size_t i = 0; i < t->n_rows; i++) {
		const struct bb_real_row *r = &t->rows[i];
		if (r->load != load)
			continue;
		fprintf(out, "  %-11s %2u ", bb_real_method_text(r->method), r->n);
		if (!r->rounds)
			fprintf(out, "SKIP: %s\n", r->skipped);
		else if (r->method == BB_REAL_NONE)
			fprintf(out, "%9s %9s %9s %11.3f %9.0f %9s\n", "-", "-", "-", r->cpu_s, r->frame_us, "-");
		else if (drawing)
			fprintf(out, "%9.1f %9.1f %9.1f %11.3f %9.0f %9.0f\n", r->p50_us, r->p99_us, r->max_us, r->cpu_s,
			        r->frame_us, r->lost_us);
		else
			fprintf(out, "%9.1f %9.1f %9.1f %11.3f\n", r->p50_us, r->p99_us, r->max_us, r->cpu_s);
	}
}

/* The barrier in shared memory that loses least of a frame, over all sizes together. */
static enum bb_real_method least_lost(const struct bb_real_table *t)
{
	enum bb_real_method best = BB_REAL_NONE;
	double least = 0;

	for (size_t m = 0; m < BB_ARRAY_LEN(ours); m++) {
		double sum = 0;
		for (size_t k = 0; k < t->n_sizes; k++) {
			const struct bb_real_row *r = bb_barrier_real_row(t, ours[m], BB_REAL_DRAWING, t->sizes[k]);
			sum += r && r->rounds ? r->lost_us : 1e9;
		}
		if (best == BB_REAL_NONE || sum < least) {
			best = ours[m];
			least = sum;
		}
	}
	return best;
}

double bb_barrier_real_disturbed(const struct bb_real_table *t)
{
	double share = 0;

	for (size_t k = 0; k < t->n_sizes; k++) {
		const struct bb_real_row *r = bb_barrier_real_row(t, BB_REAL_NONE, BB_REAL_DRAWING, t->sizes[k]);
		if (r && r->rounds)
			share += r->lost_us / (r->lost_us + r->frame_us) / (double)t->n_sizes;
	}
	return share;
}

static void conclude(const struct bb_real_table *t, FILE *out)
{
	const double disturbed = bb_barrier_real_disturbed(t);

	if (disturbed > 0.1)
		fprintf(out, "\nother programs had %.0f %% of the cores: read the middle, not the tail, and no frame\n", 100 * disturbed);
	fprintf(out, "\nthe barrier that loses least of a frame: %s\n", bb_real_method_text(least_lost(t)));
	for (size_t k = 0; k < t->n_sizes; k++) {
		const struct bb_real_row *mpi = bb_barrier_real_row(t, BB_REAL_MPI, BB_REAL_IDLE, t->sizes[k]);
		const struct bb_real_row *spin = bb_barrier_real_row(t, BB_REAL_SPIN, BB_REAL_IDLE, t->sizes[k]);
		const struct bb_real_row *usual = bb_barrier_real_row(t, BB_REAL_ADAPTIVE, BB_REAL_IDLE, t->sizes[k]);
		if (!mpi || !mpi->rounds || !spin || !spin->rounds || !usual || !usual->rounds)
			continue;
		fprintf(out, "%u processes, idle, p50 against MPI_Barrier's %.1f us: adaptive %.2f times, spin %.2f times\n",
		        t->sizes[k], mpi->p50_us, usual->p50_us / mpi->p50_us, spin->p50_us / mpi->p50_us);
	}
}

void bb_barrier_real_print(const struct bb_real_table *t, FILE *out)
{
	fprintf(out, "\nreal processes on this machine, %g s a row\n", t->seconds);
	for (int load = 0; load < BB_REAL_LOADS; load++)
		print_load(t, (enum bb_real_load)load, out);
	conclude(t, out);
}

json_t *bb_barrier_real_json(const struct bb_real_table *t)
{
	json_t *rows = json_array();

	for (size_t i = 0; i < t->n_rows; i++) {
		const struct bb_real_row *r = &t->rows[i];
		json_t *row = json_pack("{s:s, s:s, s:i}", "barrier", bb_real_method_text(r->method), "load",
		                        bb_real_load_text(r->load), "n", (int)r->n);
		if (!r->rounds) {
			json_object_set_new(row, "skipped", json_string(r->skipped));
			json_array_append_new(rows, row);
			continue;
		}
		json_object_set_new(row, "rounds", json_integer((json_int_t)r->rounds));
		json_object_set_new(row, "cpu_s_per_10000", json_real(r->cpu_s));
		if (r->method != BB_REAL_NONE) {
			json_object_set_new(row, "p50_us", json_real(r->p50_us));
			json_object_set_new(row, "p99_us", json_real(r->p99_us));
			json_object_set_new(row, "max_us", json_real(r->max_us));
		}
		if (r->load == BB_REAL_DRAWING) {
			json_object_set_new(row, "frame_us", json_real(r->frame_us));
			json_object_set_new(row, "lost_us", json_real(r->lost_us));
		}
		json_array_append_new(rows, row);
	}
	return json_pack("{s:f, s:f, s:s, s:o}", "disturbed", bb_barrier_real_disturbed(t), "seconds_a_row", t->seconds, "least_lost", bb_real_method_text(least_lost(t)), "rows",
	                 rows);
}
