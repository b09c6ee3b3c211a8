/*
 * tests/test_bricks_input.c: what brick files are built from and read from when it is not the usual: sequences of
 * files, other types, the ends of the number line, a range known before, two builders at once, and files whose every
 * checksum is right and whose contents lie.
 */
#include "tests/brick_rig.h"

#include <fcntl.h>

static struct bb_bricks *build_of(struct brick_rig *r, const char *const *paths, size_t n)
{
	struct bb_error err = { 0 };

	bb_steps_close(r->steps);
	r->steps = NULL;
	if (bb_steps_open(paths, n, r->dir, &r->steps, &err) != BB_OK)
		fail_msg("%s", err.text);
	r->config.steps = r->steps;
	return rig_build(r);
}

static void put_file(const char *dir, const char *name, const void *bytes, size_t n)
{
	char path[256];

	snprintf(path, sizeof(path), "%s/%s", dir, name);
	FILE *f = fopen(path, "w");
	assert_non_null(f);
	assert_int_equal(fwrite(bytes, 1, n, f), n);
	fclose(f);
}

/* The data's own voxel, from the leaf that has it. */
static float voxel_of(const struct bb_bricks *b, uint32_t step, uint32_t x, uint32_t y, uint32_t z)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	const uint32_t edge = t->edge, side = edge + 2 * h->pad;
	const struct bb_tree_place p = { t->n_levels - 1, { x / edge, y / edge, z / edge } };
	const uint64_t id = (uint64_t)bb_tree_leaf_time(t, step) * t->n_nodes + bb_tree_node(t, &p);
	static uint8_t stored[68 * 68 * 68 * 4];
	static float v[68 * 68 * 68];

	assert_int_equal(bb_bricks_read(b, id, stored, NULL), BB_OK);
	bb_values_load(h, stored, (size_t)side * side * side, v);
	return v[((z % edge + h->pad) * side + y % edge + h->pad) * side + x % edge + h->pad];
}

static void a_sequence_of_files_is_one(void **state)
{
	static uint16_t part[3][6 * 5 * 4];
	struct brick_rig r;
	char path[3][256];
	const char *paths[3];
	(void)state;

	rig_begin(&r, 6, 5, 4, 1, 4);
	for (int i = 0; i < 3; i++) { /* the second big-endian */
		char name[32], text[200];
		for (unsigned k = 0; k < BB_ARRAY_LEN(part[i]); k++) {
			const uint16_t v = (uint16_t)(1000 * i + (int)k);
			part[i][k] = i == 1 ? __builtin_bswap16(v) : v;
		}
		snprintf(name, sizeof(name), "s%d.raw", i);
		put_file(r.dir, name, part[i], sizeof(part[i]));
		snprintf(text, sizeof(text), "file: s%d.raw\ndims: 6 5 4\ntype: u16\nbyte_order: %s\n", i,
			 i == 1 ? "big" : "little");
		snprintf(name, sizeof(name), "s%d.hdr.txt", i);
		put_file(r.dir, name, text, strlen(text));
		snprintf(path[i], sizeof(path[i]), "%s/s%d.hdr.txt", r.dir, i);
		paths[i] = path[i];
	}
	struct bb_bricks *b = build_of(&r, paths, 3);
	assert_int_equal(bb_bricks_header(b)->tree.n_steps, 3);
	for (uint32_t s = 0; s < 3; s++)
		for (uint32_t k = 0; k < 120; k++)
			assert_true(voxel_of(b, s, k % 6, k / 6 % 5, k / 30) == (float)(1000 * s + k));
	bb_bricks_close(b);
	/* One of another shape among them. */
	const char other[] = "file: s0.raw\ndims: 5 6 4\ntype: u16\n";
	struct bb_steps *steps;
	struct bb_error err = { 0 };
	put_file(r.dir, "s1.hdr.txt", other, strlen(other));
	assert_int_not_equal(bb_steps_open(paths, 3, r.dir, &steps, &err), BB_OK);
	assert_int_equal(err.number, 1446);
	assert_null(steps);
	assert_int_not_equal(bb_steps_open(paths, 0, r.dir, &steps, NULL), BB_OK);
	rig_end(&r);
}

