/*
 * bench/report/html.h: report.html: one file that works offline, asks the network for nothing and runs no script.
 * The parts live in html.c (order and head), tables.c, streaming.c (what a volume asked of the disk), latency.c, pictures.c, plots.c
 * (SVG), cells.c and style.c. All device and file text passes through bb_put_markup. One thread, after the run.
 */
#ifndef BB_BENCH_REPORT_HTML_H
#define BB_BENCH_REPORT_HTML_H

#include "bench/latency.h"
#include "bench/result.h"

#include <stdio.h>

/* room_svg: an <svg> element of the room with the head's path (bench/report/room_drawing.h makes it), or NULL. It is put into
 * the page as it stands: whoever makes it escapes its texts. dir: where the pictures are. */
BB_MUST_CHECK enum bb_status bb_report_html_write(const struct bb_run_result *r, const char *dir, const char *path,
                                                  const char *room_svg, struct bb_error *err);

extern const char bb_report_style[]; /* CSS */

/* Parts; each writes one section's inside. */
void bb_report_verdicts(FILE *f, const struct bb_run_result *r);
void bb_report_trouble(FILE *f, const struct bb_run_result *r);
void bb_report_latency(FILE *f, const struct bb_run_result *r);
void bb_report_stages(FILE *f, const struct bb_run_result *r);
void bb_report_nodes(FILE *f, const struct bb_run_result *r);
void bb_report_devices(FILE *f, const struct bb_run_result *r);
void bb_report_counters(FILE *f, const struct bb_run_result *r);
void bb_report_configuration(FILE *f, const struct bb_run_result *r);
void bb_report_facts(FILE *f, const struct bb_run_result *r);
void bb_report_streaming(FILE *f, const struct bb_run_result *r);
void bb_report_pictures(FILE *f, const struct bb_run_result *r, const char *dir);

void bb_plot_waterfall(FILE *f, const struct bb_run_result *r, const struct bb_latency *l);
void bb_plot_distribution(FILE *f, const struct bb_run_result *r, enum bb_metric metric, const char *title);
void bb_plot_series(FILE *f, const struct bb_run_result *r);
void bb_plot_streaming(FILE *f, const struct bb_run_result *r);
/* One cell of a table: text, escaped; a number; a count in groups of three; ms with microseconds. NAN: a dash. */
void bb_cell(FILE *f, const char *class_name, const char *text);
void bb_cell_number(FILE *f, double v);
void bb_cell_count(FILE *f, uint64_t v);
void bb_cell_ms(FILE *f, double v);
const char *bb_stage_colour(enum bb_stage stage);
/* The first budget of a metric, NULL without one; and its limit, BB_UNKNOWN without one. */
const struct bb_budget_result *bb_report_budget(const struct bb_run_result *r, enum bb_metric metric);
double bb_report_limit(const struct bb_run_result *r, enum bb_metric metric);
const char *bb_report_unit(const char *unit); /* as a person writes it: "us" with a mu, "%" */

#endif
