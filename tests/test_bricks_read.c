/*
 * tests/test_bricks_read.c: bricks read in batches are those read one at a time, whatever the shape, type, codec, order
 * and number; by four threads at once; past the page cache and through it; and a damaged one fails alone. And the
 * checksum they rest on, in every way this processor can make it.
 */
#define _GNU_SOURCE
#include "tests/brick_rig.h"
#include "tests/heap.h"

#include "render/bricks/crc32c.h"

#include <fcntl.h>
#include <pthread.h>

#define MANY 4096

/* ---- the checksum ---- */

/* A bit at a time, from the definition. */
static uint32_t crc_by_bits(uint32_t crc, const uint8_t *p, size_t n)
{
	crc = ~crc;
	for (; n--; p++)
		for (int bit = 0; bit < 8; bit++) {
			const uint32_t out = (crc ^ (uint32_t)(*p >> bit)) & 1;
			crc = crc >> 1 ^ (out ? 0x82F63B78u : 0);
		}
	return ~crc;
}

static void every_way_gives_one_checksum(void **state)
{
	static uint8_t bytes[6000];
	uint64_t seed = 3;
	(void)state;

	/* RFC 3720, appendix B.4: 32 bytes of nothing, of ones, ascending; and the usual check word. */
	memset(bytes, 0, 32);
	assert_int_equal(bb_crc32c(0, bytes, 32), 0x8A9136AA);
	memset(bytes, 0xff, 32);
	assert_int_equal(bb_crc32c(0, bytes, 32), 0x62A8AB43);
	for (uint8_t i = 0; i < 32; i++)
		bytes[i] = i;
	assert_int_equal(bb_crc32c(0, bytes, 32), 0x46DD794E);
	assert_int_equal(bb_crc32c(0, "123456789", 9), 0xE3069283);
	for (size_t i = 0; i < sizeof(bytes); i++)
		bytes[i] = (uint8_t)rig_random(&seed);
	for (size_t n = 0; n < 5000; n += n < 1100 ? 1 : 37) {
		const size_t at = rig_random(&seed) % 200;
		const uint32_t from = rig_random(&seed), want = crc_by_bits(from, bytes + at, n);
		const size_t cut = n ? rig_random(&seed) % n : 0;
		for (int way = 0; way < BB_CRC32C_WAYS; way++) {
			if (!bb_crc32c_has((enum bb_crc32c_way)way))
				continue;
			assert_int_equal(bb_crc32c_by((enum bb_crc32c_way)way, from, bytes + at, n), want);
		}
		assert_int_equal(bb_crc32c(bb_crc32c(from, bytes + at, cut), bytes + at + cut, n - cut), want);
	}
	for (int way = 0; way < BB_CRC32C_WAYS; way++)
		print_message("%s: %s\n", bb_crc32c_text((enum bb_crc32c_way)way),
			      bb_crc32c_has((enum bb_crc32c_way)way) ? "checked" : "not on this processor");
}

/* To the last byte, and not a byte beside it. */
static void a_copy_is_a_copy(void **state)
{
	static uint8_t from[20000], to[20000], want[20000];
	uint64_t seed = 4;
	(void)state;

	for (size_t i = 0; i < sizeof(from); i++)
		from[i] = (uint8_t)rig_random(&seed);
	for (int i = 0; i < 3000; i++) {
		const size_t n = i < 600 ? (size_t)i : rig_random(&seed) % 19000;
		const size_t a = rig_random(&seed) % 500, b = rig_random(&seed) % 500;
		memset(to, 0xA5, sizeof(to));
		memset(want, 0xA5, sizeof(want));
		memcpy(want + b, from + a, n);
		const uint32_t crc = bb_crc32c_copy(7, to + b, from + a, n);
		bb_crc32c_copied();
		assert_int_equal(crc, bb_crc32c_by(BB_CRC32C_TABLES, 7, from + a, n));
		assert_memory_equal(to, want, sizeof(to));
	}
}

/* ---- batches ---- */

