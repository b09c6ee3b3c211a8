/* sim/sim_option.c: see sim/sim_option.h. */
#include "sim/sim_option.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static enum bb_status read_one(struct bb_device *dev, const char *key, const char *value,
                               const struct sim_option *table, void *target)
{
	char *end;

	for (const struct sim_option *o = table; o->name; o++) {
		if (strcmp(o->name, key))
			continue;
		const double number = strtod(value, &end);
		if (!*value || *end || !isfinite(number) || number < o->least || number > o->most)
			return bb_device_fail(dev, BB_ERR_CONFIG, "open", "%s=%s is not in %g..%g", key, value,
			                      o->least, o->most);
		memcpy((char *)target + o->offset, &number, sizeof(number));
		return BB_OK;
	}
	return bb_device_fail(dev, BB_ERR_CONFIG, "open", "sim has no option \"%s\"", key);
}

enum bb_status sim_options_read(struct bb_device *dev, const struct bb_uri *uri, const struct sim_option *table,
                                void *target)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; uri && i < uri->n_options && status == BB_OK; i++)
		status = read_one(dev, uri->option[i].key, uri->option[i].value, table, target);
	return status;
}
