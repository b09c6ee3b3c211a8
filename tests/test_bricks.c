/* tests/test_bricks.c: brick files: shape, every voxel of every level, statistics, caps, codecs, stops and damage. */
#include "tests/brick_rig.h"

#include <signal.h>
#include <sys/resource.h>

/* ---- shape ---- */

static void the_tree_knows_its_relatives(void **state)
{
	uint64_t seed = 5;
	(void)state;

	for (int i = 0; i < 300; i++) {
		const uint32_t dim[3] = { 1 + rig_random(&seed) % 90, 1 + rig_random(&seed) % 90,
					  1 + rig_random(&seed) % 90 };
		const uint32_t steps = 1 + rig_random(&seed) % 13, edge = 4 + 2 * (rig_random(&seed) % 7);
		struct bb_tree t;
		uint32_t child[8];
		uint64_t covered = 0;
		assert_true(bb_tree_init(&t, dim, steps, edge));
		assert_int_equal(t.first[1], 1);
		assert_int_equal(t.n_bricks, (uint64_t)t.n_nodes * (2 * steps - 1));
		for (uint32_t n = 0; n < t.n_nodes; n++) {
			const struct bb_tree_place p = bb_tree_place(&t, n);
			const uint32_t children = bb_tree_children(&t, n, child);
			assert_int_equal(bb_tree_node(&t, &p), n);
			assert_int_equal(children == 0, p.level + 1 == t.n_levels);
			uint64_t of_children = 0;
			for (uint32_t c = 0; c < children; c++) {
				assert_int_equal(bb_tree_parent(&t, child[c]), n);
				of_children += bb_tree_covered(&t, child[c]);
			}
			assert_true(!children || of_children == bb_tree_covered(&t, n));
			covered += children ? 0 : bb_tree_covered(&t, n);
		}
		assert_int_equal(covered, (uint64_t)dim[0] * dim[1] * dim[2]);
		for (uint32_t tau = 0; tau < t.n_times; tau++) {
			const struct bb_tree_span s = bb_tree_span(&t, tau);
			assert_true(s.from < s.to && s.to <= steps);
			if (s.to - s.from == 1) {
				assert_int_equal(bb_tree_leaf_time(&t, s.from), tau);
				continue;
			}
			const struct bb_tree_span a = bb_tree_span(&t, s.child[0]), b = bb_tree_span(&t, s.child[1]);
			assert_true(a.from == s.from && a.to == b.from && b.to == s.to);
			assert_true(a.parent == tau && b.parent == tau);
		}
	}
}

static void the_seeds_tree_has_as_many_bricks_as_they_say(void **state)
{
	struct bb_tree t;
	(void)state;

	assert_true(bb_tree_init(&t, (const uint32_t[]){ 256, 256, 256 }, 8, 8));
	assert_int_equal(t.n_nodes, 37449);
	assert_int_equal(t.n_bricks, 561735);
	assert_false(bb_tree_init(&t, (const uint32_t[]){ 256, 256, 0 }, 8, 8));
	assert_false(bb_tree_init(&t, (const uint32_t[]){ 256, 256, 256 }, 0, 8));
	assert_false(bb_tree_init(&t, (const uint32_t[]){ 256, 256, 256 }, 8, 7));
	assert_false(bb_tree_init(&t, (const uint32_t[]){ 1u << 20, 1u << 20, 1u << 20 }, 1, 4));
}

/* ---- statistics ---- */

static double raw_voxel(const struct brick_rig *r, uint32_t step, uint64_t i)
{
	return (double)r->voxels[step * rig_voxels(r) + i];
}

