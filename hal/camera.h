/*
 * hal/camera.h: IR tracking cameras: frames of 2-D blobs with an exposure stamp.
 *
 * Camera space: x right, y down, z forward along the optical axis (pixels grow with x and y); the pose maps it to the
 * room. Distortion is radial Brown-Conrady on normalised coordinates: r_d = r (1 + k1 r^2 + k2 r^4).
 * Pixel (0,0) is the centre of the upper left pixel.
 */
#ifndef BB_HAL_CAMERA_H
#define BB_HAL_CAMERA_H

#include "hal/dev_time.h"
#include "hal/device.h"
#include "hal/geometry.h"

enum bb_camera_sync { BB_SYNC_FREE, BB_SYNC_SHUTTERS, BB_SYNC_DISPLAY };

struct bb_camera_config {
	char id[BB_ID_MAX];
	char device[160];          /* URI text */
	struct bb_pose pose;       /* camera space to room */
	int64_t width_px, height_px;
	double fov_deg;            /* horizontal, full angle */
	double k1, k2;
	double fx_px, fy_px, cx_px, cy_px; /* derived from the above by the loader */
	struct bb_rate rate;
	enum bb_camera_sync sync;  /* where the exposures' rhythm comes from */
	double sync_offset_us;     /* exposure start after its sync edge */
	double exposure_us, readout_us;
	double transfer_us, transfer_jitter_us; /* read-out end to host arrival */
	double noise_px;           /* sd of a blob's centre, each axis */
};

struct bb_camera_limits {
	double least_rate_hz, most_rate_hz;
	uint32_t most_blobs;         /* per frame */
	int64_t least_latency_ns;    /* mid-exposure to arrival, at least */
	int64_t stamp_error_ns;      /* mid-exposure stamp, at most */
	double blob_error_px;        /* sd of a blob's centre */
};

struct bb_blob {
	float x_px, y_px, area_px;
};
#define BB_CAMERA_BLOBS_MAX 256

struct bb_camera_frame {
	uint32_t seq;                  /* counts exposures: a gap is a dropped frame */
	struct bb_dev_ns mid_exposure; /* on the camera's clock, unwrapped */
	int64_t arrived_ns;            /* host */
	bool overflow;                 /* more blobs than most_blobs, or than cap */
	struct bb_blob *blobs;         /* the caller's, cap entries */
	size_t cap, n;
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
