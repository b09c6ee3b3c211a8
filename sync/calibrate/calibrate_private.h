/* sync/calibrate/calibrate_private.h: what the files of a calibration share. */
#ifndef BB_SYNC_CALIBRATE_CALIBRATE_PRIVATE_H
#define BB_SYNC_CALIBRATE_CALIBRATE_PRIVATE_H

#include "sync/calibrate/calibrate.h"
#include "sync/track/lens.h"

#define BB_CALIBRATE_CELLS_X 8
#define BB_CALIBRATE_CELLS_Y 6
#define BB_CALIBRATE_KNOCKS 8 /* cameras, at most */

/* Fills out->bundle's rods, observations and lengths, rod_ns, and the reports' n_pictures. */
BB_MUST_CHECK enum bb_status bb_calibrate_choose(const struct bb_calibrate_config *config, const struct bb_lens *lenses,
                                                 struct bb_calibration *out);
/* Is there a camera whose picture jumped at some time? The worst of those not reported yet, into its report. sigma_px:
 * noise of an observation. */
bool bb_calibrate_find_knock(struct bb_calibration *c, double sigma_px);
/* The camera most of whose markers since its knock are far off or left out; n_cameras: none. A knocked camera whose lens took up what
 * two places could not explain looks like that: then what it saw last is kept, the later half. */
size_t bb_calibrate_find_sick(const struct bb_calibration *c, double sigma_px);
void bb_calibrate_halve(struct bb_calibration *c, size_t camera);
/* When exactly, now that the adjustment is right about what came after: what came before is far off. */
void bb_calibrate_time_knocks(struct bb_calibration *c, double sigma_px);
/* What knocked cameras saw before becomes the cameras after n_cameras, with the same lenses, and counts; false: nobody was
 * knocked. lens_of: n_cameras + BB_CALIBRATE_KNOCKS, the caller's until they are joined. */
bool bb_calibrate_split(struct bb_calibration *c, uint16_t *lens_of);
/* Leaves out all of such a camera when most of it is. */
void bb_calibrate_doubt(struct bb_calibration *c);
/* Undoes it: what was seen before is left out. */
void bb_calibrate_join(struct bb_calibration *c);
/* Moves cameras and rods to where the square says the room is. */
BB_MUST_CHECK enum bb_status bb_calibrate_align(const struct bb_calibrate_config *config, struct bb_calibration *c,
                                                struct bb_error *err);
/* Which of 48 parts of its picture a place lies in. */
unsigned bb_calibrate_cell(const struct bb_camera_config *c, double x_px, double y_px);
double bb_median(double *values, size_t n); /* sorts them; n > 0 */

#endif
