#include "sync/polarity.h"

#include <math.h>
#include <string.h>

#define TO_FLIP 2      /* eye changes in a row */
#define TO_HOLD 20     /* ten frames of both eyes */
#define TO_BEGIN 2
#define SILENT_MOST 20 /* eye changes without any identity: the source is gone */

void bb_polarity_init(struct bb_polarity *p, struct bb_rate rate)
{
	memset(p, 0, sizeof(*p));
	p->period_ns = bb_rate_period_ns(rate);
}

static void disagree(struct bb_polarity *p, enum bb_polarity_source source, int64_t at_ns)
{
	if (!p->source[source].bad)
		p->source[source].bad_ns = at_ns;
	p->source[source].bad++;
	p->source[source].good = 0;
	if (p->source[source].bad < TO_FLIP || p->verdict == BB_POLARITY_FLIPPED)
		return;
	p->verdict = BB_POLARITY_FLIPPED;
	p->by = source;
	p->flipped_ns = p->source[source].bad_ns;
	p->flips++;
}

static void agree(struct bb_polarity *p, enum bb_polarity_source source)
{
	const bool flipped = p->verdict == BB_POLARITY_FLIPPED;

	p->glitches += p->source[source].bad && p->source[source].bad < TO_FLIP;
	p->source[source].bad = 0;
	p->source[source].good++;
	/* A flip is over when the source that saw it says so. */
	if (flipped ? source == p->by && p->source[source].good >= TO_HOLD : p->source[source].good >= TO_BEGIN)
		p->verdict = BB_POLARITY_HOLDS;
}

enum bb_polarity_verdict bb_polarity_see(struct bb_polarity *p, enum bb_polarity_source source, int64_t at_ns,
                                         enum bb_eye picture, enum bb_eye glasses)
{
	if (glasses == BB_EYE_NONE)
		return p->verdict; /* mono: there is nothing to be wrong */
	if (picture == BB_EYE_NONE) {
		/* Other sources may still tell of the same change. */
		p->silent += at_ns - p->known_ns > p->period_ns / 2;
		if (p->silent >= SILENT_MOST) {
			p->verdict = BB_POLARITY_UNTAGGED;
			memset(p->source, 0, sizeof(p->source));
		}
		return p->verdict;
	}
	p->silent = 0;
	p->known_ns = at_ns;
	if (picture != glasses)
		disagree(p, source, at_ns);
	else
		agree(p, source);
	return p->verdict;
}

/* ---- the tag ---- */

#define LEARN 4 /* frames in which a white one is sure to be */

void bb_tag_reader_init(struct bb_tag_reader *r)
{
	*r = (struct bb_tag_reader){ .place = -1 };
}

static void count_bit(struct bb_tag_reader *r, bool bit)
{
	r->bits = (r->bits << 1 | bit) & ((1u << BB_TAG_BITS) - 1);
	r->gap = false;
	if (++r->n_bits < BB_TAG_BITS)
		return;
	const int place = bb_tag_place(r->bits);
	r->gap = place < 0 || (r->place >= 0 && place != (r->place + 1) % BB_TAG_CYCLES);
	r->place = place;
}

enum bb_eye bb_tag_reader_frame(struct bb_tag_reader *r, double light)
{
	r->low = r->n ? fmin(r->low, light) : light;
	r->high = r->n ? fmax(r->high, light) : light;
	r->n += r->n < LEARN;
	if (r->n < LEARN || !isfinite(light) || !(r->high > r->low))
		return BB_EYE_NONE;
	const double share = (light - r->low) / (r->high - r->low);
	if (share > 0.75)
		return BB_EYE_LEFT;
	count_bit(r, share > 0.25);
	return BB_EYE_RIGHT;
}

