/* tests/test_budget.c: every verdict at its edges, and who is named for a miss. */
#include "tests/fixture_result.h"

#include "bench/cli.h"

#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>

#define NONE ((double)NAN)

struct rig { /* a room of three nodes with one budget */
	struct bb_room room;
	struct bb_scene scene;
	struct bb_node nodes[3];
	struct bb_run_result *r;
};

static struct rig rig_create(enum bb_metric metric, enum bb_stat stat, double limit, double marginal)
{
	struct rig g = { .r = calloc(1, sizeof(*g.r)) };

	snprintf(g.room.name, sizeof(g.room.name), "room");
	snprintf(g.scene.name, sizeof(g.scene.name), "scene");
	g.room.n_nodes = 3;
	snprintf(g.nodes[0].id, BB_ID_MAX, "left");
	snprintf(g.nodes[1].id, BB_ID_MAX, "right");
	snprintf(g.nodes[2].id, BB_ID_MAX, "head");
	g.room.degraded_max_s = 1;
	g.room.budgets[0] = fixture_budget(metric, stat, limit, marginal, NULL, 0);
	g.room.n_budgets = 1;
	for (int c = 0; c < BB_CLASS_COUNT; c++)
		g.scene.needs[c] = 1;
	g.r->duration_s = 10;
	g.r->scene_start_s = 2;
	assert_int_equal(bb_ledger_create(1000, 3, &g.r->ledger), BB_OK);
	return g;
}

static void add(struct rig *g, double value, double sigma, uint64_t frame, uint16_t node, enum bb_stage stage)
{
	const struct bb_sample s = { value, sigma,          frame, 2 * BB_NS_PER_S + (int64_t)frame * 10000000,
		                     node,  (uint16_t)stage };

	bb_ledger_sample(g->r->ledger, g->room.budgets[0].metric, &s);
}

static const struct bb_budget_result *judge(struct rig *g)
{
	g->room.nodes = g->nodes;
	g->r->room = &g->room;
	g->r->scene = &g->scene;
	assert_int_equal(bb_result_judge(g->r), BB_OK);
	return &g->r->budgets[0];
}

static void incident(struct rig *g, const char *culprit, int64_t from_ns, int64_t to_ns)
{
	struct bb_incident *in;

	g->r->incidents = realloc(g->r->incidents, (g->r->n_incidents + 1) * sizeof(*in));
	in = &g->r->incidents[g->r->n_incidents++];
	*in = (struct bb_incident){ .from_ns = from_ns, .to_ns = to_ns };
	snprintf(in->culprit, sizeof(in->culprit), "%s", culprit);
	snprintf(in->what, sizeof(in->what), "ill");
	snprintf(in->state, sizeof(in->state), "DEGRADED");
}

static void device(struct rig *g, const char *class_name, const char *id, const char *health, double bad_s, int fidelity)
{
	struct bb_device_result *d;

	g->r->devices = realloc(g->r->devices, (g->r->n_devices + 1) * sizeof(*d));
	d = &g->r->devices[g->r->n_devices++];
	*d = (struct bb_device_result){ .fidelity = fidelity, .longest_bad_s = bad_s, .bad_s = bad_s };
	snprintf(d->class_name, sizeof(d->class_name), "%s", class_name);
	snprintf(d->id, sizeof(d->id), "%s", id);
	snprintf(d->health, sizeof(d->health), "%s", health);
}

static enum bb_verdict verdict_of(enum bb_metric metric, enum bb_stat stat, double limit, double marginal, double value,
                                  double sigma)
{
	struct rig g = rig_create(metric, stat, limit, marginal);
	enum bb_verdict v;

	add(&g, value, sigma, 1, 0, BB_STAGE_DRAW);
	v = judge(&g)->verdict;
	bb_run_result_free(g.r);
	return v;
}

