/*
 * render/cpu/options.h: switches of the native caster that a room has no use for, but a bench has.
 */
#ifndef BB_RENDER_CPU_OPTIONS_H
#define BB_RENDER_CPU_OPTIONS_H

#include "render/renderer.h"

struct bb_renderer_cpu_options {
	const char *kernel; /* as in renderer.h */
	unsigned threads;
	bool no_early_exit; /* rays go on behind what is opaque */
	bool no_skipping;   /* empty blocks are sampled like any other */
	/* Pixels in this order (row * width + column), four to a packet, as a frameless renderer would draw them; NULL:
	 * neighbours together, tile by tile. Borrowed; for pictures of n_order pixels only. */
	const uint32_t *order;
	size_t n_order;
};

/* As bb_renderer_cpu_create. BB_ERR_RANGE also from a draw: the picture has another number of pixels than the order. */
BB_MUST_CHECK enum bb_status bb_renderer_cpu_create_with(const struct bb_renderer_cpu_options *options,
							 struct bb_renderer **out, struct bb_error *err);

#endif
