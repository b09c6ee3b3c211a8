/*
 * sim/rng.c: xoshiro256** (Blackman and Vigna, public domain algorithm) seeded through splitmix64. The normal draw
 * uses +, -, *, / and sqrt only: IEEE 754 fixes their bits, while a libm's log may differ between machines.
 */
#include "sim/world.h"

#include <math.h>

static uint64_t splitmix(uint64_t *state)
{
	uint64_t z = *state += UINT64_C(0x9E3779B97F4A7C15);

	z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
	z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
	return z ^ (z >> 31);
}

static uint64_t fnv1a(uint64_t hash, const char *text)
{
	for (; *text; text++)
		hash = (hash ^ (unsigned char)*text) * UINT64_C(0x100000001B3);
	return hash;
}

static void fill(struct sim_rng *r, uint64_t state)
{
	for (int i = 0; i < 4; i++)
		r->s[i] = splitmix(&state);
	r->has_spare = false;
	r->spare = 0;
}

void sim_rng_seed(struct sim_rng *r, uint64_t seed, const char *class_name, const char *id)
{
	uint64_t hash = UINT64_C(0xCBF29CE484222325);

	hash = fnv1a(hash, class_name);
	hash = fnv1a(hash, "/");
	hash = fnv1a(hash, id);
	fill(r, seed + hash);
}

struct sim_rng sim_rng_at(const struct sim_rng *instance, uint64_t n)
{
	struct sim_rng r;

	fill(&r, instance->s[0] ^ (n * UINT64_C(0xD1342543DE82EF95)));
	return r;
}

static uint64_t rotate(uint64_t x, int k)
{
	return (x << k) | (x >> (64 - k));
}

uint64_t sim_rng_u64(struct sim_rng *r)
{
	uint64_t *s = r->s;
	const uint64_t result = rotate(s[1] * 5, 7) * 9;
	const uint64_t t = s[1] << 17;

	s[2] ^= s[0];
	s[3] ^= s[1];
	s[1] ^= s[2];
	s[0] ^= s[3];
	s[2] ^= t;
	s[3] = rotate(s[3], 45);
	return result;
}

double sim_rng_uniform(struct sim_rng *r)
{
	return (double)(sim_rng_u64(r) >> 11) * 0x1p-53;
}

/* ln x for 0 < x <= 1 to about 1e-15: x = m 2^e, ln m = 2 artanh((m - 1) / (m + 1)) with |z| <= 0.172. */
static double natural_log(double x)
{
	int e;
	double m = frexp(x, &e);

	if (m < 0.70710678118654752) {
		m *= 2;
		e--;
	}
	const double z = (m - 1) / (m + 1), zz = z * z;
	double sum = 0;
	for (int k = 19; k >= 1; k -= 2)
		sum = sum * zz + 1.0 / k;
	return 2 * z * sum + e * 0.69314718055994530942;
}

double sim_rng_normal(struct sim_rng *r) /* Marsaglia's polar method */
{
	double u, v, s;

	if (r->has_spare) {
		r->has_spare = false;
		return r->spare;
	}
	do {
		u = 2 * sim_rng_uniform(r) - 1;
		v = 2 * sim_rng_uniform(r) - 1;
		s = u * u + v * v;
	} while (s >= 1 || s <= 0);
	const double f = sqrt(-2 * natural_log(s) / s);
	r->has_spare = true;
	r->spare = v * f;
	return u * f;
}

double sim_rng_exponential(struct sim_rng *r)
{
	return -natural_log(1 - sim_rng_uniform(r));
}