/* Moments of a node from all of its voxels, in two passes of long double. */
static void check_moments(const struct brick_rig *r, const struct bb_bricks *b, uint64_t id)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	const struct bb_tree_place p = bb_tree_place(t, (uint32_t)(id % t->n_nodes));
	const struct bb_tree_span s = bb_tree_span(t, (uint32_t)(id / t->n_nodes));
	const struct bb_bricks_moments *m = &bb_bricks_moments(b)[id];
	const uint32_t reach = t->edge << (t->n_levels - 1 - p.level);
	long double sum = 0, square = 0, dev = 0;
	double least = (double)INFINITY, most = -(double)INFINITY, n = 0, positions = 0;

	for (int pass = 0; pass < 2; pass++)
		for (uint32_t z = p.at[2] * reach; z < (p.at[2] + 1) * reach && z < r->dim[2]; z++)
			for (uint32_t y = p.at[1] * reach; y < (p.at[1] + 1) * reach && y < r->dim[1]; y++)
				for (uint32_t x = p.at[0] * reach; x < (p.at[0] + 1) * reach && x < r->dim[0]; x++) {
					const uint64_t i = ((uint64_t)z * r->dim[1] + y) * r->dim[0] + x;
					long double mean = 0, var = 0;
					for (uint32_t step = s.from; step < s.to; step++) {
						const double v = raw_voxel(r, step, i);
						mean += (long double)v / (s.to - s.from);
						if (!pass) {
							sum += (long double)v;
							n++;
							least = fmin(least, v);
							most = fmax(most, v);
						} else {
							square += ((long double)v - sum / (long double)n) *
								  ((long double)v - sum / (long double)n);
						}
					}
					if (!pass)
						continue;
					for (uint32_t step = s.from; step < s.to; step++)
						var += ((long double)raw_voxel(r, step, i) - mean) *
						       ((long double)raw_voxel(r, step, i) - mean);
					dev += sqrtl(var / (s.to - s.from));
					positions++;
				}
	assert_true(fabs((double)m->mean - (double)(sum / (long double)n)) <= 1e-6);
	assert_true(fabs((double)m->deviation - (double)sqrtl(square / (long double)n)) <= 1e-6);
	assert_true(fabs((double)m->time_dev - (double)dev / positions) <= 2e-6);
	assert_true((double)m->least == least && (double)m->most == most);
}

static void statistics_are_those_of_the_voxels(void **state)
{
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 37, 20, 29, 5, 8);
	struct bb_bricks *b = rig_build(&r);
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
	for (uint64_t id = 0; id < t->n_bricks; id++) {
		double values = 0;
		check_moments(&r, b, id);
		assert_int_equal(bb_bricks_histograms(b, id, h, NULL), BB_OK);
		for (int i = 0; i < BB_STATS_BINS; i++)
			values += h[BB_HIST_VALUE][i];
		assert_true(fabs(values - 65535) <= BB_STATS_BINS * 4); /* roundings of each merge */
	}
	bb_bricks_close(b);
	rig_end(&r);
}

/* The sum of an error histogram is the mean error in bins, which the slow way knows. */
static void error_histograms_hold_the_errors(void **state)
{
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 40, 33, 32, 4, 8);
	struct bb_bricks *b = rig_build(&r);
	const struct bb_bricks_header *head = bb_bricks_header(b);
	const struct bb_tree *t = &head->tree;
	const double bin = (head->most - head->least) / BB_STATS_BINS;
	uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
	for (uint64_t id = 0; id < t->n_bricks; id++) {
		const struct bb_tree_place p = bb_tree_place(t, (uint32_t)(id % t->n_nodes));
		const struct bb_tree_span s = bb_tree_span(t, (uint32_t)(id / t->n_nodes));
		double sum[BB_HIST_KINDS] = { 0 };
		assert_int_equal(bb_bricks_histograms(b, id, h, NULL), BB_OK);
		for (int kind = 0; kind < BB_HIST_KINDS; kind++)
			for (int i = 0; i < BB_STATS_BINS; i++)
				sum[kind] += h[kind][i] / 65535.0;
		const bool leaf = p.level + 1 == t->n_levels, step = s.to - s.from == 1;
		assert_true(fabs(sum[BB_HIST_LEAF] * bin - (double)bb_bricks_moments(b)[id].leaf_error) <=
			    2e-3 * bin + 1e-6);
		assert_true((sum[BB_HIST_LEAF] > 0) == !(leaf && step));
		assert_true((sum[BB_HIST_SPACE] > 0) == !leaf);
		assert_true((sum[BB_HIST_TIME] > 0) == !step);
		if (leaf || step)
			continue;
		/* By the triangle inequality no worse than the steps in between; and not better than nothing. */
		assert_true(sum[BB_HIST_LEAF] < 20 * (sum[BB_HIST_SPACE] + sum[BB_HIST_TIME]));
	}
	bb_bricks_close(b);
	rig_end(&r);
}

