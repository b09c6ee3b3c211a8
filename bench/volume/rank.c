#include "bench/volume/rank.h"

#include <math.h>
#include <stdlib.h>

struct ranked {
	float value;
	size_t index;
};

static int by_value(const void *a, const void *b)
{
	const struct ranked *x = a, *y = b;

	return (x->value > y->value) - (x->value < y->value);
}

static bool ranks(const float *v, size_t n, double *out)
{
	struct ranked *r = malloc((n ? n : 1) * sizeof(*r));

	if (!r)
		return false;
	for (size_t i = 0; i < n; i++)
		r[i] = (struct ranked){ v[i], i };
	qsort(r, n, sizeof(*r), by_value);
	for (size_t i = 0, k; i < n; i = k) {
		for (k = i + 1; k < n && !(r[k].value > r[i].value); k++)
			;
		for (size_t j = i; j < k; j++)
			out[r[j].index] = ((double)i + (double)k - 1) / 2;
	}
	free(r);
	return true;
}

enum bb_status bb_rank_correlation(const float *a, const float *b, size_t n, double *out, struct bb_error *err)
{
	double *x = malloc((n ? n : 1) * sizeof(*x)), *y = malloc((n ? n : 1) * sizeof(*y)), xy = 0, xx = 0, yy = 0;
	const bool ranked = x && y && ranks(a, n, x) && ranks(b, n, y);

	for (size_t i = 0; i < n && ranked; i++) {
		const double dx = x[i] - ((double)n - 1) / 2, dy = y[i] - ((double)n - 1) / 2;
		xy += dx * dy;
		xx += dx * dx;
		yy += dy * dy;
	}
	free(x);
	free(y);
	*out = xx > 0 && yy > 0 ? xy / sqrt(xx * yy) : !(xx > 0) && !(yy > 0);
	return ranked ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ranks of %zu bricks", n);
}
