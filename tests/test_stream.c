/*
 * tests/test_stream.c: the streamer under its budgets. Invariants of the maps over many random frames, what is asked for
 * and when, what a damaged brick does, and that playing is steady.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <time.h>

#include "hal/clock.h"
#include "render/stream/io.h"
#include "render/stream/stream_private.h"
#include "tests/drawing.h"
#include "tests/heap.h"

#define WIDTH 1400
#define HEIGHT 1050

static struct {
	struct bb_volume *volume;
	struct bb_bricks *bricks; /* 8^3 u16 */
	struct bb_transfer smooth, sharp;
} fixture;

static uint32_t random_state = 1;

static uint32_t dice(uint32_t n)
{
	random_state = random_state * 1664525U + 1013904223U;
	return (uint32_t)(((uint64_t)(random_state >> 8) * n) >> 24);
}

static double unit(void)
{
	return dice(1 << 20) / (double)(1 << 20);
}

static struct bb_stream *stream_of(uint64_t memory_bytes, uint32_t bricks_per_frame)
{
	const struct bb_stream_config config = { .bricks = fixture.bricks,
						 .transfer = &fixture.smooth,
						 .placement = drawing_placement(fixture.volume),
						 .memory_bytes = memory_bytes,
						 .bricks_per_frame = bricks_per_frame,
						 .gain = BB_GAIN_LEAF };
	struct bb_error err = { 0 };
	struct bb_stream *s = NULL;

	if (bb_stream_create(&config, &s, &err) != BB_OK)
		fail_msg("%s", err.text);
	return s;
}

static struct bb_stream_frame frame_at(const struct bb_view *view, double step)
{
	return (struct bb_stream_frame){ .views = view, .n_views = 1, .width_px = WIDTH, .height_px = HEIGHT, .step = step,
					 .step_voxels = 1, .bricks_most = UINT32_MAX };
}

/* ---- invariants ---- */

static bool covers(const struct bb_tree *t, uint64_t brick, const uint32_t cell[3], uint32_t step, uint32_t up)
{
	const struct bb_tree_place p = bb_tree_place(t, (uint32_t)(brick % t->n_nodes));
	const struct bb_tree_span span = bb_tree_span(t, (uint32_t)(brick / t->n_nodes));

	for (int a = 0; a < 3; a++)
		if (cell[a] >> up != p.at[a])
			return false;
	return p.level + 1 + up == t->n_levels && span.from <= step && step < span.to;
}

static void check_map(const struct bb_stream *s, unsigned k, uint32_t step)
{
	const struct bb_atlas *a = bb_stream_atlas(s);
	size_t i = 0;
	uint32_t cell[3];

	for (cell[2] = 0; cell[2] < a->grid[2]; cell[2]++)
		for (cell[1] = 0; cell[1] < a->grid[1]; cell[1]++)
			for (cell[0] = 0; cell[0] < a->grid[0]; cell[0]++, i++) {
				const struct bb_atlas_cell *c = &a->map[k][i];
				assert_in_range(c->slot, 0, a->n_slots - 1);
				const struct bb_slot *slot = &s->slots.slot[c->slot];
				assert_true(slot->brick != BB_NO_BRICK && !slot->pending);
				assert_true(a->slot_generation[c->slot] > 0);
				assert_true(covers(s->tree, slot->brick, cell, step, c->up));
			}
}

/* No brick is twice in memory, every one is found, and the list goes through all of them. */
static void check_slots(const struct bb_stream *s)
{
	uint32_t n = 0, entries = 0, pending = 0;

	for (uint32_t i = s->slots.oldest; i != BB_NO_SLOT; i = s->slots.slot[i].newer, n++) {
		const struct bb_slot *slot = &s->slots.slot[i];
		pending += slot->pending;
		if (slot->brick != BB_NO_BRICK)
			assert_int_equal(bb_slots_find(&s->slots, slot->brick), i);
		entries += slot->brick != BB_NO_BRICK;
		assert_true(n < s->slots.n);
	}
	assert_int_equal(n, s->slots.n);
	assert_int_equal(pending, s->slots.n_pending);
	for (uint32_t i = 0; i < s->slots.n_hash; i++)
		entries -= s->slots.hash[i] != 0;
	assert_int_equal(entries, 0);
}