static void a_zero_mean_is_not_infinitely_uneven(void **state)
{
	struct bb_moments m = { .n = 4, .mean = 0, .m2 = 4 };
	(void)state;

	assert_true(fabs(bb_moments_cov(&m, 10) - 100) < 1e-9);
	m.mean = -2;
	assert_true(fabs(bb_moments_cov(&m, 10) - 0.5) < 1e-12);
	m = (struct bb_moments){ .n = 4 };
	assert_true(bb_moments_cov(&m, 0) == 0);
}

static void histograms_survive_their_coding(void **state)
{
	uint64_t seed = 9;
	(void)state;

	for (int i = 0; i < 20000; i++) {
		uint16_t h[BB_STATS_BINS] = { 0 }, back[BB_STATS_BINS];
		uint8_t coded[BB_HISTOGRAM_CODED_MOST];
		const uint32_t many = rig_random(&seed) % BB_STATS_BINS;
		for (uint32_t k = 0; k < many; k++)
			h[rig_random(&seed) % BB_STATS_BINS] = (uint16_t)(rig_random(&seed) >> rig_random(&seed) % 16);
		const size_t n = bb_histogram_encode(h, coded);
		assert_true(n >= 1 && n <= sizeof(coded));
		assert_int_equal(bb_histogram_decode(coded, n, back), n);
		assert_memory_equal(h, back, sizeof(h));
		assert_int_equal(bb_histogram_decode(coded, n - 1, back), 0);
	}
}

/* ---- building ---- */

static void caps_and_threads_do_not_change_the_result(void **state)
{
	static const struct {
		uint64_t memory_bytes;
		unsigned threads;
	} ways[] = { { 64u << 20, 1 }, { 64u << 20, 16 }, { 1100u << 10, 2 } };
	uint32_t crc[BB_ARRAY_LEN(ways)];
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(ways); i++) {
		struct brick_rig r;
		uint8_t stored[10 * 10 * 10 * 4];
		rig_begin(&r, 41, 50, 30, 3, 8);
		r.config.memory_bytes = ways[i].memory_bytes;
		r.config.threads = ways[i].threads;
		struct bb_bricks *b = rig_build(&r);
		assert_true(r.report.peak_bytes <= r.config.memory_bytes);
		crc[i] = 0;
		for (uint64_t id = 0; id < bb_bricks_header(b)->tree.n_bricks; id++) {
			assert_int_equal(bb_bricks_read(b, id, stored, NULL), BB_OK);
			crc[i] = bb_crc32c(crc[i], stored, sizeof(stored));
		}
		bb_bricks_close(b);
		rig_end(&r);
		assert_int_equal(crc[i], crc[0]);
	}
}

static uint32_t crc_of_file(const char *path)
{
	FILE *f = fopen(path, "r");
	uint32_t crc = 0;
	uint8_t buf[4096];
	size_t n;

	assert_non_null(f);
	while ((n = fread(buf, 1, sizeof(buf), f)) > 0)
		crc = bb_crc32c(crc, buf, n);
	fclose(f);
	return crc;
}

