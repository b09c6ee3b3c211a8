/* bench/optics/measure.c: a recording from disk, twice through the analyser. */
#include "bench/optics/measure.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "render/image.h"
#include "sync/optics/recorded.h"

#define PIECE 65536
#define MOST_PIXELS (1u << 24)
#define MOST_PICTURES 10000000L

struct pass {
	struct bb_measure *m;
	bool second;
};

static void take(void *ctx, const struct bb_recording *r, int64_t at_ns, const double *volts)
{
	const struct pass *p = ctx;

	(void)r;
	if (p->second)
		bb_analyser_fold(p->m->analyser, at_ns, volts);
	else
		bb_analyser_scan(p->m->analyser, at_ns, volts);
}

static enum bb_status make_analyser(struct bb_measure *m, struct bb_error *err)
{
	const enum bb_status status = bb_analyser_create(&m->recording, &m->analyser);

	return status == BB_OK ? BB_OK : bb_fail(err, status, 1702, NULL, "%zu channels", m->recording.n_channels);
}

/* ---- text ---- */

/* The analyser is made when the head is complete, which the first sample's call-back is too late to do. */
static enum bb_status push_all(FILE *f, struct bb_recorded *r, struct pass *p, struct bb_error *err)
{
	char piece[PIECE];
	size_t n;
	enum bb_status status = BB_OK;

	while (status == BB_OK && (n = fread(piece, 1, sizeof(piece), f)) > 0)
		for (size_t at = 0; at < n && status == BB_OK;) {
			const char *end = memchr(piece + at, '\n', n - at);
			const size_t length = end && !r->headed ? (size_t)(end - piece) + 1 - at : n - at;
			status = bb_recorded_push(r, piece + at, length, err);
			at += length;
			if (status == BB_OK && r->headed && !p->m->analyser) {
				p->m->recording = r->recording;
				status = make_analyser(p->m, err);
			}
		}
	return status;
}

static enum bb_status read_text(const char *path, struct pass *p, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	struct bb_recorded *r = malloc(sizeof(*r));
	/* Not blocking: a pipe by that name must be refused, not waited for. */
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	FILE *f = fd >= 0 ? fdopen(fd, "r") : NULL;
	struct stat st;
	enum bb_status status;

	if (!r)
		status = bb_fail(err, BB_ERR_NOMEM, 1702, &where, "a line of a recording");
	else if (!f)
		status = bb_fail(err, BB_ERR_IO, 1001, &where, "%s", strerror(errno));
	else if (fstat(fileno(f), &st) || !S_ISREG(st.st_mode))
		status = bb_fail(err, BB_ERR_IO, 1630, &where, "it is no regular file");
	else {
		bb_recorded_begin(r, path, take, p);
		status = push_all(f, r, p, err);
		if (status == BB_OK)
			status = bb_recorded_end(r, err);
	}
	if (f)
		fclose(f);
	else if (fd >= 0)
		close(fd);
	free(r);
	return status;
}

/* ---- pictures ---- */

/* The uppermost, middle and lowest tenth of a picture. */
static double band_of(const struct bb_image *img, unsigned band)
{
	const uint32_t rows = img->height / 10 ? img->height / 10 : 1;
	const uint32_t from = band * (img->height - rows) / 2, to = from + rows;
	uint64_t sum = 0;

	for (size_t i = (size_t)from * img->width * 4; i < (size_t)to * img->width * 4; i += 4)
		sum += (uint64_t)img->rgba[i] + img->rgba[i + 1] + img->rgba[i + 2];
	return (double)sum / (3.0 * img->width * (to - from));
}

static enum bb_status read_pictures(const char *dir, struct pass *p, struct bb_error *err)
{
	const struct bb_where where = { dir, 0, 0 };
	const struct bb_recording *r = &p->m->recording;
	uint32_t width = 0, height = 0;
	long n = 0;

	for (; n < MOST_PICTURES; n++) {
		char file[BB_PATH_MAX_BYTES];
		struct bb_image img;
		double volts[BB_CHANNELS_MAX];
		struct stat st;
		if (snprintf(file, sizeof(file), "%s/%06ld.png", dir, n) >= (int)sizeof(file))
			return bb_fail(err, BB_ERR_RANGE, 1638, &where, "the path is too long");
		if (n && stat(file, &st) && errno == ENOENT)
			break;
		const enum bb_status status = bb_image_read_png(file, MOST_PIXELS, &img, err);
		if (status != BB_OK)
			return status;
		const bool alike = !n || (img.width == width && img.height == height);
		width = img.width;
		height = img.height;
		for (size_t c = 0; c < r->n_channels; c++)
			volts[c] = height >= BB_BANDS ? band_of(&img, r->channel[c].spot) : 0;
		bb_image_release(&img);
		if (!alike || height < BB_BANDS)
			return bb_fail(err, BB_ERR_FORMAT, 1638, &where, "%06ld.png is %u x %u", n, width, height);
		take(p, r, (int64_t)(r->first_s * 1e9 + (double)n * 1e9 / r->fps_hz), volts);
	}
	return BB_OK;
}

static enum bb_status read_folder(const char *dir, double fps, struct pass *p, struct bb_error *err)
{
	const struct bb_where where = { dir, 0, 0 };
	char file[BB_PATH_MAX_BYTES];
	struct bb_recording *r = &p->m->recording;

	if (p->second)
		return read_pictures(dir, p, err);
	if (snprintf(file, sizeof(file), "%s/recording.txt", dir) >= (int)sizeof(file))
		return bb_fail(err, BB_ERR_RANGE, 1638, &where, "the path is too long");
	const enum bb_status status = read_text(file, p, err);
	if (status != BB_OK)
		return status;
	if (fps > 0)
		r->fps_hz = fps;
	if (!(r->fps_hz > 0))
		return bb_fail(err, BB_ERR_CONFIG, 1638, &where, "neither recording.txt nor --fps says how many a second");
	for (size_t c = 0; c < r->n_channels; c++)
		if (r->channel[c].spot >= BB_BANDS || r->channel[c].lens != r->channel[0].lens ||
		    strcmp(r->channel[c].wall, r->channel[0].wall) != 0)
			return bb_fail(err, BB_ERR_CONFIG, 1638, &where,
			               "a camera sees top, middle and bottom of one wall through one lens");
	return read_pictures(dir, p, err);
}

enum bb_status bb_measure_read(const char *path, double fps, struct bb_measure *m, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	struct pass p = { .m = m };
	struct stat st;
	const bool folder = !stat(path, &st) && S_ISDIR(st.st_mode);
	enum bb_status status = BB_OK;

	memset(m, 0, sizeof(*m));
	for (int pass = 0; pass < 2 && status == BB_OK; pass++) {
		p.second = pass;
		status = folder ? read_folder(path, fps, &p, err) : read_text(path, &p, err);
		if (status == BB_OK && !pass && !bb_analyser_turn(m->analyser))
			status = bb_fail(err, BB_ERR_FORMAT, 1639, &where, "no channel has a pulse at half of %g Hz",
			                 bb_rate_hz(m->recording.rate));
	}
	if (status == BB_OK)
		bb_analyser_finish(m->analyser, &m->optics);
	else
		bb_measure_free(m);
	return status;
}

void bb_measure_free(struct bb_measure *m)
{
	bb_analyser_destroy(m->analyser);
	m->analyser = NULL;
}
