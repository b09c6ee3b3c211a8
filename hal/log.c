#include "hal/log.h"

#include <stdarg.h>
#include <stdio.h>

void bb_log_write(const struct bb_log *log, enum bb_log_level level, enum bb_blame blame, const char *culprit,
                  const char *fmt, ...)
{
	static const char *const words[] = { "bug", "config", "device", "host" };
	char line[512];
	va_list ap;
	int n = snprintf(line, sizeof(line), "%s: %s: ", words[blame], culprit);

	if (n < 0 || (size_t)n >= sizeof(line))
		return;
	va_start(ap, fmt);
	vsnprintf(line + n, sizeof(line) - (size_t)n, fmt, ap);
	va_end(ap);
	log->sink(log->ctx, level, line);
}