static void too_small_a_cap_is_said(void **state)
{
	struct brick_rig r;
	struct bb_error err = { 0 };
	(void)state;

	rig_begin(&r, 60, 60, 60, 4, 8);
	r.config.memory_bytes = 1u << 20;
	assert_int_equal(bb_bricks_build(&r.config, &r.report, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1447);
	assert_int_not_equal(access(r.result, F_OK), 0);
	rig_end(&r);
}

struct stopper {
	int left;
};

static bool stop_later(void *ctx, uint64_t done, uint64_t total)
{
	struct stopper *s = ctx;

	assert_true(done <= total);
	return s->left-- > 0;
}

/* Stopped after any slab, gone on with, stopped again: the same bytes in the end; over the seam of an angle too. */
static void stop_and_go_on(enum bb_brick_grid grid)
{
	uint32_t crc[2] = { 0 };

	for (int stopped = 0; stopped < 2; stopped++) {
		struct brick_rig r;
		struct stopper s = { 0 };
		struct bb_error err = { 0 };
		int stops = 0;
		rig_begin(&r, 41, 50, 30, 3, 8);
		r.config.memory_bytes = 1000u << 10; /* several tiles */
		r.config.grid = grid;
		memcpy(r.config.extent, (const double[]){ 1, 2, 0, 3, 0, 6.283185307179586 }, sizeof(r.config.extent));
		if (stopped) {
			r.config.progress = stop_later;
			r.config.ctx = &s;
		}
		while (bb_bricks_build(&r.config, &r.report, &err) == BB_SKIPPED) {
			assert_true(r.report.resumed == (stops > 0));
			s.left = ++stops % 3;
		}
		if (err.number)
			fail_msg("%s", err.text);
		if (stopped && stops < 5)
			fail_msg("only %d stops", stops);
		crc[stopped] = crc_of_file(r.result);
		rig_end(&r);
	}
	assert_int_equal(crc[0], crc[1]);
}

/* What could not be written is not told to the next build as if it had been. */
static void a_stop_on_a_full_disk_keeps_nothing(void **state)
{
	const struct rlimit little = { 800000, RLIM_INFINITY }; /* two slabs are more; scratch file and state are less */
	struct stopper s = { .left = 1 };
	struct bb_error err = { 0 };
	struct rlimit all;
	struct brick_rig r;
	char path[160];
	(void)state;

	signal(SIGXFSZ, SIG_IGN);
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &all), 0);
	rig_begin(&r, 40, 40, 40, 3, 8);
	r.config.progress = stop_later;
	r.config.ctx = &s;
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &little), 0);
	assert_int_equal(bb_bricks_build(&r.config, &r.report, &err), BB_ERR_IO);
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &all), 0);
	assert_int_equal(err.number, 1901);
	snprintf(path, sizeof(path), "%s.part.state", r.result);
	assert_int_not_equal(access(path, F_OK), 0);
	rig_end(&r);
}

static void a_stop_loses_nothing(void **state)
{
	(void)state;

	for (int grid = 0; grid < BB_BRICK_GRIDS; grid++)
		stop_and_go_on((enum bb_brick_grid)grid);
}

