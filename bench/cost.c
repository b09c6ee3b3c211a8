#include "bench/cost.h"

int64_t bb_cost_select_ns(const struct bb_profile *p, const struct bb_stream_counts *c)
{
	return (int64_t)(p->select_per_brick_ns * c->wanted + p->per_byte_ns * (double)c->bytes);
}

int64_t bb_cost_draw_ns(const struct bb_profile *p, const struct bb_stream_counts *c, size_t n_views)
{
	return (int64_t)(p->frame_base_ns + p->per_view_ns * (double)n_views + p->per_ray_ns * (double)c->rays +
	                 p->per_sample_ns * (double)c->samples + p->per_brick_ns * c->resident);
}
