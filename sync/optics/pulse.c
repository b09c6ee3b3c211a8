/*
 * sync/optics/pulse.c: Levenberg and Marquardt on six numbers: base, height, rise, fall, and the logarithms of the two
 * time constants. First on few wide bins from three guesses, then on all of them from the best.
 */
#include "sync/optics/pulse.h"

#include <math.h>
#include <string.h>

#define WIDE 512             /* bins of the first look */
#define N 6
#define ROUNDS 40
#define LN_SIGMA 4.0         /* what is thought of a time constant beforehand: next to nothing */
#define LEAST_TAU_NS 300.0
#define GAUSS 3

enum { BASE, HEIGHT, RISE, FALL, LN_RISE, LN_FALL };

struct bins { /* what is fitted: means, places, weights */
	size_t n;
	double y[8192], at[8192], w[8192];
};

struct shape { /* the steady state between the drives */
	double cycle, rise, on;      /* ns; on: from rise to fall */
	double tr, tf, tl;           /* time constants; tl 0: no sensor */
	double x0, x1, kr, kf, cr, cf;
};

static double wrap(double v, double cycle)
{
	v = fmod(v, cycle);
	return v < 0 ? v + cycle : v;
}

/* Two equal exponentials have no partial fractions; a little apart they have. */
static double apart(double tau, double from)
{
	return fabs(tau - from) < 1e-3 * from ? from * 1.001 : tau;
}

static struct shape shape_of(const double *v, const struct bb_pulse_task *t)
{
	struct shape s = { .cycle = t->cycle_ns, .rise = v[RISE], .on = wrap(v[FALL] - v[RISE], t->cycle_ns),
		           .tr = fmax(exp(v[LN_RISE]), LEAST_TAU_NS), .tf = fmax(exp(v[LN_FALL]), LEAST_TAU_NS),
		           .tl = t->sensor_tau_ns };
	const double off = s.cycle - s.on;

	if (s.tl > 0) {
		s.tr = apart(s.tr, s.tl);
		s.tf = apart(s.tf, s.tl);
	}
	const double er = exp(-s.on / s.tr), ef = exp(-off / s.tf);
	s.x1 = (1 - er) / (1 - er * ef);
	s.x0 = s.x1 * ef;
	if (!(s.tl > 0))
		return s;
	/* z' = (x - z) / tl along both stretches; z repeats. */
	const double lr = exp(-s.on / s.tl), lf = exp(-off / s.tl);
	s.kr = s.tr / (s.tr - s.tl);
	s.kf = s.tf / (s.tf - s.tl);
	const double end_r = 1 - (1 - s.x0) * s.kr * er + ((1 - s.x0) * s.kr - 1) * lr; /* z1 = end_r + z0 lr */
	const double end_f = s.x1 * s.kf * ef - s.x1 * s.kf * lf;                       /* z0 = end_f + z1 lf */
	const double z0 = (end_f + end_r * lf) / (1 - lr * lf), z1 = end_r + z0 * lr;
	s.cr = z0 - 1 + (1 - s.x0) * s.kr;
	s.cf = z1 - s.x1 * s.kf;
	return s;
}

static double light_at(const struct shape *s, double phase)
{
	const double t = wrap(phase - s->rise, s->cycle);

	if (t < s->on) {
		const double e = (1 - s->x0) * exp(-t / s->tr);
		return s->tl > 0 ? 1 - e * s->kr + s->cr * exp(-t / s->tl) : 1 - e;
	}
	const double u = t - s->on, e = s->x1 * exp(-u / s->tf);
	return s->tl > 0 ? e * s->kf + s->cf * exp(-u / s->tl) : e;
}

static double exposed_at(const struct shape *s, double phase, double aperture)
{
	static const double place[GAUSS] = { -0.7745966692414834, 0, 0.7745966692414834 };
	static const double weight[GAUSS] = { 5.0 / 18, 8.0 / 18, 5.0 / 18 };
	double sum = 0;

	if (!(aperture > 0))
		return light_at(s, phase);
	for (int part = 0; part < 4; part++)
		for (int i = 0; i < GAUSS; i++)
			sum += weight[i] / 4 * light_at(s, phase + aperture * ((part - 1.5 + place[i] / 2) / 4));
	return sum;
}

/* Solves a x = b for symmetric positive a, which becomes its inverse. False when it is singular. */
static bool invert(double a[N][N])
{
	for (int i = 0; i < N; i++) {
		const double pivot = a[i][i];
		if (!(fabs(pivot) > 1e-300))
			return false;
		a[i][i] = 1;
		for (int j = 0; j < N; j++)
			a[i][j] /= pivot;
		for (int k = 0; k < N; k++) {
			if (k == i)
				continue;
			const double f = a[k][i];
			a[k][i] = 0;
			for (int j = 0; j < N; j++)
				a[k][j] -= f * a[i][j];
		}
	}
	return true;
}