/* A packed NIfTI-1 with scale and offset: what it is worth, not what it says. */
static void a_packed_nifti_is_unpacked(void **state)
{
	uint8_t file[352 + 8 * 7 * 6 * 2 * 2] = { 0 };
	const int16_t dim[8] = { 4, 8, 7, 6, 2, 1, 1, 1 };
	const float scale[2] = { 0.5f, -3 }, offset = 352, pixdim[8] = { 1, 1, 2, 3, 1, 1, 1, 1 };
	const int32_t size = 348;
	const int16_t type = 4, bits = 16;
	char command[300], path[256];
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 4, 4, 4, 1, 4);
	memcpy(file, &size, 4);
	memcpy(file + 40, dim, 16);
	memcpy(file + 70, &type, 2);
	memcpy(file + 72, &bits, 2);
	memcpy(file + 76, pixdim, 32);
	memcpy(file + 108, &offset, 4);
	memcpy(file + 112, scale, 8);
	memcpy(file + 344, "n+1", 4);
	for (int16_t i = 0; i < 8 * 7 * 6 * 2; i++)
		memcpy(file + 352 + 2 * i, &i, 2);
	put_file(r.dir, "v.nii", file, sizeof(file));
	snprintf(command, sizeof(command), "gzip %s/v.nii", r.dir);
	assert_int_equal(system(command), 0);
	snprintf(path, sizeof(path), "%s/v.nii.gz", r.dir);
	struct bb_bricks *b = build_of(&r, (const char *[]){ path }, 1);
	assert_string_equal(bb_bricks_header(b)->name, "v");
	assert_true(bb_bricks_header(b)->spacing_mm[1] == 2);
	for (uint32_t i = 0; i < 8 * 7 * 6 * 2; i++)
		assert_true(voxel_of(b, i / 336, i % 8, i / 8 % 7, i / 56 % 6) == 0.5f * (float)i - 3);
	bb_bricks_close(b);
	rig_end(&r);
}

/* ---- the ends of the number line ---- */

static void all_is_finite(const struct bb_bricks *b)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const size_t side = h->tree.edge + 2 * h->pad;
	uint8_t *stored = malloc(bb_bricks_brick_bytes(h));
	float *v = malloc(side * side * side * sizeof(float));
	uint16_t hist[BB_HIST_KINDS][BB_STATS_BINS];

	assert_true(stored && v);
	for (uint64_t id = 0; id < h->tree.n_bricks; id++) {
		const struct bb_bricks_moments *m = &bb_bricks_moments(b)[id];
		assert_int_equal(bb_bricks_read(b, id, stored, NULL), BB_OK);
		bb_values_load(h, stored, side * side * side, v);
		for (size_t i = 0; i < side * side * side; i++)
			assert_true(isfinite(v[i]));
		assert_true(isfinite(m->mean) && isfinite(m->deviation) && isfinite(m->time_dev) &&
			    isfinite(m->time_cov));
		assert_true(isfinite(m->leaf_error) && m->least <= m->most);
		assert_int_equal(bb_bricks_histograms(b, id, hist, NULL), BB_OK);
	}
	free(stored);
	free(v);
}

static void extreme_values_stay_finite(void **state)
{
	static const struct {
		float a, b;
	} pairs[] = { { 3.4e38f, -3.4e38f },
		      { 3.4e38f, 3.3e38f },
		      { 1e-45f, 0 },
		      { 7, 7 },
		      { 0, 0 },
		      { NAN, NAN },
		      { NAN, 5 },
		      { INFINITY, -INFINITY },
		      { 16777216, 16777218 } };
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(pairs); i++)
		for (int type = 0; type < BB_BRICK_TYPES; type++) {
			struct brick_rig r;
			rig_begin(&r, 11, 9, 10, 3, 4);
			for (size_t k = 0; k < rig_voxels(&r) * 3; k++)
				r.voxels[k] = k * 7 % 3 ? pairs[i].a : pairs[i].b;
			rig_write(&r);
			r.config.type = (enum bb_brick_type)type;
			struct bb_bricks *b = rig_build(&r);
			all_is_finite(b);
			bb_bricks_close(b);
			rig_end(&r);
		}
}

/* ---- builders ---- */

static bool stop_at_once(void *ctx, uint64_t done, uint64_t total)
{
	(void)done;
	(void)total;
	return ctx != NULL;
}

