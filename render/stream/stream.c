#include "render/stream/stream.h"

enum bb_status bb_stream_create(const struct bb_stream_config *config, struct bb_stream **out, struct bb_error *err)
{
	(void)config;
	*out = NULL;
	return bb_fail(err, BB_ERR_UNSUPPORTED, 1702, NULL, "under construction");
}
void bb_stream_destroy(struct bb_stream *s) { (void)s; }
struct bb_stream_counts bb_stream_frame(struct bb_stream *s, const struct bb_stream_frame *frame)
{ (void)s; (void)frame; return (struct bb_stream_counts){ 0 }; }
unsigned bb_stream_settle(struct bb_stream *s, const struct bb_stream_frame *frame) { (void)s; (void)frame; return 0; }
struct bb_layer bb_stream_layer(const struct bb_stream *s) { (void)s; return (struct bb_layer){ 0 }; }
const struct bb_atlas *bb_stream_atlas(const struct bb_stream *s) { (void)s; return NULL; }