static void test_edges(void **state)
{
	(void)state;
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE, 8, 0), BB_PASS);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE, 8.001, 0), BB_FAIL);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, 7, 7, 0), BB_PASS);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, 7, 7.5, 0), BB_MARGINAL);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE, 7.9, 0.06), BB_INCONCLUSIVE);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE, 8.1, 0.06), BB_INCONCLUSIVE);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE, 8.1, 0.04), BB_FAIL);
	assert_int_equal(verdict_of(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE, 7.9, 0.04), BB_PASS);
	assert_int_equal(verdict_of(BB_METRIC_PHASE, BB_STAT_MAX_ABS, 300, NONE, -900, 0), BB_FAIL);
	assert_int_equal(verdict_of(BB_METRIC_PHASE, BB_STAT_MAX, 300, NONE, -900, 0), BB_PASS);
}

static void test_lower_limits(void **state)
{
	(void)state;
	assert_int_equal(verdict_of(BB_METRIC_PSNR, BB_STAT_MIN, 30, 35, 40, 0), BB_PASS);
	assert_int_equal(verdict_of(BB_METRIC_PSNR, BB_STAT_MIN, 30, 35, 33, 0), BB_MARGINAL);
	assert_int_equal(verdict_of(BB_METRIC_PSNR, BB_STAT_MIN, 30, 35, 29, 0), BB_FAIL);
	assert_int_equal(verdict_of(BB_METRIC_TRACKED, BB_STAT_MIN, 99, NONE, 99, 0), BB_PASS);
	assert_int_equal(verdict_of(BB_METRIC_TRACKED, BB_STAT_MIN, 99, NONE, 98.9, 0), BB_FAIL);
}

static void test_skips_say_why(void **state)
{
	struct rig g = rig_create(BB_METRIC_CROSSTALK, BB_STAT_MAX, 2, NONE);
	const struct bb_budget_result *b;

	(void)state;
	add(&g, 50, 0, 1, 0, BB_STAGE_SHUTTER); /* what a fidelity cannot know must not be judged even if it is there */
	b = judge(&g);
	assert_int_equal(b->verdict, BB_SKIP);
	assert_string_equal(b->cause, "needs shutters at fidelity 2, the scene asks for 1");
	g.scene.needs[BB_CLASS_SHUTTERS] = BB_NOT_NEEDED;
	assert_string_equal(judge(&g)->cause, "the scene does not use shutters");
	bb_run_result_free(g.r);

	g = rig_create(BB_METRIC_FRAME, BB_STAT_P99, 2, NONE);
	assert_string_equal(judge(&g)->cause, "no samples");
	assert_int_equal(g.r->verdict, BB_SKIP);
	assert_int_equal(g.r->exit_code, BB_EXIT_SKIPPED);
	bb_run_result_free(g.r);
}

static void test_counts_are_summed(void **state)
{
	struct rig g = rig_create(BB_METRIC_TORN_FRAMES, BB_STAT_MAX, 2, NONE);
	const struct bb_budget_result *b;

	(void)state;
	for (uint64_t i = 0; i < 100; i++)
		add(&g, i == 20 || i == 21 || i == 50, 0, i, i == 50 ? 0 : 1, BB_STAGE_DRAW);
	b = judge(&g);
	assert_int_equal(b->verdict, BB_FAIL);
	assert_true(fabs(b->value - 3) < 1e-9);
	assert_string_equal(b->culprit, "node/right");
	bb_run_result_free(g.r);
}

static void test_tracked_is_a_share(void **state)
{
	struct rig g = rig_create(BB_METRIC_TRACKED, BB_STAT_MIN, 95, NONE);

	(void)state;
	for (uint64_t i = 0; i < 100; i++)
		add(&g, i < 4 ? 0 : 100, 0, i, 0xFFFF, BB_STAGE_COUNT);
	assert_int_equal(judge(&g)->verdict, BB_PASS);
	assert_true(fabs(g.r->budgets[0].value - 96) < 1e-9);
	bb_run_result_free(g.r);
}