static double misfit(const struct bins *b, const double *v, const struct bb_pulse_task *t)
{
	const struct shape s = shape_of(v, t);
	double sum = 0;

	for (size_t i = 0; i < b->n; i++) {
		const double r = b->y[i] - v[BASE] - v[HEIGHT] * exposed_at(&s, b->at[i], t->aperture_ns);
		sum += b->w[i] * r * r;
	}
	return sum;
}

/* Normal equations, with what is known beforehand of the time constants as two more observations. */
static void equations(const struct bins *b, const double *v, const struct bb_pulse_task *t, double variance,
                      const double *prior, double a[N][N], double g[N])
{
	static const double step[N] = { 0, 0, 40, 40, 1e-3, 1e-3 };
	struct shape plus[N], minus[N];
	const struct shape s = shape_of(v, t);

	memset(a, 0, sizeof(double[N][N]));
	memset(g, 0, sizeof(double[N]));
	for (int k = RISE; k < N; k++) {
		double u[N];
		memcpy(u, v, sizeof(u));
		u[k] = v[k] + step[k];
		plus[k] = shape_of(u, t);
		u[k] = v[k] - step[k];
		minus[k] = shape_of(u, t);
	}
	for (size_t i = 0; i < b->n; i++) {
		const double m = exposed_at(&s, b->at[i], t->aperture_ns), r = b->y[i] - v[BASE] - v[HEIGHT] * m;
		double d[N] = { 1, m };
		for (int k = RISE; k < N; k++)
			d[k] = v[HEIGHT] *
			       (exposed_at(&plus[k], b->at[i], t->aperture_ns) - exposed_at(&minus[k], b->at[i], t->aperture_ns)) /
			       (2 * step[k]);
		for (int j = 0; j < N; j++) {
			for (int k = 0; k <= j; k++)
				a[j][k] += b->w[i] * d[j] * d[k];
			g[j] += b->w[i] * d[j] * r;
		}
	}
	for (int k = LN_RISE; k < N; k++) {
		a[k][k] += variance / (LN_SIGMA * LN_SIGMA);
		g[k] += variance / (LN_SIGMA * LN_SIGMA) * (prior[k] - v[k]);
	}
	for (int j = 0; j < N; j++)
		for (int k = j + 1; k < N; k++)
			a[j][k] = a[k][j];
}

static bool damped_step(const double a[N][N], const double *g, double damping, double *v)
{
	double m[N][N];

	memcpy(m, a, sizeof(m));
	for (int i = 0; i < N; i++)
		m[i][i] *= 1 + damping;
	if (!invert(m))
		return false;
	for (int i = 0; i < N; i++)
		for (int k = 0; k < N; k++)
			v[i] += m[i][k] * g[k];
	for (int i = 0; i < N; i++)
		if (!isfinite(v[i]))
			return false;
	return v[LN_RISE] < 30 && v[LN_FALL] < 30 && v[LN_RISE] > 0 && v[LN_FALL] > 0;
}

/* Returns the sum of squares; v is improved in place. */
static double improve(const struct bins *b, const struct bb_pulse_task *t, double *v, int rounds)
{
	double prior[N], best = misfit(b, v, t), damping = 1e-3;

	memcpy(prior, v, sizeof(prior));
	for (int round = 0; round < rounds; round++) {
		double a[N][N], g[N];
		bool better = false;
		const double before = best;
		equations(b, v, t, best / (double)b->n, prior, a, g);
		for (int tries = 0; tries < 8 && !better; tries++) {
			double u[N];
			memcpy(u, v, sizeof(u));
			const double now = damped_step(a, g, damping, u) ? misfit(b, u, t) : (double)INFINITY;
			better = now < best;
			damping = better ? fmax(damping / 8, 1e-9) : damping * 6;
			if (better) {
				memcpy(v, u, sizeof(u));
				best = now;
			}
		}
		if (!better || before - best < 1e-7 * before)
			break;
	}
	return best;
}

/* ---- where to begin ---- */

/* Bins that hold nothing are left out; wide joins that many of the fold's. */
static void gather(const struct bb_pulse_task *t, size_t n_out, struct bins *b)
{
	const double bin_ns = t->cycle_ns / (double)t->n_bins;

	b->n = 0;
	for (size_t o = 0; o < n_out; o++) {
		double y = 0, at = 0, w = 0;
		for (size_t i = o * t->n_bins / n_out; i < (o + 1) * t->n_bins / n_out; i++) {
			y += t->fold[i].sum;
			at += t->fold[i].phase_sum + (double)i * bin_ns * t->fold[i].n;
			w += t->fold[i].n;
		}
		if (!(w > 0))
			continue;
		b->y[b->n] = y / w;
		b->at[b->n] = at / w;
		b->w[b->n++] = w;
	}
}

/* Circular search from bin i on for the first that is (or is not) above a level: the number of bins to it. */
static size_t until(const struct bins *b, size_t from, double level, bool above)
{
	for (size_t i = 0; i < b->n; i++)
		if ((b->y[(from + i) % b->n] > level) == above)
			return i;
	return b->n;
}

