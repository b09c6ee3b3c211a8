#include "sync/lock_proof.h"

#include <string.h>

#define STAMP_EARLIEST_NS (-(INT64_C(1) << 60)) /* differences of stamps fit, and a recording may begin at 2^62 */
#define STAMP_LATEST_NS (INT64_C(3) << 61)
#define UNCERTAINTY_MOST_NS (INT64_C(1) << 60)
#define OLD_FRAMES 600 /* a counter is carried on by the nominal rate for so long; 100 ppm of it is 6 % of a frame */

void bb_lock_proof_init(struct bb_lock_proof *p, unsigned n, struct bb_rate rate, int64_t phase_limit_ns)
{
	memset(p, 0, sizeof(*p));
	p->n = n < BB_LOCK_PROOF_DISPLAYS_MAX ? n : BB_LOCK_PROOF_DISPLAYS_MAX;
	p->rate = rate;
	p->phase_limit_ns = phase_limit_ns;
}

/* The nearest whole number of frames in a time. */
static int64_t frames_in(const struct bb_lock_proof *p, int64_t ns)
{
	const int64_t half_ns = bb_rate_period_ns(p->rate) / 2, frame_ns = BB_NS_PER_S * p->rate.den;

	return (int64_t)((__int128)(ns + half_ns) * p->rate.num / frame_ns);
}

static bool stamp_possible(int64_t vblank_ns, int64_t uncertainty_ns)
{
	return vblank_ns >= STAMP_EARLIEST_NS && vblank_ns <= STAMP_LATEST_NS && uncertainty_ns >= 0 &&
	       uncertainty_ns <= UNCERTAINTY_MOST_NS;
}

bool bb_lock_proof_add(struct bb_lock_proof *p, unsigned display, uint64_t counter, int64_t vblank_ns, int64_t uncertainty_ns)
{
	struct bb_lock_display *d = &p->display[display < p->n ? display : 0];

	if (display >= p->n || !stamp_possible(vblank_ns, uncertainty_ns) || (d->any && vblank_ns < d->vblank_ns))
		return false;
	d->skips += d->any && counter - d->counter != (uint64_t)frames_in(p, vblank_ns - d->vblank_ns);
	*d = (struct bb_lock_display){ true, counter, vblank_ns, uncertainty_ns, d->skips };
	return true;
}

/* Counter and begin of the display's vblank that is nearest to a time. */
static int64_t near(const struct bb_lock_proof *p, const struct bb_lock_display *d, int64_t at_ns, uint64_t *counter)
{
	const int64_t since_ns = at_ns - d->vblank_ns;
	const int64_t k = since_ns >= 0 ? frames_in(p, since_ns) : -frames_in(p, -since_ns);

	*counter = d->counter + (uint64_t)k;
	return d->vblank_ns + bb_rate_frame_ns(p->rate, k);
}

static uint64_t distance(uint64_t a, uint64_t b)
{
	const int64_t d = (int64_t)(a - b);

	return d < 0 ? -(uint64_t)d : (uint64_t)d;
}

static bool usable(const struct bb_lock_proof *p, int64_t at_ns)
{
	for (unsigned i = 0; i < p->n; i++)
		if (!p->display[i].any || at_ns - p->display[i].vblank_ns > bb_rate_frame_ns(p->rate, OLD_FRAMES))
			return false;
	return p->n > 1;
}

/* The counter most displays show, and of those the first. */
static unsigned reference(const struct bb_lock_proof *p, int64_t common_ns)
{
	unsigned best = 0, most = 0;

	for (unsigned i = 0; i < p->n; i++) {
		uint64_t mine, other;
		unsigned n = 0;
		(void)near(p, &p->display[i], common_ns, &mine);
		for (unsigned k = 0; k < p->n; k++) {
			(void)near(p, &p->display[k], common_ns, &other);
			n += other == mine;
		}
		if (n > most) {
			most = n;
			best = i;
		}
	}
	return best;
}

static enum bb_lock_verdict verdict_of(const struct bb_lock_proof *p, const struct bb_lock_finding *f)
{
	const int64_t apart_ns = f->phase_ns < 0 ? -f->phase_ns : f->phase_ns;