static void test_node_and_stage(void **state)
{
	struct rig g = rig_create(BB_METRIC_FRAME, BB_STAT_MAX, 8.33, NONE);
	const struct bb_budget_result *b;

	(void)state;
	for (uint64_t i = 0; i < 200; i++) {
		const bool late = i >= 100 && i < 120;
		const int64_t at = 2 * BB_NS_PER_S + (int64_t)i * 10000000;
		add(&g, 6, 0, i, 0, BB_STAGE_DRAW);
		add(&g, late ? 25.5 : 6, 0, i, 1, late ? BB_STAGE_DRAW : BB_STAGE_SELECT);
		bb_ledger_span(g.r->ledger, i, BB_STAGE_DRAW, 1, 0, at, at + (late ? 24900000 : 5000000));
	}
	b = judge(&g);
	assert_int_equal(b->verdict, BB_FAIL);
	assert_string_equal(b->culprit, "node/right");
	assert_string_equal(b->cause, "node/right draw took 24.9 ms at 1.000 s (limit 8.33 ms), 20 frames");
	assert_true(b->cause_ns == BB_NS_PER_S);
	assert_int_equal(g.r->exit_code, BB_EXIT_FAILED);
	bb_run_result_free(g.r);
}

/* The worst single frame is the left node's, but the right node spent far more. */
static void test_most_spent_wins(void **state)
{
	struct rig g = rig_create(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE);

	(void)state;
	add(&g, 30, 0, 1, 0, BB_STAGE_SELECT);
	for (uint64_t i = 10; i < 30; i++)
		add(&g, 20, 0, i, 1, BB_STAGE_DRAW);
	assert_string_equal(judge(&g)->culprit, "node/right");
	bb_run_result_free(g.r);

	g = rig_create(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE); /* often, but hardly: not the cause */
	for (uint64_t i = 10; i < 30; i++)
		add(&g, 8.01, 0, i, 0, BB_STAGE_DRAW);
	add(&g, 20, 0, 40, 1, BB_STAGE_DRAW);
	assert_string_equal(judge(&g)->culprit, "node/right");
	bb_run_result_free(g.r);
}

static void test_late_node_of_the_row(void **state)
{
	struct rig g = rig_create(BB_METRIC_SWAP_SKEW, BB_STAT_MAX, 500, NONE);

	(void)state;
	for (uint64_t i = 0; i < 50; i++) {
		const struct bb_frame_row row = { .frame = i, .late_node = i == 30 ? 1 : UINT32_MAX };
		bb_ledger_row(g.r->ledger, &row);
		add(&g, i == 30 ? 8000 : 10, 0, i, 0xFFFF, BB_STAGE_COUNT);
	}
	assert_string_equal(judge(&g)->culprit, "node/right");
	bb_run_result_free(g.r);
}

/* An ill device is named if it can have caused the miss and was ill at that time; else the node is. */
static void test_incidents(void **state)
{
	static const struct {
		const char *ill;
		int64_t from_ms, to_ms;
		enum bb_stage stage;
		const char *culprit;
	} cases[] = {
		{ "camera/c3", 900, 2000, BB_STAGE_WAIT, "camera/c3" },
		{ "camera/c3", 1300, 2000, BB_STAGE_WAIT, "camera/c3" },  /* noticed a little later */
		{ "camera/c3", 3000, 4000, BB_STAGE_WAIT, "cameras" },    /* long after */
		{ "camera/c3", 0, 400, BB_STAGE_WAIT, "cameras" },        /* over before */
		{ "camera/c3", 900, 2000, BB_STAGE_DRAW, "node/right" },  /* a camera does not slow a draw */
		{ "gamepad/pad", 900, 2000, BB_STAGE_WAIT, "cameras" },
		{ "node/left", 900, 2000, BB_STAGE_DRAW, "node/left" },
	};

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		struct rig g = rig_create(BB_METRIC_HEAD_TO_PHOTON, BB_STAT_MAX, 50, NONE);
		for (uint64_t k = 0; k < 200; k++)
			add(&g, k == 100 ? 90 : 30, 0, k, cases[i].stage == BB_STAGE_DRAW ? 1 : 0xFFFF, cases[i].stage);
		incident(&g, cases[i].ill, cases[i].from_ms * 1000000, cases[i].to_ms * 1000000);
		assert_string_equal(judge(&g)->culprit, cases[i].culprit);
		bb_run_result_free(g.r);
	}
}

