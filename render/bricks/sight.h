/*
 * render/bricks/sight.h: what a node of the octree is worth to the eyes in a room: nothing when no view can see it,
 * more when its voxels are large in one of the pictures, less when what lies in front of it hid it in the last frame.
 * All views of a render node (each wall, both eyes) are asked at once, so that they can share one selection of bricks.
 *
 * A node is taken as the box it fills, half of one of its own voxels around it included (interpolation reaches so far);
 * on a spherical grid as the box around its part of the ball. The answer is conservative: a node that can be seen is
 * never called hidden. Where a volume stands, and what a spherical grid's axes are: as render/atlas.h says.
 *
 * Pure; no allocation. A prepared sight is constant and may be asked from many threads.
 */
#ifndef BB_RENDER_BRICKS_SIGHT_H
#define BB_RENDER_BRICKS_SIGHT_H

#include "render/bricks/format.h"
#include "render/view.h"

#define BB_SIGHT_PIXELS_MOST 64.0 /* a voxel of the data is not worth more, however near it is */
#define BB_SIGHT_SEEN_LEAST \
	0.0625 /* what is left of the worth of a node that was hidden: it must be able to come back */

struct bb_sight_frustum {               /* of a view, in the volume's own space (metres, centred) */
	double side[4][4];              /* inward planes through the eye: a x + b y + c z + d >= 0 inside */
	double depth[4];                /* metres in front of the eye, along the wall's normal */
	double eye[3], low[3], high[3]; /* low, high: the whole frustum lies between */
	double near_m, least_cosine;    /* between a line of sight and the normal */
	double pixels;                  /* of a segment of 1 m, parallel to the wall, at a depth of 1 m */
};

struct bb_sight {
	const struct bb_tree *tree;
	enum bb_brick_grid grid;
	double from[3], voxel[3]; /* Cartesian: corner and voxel in metres. Spherical: m, rad, rad */
	double scale[3];          /* spherical: the ball's radii, if size_m is not a cube, over the largest */
	const struct bb_sight_frustum *frusta;
	size_t n_frusta;
	const float *seen;
};

struct bb_sight_view {
	const struct bb_view *view;
	uint32_t width_px, height_px;
};

/*
 * pose and size_m: the volume's placement. extent: of a spherical grid, as in bb_bricks_header; else not read. frusta:
 * n_views of them, filled in here; they, tree and seen are borrowed for as long as the sight is used. seen: NULL, or
 * for each node of the tree (bb_sight_seen) the share of light that reached it in the last frame.
 */
void bb_sight_prepare(const struct bb_tree *tree, enum bb_brick_grid grid, const double extent[6],
		      const struct bb_pose *pose, struct bb_vec3 size_m, const struct bb_sight_view *views,
		      size_t n_views, const float *seen, struct bb_sight_frustum *frusta, struct bb_sight *out);

/*
 * Pixels that one of the node's voxels is wide, in the view where that is most; 0: no view sees the node. At most
 * BB_SIGHT_PIXELS_MOST for a voxel of the data, twice as much for each level above. At least twice the pixels of any of
 * its children.
 */
float bb_sight_pixels(const struct bb_sight *s, uint32_t node);

/*
 * What to multiply the gain of a split with: the area in pixels of a voxel of the data there (an error that many more
 * pixels show is that much worse), by the share of light that reaches the node. 0, and with it for all its descendants,
 * when nobody sees the node, or when its voxels are no wider than a pixel: a finer picture would look the same.
 * At least that of any of its children.
 */
float bb_sight_weight(const struct bb_sight *s, uint32_t node);

/* Of every node, [n_nodes]: for bb_choose_by_budget. Asks no view about what lies below a node that is worth nothing.
 */
void bb_sight_weights(const struct bb_sight *s, float *out);

/*
 * A renderer fills the leaves, seen[first[n_levels - 1]...], with the largest share of light (0..1) any ray still had
 * when it entered the node's cell, 0 where none did; this gives every node above the largest of its descendants.
 */
void bb_sight_seen(const struct bb_tree *tree, float *seen);

#endif