static struct bb_bricks_reader *reader_of(const struct bb_bricks *b, uint32_t most, enum bb_bricks_way way)
{
	struct bb_bricks_reader *r = NULL;
	struct bb_error err = { 0 };

	if (bb_bricks_reader_create(b, most, way, &r, &err) == BB_ERR_UNSUPPORTED) {
		assert_int_equal(err.number, 1453); /* a temporary folder without a disk */
		assert_int_equal(bb_bricks_reader_create(b, most, BB_BRICKS_CACHED, &r, NULL), BB_OK);
	}
	assert_non_null(r);
	return r;
}

/* All bricks, one at a time. */
static uint8_t *all_of(const struct bb_bricks *b)
{
	const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	uint8_t *all = malloc(n * n_brick);

	assert_non_null(all);
	for (uint64_t i = 0; i < n; i++)
		assert_int_equal(bb_bricks_read(b, i, all + i * n_brick, NULL), BB_OK);
	return all;
}

/* Random batches (in order, out of order, some bricks twice) by one reader against `all`. */
static void batches_are_as_all(const struct bb_bricks *b, struct bb_bricks_reader *r, const uint8_t *all, uint64_t seed,
			       int n_batches)
{
	const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b)), slot = n_brick + 32 + seed % 64;
	const uint64_t n_bricks = bb_bricks_header(b)->tree.n_bricks;
	const uint32_t most = n_bricks < 60 ? (uint32_t)n_bricks + 5 : 60;
	struct bb_bricks_want wants[65];
	uint8_t *out = malloc(slot * most);

	assert_non_null(out);
	for (int batch = 0; batch < n_batches; batch++) {
		const uint32_t n = rig_random(&seed) % (most + 1), kind = rig_random(&seed) % 3;
		const uint64_t first = rig_random(&seed) % n_bricks;
		memset(out, 0xA5, slot * most);
		for (uint32_t i = 0; i < n; i++)
			wants[i] = (struct bb_bricks_want){
				.brick = kind == 0 ? (first + i) % n_bricks :
					 kind == 1 ? (first + n_bricks - i % n_bricks) % n_bricks :
						     rig_random(&seed) % n_bricks,
				.out = out + i * slot,
				.status = BB_ERR_LOST,
				.number = -1,
			};
		assert_int_equal(bb_bricks_read_many(r, wants, n, NULL), BB_OK);
		for (uint32_t i = 0; i < n; i++) {
			assert_int_equal(wants[i].status, BB_OK);
			assert_int_equal(wants[i].number, 0);
			assert_memory_equal(wants[i].out, all + wants[i].brick * n_brick, n_brick);
			for (size_t k = n_brick; k < slot; k++)
				assert_int_equal(wants[i].out[k], 0xA5);
		}
	}
	free(out);
}

static void batches_of_any_file_are_its_bricks(void **state)
{
	uint64_t seed = 11;
	(void)state;

	for (int i = 0; i < 40; i++) {
		struct brick_rig r;
		const bool large = i % 10 == 9; /* bricks of more than one piece of staging */
		const uint32_t edge = large ? 64 : 4 + 2 * (rig_random(&seed) % 8), most = large ? 80 : 30;
		rig_begin(&r, 1 + rig_random(&seed) % most, 1 + rig_random(&seed) % most, 1 + rig_random(&seed) % most,
			  1 + rig_random(&seed) % (large ? 2 : 4), edge);
		r.config.pad = rig_random(&seed) % 3;
		r.config.type = large ? BB_BRICK_F32 : (enum bb_brick_type)(rig_random(&seed) % BB_BRICK_TYPES);
		r.config.codec = (enum bb_brick_codec)(large ? i / 10 % 3 : (int)(rig_random(&seed) % BB_BRICK_CODECS));
		struct bb_bricks *b = rig_build(&r);
		uint8_t *all = all_of(b);
		for (int way = 0; way < 2; way++) {
			struct bb_bricks_reader *reader =
				reader_of(b, 1 + rig_random(&seed) % 70, (enum bb_bricks_way)way);
			batches_are_as_all(b, reader, all, seed, 12);
			bb_bricks_reader_destroy(reader);
		}
		free(all);
		bb_bricks_close(b);
		rig_end(&r);
	}
}

