/*
 * sim/sim_option.h: numbers from a sim's URI, "sim:?rate_error_ppm=12". A URI option wins over the room file's key of
 * the same name. Stateless.
 */
#ifndef BB_SIM_OPTION_H
#define BB_SIM_OPTION_H

#include "hal/device.h"

struct sim_option { /* a table ends with name == NULL */
	const char *name;
	size_t offset;      /* of a double in the target */
	double least, most;
};
/* BB_ERR_CONFIG with the device's last_error for an unknown option, no number, or one out of range. */
BB_MUST_CHECK enum bb_status sim_options_read(struct bb_device *dev, const struct bb_uri *uri,
                                              const struct sim_option *table, void *target);

#endif
