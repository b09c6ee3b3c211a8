/*
 * bench/report/html.c: the page: head, verdict banner and the order of the sections, most important first.
 */
#include "bench/report/html.h"

#include "bench/file.h"
#include "bench/stats.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

const struct bb_budget_result *bb_report_budget(const struct bb_run_result *r, enum bb_metric metric)
{
	for (size_t i = 0; i < r->n_budgets; i++)
		if (r->budgets[i].budget.metric == metric)
			return &r->budgets[i];
	return NULL;
}

double bb_report_limit(const struct bb_run_result *r, enum bb_metric metric)
{
	const struct bb_budget_result *b = bb_report_budget(r, metric);

	return b ? b->budget.limit : BB_UNKNOWN;
}

const char *bb_report_unit(const char *unit)
{
	if (!strcmp(unit, "percent"))
		return "%";
	if (!strcmp(unit, "us"))
		return "\xC2\xB5s";
	return !strcmp(unit, "db") ? "dB" : !strcmp(unit, "count") ? "" : unit;
}

static void put_head(FILE *f, const struct bb_run_result *r)
{
	/* The policy is the promise that this page loads nothing, kept by the browser. */
	fputs("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
	      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
	      "style-src 'unsafe-inline'\">\n"
	      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
	      "<link rel=\"icon\" href=\"data:,\">\n<title>",
	      f);
	bb_put_markupf(f, "%s: %s x %s", bb_verdict_text(r->verdict), r->room->name, r->scene->name);
	fprintf(f, "</title>\n<style>\n%s</style>\n</head>\n<body>\n", bb_report_style);
}

static void put_key(FILE *f, const char *name, const char *value)
{
	fputs("<div><dt>", f);
	bb_put_markup(f, name);
	fputs("</dt><dd>", f);
	bb_put_markup(f, value);
	fputs("</dd></div>", f);
}

static const char *sentence_of(const struct bb_run_result *r)
{
	const char *colon = strchr(r->summary, ':');

	return colon ? colon + 2 : r->summary;
}

static size_t devices_in_use(const struct bb_run_result *r)
{
	size_t n = 0;

	for (size_t i = 0; i < r->n_devices; i++)
		n += r->devices[i].fidelity != BB_NOT_NEEDED;
	return n;
}

static void put_keys(FILE *f, const struct bb_run_result *r)
{
	const struct bb_frame_row *row;
	char text[64];

	fputs("<dl class=\"key\">", f);
	bb_text_format(text, sizeof(text), "%.4g s%s", r->duration_s, r->truncated ? " (interrupted)" : "");
	put_key(f, "Duration", text);
	bb_text_format(text, sizeof(text), "%zu", bb_ledger_rows(r->ledger, &row));
	put_key(f, "Frames", text);
	bb_text_format(text, sizeof(text), "%zu of %zu", devices_in_use(r), r->n_devices);
	put_key(f, "Devices in use", text);
	bb_text_format(text, sizeof(text), "%llu", (unsigned long long)r->n_events);
	put_key(f, "Events", text);
	put_key(f, "Clock", r->clock);
	bb_text_format(text, sizeof(text), "%llu", (unsigned long long)r->seed);
	put_key(f, "Seed", text);
	bb_text_format(text, sizeof(text), "%.12s", r->event_log_sha256);
	put_key(f, "Event log", text);
	fputs("</dl>\n", f);
}

static void put_banner(FILE *f, const struct bb_run_result *r)
{
	const char *verdict = bb_verdict_text(r->verdict);

	fputs("<header class=\"top\"><div><h1>", f);
	bb_put_markup(f, r->room->name);
	fputs(" <span>&times;</span> ", f);
	bb_put_markup(f, r->scene->name);
	fputs("</h1></div><div class=\"brand\">blackburst</div></header>\n", f);
	fprintf(f, "<div class=\"banner %s\"><div class=\"word\">%s</div><div class=\"sentence\">", verdict, verdict);
	bb_put_markup(f, sentence_of(r));
	fputs("</div></div>\n", f);
	put_keys(f, r);
	if (bb_ledger_dropped(r->ledger))
		fprintf(f,
		        "<p class=\"lead small\">%llu records did not fit into the ledger: minima, maxima and means "
		        "are "
		        "exact, percentiles speak for the rest.</p>\n",
		        (unsigned long long)bb_ledger_dropped(r->ledger));
}

