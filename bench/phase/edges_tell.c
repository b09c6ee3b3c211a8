#include "bench/phase/edges.h"

#include <math.h>
#include <stdio.h>

#include <jansson.h>

static const char *eye_text(enum bb_eye eye)
{
	return eye == BB_EYE_LEFT ? "left" : eye == BB_EYE_RIGHT ? "right" : "";
}

void bb_phase_edges_print(const struct bb_phase_edges *e, FILE *out)
{
	fprintf(out, "\nmeasured, a cycle of %.2f us that begins with the left edges of %s\n%-32s %8s %10s %16s %12s\n",
	        e->cycle_us, e->reference, "edge", "n", "us", "spread, us", "from plan");
	for (size_t i = 0; i < e->n_groups; i++) {
		const struct bb_phase_group *g = &e->group[i];
		char name[96], from[32] = "";

		snprintf(name, sizeof(name), "%s %s %s", g->track, eye_text(g->eye), g->event);
		if (isfinite(g->planned_us) && g->n)
			snprintf(from, sizeof(from), "%+.1f", bb_phase_off_us(e, g));
		if (bb_phase_loose(e, g))
			fprintf(out, "%-32s %8zu %10s %16s  all over the cycle: not locked\n", name, g->n, "", "");
		else if (g->n)
			fprintf(out, "%-32s %8zu %10.1f %+7.1f %+7.1f %13s\n", name, g->n, g->mean_us, g->least_us,
			        g->most_us, from);
	}
}

json_t *bb_phase_edges_json(const struct bb_phase_edges *e)
{
	json_t *groups = json_array();

	for (size_t i = 0; i < e->n_groups; i++) {
		const struct bb_phase_group *g = &e->group[i];

		json_array_append_new(groups, json_pack("{s:s, s:s, s:s, s:I, s:f, s:f, s:f, s:o}", "track", g->track, "eye",
		                                        eye_text(g->eye), "event", g->event, "n", (json_int_t)g->n,
		                                        "mean_us", g->mean_us, "earliest_us", g->least_us, "latest_us",
		                                        g->most_us, "planned_us",
		                                        isfinite(g->planned_us) ? json_real(g->planned_us) : json_null()));
	}
	return json_pack("{s:f, s:s, s:o}", "cycle_us", e->cycle_us, "reference", e->reference, "edges", groups);
}