struct reading {
	const struct bb_bricks *b;
	const uint8_t *all;
	uint64_t seed;
	enum bb_bricks_way way;
};

static void *read_batches(void *arg)
{
	const struct reading *a = arg;
	struct bb_bricks_reader *r = reader_of(a->b, 32, a->way);

	batches_are_as_all(a->b, r, a->all, a->seed, 60);
	bb_bricks_reader_destroy(r);
	return NULL;
}

static void four_threads_read_one_file(void **state)
{
	(void)state;

	for (int codec = 0; codec < BB_BRICK_CODECS; codec++) {
		struct brick_rig r;
		struct reading reading[4];
		pthread_t thread[4];
		rig_begin(&r, 40, 33, 30, 3, 8);
		r.config.codec = (enum bb_brick_codec)codec;
		struct bb_bricks *b = rig_build(&r);
		uint8_t *all = all_of(b);
		for (size_t i = 0; i < 4; i++) {
			reading[i] = (struct reading){ b, all, 100 + i, i == 3 ? BB_BRICKS_DIRECT : BB_BRICKS_CACHED };
			assert_int_equal(pthread_create(&thread[i], NULL, read_batches, &reading[i]), 0);
		}
		for (size_t i = 0; i < 4; i++)
			pthread_join(thread[i], NULL);
		free(all);
		bb_bricks_close(b);
		rig_end(&r);
	}
}

/* All of the file out of the page cache; and of every two `part`s the second one in again. */
static void drop(const char *path, size_t part)
{
	const int fd = open(path, O_RDONLY | O_CLOEXEC);
	char *bytes = malloc(part + 1);

	assert_true(fd >= 0 && bytes && !fsync(fd) && !posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED));
	assert_int_equal(posix_fadvise(fd, 0, 0, POSIX_FADV_RANDOM), 0); /* and nothing besides */
	for (off_t at = (off_t)part; part && pread(fd, bytes, part, at) > 0; at += 2 * (off_t)part)
		;
	free(bytes);
	close(fd);
}

/* Neighbours in the file are one read; what is not in the page cache comes all the same. */
static void neighbours_are_joined(void **state)
{
	static struct bb_bricks_want wants[400];
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 64, 64, 40, 2, 8);
	struct bb_bricks *b = rig_build(&r);
	const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	uint8_t *all = all_of(b), *out = malloc(BB_ARRAY_LEN(wants) * n_brick);
	for (int cold = 0; cold < 2; cold++) {
		struct bb_bricks_reader *reader = reader_of(b, MANY, BB_BRICKS_CACHED);
		const uint32_t n = 300; /* of the finest level of the first time node */
		assert_true(t->n_nodes - t->first[t->n_levels - 1] >= n && n <= BB_ARRAY_LEN(wants));
		for (uint32_t i = 0; i < n; i++) /* every third, then the others */
			wants[i] = (struct bb_bricks_want){
				.brick = t->first[t->n_levels - 1] + i * 7 % n, .out = out + i * n_brick
			};
		if (cold)
			drop(r.result, 0);
		assert_int_equal(bb_bricks_read_many(reader, wants, n, NULL), BB_OK);
		for (uint32_t i = 0; i < n; i++)
			assert_memory_equal(wants[i].out, all + wants[i].brick * n_brick, n_brick);
		const struct bb_bricks_counts c = bb_bricks_reader_counts(reader);
		print_message("%s: %llu bricks, %llu reads of %llu bytes together, %zu are theirs\n",
			      cold ? "dropped from the page cache" : "in the page cache", (unsigned long long)c.bricks,
			      (unsigned long long)c.reads, (unsigned long long)c.read_bytes, n * n_brick);
		assert_int_equal(c.bricks, n);
		assert_int_equal(c.failed, 0);
		assert_true(c.reads >= n * n_brick / (256 << 10) && c.reads < n / 5);
		assert_true(c.read_bytes >= n * n_brick && c.read_bytes < n * n_brick * 11 / 10);
		bb_bricks_reader_destroy(reader);
	}
	free(all);
	free(out);
	bb_bricks_close(b);
	rig_end(&r);
}

