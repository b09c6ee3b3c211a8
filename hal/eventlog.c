#include "hal/eventlog.h"

#include <stdio.h>
#include <string.h>

void bb_eventlog_init(struct bb_eventlog *log, void (*sink)(void *, const struct bb_event *, size_t), void *ctx)
{
	memset(log, 0, sizeof(*log));
	log->sink = sink;
	log->ctx = ctx;
}

uint16_t bb_eventlog_source(struct bb_eventlog *log, const char *class_name, const char *id)
{
	char name[sizeof(log->names[0])];

	if (!log)
		return 0;
	snprintf(name, sizeof(name), "%.11s/%.31s", class_name, id);
	for (uint16_t i = 0; i < log->n_sources; i++)
		if (!strcmp(log->names[i], name))
			return i;
	if (log->n_sources == BB_EVENT_SOURCES_MAX)
		return BB_EVENT_SOURCES_MAX - 1;
	memcpy(log->names[log->n_sources], name, sizeof(name));
	return log->n_sources++;
}

void bb_eventlog_flush(struct bb_eventlog *log)
{
	if (log->sink && log->n)
		log->sink(log->ctx, log->block, log->n);
	log->n = 0;
}

void bb_eventlog_add(struct bb_eventlog *log, uint16_t source, enum bb_event_kind kind, int64_t at_ns, int64_t a,
                     int64_t b)
{
	if (!log)
		return;
	if (log->n == BB_EVENT_BLOCK)
		bb_eventlog_flush(log);
	log->block[log->n++] = (struct bb_event){ at_ns, a, b, source, (uint16_t)kind, 0 };
	log->total++;
	log->per_source[source]++;
}

const char *bb_event_kind_text(enum bb_event_kind kind)
{
	static const char *const text[] = {
#define X(name, word) word,
		BB_EVENT_KINDS(X)
#undef X
	};
	return (size_t)kind < BB_ARRAY_LEN(text) ? text[kind] : "unknown";
}