	if (f->counters_apart)
		return BB_LOCK_COUNTERS_APART;
	if (apart_ns - f->uncertainty_ns > p->phase_limit_ns)
		return BB_LOCK_PHASES_APART;
	return apart_ns + f->uncertainty_ns > p->phase_limit_ns ? BB_LOCK_INCONCLUSIVE : BB_LOCK_PROVEN;
}

struct bb_lock_finding bb_lock_proof_judge(const struct bb_lock_proof *p, int64_t at_ns)
{
	struct bb_lock_finding f = { .verdict = BB_LOCK_INCONCLUSIVE };
	uint64_t want, counter;

	for (unsigned i = 0; i < p->n; i++)
		f.skips += p->display[i].skips;
	if (!usable(p, at_ns))
		return f;
	/* The common instant is a vblank of a display: those near it are compared, none lies at the edge between two. */
	const int64_t first_ns = near(p, &p->display[0], at_ns, &want);
	const unsigned ref = reference(p, first_ns);
	const int64_t common_ns = near(p, &p->display[ref], at_ns, &want);
	f.display = ref;
	for (unsigned i = 0; i < p->n; i++) {
		const int64_t phase_ns = near(p, &p->display[i], common_ns, &counter) - common_ns;
		const int64_t apart = (int64_t)(counter - want);
		const bool farther = distance(counter, want) > distance((uint64_t)f.counters_apart, 0) ||
		                     (apart == f.counters_apart && (phase_ns < 0 ? -phase_ns : phase_ns) >
		                                                           (f.phase_ns < 0 ? -f.phase_ns : f.phase_ns));
		if (i == ref || !farther)
			continue;
		f.display = i;
		f.counters_apart = apart;
		f.phase_ns = phase_ns;
		f.uncertainty_ns = p->display[i].uncertainty_ns + p->display[ref].uncertainty_ns;
	}
	if (f.display == ref) /* all at the very same instant */
		f.uncertainty_ns = 2 * p->display[ref].uncertainty_ns;
	f.verdict = verdict_of(p, &f);
	return f;
}

const char *bb_lock_verdict_text(enum bb_lock_verdict v)
{
	static const char *const names[] = { "locked", "counters apart", "phases apart", "inconclusive" };

	return names[v];
}

/* ---- recordings ---- */

static bool is_blank(char c)
{
	return c == ' ' || c == '\t' || c == '\r';
}

/* A whole number that fits, after blanks and before one or the end; false otherwise. */
static bool read_number(const char **at, const char *end, int64_t *out)
{
	const char *c = *at;
	bool minus = false;
	int64_t v = 0;

	while (c < end && is_blank(*c))
		c++;
	if (c < end && *c == '-') {
		minus = true;
		c++;
	}
	const char *digits = c;
	for (; c < end && *c >= '0' && *c <= '9'; c++)
		if (__builtin_mul_overflow(v, 10, &v) || __builtin_add_overflow(v, *c - '0', &v))
			return false;
	*out = minus ? -v : v;
	*at = c;
	return c > digits && (c == end || is_blank(*c));
}

static bool read_line(struct bb_lock_proof *p, const char *c, const char *end)
{
	int64_t v[4];

	for (int i = 0; i < 4; i++)
		if (!read_number(&c, end, &v[i]))
			return false;
	while (c < end && is_blank(*c))
		c++;
	return c == end && v[0] >= 0 && v[0] < p->n && v[1] >= 0 &&
	       bb_lock_proof_add(p, (unsigned)v[0], (uint64_t)v[1], v[2], v[3]);
}

unsigned bb_lock_proof_read(struct bb_lock_proof *p, const char *text, size_t n_bytes)
{
	const char *end = text + n_bytes;

	for (unsigned line = 1; text < end; line++) {
		const char *newline = memchr(text, '\n', (size_t)(end - text)), *next = newline ? newline + 1 : end;
		const char *stop = newline ? newline : end, *comment = memchr(text, '#', (size_t)(stop - text));
		const char *c = text;
		stop = comment ? comment : stop;
		while (c < stop && is_blank(*c))
			c++;
		if (c < stop && !read_line(p, c, stop))
			return line;
		text = next;
	}
	return 0;
}