/* What was begun with one range is not gone on with for another; and what is not finite is counted once. */
static void a_stopped_build_knows_its_range(void **state)
{
	struct brick_rig r;
	int stops = 0;
	(void)state;

	rig_begin(&r, 20, 21, 40, 2, 8);
	for (uint32_t z = 0; z < 40; z++)
		r.voxels[(size_t)z * 20 * 21] = NAN;
	rig_write(&r);
	r.config.has_range = true;
	r.config.least = -2;
	r.config.most = 2;
	r.config.progress = stop_at_once;
	assert_int_equal(bb_bricks_build(&r.config, &r.report, NULL), BB_SKIPPED);
	r.config.most = 3;
	assert_int_equal(bb_bricks_build(&r.config, &r.report, NULL), BB_SKIPPED);
	assert_false(r.report.resumed);
	while (bb_bricks_build(&r.config, &r.report, NULL) == BB_SKIPPED)
		assert_true(r.report.resumed && ++stops < 100);
	struct bb_bricks *b;
	assert_int_equal(bb_bricks_open(r.result, &b, NULL), BB_OK);
	assert_true(bb_bricks_header(b)->most == 3);
	assert_int_equal(bb_bricks_header(b)->n_nonfinite, 40);
	assert_true(stops > 3);
	bb_bricks_close(b);
	rig_end(&r);
}

/* A state that was damaged on its disk is not gone on with. */
static void a_damaged_state_begins_anew(void **state)
{
	struct brick_rig r;
	char path[300];
	(void)state;

	rig_begin(&r, 20, 21, 40, 2, 8);
	r.config.progress = stop_at_once;
	assert_int_equal(bb_bricks_build(&r.config, &r.report, NULL), BB_SKIPPED);
	snprintf(path, sizeof(path), "%s.part.state", r.result);
	for (long at = 0; at < 4000; at += 313) {
		FILE *f = fopen(path, "r+");
		assert_non_null(f);
		assert_true(fseek(f, at, SEEK_SET) == 0);
		const int c = fgetc(f);
		assert_true(fseek(f, at, SEEK_SET) == 0 && fputc(c ^ 0x40, f) != EOF);
		fclose(f);
		assert_int_equal(bb_bricks_build(&r.config, &r.report, NULL), BB_SKIPPED);
		assert_false(r.report.resumed);
	}
	assert_int_equal(truncate(path, 100), 0);
	r.config.ctx = &r; /* to the end */
	struct bb_bricks *b = rig_build(&r);
	assert_false(r.report.resumed);
	all_is_finite(b);
	bb_bricks_close(b);
	rig_end(&r);
}

static bool build_beside(void *ctx, uint64_t done, uint64_t total)
{
	struct brick_rig *r = ctx;
	struct bb_build_config other = r->config;
	struct bb_build_report report;
	struct bb_error err = { 0 };
	(void)done;
	(void)total;

	other.progress = NULL;
	assert_int_equal(bb_bricks_build(&other, &report, &err), BB_ERR_BUSY);
	assert_int_equal(err.number, 1449);
	return true;
}

static void a_second_builder_is_refused(void **state)
{
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 20, 21, 22, 2, 8);
	r.config.progress = build_beside;
	r.config.ctx = &r;
	struct bb_bricks *b = rig_build(&r); /* and spoils nothing */
	all_is_finite(b);
	bb_bricks_close(b);
	rig_end(&r);
}

/* The data is cut short while it is read. */
static bool cut_data(void *ctx, uint64_t done, uint64_t total)
{
	const struct brick_rig *r = ctx;
	char path[160];
	(void)total;

	snprintf(path, sizeof(path), "%s/data.raw", r->dir);
	return done == 0 || truncate(path, 1000) == 0;
}

static void data_that_shrinks_is_an_error(void **state)
{
	struct brick_rig r;
	struct bb_error err = { 0 };
	(void)state;

	rig_begin(&r, 20, 21, 40, 2, 8);
	r.config.progress = cut_data;
	r.config.ctx = &r;
	assert_int_equal(bb_bricks_build(&r.config, &r.report, &err), BB_ERR_FORMAT);
	assert_int_equal(err.number, 1406);
	assert_int_not_equal(access(r.result, F_OK), 0);
	rig_end(&r);
}

/* ---- liars with good checksums ---- */

/* Changes bytes of a record section and mends its checksum and the header's. */
static void rewrite(const char *path, bool index, uint64_t at, const void *bytes, size_t n)
{
	uint8_t header[BB_BRICKS_HEADER_BYTES];
	const int where = index ? 160 : 184;
	const int fd = open(path, O_RDWR | O_CLOEXEC);

	assert_true(fd >= 0 && pread(fd, header, sizeof(header), 0) == (ssize_t)sizeof(header));
	const uint64_t from = bb_get_u64(header + where), size = bb_get_u64(header + where + 8);
	uint8_t *section = malloc(size);
	assert_true(section && pread(fd, section, size, (off_t)from) == (ssize_t)size);
	memcpy(section + at, bytes, n);
	assert_int_equal(pwrite(fd, section, size, (off_t)from), (ssize_t)size);
	bb_put_u32(header + where + 16, bb_crc32c(0, section, size));
	bb_put_u32(header + sizeof(header) - 4, bb_crc32c(0, header, sizeof(header) - 4));
	assert_int_equal(pwrite(fd, header, sizeof(header), 0), (ssize_t)sizeof(header));
	free(section);
	close(fd);
}

