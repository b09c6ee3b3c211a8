/* bench/optics/edges.c: what was measured as a list of edges, for `phase ROOM --measured FILE` to draw beside the plan. */
#include <math.h>
#include <string.h>

#include "bench/file.h"
#include "bench/optics/measure.h"

#define CYCLES 8

static const char *const eyes[2] = { "left", "right" };

/* One edge in each of a few cycles: a list of edges shows no less. */
static void put(FILE *out, const char *track, const char *wall, int eye, const char *event, double at_ns, double cycle_ns)
{
	for (int k = 0; k < CYCLES; k++)
		fprintf(out, "%lld,%s%s,%s,%s\n", llround(at_ns + (k + 1) * cycle_ns), track, wall, eyes[eye], event);
}

static void put_wall(FILE *out, const struct bb_optics_wall *w, const struct bb_display_config *d)
{
	const double cycle = w->cycle_ns.value;

	for (int e = 0; e < 2; e++) {
		const struct bb_optics_band *b = d->scan == BB_SCAN_UP ? &w->band[BB_SPOT_BOTTOM] : &w->band[BB_SPOT_TOP];
		if (!b->white[e].found)
			continue;
		if (d->stereo == BB_STEREO_DUAL_PROJECTOR) {
			put(out, "shutter:", w->id, e, "open", b->white[e].rise_ns.value, cycle);
			put(out, "shutter:", w->id, e, "close", b->white[e].fall_ns.value, cycle);
		} else { /* the first row lights up at the end of vblank, which a sensor does not see begin */
			put(out, "vblank:", w->id, e, "flip", b->white[e].rise_ns.value - bb_display_vblank_us(d) * 1e3, cycle);
		}
	}
}

enum bb_status bb_measure_edges(const struct bb_measure *m, const struct bb_room *room, const char *file,
                                struct bb_error *err)
{
	const struct bb_optics *o = &m->optics;
	struct bb_file f;
	const enum bb_status status = bb_file_begin(&f, file, err);

	if (status != BB_OK)
		return status;
	fputs("t_ns,track,eye,event\n", f.out);
	for (int e = 0; e < 2; e++)
		if (o->has_lens[e]) {
			put(f.out, "glasses", "", e, "open", o->lens[e].rise_ns.value, o->cycle_ns.value);
			put(f.out, "glasses", "", e, "close", o->lens[e].fall_ns.value, o->cycle_ns.value);
		}
	for (size_t i = 0; i < o->n_walls; i++)
		for (size_t s = 0; s < room->n_screens; s++)
			if (!strcmp(room->screens[s].id, o->wall[i].id))
				put_wall(f.out, &o->wall[i], &room->screens[s].display);
	return bb_file_commit(&f, err);
}