/* More reads than can be under way together; of which all, some or none find their bytes in the page cache. */
static void scattered_bricks_come_from_cache_and_disk(void **state)
{
	static const struct {
		uint32_t dim, edge, apart;
		size_t part;
	} kinds[] = { { 64, 8, 5, 28 << 10 }, { 100, 64, 1, 600 << 10 } }; /* small ones apart; large ones that are read in parts */
	(void)state;

	for (size_t kind = 0; kind < BB_ARRAY_LEN(kinds); kind++) {
		struct brick_rig r;
		rig_begin(&r, kinds[kind].dim, kinds[kind].dim, kinds[kind].dim, 1, kinds[kind].edge);
		struct bb_bricks *b = rig_build(&r);
		const uint32_t n_bricks = (uint32_t)bb_bricks_header(b)->tree.n_bricks, n = n_bricks / kinds[kind].apart;
		const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
		struct bb_bricks_want *wants = calloc(n, sizeof(*wants));
		uint8_t *all = all_of(b), *out = malloc(n * n_brick);
		struct bb_bricks_reader *reader = reader_of(b, n, BB_BRICKS_CACHED);
		assert_true(wants && out);
		for (int cold = 0; cold < 3; cold++) {
			if (cold)
				drop(r.result, cold == 1 ? kinds[kind].part : 0);
			for (uint32_t i = 0; i < n; i++)
				wants[i] = (struct bb_bricks_want){ .brick = i * kinds[kind].apart, .out = out + i * n_brick };
			memset(out, 0, n * n_brick);
			assert_int_equal(bb_bricks_read_many(reader, wants, n, NULL), BB_OK);
			for (uint32_t i = 0; i < n; i++)
				assert_memory_equal(wants[i].out, all + wants[i].brick * n_brick, n_brick);
		}
		bb_bricks_reader_destroy(reader);
		free(wants);
		free(all);
		free(out);
		bb_bricks_close(b);
		rig_end(&r);
	}
}

/* A reader says what it holds, to the byte, and takes nothing more to read with. */
static void reading_allocates_nothing(void **state)
{
	(void)state;

	for (int codec = 0; codec < BB_BRICK_CODECS; codec++) {
		struct brick_rig r;
		struct bb_bricks_want wants[50];
		rig_begin(&r, 40, 33, 30, 2, 16);
		r.config.codec = (enum bb_brick_codec)codec;
		struct bb_bricks *b = rig_build(&r);
		const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
		uint8_t *out = malloc(BB_ARRAY_LEN(wants) * n_brick);
		for (uint32_t i = 0; i < BB_ARRAY_LEN(wants); i++)
			wants[i] = (struct bb_bricks_want){ .brick = i * 5 % 36, .out = out + i * n_brick };
		heap_begin();
		struct bb_bricks_reader *reader = reader_of(b, 32, BB_BRICKS_CACHED);
		if (HEAP_COUNTED)
			assert_int_equal(heap_asked, bb_bricks_reader_bytes(reader));
		assert_true(bb_bricks_reader_bytes(reader) < (5 << 19));
		heap_begin();
		for (int i = 0; i < 20; i++)
			assert_int_equal(bb_bricks_read_many(reader, wants, BB_ARRAY_LEN(wants), NULL), BB_OK);
		assert_int_equal(heap_calls, 0);
		bb_bricks_reader_destroy(reader);
		free(out);
		bb_bricks_close(b);
		rig_end(&r);
	}
	bb_bricks_reader_destroy(NULL);
}

