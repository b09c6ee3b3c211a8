/*
 * sync/blobs/blobs.h: bright spots in 8-bit camera pictures, to a few hundredths of a pixel.
 *
 * One pass over the rows: pixels of at least `low` form runs, runs that touch (8 neighbours) form parts by union-find,
 * and a part that reaches `high` somewhere and passes the gates of area and roundness is a spot (hysteresis). Its
 * centre is the centroid over grey levels above low - 1; a spot that stands alone and is not saturated gets one step of
 * least squares towards a Gaussian of its own width on its local background, which comes within 1.1 times the
 * Cramer-Rao bound (tests/test_blobs.c). Spots cut by the picture's border are no spots.
 *
 * Work and memory are bounded whatever the picture shows: at most most_runs runs are followed and most_spots spots
 * kept; what is left is not looked at and `overflow` says so. All memory is taken at creation. One thread per finder.
 * Whichever instructions look for bright pixels, the same bytes come out. Pixel (0,0) is the centre of the upper left.
 */
#ifndef BB_SYNC_BLOBS_BLOBS_H
#define BB_SYNC_BLOBS_BLOBS_H

#include "hal/camera.h"

#define BB_BLOBS_EDGE_MAX 16384 /* pixels of a picture's edge */

struct bb_blobs_config {
	int low, high;             /* grey levels, 1 <= low <= high <= 255 */
	double black;              /* of a dark pixel; < low */
	double least_area_px, most_area_px; /* pixels of at least low */
	double least_roundness;    /* lesser over greater standard deviation of the light, 0..1 */
	size_t most_spots;         /* a picture, and parts under way at a time; 1..65536 */
	size_t most_runs;          /* a picture */
	bool refine;
	const char *kernel;        /* NULL: the best here; "avx512", "avx2", "portable" */
};
/* low 14, high 28, black 4, 3 to 2000 px, roundness 0.5, 256 spots, 16384 runs, refined. */
struct bb_blobs_config bb_blobs_usual(void);
/* The same for a camera whose dark pixels have another level and noise (sd): low 10 levels above black or 3 sds, high 24
 * or 6. Nobody can look where that is past 255, and bb_blob_finder_create says so. */
struct bb_blobs_config bb_blobs_above(double black, double noise);

enum bb_spot_flags {
	BB_SPOT_SATURATED = 1, /* a pixel is 255: the centroid is all there is */
	BB_SPOT_REFINED = 2
};
struct bb_spot {
	double x_px, y_px;
	double area_px, light;  /* pixels of at least low, and the sum of their levels above low - 1 */
	double sigma_px;        /* of a round Gaussian of this area and light; 0 where there is none */
	double xx, xy, yy;      /* central second moments of the light above low - 1, px^2 */
	double roundness;
	int peak;               /* grey level of its brightest pixel */
	unsigned flags;
};
struct bb_blobs_found {
	size_t n;        /* spots written */
	size_t runs;     /* followed */
	size_t refused;  /* parts that failed a gate */
	bool overflow;   /* runs, parts, spots or cap ran out: the rest of the picture is not in */
};

struct bb_blob_finder;
/* BB_ERR_RANGE: the configuration or the size, 1..BB_BLOBS_EDGE_MAX each; BB_ERR_UNSUPPORTED: the kernel. */
BB_MUST_CHECK enum bb_status bb_blob_finder_create(const struct bb_blobs_config *config, int64_t width_px,
                                                   int64_t height_px, struct bb_blob_finder **out);
void bb_blob_finder_destroy(struct bb_blob_finder *f);
const char *bb_blob_finder_kernel(const struct bb_blob_finder *f);
/* Rows of width_px bytes, stride_bytes (>= width_px) apart. Spots in the order in which they end, from the top. */
struct bb_blobs_found bb_blobs_find(struct bb_blob_finder *f, const uint8_t *grey, size_t stride_bytes,
                                    struct bb_spot *out, size_t cap);
/* What a camera that finds its own blobs would say of a spot. */
struct bb_blob bb_spot_blob(const struct bb_spot *spot);

#endif
