/*
 * tests/test_track_record.c: what is written is read, bit for bit; every prefix of a recording is cut, and gives what came
 * before; numbers at their ends; what a writer is given and a reader would refuse.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include "bench/track_record/record.h"
#include "sim/world.h"

#define PLAIN "build/test-track-record.bbtrack"
#define PACKED "build/test-track-record.bbtrack.zst"

static struct bb_record_head head = {
	.room = "a room", .sha256 = "-", .has_tracker = true, .sigma_px = 0.1, .group_ns = 500000, .freeze_ns = 100000000,
	.room_min = { -1.5, 0, -1.5 }, .room_max = { 1.5, 2.6, 1.5 }, .neutral = { { 0, 1.6, 0 }, { 0, 0, 0, 1 } },
	.n_cameras = 2, .camera = { "c1", "c2" }, .n_pads = 1, .pad = { "pad" }, .n_bodies = 1,
	.body = { { .id = "head gear", .n_markers = 3, .marker = { { 0, 0, 0 }, { 0.1, 0, 0 }, { 0, 1.0 / 3, 0 } } } },
};
static struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];

static double any(struct sim_rng *r)
{
	return (sim_rng_uniform(r) - 0.5) * pow(10, 6 * sim_rng_uniform(r) - 3);
}

static struct bb_record_item item_of(struct sim_rng *r, int i)
{
	struct bb_record_item item = { .kind = (enum bb_record_kind)(i % 4) };
	struct bb_track_solution *s = &item.pose.solution;

	item.now_ns = (int64_t)sim_rng_u64(r) / 4;
	if (item.kind == BB_RECORD_FRAME) {
		item.frame = (struct bb_record_frame){ .camera = (uint16_t)(i / 4 % 2), .seq = (uint32_t)sim_rng_u64(r),
			                               .device_ns = (int64_t)sim_rng_u64(r) / 4, .mid_ns = -i,
			                               .arrived_ns = INT64_MAX / 4, .overflow = i & 8, .given = i & 16,
			                               .n = i == 400 ? BB_CAMERA_BLOBS_MAX : (size_t)i / 4 % 7,
			                               .blobs = blobs };
		for (size_t k = 0; k < item.frame.n; k++)
			blobs[k] = (struct bb_blob){ (float)any(r), (float)any(r), (float)fabs(any(r)) };
		blobs[0].x_px = FLT_MIN / 3;
		blobs[1].y_px = -0.0F;
	} else if (item.kind == BB_RECORD_POSE) {
		*s = (struct bb_track_solution){ .at_ns = (int64_t)sim_rng_u64(r) / 4, .flags = (unsigned)i & 63, .n_markers = 5,
			                         .n_cameras = 7, .position_sigma_mm = DBL_MIN, .angle_sigma_deg = 1.0 / 3,
			                         .residual_px = fabs(any(r)) };
		s->body.p = (struct bb_vec3){ any(r), -0.0, any(r) };
		s->body.q = bb_quat_unit((struct bb_quat){ any(r), any(r), any(r), 1 });
	} else if (item.kind == BB_RECORD_PAD) {
		item.pad.report = (struct bb_pad_report){ .at_ns = i, .seq = (uint32_t)i, .buttons = UINT32_MAX,
			                                  .axis = { 1, -1, 0.1F, 0, 0, 1.0F / 3 } };
	}
	return item;
}

static void check_same(const struct bb_record_item *a, const struct bb_record_item *b)
{
	assert_int_equal(a->kind, b->kind);
	if (a->kind == BB_RECORD_FRAME) {
		assert_int_equal(a->frame.camera, b->frame.camera);
		assert_int_equal(a->frame.seq, b->frame.seq);
		assert_int_equal(a->frame.device_ns, b->frame.device_ns);
		assert_int_equal(a->frame.arrived_ns, b->frame.arrived_ns);
		assert_int_equal(a->frame.mid_ns, b->frame.mid_ns);
		assert_int_equal(a->frame.given, b->frame.given);
		assert_int_equal(a->frame.overflow, b->frame.overflow);
		assert_int_equal(a->frame.n, b->frame.n);
		assert_memory_equal(a->frame.blobs, b->frame.blobs, a->frame.n * sizeof(struct bb_blob));
	} else if (a->kind == BB_RECORD_POSE) {
		const struct bb_track_solution *x = &a->pose.solution, *y = &b->pose.solution;
		assert_int_equal(x->at_ns, y->at_ns);
		assert_memory_equal(&x->body, &y->body, sizeof(x->body));
		assert_memory_equal(&x->position_sigma_mm, &y->position_sigma_mm, 3 * sizeof(double));
		assert_int_equal(x->flags, y->flags);
	} else if (a->kind == BB_RECORD_PAD) {
		assert_memory_equal(&a->pad.report, &b->pad.report, offsetof(struct bb_pad_report, battery));
	} else {
		assert_int_equal(a->now_ns, b->now_ns);
	}
}

static void write_file(const char *path, int n)
{
	struct bb_recorder *w;
	struct sim_rng r;

	sim_rng_seed(&r, 7, "test", "record");
	assert_int_equal(bb_recorder_create(path, &head, &w, NULL), BB_OK);
	for (int i = 0; i < n; i++) {
		const struct bb_record_item item = item_of(&r, i);
		bb_recorder_put(w, &item);
	}
	assert_int_equal(bb_recorder_commit(w, NULL), BB_OK);
}

static void test_round_trip(void **state)
{
	const char *const paths[] = { PLAIN, PACKED };
	const int n = 2000;

	(void)state;
	for (size_t k = 0; k < 2; k++) {
		struct bb_record_reader *rd;
		struct bb_record_item got;
		struct bb_error err = { 0 };
		struct sim_rng r;

		write_file(paths[k], n);
		assert_int_equal(bb_record_open(paths[k], &rd, &err), BB_OK);
		const struct bb_record_head *h = bb_record_head(rd);
		assert_string_equal(h->room, "a_room");
		assert_string_equal(h->body[0].id, "head_gear");
		assert_memory_equal(h->body[0].marker, head.body[0].marker, sizeof(head.body[0].marker));
		assert_memory_equal(&h->neutral, &head.neutral, sizeof(h->neutral));
		assert_true(h->sigma_px == 0.1 && h->n_cameras == 2 && h->n_pads == 1);
		sim_rng_seed(&r, 7, "test", "record");
		for (int i = 0; i < n; i++) {
			const struct bb_record_item want = item_of(&r, i);
			assert_int_equal(bb_record_next(rd, &got, &err), BB_OK);
			check_same(&want, &got);
		}
		for (int i = 0; i < 2; i++) { /* and stays there */
			assert_int_equal(bb_record_next(rd, &got, &err), BB_OK);
			assert_int_equal(got.kind, BB_RECORD_END);
		}
		bb_record_close(rd);
	}
	struct stat plain, packed;
	assert_true(!stat(PLAIN, &plain) && !stat(PACKED, &packed) && packed.st_size < plain.st_size);
}

