/*
 * tests/bench/cast.c: speed of the native ray caster on the work of cast_scene.h, against VTK's fixed-point ray caster
 * (Debian's python3-vtk9, run as a program; SKIP without) and against what this machine's gathers allow; frames of all
 * in turn, so that what else the machine does meets all alike. make bench-cast, or: cast [--json] [--rounds N] [--only TEXT]
 */
#include <math.h>
#include <unistd.h>

#include "tests/bench/cast_scene.h"
#include "tests/bench/gather.h"

#include "hal/clock.h"
#include "render/cpu/options.h"
#include "render/image.h"
#include "render/renderer_driver.h"

#define ROUNDS_MOST 99
#define LEAST_DB 50
#define VALUES_PATH "build/bench-cast.raw"

struct row {
	const char *name, *vtk; /* vtk: what to ask it for; NULL: ours */
	bool sparse, huge, gl;
	unsigned threads;
	enum bb_brick_type type;
	uint32_t edge;
	enum { BY_TILE, BY_CHANCE, IN_TILES } order;
	struct bb_renderer *renderer;
	struct cover *cover;
	double ms[ROUNDS_MOST], db;
	bool skipped;
};

static struct row rows[] = {
	{ .name = "filled, 1 thread", .threads = 1, .type = BB_BRICK_F32, .edge = 32, .huge = true },
	{ .name = "filled, 2 threads", .threads = 2, .type = BB_BRICK_F32, .edge = 32, .huge = true },
	{ .name = "sparse, 1 thread", .sparse = true, .threads = 1, .type = BB_BRICK_F32, .edge = 16, .huge = true },
	{ .name = "sparse, 2 threads", .sparse = true, .threads = 2, .type = BB_BRICK_F32, .edge = 16, .huge = true },
	{ .name = "vtk filled, 1 thread", .vtk = "fixed filled 1" },
	{ .name = "vtk filled, 2 threads", .vtk = "fixed filled 2" },
	{ .name = "vtk sparse, 1 thread", .vtk = "fixed sparse 1", .sparse = true },
	{ .name = "vtk sparse, 2 threads", .vtk = "fixed sparse 2", .sparse = true },
	{ .name = "vtk gpu filled, 2 threads", .vtk = "gpu filled 2" },
	{ .name = "gl filled, 2 threads", .type = BB_BRICK_F32, .edge = 32, .gl = true },
	{ .name = "filled, bricks of 8", .threads = 1, .type = BB_BRICK_F32, .edge = 8, .huge = true },
	{ .name = "filled, bricks of 16", .threads = 1, .type = BB_BRICK_F32, .edge = 16, .huge = true },
	{ .name = "filled, u16", .threads = 1, .type = BB_BRICK_U16, .edge = 32, .huge = true },
	{ .name = "filled, u8", .threads = 1, .type = BB_BRICK_U8, .edge = 32, .huge = true },
	{ .name = "filled, 4 KiB pages", .threads = 1, .type = BB_BRICK_F32, .edge = 32 },
	{ .name = "rays by chance, 4 KiB pages", .threads = 1, .type = BB_BRICK_F32, .edge = 32, .order = BY_CHANCE },
	{ .name = "rays by chance", .threads = 1, .type = BB_BRICK_F32, .edge = 32, .huge = true, .order = BY_CHANCE },
	{ .name = "rays by chance, in tiles", .threads = 1, .type = BB_BRICK_F32, .edge = 32, .huge = true, .order = IN_TILES },
};
#define N_ROWS BB_ARRAY_LEN(rows)

static struct {
	struct bb_volume *volume;
	struct bb_transfer transfer[2];
	struct bb_view view;
	struct bb_image image, judge[2];
	uint32_t order[3][SCENE_IMAGE * SCENE_IMAGE];
	FILE *to_vtk, *from_vtk;
	char vtk[64];
	unsigned rounds;
	bool json;
	const char *only; /* rows whose names have this; NULL: all */
} bench;

/* ---- VTK, at the other end of two pipes ---- */