/* What is in a slot is what the file has. */
static void check_content(const struct bb_stream *s, uint32_t slot)
{
	const struct bb_atlas *a = bb_stream_atlas(s);
	const size_t blocks = (size_t)a->blocks * a->blocks * a->blocks;
	uint8_t *brick = malloc(a->slot_bytes);
	struct bb_atlas_range range[512];
	struct bb_error err;

	assert_non_null(brick);
	assert_true(blocks <= BB_ARRAY_LEN(range));
	assert_int_equal(bb_bricks_read(fixture.bricks, s->slots.slot[slot].brick, brick, &err), BB_OK);
	assert_int_equal(bb_atlas_accept(a, brick, range), 0);
	assert_memory_equal(brick, a->bricks + slot * a->slot_bytes, a->slot_bytes);
	assert_memory_equal(range, a->range + slot * blocks, blocks * sizeof(*range));
	free(brick);
}

static void check(const struct bb_stream *s, uint64_t memory_bytes)
{
	const struct bb_atlas *a = bb_stream_atlas(s);
	const uint32_t slot = dice(a->n_slots), step = (uint32_t)a->time;

	assert_true(bb_stream_memory_bytes(s) <= memory_bytes);
	check_map(s, 0, step);
	check_map(s, 1, a->n_shown == 2 ? step + 1 : step);
	check_slots(s);
	if (s->slots.slot[slot].brick != BB_NO_BRICK && !s->slots.slot[slot].pending)
		check_content(s, slot);
}

/* ---- ten thousand frames ---- */

struct wander {
	struct bb_stream *s;
	uint64_t memory_bytes;
	uint32_t bricks_per_frame;
	double step, speed;
	struct bb_vec3 eye;
	struct bb_stream_counts sum;
	uint64_t hash;
};

static void turn_something(struct wander *w)
{
	struct bb_error err = { 0 };

	switch (dice(60)) {
	case 0:
		w->step = unit() * 4; /* a jump in time */
		break;
	case 1:
		w->speed = (unit() - 0.5) * 0.4;
		break;
	case 2:
		assert_int_equal(bb_stream_set_transfer(w->s, dice(2) ? &fixture.smooth : &fixture.sharp, &err), BB_OK);
		break;
	case 3:
		w->bricks_per_frame = dice(12);
		w->memory_bytes = (40 + dice(400)) * UINT64_C(1024);
		assert_int_equal(bb_stream_set_budget(w->s, w->memory_bytes, w->bricks_per_frame, &err), BB_OK);
		break;
	case 4:
		w->eye = (struct bb_vec3){ unit() * 3 - 1.5, unit() * 2.5, unit() * 3 - 1.2 };
		break;
	default:
		w->eye.x += (unit() - 0.5) * 0.02;
		w->step += w->speed;
	}
	w->step = w->step > 0 ? fmin(w->step, 4) : 0;
}

static void add(uint64_t *hash, uint64_t v)
{
	*hash = (*hash ^ v) * UINT64_C(0x100000001B3);
}

static void wander_on(struct wander *w)
{
	static const struct bb_corners wall = { { -1.5, 0.2, -1.5 }, { 1.5, 0.2, -1.5 }, { -1.5, 2.6, -1.5 } };
	static const struct bb_corners floor_ = { { -1.5, 0, 1.5 }, { 1.5, 0, 1.5 }, { -1.5, 0, -1.5 } };
	const struct bb_view views[2] = { bb_view_make(&wall, w->eye, w->eye, 0.05, 50),
					  bb_view_make(&floor_, w->eye, w->eye, 0.05, 50) };
	struct bb_stream_frame f = frame_at(views, w->step);
	double ahead[4];

	turn_something(w);
	for (int i = 0; i < 4; i++)
		ahead[i] = w->step + (i + 1) * (w->speed > 0 ? 1 : -1);
	f.step = w->step;
	f.way = w->speed > 0 ? 1 : w->speed < 0 ? -1 : 0;
	f.n_views = dice(3);
	f.ahead = ahead;
	f.n_ahead = dice(5);
	f.ahead_frames = 1 + dice(30);
	f.bricks_most = dice(10) ? UINT32_MAX : dice(4);
	const struct bb_stream_counts c = bb_stream_frame(w->s, &f);
	assert_true(!w->bricks_per_frame || c.loaded <= w->bricks_per_frame);
	assert_true(!w->bricks_per_frame || c.arrived <= w->bricks_per_frame);
	assert_true(c.loaded <= f.bricks_most && c.arrived <= f.bricks_most && c.prefetched <= c.loaded && c.missing <= c.drawn && !c.failed);
	w->sum.loaded += c.loaded;
	w->sum.prefetched += c.prefetched;
	w->sum.missing += c.missing;
	w->sum.evicted += c.evicted;
	add(&w->hash, c.loaded);
	add(&w->hash, c.deficit);
	add(&w->hash, c.evicted);
}