static void test_devices_ok(void **state)
{
	struct rig g = rig_create(BB_METRIC_FRAME, BB_STAT_MAX, 8, NONE);
	const struct bb_budget_result *b;

	(void)state;
	add(&g, 5, 0, 1, 0, BB_STAGE_DRAW);
	device(&g, "camera", "c1", "OK", 0.5, 1);
	device(&g, "power", "pdu1", "LOST", 9, BB_NOT_NEEDED); /* not used: nobody cares */
	b = judge(&g);
	assert_int_equal(g.r->n_budgets, 2);
	assert_int_equal(b[1].budget.metric, BB_METRIC_DEVICES);
	assert_int_equal(b[1].verdict, BB_PASS);
	assert_int_equal(g.r->verdict, BB_PASS);

	device(&g, "camera", "c3", "OK", 2.5, 1);
	incident(&g, "camera/c3", 3 * BB_NS_PER_S, 5 * BB_NS_PER_S + 500000000);
	b = judge(&g);
	assert_int_equal(b[1].verdict, BB_FAIL);
	assert_string_equal(b[1].culprit, "camera/c3");
	assert_string_equal(b[1].cause, "camera/c3 not OK for 2.5 s (ill) from 3.000 s");

	device(&g, "gamepad", "pad", "LOST", 0.2, 1); /* short, but it never came back */
	b = judge(&g);
	assert_int_equal(b[1].verdict, BB_FAIL);
	assert_string_equal(b[1].culprit, "gamepad/pad");
	bb_run_result_free(g.r);
}

static void test_overall(void **state)
{
	struct rig g = rig_create(BB_METRIC_FRAME, BB_STAT_MAX, 8, 4);

	(void)state;
	add(&g, 5, 0, 1, 0, BB_STAGE_DRAW);
	judge(&g);
	assert_int_equal(g.r->verdict, BB_MARGINAL);
	assert_int_equal(g.r->exit_code, BB_EXIT_OK);
	assert_string_equal(g.r->budgets[0].culprit, "");
	assert_non_null(strstr(g.r->budgets[0].cause, "marginal 4"));
	g.r->truncated = true;
	judge(&g);
	assert_int_equal(g.r->verdict, BB_INCONCLUSIVE);
	assert_int_equal(g.r->exit_code, BB_EXIT_INCONCLUSIVE);
	bb_run_result_free(g.r);
}

static const struct bb_budget_result *budget_of(const struct bb_run_result *r, enum bb_metric metric, enum bb_stat stat)
{
	for (size_t i = 0; i < r->n_budgets; i++)
		if (r->budgets[i].budget.metric == metric && r->budgets[i].budget.stat == stat)
			return &r->budgets[i];
	return NULL;
}

static void test_whole_run(void **state)
{
	const struct fixture_options sick = { .faults = true, .n_frames = 1200 }, well = { .n_frames = 1200 };
	struct fixture *x = fixture_create(&sick);

	(void)state;
	x->room.budgets[2].marginal = NONE; /* phase */
	x->scene.budgets[3].limit = 100;    /* scanout skew */
	assert_int_equal(bb_result_judge(x->result), BB_OK);
	assert_int_equal(x->result->verdict, BB_FAIL);
	assert_string_equal(budget_of(x->result, BB_METRIC_FRAME, BB_STAT_MAX)->culprit, "node/right");
	assert_string_equal(budget_of(x->result, BB_METRIC_DEVICES, BB_STAT_MAX)->culprit, "camera/c3");
	assert_true(x->result->n_stages > BB_STAGE_COUNT);
	fixture_free(x);

	x = fixture_create(&well);
	x->room.budgets[2].marginal = NONE;
	x->scene.budgets[3].limit = 100;
	assert_int_equal(bb_result_judge(x->result), BB_OK);
	assert_int_equal(x->result->verdict, BB_PASS);
	assert_int_equal(x->result->exit_code, BB_EXIT_OK);
	fixture_free(x);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_edges),
		cmocka_unit_test(test_lower_limits),
		cmocka_unit_test(test_skips_say_why),
		cmocka_unit_test(test_counts_are_summed),
		cmocka_unit_test(test_tracked_is_a_share),
		cmocka_unit_test(test_node_and_stage),
		cmocka_unit_test(test_most_spent_wins),
		cmocka_unit_test(test_late_node_of_the_row),
		cmocka_unit_test(test_incidents),
		cmocka_unit_test(test_devices_ok),
		cmocka_unit_test(test_overall),
		cmocka_unit_test(test_whole_run),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
