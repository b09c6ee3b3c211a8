/*
 * render/image.c: 8-bit pictures in memory, as PNG files, and compared. Any thread; sizes in pixels.
 * libpng is used here and nowhere else; its simplified writer needs no setjmp.
 */
#include "render/image.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define EDGE_MOST_PX 32768U
#define EQUAL_DB 200.0

enum bb_status bb_image_create(uint32_t width, uint32_t height, struct bb_image *out)
{
	*out = (struct bb_image){ 0 };
	if (!width || !height || width > EDGE_MOST_PX || height > EDGE_MOST_PX)
		return BB_ERR_RANGE;
	out->rgba = calloc((size_t)width * height, 4);
	if (!out->rgba)
		return BB_ERR_NOMEM;
	out->width = width;
	out->height = height;
	return BB_OK;
}

void bb_image_release(struct bb_image *img)
{
	if (!img)
		return;
	free(img->rgba);
	*img = (struct bb_image){ 0 };
}

static uint8_t *rgb_of(const struct bb_image *img)
{
	const size_t n = (size_t)img->width * img->height;
	uint8_t *rgb = malloc(n * 3);

	for (size_t i = 0; rgb && i < n; i++)
		memcpy(rgb + i * 3, img->rgba + i * 4, 3);
	return rgb;
}

/* Everything up to the bytes being on the disk. */
static enum bb_status put_file(FILE *f, const struct bb_image *img, const uint8_t *rgb, const struct bb_where *where,
			       struct bb_error *err)
{
	png_image png = {
		.version = PNG_IMAGE_VERSION, .width = img->width, .height = img->height, .format = PNG_FORMAT_RGB
	};

	if (!png_image_write_to_stdio(&png, f, 0, rgb, 0, NULL))
		return bb_fail(err, BB_ERR_IO, 1806, where, "%s", png.message);
	if (fflush(f) || fsync(fileno(f)))
		return bb_fail(err, BB_ERR_IO, 1806, where, "%s", strerror(errno));
	return BB_OK;
}

static enum bb_status write_part(const struct bb_image *img, const uint8_t *rgb, const char *part,
				 const struct bb_where *where, struct bb_error *err)
{
	const int fd = open(part, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
	FILE *f = fd < 0 ? NULL : fdopen(fd, "wb");
	enum bb_status st;

	if (!f) {
		st = bb_fail(err, BB_ERR_IO, 1806, where, "%s", strerror(errno));
		if (fd >= 0)
			close(fd);
		return st;
	}
	st = put_file(f, img, rgb, where, err);
	if (fclose(f) && st == BB_OK)
		st = bb_fail(err, BB_ERR_IO, 1806, where, "%s", strerror(errno));
	return st;
}

enum bb_status bb_image_write_png(const struct bb_image *img, const char *path, struct bb_error *err)
{
	const struct bb_where where = { .file = path };
	char part[BB_PATH_MAX_BYTES];
	enum bb_status st;

	if (!img->rgba)
		return BB_ERR_USAGE;
	/* The process in the name: two runs into one folder must not share a half-written file. */
	const int n = snprintf(part, sizeof(part), "%s.%ld.part", path, (long)getpid());
	if (n < 0 || (size_t)n >= sizeof(part))
		return bb_fail(err, BB_ERR_RANGE, 1806, &where, "the path is longer than %zu bytes", sizeof(part) - 1);
	uint8_t *rgb = rgb_of(img);
	if (!rgb)
		return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "%" PRIu32 "x%" PRIu32 " picture", img->width,
			       img->height);
	st = write_part(img, rgb, part, &where, err);
	if (st == BB_OK && rename(part, path))
		st = bb_fail(err, BB_ERR_IO, 1806, &where, "%s", strerror(errno));
	if (st != BB_OK)
		unlink(part);
	free(rgb);
	return st;
}

static enum bb_status read_pixels(png_image *png, size_t most_pixels, struct bb_image *out, const struct bb_where *where,
                                  struct bb_error *err)
{
	if ((uint64_t)png->width * png->height > most_pixels)
		return bb_fail(err, BB_ERR_RANGE, 1641, where, "%" PRIu32 "x%" PRIu32 " pixels are too many", png->width,
		               png->height);
	const enum bb_status st = bb_image_create(png->width, png->height, out);
	if (st != BB_OK)
		return bb_fail(err, st, st == BB_ERR_NOMEM ? 1702 : 1641, where, "%" PRIu32 "x%" PRIu32 " pixels", png->width,
		               png->height);
	png->format = PNG_FORMAT_RGBA;
	if (png_image_finish_read(png, NULL, out->rgba, 0, NULL))
		return BB_OK;
	bb_image_release(out);
	return bb_fail(err, BB_ERR_FORMAT, 1641, where, "%s", png->message);
}

enum bb_status bb_image_read_png(const char *path, size_t most_pixels, struct bb_image *out, struct bb_error *err)
{
	const struct bb_where where = { .file = path };
	png_image png = { .version = PNG_IMAGE_VERSION };
	/* Not blocking: a pipe by that name ends at once, and an empty file is no picture. */
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	FILE *f = fd >= 0 ? fdopen(fd, "rb") : NULL;
	enum bb_status st;

	*out = (struct bb_image){ 0 };
	if (!f) {
		st = bb_fail(err, BB_ERR_IO, 1641, &where, "%s", strerror(errno));
		if (fd >= 0)
			close(fd);
		return st;
	}
	if (png_image_begin_read_from_stdio(&png, f))
		st = read_pixels(&png, most_pixels, out, &where, err);
	else
		st = bb_fail(err, BB_ERR_FORMAT, 1641, &where, "%s", png.message);
	png_image_free(&png);
	fclose(f);
	return st;
}

/* Largest difference of a channel of one pixel; the squares are added to *squares. */
static unsigned pixel_difference(const uint8_t *a, const uint8_t *b, uint64_t *squares)
{
	unsigned most = 0;

	for (int c = 0; c < 3; c++) {
		const unsigned d = a[c] > b[c] ? (unsigned)(a[c] - b[c]) : (unsigned)(b[c] - a[c]);
		*squares += (uint64_t)d * d;
		if (d > most)
			most = d;
	}
	return most;
}

enum bb_status bb_image_compare(const struct bb_image *a, const struct bb_image *reference,
				struct bb_image_difference *out)
{
	const size_t n = (size_t)a->width * a->height;
	uint64_t squares = 0;

	*out = (struct bb_image_difference){ .psnr_db = EQUAL_DB, .identical = true };
	if (a->width != reference->width || a->height != reference->height)
		return BB_ERR_RANGE;
	for (size_t i = 0; i < n; i++) {
		const uint8_t *p = a->rgba + i * 4, *q = reference->rgba + i * 4;
		uint64_t here = 0;
		const unsigned most = pixel_difference(p, q, &here);
		out->n_differ += most > 0;
		if (most > out->most)
			out->most = most;
		if (q[3] <= 1)
			continue;
		out->n_pixels++;
		squares += here;
	}
	out->identical = squares == 0;
	if (squares) /* one wrong pixel in a huge picture must still rank below equal */
		out->psnr_db =
			fmin(10 * log10(255.0 * 255.0 * 3.0 * (double)out->n_pixels / (double)squares), EQUAL_DB - 1);
	return BB_OK;
}