static void check_filled(enum bb_brick_type type, enum bb_brick_grid grid, bool known)
{
	struct brick_rig r;
	uint8_t stored[10 * 10 * 10 * 4];

	rig_begin(&r, 20, 21, 22, 2, 8);
	r.voxels[5] = NAN; /* its neighbours over the seam see it too, and count it no second time */
	r.voxels[777] = INFINITY;
	r.voxels[rig_voxels(&r) * 2 - 1] = -INFINITY;
	rig_write(&r);
	r.config.type = type;
	r.config.grid = grid;
	memcpy(r.config.extent, (const double[]){ 1, 2, 0, 3, 0, 6.283185307179586 }, sizeof(r.config.extent));
	r.config.has_range = known;
	r.config.least = -2;
	r.config.most = 2;
	r.config.memory_bytes = 1000u << 10; /* several tiles: rows are read twice and counted once */
	struct bb_bricks *b = rig_build(&r);
	const struct bb_bricks_header *h = bb_bricks_header(b);
	assert_int_equal(h->n_nonfinite, 3);
	for (uint64_t id = 0; id < h->tree.n_bricks; id++) {
		float v[10 * 10 * 10];
		assert_int_equal(bb_bricks_read(b, id, stored, NULL), BB_OK);
		bb_values_load(h, stored, BB_ARRAY_LEN(v), v);
		for (size_t i = 0; i < BB_ARRAY_LEN(v); i++)
			assert_true(isfinite(v[i]));
		const struct bb_tree_place p = bb_tree_place(&h->tree, (uint32_t)(id % h->tree.n_nodes));
		const struct bb_tree_span s = bb_tree_span(&h->tree, (uint32_t)(id / h->tree.n_nodes));
		if (p.level + 1 == h->tree.n_levels && s.from == 0 && s.to == 1 && !p.at[0] && !p.at[1] && !p.at[2])
			assert_true((double)v[(1 * 10 + 1) * 10 + 6] == (double)(float)h->least);
	}
	bb_bricks_close(b);
	rig_end(&r);
}

static void what_is_not_finite_is_counted_and_filled(void **state)
{
	(void)state;

	for (int way = 0; way < 2 * BB_BRICK_TYPES * BB_BRICK_GRIDS; way++)
		check_filled((enum bb_brick_type)(way / 2 % BB_BRICK_TYPES),
			     (enum bb_brick_grid)(way / 2 / BB_BRICK_TYPES), way % 2);
}

/* ---- damage ---- */

static void every_byte_of_a_header_is_guarded(void **state)
{
	struct brick_rig r;
	uint8_t header[BB_BRICKS_HEADER_BYTES];
	(void)state;

	rig_begin(&r, 12, 9, 10, 2, 4);
	struct bb_bricks *b = rig_build(&r);
	bb_bricks_close(b);
	FILE *f = fopen(r.result, "r+");
	assert_non_null(f);
	assert_int_equal(fread(header, 1, sizeof(header), f), sizeof(header));
	for (long at = 0; at < 320; at++) {
		struct bb_error err = { 0 };
		assert_true(fseek(f, at, SEEK_SET) == 0 && fputc(header[at] ^ 0x55, f) != EOF && fflush(f) == 0);
		assert_int_not_equal(bb_bricks_open(r.result, &b, &err), BB_OK);
		assert_true(err.number == 1440 || err.number == 1441);
		assert_true(fseek(f, at, SEEK_SET) == 0 && fputc(header[at], f) != EOF && fflush(f) == 0);
	}
	assert_int_equal(bb_bricks_open(r.result, &b, NULL), BB_OK);
	bb_bricks_close(b);
	fclose(f);
	rig_end(&r);
}

