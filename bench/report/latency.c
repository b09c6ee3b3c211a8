/* bench/report/latency.c: head to photon in the report: the waterfall, its links as a table, the goals, what prediction buys. */
#include "bench/report/html.h"

#include <math.h>

static void put_link(FILE *f, const struct bb_latency_link *k, const struct bb_latency *l)
{
	fputs("<tr>", f);
	bb_cell(f, "w", k->name);
	bb_cell(f, "w", k->owner);
	bb_cell(f, "soft", k->help);
	bb_cell_ms(f, k->summary.mean);
	bb_cell_ms(f, k->summary.p50);
	bb_cell_ms(f, k->summary.p99);
	bb_cell_number(f, round(1000 * k->summary.mean / l->total.mean) / 10);
	bb_cell(f, "w", k->modelled ? "modelled" : "measured");
	bb_cell_ms(f, k->uncertainty_ms);
	fputs("</tr>\n", f);
}

static void put_total(FILE *f, const struct bb_latency *l)
{
	fputs("<tr class=\"sum\">", f);
	bb_cell(f, "w", "total");
	bb_cell(f, NULL, "");
	bb_cell(f, "soft", "middle of the exposure to light of the middle row");
	bb_cell_ms(f, l->total.mean);
	bb_cell_ms(f, l->total.p50);
	bb_cell_ms(f, l->total.p99);
	bb_cell_number(f, 100);
	bb_cell(f, NULL, "");
	bb_cell_ms(f, l->uncertainty_ms);
	fputs("</tr>\n", f);
}

static void put_prediction(FILE *f, const struct bb_prediction *p)
{
	if (!p->n)
		return;
	fprintf(f,
	        "<p>What prediction buys: over a mean horizon of %.1f ms the eyes are %.2f mm and %.2f&deg; rms from the truth at the "
	        "photon; the newest pose as it stands would be %.1f mm and %.2f&deg; off, %.1f and %.1f times as much "
	        "(%zu frames, simulated room).</p>\n",
	        p->horizon_ms, p->with_mm, p->with_deg, p->without_mm, p->without_deg, p->without_mm / p->with_mm,
	        p->without_deg / p->with_deg, p->n);
}

static void put_self_test(FILE *f, const struct bb_latency_test *t)
{
	if (!t->n)
		return;
	fprintf(f,
	        "<p>Self-test: a photodiode saw the patch light up %zu times, %.2f ms after its lamp on average (most %.2f; the wait for an "
	        "exposure included). From the exposure the links add up to %.2f ms; the light came %+.3f ms from there, each time within "
	        "%.3f ms of that.</p>\n",
	        t->n, t->end_ms, t->most_ms, t->links_ms, t->off_ms, t->scatter_ms);
}

void bb_report_latency(FILE *f, const struct bb_run_result *r)
{
	struct bb_latency l;

	if (!bb_latency_of(r, &l) || !l.n)
		return;
	bb_plot_waterfall(f, r, &l);
	fprintf(f,
	        "<p><b>Attack %s</b> Goals: %.1f %% of %zu frames within 50 ms, %.1f %% within 20 ms; exposure, read-out and scan-out "
	        "alone, which the devices' settings fix, take %.1f ms.</p>\n",
	        l.attack, 100 * l.within_50, l.n, 100 * l.within_20, l.floor_ms);
	put_prediction(f, &l.prediction);
	put_self_test(f, &r->latency_test);
	fputs("<table><thead><tr><th>Link</th><th>Owner</th><th>Covers</th><th class=\"n\">Mean, ms</th><th class=\"n\">Median, ms</th>"
	      "<th class=\"n\">p99, ms</th><th class=\"n\">Share, %</th><th>By</th><th class=\"n\">&plusmn;, ms</th></tr></thead><tbody>\n", f);
	for (int i = 0; i < BB_LINK_COUNT; i++)
		put_link(f, &l.link[i], &l);
	put_total(f, &l);
	fputs("</tbody></table>\n", f);
}
