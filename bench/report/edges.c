/*
 * bench/report/edges.c: edges.csv, a line an edge: what `phase --measured` draws beside the plan. One thread.
 */
#include "bench/file.h"
#include "bench/result.h"

#include <string.h>

#define EDGES_MOST ((size_t)600000) /* as many as a trace has */

static const struct {
	const char *track, *event;
} kinds[BB_TRACK_KIND_COUNT] = { [BB_TRACK_VSYNC] = { "vblank:", "flip" },
	                         [BB_TRACK_SHUTTER] = { "shutter:", "open" },
	                         [BB_TRACK_STROBE] = { "strobe:", "mid" } };

static void put_mark(FILE *f, const struct bb_room *room, const struct bb_mark *m)
{
	static const char *const eyes[] = { "NA", "left", "right" };
	const char *member = bb_result_track_member(room, m);
	const bool glasses = m->track == BB_TRACK_SHUTTER && m->index == BB_STAGE_EMITTER;

	if (m->track >= BB_TRACK_KIND_COUNT || !kinds[m->track].track || !member)
		return;
	fprintf(f, "%lld,%s%s,%s,%s\n", (long long)m->at_ns, glasses ? "" : kinds[m->track].track, member,
	        eyes[m->eye <= BB_EYE_RIGHT ? m->eye : 0], kinds[m->track].event);
}

enum bb_status bb_result_write_edges(const struct bb_run_result *r, const char *path, struct bb_error *err)
{
	const struct bb_mark *mark;
	const size_t n = bb_ledger_marks(r->ledger, &mark);
	struct bb_file f;
	const enum bb_status status = bb_file_begin(&f, path, err);

	if (status)
		return status;
	fputs("t_ns,track,eye,event\n", f.out);
	for (size_t i = 0; i < n && i < EDGES_MOST; i++)
		put_mark(f.out, r->room, &mark[i]);
	return bb_file_commit(&f, err);
}
