#include "hal/rate.h"

#include <math.h>

struct bb_rate bb_rate_from_hz(double hz)
{
	struct bb_rate best = { 0, 0 };
	double best_error = 1e-7;
	static const uint32_t dens[] = { 1, 1001, 1000, 100, 10 };

	if (!(hz > 0 && hz <= 1e6))
		return best;
	for (size_t i = 0; i < BB_ARRAY_LEN(dens); i++) {
		const double num = round(hz * dens[i]);
		const double error = fabs(num / dens[i] - hz) / hz;
		if (num >= 1 && num <= 4e9 && error < best_error) {
			best = (struct bb_rate){ (uint32_t)num, dens[i] };
			best_error = error;
		}
	}
	if (!best.num) /* not a customary rate: thousandths are as exact as a key in a file */
		best = (struct bb_rate){ (uint32_t)fmax(1, round(hz * 1000)), 1000 };
	return best;
}
