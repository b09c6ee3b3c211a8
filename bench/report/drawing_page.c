#include "bench/report/drawing_page.h"

#include <cairo-svg.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct buffer {
	char *bytes;
	size_t n, cap;
};

static cairo_status_t append(void *closure, const unsigned char *bytes, unsigned n)
{
	struct buffer *b = closure;

	if (b->cap - b->n < (size_t)n + 1) {
		const size_t cap = 2 * (b->cap + n) + 4096;
		char *more = realloc(b->bytes, cap);
		if (!more)
			return CAIRO_STATUS_NO_MEMORY;
		b->bytes = more;
		b->cap = cap;
	}
	memcpy(b->bytes + b->n, bytes, n);
	b->n += n;
	b->bytes[b->n] = '\0';
	return CAIRO_STATUS_SUCCESS;
}

static bool append_text(struct buffer *b, const char *text, size_t n)
{
	return append(b, (const unsigned char *)text, (unsigned)n) == CAIRO_STATUS_SUCCESS;
}

/*
 * cairo names its glyphs alike in every drawing, and two on one page would share them: ours begin with the page's prefix. It also
 * numbers its surfaces through the process; there is one here, so the number goes and a drawing is the same every time.
 * The XML declaration goes as well.
 */
static char *for_page(const char *svg, const char *prefix)
{
	static const char *const marks[] = { "id=\"", "href=\"#", "url(#" };
	const char *at = strstr(svg, "<svg");
	struct buffer out = { NULL, 0, 0 };
	bool ok = at != NULL;

	while (ok && *at) {
		size_t mark = 0;
		for (size_t i = 0; i < BB_ARRAY_LEN(marks); i++)
			if (!strncmp(at, marks[i], strlen(marks[i])))
				mark = strlen(marks[i]);
		ok = append_text(&out, at, mark ? mark : 1) && (!mark || append_text(&out, prefix, strlen(prefix)));
		at += mark ? mark : 1;
		if (mark && !strncmp(at, "surface", 7)) {
			ok = ok && append_text(&out, "surface", 7);
			at += 7 + strspn(at + 7, "0123456789");
		}
	}
	if (!ok) {
		free(out.bytes);
		return NULL;
	}
	return out.bytes;
}

char *bb_page_svg(const struct bb_page *p)
{
	struct buffer raw = { NULL, 0, 0 };
	cairo_surface_t *surface = cairo_svg_surface_create_for_stream(append, &raw, p->width, p->height);
	char *page = NULL;

	cairo_svg_surface_set_document_unit(surface, CAIRO_SVG_UNIT_PX);
	cairo_t *cr = cairo_create(surface);
	p->paint(cr, p->ctx);
	bool ok = cairo_status(cr) == CAIRO_STATUS_SUCCESS;
	cairo_destroy(cr);
	cairo_surface_finish(surface);
	ok = ok && cairo_surface_status(surface) == CAIRO_STATUS_SUCCESS;
	cairo_surface_destroy(surface);
	if (ok && raw.bytes)
		page = for_page(raw.bytes, p->prefix);
	free(raw.bytes);
	return page;
}

static bool write_svg(const struct bb_page *page, const char *file)
{
	static const char head[] = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
	char *svg = bb_page_svg(page);
	FILE *f = svg ? fopen(file, "wb") : NULL;
	bool ok = f && fputs(head, f) >= 0 && fputs(svg, f) >= 0 && !fflush(f) && !fsync(fileno(f));

	if (f && fclose(f))
		ok = false;
	free(svg);
	return ok;
}

static bool write_png(const struct bb_page *page, const char *file)
{
	const double sharper = 1.5; /* screens have more than 96 dots an inch */
	cairo_surface_t *surface = cairo_image_surface_create(CAIRO_FORMAT_RGB24, (int)ceil(page->width * sharper),
	                                                      (int)ceil(page->height * sharper));
	cairo_t *cr = cairo_create(surface);

	cairo_scale(cr, sharper, sharper);
	page->paint(cr, page->ctx);
	const bool ok = cairo_status(cr) == CAIRO_STATUS_SUCCESS &&
	                cairo_surface_write_to_png(surface, file) == CAIRO_STATUS_SUCCESS;
	cairo_destroy(cr);
	cairo_surface_destroy(surface);
	return ok;
}

static bool ends_in(const char *text, const char *tail)
{
	const size_t n = strlen(text), m = strlen(tail);

	return n > m && !strcmp(text + n - m, tail);
}

enum bb_status bb_page_check(const char *file, struct bb_error *err)
{
	const struct bb_where where = { file, 0, 0 };

	if (!ends_in(file, ".svg") && !ends_in(file, ".png"))
		return bb_fail(err, BB_ERR_USAGE, 1850, &where, "drawings are .svg or .png");
	if (strlen(file) >= BB_PATH_MAX_BYTES)
		return bb_fail(err, BB_ERR_USAGE, 1001, NULL, "the path has more than %d bytes", BB_PATH_MAX_BYTES - 1);
	return BB_OK;
}

enum bb_status bb_page_write(const struct bb_page *page, const char *file, struct bb_error *err)
{
	const struct bb_where where = { file, 0, 0 };
	const enum bb_status status = bb_page_check(file, err);
	const bool svg = ends_in(file, ".svg");
	char temporary[BB_PATH_MAX_BYTES + 32];

	if (status)
		return status;
	snprintf(temporary, sizeof(temporary), "%s.%ld.part", file, (long)getpid());
	errno = 0;
	if ((svg ? write_svg(page, temporary) : write_png(page, temporary)) && !rename(temporary, file))
		return BB_OK;
	const char *why = errno ? strerror(errno) : "the drawing failed";
	bb_fail(err, BB_ERR_IO, 1901, &where, "%s", why);
	unlink(temporary);
	return BB_ERR_IO;
}
