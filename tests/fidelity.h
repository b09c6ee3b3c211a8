/*
 * tests/fidelity.h: one script of a device class, played on its rungs (the simulated device, the shipped driver before a
 * peer, the shipped driver before a device of the kernel), and the logs of what its user saw side by side: the
 * sim-fidelity score of the class. What was seen must be the same words; when, within the limits both rungs state.
 */
#ifndef BB_TESTS_FIDELITY_H
#define BB_TESTS_FIDELITY_H

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FID_EVENTS_MAX 2048
#define FID_WORDS_MAX 64

struct fid_log {
	const char *rung; /* "sim", "driver + peer", "driver + kernel" */
	size_t n;
	struct fid_event {
		int64_t at_ns;     /* on the rung's clock; compared from the log's first event on */
		int64_t within_ns; /* how wrong at_ns may be, by the limits of this back end */
		char what[FID_WORDS_MAX];
	} event[FID_EVENTS_MAX];
};

/* An event more than the log holds is dropped: the table then shows a log of FID_EVENTS_MAX, and that is a failure. */
__attribute__((format(printf, 4, 5))) static inline void fid_note(struct fid_log *log, int64_t at_ns, int64_t within_ns,
                                                                  const char *format, ...)
{
	va_list ap;

	if (log->n == FID_EVENTS_MAX)
		return;
	struct fid_event *e = &log->event[log->n++];
	e->at_ns = at_ns;
	e->within_ns = within_ns;
	va_start(ap, format);
	vsnprintf(e->what, sizeof(e->what), format, ap);
	va_end(ap);
}

struct fid_score {
	size_t same;    /* in both logs, the n-th of its words here the n-th there */
	size_t in_time; /* of those, when they should be */
	double worst;   /* the largest difference in time as a part of what both limits allow together */
	double worst_us;
};

static inline struct fid_score fid_compare(const struct fid_log *a, const struct fid_log *b)
{
	struct fid_score s = { 0 };
	bool *used = calloc(FID_EVENTS_MAX, sizeof(*used));

	for (size_t i = 0; used && i < a->n; i++) {
		const struct fid_event *p = &a->event[i], *q = NULL;
		for (size_t k = 0; k < b->n && !q; k++)
			if (!used[k] && !strcmp(p->what, b->event[k].what)) {
				q = &b->event[k];
				used[k] = true;
			}
		if (!q)
			continue;
		const int64_t apart = (p->at_ns - a->event[0].at_ns) - (q->at_ns - b->event[0].at_ns);
		const double dt = (double)(apart < 0 ? -apart : apart), may = (double)(p->within_ns + q->within_ns);
		s.same++;
		s.in_time += dt <= may;
		if (dt > 0 && dt / (may > 1 ? may : 1) > s.worst) {
			s.worst = dt / (may > 1 ? may : 1);
			s.worst_us = dt * 1e-3;
		}
	}
	free(used);
	return s;
}

static inline void fid_show_missing(const struct fid_log *a, const struct fid_log *b)
{
	size_t shown = 0;

	for (size_t i = 0; i < a->n && shown < 8; i++) {
		size_t here = 0, there = 0;
		for (size_t k = 0; k <= i; k++)
			here += !strcmp(a->event[k].what, a->event[i].what);
		for (size_t k = 0; k < b->n; k++)
			there += !strcmp(b->event[k].what, a->event[i].what);
		if (there < here) {
			shown++;
			printf("  %s only: \"%s\" at %.3f ms\n", a->rung, a->event[i].what,
			       (double)(a->event[i].at_ns - a->event[0].at_ns) * 1e-6);
		}
	}
}

/*
 * Prints a line for each rung against logs[0], each beginning with "fidelity", and what only one log has. Returns how many
 * rungs do not agree; a script nobody saw anything of agrees with nothing.
 */
static inline int fid_table(const char *class_name, const struct fid_log *const *logs, size_t n_logs)
{
	int apart = 0;

	printf("fidelity %-14s %-44s %7s %7s %7s %7s %9s %10s %9s %7s\n", "class", "rung", "events", "same", "missing",
	       "extra", "in time", "worst us", "of limit", "score");
	for (size_t i = 0; i < n_logs; i++) {
		const struct fid_log *a = logs[0], *b = logs[i];
		const struct fid_score s = fid_compare(a, b);
		const size_t most = a->n > b->n ? a->n : b->n;
		const double score = most ? (double)s.in_time / (double)most : 0;
		const bool agrees = most && most < FID_EVENTS_MAX && s.in_time == most;
		printf("fidelity %-14s %-44s %7zu %7zu %7zu %7zu %9zu %10.1f %8.0f%% %6.1f%%%s\n", class_name, b->rung, b->n,
		       s.same, a->n - s.same, b->n - s.same, s.in_time, s.worst_us, s.worst * 100, score * 100,
		       agrees ? "" : "  DIFFERS");
		if (!agrees) {
			fid_show_missing(a, b);
			fid_show_missing(b, a);
			apart++;
		}
	}
	return apart;
}

#endif