static size_t slurp(const char *path, uint8_t *bytes, size_t cap)
{
	FILE *f = fopen(path, "rb");

	assert_non_null(f);
	const size_t n = fread(bytes, 1, cap, f);
	fclose(f);
	assert_true(n < cap);
	return n;
}

/* How many items a prefix gives; the error's number. */
static size_t items_in(const uint8_t *bytes, size_t n, int *number)
{
	static struct bb_record_reader *rd;
	struct bb_record_item item = { .kind = BB_RECORD_PAD };
	struct bb_error err = { 0 };
	uint8_t *exact = malloc(n ? n : 1); /* ASan sees who reads on */
	size_t n_items = 0;

	assert_non_null(exact);
	memcpy(exact, bytes, n);
	enum bb_status status = bb_record_open_bytes(exact, n, &rd, &err);
	while (status == BB_OK && item.kind != BB_RECORD_END) {
		status = bb_record_next(rd, &item, &err);
		n_items += status == BB_OK;
	}
	free(exact);
	*number = err.number;
	return n_items;
}

static void test_cut(void **state)
{
	static uint8_t bytes[65536];
	const char *const paths[] = { PLAIN, PACKED };
	int number;

	(void)state;
	for (size_t k = 0; k < 2; k++) {
		write_file(paths[k], 24);
		const size_t n = slurp(paths[k], bytes, sizeof(bytes));
		size_t before = 0;
		assert_int_equal(items_in(bytes, n, &number), 25);
		assert_int_equal(number, 0);
		for (size_t cut = 0; cut < n; cut++) {
			const size_t here = items_in(bytes, cut, &number);
			/* The last byte of a plain file is a line's end; of a compressed one, of its checksum. */
			assert_true(here >= before && here <= 24);
			assert_true(number == 1763 || (number == 1762 && cut < 20));
			before = here;
		}
		bytes[n] = 'x';
		(void)items_in(bytes, n + 1, &number);
		assert_true(number == 1762 || number == 1763);
		for (size_t i = 0; i < n; i++) { /* one byte is another: it is read or refused, and never more than 8 MiB is taken */
			bytes[i] ^= 0x15;
			(void)items_in(bytes, n, &number);
			assert_true(number == 0 || number == 1762 || number == 1763);
			bytes[i] ^= 0x15;
		}
	}
}