static void vtk_start(void)
{
	int to[2], from[2];
	FILE *values = fopen(VALUES_PATH, "wb");

	if (!values || pipe(to) || pipe(from))
		return;
	fwrite(bench.volume->values, sizeof(float), (size_t)SCENE_EDGE * SCENE_EDGE * SCENE_EDGE, values);
	fclose(values);
	if (!fork()) {
		dup2(to[0], 0);
		dup2(from[1], 1);
		close(to[1]);
		close(from[0]);
		execlp("xvfb-run", "xvfb-run", "-a", "/usr/bin/python3", "tests/bench/cast_vtk.py", VALUES_PATH,
		       (char *)NULL);
		_exit(127);
	}
	close(to[0]);
	close(from[1]);
	bench.to_vtk = fdopen(to[1], "w");
	bench.from_vtk = fdopen(from[0], "r");
	if (!fgets(bench.vtk, sizeof(bench.vtk), bench.from_vtk))
		bench.vtk[0] = 0;
	bench.vtk[strcspn(bench.vtk, "\n")] = 0;
}

static double vtk_frame(const char *what)
{
	char line[64];

	if (!bench.vtk[0])
		return 0;
	fprintf(bench.to_vtk, "%s\n", what);
	fflush(bench.to_vtk);
	return fgets(line, sizeof(line), bench.from_vtk) ? strtod(line, NULL) : 0;
}

/* ---- ours ---- */

static struct bb_layer layer_of(const struct row *r, const struct cover *c)
{
	const double edge = SCENE_EDGE * SCENE_METRES;

	return (struct bb_layer){ &c->atlas,
				  &bench.transfer[r->sparse],
				  { { { 0, 0, 0 }, { 1, 0, 0, 0 } }, { edge, edge, edge } },
				  bench.volume };
}

static double draw_ms(struct bb_renderer *renderer, const struct row *r, const struct cover *c, struct bb_image *image)
{
	const struct bb_layer layer = layer_of(r, c);
	const struct bb_draw draw = { .view = &bench.view, .layers = &layer, .n_layers = 1, .step_voxels = SCENE_STEP };
	struct bb_draw_stats stats;

	if (bb_renderer_draw(renderer, &draw, image, &stats) != BB_OK)
		abort();
	return (double)stats.elapsed_ns / 1e6;
}

static struct cover *cover_for(const struct row *r)
{
	for (const struct row *old = rows; old < r; old++)
		if (old->cover && old->type == r->type && old->edge == r->edge && old->huge == r->huge)
			return old->cover;
	struct bb_bricks *b = cover_bricks(bench.volume, r->edge, 1, r->type);
	struct cover *c = cover_make(b, 0, cover_leaves, NULL);
	bb_bricks_close(b);
	scene_pages(c, r->huge);
	return c;
}

/* Filled is the work itself: every sample of every ray. Sparse is what a room does: all switches as they are. */
static void prepare(struct row *r)
{
	const struct bb_renderer_cpu_options o = { .kernel = "auto",
						   .threads = r->threads,
						   .no_early_exit = !r->sparse,
						   .no_skipping = !r->sparse,
						   .order = r->order ? bench.order[r->order] : NULL,
						   .n_order = SCENE_IMAGE * SCENE_IMAGE };
	struct bb_image_difference d;

	r->skipped = bench.only && !strstr(r->name, bench.only);
	if (r->vtk || (r->skipped && r != rows)) /* the first one counts the samples */
		return;
	r->cover = cover_for(r);
	/* llvmpipe takes a thread for each processor. */
	if ((r->gl ? bb_renderer_gl_create("osmesa", &r->renderer, NULL)
		   : bb_renderer_cpu_create_with(&o, &r->renderer, NULL)) != BB_OK)
		abort();
	if (!bench.judge[r->sparse].rgba) {
		struct bb_renderer *reference;
		if (bb_image_create(SCENE_IMAGE, SCENE_IMAGE, &bench.judge[r->sparse]) != BB_OK ||
		    bb_renderer_reference_create(2, &reference) != BB_OK)
			abort();
		(void)draw_ms(reference, r, r->cover, &bench.judge[r->sparse]);
		bb_renderer_destroy(reference);
	}
	(void)draw_ms(r->renderer, r, r->cover, &bench.image);
	if (bb_image_compare(&bench.image, &bench.judge[r->sparse], &d) != BB_OK)
		abort();
	r->db = d.psnr_db;
}

/* ---- orders of rays ---- */

static int in_tiles(const void *a, const void *b)
{
	const uint32_t p = *(const uint32_t *)a, q = *(const uint32_t *)b;
	const uint32_t p_tile = p / SCENE_IMAGE / 16 * 32 + p % SCENE_IMAGE / 16;
	const uint32_t q_tile = q / SCENE_IMAGE / 16 * 32 + q % SCENE_IMAGE / 16;

	return p_tile < q_tile ? -1 : p_tile > q_tile ? 1 : p < q ? -1 : p > q;
}

