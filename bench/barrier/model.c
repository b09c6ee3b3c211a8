#include "bench/barrier/model.h"

#include <math.h>

#define RADIX 2 /* of the tree */
#define HALVINGS 48
#define STEPS 400
#define FARTHEST 40 /* nothing of an exponential lies beyond */

/* Sum of k exponentials of mean 1. */
static double erlang_cdf(unsigned k, double x)
{
	double term = 1, sum = 0;

	if (x <= 0)
		return 0;
	for (unsigned i = 0; i < k; i++) {
		sum += term;
		term *= x / (i + 1);
	}
	return 1 - exp(-x) * sum;
}

static double hops_cdf(const struct bb_barrier_network *net, unsigned hops, double sends, double x)
{
	const double over = x - hops * net->delay_us - sends * net->send_us;

	return erlang_cdf(hops, over / fmax(net->jitter_us, 1e-6));
}

static unsigned tree_hops(unsigned rank, double *sends)
{
	unsigned hops = 0;

	for (*sends = 0; rank; rank = (rank - 1) / RADIX, hops++)
		*sends += (rank - 1) % RADIX + 1;
	return hops;
}

static double messages_cdf(enum bb_lock_method method, const struct bb_barrier_network *net, unsigned n, double x)
{
	double p = 1, sends;

	for (unsigned i = 1; i < n; i++) {
		const unsigned hops = method == BB_LOCK_CENTRAL ? 1
		                      : method == BB_LOCK_TREE  ? tree_hops(i, &sends)
		                                                : (unsigned)__builtin_popcount(i);
		if (method != BB_LOCK_TREE)
			sends = method == BB_LOCK_CENTRAL ? i : hops;
		p *= hops_cdf(net, hops, sends, x);
	}
	return p;
}

static double laplace_cdf(double x)
{
	return x < 0 ? exp(x) / 2 : 1 - exp(-x) / 2;
}

/* All of n - 1 clock errors and the master's, which is 0, within x of each other: by where the least of them lies. */
static double clocks_cdf(const struct bb_barrier_network *net, unsigned n, double x_us)
{
	const double x = x_us * net->window / fmax(net->jitter_us, 1e-6), m = n - 1;
	const double reach = fmin(x, FARTHEST);
	double sum = pow(laplace_cdf(x) - 0.5, m);

	for (int i = 0; i < STEPS; i++) {
		const double a = -reach * (i + 0.5) / STEPS;
		sum += m * exp(a) / 2 * pow(laplace_cdf(a + x) - laplace_cdf(a), m - 1) * reach / STEPS;
	}
	return sum;
}

double bb_barrier_skew_us(enum bb_lock_method method, const struct bb_barrier_network *net, unsigned n, double p)
{
	double low = 0, high = 1e7;

	if (n < 2)
		return 0;
	for (int k = 0; k < HALVINGS; k++) {
		const double middle = (low + high) / 2;
		const double cdf = method == BB_LOCK_TIMED ? clocks_cdf(net, n, middle) : messages_cdf(method, net, n, middle);
		if (cdf < p)
			low = middle;
		else
			high = middle;
	}
	return high;
}

double bb_barrier_cost_us(enum bb_lock_method method, const struct bb_barrier_network *net, unsigned n)
{
	const double skew_us = bb_barrier_skew_us(method, net, n, 0.5), hop_us = net->delay_us + net->jitter_us + net->send_us;
	double hops = 0, sends;

	if (method == BB_LOCK_CENTRAL)
		hops = (n - 1.0) / n; /* the root itself may be the last */
	for (unsigned i = 1; i < n && method == BB_LOCK_TREE; i++)
		hops += tree_hops(i, &sends) / (double)n;
	return hops * hop_us + skew_us;
}

double bb_barrier_messages(enum bb_lock_method method, unsigned n)
{
	const double others = n - 1.0;

	if (method == BB_LOCK_DISSEMINATION)
		return n * ceil(log2(n));
	return method == BB_LOCK_TIMED ? 3 * others : 2 * others;
}