static struct wander wandering(int frames, bool checked)
{
	struct wander w = { .memory_bytes = 100 * 1024, .bricks_per_frame = 8, .eye = { 0.3, 1.6, 1.4 }, .hash = 1 };

	random_state = 7;
	w.s = stream_of(w.memory_bytes, w.bricks_per_frame);
	for (int i = 0; i < frames; i++) {
		wander_on(&w);
		const uint32_t kept = random_state;
		if (checked)
			check(w.s, w.memory_bytes);
		random_state = kept;
	}
	bb_stream_destroy(w.s);
	return w;
}

static void neither_budget_is_ever_exceeded(void **ctx)
{
	(void)ctx;
	const struct wander w = wandering(10000, true);
	printf("10000 frames: %u bricks loaded (%u ahead of time), %u evicted, %u missing\n", w.sum.loaded, w.sum.prefetched,
	       w.sum.evicted, w.sum.missing);
	assert_true(w.sum.loaded > 10000 && w.sum.prefetched > 100 && w.sum.evicted > 1000);
	assert_true(wandering(2000, false).hash == wandering(2000, false).hash);
}

/* ---- what is asked for ---- */

static void it_grows_sharp_and_then_rests(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = stream_of(UINT64_C(4) << 20, 16);
	const struct bb_stream_frame f = frame_at(&view, 1.5);
	uint32_t last = UINT32_MAX, frames = 0;
	struct bb_stream_counts c;

	(void)ctx;
	do {
		c = bb_stream_frame(s, &f);
		assert_true(c.loaded <= 16);
		assert_true(frames < 4 || c.deficit <= last);
		last = c.deficit;
		frames++;
	} while (c.loaded);
	assert_int_equal(c.missing, 0);
	printf("sharp after %u frames, %u bricks on show\n", frames, c.drawn);
	assert_true(frames > 5 && c.drawn > 50);
	for (int i = 0; i < 10; i++) {
		c = bb_stream_frame(s, &f);
		assert_true(c.loaded == 0 && c.evicted == 0 && c.missing == 0);
	}
	const uint64_t map = bb_stream_atlas(s)->map_generation;
	(void)bb_stream_frame(s, &f);
	assert_true(bb_stream_atlas(s)->map_generation == map);
	bb_stream_destroy(s);
}

/* What the heap holds of a stream is what it says, and what stream.h says is beside that. */
static void what_it_holds_is_what_the_heap_gave(void **ctx)
{
	const uint64_t budgets[] = { 60 * 1024, 200 * 1024, 1 << 20, 5 << 20 };

	(void)ctx;
	if (!HEAP_COUNTED) {
		print_message("SKIP: a sanitizer stands in front of the allocator\n");
		skip();
	}
	for (size_t i = 0; i < BB_ARRAY_LEN(budgets); i++) {
		const uint64_t before = heap_begin();
		struct bb_stream *s = stream_of(budgets[i], 8);
		const uint64_t holds = heap_now - before, beside = s->tree->n_bricks * 8 + s->tree->n_bricks / 8 + sizeof(*s);
		const uint64_t blocks = 64; /* allocations, each rounded up by the allocator */
		print_message("%lu KiB: %lu bytes held, the heap says %lu with %lu beside\n", (unsigned long)(budgets[i] >> 10),
			      (unsigned long)bb_stream_memory_bytes(s), (unsigned long)holds, (unsigned long)beside);
		assert_true(bb_stream_memory_bytes(s) <= budgets[i]);
		assert_true(holds <= bb_stream_memory_bytes(s) + beside + blocks * 32);
		assert_true(holds >= bb_stream_memory_bytes(s));
		bb_stream_destroy(s);
	}
}

