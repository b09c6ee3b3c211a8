/*
 * bench/report/streaming.c: a volume under its budgets: by node what was held, read, missing and late, then every frame
 * over time, and what could not be read.
 */
#include "bench/report/html.h"

#include "bench/file.h"

#include <stdarg.h>

#define MIB 1048576.0

static double mean(const struct bb_stream_total *t, const struct bb_stream_node *n)
{
	return (double)t->sum / (double)n->frames;
}

BB_PRINTF(2, 3)
static void number_cell(FILE *f, const char *fmt, ...)
{
	char text[64];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	bb_cell(f, "n", text);
}

static void put_node(FILE *f, const struct bb_run_result *r, size_t i)
{
	const struct bb_stream_result *s = &r->streaming;
	const struct bb_stream_node *n = &s->nodes[i];
	char text[32];

	fputs("<tr>", f);
	bb_cell(f, "w", r->room->nodes[i].id);
	bb_text_format(text, sizeof(text), "of %.4g", (double)n->budget_bytes / MIB);
	number_cell(f, "%.2f", (double)n->held_bytes / MIB);
	bb_cell(f, "u", n->budget_bytes ? text : "no limit");
	number_cell(f, "%.1f", mean(&n->loaded, n));
	number_cell(f, "%llu", (unsigned long long)n->loaded.most);
	bb_text_format(text, sizeof(text), "of %u", n->budget_bricks);
	bb_cell(f, "u", n->budget_bricks ? text : "no limit");
	number_cell(f, "%.1f", mean(&n->bytes, n) / 1024);
	number_cell(f, "%.1f", (double)n->bytes.most / 1024);
	number_cell(f, "%.0f", mean(&n->drawn, n));
	number_cell(f, "%.1f", mean(&n->missing, n));
	number_cell(f, "%llu", (unsigned long long)n->missing.most);
	number_cell(f, "%.1f", mean(&n->deficit, n));
	number_cell(f, "%llu", (unsigned long long)n->deficit.most);
	number_cell(f, "%.3f", n->most.ms);
	number_cell(f, "%.1f %%", 100 * n->most.ms / s->limit_ms);
	bb_cell_count(f, n->late);
	bb_cell_count(f, n->evicted);
	bb_cell_count(f, n->failed);
	fputs("</tr>\n", f);
}

static void put_nodes(FILE *f, const struct bb_run_result *r)
{
	fputs("<table class=\"tight\"><thead><tr class=\"over\"><th></th><th colspan=\"2\" class=\"n\">Memory held, MiB</th>"
	      "<th colspan=\"3\" class=\"n\">Bricks read a frame</th><th colspan=\"2\" class=\"n\">KiB a frame</th>"
	      "<th class=\"n\">Drawn</th><th colspan=\"2\" class=\"n\">Missing</th><th colspan=\"2\" class=\"n\">Coarser "
	      "cells</th><th colspan=\"2\" class=\"n\">Most on bricks</th><th class=\"n\">Late</th><th class=\"n\">Bricks</th>"
	      "<th class=\"n\">Not</th></tr>\n<tr><th>Node</th><th class=\"n\">most</th><th class=\"u\">budget</th>"
	      "<th class=\"n\">mean</th><th class=\"n\">most</th><th class=\"u\">budget</th><th class=\"n\">mean</th>"
	      "<th class=\"n\">most</th><th class=\"n\">mean</th><th class=\"n\">mean</th><th class=\"n\">most</th>"
	      "<th class=\"n\">mean</th><th class=\"n\">most</th><th class=\"n\">ms</th><th class=\"n\">of limit</th>"
	      "<th class=\"n\">for it</th><th class=\"n\">replaced</th><th class=\"n\">readable</th></tr></thead><tbody>\n",
	      f);
	for (size_t i = 0; i < r->streaming.n_nodes; i++)
		if (r->streaming.nodes[i].frames)
			put_node(f, r, i);
	fputs("</tbody></table>\n", f);
}

static void put_lead(FILE *f, const struct bb_run_result *r)
{
	const struct bb_stream_result *s = &r->streaming;
	uint64_t budget = UINT64_MAX;

	for (size_t i = 0; i < s->n_nodes; i++)
		if (s->nodes[i].frames && s->nodes[i].budget_bytes && s->nodes[i].budget_bytes < budget)
			budget = s->nodes[i].budget_bytes;
	fputs("<p class=\"lead\">", f);
	bb_put_markupf(f, "The data has %.4g MiB of values", (double)s->data_bytes / MIB);
	if (budget != UINT64_MAX)
		bb_put_markupf(f, ", %.3g times what a node may hold (%.4g MiB of bricks with all that belongs to them)",
		               (double)s->data_bytes / (double)budget, (double)budget / MIB);
	bb_put_markupf(f, "; one brick takes %.4g KiB, and one step at full resolution has %llu of them. No frame waits for the "
	               "disk: a brick that is not here is drawn from a coarser one.",
	               (double)s->brick_bytes / 1024, (unsigned long long)s->leaf_cells);
	fputs("</p>\n", f);
}

/* What could not be read, and values that were cut. */
static void put_trouble(FILE *f, const struct bb_run_result *r)
{
	const struct bb_stream_result *s = &r->streaming;

	for (size_t i = 0; i < s->n_nodes; i++) {
		const struct bb_stream_node *n = &s->nodes[i];
		if (n->failed) {
			fputs("<p class=\"note FAIL\"><b>", f);
			bb_put_markupf(f, "node/%s: %llu brick%s could not be read", r->room->nodes[i].id,
			               (unsigned long long)n->failed, n->failed == 1 ? "" : "s");
			fputs("</b>, coarser ones are drawn instead. The last one: <span class=\"mono\">", f);
			bb_put_markup(f, n->error_text);
			fputs("</span></p>\n", f);
		}
		if (n->odd)
			bb_put_markupf(f, "node/%s: %llu values out of range were cut. ", r->room->nodes[i].id,
			               (unsigned long long)n->odd);
	}
}

void bb_report_streaming(FILE *f, const struct bb_run_result *r)
{
	char sentence[256];
	uint64_t late = 0;

	for (size_t i = 0; i < r->streaming.n_nodes; i++)
		late += r->streaming.nodes[i].late;
	put_lead(f, r);
	bb_result_loads(r, sentence, sizeof(sentence));
	if (sentence[0] >= 'a' && sentence[0] <= 'z')
		sentence[0] = (char)(sentence[0] - 'a' + 'A');
	fprintf(f, "<p class=\"note %s\">", late ? "FAIL" : "PASS");
	bb_put_markup(f, sentence);
	fprintf(f, ".%s</p>\n", r->streaming.measured ? " Measured: selecting, and taking over what the disk has given; what a GL "
	        "library uploads is part of drawing." : "");
	put_nodes(f, r);
	fputs("<p class=\"soft small\">Missing: bricks of the plan that are not here yet, for both steps on show alike. Coarser "
	      "cells: the parts of the volume they stand for, in bricks of full resolution, once for each step.</p>\n", f);
	put_trouble(f, r);
	bb_plot_streaming(f, r);
}