static bool guess(const struct bins *b, double cycle, double *v)
{
	double low = (double)INFINITY, high = -(double)INFINITY, smooth[WIDE];
	struct bins s = { .n = b->n };

	if (b->n < 8 || b->n > WIDE)
		return false;
	for (size_t i = 0; i < b->n; i++) { /* a median of three, against single spikes */
		const double p = b->y[(i + b->n - 1) % b->n], q = b->y[i], r = b->y[(i + 1) % b->n];
		smooth[i] = fmax(fmin(p, q), fmin(fmax(p, q), r));
		low = fmin(low, smooth[i]);
		high = fmax(high, smooth[i]);
	}
	if (!(high > low))
		return false;
	memcpy(s.y, smooth, b->n * sizeof(double));
	/* The longest stretch above the middle is the pulse. */
	const double middle = (low + high) / 2;
	size_t start = 0, longest = 0;
	for (size_t i = 0; i < b->n; i++) {
		if (!(smooth[i] > middle) || smooth[(i + b->n - 1) % b->n] > middle)
			continue;
		const size_t length = until(&s, i, middle, false);
		if (length > longest) {
			longest = length;
			start = i;
		}
	}
	if (!longest || longest == b->n)
		return false;
	const size_t end = (start + longest) % b->n;
	const double tenth = low + 0.1 * (high - low), most = low + 0.9 * (high - low);
	size_t back = 0, forth = until(&s, start, most, true);
	while (back < b->n && smooth[(start + b->n - back) % b->n] > tenth)
		back++;
	const double step = cycle / (double)b->n;
	const double rise = fmin((double)(back + (forth < longest ? forth : longest)), (double)b->n / 4) * step / 2.2;
	const double fall = fmin((double)until(&s, end, tenth, false) + 1, (double)b->n / 4) * step / 2.2;
	v[BASE] = low;
	v[HEIGHT] = high - low;
	v[LN_RISE] = log(fmax(rise, LEAST_TAU_NS * 4));
	v[LN_FALL] = log(fmax(fall, LEAST_TAU_NS * 4));
	v[RISE] = b->at[start] - 0.7 * rise;
	v[FALL] = b->at[end] - 0.7 * fall;
	return true;
}

/* ---- the whole ---- */

static struct bb_estimate estimate(double value, double variance)
{
	return (struct bb_estimate){ value, sqrt(fmax(variance, 0)) };
}

static struct bb_pulse result(const struct bins *b, const struct bb_pulse_task *t, const double *v, double sum)
{
	struct bb_pulse p = { .found = false };
	double a[N][N], g[N], samples = 0;
	const double variance = sum / (double)(b->n > N ? b->n - N : 1);

	equations(b, v, t, variance, v, a, g);
	if (!invert(a))
		return p;
	for (size_t i = 0; i < b->n; i++)
		samples += b->w[i];
	/* An edge between two samples is anywhere between them. */
	const double grain = t->cycle_ns / samples;
	const double tr = exp(v[LN_RISE]), tf = exp(v[LN_FALL]);
	p.base = estimate(v[BASE], variance * a[BASE][BASE]);
	p.height = estimate(v[HEIGHT], variance * a[HEIGHT][HEIGHT]);
	p.rise_ns = estimate(wrap(v[RISE], t->cycle_ns), variance * a[RISE][RISE] + grain * grain / 12);
	p.fall_ns = estimate(wrap(v[FALL], t->cycle_ns), variance * a[FALL][FALL] + grain * grain / 12);
	p.rise_tau_ns = estimate(tr, variance * a[LN_RISE][LN_RISE] * tr * tr);
	p.fall_tau_ns = estimate(tf, variance * a[LN_FALL][LN_FALL] * tf * tf);
	p.rms = sqrt(variance);
	p.found = v[HEIGHT] > 5 * p.height.sigma && v[HEIGHT] > 0 && p.rise_ns.sigma < t->cycle_ns / 20 &&
	          p.fall_ns.sigma < t->cycle_ns / 20;
	return p;
}

struct bb_pulse bb_pulse_fit(const struct bb_pulse_task *t)
{
	static const double factor[] = { 1, 0.1, 5 };
	struct bins b;
	double first[N], best_v[N], best = (double)INFINITY;

	if (t->n_bins > BB_ARRAY_LEN(b.y))
		return (struct bb_pulse){ .found = false };
	gather(t, t->n_bins < WIDE ? t->n_bins : WIDE, &b);
	if (!guess(&b, t->cycle_ns, first))
		return (struct bb_pulse){ .found = false };
	for (size_t i = 0; i < BB_ARRAY_LEN(factor); i++) {
		double v[N];
		memcpy(v, first, sizeof(v));
		v[LN_RISE] += log(factor[i]);
		v[LN_FALL] += log(factor[i]);
		const double sum = improve(&b, t, v, ROUNDS);
		if (sum < best) {
			best = sum;
			memcpy(best_v, v, sizeof(v));
		}
	}
	if (!isfinite(best))
		return (struct bb_pulse){ .found = false };
	gather(t, t->n_bins, &b);
	best = improve(&b, t, best_v, ROUNDS);
	return result(&b, t, best_v, best);
}