/* A budget that cannot be leaves the stream as it was. */
static void a_budget_that_cannot_be_changes_nothing(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = stream_of(300 * 1024, 8);
	const struct bb_stream_frame f = frame_at(&view, 1.5);
	struct bb_error err = { 0 };

	(void)ctx;
	(void)bb_stream_settle(s, &f);
	const uint64_t held = bb_stream_memory_bytes(s);
	assert_true(bb_stream_set_budget(s, 1, 3, &err) != BB_OK && err.number == 1470);
	assert_true(bb_stream_memory_bytes(s) == held && bb_stream_config(s)->bricks_per_frame == 8);
	(void)bb_stream_settle(s, &f);
	check(s, 300 * 1024);
	assert_true(bb_stream_set_budget(s, 100 * 1024, 3, &err) == BB_OK && bb_stream_memory_bytes(s) <= 100 * 1024);
	(void)bb_stream_settle(s, &f);
	check(s, 100 * 1024);
	bb_stream_destroy(s);
}

/* More views than it was made for, none, times that are no numbers or far away: a frame like any other. */
static void odd_frames_are_frames(void **ctx)
{
	static const double odd[] = { (double)NAN, (double)INFINITY, -(double)INFINITY, -3, 1e300, 2.5 };
	struct bb_view views[40];
	struct bb_stream *s = stream_of(200 * 1024, 0);

	(void)ctx;
	for (int i = 0; i < 40; i++)
		views[i] = drawing_view(i % DRAWING_VIEWS);
	for (size_t i = 0; i < BB_ARRAY_LEN(odd); i++)
		for (int way = -1; way <= 1; way++) {
			struct bb_stream_frame f = frame_at(views, odd[i]);
			f.n_views = 40;
			f.way = way;
			f.ahead = odd;
			f.n_ahead = BB_ARRAY_LEN(odd);
			f.ahead_frames = i % 2 ? UINT32_MAX : 0;
			f.bricks_most = i % 3 ? UINT32_MAX : 0;
			const struct bb_stream_counts c = bb_stream_frame(s, &f);
			assert_true(c.loaded <= f.bricks_most);
			check(s, 200 * 1024);
		}
	bb_stream_destroy(s);
}

static void without_a_budget_everything_is_sharp(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = stream_of(0, 0);
	const struct bb_stream_frame f = frame_at(&view, 2.25);
	const struct bb_atlas *a = bb_stream_atlas(s);

	(void)ctx;
	(void)bb_stream_settle(s, &f);
	assert_int_equal(a->n_shown, 2);
	for (size_t i = 0; i < (size_t)a->grid[0] * a->grid[1] * a->grid[2]; i++)
		assert_true(a->map[0][i].up == 0 && a->map[1][i].up == 0);
	check(s, UINT64_MAX);
	bb_stream_destroy(s);
}

static void what_nobody_sees_stays_coarse(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = stream_of(UINT64_C(4) << 20, 0);
	struct bb_stream_frame f = frame_at(&view, 1);

	(void)ctx;
	f.n_views = 0;
	(void)bb_stream_settle(s, &f);
	assert_int_equal(bb_stream_frame(s, &f).drawn, 1);
	bb_stream_destroy(s);
}

/* ---- what is hidden ---- */

/* Noise all the way through, opaque: only what lies in front can be seen. */
static double quality(const struct bb_bricks *b, const struct bb_volume *v, bool occlusion)
{
	static const struct bb_transfer_point dense[] = { { 0, 0.1, 0.2, 0.9, 0.3 }, { 0.5, 0.9, 0.5, 0.1, 0.5 }, { 1, 1, 1, 1, 0.9 } };
	const struct bb_transfer tf = drawing_transfer(BB_ARRAY_LEN(dense), dense);
	struct bb_stream_config config = { .bricks = b,
					   .transfer = &tf,
					   .placement = drawing_placement(v),
					   .memory_bytes = 500 * 1024,
					   .bricks_per_frame = 32,
					   .gain = BB_GAIN_FAR,
					   .occlusion = occlusion };
	const struct bb_view view = drawing_view(0);
	const struct bb_stream_frame f = frame_at(&view, 0);
	struct bb_image_difference d;
	struct bb_renderer *cpu;
	struct bb_stream *s[2];
	struct bb_image image[2];
	struct bb_error err;

	assert_int_equal(bb_renderer_cpu_create("auto", 1, &cpu, &err), BB_OK);
	for (int i = 0; i < 2; i++) {
		assert_int_equal(bb_stream_create(&config, &s[i], &err), BB_OK);
		for (int k = 0; k < 120; k++)
			(void)bb_stream_frame(s[i], &f);
		const struct bb_layer layer = bb_stream_layer(s[i]);
		image[i] = drawing_picture(cpu, &layer, 1, 0, 0.5, NULL);
		bb_renderer_forget(cpu);
		config.memory_bytes = 0;
	}
	assert_int_equal(bb_image_compare(&image[0], &image[1], &d), BB_OK);
	for (int i = 0; i < 2; i++) {
		bb_image_release(&image[i]);
		bb_stream_destroy(s[i]);
	}
	bb_renderer_destroy(cpu);
	return d.psnr_db;
}

