#include "sync/framelock/straggler.h"

#include <string.h>

#define FILL 0.8      /* of a frame's time that is aimed at: the rest is for the barrier and for luck */
#define NEARLY 0.92   /* of it: who is lowered already and comes that near grows slower still, and will be late next */
#define STEP 1.15     /* a quality is raised by so much at a time */
#define WAIT_FRAMES 2 /* one frame is being drawn as it was, one may have begun */

void bb_straggler_init(struct bb_straggler *s, unsigned n_nodes, int64_t refresh_ns)
{
	memset(s, 0, sizeof(*s));
	s->n_nodes = n_nodes < BB_LOCK_NODES_MAX ? n_nodes : BB_LOCK_NODES_MAX;
	s->refresh_ns = refresh_ns;
	s->every = 1;
	for (unsigned i = 0; i < s->n_nodes; i++)
		s->node[i].quality = 1;
}

void bb_straggler_note(struct bb_straggler *s, unsigned node, int64_t took_ns)
{
	if (node >= s->n_nodes || took_ns < 0)
		return;
	struct bb_straggler_node *n = &s->node[node];
	memmove(n->took_ns, n->took_ns + 1, sizeof(n->took_ns) - sizeof(n->took_ns[0]));
	n->took_ns[BB_STRAGGLER_FRAMES - 1] = took_ns;
	n->n += n->n < BB_STRAGGLER_FRAMES;
	n->wait -= n->wait > 0;
}

static int64_t budget_ns(const struct bb_straggler *s, unsigned every)
{
	return s->refresh_ns * every;
}

static int64_t newest(const struct bb_straggler_node *n)
{
	return n->n ? n->took_ns[BB_STRAGGLER_FRAMES - 1] : 0;
}

static bool is_late(const struct bb_straggler *s, const struct bb_straggler_node *n, int64_t *most_ns)
{
	const bool lowered = n->quality < 1 && n->quality > BB_STRAGGLER_QUALITY_LEAST;
	const double limit_ns = (lowered ? NEARLY : 1) * (double)budget_ns(s, s->every);
	unsigned late = 0;

	*most_ns = 0;
	for (unsigned i = BB_STRAGGLER_FRAMES - n->n; i < BB_STRAGGLER_FRAMES; i++) {
		if ((double)n->took_ns[i] <= limit_ns)
			continue;
		late++;
		*most_ns = n->took_ns[i] > *most_ns ? n->took_ns[i] : *most_ns;
	}
	return !n->wait && late >= BB_STRAGGLER_LATE;
}

static void set_quality(struct bb_straggler_node *n, double quality)
{
	n->quality = quality < BB_STRAGGLER_QUALITY_LEAST ? BB_STRAGGLER_QUALITY_LEAST : quality > 1 ? 1 : quality;
	n->n = 0;
	n->wait = WAIT_FRAMES;
	n->good = 0;
	n->most_ns = 0;
}

/* The quality at which a frame should take want_ns: in proportion at first; lowered again, by what the last time did, as
 * not all of a draw shrinks with its samples. At least a fifth less, and at most half: what it draws may have grown meanwhile. */
static double fitting(const struct bb_straggler_node *n, int64_t took_ns, double want_ns)
{
	const double per_quality = (double)(n->was_ns - took_ns) / (n->was_quality - n->quality);
	double fits = n->quality * want_ns / (double)took_ns;

	if (n->was_quality > n->quality && per_quality > 0)
		fits = n->quality - ((double)took_ns - want_ns) / per_quality;
	fits = fits < 0.8 * n->quality ? fits : 0.8 * n->quality;
	return fits > 0.5 * n->quality ? fits : 0.5 * n->quality;
}

/* Late: a quality that fits, or, when there is none, a frame more for everybody. */
static enum bb_straggler_change relieve(struct bb_straggler *s, struct bb_straggler_node *n, int64_t took_ns)
{
	if (n->quality > BB_STRAGGLER_QUALITY_LEAST) {
		const double lower = fitting(n, took_ns, FILL * (double)budget_ns(s, s->every));
		n->was_quality = n->quality;
		n->was_ns = took_ns;
		set_quality(n, lower);
		return BB_STRAGGLER_LOWER;
	}
	if (s->every == BB_STRAGGLER_EVERY_MOST)
		return BB_STRAGGLER_NONE;
	s->every++;
	s->good = 0;
	for (unsigned i = 0; i < s->n_nodes; i++)
		s->node[i].n = 0; /* judged anew */
	return BB_STRAGGLER_SLOWER;
}

static enum bb_straggler_change restore(struct bb_straggler *s, struct bb_straggler_node *n)
{
	n->most_ns = newest(n) > n->most_ns ? newest(n) : n->most_ns;
	if (n->quality >= 1 || n->wait || (double)n->most_ns * STEP > FILL * (double)budget_ns(s, s->every)) {
		n->good = 0;
		n->most_ns = 0;
		return BB_STRAGGLER_NONE;
	}
	if (++n->good < BB_STRAGGLER_RECOVER)
		return BB_STRAGGLER_NONE;
	set_quality(n, n->quality * STEP);
	n->was_quality = 0;
	return BB_STRAGGLER_RAISE;
}

struct bb_straggler_verdict bb_straggler_decide(struct bb_straggler *s)
{
	struct bb_straggler_verdict v = { BB_STRAGGLER_NONE, 0 };
	bool fits = s->every > 1;

	for (unsigned i = 0; i < s->n_nodes; i++) {
		struct bb_straggler_node *n = &s->node[i];
		int64_t took_ns;
		const enum bb_straggler_change change = is_late(s, n, &took_ns) ? relieve(s, n, took_ns) : restore(s, n);
		if (change != BB_STRAGGLER_NONE)
			v = (struct bb_straggler_verdict){ change, i };
		fits = fits && (double)newest(n) <= FILL * (double)budget_ns(s, s->every - 1);
	}
	s->good = fits ? s->good + 1 : 0;
	if (s->good < BB_STRAGGLER_RECOVER)
		return v;
	s->every--;
	s->good = 0;
	return (struct bb_straggler_verdict){ BB_STRAGGLER_FASTER, v.node };
}
