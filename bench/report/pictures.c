/*
 * bench/report/pictures.c: what the walls showed, eye by eye, and beside it how fine it was: a colour for each level of
 * detail. Pictures are embedded as they are, up to what a browser still opens.
 */
#include "bench/report/html.h"

#include "bench/file.h"
#include "render/levels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PICTURE_MOST ((size_t)16 << 20)
#define PICTURES_MOST ((size_t)96 << 20) /* of all together: what a browser still opens */

/* A name from a result must stay inside the result's folder. */
static bool plain_name(const char *name)
{
	return name[0] && name[0] != '.' && !strchr(name, '/');
}

static bool put_image(FILE *f, const char *dir, const struct bb_picture_result *p, size_t *left)
{
	static const char signature[] = "\x89PNG\r\n\x1a\n";
	char path[BB_PATH_MAX_BYTES];
	char *bytes = NULL;
	size_t n = 0;

	bb_text_format(path, sizeof(path), "%s/%s", dir, p->file);
	if (!plain_name(p->file) ||
	    bb_file_read(path, *left < PICTURE_MOST ? *left : PICTURE_MOST, &bytes, &n, NULL) != BB_OK)
		return false;
	if (n < 8 || memcmp(bytes, signature, 8)) {
		free(bytes);
		return false;
	}
	*left -= n;
	fprintf(f, "<img width=\"%u\" height=\"%u\" alt=\"", p->width, p->height);
	bb_put_markupf(f, "%s, %s eye, %.3f s", p->wall, p->eye, p->at_s);
	fputs("\" src=\"data:image/png;base64,", f);
	bb_put_base64(f, (const unsigned char *)bytes, n);
	fputs("\">", f);
	free(bytes);
	return true;
}

static bool same_time(const struct bb_picture_result *a, const struct bb_picture_result *b)
{
	return a->at_s >= b->at_s && a->at_s <= b->at_s;
}

static bool same_wall(const struct bb_picture_result *a, const struct bb_picture_result *b)
{
	return !strcmp(a->wall, b->wall) && same_time(a, b);
}

static void put_quality(FILE *f, const struct bb_picture_result *p)
{
	if (!strcmp(p->eye, "levels"))
		bb_put_markup(f, "\xE2\x80\x82level of detail");
	if (isnan(p->psnr_db))
		return;
	if (p->identical)
		bb_put_markupf(f, "\xE2\x80\x82%s identical", p->eye);
	else
		bb_put_markupf(f, "\xE2\x80\x82%s %.1f dB", p->eye, fmin(p->psnr_db, 200));
}

static size_t eyes_of(const struct bb_run_result *r, size_t first)
{
	size_t n = 0;

	for (size_t i = 0; i < r->n_pictures; i++)
		n += same_wall(&r->pictures[first], &r->pictures[i]);
	return n;
}

/* One wall at one time: every eye of it, left first. */
static void put_wall(FILE *f, const struct bb_run_result *r, size_t first, const char *dir, size_t *left)
{
	static const char *const eyes[] = { "left", "mono", "right", "levels" };
	const struct bb_picture_result *wall = &r->pictures[first];

	fprintf(f, "<div class=\"wall\"><div class=\"pair%s\">", eyes_of(r, first) > 2 ? " three" : "");
	for (size_t e = 0; e < BB_ARRAY_LEN(eyes); e++)
		for (size_t i = first; i < r->n_pictures; i++)
			if (same_wall(wall, &r->pictures[i]) && !strcmp(r->pictures[i].eye, eyes[e]) &&
			    !put_image(f, dir, &r->pictures[i], left))
				fputs("<span class=\"soft\">not embedded</span>", f);
	fputs("</div><div class=\"cap\"><span><b>", f);
	bb_put_markup(f, wall->wall);
	fputs("</b></span><span>", f);
	for (size_t e = 0; e < BB_ARRAY_LEN(eyes); e++)
		for (size_t i = first; i < r->n_pictures; i++)
			if (same_wall(wall, &r->pictures[i]) && !strcmp(r->pictures[i].eye, eyes[e]))
				put_quality(f, &r->pictures[i]);
	fputs("</span></div></div>\n", f);
}

static bool wall_shown(const struct bb_run_result *r, size_t i)
{
	for (size_t k = 0; k < i; k++)
		if (same_wall(&r->pictures[k], &r->pictures[i]))
			return true;
	return false;
}

static bool has_levels(const struct bb_run_result *r)
{
	for (size_t i = 0; i < r->n_pictures; i++)
		if (!strcmp(r->pictures[i].eye, "levels"))
			return true;
	return false;
}

static void put_legend(FILE *f)
{
	static const char *const text[BB_LEVELS_COLOURS] = { "as fine as the data", "half as fine", "a quarter", "an eighth",
		                                             "a sixteenth", "coarser" };

	fputs("<div class=\"legend\"><span>Level of detail, of what lies nearest:</span>", f);
	for (size_t i = 0; i < BB_LEVELS_COLOURS; i++)
		fprintf(f, "<span><span class=\"swatch\" style=\"background:%s\"></span>%s</span>", bb_levels_colour[i], text[i]);
	fputs("</div>\n", f);
}

void bb_report_pictures(FILE *f, const struct bb_run_result *r, const char *dir)
{
	size_t left = PICTURES_MOST;

	if (!r->n_pictures || !dir) {
		fputs("<p class=\"soft\">This run drew no pictures.</p>\n", f);
		return;
	}
	if (has_levels(r))
		put_legend(f);
	for (size_t i = 0; i < r->n_pictures; i++) {
		if (wall_shown(r, i))
			continue;
		if (!i || !same_time(&r->pictures[i - 1], &r->pictures[i]))
			fprintf(f, "%s<h3>At %.3f s</h3>\n<div class=\"walls%s\">\n", i ? "</div>" : "",
			        r->pictures[i].at_s, has_levels(r) ? " three" : "");
		put_wall(f, r, i, dir, &left);
	}
	fputs("</div>\n", f);
}
