/*
 * tests/fuzz/fuzz_track_record.c: any bytes as a recording of tracking, plain or compressed: what is given is in range,
 * and it ends in an error with a number or in its own end.
 */
#include <math.h>

#include "bench/track_record/record.h"
#include "tests/fuzz/fuzz.h"

static void check(const struct bb_record_head *h, const struct bb_record_item *item)
{
	const struct bb_track_solution *s = &item->pose.solution;

	if (item->kind == BB_RECORD_FRAME) {
		fuzz_must(item->frame.camera < h->n_cameras && item->frame.n <= BB_CAMERA_BLOBS_MAX);
		for (size_t i = 0; i < item->frame.n; i++)
			fuzz_must(isfinite(item->frame.blobs[i].x_px) && isfinite(item->frame.blobs[i].area_px));
	}
	if (item->kind == BB_RECORD_POSE)
		fuzz_must(item->pose.body < h->n_bodies && isfinite(s->body.p.x + s->body.q.w + s->residual_px));
	if (item->kind == BB_RECORD_PAD)
		fuzz_must(item->pad.pad < h->n_pads && fabsf(item->pad.report.axis[5]) <= 1);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bb_record_reader *reader; /* made once */
	struct bb_record_item item = { .kind = BB_RECORD_PAD };
	struct bb_error err = { 0 };
	enum bb_status status = bb_record_open_bytes(data, size, &reader, &err);
	const struct bb_record_head *h = bb_record_head(reader);

	fuzz_must(h->n_cameras <= BB_RECORD_CAMERAS_MAX && h->n_bodies <= BB_BODIES_MAX && h->n_pads <= BB_RECORD_PADS_MAX);
	for (size_t i = 0; i < h->n_bodies; i++)
		fuzz_must(h->body[i].id[0] && strlen(h->body[i].id) < BB_ID_MAX && h->body[i].n_markers <= 6);
	while (status == BB_OK && item.kind != BB_RECORD_END) {
		status = bb_record_next(reader, &item, &err);
		if (status == BB_OK)
			check(h, &item);
	}
	fuzz_must(status == BB_OK || err.number == 1762 || err.number == 1763);
	return 0;
}
