/*
 * hal/camera.h: IR tracking cameras: frames of 2-D blobs with an exposure stamp.
 *
 * Camera space: x right, y down, z forward along the optical axis (pixels grow with x and y); the pose maps it to the
 * room. Pixel (0,0) is the centre of the upper left pixel.
 *
 * Lenses, on x = X / Z, y = Y / Z and r^2 = x^2 + y^2:
 *   Brown-Conrady (Brown 1966): f = 1 + k1 r^2 + k2 r^4 + k3 r^6,
 *     x_d = x f + 2 p1 x y + p2 (r^2 + 2 x^2),  y_d = y f + p1 (r^2 + 2 y^2) + 2 p2 x y;
 *   fisheye (Kannala and Brandt 2006, eq. 6 with odd powers): theta = atan(r),
 *     theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), (x_d, y_d) = theta_d / r (x, y).
 */
#ifndef BB_HAL_CAMERA_H
#define BB_HAL_CAMERA_H

#include "hal/dev_time.h"
#include "hal/device.h"
#include "hal/geometry.h"

enum bb_lens_kind { BB_LENS_BROWN, BB_LENS_FISHEYE };
enum bb_camera_sync { BB_SYNC_FREE, BB_SYNC_SHUTTERS, BB_SYNC_DISPLAY };

struct bb_camera_config {
	char id[BB_ID_MAX];
	char device[160];          /* URI text */
	struct bb_pose pose;       /* camera space to room */
	int64_t width_px, height_px;
	double fov_deg;            /* horizontal, full angle */
	enum bb_lens_kind lens;
	double k1, k2, k3, k4;     /* k4: fisheye only */
	double p1, p2;             /* Brown-Conrady only */
	double fx_px, fy_px, cx_px, cy_px; /* derived from the above by the loader */
	struct bb_rate rate;
	enum bb_camera_sync sync;  /* where the exposures' rhythm comes from */
	double sync_offset_us;     /* exposure start after its sync edge */
	double exposure_us, readout_us;
	double row_us;             /* a rolling shutter's rows expose this long after one another; 0: all at once */
	double transfer_us, transfer_jitter_us; /* read-out end to host arrival */
	double noise_px;           /* sd of a blob's centre, each axis */
	double calibrated_px;      /* rms its calibration left over, each axis; 0: pose and lens are as planned */
};

struct bb_camera_limits {
	double least_rate_hz, most_rate_hz;
	uint32_t most_blobs;         /* per frame */
	int64_t least_latency_ns;    /* mid-exposure to arrival, at least */
	int64_t stamp_error_ns;      /* mid-exposure stamp, at most */
	double blob_error_px;        /* sd of a blob's centre */
	bool grey;                   /* it delivers pictures; whoever reads them looks for the blobs */
	double black, black_noise;   /* grey: level of a dark pixel, and its sd */
};

struct bb_blob {
	float x_px, y_px, area_px;
};
#define BB_CAMERA_BLOBS_MAX 256

struct bb_camera_frame {
	uint32_t seq;                  /* counts exposures: a gap is a dropped frame */
	struct bb_dev_ns mid_exposure; /* of its middle row, on the camera's clock, unwrapped */
	int64_t arrived_ns;            /* host */
	bool overflow;                 /* more blobs than most_blobs, or than cap */
	struct bb_blob *blobs;         /* the caller's, cap entries */
	size_t cap, n;
	uint8_t *grey;                 /* the caller's, width_px * height_px without gaps; NULL: no picture wanted */
	bool has_grey;                 /* a picture was written there, and n is 0 */
};

struct bb_camera; /* opaque */
struct bb_camera_driver;

BB_MUST_CHECK enum bb_status bb_camera_open(const struct bb_camera_driver *driver, const struct bb_camera_config *config,
                                            const struct bb_open *open, struct bb_camera **out);
void bb_camera_close(struct bb_camera *cam);
const struct bb_camera_limits *bb_camera_limits(const struct bb_camera *cam);
BB_MUST_CHECK enum bb_status bb_camera_start(struct bb_camera *cam);
BB_MUST_CHECK enum bb_status bb_camera_stop(struct bb_camera *cam);
/* The oldest frame not read yet; BB_TIMEOUT when there is none; BB_ERR_LOST when the camera is gone. */
BB_MUST_CHECK enum bb_status bb_camera_read(struct bb_camera *cam, struct bb_camera_frame *frame);
/* Exposure time and offset to the sync edge; BB_ERR_RANGE outside what the device can do. */
BB_MUST_CHECK enum bb_status bb_camera_set_exposure(struct bb_camera *cam, int64_t exposure_ns, int64_t offset_ns);
struct bb_device *bb_camera_device(struct bb_camera *cam);

#endif
