/*
 * hal/log.h: log lines with the culprit first, "device: monitor/left: reply checksum 0x51, want 0x6e (try 2 of 3)".
 * The level is tested before the arguments are evaluated; the sink is a callback so that tests can read what was
 * said. Libraries below bench/ log only what a decision needs; nothing logs between a sync edge and the swap.
 */
#ifndef BB_HAL_LOG_H
#define BB_HAL_LOG_H

#include "hal/status.h"

enum bb_log_level { BB_LOG_ERROR, BB_LOG_WARN, BB_LOG_INFO, BB_LOG_DEBUG };
enum bb_blame { BB_BLAME_BUG, BB_BLAME_CONFIG, BB_BLAME_DEVICE, BB_BLAME_HOST };

typedef void (*bb_log_sink)(void *ctx, enum bb_log_level level, const char *line);

struct bb_log { /* the caller's memory; zero = silent */
	bb_log_sink sink;
	void *ctx;
	enum bb_log_level level;
};

BB_PRINTF(5, 6)
void bb_log_write(const struct bb_log *log, enum bb_log_level level, enum bb_blame blame, const char *culprit,
                  const char *fmt, ...);

#define bb_log(log, lv, blame, culprit, ...)                                                                         \
	do {                                                                                                         \
		if ((log) && (log)->sink && (lv) <= (log)->level)                                                    \
			bb_log_write((log), (lv), (blame), (culprit), __VA_ARGS__);                                  \
	} while (0)

#endif
