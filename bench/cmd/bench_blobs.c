/*
 * bench/cmd/bench_blobs.c: `blackburst bench blobs`: how many pixels a second one core looks through for bright spots,
 * beside memcpy of the same pictures in the same run: once over more memory than the caches hold, once over one picture
 * that stays in them. The peers take turns round by round; the best round is what a busy machine disturbs least.
 */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/cli.h"
#include "bench/stats.h"
#include "hal/clock.h"
#include "sim/camera/picture.h"
#include "sync/blobs/blobs.h"

#define ROUNDS_MOST 4000
#define ROUND_PIXELS (8u << 20)  /* some milliseconds */
#define RING_BYTES (192u << 20)  /* several times what caches hold */
#define DIFFERENT 8              /* pictures drawn; the ring repeats them */
#define MUST_GPX 2.5
#define DECK_CAMERAS 24
#define DECK_HZ 250
#define DECK_PX (832.0 * 832)

static const struct bb_cli_option options[] = {
	{ "seconds", "S", "for each row, 0.05 to 60 (0.4)" },
	{ "spots", "N", "in a picture, 0 to 256 (64)" },
	{ "kernel", "NAME", "avx512, avx2 or portable instead of the best one here" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

enum content { SPOTS, WHITE, CHESSBOARD };

struct row {
	int64_t width, height;
	bool from_memory;
	enum content content;
	double gpx, copy_gpx, median_gpx, median_copy_gpx, spots; /* 1e9 pixels, that is bytes, a second */
	bool overflow;
};

struct bench {
	double seconds;
	size_t spots;
	struct bb_blobs_config config;
	const char *kernel;
	uint8_t *ring, *copy;
	struct bb_spot spot[BB_CAMERA_BLOBS_MAX];
	double rate[2][ROUNDS_MOST];
};

/* Spots of sd 1.2 px or so, peak 150, each in a cell of its own. */
static size_t lay_lights(const struct row *r, size_t n, struct sim_rng *rng, struct sim_light *out)
{
	const size_t side = (size_t)ceil(sqrt((double)n));

	for (size_t i = 0; i < n; i++) {
		const double w = (double)r->width / (double)side, h = (double)r->height / (double)side;
		const double x = ((double)(i % side) + 0.3 + 0.4 * sim_rng_uniform(rng)) * w;
		const size_t row = i / side;
		const double y = ((double)row + 0.3 + 0.4 * sim_rng_uniform(rng)) * h;
		out[i] = (struct sim_light){ x, y, x, y, 1.5, 220, 0, false };
	}
	return n;
}

static enum bb_status draw_spots(struct bench *b, const struct row *r, size_t frame_bytes)
{
	static const struct sim_sensor sensor = { .psf_px = 0.9, .read_noise = 1, .full_well_e = 10000, .black = 4, .sun_px = 1 };
	struct sim_light light[BB_CAMERA_BLOBS_MAX];
	struct sim_picture *picture;
	struct sim_rng rng;
	enum bb_status status = sim_picture_create(&sensor, r->width, r->height, &picture);

	sim_rng_seed(&rng, 7, "bench", "blobs");
	for (size_t i = 0; i < DIFFERENT && status == BB_OK; i++) {
		const size_t n = lay_lights(r, b->spots, &rng, light);
		sim_picture_draw(picture, light, n, 0, &rng, b->ring + i * frame_bytes);
	}
	sim_picture_destroy(picture);
	return status;
}

static void paint(struct bench *b, const struct row *r, size_t frame_bytes)
{
	for (size_t i = 0; i < frame_bytes; i++) {
		const size_t x = i % (size_t)r->width, y = i / (size_t)r->width;
		b->ring[i] = r->content == WHITE || (x + y) % 2 ? 255 : 0;
	}
}

static enum bb_status fill(struct bench *b, const struct row *r, size_t frame_bytes, size_t n_frames)
{
	enum bb_status status = BB_OK;
	size_t drawn = DIFFERENT;

	if (r->content == SPOTS) {
		status = draw_spots(b, r, frame_bytes);
	} else {
		paint(b, r, frame_bytes);
		drawn = 1;
	}
	for (size_t i = drawn; i < n_frames; i++)
		memcpy(b->ring + i * frame_bytes, b->ring + (i % drawn) * frame_bytes, frame_bytes);
	return status;
}

struct turn {
	size_t frame_bytes, n_frames, next;
	size_t spots, pictures;
	bool overflow;
};

static double find_round(struct bench *b, struct bb_blob_finder *f, struct turn *t, size_t width, size_t n)
{
	const int64_t from_ns = bb_clock_stopwatch_ns();

	for (size_t i = 0; i < n; i++) {
		const uint8_t *grey = b->ring + (t->next + i) % t->n_frames * t->frame_bytes;
		const struct bb_blobs_found found = bb_blobs_find(f, grey, width, b->spot, BB_ARRAY_LEN(b->spot));
		t->spots += found.n;
		t->overflow |= found.overflow;
	}
	t->pictures += n;
	return (double)(n * t->frame_bytes) / (double)(bb_clock_stopwatch_ns() - from_ns);
}

static double copy_round(struct bench *b, const struct turn *t, size_t n)
{
	const int64_t from_ns = bb_clock_stopwatch_ns();

	for (size_t i = 0; i < n; i++) {
		const size_t at = (t->next + i) % t->n_frames * t->frame_bytes;
		memcpy(b->copy + at, b->ring + at, t->frame_bytes);
	}
	return (double)(n * t->frame_bytes) / (double)(bb_clock_stopwatch_ns() - from_ns);
}

static enum bb_status measure(struct bench *b, struct row *r)
{
	const size_t frame_bytes = (size_t)(r->width * r->height), fits = RING_BYTES / frame_bytes;
	const size_t n = ROUND_PIXELS / frame_bytes + 1;
	struct turn t = { .frame_bytes = frame_bytes, .n_frames = r->from_memory ? fits : 1 };
	struct bb_blob_finder *f;
	size_t rounds = 0;
	enum bb_status status = bb_blob_finder_create(&b->config, r->width, r->height, &f);

	if (status == BB_OK)
		status = fill(b, r, frame_bytes, r->content == SPOTS && fits > DIFFERENT ? fits : DIFFERENT);
	if (status != BB_OK) {
		bb_blob_finder_destroy(f);
		return status;
	}
	b->kernel = bb_blob_finder_kernel(f);
	const int64_t end_ns = bb_clock_stopwatch_ns() + (int64_t)(b->seconds * 1e9);
	while (rounds < ROUNDS_MOST && (rounds < 3 || bb_clock_stopwatch_ns() < end_ns)) {
		b->rate[0][rounds] = find_round(b, f, &t, (size_t)r->width, n);
		b->rate[1][rounds++] = copy_round(b, &t, n);
		t.next = (t.next + n) % t.n_frames;
	}
	bb_blob_finder_destroy(f);
	for (int k = 0; k < 2; k++)
		bb_stats_sort(b->rate[k], rounds);
	r->gpx = b->rate[0][rounds - 1];
	r->copy_gpx = b->rate[1][rounds - 1];
	r->median_gpx = bb_stats_nearest_rank(b->rate[0], rounds, 0.5);
	r->median_copy_gpx = bb_stats_nearest_rank(b->rate[1], rounds, 0.5);
	r->spots = (double)t.spots / (double)t.pictures;
	r->overflow = t.overflow;
	return BB_OK;
}

static const char *content_text(enum content c)
{
	return c == WHITE ? "white" : c == CHESSBOARD ? "chessboard" : "spots";
}

static double deck_cores(const struct row *rows, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (rows[i].width == 832 && rows[i].from_memory)
			return DECK_CAMERAS * DECK_HZ * DECK_PX * 1e-9 / rows[i].gpx;
	return BB_UNKNOWN;
}

static double worst_gpx(const struct row *rows, size_t n)
{
	double worst = (double)INFINITY;

	for (size_t i = 0; i < n; i++)
		if (rows[i].content == SPOTS)
			worst = fmin(worst, rows[i].gpx);
	return worst;
}

static void print(const struct bench *b, const struct row *rows, size_t n)
{
	printf("one core, kernel %s, %zu spots a picture; 1e9 pixels (bytes) a second, best round and median\n\n", b->kernel,
	       b->spots);
	printf("  %-11s %-7s %-10s %7s %9s %7s %9s %6s %7s\n", "picture", "from", "content", "found", "(median)", "memcpy",
	       "(median)", "share", "spots");
	for (size_t i = 0; i < n; i++) {
		const struct row *r = &rows[i];
		printf("  %4lld x %-4lld %-7s %-10s %7.2f %9.2f %7.2f %9.2f %5.0f%% %7.1f%s\n", (long long)r->width,
		       (long long)r->height, r->from_memory ? "memory" : "caches", content_text(r->content), r->gpx,
		       r->median_gpx, r->copy_gpx, r->median_copy_gpx, 100 * r->gpx / r->copy_gpx, r->spots,
		       r->overflow ? " (overflow)" : "");
	}
	printf("\n%s: at least %.1f of %.1f wanted\n", worst_gpx(rows, n) >= MUST_GPX ? "holds" : "does not hold",
	       worst_gpx(rows, n), MUST_GPX);
	printf("24 cameras of 832 x 832 at 250 Hz are %.2f: %.2f of a core like this one\n",
	       DECK_CAMERAS * DECK_HZ * DECK_PX * 1e-9, deck_cores(rows, n));
}

static json_t *row_json(const struct row *r)
{
	return json_pack("{s:I,s:I,s:s,s:s,s:f,s:f,s:f,s:f,s:f,s:b}", "width_px", (json_int_t)r->width, "height_px",
	                 (json_int_t)r->height, "from", r->from_memory ? "memory" : "caches", "content",
	                 content_text(r->content), "found_gpx_s", r->gpx, "found_median_gpx_s", r->median_gpx,
	                 "memcpy_gb_s", r->copy_gpx, "memcpy_median_gb_s", r->median_copy_gpx, "spots", r->spots,
	                 "overflow", r->overflow);
}

static int tell(const struct bb_cli *cli, const struct bench *b, const struct row *rows, size_t n)
{
	json_t *list = json_array();

	if (!bb_cli_has(cli, "json")) {
		print(b, rows, n);
		json_decref(list);
		return BB_EXIT_OK;
	}
	for (size_t i = 0; i < n; i++)
		json_array_append_new(list, row_json(&rows[i]));
	return bb_cli_print_json(json_pack("{s:s,s:o,s:f,s:f,s:b}", "kernel", b->kernel, "rows", list, "must_gpx_s",
	                                   MUST_GPX, "deck_cores", deck_cores(rows, n), "holds",
	                                   (int)(worst_gpx(rows, n) >= MUST_GPX)));
}

static enum bb_status read_options(const struct bb_cli *cli, struct bench *b, struct bb_error *err)
{
	double spots = 64;
	enum bb_status status = bb_cli_number(cli, "seconds", 0.4, 0.05, 60, &b->seconds, err);
	struct bb_blob_finder *f;

	if (status == BB_OK)
		status = bb_cli_number(cli, "spots", 64, 0, BB_CAMERA_BLOBS_MAX, &spots, err);
	b->spots = (size_t)spots;
	b->config = bb_blobs_usual();
	b->config.kernel = bb_cli_get(cli, "kernel", NULL);
	if (status != BB_OK)
		return status;
	if (bb_blob_finder_create(&b->config, 64, 64, &f) != BB_OK)
		return bb_fail(err, BB_ERR_USAGE, 1710, NULL, "--kernel %s", b->config.kernel);
	bb_blob_finder_destroy(f);
	b->ring = malloc(RING_BYTES);
	b->copy = malloc(RING_BYTES);
	if (!b->ring || !b->copy)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "two rings of pictures");
	memset(b->copy, 1, RING_BYTES);
	return BB_OK;
}

static int command(const struct bb_cli *cli)
{
	static const struct {
		int64_t width, height;
		bool from_memory;
		enum content content;
	} wanted[] = { { 640, 480, true, SPOTS },   { 640, 480, false, SPOTS },   { 832, 832, true, SPOTS },
		       { 832, 832, false, SPOTS },  { 1280, 1024, true, SPOTS },  { 1280, 1024, false, SPOTS },
		       { 832, 832, false, WHITE }, { 832, 832, false, CHESSBOARD } };
	struct row rows[BB_ARRAY_LEN(wanted)];
	struct bench *b = calloc(1, sizeof(*b));
	struct bb_error err = { 0 };
	int code = BB_EXIT_OK;

	if (!b)
		return bb_cli_fail(bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "a bench"), &err);
	enum bb_status status = read_options(cli, b, &err);
	for (size_t i = 0; i < BB_ARRAY_LEN(rows) && status == BB_OK; i++) {
		rows[i] = (struct row){ .width = wanted[i].width, .height = wanted[i].height,
			                .from_memory = wanted[i].from_memory, .content = wanted[i].content };
		status = measure(b, &rows[i]);
		if (status != BB_OK)
			status = bb_fail(&err, status, 1702, NULL, "pictures of %lld x %lld", (long long)rows[i].width,
			                 (long long)rows[i].height);
	}
	code = status == BB_OK ? tell(cli, b, rows, BB_ARRAY_LEN(rows)) : bb_cli_fail(status, &err);
	free(b->ring);
	free(b->copy);
	free(b);
	return code;
}

const struct bb_command bb_cmd_bench_blobs = {
	"bench blobs", "how fast bright spots are found in pictures, beside memcpy", "[options]", options, 0, 0, command,
};