static void what_is_hidden_makes_room(void **ctx)
{
	uint32_t state = 3;
	struct bb_volume *v = drawing_noise((uint32_t[]){ 64, 64, 64 }, 1, &state);
	struct bb_bricks *b = cover_bricks(v, 8, 1, BB_BRICK_U16);

	(void)ctx;
	const double without = quality(b, v, false), with = quality(b, v, true);
	printf("an opaque volume of noise, a tenth of it in memory: %.1f dB, with occlusion %.1f dB\n", without, with);
	assert_true(with > without + 1);
	bb_bricks_close(b);
	drawing_free(v);
}

/* ---- playing ---- */

struct played {
	double mean, most;
	uint64_t missing, drawn;
};

/* Three times through all steps; counted from the second time on, which is like any other. */
static struct played play(struct bb_stream *s, const struct bb_view *view, uint32_t n_steps, uint32_t frames_per_step)
{
	const uint32_t round = (n_steps - 1) * frames_per_step;
	struct played p = { 0 };
	uint64_t sum = 0;

	for (uint32_t i = 0; i < 3 * round; i++) {
		struct bb_stream_frame f = frame_at(view, (double)(i % round) / frames_per_step);
		double ahead[4];
		for (uint32_t k = 0; k < 4; k++)
			ahead[k] = (double)((i + (k + 1) * frames_per_step) % round) / frames_per_step;
		f.way = 1;
		f.ahead = ahead;
		f.n_ahead = 4;
		f.ahead_frames = frames_per_step;
		const struct bb_stream_counts c = bb_stream_frame(s, &f);
		if (i < round)
			continue;
		sum += c.loaded;
		p.missing += c.missing;
		p.drawn += c.drawn;
		p.most = c.loaded > p.most ? c.loaded : p.most;
	}
	p.mean = (double)sum / (2 * round);
	return p;
}

static struct bb_bricks *sequence(uint32_t edge, uint32_t n_steps)
{
	const uint32_t dim[3] = { edge, edge, edge };
	struct bb_steps *steps;
	struct bb_error err;

	assert_int_equal(bb_steps_generate("cme", dim, n_steps, &steps, &err), BB_OK);
	struct bb_bricks *b = cover_build(steps, (struct bb_build_config){ .edge = 8, .pad = 1, .type = BB_BRICK_U16 });
	bb_steps_close(steps);
	return b;
}

/* Half as many bricks again as playing needs on average are enough for a picture that is nearly always complete, when it
 * is known what comes; when it is not, they are not, and without any budget a new step comes all at once. */
static void playing_is_steady(void **ctx)
{
	static const struct {
		const char *text;
		uint32_t budget;
		bool no_prediction;
	} ways[] = { { "with prediction", 0, false },
		     { "with prediction, 7 bricks a frame", 7, false },
		     { "without, 7 bricks a frame", 7, true },
		     { "without, no budget", 0, true } };
	struct bb_bricks *b = sequence(64, 16);
	const struct bb_view view = drawing_view(0);
	struct played p[BB_ARRAY_LEN(ways)];
	struct bb_error err;

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(ways); i++) {
		const struct bb_stream_config config = { .bricks = b,
							 .transfer = &fixture.smooth,
							 .placement = drawing_placement(fixture.volume),
							 .memory_bytes = UINT64_C(3) << 20,
							 .bricks_per_frame = ways[i].budget,
							 .gain = BB_GAIN_LEAF,
							 .no_prediction = ways[i].no_prediction };
		struct bb_stream *s;
		assert_int_equal(bb_stream_create(&config, &s, &err), BB_OK);
		p[i] = play(s, &view, 16, 30);
		printf("%s: mean %.2f bricks a frame, most %.0f: %.1f x; %.2f %% of the picture's bricks missing\n", ways[i].text,
		       p[i].mean, p[i].most, p[i].most / p[i].mean, 100.0 * (double)p[i].missing / (double)p[i].drawn);
		bb_stream_destroy(s);
	}
	assert_true(p[0].most <= 2 * p[0].mean && p[0].missing * 100 < 2 * p[0].drawn);
	assert_true(p[1].most <= 2 * p[1].mean && p[1].missing * 100 < p[1].drawn);
	assert_true(p[2].missing > 5 * p[1].missing && p[3].most > 20 * p[3].mean);
	bb_bricks_close(b);
}