/* Fields that lie behind a good checksum: a liar who knows the format. */
static void a_header_that_lies_is_refused(void **state)
{
	static const struct {
		int at;
		uint64_t value;
		int number;
	} lies[] = {
		{ 8, BB_BRICKS_VERSION + 1, 1440 },
		{ 16, 0, 1442 },
		{ 16, UINT32_MAX, 1442 },
		{ 20, 1u << 20, 1442 },
		{ 28, 0, 1442 },
		{ 28, 70000, 1442 },
		{ 32, 3, 1442 },
		{ 32, 66, 1442 },
		{ 36, 3, 1443 },
		{ 40, 4, 1443 },
		{ 44, 3, 1443 },
		{ 48, 2, 1443 },
		{ 56, 0, 1444 },
		{ 128, UINT64_MAX, 1444 },
		{ 136, 0x7FF0000000000000, 1444 },
		{ 152, 1, 1442 },
		{ 160, 0, 1445 },
		{ 160, UINT64_MAX, 1445 },
		{ 168, UINT64_MAX, 1445 },
		{ 168, 16, 1445 },
		{ 184, 1ull << 60, 1445 },
		{ 192, 47, 1445 },
	};
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 12, 9, 10, 2, 4);
	struct bb_bricks *b = rig_build(&r);
	bb_bricks_close(b);
	FILE *f = fopen(r.result, "r");
	uint8_t good[BB_BRICKS_HEADER_BYTES], header[BB_BRICKS_HEADER_BYTES];
	assert_non_null(f);
	assert_int_equal(fread(good, 1, sizeof(good), f), sizeof(good));
	fclose(f);
	for (size_t i = 0; i < BB_ARRAY_LEN(lies); i++) {
		struct bb_bricks_header h;
		struct bb_error err = { 0 };
		memcpy(header, good, sizeof(header));
		if (lies[i].at >= 56)
			bb_put_u64(header + lies[i].at, lies[i].value);
		else
			bb_put_u32(header + lies[i].at, (uint32_t)lies[i].value);
		bb_put_u32(header + sizeof(header) - 4, bb_crc32c(0, header, sizeof(header) - 4));
		assert_int_not_equal(bb_bricks_header_read(header, r.report.result_bytes,
							   &(struct bb_where){ r.result, 0, 0 }, &h, &err),
				     BB_OK);
		if (err.number != lies[i].number)
			fail_msg("field %d = %llu: %s", lies[i].at, (unsigned long long)lies[i].value, err.text);
	}
	rig_end(&r);
}

static void a_damaged_brick_is_one_brick(void **state)
{
	struct brick_rig r;
	uint8_t stored[10 * 10 * 10 * 4];
	struct bb_error err = { 0 };
	(void)state;

	rig_begin(&r, 20, 20, 20, 2, 8);
	r.config.codec = BB_BRICK_LZ4;
	struct bb_bricks *b = rig_build(&r);
	FILE *f = fopen(r.result, "r+");
	assert_non_null(f);
	assert_true(fseek(f, (long)bb_bricks_index(b)[7].offset + 3, SEEK_SET) == 0 && fputc(0x5A, f) != EOF);
	fclose(f);
	for (uint64_t id = 0; id < bb_bricks_header(b)->tree.n_bricks; id++)
		assert_true((bb_bricks_read(b, id, stored, id == 7 ? &err : NULL) == BB_OK) == (id != 7));
	assert_int_equal(err.number, 1441);
	/* Cut short while it is open. */
	assert_int_equal(truncate(r.result, 5000), 0);
	err = (struct bb_error){ 0 };
	assert_int_not_equal(bb_bricks_read(b, bb_bricks_header(b)->tree.n_bricks - 1, stored, &err), BB_OK);
	assert_int_equal(err.number, 1406);
	bb_bricks_close(b);
	rig_end(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_tree_knows_its_relatives),
		cmocka_unit_test(the_seeds_tree_has_as_many_bricks_as_they_say),
		cmocka_unit_test(statistics_are_those_of_the_voxels),
		cmocka_unit_test(error_histograms_hold_the_errors),
		cmocka_unit_test(a_zero_mean_is_not_infinitely_uneven),
		cmocka_unit_test(histograms_survive_their_coding),
		cmocka_unit_test(caps_and_threads_do_not_change_the_result),
		cmocka_unit_test(too_small_a_cap_is_said),
		cmocka_unit_test(a_stop_loses_nothing),
		cmocka_unit_test(a_stop_on_a_full_disk_keeps_nothing),
		cmocka_unit_test(what_is_not_finite_is_counted_and_filled),
		cmocka_unit_test(every_byte_of_a_header_is_guarded),
		cmocka_unit_test(a_header_that_lies_is_refused),
		cmocka_unit_test(a_damaged_brick_is_one_brick),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