/* What a writer flushed before it was killed is read to its last line, though it unpacks to more than one read's room. */
static void test_killed_after_flush(void **state)
{
	static uint8_t text[131072], packed[131072];
	int number;

	(void)state;
	write_file(PLAIN, 2000);
	FILE *f = fopen(PLAIN, "rb");
	assert_non_null(f);
	const size_t n = fread(text, 1, sizeof(text), f);
	fclose(f);
	assert_int_equal(n, sizeof(text));
	ZSTD_CStream *z = ZSTD_createCStream();
	ZSTD_inBuffer in = { text, n, 0 };
	ZSTD_outBuffer out = { packed, sizeof(packed), 0 };
	assert_int_equal(ZSTD_compressStream2(z, &out, &in, ZSTD_e_flush), 0);
	ZSTD_freeCStream(z);
	const size_t want = items_in(text, n, &number);
	assert_true(want > 100);
	assert_int_equal(items_in(packed, out.pos, &number), want);
	assert_int_equal(number, 1763);
}

/* A whole one whose text fills the reader's room to its last byte is whole, and not cut. */
static void test_full_to_the_brim(void **state)
{
	static char text[16 * 65536];
	static uint8_t packed[sizeof(text)];
	size_t n = 0, lacks = SIZE_MAX;
	int number, items = 410;

	(void)state;
	for (; lacks > 50 && items < 4000; items += lacks > 16384 ? 8 : 1) {
		write_file(PLAIN, items);
		n = slurp(PLAIN, (uint8_t *)text, sizeof(text));
		lacks = -n % 65536;
	}
	assert_true(lacks <= 50);
	char *name = text; /* the room's gets longer by what is lacking */
	for (; memcmp(name, "room a", 6) != 0; name++)
		assert_true(name < text + 1000);
	memmove(name + 6 + lacks, name + 6, n - (size_t)(name + 6 - text));
	memset(name + 6, 'a', lacks);
	n += lacks;
	const size_t want = items_in((uint8_t *)text, n, &number);
	assert_int_equal(number, 0);
	const size_t n_packed = ZSTD_compress(packed, sizeof(packed), text, n, 3);
	assert_false(ZSTD_isError(n_packed));
	assert_int_equal(items_in(packed, n_packed, &number), want);
	assert_int_equal(number, 0);
}

/* A broken camera and a broken pad must not make a recording that cannot be read. */
static void test_nonsense(void **state)
{
	struct bb_blob bad[] = { { NAN, 1, 1 }, { 1, INFINITY, 1 }, { 7, 8, 9 }, { 1, 1, -1e30F } };
	struct bb_record_item item = { .kind = BB_RECORD_FRAME, .frame = { .n = 4, .blobs = bad } };
	struct bb_recorder *w;
	struct bb_record_reader *rd;

	(void)state;
	assert_int_equal(bb_recorder_create(PLAIN, &head, &w, NULL), BB_OK);
	bb_recorder_put(w, &item);
	item.kind = BB_RECORD_PAD;
	item.pad.report.axis[0] = NAN;
	item.pad.report.axis[1] = 7;
	bb_recorder_put(w, &item);
	assert_int_equal(bb_recorder_commit(w, NULL), BB_OK);
	assert_int_equal(bb_record_open(PLAIN, &rd, NULL), BB_OK);
	assert_int_equal(bb_record_next(rd, &item, NULL), BB_OK);
	assert_int_equal(item.frame.n, 1);
	assert_true(item.frame.blobs[0].x_px == 7.0F);
	assert_int_equal(bb_record_next(rd, &item, NULL), BB_OK);
	assert_true(item.pad.report.axis[1] == 1.0F);
	assert_int_equal(bb_record_next(rd, &item, NULL), BB_OK);
	assert_int_equal(item.kind, BB_RECORD_END);
	bb_record_close(rd);
}

static void test_old_or_new(void **state)
{
	struct bb_error err = { 0 };
	struct bb_recorder *w;
	int number;
	static uint8_t bytes[65536];

	(void)state;
	write_file(PLAIN, 4);
	assert_int_equal(bb_recorder_create(PLAIN, &head, &w, &err), BB_OK);
	bb_recorder_abort(w);
	assert_int_equal(items_in(bytes, slurp(PLAIN, bytes, sizeof(bytes)), &number), 5);
	assert_int_equal(bb_recorder_create("build/no/such/folder.zst", &head, &w, &err), BB_ERR_IO);
	assert_int_equal(err.number, 1901);
	assert_null(w);
	err.number = 0;
	struct bb_record_reader *rd;
	assert_int_equal(bb_record_open("build", &rd, &err), BB_ERR_IO);
	assert_int_equal(err.number, 1001);
	unlink(PLAIN);
	unlink(PACKED);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_round_trip),
		cmocka_unit_test(test_cut),
		cmocka_unit_test(test_full_to_the_brim),
		cmocka_unit_test(test_killed_after_flush),
		cmocka_unit_test(test_nonsense),
		cmocka_unit_test(test_old_or_new),
	};

	mkdir("build", 0777);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
