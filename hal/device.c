#include "hal/device.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>

const char *bb_health_text(enum bb_health health)
{
	static const char *const text[] = {
#define X(name, word) word,
		BB_HEALTH_LIST(X)
#undef X
	};
	return (size_t)health < BB_ARRAY_LEN(text) ? text[health] : "unknown";
}

void bb_device_init(struct bb_device *dev, const char *class_name, const char *id, const struct bb_open *open)
{
	dev->class_name = class_name;
	snprintf(dev->id, sizeof(dev->id), "%s", id);
	dev->clk = open->clk;
	dev->events = open->events;
	dev->log = open->log;
	dev->event_source = bb_eventlog_source(open->events, class_name, id);
}

enum bb_status bb_device_fail(struct bb_device *dev, enum bb_status status, const char *op, const char *fmt, ...)
{
	const int os_errno = errno;
	va_list ap;

	dev->failures++;
	dev->last_error.status = status;
	dev->last_error.os_errno = os_errno;
	snprintf(dev->last_error.op, sizeof(dev->last_error.op), "%s", op);
	va_start(ap, fmt);
	vsnprintf(dev->last_error.detail, sizeof(dev->last_error.detail), fmt, ap);
	va_end(ap);
	return status;
}

void bb_device_event(struct bb_device *dev, enum bb_event_kind kind, int64_t at_ns, int64_t a, int64_t b)
{
	bb_eventlog_add(dev->events, dev->event_source, kind, at_ns, a, b);
}