/* ---- a disk that stalls ---- */

#define FRAME_NS (BB_NS_PER_S / 60)
#define AT_60(seconds) ((seconds) * 60)

/* One frame a call; time in the data goes on by a step in half a second, to and fro. */
static struct bb_stream_counts at_frame(struct bb_stream *s, const struct bb_view *view, uint32_t i)
{
	const uint32_t round = 4 * 30, turn = i % (2 * round);
	double ahead[4];
	struct bb_stream_frame f = frame_at(view, (turn <= round ? turn : 2 * round - turn) / 30.0);

	for (uint32_t k = 0; k < 4; k++) {
		const uint32_t then = (i + (k + 1) * 30) % (2 * round);
		ahead[k] = (then <= round ? then : 2 * round - then) / 30.0;
	}
	f.way = turn < round ? 1 : -1;
	f.ahead = ahead;
	f.n_ahead = 4;
	f.ahead_frames = 30;
	f.now_ns = i * FRAME_NS;
	return bb_stream_frame(s, &f);
}

/* Thirty seconds without a disk: every part of the volume has a brick in every frame, and two seconds later the picture
 * lacks no more than it did before (an eighth aside: bricks came in another order). */
static void a_disk_may_stall_for_half_a_minute(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = stream_of(600 * 1024, 24);
	struct bb_stream_disk *disk;
	uint32_t before = 0, during = 0, after = 0;

	(void)ctx;
	assert_int_equal(bb_stream_disk_start(s, 50e3, 1, &disk), BB_OK);
	for (uint32_t i = 0; i < AT_60(60); i++) {
		bb_stream_disk_stall(disk, i >= AT_60(10) && i < AT_60(40), i * FRAME_NS);
		const uint32_t missing = at_frame(s, &view, i).missing;
		uint32_t *most = i < AT_60(10) ? &before : i < AT_60(40) ? &during : &after;
		if ((i > AT_60(2) && i < AT_60(40)) || i >= AT_60(42))
			*most = missing > *most ? missing : *most;
		if (i % 50 == 0)
			check(s, 600 * 1024);
	}
	printf("missing at most: %u before, %u while the disk stood still, %u from two seconds after\n", before, during, after);
	assert_true(during > 2 * before && after <= before + before / 8);
	bb_stream_disk_stop(disk);
	bb_stream_destroy(s);
}