static void begin(FILE *f, const char *id, const char *title, const char *lead)
{
	fprintf(f, "<section id=\"%s\"><h2>%s</h2>\n", id, title);
	if (lead)
		fprintf(f, "<p class=\"lead\">%s</p>\n", lead);
}

static void end(FILE *f)
{
	fputs("</section>\n", f);
}

static void put_navigation(FILE *f, const struct bb_run_result *r)
{
	fprintf(f, "<nav><a href=\"#verdicts\">Verdicts</a><a href=\"#trouble\">Incidents</a><a href=\"#latency\">Latency</a>"
	        "<a href=\"#time\">Over time</a>%s<a href=\"#room\">Room</a><a href=\"#pictures\">Pictures</a>"
	        "<a href=\"#devices\">Devices</a><a href=\"#counters\">Counters</a>"
	        "<a href=\"#configuration\">Configuration</a><a href=\"#versions\">Versions</a></nav>\n",
	        r->streaming.n_nodes ? "<a href=\"#streaming\">Streaming</a>" : "");
}

static void put_latency(FILE *f, const struct bb_run_result *r)
{
	begin(f, "latency", "Where the time goes",
	      "From the middle of a camera's exposure to light through an open shutter, stage by stage.");
	bb_report_latency(f, r);
	fputs("<h3>All spans of all nodes</h3>\n", f);
	bb_report_stages(f, r);
	fputs("<div class=\"two\">", f);
	bb_plot_distribution(f, r, BB_METRIC_HEAD_TO_PHOTON, "Head to photon");
	bb_plot_distribution(f, r, BB_METRIC_FRAME, "Frame time, all nodes");
	fputs("</div>\n", f);
	bb_report_nodes(f, r);
	end(f);
}

static void put_room(FILE *f, const char *room_svg)
{
	begin(f, "room", "The room", "Plan and side view, with the path the head took.");
	/* bb_report_room_svg: the drawing comes from bench/report/room_drawing.h through the caller. */
	fputs(room_svg ? room_svg : "<p class=\"soft\">No drawing was made for this run.</p>", f);
	end(f);
}

static void put_page(FILE *f, const struct bb_run_result *r, const char *dir, const char *room_svg)
{
	put_head(f, r);
	put_banner(f, r);
	put_navigation(f, r);
	begin(f, "verdicts", "Verdicts", NULL);
	bb_report_verdicts(f, r);
	end(f);
	begin(f, "trouble", "Incidents and planted faults", NULL);
	bb_report_trouble(f, r);
	end(f);
	put_latency(f, r);
	begin(f, "time", "Over time",
	      "Every frame, in seconds of the scene. Dashed: the limit; tinted: an incident; arrow: a planted fault.");
	bb_plot_series(f, r);
	end(f);
	if (r->streaming.n_nodes) {
		begin(f, "streaming", "Streaming", NULL);
		bb_report_streaming(f, r);
		end(f);
	}
	put_room(f, room_svg);
	begin(f, "pictures", "Pictures",
	      "Left and right eye of each wall, with PSNR against full resolution where it was measured.");
	bb_report_pictures(f, r, dir);
	end(f);
	begin(f, "devices", "Devices", NULL);
	bb_report_devices(f, r);
	end(f);
	begin(f, "counters", "Counters",
	      "Exact on the virtual clock: the same room, scene, seed and build give the same numbers.");
	bb_report_counters(f, r);
	end(f);
	begin(f, "configuration", "Configuration", NULL);
	bb_report_configuration(f, r);
	end(f);
	begin(f, "versions", "Versions and facts", NULL);
	bb_report_facts(f, r);
	end(f);
	fputs("<footer>Derived from result.json of the same folder, which is the master. Times count from the start of "
	      "the "
	      "scene.</footer>\n</body>\n</html>\n",
	      f);
}

enum bb_status bb_report_html_write(const struct bb_run_result *r, const char *dir, const char *path,
                                    const char *room_svg, struct bb_error *err)
{
	struct bb_file f;
	enum bb_status st = bb_file_begin(&f, path, err);

	if (st != BB_OK)
		return st;
	put_page(f.out, r, dir, room_svg);
	return bb_file_commit(&f, err);
}
