/* bench/track/cover_html.c: coverage as one page that works offline. */
#include <stdlib.h>

#include "bench/file.h"
#include "bench/report/html.h"
#include "bench/track/cover_pictures.h"

static enum bb_status drawing(FILE *f, const struct bb_page *page)
{
	char *svg = bb_page_svg(page);

	if (!svg)
		return BB_ERR_NOMEM;
	fputs("<figure>", f);
	fputs(svg, f);
	fputs("</figure>\n", f);
	free(svg);
	return BB_OK;
}

static enum bb_status table(FILE *f, const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
			    const unsigned *levels, size_t n_levels)
{
	char *text = NULL;
	size_t n = 0;
	FILE *memory = open_memstream(&text, &n);

	if (!memory)
		return BB_ERR_NOMEM;
	bb_cover_print(c, s, levels, n_levels, memory);
	const bool ok = !fclose(memory);
	fputs("<pre>", f);
	bb_put_markup(f, ok ? text : "");
	fputs("</pre>\n", f);
	free(text);
	return ok ? BB_OK : BB_ERR_NOMEM;
}

enum bb_status bb_cover_html(const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
			     const unsigned *levels, size_t n_levels, const struct bb_page *clouds,
			     const struct bb_page *slices, const char *path, struct bb_error *err)
{
	struct bb_file file;
	enum bb_status status = bb_file_begin(&file, path, err);

	if (status)
		return status;
	fputs("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Coverage of ", file.out);
	bb_put_markup(file.out, c->room->name);
	fprintf(file.out, "</title>\n<style>%s figure { margin: 1.5em 0 } svg { max-width: 100%%; height: auto }</style></head><body>\n<main>\n<h1>Coverage of ",
		bb_report_style);
	bb_put_markup(file.out, c->room->name);
	fputs("</h1>\n", file.out);
	status = table(file.out, c, s, levels, n_levels);
	if (!status)
		status = drawing(file.out, clouds);
	if (!status)
		status = drawing(file.out, slices);
	fputs("</main>\n</body></html>\n", file.out);
	if (!status)
		return bb_file_commit(&file, err);
	bb_file_abort(&file);
	return bb_fail(err, status, 1702, NULL, "the page");
}
