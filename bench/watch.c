#include "bench/watch.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define INCIDENTS_MAX 1024

struct slot {
	char name[64];
	uint16_t source;          /* in the event log */
	enum bb_health health;
	int64_t bad_since_ns, good_since_ns; /* good_since: BB_NEVER while bad reports come */
	int64_t bad_ns, longest_ns;
	size_t incident;          /* 1 + index of the open one */
};

struct bb_watch {
	struct bb_eventlog *events;
	int64_t settle_ns;
	size_t n, cap, n_incidents;
	struct slot *slots;
	struct bb_incident *incidents;
};

enum bb_status bb_watch_create(size_t n_slots, struct bb_eventlog *events, int64_t settle_ns, struct bb_watch **out)
{
	struct bb_watch *w = calloc(1, sizeof(*w));

	*out = NULL;
	if (!w)
		return BB_ERR_NOMEM;
	w->slots = calloc(n_slots ? n_slots : 1, sizeof(*w->slots));
	w->incidents = calloc(INCIDENTS_MAX, sizeof(*w->incidents));
	w->cap = n_slots ? n_slots : 1;
	w->events = events;
	w->settle_ns = settle_ns;
	if (!w->slots || !w->incidents) {
		bb_watch_destroy(w);
		return BB_ERR_NOMEM;
	}
	*out = w;
	return BB_OK;
}

void bb_watch_destroy(struct bb_watch *w)
{
	if (!w)
		return;
	free(w->slots);
	free(w->incidents);
	free(w);
}

size_t bb_watch_slot(struct bb_watch *w, const char *class_name, const char *id)
{
	if (w->n == w->cap)
		return w->cap - 1;
	struct slot *s = &w->slots[w->n];
	snprintf(s->name, sizeof(s->name), "%s/%s", class_name, id);
	s->source = bb_eventlog_source(w->events, class_name, id);
	s->health = BB_HEALTH_OK;
	s->good_since_ns = BB_NEVER;
	return w->n++;
}

static void change(struct bb_watch *w, struct slot *s, int64_t now_ns, enum bb_health health)
{
	bb_eventlog_add(w->events, s->source, BB_EV_HEALTH, now_ns, (int64_t)health, (int64_t)s->health);
	s->health = health;
}

void bb_watch_bad(struct bb_watch *w, size_t slot, int64_t now_ns, enum bb_health health, const char *fmt, ...)
{
	struct slot *s = &w->slots[slot];
	const bool worse = s->health == BB_HEALTH_OK || health > s->health;

	s->good_since_ns = BB_NEVER;
	if (!worse)
		return;
	if (s->health == BB_HEALTH_OK)
		s->bad_since_ns = now_ns;
	if (!s->incident && w->n_incidents < INCIDENTS_MAX) {
		struct bb_incident *in = &w->incidents[w->n_incidents];
		s->incident = ++w->n_incidents;
		snprintf(in->culprit, sizeof(in->culprit), "%s", s->name);
		in->from_ns = now_ns;
		in->to_ns = BB_NEVER;
	}
	if (s->incident) {
		struct bb_incident *in = &w->incidents[s->incident - 1];
		va_list ap;
		va_start(ap, fmt);
		vsnprintf(in->what, sizeof(in->what), fmt, ap);
		va_end(ap);
		snprintf(in->state, sizeof(in->state), "%s", bb_health_text(health));
	}
	change(w, s, now_ns, health);
}

void bb_watch_say(struct bb_watch *w, size_t slot, const char *word, const char *fmt, ...)
{
	const size_t incident = w->slots[slot].incident;
	va_list ap;

	if (!incident || strncmp(w->incidents[incident - 1].what, word, strlen(word)))
		return;
	va_start(ap, fmt);
	vsnprintf(w->incidents[incident - 1].what, sizeof(w->incidents[incident - 1].what), fmt, ap);
	va_end(ap);
}

size_t bb_watch_warn(struct bb_watch *w, size_t slot, int64_t now_ns, const char *fmt, ...)
{
	va_list ap;

	if (w->n_incidents == INCIDENTS_MAX)
		return INCIDENTS_MAX;
	struct bb_incident *in = &w->incidents[w->n_incidents++];
	snprintf(in->culprit, sizeof(in->culprit), "%s", w->slots[slot].name);
	snprintf(in->state, sizeof(in->state), "WARNING");
	in->from_ns = now_ns;
	in->to_ns = BB_NEVER;
	va_start(ap, fmt);
	vsnprintf(in->what, sizeof(in->what), fmt, ap);
	va_end(ap);
	return w->n_incidents - 1;
}

void bb_watch_over(struct bb_watch *w, size_t warning, int64_t now_ns)
{
	if (warning < INCIDENTS_MAX)
		w->incidents[warning].to_ns = now_ns;
}

static void close_incident(struct bb_watch *w, struct slot *s, int64_t at_ns)
{
	const int64_t lasted_ns = at_ns - s->bad_since_ns;

	s->bad_ns += lasted_ns;
	if (lasted_ns > s->longest_ns)
		s->longest_ns = lasted_ns;
	if (s->incident)
		w->incidents[s->incident - 1].to_ns = at_ns;
	s->incident = 0;
}

void bb_watch_good(struct bb_watch *w, size_t slot, int64_t now_ns)
{
	struct slot *s = &w->slots[slot];

	if (s->health == BB_HEALTH_OK)
		return;
	if (s->good_since_ns == BB_NEVER)
		s->good_since_ns = now_ns;
	if (now_ns - s->good_since_ns < w->settle_ns)
		return;
	close_incident(w, s, s->good_since_ns); /* the settling itself is not held against the device */
	change(w, s, now_ns, BB_HEALTH_OK);
}

enum bb_health bb_watch_health(const struct bb_watch *w, size_t slot)
{
	return w->slots[slot].health;
}

void bb_watch_finish(struct bb_watch *w, int64_t now_ns)
{
	for (size_t i = 0; i < w->n; i++) {
		struct slot *s = &w->slots[i];
		if (s->health == BB_HEALTH_OK)
			continue;
		const size_t incident = s->incident;
		const bool recovering = s->good_since_ns != BB_NEVER;
		close_incident(w, s, recovering ? s->good_since_ns : now_ns);
		if (incident && !recovering)
			w->incidents[incident - 1].to_ns = BB_NEVER;
	}
}

double bb_watch_longest_bad_s(const struct bb_watch *w, size_t slot)
{
	return (double)w->slots[slot].longest_ns * 1e-9;
}

double bb_watch_bad_s(const struct bb_watch *w, size_t slot)
{
	return (double)w->slots[slot].bad_ns * 1e-9;
}

const char *bb_watch_name(const struct bb_watch *w, size_t slot)
{
	return w->slots[slot].name;
}

size_t bb_watch_slots(const struct bb_watch *w)
{
	return w->n;
}

size_t bb_watch_incidents(const struct bb_watch *w, const struct bb_incident **out)
{
	*out = w->incidents;
	return w->n_incidents;
}
