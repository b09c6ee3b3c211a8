#include "render/bricks/errors.h"

#include <math.h>
#include <string.h>

#define WIDTH BB_ERRORS_WIDTH
#define BINS (BB_STATS_BINS + 1)
#define GROUP 4
#define ALIGNMENT 64

bool bb_errors_has(enum bb_errors_way way)
{
#ifdef __x86_64__
	if (way == BB_ERRORS_AVX512)
		return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
		       __builtin_cpu_supports("avx512vl");
	if (way == BB_ERRORS_AVX2)
		return __builtin_cpu_supports("avx2");
#endif
	return way == BB_ERRORS_PORTABLE;
}

enum bb_errors_way bb_errors_best(void)
{
	enum bb_errors_way way = BB_ERRORS_WAYS - 1;

	while (!bb_errors_has(way))
		way--;
	return way;
}

/* ---- memory ---- */

static size_t words_of_bins(const struct bb_errors_tree *t)
{
	return (size_t)t->n_times * BINS * t->n_groups * 2 * GROUP;
}

static bool may_run_over(const struct bb_errors_tree *t, uint64_t brick_voxels)
{
	return brick_voxels * (t->n_steps + 1) > BB_ERRORS_MOST;
}

/* The next n bytes of the memory; none of it: how many there must be. */
static void *piece(uint8_t *memory, size_t *used, size_t n)
{
	void *p = memory ? memory + *used : NULL;

	*used += (n + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
	return p;
}

static size_t lay_out(struct bb_errors *b, const struct bb_errors_tree *t, uint64_t brick_voxels, uint8_t *memory)
{
	const size_t times = t->n_times, eight = WIDTH * sizeof(int32_t);
	size_t used = memory ? -(uintptr_t)memory % ALIGNMENT : ALIGNMENT;

	b->bins = piece(memory, &used, words_of_bins(t) * sizeof(*b->bins));
	b->counts = piece(memory, &used, (size_t)t->n_steps * BINS * sizeof(*b->counts));
	b->sums = piece(memory, &used, times * BB_ERRORS_SUMS * WIDTH * sizeof(*b->sums));
	b->lanes = piece(memory, &used, t->n_steps * sizeof(*b->lanes));
	b->values = piece(memory, &used, times * 4 * eight);
	b->places = piece(memory, &used, times * 4 * eight);
	b->above = piece(memory, &used, times * eight);
	b->above_signs = piece(memory, &used, times * eight);
	b->own = piece(memory, &used, times * 2 * eight);
	b->signs = piece(memory, &used, times * t->n_groups * GROUP * eight);
	b->wide = NULL;
	if (may_run_over(t, brick_voxels))
		b->wide = piece(memory, &used, words_of_bins(t) * sizeof(*b->wide));
	return used;
}

size_t bb_errors_bytes(const struct bb_errors_tree *t, uint64_t brick_voxels)
{
	struct bb_errors b;

	return lay_out(&b, t, brick_voxels, NULL);
}

void bb_errors_init(struct bb_errors *b, const struct bb_errors_tree *t, uint64_t brick_voxels,
		    struct bb_bin_scale scale, double range, enum bb_errors_way way, void *memory)
{
	static const struct bb_errors_kernel *const kernels[BB_ERRORS_WAYS] = { &bb_errors_portable, &bb_errors_avx2,
										&bb_errors_avx512 };

	*b = (struct bb_errors){ .t = t, .kernel = kernels[way], .scale = scale, .floor = 1e-3 * range };
	(void)lay_out(b, t, brick_voxels, memory);
}

void bb_errors_clear(struct bb_errors *b)
{
	const struct bb_errors_tree *t = b->t;

	memset(b->bins, 0, words_of_bins(t) * sizeof(*b->bins));
	memset(b->counts, 0, (size_t)t->n_steps * BINS * sizeof(*b->counts));
	memset(b->sums, 0, (size_t)t->n_times * BB_ERRORS_SUMS * WIDTH * sizeof(*b->sums));
	memset(b->lanes, 0, t->n_steps * sizeof(*b->lanes));
	if (b->wide && b->n_waiting != b->n_added)
		memset(b->wide, 0, words_of_bins(t) * sizeof(*b->wide));
	b->n_waiting = b->n_added = 0;
}

/* ---- counting ---- */

/* n more voxels come: bins that could run over go to the wide ones before. */
static void make_room(struct bb_errors *b, uint64_t n)
{
	const uint64_t signs = n * (b->t->n_steps + 1);

	b->n_added += signs;
	b->n_waiting += signs;
	if (b->n_waiting <= BB_ERRORS_MOST)
		return;
	for (size_t i = 0; i < words_of_bins(b->t); i++) {
		b->wide[i] += b->bins[i];
		b->bins[i] = 0;
	}
	b->n_waiting = signs;
}

void bb_errors_add(struct bb_errors *b, const struct bb_errors_quad *q)
{
	for (uint32_t x = 0; x < q->n; x += WIDTH) {
		const uint32_t n = q->n - x < WIDTH ? q->n - x : WIDTH;
		make_room(b, q->n_rows * n);
		b->kernel->add(b, q, x, n);
	}
}

void bb_errors_sample(struct bb_errors *b, uint32_t n)
{
	make_room(b, n);
	b->kernel->sample(b, n);
}

/* ---- sums ---- */

static void take_lane(const struct bb_errors *b, uint32_t tau, uint32_t lane, struct bb_bin_sums *sums)
{
	const size_t per_bin = (size_t)b->t->n_groups * 2 * GROUP;
	const size_t from = tau * BINS * per_bin + lane / GROUP * 2 * GROUP + lane % GROUP;

	for (size_t i = 0; i < BINS; i++) {
		sums->at[i].below += b->bins[from + i * per_bin];
		sums->at[i].part += b->bins[from + i * per_bin + GROUP];
	}
	if (!b->wide)
		return;
	for (size_t i = 0; i < BINS; i++) {
		sums->at[i].below += b->wide[from + i * per_bin];
		sums->at[i].part += b->wide[from + i * per_bin + GROUP];
	}
}

void bb_errors_space(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums)
{
	take_lane(b, tau, 0, sums);
}

void bb_errors_time(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums)
{
	const uint32_t *child = b->t->span[tau].child;

	if (bb_tree_is_step(&b->t->span[tau]))
		return;
	for (int c = 0; c < 2; c++)
		take_lane(b, child[c], bb_tree_is_step(&b->t->span[child[c]]) ? 1 + b->t->depth[tau] : 1, sums);
	take_lane(b, tau, 2, sums);
}

void bb_errors_leaf(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums)
{
	if (bb_tree_is_step(&b->t->span[tau])) /* it is what it is compared with */
		return;
	for (uint32_t step = b->t->span[tau].from; step < b->t->span[tau].to; step++)
		take_lane(b, b->t->leaf[step], 1 + b->t->depth[tau], sums);
	take_lane(b, tau, 3, sums);
}

void bb_errors_sampled(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums)
{
	if (bb_tree_is_step(&b->t->span[tau]))
		take_lane(b, tau, 0, sums);
	else
		bb_errors_leaf(b, tau, sums);
}

double bb_errors_sum(const struct bb_errors *b, uint32_t tau, enum bb_errors_sum which)
{
	return bb_lanes_sum(b->sums + (tau * BB_ERRORS_SUMS + which) * WIDTH);
}
