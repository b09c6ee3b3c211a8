/*
 * hal/room/calibration.h: the side file in which a room's calibrated cameras stand, and which `calibration: FILE` in the room
 * file names.
 *
 * It belongs to the cameras as the room file plans them: their hash stands in it, and a room whose cameras were changed
 * since is refused (1738) rather than tracked wrongly. Hostile until checked like the room file itself (1737).
 */
#ifndef BB_HAL_ROOM_CALIBRATION_H
#define BB_HAL_ROOM_CALIBRATION_H

#include <stdio.h>

#include "hal/hash.h"
#include "hal/room.h"

/* Of what the room file says about its cameras: ids, pictures, lenses, places. */
void bb_calibration_hash(const struct bb_camera_config *cameras, size_t n, char out[BB_HASH_HEX]);

struct bb_calibration_head {
	char room[64], made[32];          /* the room's name; a date */
	char room_sha256[BB_HASH_HEX];     /* of the room file it was made with */
	char cameras_sha256[BB_HASH_HEX];
	char sequence_sha256[BB_HASH_HEX]; /* of what was recorded; zeros: simulated, or aligned by touch */
	double rms_px;                     /* per coordinate */
	struct bb_pose moved;              /* since the adjustment, by touched points */
};

/* Cameras carry rms_px in calibrated_px. */
void bb_calibration_write(FILE *out, const struct bb_calibration_head *head, const struct bb_camera_config *cameras,
                          size_t n);
/* Replaces pose and lens of every camera; planned: as the room file says. On failure cameras are untouched. */
BB_MUST_CHECK enum bb_status bb_calibration_read(const char *path, struct bb_camera_config *cameras, size_t n,
                                                 struct bb_calibration_head *head, struct bb_error *err);

#endif
