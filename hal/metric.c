#include "hal/metric.h"

#include <string.h>

static const struct bb_metric_info metrics[BB_METRIC_COUNT] = {
#define X(id, name, unit, class, fidelity, help)                                                                    \
	[id] = { name, unit, class, fidelity, help,                                                                   \
		 (id) == BB_METRIC_TRACKED || (id) == BB_METRIC_PSNR || (id) == BB_METRIC_PAD_BATTERY },
	BB_METRIC_LIST(X)
#undef X
};

const char *bb_class_text(enum bb_class c)
{
	static const char *const text[] = { "shutters", "cameras", "displays", "monitors", "power", "gamepads" };

	return (size_t)c < BB_ARRAY_LEN(text) ? text[c] : "none";
}

const struct bb_metric_info *bb_metric_info(enum bb_metric metric)
{
	return &metrics[metric];
}

bool bb_metric_find(const char *name, enum bb_metric *out)
{
	for (int i = 0; i < BB_METRIC_COUNT; i++)
		if (!strcmp(metrics[i].name, name)) {
			*out = (enum bb_metric)i;
			return true;
		}
	return false;
}

const char *bb_stat_text(enum bb_stat stat)
{
	static const char *const text[] = { "p50", "p99", "max", "max_abs", "mean", "min", "rms" };

	return (size_t)stat < BB_ARRAY_LEN(text) ? text[stat] : "?";
}