/* By chance, as a frameless renderer draws; in tiles: a sixteenth of those at a time, put in order of their place. */
static void make_orders(void)
{
	const uint32_t n = SCENE_IMAGE * SCENE_IMAGE;
	uint32_t state = 1;

	for (uint32_t i = 0; i < n; i++) {
		state = state * 1664525U + 1013904223U;
		const uint32_t j = (uint32_t)((uint64_t)state * (i + 1) >> 32);
		bench.order[BY_CHANCE][i] = bench.order[BY_CHANCE][j];
		bench.order[BY_CHANCE][j] = i;
	}
	memcpy(bench.order[IN_TILES], bench.order[BY_CHANCE], sizeof(bench.order[0]));
	for (uint32_t k = 0; k < 16; k++)
		qsort(bench.order[IN_TILES] + k * (n / 16), n / 16, sizeof(uint32_t), in_tiles);
}

/* ---- what came out ---- */

static int ascending(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

static double median_of(const struct row *r)
{
	return r->ms[bench.rounds / 2];
}

static const struct row *row_named(const char *name)
{
	for (const struct row *r = rows; r < rows + N_ROWS; r++)
		if (!strcmp(r->name, name))
			return r;
	abort();
}

static void print_row(const struct row *r, double samples)
{
	if (r->skipped && bench.only && !bench.json)
		return;
	if (r->skipped) {
		printf(bench.json ? "    { \"row\": \"%s\", \"skipped\": true }" : "%-28s SKIP\n", r->name);
		return;
	}
	const double ms = median_of(r), least = r->ms[0], most = r->ms[bench.rounds - 1];
	char db[32] = "";
	if (!r->vtk)
		snprintf(db, sizeof(db), bench.json ? ", \"psnr_db\": %.1f" : "  %5.1f dB", r->db);
	printf(bench.json ? "    { \"row\": \"%s\", \"median_ms\": %.3f, \"least_ms\": %.3f, \"most_ms\": %.3f, "
			    "\"samples_per_s\": %.0f%s }"
			  : "%-28s %8.2f ms [%.2f - %.2f]  %6.0f M samples/s nominal%s\n",
	       r->name, ms, least, most, bench.json ? samples / ms * 1e3 : samples / ms / 1e3, db);
}

static bool first_ratio = true;

static void print_ratio(const char *what, const char *a, const char *b, double must, double goal)
{
	const struct row *x = row_named(a), *y = row_named(b);

	if (x->skipped || y->skipped)
		return;
	char wanted[64] = "";
	if (must > 0)
		snprintf(wanted, sizeof(wanted), bench.json ? ", \"must\": %.2f, \"goal\": %.2f" : "  (must %.2f, goal %.2f)",
			 must, goal);
	printf(bench.json ? "%s    { \"ratio\": \"%s\", \"value\": %.3f%s }" : "%s%-52s %6.2f%s\n",
	       bench.json && !first_ratio ? ",\n" : "", what, median_of(x) / median_of(y), wanted);
	first_ratio = false;
}

static void print_all(double samples, const struct gather_rate *g)
{
	const double ceiling = 1 / (5 / g->gathers_per_s + 1 / g->samples_per_s);
	const double ours = rows[0].skipped ? 0 : samples / median_of(&rows[0]) * 1e3;

	printf(bench.json ? "{\n  \"peer\": \"%s\", \"rows\": [\n" : "%s; %u rounds in turn, median [least - most]\n",
	       bench.vtk[0] ? bench.vtk : "no VTK", bench.rounds);
	for (struct row *r = rows; r < rows + N_ROWS; r++) {
		print_row(r, samples);
		if (bench.json)
			printf(r + 1 < rows + N_ROWS ? ",\n" : "\n  ],\n  \"ratios\": [\n");
	}
	print_ratio("filled, 2 threads, against VTK fixed-point", "vtk filled, 2 threads", "filled, 2 threads", 12, 20);
	print_ratio("filled, 1 thread, against VTK fixed-point", "vtk filled, 1 thread", "filled, 1 thread", 12, 20);
	print_ratio("filled, 2 threads, against VTK GPU on llvmpipe", "vtk gpu filled, 2 threads", "filled, 2 threads",
		    7, 10);
	print_ratio("filled, 2 threads, against gl on llvmpipe", "gl filled, 2 threads", "filled, 2 threads", 3.5, 5);
	print_ratio("sparse, 1 thread, against VTK fixed-point", "vtk sparse, 1 thread", "sparse, 1 thread", 10, 20);
	print_ratio("sparse, 2 threads, against VTK fixed-point", "vtk sparse, 2 threads", "sparse, 2 threads", 10, 20);
	print_ratio("two threads against one", "filled, 1 thread", "filled, 2 threads", 1.75, 1.9);
	print_ratio("rays by chance (4 KiB pages) against tiles", "rays by chance, 4 KiB pages", "filled, 1 thread", 0,
		    0);
	print_ratio("rays by chance (2 MiB pages) against tiles", "rays by chance", "filled, 1 thread", 0, 0);
	print_ratio("rays by chance, in tiles (2 MiB pages) against tiles", "rays by chance, in tiles", "filled, 1 thread", 0, 0);
	if (rows[0].skipped && !bench.json)
		return;
	printf(bench.json ? "\n  ],\n  \"gathers_per_s\": %.0f, \"arithmetic_samples_per_s\": %.0f, \"ceiling\": %.0f, "
			    "\"share_of_ceiling\": %.3f\n}\n"
			  : "gathers %.0f/s, arithmetic %.0f samples/s: ceiling %.0f samples/s a thread; share %.2f "
			    "(must 0.65, "
			    "goal 0.85)\n",
	       g->gathers_per_s, g->samples_per_s, ceiling, ours / ceiling);
}

static double nominal_samples(void)
{
	const struct bb_layer layer = layer_of(rows, rows[0].cover);
	struct bb_rays rays;
	double sum = 0;

	if (bb_rays_make(&bench.view, &layer, SCENE_STEP, SCENE_IMAGE, SCENE_IMAGE, &rays) != BB_OK)
		abort();
	for (uint32_t y = 0; y < SCENE_IMAGE; y++)
		for (uint32_t x = 0; x < SCENE_IMAGE; x++)
			sum += bb_rays_at(&rays, x, y).n;
	return sum;
}

static void run_round(unsigned round, struct gather_rate *best)
{
	for (struct row *r = rows; r < rows + N_ROWS; r++) {
		r->skipped = r->skipped || (r->vtk && !bench.vtk[0]);
		if (!r->skipped)
			r->ms[round] = r->vtk ? vtk_frame(r->vtk) : draw_ms(r->renderer, r, r->cover, &bench.image);
	}
	const struct gather_rate g = gather_rate();
	best->gathers_per_s = fmax(best->gathers_per_s, g.gathers_per_s);
	best->samples_per_s = fmax(best->samples_per_s, g.samples_per_s);
}

int main(int argc, char **argv)
{
	struct gather_rate rate = { 0 };
	int code = 0;

	bench.rounds = 5;
	for (int i = 1; i < argc; i++) {
		bench.json = bench.json || !strcmp(argv[i], "--json");
		if (!strcmp(argv[i], "--rounds") && i + 1 < argc)
			bench.rounds = (unsigned)strtoul(argv[++i], NULL, 10);
		if (!strcmp(argv[i], "--only") && i + 1 < argc)
			bench.only = argv[++i];
	}
	bench.rounds = bench.rounds < 1 ? 1 : bench.rounds > ROUNDS_MOST ? ROUNDS_MOST : bench.rounds;
	bench.volume = scene_volume();
	bench.transfer[0] = scene_transfer(false);
	bench.transfer[1] = scene_transfer(true);
	bench.view = scene_view();
	if (bb_image_create(SCENE_IMAGE, SCENE_IMAGE, &bench.image) != BB_OK)
		return 1;
	make_orders();
	const bool with_vtk = !bench.only || strstr(bench.only, "vtk");
	if (with_vtk)
		vtk_start();
	if (with_vtk && !bench.vtk[0])
		fprintf(stderr, "SKIP: VTK's rows: xvfb-run or /usr/bin/python3 with vtk and numpy is missing "
				"(apt-get install python3-vtk9 python3-numpy xvfb xauth)\n");
	for (struct row *r = rows; r < rows + N_ROWS; r++)
		prepare(r);
	for (unsigned k = 0; k < bench.rounds; k++)
		run_round(k, &rate);
	for (struct row *r = rows; r < rows + N_ROWS; r++) {
		qsort(r->ms, bench.rounds, sizeof(r->ms[0]), ascending);
		code = !r->vtk && r->type == BB_BRICK_F32 && r->db < LEAST_DB ? 1 : code;
	}
	print_all(nominal_samples(), &rate);
	return code;
}
