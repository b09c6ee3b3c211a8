#include "bench/backends.h"

#include <stdio.h>
#include <string.h>

#include "drivers/power_modbus.h"
#include "sim/sim.h"

static const struct bb_backend backends[] = {
	/* first: a room without wires must never touch hardware */
	{ "sim", "models in this process", &sim_shutter_driver, &sim_camera_driver, &sim_display_driver,
	  &sim_monitor_driver, &sim_power_driver, &sim_gamepad_driver, &sim_link_driver },
	{ .scheme = "modbus", .help = "power strips on Modbus TCP and RTU", .power = &power_modbus_driver },
};

const struct bb_backend *bb_backend(size_t i)
{
	return i < BB_ARRAY_LEN(backends) ? &backends[i] : NULL;
}

const struct bb_backend *bb_backend_find(const struct bb_uri *uri, const char *device, struct bb_error *err)
{
	char known[120] = "";

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		const size_t n = strlen(known);
		if (!strcmp(backends[i].scheme, uri->scheme))
			return &backends[i];
		snprintf(known + n, sizeof(known) - n, "%s%s:", i ? ", " : "", backends[i].scheme);
	}
	bb_fail(err, BB_ERR_CONFIG, 1502, NULL, "%s asks for '%s:', this build has %s", device, uri->scheme, known);
	return NULL;
}
