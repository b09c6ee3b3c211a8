/* bench/optics/plot.c: the lenses and every wall over one cycle of both eyes, with the edges that were found. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/optics/measure.h"
#include "bench/report/chart.h"
#include "bench/report/drawing_page.h"

#define WIDTH 1060.0
#define PANEL 230.0
#define HEAD 64.0
#define WALLS_MOST 8
#define POINTS 1024
#define CURVES 4
#define EDGES 4

struct panel {
	struct chart chart;
	struct chart_series series[CURVES + EDGES];
	struct chart_label label[EDGES];
	double x[POINTS], y[CURVES][POINTS], edge_x[EDGES][2], edge_y[EDGES][2];
	char title[80];
	double cycle_ms, most;
};
struct page {
	const struct bb_measure *m;
	size_t n;
	struct panel panel[WALLS_MOST + 1];
};

static const struct pen_colour left_eye = { 0.14, 0.32, 0.48, 1 }, right_eye = { 0.72, 0.44, 0.12, 1 },
                               leak = { 0.70, 0.15, 0.12, 1 };

static int find(const struct bb_recording *r, const char *wall, int spot, int lens)
{
	for (size_t i = 0; i < r->n_channels; i++)
		if (!strcmp(r->channel[i].wall, wall) && r->channel[i].spot == spot && r->channel[i].lens == lens)
			return (int)i;
	return -1;
}

static void curve(const struct bb_measure *m, struct panel *p, int channel, enum bb_pattern pattern, const char *name,
                  struct pen_colour colour, bool dashed)
{
	const size_t i = p->chart.n_series;

	if (channel < 0 || !bb_analyser_wave(m->analyser, (size_t)channel, pattern, p->y[i], POINTS))
		return;
	for (size_t k = 0; k < POINTS; k++)
		p->most = fmax(p->most, isfinite(p->y[i][k]) ? p->y[i][k] : 0);
	p->series[p->chart.n_series++] = (struct chart_series){ .name = name, .colour = colour, .x = p->x, .y = p->y[i],
		                                                .n = POINTS, .width = 1.1, .dashed = dashed };
}

static void edge(struct panel *p, size_t *n, double at_ns, const char *word, struct pen_colour colour)
{
	const double x = at_ns * 1e-6;
	struct chart_label *l = &p->label[*n];

	p->edge_x[*n][0] = p->edge_x[*n][1] = x;
	p->edge_y[*n][0] = 0;
	p->edge_y[*n][1] = p->most * 1.04;
	p->series[p->chart.n_series++] = (struct chart_series){ .colour = pen_alpha(colour, 0.7), .x = p->edge_x[*n],
		                                                .y = p->edge_y[*n], .n = 2, .width = 0.8, .dashed = true };
	*l = (struct chart_label){ .x = x, .y = p->most * 1.04 };
	snprintf(l->text, sizeof(l->text), "%s %.3f ms", word, x);
	++*n;
}

static void edges(struct panel *p, const struct bb_pulse pulse[2], const char *on, const char *off)
{
	size_t n = 0;

	for (int e = 0; e < 2; e++) {
		if (!pulse[e].found)
			continue;
		edge(p, &n, pulse[e].rise_ns.value, on, e ? right_eye : left_eye);
		edge(p, &n, pulse[e].fall_ns.value, off, e ? right_eye : left_eye);
	}
	p->chart.labels = p->label;
	p->chart.n_labels = n;
}

static struct panel *begin(struct page *page, double cycle_ns)
{
	struct panel *p = &page->panel[page->n++];

	p->chart = (struct chart){ .title = p->title, .x_title = "ms in a cycle", .y_title = "volts", .series = p->series };
	for (size_t k = 0; k < POINTS; k++)
		p->x[k] = ((double)k + 0.5) / POINTS * cycle_ns * 1e-6;
	return p;
}

static void lenses(struct page *page)
{
	const struct bb_measure *m = page->m;
	struct panel *p = begin(page, m->optics.cycle_ns.value);

	snprintf(p->title, sizeof(p->title), "lenses before a lamp");
	curve(m, p, find(&m->recording, "", BB_SPOT_LAMP, BB_LENS_LEFT), BB_PATTERN_WHITE_WHITE, "left", left_eye, false);
	curve(m, p, find(&m->recording, "", BB_SPOT_LAMP, BB_LENS_RIGHT), BB_PATTERN_WHITE_WHITE, "right", right_eye, false);
	edges(p, m->optics.lens, "opens", "closes");
}

static void wall(struct page *page, const struct bb_optics_wall *w)
{
	static const int order[BB_BANDS] = { BB_SPOT_MIDDLE, BB_SPOT_TOP, BB_SPOT_BOTTOM };
	static const char *const names[BB_BANDS] = { "middle", "top", "bottom" };
	const struct bb_measure *m = page->m;
	struct panel *p = begin(page, w->cycle_ns.value);
	int i = 0;

	while (i < BB_BANDS - 1 && !w->band[order[i]].seen)
		i++;
	const int bare = find(&m->recording, w->id, order[i], BB_LENS_BARE),
	          through = find(&m->recording, w->id, order[i], BB_LENS_LEFT);
	snprintf(p->title, sizeof(p->title), "%s, %s band", w->id, names[i]);
	curve(m, p, bare, BB_PATTERN_WHITE_BLACK, "white for the left eye", left_eye, false);
	curve(m, p, bare, BB_PATTERN_BLACK_WHITE, "white for the right eye", right_eye, false);
	curve(m, p, through, BB_PATTERN_WHITE_BLACK, "signal in the left lens", pen_ink, false);
	curve(m, p, through, BB_PATTERN_BLACK_WHITE, "leakage in the left lens", leak, false);
	edges(p, w->band[order[i]].white, "on", "off");
}

static void paint(cairo_t *cr, void *ctx)
{
	const struct page *page = ctx;

	pen_set(cr, pen_paper);
	cairo_paint(cr);
	pen_text(cr, (struct pen_point){ 24, 26 }, PEN_LEFT, 16, true, pen_ink, "Light over one cycle of both eyes");
	pen_text(cr, (struct pen_point){ 24, 47 }, PEN_LEFT, 11, false, pen_grey,
	         "%llu samples folded at %.4f Hz; dashed: edges as fitted", (unsigned long long)page->m->optics.n_samples,
	         bb_rate_hz(page->m->recording.rate));
	for (size_t i = 0; i < page->n; i++) {
		const double top = HEAD + PANEL * (double)i;
		chart_draw(cr, &page->panel[i].chart, 14, top, WIDTH - 24, PANEL - 10);
		chart_legend(cr, page->panel[i].series, page->panel[i].chart.n_series, 260, top + 8);
	}
}

enum bb_status bb_measure_plot(const struct bb_measure *m, const char *file, struct bb_error *err)
{
	struct page *page = calloc(1, sizeof(*page));

	if (!page)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a plot");
	page->m = m;
	if (m->optics.has_lens[0] || m->optics.has_lens[1])
		lenses(page);
	for (size_t i = 0; i < m->optics.n_walls && page->n <= WALLS_MOST; i++)
		if (isfinite(m->optics.wall[i].cycle_ns.value))
			wall(page, &m->optics.wall[i]);
	const struct bb_page out = { WIDTH, HEAD + PANEL * (double)page->n, "optics-", paint, page };
	const enum bb_status status = bb_page_write(&out, file, err);
	free(page);
	return status;
}
