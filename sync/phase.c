#include "sync/phase.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

void bb_phase_init(struct bb_phase *p, struct bb_rate rate, unsigned n_stages)
{
	memset(p, 0, sizeof(*p));
	p->nominal_ns = bb_rate_period_ns(rate);
	p->recent_ns = (double)p->nominal_ns;
	p->n_stages = n_stages < BB_STAGES_MAX ? n_stages : BB_STAGES_MAX;
}

/* Pair a stage's newest edge with the emitter's of the same sequence, whichever came first. */
static void pair(struct bb_phase *p, struct bb_phase_stage *s)
{
	const unsigned i = s->seq % BB_ARRAY_LEN(p->ring);

	if (!s->n || !p->ring[i].valid || p->ring[i].seq != s->seq)
		return;
	s->offset_ns = s->at_ns - p->ring[i].at_ns - p->planned_ns;
	s->eye_differs = s->eye && p->ring[i].eye && s->eye != p->ring[i].eye;
	s->pair_seq = s->seq;
	s->paired = true;
}

static void note_emitter(struct bb_phase *p, const struct bb_shutter_edge *e)
{
	const unsigned i = e->seq % BB_ARRAY_LEN(p->ring);

	if (!p->emitter.n) {
		p->first_ns = e->at_ns;
		p->first_seq = e->seq;
	} else {
		const double steps = (double)(int32_t)(e->seq - p->emitter.seq);
		const double interval = (double)(e->at_ns - p->emitter.at_ns) / steps;
		const double off = interval - p->recent_ns;
		p->jitter_sq_ns2 += (off * off - p->jitter_sq_ns2) / 64;
		p->recent_ns += off / 16;
	}
	p->ring[i].seq = e->seq;
	p->ring[i].at_ns = e->at_ns;
	p->ring[i].eye = e->eye;
	p->ring[i].valid = true;
}

void bb_phase_edge(struct bb_phase *p, const struct bb_shutter_edge *e)
{
	const bool emitter = e->stage == BB_STAGE_EMITTER;

	if (!emitter && e->stage >= p->n_stages)
		return;
	struct bb_phase_stage *s = emitter ? &p->emitter : &p->stage[e->stage];
	if (s->n) {
		const int32_t step = (int32_t)(e->seq - s->seq);
		if (step <= 0 || e->at_ns - s->at_ns < p->nominal_ns / 4) { /* row G2: bounce or double edge */
			s->doubled++;
			return;
		}
		s->missed += (uint64_t)(step - 1);
	}
	if (emitter)
		note_emitter(p, e);
	s->n++;
	s->seq = e->seq;
	s->at_ns = e->at_ns;
	s->eye = e->eye;
	if (!emitter) {
		pair(p, s);
		return;
	}
	for (unsigned i = 0; i < p->n_stages; i++)
		if (p->stage[i].seq == e->seq)
			pair(p, &p->stage[i]);
}

double bb_phase_period_ns(const struct bb_phase *p)
{
	const uint32_t n = p->emitter.seq - p->first_seq;

	return p->emitter.n > 1 && n ? (double)(p->emitter.at_ns - p->first_ns) / (double)n : (double)p->nominal_ns;
}

double bb_phase_jitter_ns(const struct bb_phase *p)
{
	return sqrt(p->jitter_sq_ns2 / 2); /* an interval holds the jitter of two edges */
}

bool bb_phase_worst(const struct bb_phase *p, int64_t *offset_ns, unsigned *stage)
{
	bool any = false;

	for (unsigned i = 0; i < p->n_stages; i++) {
		const struct bb_phase_stage *s = &p->stage[i];
		if (!s->paired || (any && llabs(s->offset_ns) <= llabs(*offset_ns)))
			continue;
		*offset_ns = s->offset_ns;
		*stage = i;
		any = true;
	}
	return any;
}

/* Half periods since the emitter's newest edge, rounded down. */
static int64_t halves_since(const struct bb_phase *p, int64_t at_ns)
{
	return (int64_t)floor((double)(at_ns - p->emitter.at_ns) / bb_phase_period_ns(p));
}

enum bb_eye bb_phase_eye_at(const struct bb_phase *p, int64_t at_ns)
{
	if (!p->emitter.n || p->emitter.eye == BB_EYE_NONE)
		return BB_EYE_NONE;
	if (halves_since(p, at_ns) % 2 == 0)
		return (enum bb_eye)p->emitter.eye;
	return p->emitter.eye == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
}

int64_t bb_phase_open_ns(const struct bb_phase *p, enum bb_eye eye, int64_t at_ns)
{
	const enum bb_eye now = bb_phase_eye_at(p, at_ns);

	if (now == BB_EYE_NONE || eye == BB_EYE_NONE || now == eye)
		return at_ns;
	return p->emitter.at_ns + (int64_t)((double)(halves_since(p, at_ns) + 1) * bb_phase_period_ns(p));
}