static int opened(const char *path)
{
	struct bb_error err = { 0 };
	struct bb_bricks *b;

	if (bb_bricks_open(path, &b, &err) == BB_OK)
		bb_bricks_close(b);
	return err.number;
}

static void records_that_lie_are_refused(void **state)
{
	struct brick_rig r;
	uint8_t record[16], kept[16];
	(void)state;

	rig_begin(&r, 12, 9, 10, 2, 4);
	struct bb_bricks *b = rig_build(&r);
	const struct bb_bricks_record good = bb_bricks_index(b)[3], hist = bb_bricks_moments(b)[5].histograms;
	bb_bricks_close(b);
	const struct bb_bricks_record lies[] = {
		{ 0, good.bytes, 0 },           { UINT64_MAX, good.bytes, 0 },      { r.report.result_bytes, 1, 0 },
		{ good.offset, UINT32_MAX, 0 }, { good.offset, good.bytes + 1, 0 },
	};
	bb_bricks_record_write(&good, kept);
	for (size_t i = 0; i < BB_ARRAY_LEN(lies); i++) {
		bb_bricks_record_write(&lies[i], record);
		rewrite(r.result, true, 3 * BB_BRICKS_INDEX_BYTES, record, 16);
		assert_int_equal(opened(r.result), 1445);
	}
	rewrite(r.result, true, 3 * BB_BRICKS_INDEX_BYTES, kept, 16);
	assert_int_equal(opened(r.result), 0);
	const struct bb_bricks_record far = { hist.offset, 100000, 0 };
	bb_bricks_record_write(&far, record);
	rewrite(r.result, false, 5 * BB_BRICKS_MOMENTS_BYTES + 28, record, 16);
	assert_int_equal(opened(r.result), 1445);
	rig_end(&r);
}

/* A record that points at other bytes of the file, with their right checksum: whatever they are, nothing bad comes of
 * it. */
static void bytes_that_are_no_brick_are_refused(void **state)
{
	static const enum bb_brick_codec codecs[] = { BB_BRICK_PLAIN, BB_BRICK_LZ4, BB_BRICK_ZSTD };
	(void)state;

	for (size_t c = 0; c < BB_ARRAY_LEN(codecs); c++) {
		struct brick_rig r;
		uint8_t bytes[64], record[16], stored[6 * 6 * 6 * 4];
		uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
		struct bb_error err = { 0 };
		rig_begin(&r, 12, 9, 10, 2, 4);
		r.config.codec = codecs[c];
		struct bb_bricks *b = rig_build(&r);
		bb_bricks_close(b);
		const int fd = open(r.result, O_RDONLY | O_CLOEXEC);
		assert_true(fd >= 0 && pread(fd, bytes, sizeof(bytes), 4200) == (ssize_t)sizeof(bytes));
		close(fd);
		const struct bb_bricks_record other = { 4200, sizeof(bytes), bb_crc32c(0, bytes, sizeof(bytes)) };
		bb_bricks_record_write(&other, record);
		rewrite(r.result, true, 0, record, 16);
		rewrite(r.result, false, 28, record, 16);
		assert_int_equal(bb_bricks_open(r.result, &b, NULL), BB_OK);
		assert_int_not_equal(bb_bricks_read(b, 0, stored, &err), BB_OK);
		assert_int_equal(err.number, 1450);
		err = (struct bb_error){ 0 };
		if (bb_bricks_histograms(b, 0, h, &err) != BB_OK)
			assert_int_equal(err.number, 1450);
		assert_int_equal(bb_bricks_read(b, bb_bricks_header(b)->tree.n_bricks, stored, NULL), BB_ERR_USAGE);
		bb_bricks_close(b);
		rig_end(&r);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_sequence_of_files_is_one),
		cmocka_unit_test(a_packed_nifti_is_unpacked),
		cmocka_unit_test(extreme_values_stay_finite),
		cmocka_unit_test(a_stopped_build_knows_its_range),
		cmocka_unit_test(a_damaged_state_begins_anew),
		cmocka_unit_test(a_second_builder_is_refused),
		cmocka_unit_test(data_that_shrinks_is_an_error),
		cmocka_unit_test(records_that_lie_are_refused),
		cmocka_unit_test(bytes_that_are_no_brick_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