/* The file's header says another version. */
static void say_version(const char *path, uint32_t version)
{
	uint8_t header[BB_BRICKS_HEADER_BYTES];
	FILE *f = fopen(path, "r+");

	assert_true(f && fread(header, 1, sizeof(header), f) == sizeof(header));
	bb_put_u32(header + 8, version);
	bb_put_u32(header + sizeof(header) - 4, bb_crc32c(0, header, sizeof(header) - 4));
	assert_true(!fseek(f, 0, SEEK_SET) && fwrite(header, 1, sizeof(header), f) == sizeof(header));
	fclose(f);
}

/* Half the data is noise: its bricks are in the file as they are, the others packed, and all of them are what a file
 * without a codec has. A file of the first version has none that are as they are. */
static void what_does_not_pack_is_as_it_is(void **state)
{
	(void)state;

	for (int codec = BB_BRICK_LZ4; codec < BB_BRICK_CODECS; codec++) {
		struct brick_rig r;
		uint64_t seed = 9;
		rig_begin(&r, 32, 32, 32, 1, 8);
		for (size_t i = 0; i < rig_voxels(&r); i++)
			r.voxels[i] = i < rig_voxels(&r) / 2 ? 0 : ldexpf((float)rig_random(&seed), (int)(i * 7 % 30));
		rig_write(&r);
		r.config.pad = 0; /* at a face it repeats what is beside it */
		struct bb_bricks *b = rig_build(&r);
		uint8_t *plain = all_of(b);
		bb_bricks_close(b);
		r.config.codec = (enum bb_brick_codec)codec;
		b = rig_build(&r);
		const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
		const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
		uint64_t as_is = 0;
		for (uint64_t i = 0; i < n; i++) {
			const uint32_t bytes = bb_bricks_index(b)[i].bytes;
			assert_true(bytes == n_brick || bytes < n_brick - n_brick / 16);
			as_is += bytes == n_brick;
		}
		print_message("%s: %d of %d bricks are as they are\n", bb_brick_codec_text(r.config.codec), (int)as_is,
			      (int)n);
		assert_true(as_is >= n / 4 && as_is <= n * 3 / 4);
		uint8_t *all = all_of(b);
		assert_memory_equal(all, plain, n * n_brick);
		struct bb_bricks_reader *reader = reader_of(b, 16, BB_BRICKS_CACHED);
		batches_are_as_all(b, reader, plain, 5, 20);
		bb_bricks_reader_destroy(reader);
		bb_bricks_close(b);
		say_version(r.result, 1);
		assert_int_equal(bb_bricks_open(r.result, &b, NULL), BB_OK);
		for (uint64_t i = 0; i < n; i++)
			assert_int_equal(bb_bricks_read(b, i, all, NULL),
					 bb_bricks_index(b)[i].bytes == n_brick ? BB_ERR_FORMAT : BB_OK);
		bb_bricks_close(b);
		free(plain);
		free(all);
		rig_end(&r);
	}
}

/* ---- damage ---- */

static void flip(const char *path, uint64_t at)
{
	const int fd = open(path, O_RDWR | O_CLOEXEC);
	uint8_t byte = 0;

	assert_true(fd >= 0 && pread(fd, &byte, 1, (off_t)at) == 1);
	byte ^= 0x20;
	assert_int_equal(pwrite(fd, &byte, 1, (off_t)at), 1);
	close(fd);
}