static double cpu_s(void)
{
	struct timespec t;

	clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
	return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

/* The same with a real thread that is held: frames go on, nothing of what it may write to is drawn. */
static void a_thread_reads_and_may_be_held(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = stream_of(600 * 1024, 24);
	struct bb_stream_io *io;
	const double begin_s = cpu_s();

	(void)ctx;
	assert_int_equal(bb_stream_io_start(s, &io), BB_OK);
	for (uint32_t i = 0; i < 900; i++) {
		if (i == 300 || i == 600)
			bb_stream_io_hold(io, i == 300);
		const struct bb_stream_counts c = at_frame(s, &view, i);
		assert_true(i < 320 || i >= 600 || c.drawn > 0);
		if (i % 30 == 0 && i != 300)
			check(s, 600 * 1024);
		if (i < 300 && i % 60 == 59)
			bb_stream_io_drain(io);
	}
	bb_stream_io_drain(io);
	assert_true(cpu_s() - begin_s < 60); /* a hang guard */
	bb_stream_io_stop(io);
	check(s, 600 * 1024);
	assert_int_equal(s->slots.n_pending, 0);
	bb_stream_destroy(s);
}

/* ---- trouble ---- */

static void budgets_that_cannot_be_are_refused(void **ctx)
{
	struct bb_stream_config config = { .bricks = fixture.bricks,
					   .transfer = &fixture.smooth,
					   .placement = drawing_placement(fixture.volume),
					   .memory_bytes = 1000 };
	struct bb_bricks *bare = cover_bricks(fixture.volume, 8, 0, BB_BRICK_U16);
	struct bb_stream *s;
	struct bb_error err = { 0 };

	(void)ctx;
	assert_true(bb_stream_create(&config, &s, &err) != BB_OK && err.number == 1470);
	config.memory_bytes = 0;
	config.bricks = bare;
	err = (struct bb_error){ 0 };
	assert_true(bb_bricks_header(bare)->pad == 0);
	assert_true(bb_stream_create(&config, &s, &err) != BB_OK && err.number == 1471);
	config.placement.size_m.x = (double)NAN;
	err = (struct bb_error){ 0 };
	assert_true(bb_stream_create(&config, &s, &err) != BB_OK && err.number == 1701);
	bb_bricks_close(bare);
}

/* A brick that cannot be read is asked for once; its parent stays on show and everything else is as it was. */
static void a_damaged_brick_stays_coarse(void **ctx)
{
	const char *path = "/tmp/bb-stream-damaged.bricks";
	const struct bb_build_config c = { .path = path, .edge = 8, .pad = 1, .type = BB_BRICK_U16, .threads = 1,
					   .memory_bytes = UINT64_C(1) << 28 };
	const struct bb_view view = drawing_view(0);
	struct bb_build_config config = c;
	struct bb_build_report report;
	struct bb_steps *steps;
	struct bb_bricks *b;
	struct bb_error err = { 0 };
	uint32_t failed = 0;

	(void)ctx;
	assert_int_equal(bb_steps_of_volume(fixture.volume, &steps, &err), BB_OK);
	config.steps = steps;
	assert_int_equal(bb_bricks_build(&config, &report, &err), BB_OK);
	assert_int_equal(bb_bricks_open(path, &b, &err), BB_OK);
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	FILE *file = fopen(path, "r+b");
	for (uint32_t node = t->first[t->n_levels - 1]; node < t->n_nodes; node += 5) {
		const uint64_t id = (uint64_t)bb_tree_leaf_time(t, 1) * t->n_nodes + node;
		assert_int_equal(fseek(file, (long)bb_bricks_index(b)[id].offset + 7, SEEK_SET), 0);
		fputc(0x5A, file);
	}
	fclose(file);
	struct bb_bricks *kept = fixture.bricks;
	fixture.bricks = b;
	struct bb_stream *s = stream_of(UINT64_C(4) << 20, 0);
	const struct bb_stream_frame f = frame_at(&view, 1);
	struct bb_stream_counts n;
	for (int i = 0; i < 12; i++) {
		n = bb_stream_frame(s, &f);
		failed += n.failed;
	}
	printf("%u bricks could not be read, %u of %u on show are coarser for it: %s\n", failed, n.missing, n.drawn,
	       bb_stream_error(s)->text);
	assert_true(failed > 10 && n.loaded == 0 && n.missing == failed && bb_stream_error(s)->number == 1441);
	check(s, UINT64_C(4) << 20);
	bb_stream_destroy(s);
	fixture.bricks = kept;
	bb_bricks_close(b);
	bb_steps_close(steps);
	unlink(path);
}

static int setup(void **ctx)
{
	(void)ctx;
	fixture.volume = drawing_volume(52, 45, 37, 5);
	fixture.bricks = cover_bricks(fixture.volume, 8, 1, BB_BRICK_U16);
	fixture.smooth = drawing_smooth();
	fixture.sharp = drawing_sharp();
	return 0;
}

static int teardown(void **ctx)
{
	(void)ctx;
	bb_bricks_close(fixture.bricks);
	drawing_free(fixture.volume);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(neither_budget_is_ever_exceeded),
		cmocka_unit_test(it_grows_sharp_and_then_rests),
		cmocka_unit_test(what_it_holds_is_what_the_heap_gave),
		cmocka_unit_test(a_budget_that_cannot_be_changes_nothing),
		cmocka_unit_test(odd_frames_are_frames),
		cmocka_unit_test(without_a_budget_everything_is_sharp),
		cmocka_unit_test(what_nobody_sees_stays_coarse),
		cmocka_unit_test(what_is_hidden_makes_room),
		cmocka_unit_test(playing_is_steady),
		cmocka_unit_test(a_disk_may_stall_for_half_a_minute),
		cmocka_unit_test(a_thread_reads_and_may_be_held),
		cmocka_unit_test(a_damaged_brick_stays_coarse),
		cmocka_unit_test(budgets_that_cannot_be_are_refused),
	};

	return cmocka_run_group_tests(tests, setup, teardown);
}