static void a_damaged_brick_fails_alone(void **state)
{
	(void)state;

	for (int codec = 0; codec < BB_BRICK_CODECS; codec++)
		for (int way = 0; way < 2; way++) {
			struct brick_rig r;
			struct bb_bricks_want wants[27];
			struct bb_error err = { 0 };
			rig_begin(&r, 24, 24, 24, 1, 8);
			r.config.codec = (enum bb_brick_codec)codec;
			struct bb_bricks *b = rig_build(&r);
			const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
			uint8_t *all = all_of(b), *out = malloc(BB_ARRAY_LEN(wants) * n_brick);
			struct bb_bricks_reader *reader = reader_of(b, 64, (enum bb_bricks_way)way);
			for (uint32_t i = 0; i < BB_ARRAY_LEN(wants); i++)
				wants[i] = (struct bb_bricks_want){ .brick = i, .out = out + i * n_brick };
			wants[20].brick = UINT64_MAX;
			wants[26].brick = bb_bricks_header(b)->tree.n_bricks;
			flip(r.result, bb_bricks_index(b)[12].offset + bb_bricks_index(b)[12].bytes / 2);
			assert_int_equal(bb_bricks_read_many(reader, wants, BB_ARRAY_LEN(wants), &err), BB_ERR_FORMAT);
			assert_true(err.number == 1452 && strstr(err.text, "18446744073709551615"));
			for (uint32_t i = 0; i < BB_ARRAY_LEN(wants); i++) {
				assert_int_equal(wants[i].number, i == 12 ? 1441 : i == 20 || i == 26 ? 1452 : 0);
				assert_int_equal(wants[i].status,
						 i == 12	    ? BB_ERR_FORMAT :
						 i == 20 || i == 26 ? BB_ERR_USAGE :
								      BB_OK);
				if (wants[i].status == BB_OK)
					assert_memory_equal(wants[i].out, all + i * n_brick, n_brick);
			}
			assert_int_equal(bb_bricks_reader_counts(reader).failed, 3);
			assert_int_equal(bb_bricks_reader_counts(reader).bricks, 24);
			bb_bricks_reader_destroy(reader);
			free(all);
			free(out);
			bb_bricks_close(b);
			rig_end(&r);
		}
}

/* Cut behind any brick: what lies before the cut is there, what does not is error 1406. */
static void a_file_that_shrinks_gives_what_it_has(void **state)
{
	struct brick_rig r;
	struct bb_bricks_want wants[36];
	(void)state;

	rig_begin(&r, 24, 24, 24, 1, 8);
	struct bb_bricks *b = rig_build(&r);
	const uint32_t n = (uint32_t)bb_bricks_header(b)->tree.n_bricks;
	const size_t n_brick = bb_bricks_brick_bytes(bb_bricks_header(b));
	uint8_t *all = all_of(b), *out = malloc(BB_ARRAY_LEN(wants) * n_brick);
	struct bb_bricks_reader *reader[2] = { reader_of(b, 64, BB_BRICKS_CACHED), reader_of(b, 64, BB_BRICKS_DIRECT) };
	assert_true(n <= BB_ARRAY_LEN(wants));
	for (uint64_t size = r.report.result_bytes; size > 4000; size -= 4001) {
		assert_int_equal(truncate(r.result, (off_t)size), 0);
		for (size_t way = 0; way < 2; way++) {
			for (uint32_t i = 0; i < n; i++)
				wants[i] = (struct bb_bricks_want){ .brick = i, .out = out + i * n_brick };
			(void)bb_bricks_read_many(reader[way], wants, n, NULL);
			for (uint32_t i = 0; i < n; i++) {
				const bool there = bb_bricks_index(b)[i].offset + n_brick <= size;
				assert_int_equal(wants[i].number, there ? 0 : 1406);
				if (there)
					assert_memory_equal(wants[i].out, all + i * n_brick, n_brick);
			}
		}
	}
	bb_bricks_reader_destroy(reader[0]);
	bb_bricks_reader_destroy(reader[1]);
	free(all);
	free(out);
	bb_bricks_close(b);
	rig_end(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_way_gives_one_checksum),
		cmocka_unit_test(a_copy_is_a_copy),
		cmocka_unit_test(batches_of_any_file_are_its_bricks),
		cmocka_unit_test(four_threads_read_one_file),
		cmocka_unit_test(neighbours_are_joined),
		cmocka_unit_test(scattered_bricks_come_from_cache_and_disk),
		cmocka_unit_test(reading_allocates_nothing),
		cmocka_unit_test(what_does_not_pack_is_as_it_is),
		cmocka_unit_test(a_damaged_brick_fails_alone),
		cmocka_unit_test(a_file_that_shrinks_gives_what_it_has),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
